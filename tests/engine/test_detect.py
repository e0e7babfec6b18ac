"""Detection counts: exact laws, equal false-alarm rates on other draws, determinism, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import pl_mc
from pl_mc import InputError
from pl_mc.engine import detect, examine
from pl_mc.engine.detect_runs import Calibration, calibrate, checked_options
from pl_mc.faults import biases, no_fault, ramp, ramps
from pl_mc.geometry.record import Geometry
from pl_mc.statistics import binomial_p_value, chi2_threshold, ls_quantities, split_at_threshold

COLUMNS = [
    "test", "reading", "level", "fault", "bias_m", "draws", "detections", "detection_rate", "low", "high",
    "identified_rate", "threshold", "p_fa_nominal", "p_fa_measured", "p_fa_low", "p_fa_high",
]  # fmt: skip
DRAWS = 20_000


def series(epochs: int = 6) -> Geometry:
    return pl_mc.simulate(
        site="JFNG", start="2020-12-01T00:00:00", epochs=epochs, interval_s=3600.0,
        constellations=("GPS", "BDS-2", "BDS-3"), error_model="constant",
    )  # fmt: skip


@pytest.fixture(scope="module")
def g() -> Geometry:
    return series()[2]


@pytest.fixture(scope="module")
def table(g: Geometry) -> pd.DataFrame:
    faults = no_fault(g) + ramps(g, satellites=[g.names[0], g.names[-1]], start_m=6.0, stop_m=18.0, step_m=6.0)
    return detect(g, faults, draws=DRAWS, seed=11, calibration_draws=30_000, progress=False)


def cut(g: Geometry, gps: int, bds: int) -> Geometry:
    """The first satellites of both systems of an epoch."""
    rows = [k for k, s in enumerate(g.systems) if s == "G"][:gps] + [k for k, s in enumerate(g.systems) if s == "C"][
        :bds
    ]
    design = g.design[rows]
    return Geometry.from_arrays(
        design[:, design.any(axis=0)], g.sigma_m[rows], [g.systems[k] for k in rows], [g.names[k] for k in rows]
    )


def test_columns_and_order(g: Geometry, table: pd.DataFrame) -> None:
    assert list(table.columns) == COLUMNS
    assert table.test.tolist() == ["chi2"] * 14 + ["mean_check"] * 14
    assert table.level.tolist() == 2 * (["nominal"] * 7 + ["equal_p_fa"] * 7)
    assert table.reading.unique().tolist() == ["apriori", "shift_kept"]
    np.testing.assert_allclose(table.detection_rate, table.detections / DRAWS, rtol=1e-15)
    assert ((table.low <= table.detection_rate) & (table.detection_rate <= table.high)).all()
    assert table.identified_rate.isna().eq(table.fault == "none").all()
    assert (table.identified_rate.dropna() <= table.detection_rate[table.fault != "none"]).all()


def test_the_chi_square_test_obeys_the_noncentral_law(g: Geometry, table: pd.DataFrame) -> None:
    quantities = ls_quantities(g)
    found = table[(table.test == "chi2") & (table.level == "nominal")]
    limit = chi2_threshold(quantities.dof, 0.01)
    np.testing.assert_allclose(found.threshold, limit, rtol=1e-12)
    for row in found.itertuples():
        at = 0 if row.fault == "none" else g.names.index(row.fault.split(":")[0])
        spread = row.bias_m**2 * quantities.redundancy[at] / g.sigma_m[at] ** 2
        exact = split_at_threshold(limit, quantities.dof, spread)[1]
        assert binomial_p_value(row.detections, row.draws, exact) > 1e-4
    assert binomial_p_value(round(found.p_fa_measured.iloc[0] * 30_000), 30_000, 0.01) > 1e-4


def test_equal_false_alarm_rates_are_equal_on_other_draws(table: pd.DataFrame) -> None:
    """Each threshold is an order statistic, so its own rate is a beta variable of 300 false alarms, spread 1/17."""
    equal = table[(table.level == "equal_p_fa") & (table.fault == "none")]
    for row in equal.itertuples():
        for rate, draws in ((row.p_fa_measured, 30_000), (row.detection_rate, row.draws)):
            spread = np.sqrt(0.01 / 30_000 + 0.01 / draws)
            assert abs(rate - 0.01) < 4 * spread
    # The nominal mean check hardly ever alarms: the two levels are not the same comparison.
    nominal = table[(table.level == "nominal") & (table.test == "mean_check")]
    assert nominal.p_fa_measured.max() < 1e-3
    assert (table[table.level == "equal_p_fa"].groupby("test").threshold.nunique() == 1).all()


def test_calibrated_thresholds_have_their_expected_rate_over_many_epochs() -> None:
    """With 199 draws each threshold is far from its quantile, yet the mean rate over epochs is k / 200 exactly."""
    many = series(48)
    # Every hour of two days by the same tests: epochs are independent.
    found = calibrate(many, checked_options(("chi2",), 0.02, 5), draws=199)
    assert isinstance(found, Calibration)
    mean = found.false_alarms[:, 0, 1].mean() / 199
    # A beta variable of 4 in 200, then 199 draws with it.
    spread = np.sqrt((0.02 * 0.98 / 201 + 0.02 / 199) / 48)
    assert abs(mean - 0.02) < 4 * spread


def test_the_same_seed_gives_the_same_table_however_it_is_cut(g: Geometry, table: pd.DataFrame) -> None:
    faults = no_fault(g) + ramps(g, satellites=[g.names[0], g.names[-1]], start_m=6.0, stop_m=18.0, step_m=6.0)
    options = {"draws": DRAWS, "calibration_draws": 30_000, "progress": False}
    again = detect(g, faults, seed=11, workers=1, **options)
    pd.testing.assert_frame_equal(again, table)
    assert not detect(g, faults, seed=12, **options).detections.equals(table.detections)


def test_a_series_is_its_epochs_and_padding_changes_nothing() -> None:
    days, options = series(), {"draws": 300, "seed": 3, "calibration_draws": 999, "progress": False}
    name = next(name for name in days.names if (days.satellite_count > 0).all() and name.startswith("C"))
    faults = biases(days, {name: 15.0})
    whole = detect(days, faults, **options)
    assert whole.columns[0] == "epoch"
    seen = whole.epoch.unique()
    assert any("out of view" in note for note in whole.attrs["notes"]) == (len(seen) < len(days))
    one = detect(days[int(seen[-1])], biases(days[int(seen[-1])], {name: 15.0}), **options)
    mine = whole[whole.epoch == seen[-1]].drop(columns="epoch").reset_index(drop=True)
    pd.testing.assert_frame_equal(mine, one, rtol=1e-9)


def test_examine_sees_what_detect_counts(g: Geometry) -> None:
    """The draws are those of the sweep: noise of `pl_mc.sample`, one by one."""
    from pl_mc.studies.sources import drawn_errors_m

    faults = biases(g, {g.names[3]: 12.0})
    counted = detect(g, faults, draws=100, seed=9, calibration_draws=999, progress=False)
    noise = drawn_errors_m(g.as_series(), draws=100, seed=9, precision="float64")[:, 0]
    found = pd.concat([examine(g, one + faults.bias_m[0]) for one in noise])
    for test, group in found.groupby("test"):
        row = counted[(counted.test == test) & (counted.level == "nominal")].iloc[0]
        assert row.detections == group.decision.sum()
        assert row.identified_rate == pytest.approx((group.decision & (group.suspect == g.names[3])).mean())


@pytest.mark.parametrize(
    ("gps", "bds", "words"),
    [
        (6, 0, "mean_check: it is not defined at this epoch: BeiDou has no satellite .*without it there is chi2"),
        (6, 1, "mean_check: .* BeiDou has a single satellite"),
        (3, 2, "n = t"),
    ],
)
def test_where_the_mean_check_is_not_defined(g: Geometry, gps: int, bds: int, words: str) -> None:
    few = cut(g, gps, bds)
    fault = ramp(few, satellite=few.names[0], start_m=0, stop_m=30, step_m=15)
    options = {"draws": 300, "seed": 1, "calibration_draws": 999, "progress": False}
    with pytest.raises(InputError, match=words):
        detect(few, fault, **options)
    # What is still defined is still given.
    assert len(pl_mc.reliability(few)) == len(few.names)
    if bds == 0:
        assert len(detect(few, fault, tests=("chi2",), **options)) == 6
        assert examine(few, np.zeros(len(few.names)), tests=("chi2",)).threshold.notna().all()


def test_a_series_leaves_such_epochs_out_and_says_so() -> None:
    days = series(3)
    bds = np.array(days.systems)[days.satellite] == "C"
    rows = days.in_view.copy()
    rows[1] &= ~bds[1]
    places = np.argmax(bds[2] & rows[2])
    rows[2] &= ~bds[2] | (np.arange(rows.shape[1]) == places)
    known = len(days.names)
    design, sigma, seen = np.zeros((3, known, 5)), np.ones((3, known)), np.zeros((3, known), bool)
    e, k = np.nonzero(rows)
    design[e, days.satellite[e, k]], sigma[e, days.satellite[e, k]] = days.design[e, k], days.sigma_m[e, k]
    seen[e, days.satellite[e, k]] = True
    g = Geometry.from_rows(
        design=design, sigma_m=sigma, in_view=seen, names=days.names, systems=days.systems, clocks=days.clocks
    )
    found = detect(g, no_fault(g), draws=300, seed=1, calibration_draws=999, progress=False)
    assert found[found.test == "chi2"].epoch.unique().tolist() == [0, 1, 2]
    assert found[found.test == "mean_check"].epoch.unique().tolist() == [0]
    notes = " ".join(found.attrs["notes"])
    assert "mean_check is not defined at 1 of 3 epochs, which give no row: BeiDou has no satellite" in notes
    assert "BeiDou has a single satellite" in notes


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"draws": 0}, "draws: a whole number"),
        ({"seed": -1}, "seed: a whole number"),
        ({"p_fa": 1.0}, "p_fa: it lies between 0 and 1"),
        ({"p_fa": "1 %"}, "p_fa: a finite number"),
        ({"calibration_draws": 98}, "calibration_draws: 98 draws .* at least 99 are needed"),
        ({"tests": ("chi3",)}, "test: 'chi3' is unknown .nearest: chi2"),
        ({"precision": "float16"}, "precision"),
        ({"workers": 0}, "workers"),
    ],
)
def test_bad_options_are_refused(g: Geometry, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        detect(g, no_fault(g), **({"draws": 10, "seed": 1} | options))


def test_bad_errors_are_refused(g: Geometry) -> None:
    with pytest.raises(InputError, match="errors_m: the shape"):
        examine(g, np.zeros((2, len(g.names))))
    with pytest.raises(InputError, match="finite number of metres"):
        examine(g, np.full(len(g.names), np.nan))


def test_drawn_sizes_are_detected_as_the_mean_over_them() -> None:
    """Of uniform sizes the power is the mean of that of fixed ones; the suspect is a faulted satellite."""
    g = pl_mc.simulate(epochs=2, interval_s=3600.0)
    options: dict[str, Any] = {"tests": ("chi2",), "p_fa": 0.01, "calibration_draws": 999, "progress": False}
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, "G12:uniform(1,9)m") + pl_mc.biases(g, "G12:+5m")
    table = pl_mc.detect(g, faults, draws=4096, seed=3, **options)
    nominal = table[table.level == "nominal"].set_index(["epoch", "fault"])
    # Faults beside a drawn one are counted as they are alone.
    alone = pl_mc.detect(g, faults.only(0, 2), draws=4096, seed=3, **options)
    for row in alone[alone.level == "nominal"].itertuples():
        assert nominal.detections[row.epoch, row.fault] == row.detections
    points, weights = np.polynomial.legendre.leggauss(20)
    for epoch in (0, 1):
        one = g[epoch]
        quantities = pl_mc.statistics.ls_quantities(one)
        sizes = np.zeros((20, len(one.names)))
        sizes[:, one.names.index("G12")] = 5.0 + 4.0 * points
        effects = pl_mc.statistics.fault_effects(one, pl_mc.Faults.from_array(one, sizes))
        limit = stats.chi2.isf(0.01, quantities.dof)
        power = float(weights / 2.0 @ stats.ncx2.sf(limit, quantities.dof, effects.noncentrality))
        row = nominal.loc[(epoch, "G12:uniform(1,9)m")]
        assert pl_mc.statistics.binomial_p_value(int(row.detections), 4096, power) > 1e-4
        assert row.identified_rate > 0.8 * row.detection_rate
