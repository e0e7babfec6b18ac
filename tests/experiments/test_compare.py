"""The comparison of methods: its counts are those of the sweep, and only tests of one false-alarm rate rank."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import LPV_200, Judged
from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.methods import METHODS
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.compare import STUDY
from pl_mc.studies.compare.tables import EqualTables, equal_table, overview_table, same_curves
from pl_mc.studies.compare.text import findings
from pl_mc.studies.planned_sweep import PlannedSweep

DRAWS, SEED = 3000, 5
RAMP = {"satellite": "G22", "start_m": 20.0, "stop_m": 40.0, "step_m": 20.0}
SMALL = {
    "kind": "compare",
    "title": "small",
    "draws": DRAWS,
    "seed": SEED,
    "geometry": {"epochs": 1, "epoch": 0},
    "faults": RAMP,
    "methods": [{"name": "ls"}, {"name": "slope"}],
    "equal": {
        "p_fa": 0.05,
        "draws": DRAWS,
        "faults": RAMP | {"start_m": 4.0, "stop_m": 8.0, "step_m": 4.0},
        "methods": [{"name": "slope"}, {"name": "parity"}, {"name": "max_dop", "p_fa": 0.2}],
    },
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("compare") / "out"
    run_experiment("small", build_experiment(SMALL, source="test"), out)
    return out


def test_rates_are_those_of_the_sweep(folder: Path) -> None:
    rates = pd.read_csv(folder / "rates.csv", keep_default_na=False)
    g = pl_mc.simulate(epochs=1)[0]
    faults = pl_mc.no_fault(g) + pl_mc.ramp(g, satellite="G22", start_m=20.0, stop_m=40.0, step_m=20.0)
    table = pl_mc.sweep(g, faults, draws=DRAWS, seed=SEED, methods=("ls", "slope"))
    for event in ("alarms", "missed", "misleading", "hazards"):
        assert rates[event].tolist() == table[event].tolist()


def test_the_overview_takes_the_worst_bias_and_the_levels_without_a_fault(folder: Path) -> None:
    overview = pd.read_csv(folder / "overview.csv").set_index("method")
    rates = pd.read_csv(folder / "rates.csv", keep_default_na=False)
    g = pl_mc.simulate(epochs=1)[0]
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), draws=DRAWS, seed=SEED, methods=("ls", "slope"))
    for name, rows in rates.groupby("method"):
        row, faulted = overview.loc[name], rows[rows.fault != "none"]
        assert row.fault_free_alarm_rate == rows[rows.fault == "none"].alarm_rate.iloc[0]
        for event in ("missed", "misleading", "hazard"):
            assert row[f"{event}_rate"] == faulted[f"{event}_rate"].max()
        levels = drawn[drawn.method == name]
        within = (levels.vpl_m <= LPV_200.vertical_m) & (levels.hpl_m <= LPV_200.horizontal_m)
        assert row.within == within.sum()
        np.testing.assert_allclose(row.vpl_50_m, levels.vpl_m.median(), rtol=1e-12)


def test_a_test_of_another_false_alarm_rate_is_left_out(folder: Path) -> None:
    """0.05 was asked for; one test was set for 0.2 on purpose."""
    tests = pd.read_csv(folder / "equal.csv").set_index("method")
    assert tests.fits.to_dict() == {"slope(p_fa=0.05)": True, "parity(p_fa=0.05)": True, "max_dop(p_fa=0.2)": False}
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert "these have another one and are left out of what follows: max_dop(p_fa=0.2)" in text
    assert "slope(p_fa=0.05) and parity(p_fa=0.05) alarm equally often" in text
    for name in ("methods.png", "tests.png"):
        assert (folder / name).stat().st_size > 20_000


def test_counts_that_do_not_fit_are_told_by_an_exact_test() -> None:
    """Of 10,000 draws 100 and 120 may belong to 1 %, 200 do not; the level is shared by the three."""
    alarms = np.array([100, 120, 200])
    rates = pd.DataFrame({"method": list("abc"), "fault": "none", "draws": 10_000, "alarms": alarms})
    rates = rates.assign(alarm_rate=alarms / 1e4, alarm_low=0.0, alarm_high=1.0)
    assert equal_table(rates, 0.01).fits.tolist() == [True, True, False]


def made_up() -> pd.DataFrame:
    """Two methods, of which one never misses; 1000 draws."""
    rows = []
    for name, missed in (("a", (0, 0, 0)), ("b", (0, 10, 30))):
        for fault, bias, count in zip(("none", "G01:+5m", "G01:+10m"), (0.0, 5.0, 10.0), missed, strict=True):
            row = {"method": name, "fault": fault, "bias_m": bias, "draws": 1000, "alarms": 0}
            for event in ("alarm", "misleading", "hazard"):
                row |= {f"{event}_rate": 0.0, f"{event}_low": 0.0, f"{event}_high": 0.0037}
            rows.append(row | {"missed_rate": count / 1000, "missed_low": 0.001, "missed_high": 0.05})
    return pd.DataFrame(rows)


def test_findings_say_what_was_seen_and_bound_what_was_not() -> None:
    fault_free = pd.DataFrame(
        {"method": ["a", "b"], "draws": 1000, "within": [1000, 900], "availability": [1.0, 0.9],
         "availability_low": [0.996, 0.88], "availability_high": [1.0, 0.92], "vpl_50_m": [9.0, 8.0],
         "vpl_95_m": [9.0, 8.0]}
    )  # fmt: skip
    overview = overview_table(made_up(), fault_free)
    sentences = findings(overview, None, Judged(LPV_200))
    missed = next(sentence for sentence in sentences if sentence.startswith("Missed"))
    assert "3 % [0.1, 5] at 10 m with b; none (each < 5 %) with a." in missed
    assert "none (each < 0.37 %) with a and b" in sentences[0]
    assert "90 % [88, 92] with b" in sentences[1]
    assert "all draws (> 99.60 %) with a" in sentences[1]
    assert "8.000 m with b, 9.000 m with a" in sentences[2]


def test_methods_with_the_same_counts_share_a_curve() -> None:
    twice = pd.concat([made_up(), made_up().assign(method=lambda t: t.method + "2")])
    assert list(same_curves(twice, "missed")) == [("a", "a2"), ("b", "b2")]
    empty = EqualTables(twice, pd.DataFrame({"method": ["a"], "fits": [False]}), 0.01)
    assert empty.comparable.empty


def test_the_answer_of_stored_tables_is_the_one_of_the_run(folder: Path) -> None:
    experiment = build_experiment(SMALL, source="test")
    stored = read_run_folder(folder)
    sentences = STUDY.answer(stored.tables, experiment)
    assert stored.document is not None
    assert sentences == stored.document.answer
    assert len(sentences) == 3
    assert all("least squares (VPL) " in sentence and "of 2 methods." in sentence for sentence in sentences)


def test_wrong_tests_are_named_before_anything_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PlannedSweep, "run", lambda *_: pytest.fail("it counted"))
    changed = SMALL | {"equal": SMALL["equal"] | {"methods": [{"name": "ls"}]}}
    with pytest.raises(InputError, match=r"equal.methods"):
        STUDY.run(build_experiment(changed, source="test"), Execution())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"equal": SMALL["equal"] | {"methods": [{"name": "ls"}]}}, "equal.methods: ls has no test"),
        ({"equal": SMALL["equal"] | {"methods": [{"name": "slop"}]}}, "method: 'slop' is unknown"),
        ({"geometry": {"epochs": 2}}, "geometry.epoch: this kind of experiment needs one epoch"),
    ],
)
def test_what_cannot_be_used_says_why(changed: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        run_experiment("small", build_experiment(SMALL | changed, source="test"), tmp_path / "out")


def test_the_shipped_comparison_has_every_method() -> None:
    _, experiment = load_experiment("compare-methods")
    assert {choice.name for choice in experiment.methods} == set(METHODS)
    assert all(one.p_fa > 0 for one in experiment.equal.records())
