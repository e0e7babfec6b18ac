"""The length of a Gaussian vector against closed forms, other integrals and counting; horizontal rates of epochs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

import pl_mc
from pl_mc.input_errors import InputError
from pl_mc.statistics import binomial_p_value, ls_quantities, ls_rates
from pl_mc.statistics.exact import RATE_COLUMNS
from pl_mc.statistics.length import joint_length_exceedance, length_beyond

RATES = list(RATE_COLUMNS)


def test_equal_variances_are_a_noncentral_chi_square() -> None:
    limit = np.array([0.01, 0.5, 1.0, 3.0, 6.0, 8.0, 12.0, 30.0])
    mean = np.array([0.0, 0.0, 1.0, 2.0, 0.0, 3.0, 4.0, 22.0])
    within, beyond = length_beyond(limit, 1.0, mean * 0.6, mean * 0.8)
    central = np.where(mean == 0, stats.chi2.sf(limit**2, 2), stats.ncx2.sf(limit**2, 2, np.maximum(mean, 1e-9) ** 2))
    np.testing.assert_allclose(beyond, central, rtol=1e-11)
    rest = np.where(mean == 0, stats.chi2.cdf(limit**2, 2), stats.ncx2.cdf(limit**2, 2, np.maximum(mean, 1e-9) ** 2))
    np.testing.assert_allclose(within, rest, rtol=1e-11)


@pytest.mark.parametrize("ratio", [1.0, 0.9, 0.5, 0.1, 0.001])
@pytest.mark.parametrize("limit", [0.3, 1.0, 4.0, 7.5])
def test_without_a_mean_it_is_an_integral_over_the_direction(ratio: float, limit: float) -> None:
    """Of two standard normal variables the square of the length is exponential in every direction."""

    def in_direction(angle: float) -> float:
        return np.exp(-0.5 * limit**2 / (np.cos(angle) ** 2 + (ratio * np.sin(angle)) ** 2)) * 2.0 / np.pi

    expected = integrate.quad(in_direction, 0.0, np.pi / 2.0, epsabs=0.0, epsrel=1e-11, limit=400)[0]
    assert length_beyond(limit, ratio, 0.0, 0.0)[1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("slope", [0.5, 1.0, 3.0, 6.18 * np.sqrt(2.0 / 8.0), 12.0])
def test_central_and_round_it_is_fisher_s_law(slope: float) -> None:
    below, above = joint_length_exceedance(1e9, 8, 0, slope, 1.0, 0, 0)
    assert below == pytest.approx(stats.f.sf(slope**2 * 4.0, 2, 8), rel=1e-10)
    assert above == 0.0


@pytest.mark.parametrize(
    "case",
    [
        (30.0, 8, 12.0, 1.1, 0.6, 2.0, 1.0), (20.0, 3, 5.0, 0.9, 0.2, 0.5, 3.0), (15.0, 6, 10.0, 0.8, 0.9, -2.0, 2.0),
        (25.0, 5, 4.0, 1.5, 0.05, 0.0, 4.0),
    ],
)  # fmt: skip
def test_both_sides_of_a_threshold_as_counted(case: tuple[float, ...]) -> None:
    threshold, dof, noncentrality, slope, ratio, major, minor = case
    rng, draws = np.random.default_rng(7), 1_000_000
    normal = rng.standard_normal((int(dof) + 2, draws))
    normal[2] += np.sqrt(noncentrality)
    square = (normal[2:] ** 2).sum(axis=0)
    beyond = np.hypot(normal[0] + major, ratio * normal[1] + minor) > slope * np.sqrt(square)
    counted = [int((beyond & side).sum()) for side in (square <= threshold, square > threshold)]
    exact = joint_length_exceedance(*case)
    assert (binomial_p_value(counted, draws, exact) > 1e-5).all(), (counted, exact)


@pytest.mark.parametrize(("field", "value"), [("ratio", 0.0), ("ratio", 1.5), ("slope", 0.0), ("major", np.inf)])
def test_what_is_out_of_range(field: str, value: float) -> None:
    given_ = {"slope": 1.0, "ratio": 0.5, "major": 0.0, "minor": 0.0} | {field: value}
    with pytest.raises(InputError, match=f"^{field}: "):
        joint_length_exceedance(10.0, 4, 0.0, **given_)


LIMITS = pl_mc.AlertLimits("test", horizontal_m=9.0)


def turned(g: pl_mc.Geometry, angle: float) -> pl_mc.Geometry:
    """The same epoch with its axes turned about the vertical."""
    design = np.array(g.design)
    cos, sin = np.cos(angle), np.sin(angle)
    design[..., :2] = design[..., :2] @ np.array([[cos, sin], [-sin, cos]])
    return dataclasses.replace(g, design=design)


@given(angle=st.floats(-3.0, 3.0), bias_m=st.floats(0.0, 60.0))
@settings(max_examples=10)
def test_north_is_where_one_likes(angle: float, bias_m: float) -> None:
    g = pl_mc.simulate(epochs=1)[0]
    here, there = (ls_rates(of, pl_mc.biases(of, {"G12": bias_m}), alert=LIMITS, axis="horizontal")
                   for of in (g, turned(g, angle)))  # fmt: skip
    np.testing.assert_allclose(here[RATES], there[RATES], rtol=1e-6, atol=1e-280)


def test_horizontal_quantities_are_those_of_the_normal_equations(appendix_d: pl_mc.Geometry) -> None:
    g = appendix_d
    normal = g.design.T @ np.diag(g.sigma_m**-2.0) @ g.design
    inverse = np.linalg.inv(normal)
    found = ls_quantities(g)
    np.testing.assert_allclose(found.horizontal_cofactor, inverse[:2, :2], rtol=1e-9)
    np.testing.assert_allclose(found.horizontal_gain, (inverse @ g.design.T / g.sigma_m**2)[:2], rtol=1e-9, atol=1e-12)
    assert found.hdop_m == pytest.approx(np.sqrt(np.trace(inverse[:2, :2])))


def test_rates_belong_together(day: pl_mc.Geometry) -> None:
    """Epochs without a solution alarm; the parts of a rate are its parts; a chi-square alarm is the vertical one."""
    faults = pl_mc.no_fault(day) + pl_mc.biases(day, {"G01": 15.0}) + pl_mc.biases(day, {"C01": 60.0})
    rates = ls_rates(day, faults, alert=LIMITS, axis="horizontal")
    known = rates.hazard_rate > 0
    assert (rates.alarm_rate[~known] == 1.0).all()
    assert (rates.missed_rate <= rates.hazard_rate).all()
    assert (rates.misleading_rate <= rates.exceeded_rate).all()
    of_test = [ls_rates(day, faults, axis=axis, alarm="chi2") for axis in ("vertical", "horizontal")]
    np.testing.assert_array_equal(of_test[0].alarm_rate, of_test[1].alarm_rate)
    with pytest.raises(InputError, match="axis: horizontal needs a horizontal limit, and test has VAL 35 m alone"):
        ls_rates(day, faults, axis="horizontal", alert=pl_mc.AlertLimits("test", vertical_m=35.0))
    with pytest.raises(InputError, match="axis: 'eastern' is unknown"):
        ls_rates(day, faults, axis="eastern")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"k_horizontal: it does nothing on the vertical axis; .* k_vertical"):
        ls_rates(day, faults, k_horizontal=5.0)
    with pytest.raises(InputError, match="k_vertical: it does nothing on the horizontal axis"):
        ls_rates(day, faults, axis="horizontal", k_vertical=5.0)
