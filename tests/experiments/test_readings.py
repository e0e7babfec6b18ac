"""Readings of the paper side by side: each changes what it says, and the distance is what its formula says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.readings import STUDY
from pl_mc.studies.readings.run import distance_table
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS

SMALL = {
    "kind": "readings",
    "title": "small",
    "compare": "static",
    "seed": 3,
    "redraws": 1,
    "source": {"kind": "site", "epochs": 40},
    "faults": {"windows": [[10, 19]]},
    "readings": [
        {"varies": "base", "label": "defaults"},
        {"varies": "scale", "label": "apriori", "igg3": {"scale": "apriori"}},
        {"varies": "sizes", "label": "small", "faults": {"highest_m": 6.0}},
    ],
}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("readings") / "small"
    run_experiment("small", build_experiment(SMALL, source="test"), folder)
    return folder


def test_each_reading_changes_what_it_says(small: Path) -> None:
    draws = pd.read_csv(small / "readings.csv")
    assert len(draws) == 3 * 2 * 2
    plain = draws[draws.role == "before"].set_index(["reading", "redraw"])
    robust = draws[draws.role == "after"].set_index(["reading", "redraw"])
    # Another scale leaves least squares alone; other sizes do not.
    for redraw in (0, 1):
        assert plain.up_95_m["apriori", redraw] == plain.up_95_m["defaults", redraw]
        assert plain.up_95_m["small", redraw] < plain.up_95_m["defaults", redraw]
    assert set(robust.method["apriori"]) == {"igg3(scale=apriori)"}
    distances = pd.read_csv(small / "distances.csv")
    assert list(distances.reading) == ["defaults", "apriori", "small"]


def test_a_run_writes_nothing_and_answers_alike_of_tables_read_back(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = build_experiment(SMALL, source="test")
    findings = STUDY.run(experiment, Execution(progress=False))
    assert list(tmp_path.iterdir()) == []
    tables = read_run_folder(small).tables
    assert set(findings.data) == set(tables)
    assert STUDY.answer(findings.data, experiment) == STUDY.answer(tables, experiment)


def test_the_distance_is_a_typical_factor() -> None:
    paper = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    rows = []
    for redraw, factor in enumerate((2.0, 0.5, 4.0)):
        for role in ("before", "after"):
            values = dict(zip(ACCURACY_COLUMNS, paper.ravel() * (factor if role == "before" else 1.0), strict=True))
            rows.append(
                {"varies": "x", "reading": "r", "role": role, "redraw": redraw, "alarms": 1, "faulted_epochs": 2,
                 "unavailable": 0, "median_clean_vpl_m": 5.0, "clean_alarm_rate": 0.0} | values
            )  # fmt: skip
    (row,) = distance_table(pd.DataFrame(rows), paper, paper).to_dict("records")
    assert row["after_factor"] == pytest.approx(1.0)
    # Twice and half are equally far; the median of 2, 2, 4 is 2.
    assert row["before_factor"] == pytest.approx(2.0)
    assert row["before_factor_high"] == pytest.approx(4.0)
    assert row["before_alarm_rate"] == 0.5


def test_a_reading_that_makes_no_sense_is_named() -> None:
    wrong = SMALL | {"readings": [{"varies": "scale", "label": "mine", "faults": {"highest_mm": 3.0}}]}
    experiment = build_experiment(wrong, source="test")
    with pytest.raises(InputError, match=r"readings, mine: faults\.highest_mm: .*nearest: highest_m"):
        experiment.series(experiment.readings[0])  # type: ignore[attr-defined]
