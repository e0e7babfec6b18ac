"""The experiments about risk: cells and regions that are a sweep's counts, tables with exact rows, bad input."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.engine import Execution
from pl_mc.engine.stanford import (
    BEYOND,
    HAZARDOUS,
    MISLEADING,
    NO_SOLUTION,
    REGIONS,
    UNAVAILABLE,
    Grid,
    stanford_counts,
)
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3, as_methods
from pl_mc.report.files import to_markdown
from pl_mc.statistics import clopper_pearson
from pl_mc.studies.risk import STUDY

# Three plain solutions are compiled and solved in a part of the time that settled ones take.
ROBUST = Igg3(iterations=3)
METHODS = ["ls", {"name": "igg3", "iterations": 3}]
STANFORD = {
    "kind": "stanford",
    "title": "small",
    "draws": 300,
    "seed": 3,
    "noise_scale": 3.0,
    "methods": METHODS,
    "geometry": {"epochs": 3, "interval_s": 7200.0},
    "faults": {"start_m": 10.0, "stop_m": 40.0, "step_m": 30.0},
}
RISK = {
    "kind": "risk",
    "title": "small",
    "seed": 5,
    "noise_scale": 3.0,
    "methods": METHODS,
    "geometry": {"epochs": 1, "epoch": 0},
    "curves": {"satellites": ["G22"], "step_m": 5.0, "misleading_m": [12.5], "target_cov": 0.3},
    "budgets": [{"method": "ls", "pairs": 0, "p_const": 0.0}],
    "calibration": {
        "targets": [1e-1, 1e-2],
        "faults": [{}, {"G22": 12.5}],
        "fewest_draws": 2000,
        "alarm_satellite": "G22",
        "alarm_biases_m": [0.0, 20.0],
        "alarm_draws": 300,
    },
}


def test_regions_and_cells_are_the_counts_of_the_sweep(tmp_path: Path) -> None:
    run_experiment("small", build_experiment(STANFORD, source="test"), tmp_path / "out")
    g = pl_mc.simulate(epochs=3, interval_s=7200.0)
    regions = pd.read_csv(tmp_path / "out" / "regions.csv").set_index(["method", "region"])
    cells = pd.read_csv(tmp_path / "out" / "stanford.csv")
    # Noise and weights with three times the sigma.
    tripled = dataclasses.replace(g, sigma_m=3.0 * g.sigma_m)
    faults = pl_mc.ramps(tripled, satellites=g.names, start_m=10.0, stop_m=40.0, step_m=30.0)
    counts = (
        pl_mc.sweep(tripled, faults, draws=300, seed=3, methods=("ls", ROBUST)).groupby("method").sum(numeric_only=True)
    )
    for method in ("ls", ROBUST.name):
        count, total = regions.loc[method]["count"], counts.loc[method]
        assert count.sum() == total.draws == regions.loc[method].scenarios.iloc[0]
        assert count[HAZARDOUS] == total.missed
        assert count[MISLEADING] + count[HAZARDOUS] == total.misleading
        assert count[UNAVAILABLE] + count[BEYOND] + count[NO_SOLUTION] == total.alarms
        assert count[MISLEADING] + count[HAZARDOUS] + count[BEYOND] == total.exceeded
        mine = cells[cells.method == method]
        assert mine["count"].sum() == total.draws
        # A cell wholly beyond VAL on the level's axis alarms, one wholly below does not.
        assert mine[mine.level_from_m >= 35.0]["count"].sum() == total.alarms
        assert mine[(mine.error_from_m >= 35.0)]["count"].sum() == total.hazards
    # The case is one in which everything but the rarest happens.
    assert counts.loc[ROBUST.name].misleading > 0
    assert counts.loc["ls"].alarms > 0
    # Every draw counts once for the bounds, though all faults of an epoch share it.
    assert (regions.independent_draws == 900).all()
    empty = regions[regions["count"] == 0]
    np.testing.assert_allclose(empty.high, clopper_pearson(0, 900)[1])
    assert (tmp_path / "out" / "stanford.png").stat().st_size > 20_000


def test_neither_the_cut_nor_the_number_of_threads_moves_a_count() -> None:
    g = pl_mc.simulate(epochs=2, interval_s=7200.0)
    faults = pl_mc.no_fault(g)
    options = {"draws": 300, "seed": 3, "methods": as_methods(["ls", ROBUST]), "alert": pl_mc.LPV_200}
    coarse = stanford_counts(g, faults, grid=Grid(60.0, 2.0), workers=1, **options)
    fine = stanford_counts(g, faults, grid=Grid(60.0, 0.5), workers=2, **options)
    assert coarse.scenarios == fine.scenarios == 600
    np.testing.assert_array_equal(coarse.counts.sum(axis=(2, 3)), fine.counts.sum(axis=(2, 3)))
    inner = fine.counts[:, :, :-1, :-1].reshape(2, len(REGIONS), 30, 4, 30, 4).sum(axis=(3, 5))
    np.testing.assert_array_equal(inner, coarse.counts[:, :, :-1, :-1])
    # Errors and levels themselves, one by one.
    drawn = pl_mc.sample(g, faults, draws=300, seed=3, methods=[ROBUST])
    expected, *_ = np.histogram2d(drawn.up_m.abs(), drawn.vpl_m, bins=[Grid().edges_m] * 2)
    np.testing.assert_array_equal(fine.counts[1].sum(axis=0), expected)


def test_an_epoch_without_redundancy_has_no_solution() -> None:
    day = pl_mc.simulate(epochs=1)[0]
    rows = [k for k, letter in enumerate(day.systems) if letter == "G"][:4]
    g = pl_mc.Geometry.from_arrays(
        day.design[rows][:, :4], day.sigma_m[rows], [day.systems[k] for k in rows], [day.names[k] for k in rows]
    )
    found = stanford_counts(
        g, pl_mc.no_fault(g), draws=50, seed=1, methods=as_methods(["ls"]), alert=pl_mc.LPV_200, grid=Grid()
    )
    table = found.regions().set_index("region")
    assert table.loc[NO_SOLUTION, "count"] == 50
    assert found.cells().error_from_m.isna().all()


def test_the_risk_experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # One thread: two would compile the same at the same time.
    experiment = build_experiment(RISK, source="test")
    findings = STUDY.run(experiment, Execution(workers=1, progress=False))
    # What a study finds is written by others.
    assert list(tmp_path.iterdir()) == []
    day = pl_mc.simulate(epochs=1)[0]
    g = dataclasses.replace(day, sigma_m=3.0 * day.sigma_m)
    read = findings.data
    curves = read["curves"]
    line = curves[(curves.method == "ls") & (curves.event == "missed")]
    faults = pl_mc.ramp(g, satellite="G22", start_m=0.0, stop_m=100.0, step_m=5.0)
    np.testing.assert_allclose(line.probability, pl_mc.exact.ls_rates(g, faults).missed_rate, rtol=1e-9)
    estimates = curves[curves.method == ROBUST.name]
    assert list(estimates.bias_m) == [12.5]
    assert ((estimates.low <= estimates.probability) & (estimates.probability <= estimates.high)).all()
    # The worst bias is at least as bad as anything on the ramp, and the steps lead over it.
    worst = read["worst"]
    for event in ("misleading", "missed"):
        rows = worst[worst.event == event].set_index("satellites")
        assert set(rows.index) == set(g.names)
        along = curves[(curves.method == "ls") & (curves.event == event)].probability
        assert rows.probability["G22"] >= along.max()
        steps = read["steps"][read["steps"].event == event]
        assert steps.probability.max() == pytest.approx(rows.probability.max(), rel=1e-2)
    # Multipliers keep their targets, and the one for all faults is the largest.
    calibration = read["calibration"]
    exact = calibration[calibration.method == "ls"]
    np.testing.assert_allclose(exact.probability, exact.target, rtol=1e-6)
    counted = calibration[calibration.method == ROBUST.name]
    assert (counted.found == "counting").all()
    assert (counted.k_low <= counted.k_high).all()
    assert (calibration.groupby(["method", "target"]).decides.sum() == 1).all()
    equal = read["equal_risk"]
    for (method, target), rows in equal.groupby(["method", "target"]):
        same = calibration[(calibration.method == method) & (calibration.target == target)]
        assert rows.k_vertical.iloc[0] == pytest.approx(same.k_high.max())
        alarm = rows.set_index("bias_m").alarm_rate
        both = pl_mc.no_fault(g) + pl_mc.biases(g, {"G22": 20.0})
        # A larger multiplier is a lower limit.
        limit = pl_mc.AlertLimits("scaled", vertical_m=35.0 * 5.33 / same.k_high.max(), horizontal_m=40.0)
        if method == ROBUST.name:
            drawn = pl_mc.sample(g, both, draws=300, seed=5, methods=[ROBUST], alert=limit)
            np.testing.assert_allclose(alarm.loc[[0.0, 20.0]], drawn.groupby("fault", sort=False).alarm.mean())
        else:
            np.testing.assert_allclose(alarm.loc[[0.0, 20.0]], pl_mc.exact.ls_rates(g, both, alert=limit).alarm_rate)
    budget = read["budgets"]
    total = budget[budget["mode"] == "total"].risk_per_approach.iloc[0]
    assert total == pytest.approx(budget[budget["mode"] != "total"].risk_per_approach.sum())
    drawn_figures = {picture.name: picture.figure for picture in STUDY.pictures(findings.data, experiment)}
    assert list(drawn_figures) == ["risk_against_bias", "worst_case", "grid_steps", "worst_sky", "calibration"]
    for name, figure in drawn_figures.items():
        figure.savefig(tmp_path / f"{name}.png", dpi=150)
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    summary = to_markdown("small", findings.summary)
    assert "posterior_floored" in summary
    assert "not shown" in summary


@pytest.mark.parametrize(
    ("base", "change", "words"),
    [
        (RISK, {"geometry": {"epochs": 2}}, r"geometry\.epoch"),
        (RISK, {"curves": {"satellites": ["G99"]}}, "'G99' is not in view"),
        (RISK, {"budgets": [{"method": "igg4"}]}, r"budgets\.method: 'igg4' is unknown"),
        (RISK, {"worst": {"estimated": ["G2"]}}, "'G2' is not in view"),
        (RISK, {"worst": {"estimated": ["G22"], "refined": [1, 1]}}, r"worst\.refined: one number"),
        (STANFORD, {"reach_m": 30.0}, "more than the alert limit of 35 m"),
        (STANFORD, {"cell_m": 0.7}, "whole cells of 0.7 m"),
        (STANFORD, {"faults": None, "satellites": ["G01"]}, "they get a ramp"),
        (STANFORD, {"draws": 0}, "draws"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path: Path, base: dict, change: dict, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        run_experiment("small", build_experiment(base | change, source="test"), tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
