"""Figures in another look: drawn again from stored tables, for print at a width of one's own, in greys, as PDF."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.redrawing import figure_fields, redraw
from pl_mc.experiments.running import merge, run_experiment, run_shard
from pl_mc.experiments.verifying import verify
from pl_mc.input_errors import InputError
from pl_mc.report.figures import in_common_look, legend_below, new_figure
from pl_mc.report.look import Look, drawn_in, styles_of
from pl_mc.report.run_folder import StoredTables, read_run_folder
from pl_mc.studies.registry import study_of
from reference.small_run import SMALL, ended

pytestmark = pytest.mark.drawn

EPOCH = {"epochs": 1, "epoch": 0}
RAMP = {"satellite": "G12", "start_m": 20.0, "stop_m": 40.0, "step_m": 20.0}
KINDS: dict[str, dict[str, Any]] = {
    "satellites": SMALL | {
        "view": "satellites", "draws_per_satellite": 100, "axes": ["vertical", "either"], "methods": ["ls"],
    },
    "map": {
        "kind": "sweep", "view": "map", "title": "t", "draws": 40, "seed": 5, "geometry": {"epochs": 3},
        "faults": {"start_m": 20, "stop_m": 60, "step_m": 40}, "methods": ["ls"],
    },
    "stanford": {
        "kind": "stanford", "title": "t", "draws": 300, "seed": 3, "geometry": EPOCH,
        "faults": {"start_m": 10.0, "stop_m": 40.0, "step_m": 30.0}, "methods": ["ls"],
    },
    "compare": {
        "kind": "compare", "title": "t", "draws": 300, "seed": 3, "faults": RAMP, "methods": ["ls", "slope"],
        "geometry": EPOCH, "equal": {"p_fa": 0.05, "draws": 300, "faults": RAMP, "methods": ["slope", "parity"]},
    },
    "series": {
        "kind": "series", "title": "t", "seed": 3, "compare": "static", "redraws": 0,
        "source": {"kind": "site", "epochs": 40}, "faults": {"biases": ["G12:+60m:10-29"]},
    },
    "service": {
        "kind": "service", "title": "t", "draws": 2, "operations": ["CAT-I"], "step_deg": 60.0, "step_s": 7200.0,
        "duration_s": 14400.0, "durations_s": [], "methods": ["ls"],
    },
}  # fmt: skip


def files(folder: Path, *endings: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for ending in endings for path in sorted(folder.glob(f"*.{ending}"))}


@pytest.mark.parametrize("kind", KINDS)
def test_figures_from_stored_tables_are_those_of_the_run(kind: str, tmp_path: Path) -> None:
    experiment = build_experiment(KINDS[kind] | {"figures": {"format": "svg"}}, source="test")
    folder = run_experiment("one", experiment, tmp_path / "out").folder
    drawn = files(folder, "svg")
    document = read_run_folder(folder).document
    assert document is not None
    assert {f"{entry.name}.svg" for entry in document.figures} == set(drawn)
    assert drawn
    assert not files(folder, "png", "pdf")
    for name in drawn:
        (folder / name).unlink()
    assert redraw(folder, figure_fields({"format": "svg"})) == ()
    assert files(folder, "svg") == drawn
    # Stored rows of epochs are a folder of their own.
    found = verify(folder)
    assert found.changed == found.missing == ()
    assert set(found.foreign) <= {"epochs"}


def test_a_map_of_nothing_is_a_sentence(tmp_path: Path) -> None:
    content = KINDS["map"] | {"methods": ["ls"], "alert": {"name": "far", "vertical_m": 1000.0}}
    run = run_experiment("one", build_experiment(content, source="test"), tmp_path / "out")
    assert not (run.folder / "map_missed.png").exists()
    (said,) = (note for note in run.notes if note.startswith("No map of missed"))
    assert "VAL 1000 m: it was seen at no epoch" in said
    assert "bounds its rate" in said


@pytest.mark.parametrize("style", ["paper", "grey"])
def test_print_is_as_wide_as_asked_and_legible(style: Any, finished: Path) -> None:
    _, experiment = load_experiment(str(finished / "manifest.json"))
    (picture,) = study_of(experiment).pictures(StoredTables(finished), experiment)
    with drawn_in(Look(style, 88.0)):
        figure = picture.figure
    assert figure.get_figwidth() * 25.4 == pytest.approx(88.0)
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
    assert all(7.0 <= text.get_fontsize() <= 9.0 for text in texts)
    assert figure.get_suptitle() == ""
    figure.canvas.draw()
    (legend,) = figure.legends
    assert 0 <= legend.get_window_extent().x0 < legend.get_window_extent().x1 <= figure.bbox.width
    for upper, lower in itertools.pairwise(panel.get_tightbbox() for panel in figure.axes):
        assert lower.y1 <= upper.y0 + 1.0
    # Told apart by colours, or else by lines and markers.
    lines = [line for line in figure.axes[0].get_lines() if line.get_label()[0] != "_"]
    assert len({(line.get_linestyle(), line.get_marker()) for line in lines}) == len(lines) == 2
    is_grey = [np.ptp(to_rgb(line.get_color())) == 0.0 for panel in figure.axes for line in panel.get_lines()]
    assert all(is_grey) if style == "grey" else not all(is_grey)


@in_common_look
def panels(rows: int, columns: int) -> Figure:
    figure, axes = new_figure(
        rows, columns, width_in=4.0 * columns, height_in=3.0 * rows, sharex=True, sharey="row", title="A heading"
    )
    for k, panel in enumerate(axes):
        panel.plot(
            [1.0, 2.0], [1.0, 10.0 ** (k % columns)], label=f"a method with a name that is rather long ({k % 3})"
        )
        panel.set_title("a title that is much wider than a narrow panel")
        panel.set_yscale("log")
    for row in range(rows):
        axes[row * columns].set_ylabel("what it is [m]")
    for panel in axes[-columns:]:
        panel.set_xlabel("bias [m]")
    legend_below(figure, axes, columns=3)
    return figure


@pytest.mark.parametrize(("width_mm", "across"), [(180.0, 4), (88.0, 2), (60.0, 1)])
def test_columns_go_below_each_other_where_they_find_no_room(width_mm: float, across: int) -> None:
    with drawn_in(Look("paper", width_mm)):
        figure = panels(2, 4)
    figure.canvas.draw()
    places = {round(panel.get_position().x0, 2) for panel in figure.axes}
    assert len(places) == across
    # What begins a line has the name of the axis and its figures, the last line that of the other one.
    first = [panel for panel in figure.axes if round(panel.get_position().x0, 2) == min(places)]
    assert all(panel.get_ylabel() and panel.yaxis.get_tick_params()["labelleft"] for panel in first)
    assert all(panel.get_position().height * figure.get_figheight() > 1.0 for panel in figure.axes)
    boxes = [panel.get_tightbbox() for panel in figure.axes]
    (legend,) = figure.legends
    boxes.append(legend.get_window_extent())
    for one, other in itertools.combinations(boxes, 2):
        assert one.x1 <= other.x0 + 1 or other.x1 <= one.x0 + 1 or one.y1 <= other.y0 + 1 or other.y1 <= one.y0 + 1
    assert all(0 <= box.x0 < box.x1 <= figure.bbox.width + 1 for box in boxes)


def test_a_screen_may_have_a_width_too_and_is_as_ever_without() -> None:
    with drawn_in(Look("screen", 120.0)):
        figure = panels(1, 2)
    assert figure.get_figwidth() * 25.4 == pytest.approx(120.0)
    assert figure.get_suptitle() == "A heading"
    assert panels(1, 2).get_figwidth() == 8.0


def test_a_pdf_has_its_fonts_and_no_time(copied: Path) -> None:
    fields = figure_fields({"format": "pdf", "style": "paper", "width": "3.5in"})
    assert redraw(copied, fields) == ()
    content = (copied / "rates.pdf").read_bytes()
    assert b"/FontFile2" in content
    assert b"/CIDFontType2" in content
    assert b"/Type3" not in content
    assert b"CreationDate" not in content
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) [\d.]+ \]", content)
    assert float(box) == pytest.approx(3.5 * 72.0)
    redraw(copied, fields)
    assert (copied / "rates.pdf").read_bytes() == content


def test_a_report_touches_figures_only_where_it_is_asked_to(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files(copied, "png", "svg")
    assert ended("report", str(copied)) == 0
    assert files(copied, "png", "svg", "pdf") == before
    assert ended("report", str(copied), "--format", "pdf", "--style", "paper", "--width", "88mm") == 0
    # What a page shows stays as it was.
    assert files(copied, "png", "svg") == before
    assert set(files(copied, "pdf")) == {"rates.pdf"}
    assert ended("verify", str(copied)) == 0
    assert ended("report", str(copied), "--style", "grey", "--width", "8.8cm") == 0
    with Image.open(copied / "rates.png") as image:
        assert image.width == pytest.approx(88.0 / 25.4 * 300.0, abs=1.0)
        pixels = np.asarray(image.convert("RGB")).astype(int)
        assert np.ptp(pixels, axis=2).max() == 0
    manifest = json.loads((copied / "manifest.json").read_text())
    assert [one["format"] for one in manifest["redrawn"]] == [["pdf"], ["png", "svg"]]
    # Another run, whose figures are drawn again in the same ways, gives the same files.
    found = verify(copied, redo=True)
    assert found.passed
    assert {"rates.pdf", "rates.png", "rates.svg"} <= set(found.same)


def test_what_cannot_be_drawn_again_is_named(copied: Path) -> None:
    (copied / "levels.csv").unlink()
    (said,) = redraw(copied, figure_fields({"style": "paper"}))
    assert said == (
        "Not drawn again, since the folder does not hold all that they are made of: rates (the table levels is not in "
        f"the folder); pl-mc run {copied / 'manifest.json'} with the same options draws them."
    )
    assert "redrawn" not in json.loads((copied / "manifest.json").read_text())
    (copied / "rates.csv").write_text("changed\n")
    with pytest.raises(InputError, match=r"rates\.csv: it is not what the run wrote; no figure is drawn from it"):
        redraw(copied, figure_fields({"style": "paper"}))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"width": "88"}, "--width: a length of 60mm to 420mm with its unit is needed, such as 88mm, not '88'."),
        ({"width": "20mm"}, "--width: a length of 60mm to 420mm with its unit is needed (nearest: 60mm), not '20mm'."),
        ({"width": "40in"}, "--width: a length of 60mm to 420mm with its unit is needed (nearest: 420mm), not '40in'."),
        ({"format": "png,jpg"}, "--format: the forms of a figure are png, svg, pdf, one or several, not 'png,jpg'."),
        ({"format": []}, "--format: the forms of a figure are png, svg, pdf, one or several, not []."),
        ({"format": "png,svg,png"}, "--format: png stands there twice, not 'png,svg,png'."),
        ({"format": "bmp"}, "--format: the forms of a figure are png, svg, pdf, one or several, not 'bmp'."),
        ({"style": "gray"}, "--style: "),
    ],
)
def test_what_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as refused:
        figure_fields(given)
    assert str(refused.value).startswith(said)


def test_figures_are_no_matter_of_numbers(tmp_path: Path) -> None:
    drawn = {"figures": {"format": "pdf,png", "style": "grey", "width": "88mm"}}
    plain, asked = (build_experiment(SMALL | more, source="test") for more in ({}, drawn))
    assert plain.model_dump(mode="json") == asked.model_dump(mode="json")
    # A share counts in the one way; the results are drawn in the other one.
    for share in (1, 2):
        run_shard("small", asked, tmp_path / "share", Execution(shard=(share, 2)))
    folder = merge([tmp_path / "share"], tmp_path / "merged").folder
    manifest = json.loads((folder / "manifest.json").read_text())
    assert "figures" not in manifest["experiment"]
    assert manifest["figures"] == {"format": ["png", "pdf"], "style": "grey", "width": "88mm"}
    assert set(files(folder, "png", "svg", "pdf")) == {"rates.png", "rates.pdf"}
    assert load_experiment(str(folder / "manifest.json"))[1].figures == asked.figures
    # The command line goes before the file.
    _, changed = load_experiment(str(folder / "manifest.json"), figures={"width": "90mm"})
    assert (changed.figures.style, changed.figures.width) == ("grey", "90mm")
    again = run_experiment("small", plain, folder, execution=Execution(resume=True))
    assert not any("its figures are as they were" in note for note in again.notes)
    again = run_experiment("small", changed, folder, execution=Execution(resume=True))
    assert any("its figures are as they were" in note for note in again.notes)


def test_a_method_looks_the_same_everywhere_and_no_two_alike() -> None:
    few, other = styles_of(["ls", "igg3"]), styles_of(["araim", "igg3(k1=4.0)", "made_up", "ls"])
    assert few["ls"] == other["ls"]
    assert few["igg3"] == other["igg3(k1=4.0)"]
    assert (few["ls"].colour, few["ls"].line, few["ls"].marker) == ("#0072B2", "-", "o")
    # Of two of a family that without options has its look, and nobody else while there are others.
    assert styles_of(["ls(level_scale=floored)", "made_up", "ls"])["ls"] == few["ls"]
    assert few["ls"] not in styles_of(["made_up", *(f"made_up_{k}" for k in range(12))]).values()
    many = [f"{name}(k={k})" for name in ("ls", "igg3", "separated", "made_up") for k in range(12)]
    for style in ("screen", "grey"):
        with drawn_in(Look(style)):
            styles = styles_of(many)
        assert list(styles) == many
        assert len({(one.colour, one.line, one.marker) for one in styles.values()}) == len(many)
    with drawn_in(Look("grey")):
        assert all(np.ptp(to_rgb(one.colour)) == 0.0 for one in styles_of(many).values())
