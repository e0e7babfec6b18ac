"""A sweep of a method that excludes: its columns in the stored table, in the chart of its page, and in a comparison."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.kernels.events import EXCLUSIONS
from pl_mc.report.comparison import compare_runs
from pl_mc.report.findings import event_quantities
from pl_mc.report.run_folder import read_run_folder

ARAIM = {"name": "araim", "p_const": 0.0, "b_nom_m": 0.0}
SWEEP = {
    "kind": "sweep", "title": "exclusions", "draws": 300, "alert": "APV-I",
    "geometry": {"site": "CUT0", "epoch": 0, "constellations": ["GPS", "BDS-2"]},
    "faults": {"satellite": "G01", "start_m": 20.0, "stop_m": 60.0, "step_m": 20.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    made = []
    for name, seed, exclusion in (("one", 1, "satellites"), ("two", 2, "satellites"), ("none", 1, "none")):
        content = SWEEP | {"seed": seed, "methods": [ARAIM | {"exclusion": exclusion}]}
        made.append(tmp_path_factory.mktemp("runs") / name)
        run_experiment(name, build_experiment(content, source="test"), made[-1])
    return tuple(made)


def test_the_stored_table_and_its_chart_have_exclusions(folders: tuple[Path, Path, Path]) -> None:
    table, without = (pd.read_csv(folder / "rates.csv") for folder in (folders[0], folders[2]))
    large = table[table.bias_m == 60.0].iloc[0]
    assert large.right_exclusions > 0.9 * large.draws
    assert large[[event.count for event in EXCLUSIONS]].sum() == large.draws - large.unavailable
    named = [quantity.count for quantity in event_quantities(table)]
    assert named[-len(EXCLUSIONS) :] == [event.count for event in EXCLUSIONS]
    assert [quantity.count for quantity in event_quantities(without)] == [q.count for q in event_quantities()]
    for folder, has in zip(folders, (True, True, False), strict=True):
        assert ("wrong exclusion" in (folder / "report.html").read_text(encoding="utf-8")) is has


def test_runs_are_compared_by_them(folders: tuple[Path, Path, Path]) -> None:
    found = compare_runs(*map(read_run_folder, folders[:2])).rates
    rows = found[found.event == "right_exclusion"]
    assert len(rows) == 3
    assert not rows.differs.any()
    # Where one of the runs excludes nobody there is nothing to compare.
    assert not compare_runs(*map(read_run_folder, folders[::2])).rates.event.str.contains("exclusion").any()
