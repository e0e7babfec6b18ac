"""What CONTRIBUTING promises: a method is thirty lines, a kind of experiment one folder and one line.

Both are written into a package of their own here, as a newcomer would write them, and are run from an experiment
file. A signal is a row, see tests/receiver/test_signals.py.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.experiments.template import template_for
from pl_mc.methods.registry import METHODS
from pl_mc.studies.registry import KINDS

METHOD = '''"""Least squares with a test of the largest whitened residual."""

from dataclasses import dataclass, replace

import jax.numpy as jnp

from pl_mc.kernels import least_squares, protection_levels
from pl_mc.methods.base import name_with_options, outcome_of


@dataclass(frozen=True)
class LargestResidual:
    """Alarms where a whitened residual is larger than ``limit``."""

    limit: float = 4.0

    @property
    def name(self):
        return name_with_options("largest_residual", self, LargestResidual())

    def prepare(self, model):
        return ()

    def solve(self, model, prepared, start):
        estimate = least_squares(model, start)
        outcome = outcome_of(estimate, protection_levels(estimate, k_horizontal=6.18, k_vertical=5.33))
        return replace(outcome, rejects=jnp.abs(start.residuals).max(axis=0) > self.limit)
'''

KIND = '''"""How often each method alarms without a fault."""

from typing import Literal

from pydantic import Field

from pl_mc.engine import sweep
from pl_mc.faults import no_fault
from pl_mc.report.document import Paragraph
from pl_mc.report.findings import Findings, Table
from pl_mc.report.text import event_text
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.study import Study, Work


class QuietExperiment(Experiment):
    """Draws without a fault."""

    kind: Literal["quiet"] = "quiet"
    draws: int = Field(default=500, ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry(epochs=1, epoch=0)


def run(experiment, execution):
    g = experiment.geometry.build()
    rates = sweep(
        g, no_fault(g), draws=experiment.draws, seed=experiment.seed, methods=experiment.method_records(),
        alert=experiment.alert_limits(), progress=False,
    )
    return Findings(summary=(Paragraph(f"{experiment.draws} draws."),), tables=(Table("rates", rates),))


def answer(tables, experiment):
    return tuple(f"{row.method}: {event_text(row, 'alarm')}." for row in tables["rates"].itertuples())


STUDY = Study(
    model=QuietExperiment,
    question="How often does each method alarm without a fault?",
    run=run,
    answer=answer,
    work=lambda experiment: Work(experiment.draws, experiment.draws / 1e6),
    outline={"kind": "quiet", "title": "Nothing happens"},
)
'''

EXPERIMENT = """kind = "quiet"
title = "Nothing happens"
draws = 300

[[methods]]
name = "ls"

[[methods]]
name = "largest_residual"
limit = 2.0
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package with the two files, and the line that each registry gets."""
    (tmp_path / "newcomer" / "quiet").mkdir(parents=True)
    (tmp_path / "newcomer" / "__init__.py").touch()
    (tmp_path / "newcomer" / "largest_residual.py").write_text(METHOD)
    (tmp_path / "newcomer" / "quiet" / "__init__.py").write_text(KIND)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(
        METHODS, "largest_residual", importlib.import_module("newcomer.largest_residual").LargestResidual
    )
    monkeypatch.setitem(KINDS.folders, "quiet", "newcomer.quiet")
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("newcomer")]:
        del sys.modules[name]


def test_a_method_is_thirty_lines() -> None:
    assert len(METHOD.splitlines()) <= 30


def test_both_run_from_an_experiment_file(package: Path) -> None:
    path = package / "quiet.toml"
    path.write_text(EXPERIMENT)
    checked = check_experiment(str(path))
    assert checked.problems == ()
    assert checked.cost is not None
    assert checked.cost.scenarios == 300
    name, experiment = load_experiment(str(path))
    result = run_experiment(name, experiment, package / "out")
    rates = pd.read_csv(package / "out" / "rates.csv")
    assert list(rates.method) == ["ls", "largest_residual(limit=2)"]
    # The largest of some sixteen standard normals is above 2 in most draws, and least squares never alarms there.
    assert rates.alarms[0] == 0
    assert 0 < rates.alarms[1] < 300
    assert result.answer[0].startswith("ls: 0 (<")
    manifest = json.loads((package / "out" / "manifest.json").read_text())
    assert manifest["experiment"]["kind"] == "quiet"
    page = (package / "out" / "report.html").read_text()
    assert "How often does each method alarm without a fault?" in page
    # And again from its manifest, and as a file to begin with.
    again = load_experiment(str(package / "out" / "manifest.json"))[1]
    assert again == experiment
    assert 'kind = "quiet"' in template_for("quiet")


def test_wrong_fields_of_the_kind_are_named(package: Path) -> None:
    path = package / "quiet.toml"
    path.write_text(EXPERIMENT.replace("draws = 300", "drawz = 300"))
    (problem,) = check_experiment(str(path)).problems
    assert (problem.field, problem.line) == ("drawz", 3)
    assert "draws" in problem.reason


def test_what_a_kind_gets_wrong_most_easily_is_told_before_anything_is_written(package: Path, tmp_path: Path) -> None:
    from pl_mc.report.document import Paragraph
    from pl_mc.report.files import write_findings
    from pl_mc.report.findings import Findings, Table

    table = Table("rates", pd.DataFrame({"draws": [1]}))
    folder = tmp_path / "nothing"
    folder.mkdir()
    for findings, answer, words in (
        (Findings("One text.", (table,)), ("a",), "tuples"),
        (Findings((Paragraph("a"),), (table,)), "One text.", "tuples"),
        (Findings((Paragraph("a"),), (table, table)), ("a",), "two tables have one name"),
    ):
        with pytest.raises((TypeError, ValueError), match=words):
            write_findings(findings, folder, title="t", kind="quiet", question="?", answer=answer, val_m=35.0)
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("lines", "field", "words"),
    [
        ('kind = ["map"]\ntitle = "t"\n', "kind", "is unknown"),
        ('kind = "map"\nview = "satellites"\ntitle = "t"\n', "kind", "'map' is unknown"),
        ('kind = "sweep"\nview = "maps"\ntitle = "t"\ndraws = 5\nfaults = { start_m = 1.0 }\n', "view", "not 'maps'"),
    ],
    ids=["a list", "a former kind with a view", "an unknown view"],
)
def test_kinds_and_views_that_are_none_are_named_and_nothing_else(
    lines: str, field: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(lines)
    (problem,) = check_experiment(str(path)).problems
    assert problem.field == field
    assert words in problem.reason
