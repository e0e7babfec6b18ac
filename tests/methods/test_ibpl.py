"""The isotropy-based level: Student's law vertically, the patent's integral, and what it holds without a fault."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, special, stats

import pl_mc
from pl_mc.methods import Ls, method
from pl_mc.methods.ibpl import _factors
from pl_mc.statistics import binomial_p_value
from reference.problems import random_series

G = random_series(np.random.default_rng(6), np.ones((1, 10), bool), "GGGGGEEEEE", noise=1.0)[0]


@pytest.mark.parametrize("dof", [1, 2, 5, 14])
@pytest.mark.parametrize("alpha", [1e-7, 1e-2])
def test_factors_solve_the_integral_of_the_patent(dof: int, alpha: float) -> None:
    """Gamma(n/2) int_{|z| <= k / sqrt(1 + k^2)} (1 - z^2)^((n-m-2)/2) dz = Gamma((n-m)/2) pi^(m/2) (1 - alpha)."""
    horizontal, vertical = _factors(dof, alpha, alpha)
    for m, k in ((1, vertical[dof]), (2, horizontal[dof])):
        n = dof + m
        # What is left out, with 1 - z^2 = s: the complement keeps its digits.
        edge = 1.0 / (1.0 + k * k)

        def outside(s: float, m: int = m, n: int = n) -> float:
            radial = 0.5 * (1.0 - s) ** ((m - 2) / 2.0)
            return s ** ((n - m - 2) / 2.0) * radial * (2.0 if m == 1 else 2.0 * np.pi)

        # A pole at zero for one degree of freedom: s = u^2.
        left = integrate.quad(lambda u: 2.0 * u * outside(u * u), 0.0, np.sqrt(edge), epsrel=1e-11)[0]
        expected = special.gamma((n - m) / 2.0) * np.pi ** (m / 2.0) * alpha / special.gamma(n / 2.0)
        np.testing.assert_allclose(left, expected, rtol=1e-8)


def test_the_vertical_level_is_that_of_students_quantile() -> None:
    one = method("ibpl", alpha_vertical=1e-3, alpha_horizontal=1e-2)
    ls = Ls(k_vertical=float(stats.t.isf(5e-4, 5)))
    rows = pl_mc.sample(G, pl_mc.no_fault(G), draws=2000, seed=2, methods=(one, ls))
    np.testing.assert_allclose(*(rows.vpl_m[rows.method == each.name] for each in (one, ls)), rtol=1e-12)


def test_it_holds_its_probabilities_without_a_fault() -> None:
    one = method("ibpl", alpha_vertical=1e-2, alpha_horizontal=2e-2)
    table = pl_mc.sweep(
        G, pl_mc.no_fault(G), draws=100_000, seed=4, methods=(one,), axes=("vertical", "horizontal"), progress=False
    ).set_index("axis")
    assert binomial_p_value(int(table.exceeded["vertical"]), 100_000, 1e-2) > 1e-4
    # The longest axis in the place of both.
    assert 0.2 * 2e-2 < table.exceeded_rate["horizontal"] < 2e-2


def test_refusals() -> None:
    with pytest.raises(pl_mc.InputError, match="ibpl: alpha_vertical: a number between 0 and 1"):
        method("ibpl", alpha_vertical=0.0)
