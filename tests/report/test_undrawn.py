"""Texts of users are texts, and a figure that cannot be drawn costs that figure alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from PIL import Image

from pl_mc.report.artists import Undrawn
from pl_mc.report.figures import in_common_look, new_figure, save_figure
from pl_mc.report.files import write_findings
from pl_mc.report.findings import Findings, Picture, Table

pytestmark = pytest.mark.drawn

TITLES = ["price $x_{$", "$$", r"\frac{1}{0} $\undefined$", "a_b^c", "5 $ and 6 $", "%s {} {{", r"$\mathdefault{10}$"]


@in_common_look
def drawn(title: str, *, logarithmic: bool = True) -> Figure:
    figure, (axes,) = new_figure(1, 1, width_in=4.0, height_in=3.0, title=title)
    axes.plot([1.0, 2.0, 3.0], [1e-7, 1e-3, 1.0], label=title)
    axes.set_xlabel(title)
    axes.set_yscale("log" if logarithmic else "linear")
    axes.bar([title, f"{title} too"], [1.0, 2.0]) if not logarithmic else None
    axes.legend()
    return figure


@pytest.mark.parametrize("title", TITLES)
@pytest.mark.parametrize("logarithmic", [True, False])
def test_text_is_text(title: str, logarithmic: bool, tmp_path: Path) -> None:
    assert save_figure(drawn(title, logarithmic=logarithmic), tmp_path, "one") == ""
    text = (tmp_path / "one.svg").read_text(encoding="utf-8")
    shown = title.replace("&", "&amp;")
    assert text.count(f">{shown}<") >= 3
    if logarithmic:
        assert ">$\\mathdefault{10^" not in text
        assert text.count(">10⁻⁴<") == text.count(">10⁰<") == 1


def _findings(figure: Figure) -> Findings:
    table = Table("rates", pd.DataFrame({"bias_m": [1.0, 2.0]}))
    good, bad = Picture("good", "Good.", lambda: drawn("A title")), Picture("bad", "Bad.", lambda: figure)
    return Findings(("Words.",), (table,), (good, bad))


class _Strange(Figure):
    def draw(self, *args: object, **kwargs: object) -> None:
        raise RuntimeError("no ink")


@pytest.mark.parametrize("figure", [Undrawn("ValueError: no ink"), _Strange()])
def test_a_figure_that_fails_costs_that_figure(figure: Figure, tmp_path: Path) -> None:
    document = write_findings(
        _findings(figure), tmp_path, title="T", kind="k", question="Q?", answer=("A.",), val_m=1.0
    )
    assert [entry.name for entry in document.figures] == ["good"]
    (note,) = document.notes
    assert note.startswith("The figure bad could not be drawn (")
    assert "no ink" in note
    assert note in (tmp_path / "summary.md").read_text(encoding="utf-8")
    assert {path.name for path in tmp_path.iterdir()} == {
        "good.png", "good.svg", "rates.csv", "report.json", "summary.md",
    }  # fmt: skip
    with Image.open(tmp_path / "good.png") as image:
        assert np.asarray(image).std() > 0


def test_a_function_that_fails_gives_what_stands_for_its_figure() -> None:
    def draw() -> Figure:
        raise ZeroDivisionError("nothing to divide by")

    figure = Picture("one", "One.", draw).figure
    assert isinstance(figure, Undrawn)
    assert figure.reason == "ZeroDivisionError: nothing to divide by"
