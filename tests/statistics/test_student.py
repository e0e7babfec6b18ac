"""Fault-free risks, factors and thresholds against published numbers and the integrals that define them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, special, stats

from pl_mc.input_errors import InputError
from pl_mc.statistics import chi2_threshold, fault_free_exceeded, student_factor


def test_chi_square_thresholds_of_the_rtklib_table() -> None:
    # RTKLIB, chi-square table at 1e-3, degrees of freedom 1 to 10.
    table = [10.8, 13.8, 16.3, 18.5, 20.5, 22.5, 24.3, 26.1, 27.9, 29.6]
    np.testing.assert_allclose(chi2_threshold(np.arange(1, 11), 1e-3), table, atol=0.05)
    # ARAIM ADD v3.0 Appendix D geometry, five degrees of freedom.
    assert chi2_threshold(5, 1e-3) == pytest.approx(20.515006, abs=5e-7)


@pytest.mark.parametrize("p_fa", [1e-3, 1e-7, 1e-11, 1e-15])
def test_threshold_gives_its_probability(p_fa: float) -> None:
    dof = np.arange(1, 41)
    np.testing.assert_allclose(special.gammaincc(dof / 2, chi2_threshold(dof, p_fa) / 2), p_fa, rtol=1e-10)


def test_normal_quantile_does_not_keep_its_risk() -> None:
    # Twenty satellites and five unknowns: 8.4e-5 where the normal quantile promises 1e-7.
    assert fault_free_exceeded(15) == pytest.approx(8.4e-5, rel=5e-3)
    # The incomplete beta function at a precision of 25 digits gives the same integral.
    assert fault_free_exceeded(15) == pytest.approx(8.411972337552067e-05, rel=1e-12)
    # One degree of freedom is the Cauchy distribution.
    assert fault_free_exceeded(1) == pytest.approx(2 * np.arctan(1 / 5.33) / np.pi, rel=1e-13)


@pytest.mark.parametrize("dof", [1, 2, 7, 30])
def test_exceeded_is_the_mean_over_the_residuals(dof: int) -> None:
    """P(|Z| > k sqrt(Y / dof)) by an adaptive rule over the chi-square density of Y."""
    value, _ = integrate.quad(
        lambda r: 2 * r * stats.chi2.pdf(r * r, dof) * 2 * special.ndtr(-5.33 * r / np.sqrt(dof)), 0, 40,
        points=[0.5, 1, 2, 4, 8], epsabs=0, epsrel=1e-11, limit=300,
    )  # fmt: skip
    assert fault_free_exceeded(dof) == pytest.approx(value, rel=1e-10)


def test_factor_inverts_the_risk_down_to_1e_11() -> None:
    for risk in (1e-3, 1e-7, 1e-11):
        for dof in (1, 2, 5, 15, 40):
            factor = float(student_factor(dof, risk))
            assert fault_free_exceeded(dof, factor) == pytest.approx(risk, rel=1e-9)


def test_factor_tends_to_the_normal_quantile() -> None:
    # Q^-1(5e-8) = 5.326724, the origin of the factor 5.33; and sqrt(-2 ln 5e-9) = 6.182852 for the horizontal one.
    assert student_factor(1e9, 1e-7) == pytest.approx(5.326724, abs=1e-6)
    assert np.sqrt(-2 * np.log(5e-9)) == pytest.approx(6.182852, abs=5e-7)
    factors = student_factor(np.arange(1, 200), 1e-7)
    assert (np.diff(factors) < 0).all()
    assert (factors > 5.326724).all()


def test_arguments_outside_their_range() -> None:
    for dof in (0, -3, 0.5, np.nan, np.inf):
        with pytest.raises(InputError, match="dof"):
            fault_free_exceeded(dof)
    with pytest.raises(InputError, match="k_vertical"):
        fault_free_exceeded(5, 0.0)
    for risk in (0.0, 1.0, np.nan):
        with pytest.raises(InputError, match="risk"):
            student_factor(5, risk)
        with pytest.raises(InputError, match="p_fa"):
            chi2_threshold(5, risk)
