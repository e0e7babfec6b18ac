"""Exact rates of least squares: published numbers, identities, invariances, and a plain simulation."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.faults import Faults, biases, no_fault, ramp
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.statistics import binomial_p_value, chi2_threshold, fault_free_exceeded, ls_quantities, ls_rates
from pl_mc.statistics.exact import RATE_COLUMNS, LeastSquaresLaw

RATES = list(RATE_COLUMNS)


def _noisier(g: Geometry, factor: float) -> Geometry:
    return dataclasses.replace(g, sigma_m=g.sigma_m * factor)


def _limits(vertical_m: float) -> AlertLimits:
    return AlertLimits("test", vertical_m=vertical_m, horizontal_m=40.0)


# ARAIM ADD v3.0 Appendix D geometry, W = 1/C_int, sigma three times as large in noise and weights, chi-square
# alarm at 1e-3, VAL 35 m; exact computation made elsewhere. P_HMI there is |error| > VAL without an alarm.
@pytest.mark.parametrize(
    ("satellite", "worst_bias_m", "missed", "alarm"),
    [("G03", 26.9616, 1.193302e-2, 0.897381), ("E10", 30.5908, 3.146292e-5, None)],
)
def test_worst_bias_of_appendix_d(
    appendix_d: Geometry, satellite: str, worst_bias_m: float, missed: float, alarm: float | None
) -> None:
    g = _noisier(appendix_d, 3.0)

    def rates(bias_m: float) -> pd.Series:
        return ls_rates(g, biases(g, {satellite: bias_m}), alarm="chi2", p_fa=1e-3).iloc[0]

    worst = optimize.minimize_scalar(
        lambda b: -np.log(rates(b)["missed_rate"]), bounds=(5, 80), method="bounded", options={"xatol": 1e-6}
    )
    assert worst.x == pytest.approx(worst_bias_m, abs=1e-4)
    got = rates(worst.x)
    assert got["missed_rate"] == pytest.approx(missed, rel=2e-7)
    if alarm is not None:
        assert got["alarm_rate"] == pytest.approx(alarm, abs=2e-6)


def test_rare_event_of_appendix_d(appendix_d: Geometry) -> None:
    g = _noisier(appendix_d, 3.0)
    got = ls_rates(g, no_fault(g), alarm="chi2", p_fa=1e-3).iloc[0]
    assert got["missed_rate"] == pytest.approx(5.480602e-11, rel=1e-6)
    assert got["alarm_rate"] == pytest.approx(1e-3, rel=1e-11)


def test_alarm_is_the_noncentral_tail_of_the_protection_level(appendix_d: Geometry) -> None:
    quantities = ls_quantities(appendix_d)
    spread = 12.0**2 * quantities.redundancy[2] / appendix_d.sigma_m[2] ** 2
    threshold = 5 * (35.0 / (5.33 * quantities.vdop_m)) ** 2
    got = ls_rates(appendix_d, biases(appendix_d, {"G03": -12.0})).iloc[0]
    assert got["alarm_rate"] == pytest.approx(stats.ncx2.sf(threshold, 5, spread), rel=1e-10)
    error = stats.norm(-12.0 * quantities.gain[2], quantities.vdop_m)
    hazard = error.cdf(-35.0) + error.sf(35.0)
    assert got["hazard_rate"] == pytest.approx(hazard, rel=1e-11)
    assert got["missed_rate"] == pytest.approx(hazard * stats.ncx2.cdf(threshold, 5, spread), rel=1e-10)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_what_is_left_out_changes_nothing_else(appendix_d: Geometry, axis: Literal["vertical", "horizontal"]) -> None:
    law, faults = LeastSquaresLaw(3.0, 4.0), no_fault(appendix_d) + biases(appendix_d, {"G03": 25.0})
    near = AlertLimits("near", vertical_m=8.0, horizontal_m=6.0)
    whole = law.rates(appendix_d, faults, near, axis)
    assert (whole["exceeded_rate"] > whole["misleading_rate"]).all()
    least = law.rates(appendix_d, faults, near, axis, exceeded=False)
    pd.testing.assert_frame_equal(least, whole.drop(columns="exceeded_rate"), check_exact=True)


def test_fault_free_risk_is_student_whatever_the_limit(day: Geometry) -> None:
    for vertical_m in (1.0, 35.0, 1e7):
        got = ls_rates(day, no_fault(day), alert=_limits(vertical_m)).iloc[:4]
        np.testing.assert_allclose(got["exceeded_rate"], fault_free_exceeded([7, 2, 2, 1]), rtol=1e-9)
    # Without alarms every error beyond its level misleads.
    np.testing.assert_allclose(got["misleading_rate"], got["exceeded_rate"], rtol=1e-12)
    np.testing.assert_array_equal(got["alarm_rate"], 0.0)


def test_fifteen_degrees_of_freedom_do_not_keep_1e_7() -> None:
    rng = np.random.default_rng(1)
    line = rng.normal(size=(20, 3))
    line[:, 2] = np.abs(line[:, 2])
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    clock = np.repeat(np.eye(2), 10, axis=0)
    names = [f"S{k}" for k in range(20)]
    g = Geometry.from_arrays(np.hstack([-line, clock]), rng.uniform(0.5, 2, 20), "G" * 10 + "C" * 10, names)
    assert ls_rates(g, no_fault(g))["exceeded_rate"][0] == pytest.approx(8.412e-5, rel=1e-4)


def test_columns_and_rows(day: Geometry) -> None:
    faults = no_fault(day) + biases(day, {"G01": 20.0}) + biases(day, {"G02": 5.0, "C02": -7.0})
    got = ls_rates(day, faults)
    assert list(got.columns) == ["epoch", "fault", "bias_m", *RATES]
    assert len(got) == faults.applies(day).sum()
    assert got["fault"].iloc[:3].tolist() == ["none", "G01:+20m", "G02:+5m,C02:-7m"]
    np.testing.assert_array_equal(got["bias_m"].iloc[:3], [0.0, 20.0, np.nan])
    # G02 is not in view at epoch 101, and C02 not at 102.
    assert got["epoch"].tolist() == [100] * 3 + [101] * 2 + [102] * 2 + [103] * 3 + [104] * 3 + [105] * 3


def test_epochs_without_redundancy_are_alarms_and_nothing_else(day: Geometry) -> None:
    got = ls_rates(day, no_fault(day) + biases(day, {"G01": 90.0}))
    unavailable = got[got["epoch"] >= 104]
    np.testing.assert_array_equal(unavailable["alarm_rate"], 1.0)
    np.testing.assert_array_equal(unavailable[RATES[1:]], 0.0)
    assert (got[got["epoch"] < 104]["hazard_rate"] > 0).all()
    alone = ls_rates(day[4:6], no_fault(day))
    np.testing.assert_array_equal(alone["alarm_rate"], [1.0, 1.0])


@pytest.mark.parametrize("alarm", ["pl", "chi2"])
@pytest.mark.parametrize("vertical_m", [0.01, 3.0, 35.0, 1000.0])
def test_identities(day: Geometry, alarm: str, vertical_m: float) -> None:
    faults = ramp(day, satellite="G01", start_m=0.0, stop_m=100.0, step_m=10.0)
    got = ls_rates(day[0:4], faults, alert=_limits(vertical_m), alarm=alarm)  # type: ignore[arg-type]
    values = got[RATES].to_numpy()
    assert ((values >= 0) & (values <= 1)).all()
    quiet = 1 - got["alarm_rate"]
    # Hazard is a missed one or one with an alarm, and an alarm is false or comes with a hazard.
    with_alarm = got["alarm_rate"] - got["false_alarm_rate"]
    np.testing.assert_allclose(got["hazard_rate"] - got["missed_rate"], with_alarm, rtol=1e-9, atol=1e-14)
    assert (got["misleading_rate"] <= quiet + 1e-14).all()
    assert (got["misleading_rate"] <= got["exceeded_rate"]).all()
    if alarm == "pl":
        # Without an alarm VPL <= VAL, so that a hazard is beyond VPL too.
        assert (got["missed_rate"] <= got["misleading_rate"] * (1 + 1e-9)).all()
    else:
        first = got[got["bias_m"] == 0]
        np.testing.assert_allclose(first["alarm_rate"], 1e-3, rtol=1e-10)


def test_exceeded_does_not_depend_on_the_alarm(day: Geometry) -> None:
    faults = ramp(day, satellite="G03", start_m=0.0, stop_m=60.0, step_m=15.0)
    one, other = ls_rates(day, faults), ls_rates(day, faults, alarm="chi2", p_fa=1e-5, alert=_limits(12.0))
    np.testing.assert_allclose(one["exceeded_rate"], other["exceeded_rate"], rtol=1e-10, atol=1e-290)


def test_rates_move_one_way(appendix_d: Geometry) -> None:
    g = _noisier(appendix_d, 2.0)
    growing = ls_rates(g, ramp(g, satellite="G03", start_m=0.0, stop_m=150.0, step_m=3.0))
    for column in ("alarm_rate", "hazard_rate"):
        assert (np.diff(growing[column]) >= -1e-14).all()
    fault = biases(g, {"G03": 20.0})
    over_limits = pd.concat([ls_rates(g, fault, alert=_limits(v)) for v in np.linspace(2, 80, 40)])
    assert (np.diff(over_limits["alarm_rate"]) <= 1e-14).all()
    assert (np.diff(over_limits["hazard_rate"]) <= 1e-14).all()
    assert (np.diff(over_limits["misleading_rate"]) >= -1e-14).all()
    over_factors = pd.concat([ls_rates(g, fault, k_vertical=k) for k in np.linspace(1, 12, 30)])
    assert (np.diff(over_factors["alarm_rate"]) >= -1e-14).all()
    assert (np.diff(over_factors["exceeded_rate"]) <= 1e-14).all()


def test_large_faults_and_extreme_limits_stay_finite(day: Geometry) -> None:
    """100 m at 0.5 m makes a noncentrality of about 4e4; 10 km makes one of 4e8."""
    faults = Faults.from_array(day, np.diag([100.0, -100.0, 1e4] + [0.0] * 9)[:3])
    for vertical_m in (1e-3, 35.0, 1e6):
        for factor in (1e-2, 5.33, 50.0):
            for alarm in ("pl", "chi2"):
                got = ls_rates(day, faults, alert=_limits(vertical_m), k_vertical=factor, alarm=alarm)  # type: ignore[arg-type]
                values = got[RATES].to_numpy()
                assert np.isfinite(values).all()
                assert ((values >= 0) & (values <= 1)).all()


def _shuffled(g: Geometry, bias_m: np.ndarray, order: list[int]) -> tuple[Geometry, np.ndarray]:
    at = np.array(order)
    names = tuple(g.names[k] for k in order)
    return Geometry.from_arrays(g.design[at], g.sigma_m[at], [g.systems[k] for k in order], names), bias_m[at]


_BIAS = st.lists(st.floats(-100, 100), min_size=10, max_size=10).map(np.array)


@settings(max_examples=25, deadline=None)
@given(bias_m=_BIAS, order=st.permutations(range(10)), vertical_m=st.floats(5, 80))
def test_order_of_satellites_does_not_matter(
    appendix_d: Geometry, bias_m: np.ndarray, order: list[int], vertical_m: float
) -> None:
    g, moved = _shuffled(appendix_d, bias_m, order)
    one = ls_rates(appendix_d, Faults.from_array(appendix_d, bias_m), alert=_limits(vertical_m))[RATES]
    other = ls_rates(g, Faults.from_array(g, moved), alert=_limits(vertical_m))[RATES]
    # The rounding of a noncentrality of 1e4 moves a far tail by a part in 1e9.
    np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-200)


@settings(max_examples=25, deadline=None)
@given(bias_m=_BIAS, exponent=st.floats(-3, 3))
def test_scale_does_not_matter(appendix_d: Geometry, bias_m: np.ndarray, exponent: float) -> None:
    """Sigma, bias and alert limit in another unit of length; also both signs of the fault."""
    scale = 10.0**exponent
    g = _noisier(appendix_d, scale)
    one = ls_rates(appendix_d, Faults.from_array(appendix_d, bias_m))[RATES]
    other = ls_rates(g, Faults.from_array(g, -bias_m * scale), alert=_limits(LPV_200.vertical_m * scale))[RATES]
    np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-200)


def test_common_clock_bias_and_padding_do_not_matter(day: Geometry) -> None:
    faults = biases(day, {"G01": 20.0, "G03": 11.0})
    series = ls_rates(day, faults)
    for row in series.itertuples():
        single = day[int(row.epoch) - 100]
        alone = ls_rates(single, biases(single, {"G01": 20.0, "G03": 11.0}))
        assert alone["epoch"].tolist() == [row.epoch]
        np.testing.assert_allclose(alone[RATES].iloc[0], [getattr(row, name) for name in RATES], rtol=1e-9)
    # The same error on every GPS satellite is a clock error.
    clock = np.array([[25.0 if system == "G" else 0.0 for system in day.systems]])
    got = ls_rates(day[0:1], Faults.from_array(day, clock))[RATES]
    np.testing.assert_allclose(got, ls_rates(day[0:1], no_fault(day))[RATES], rtol=1e-9)


@pytest.mark.parametrize("alarm", ["pl", "chi2"])
@pytest.mark.parametrize(
    ("scale", "bias_m"), [(3.0, {}), (1.5, {"G03": 14.0}), (3.0, {"G03": 30.0}), (2.0, {"G03": 25.0, "E08": 20.0})]
)
def test_rates_against_a_plain_simulation(
    appendix_d: Geometry, scale: float, bias_m: dict[str, float], alarm: str
) -> None:
    """Draws, normal equations and counts, with nothing shared but the definitions."""
    g, alert, draws = _noisier(appendix_d, scale), _limits(20.0), 200_000
    faults = biases(g, bias_m) if bias_m else no_fault(g)
    rng = np.random.default_rng(20211118)
    error = rng.standard_normal((draws, 10)) * g.sigma_m + faults.bias_m[0]
    weight = 1.0 / g.sigma_m**2
    inverse = np.linalg.inv(g.design.T @ (weight[:, None] * g.design))
    position = error * weight @ g.design @ inverse
    squares = (((position @ g.design.T - error) ** 2) * weight).sum(axis=1)
    level = 5.33 * np.sqrt(squares / 5) * np.sqrt(inverse[2, 2])
    vertical = np.abs(position[:, 2])
    alarmed = level > 20.0 if alarm == "pl" else squares > chi2_threshold(5, 1e-3)
    hazard, exceeded = vertical > 20.0, vertical > level
    counts = [
        np.count_nonzero(event)
        for event in (alarmed, hazard, hazard & ~alarmed, exceeded & ~alarmed, exceeded, alarmed & ~hazard)
    ]
    rates = ls_rates(g, faults, alert=alert, alarm=alarm)[RATES].iloc[0]  # type: ignore[arg-type]
    # Eight cases of six rates, 1e-6 for all of them together.
    assert binomial_p_value(counts, draws, rates).min() > 1e-6 / 48


def test_arguments_outside_their_range(appendix_d: Geometry) -> None:
    faults = no_fault(appendix_d)
    with pytest.raises(InputError, match="alarm: 'ch2' is unknown"):
        ls_rates(appendix_d, faults, alarm="ch2")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="p_fa"):
        ls_rates(appendix_d, faults, alarm="chi2", p_fa=1.0)
    for factor in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="k_vertical"):
            ls_rates(appendix_d, faults, k_vertical=factor)
