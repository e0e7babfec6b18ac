"""The reweighting is that of the statistics books: the stackloss fits of R and of statsmodels come out of it.

A regression is a geometry with sigma 1, whose columns are the regressors; the cofactor ``none`` and the scale
``mad`` make it the M-estimate that both packages compute.
"""

from __future__ import annotations

import functools

import jax
import numpy as np
import pytest
import statsmodels.api as sm

from pl_mc import kernels
from pl_mc.kernels import HuberWeight, IrlsOptions, TukeyWeight, linear_model
from reference.problems import appendix_d, random_sky

# Brownlee (1965), Statistical Theory and Methodology: 21 days of a plant that oxidises ammonia. Air flow, cooling
# water temperature, acid concentration; stack loss.
STACKLOSS = np.array(
    [
        (80, 27, 89, 42), (80, 27, 88, 37), (75, 25, 90, 37), (62, 24, 87, 28), (62, 22, 87, 18), (62, 23, 87, 18),
        (62, 24, 93, 19), (62, 24, 93, 20), (58, 23, 87, 15), (58, 18, 80, 14), (58, 18, 89, 14), (58, 17, 88, 13),
        (58, 18, 82, 11), (58, 19, 93, 12), (50, 18, 89, 8), (50, 18, 86, 7), (50, 19, 72, 8), (50, 19, 79, 8),
        (50, 20, 80, 9), (56, 20, 82, 15), (70, 20, 91, 15),
    ],
    dtype=float,
)  # fmt: skip
DESIGN, LOSS = np.column_stack([STACKLOSS[:, :3], np.ones(21)]), STACKLOSS[:, 3]
# R (MASS::rlm and lm), as quoted by the tests of statsmodels: air flow, temperature, concentration, constant.
R_OLS = (0.715640, 1.295286, -0.152123, -39.91967)
R_HUBER = (0.829374, 0.926108, -0.127849, -41.02653)
R_TUKEY = (0.927547, 0.650732, -0.112331, -42.28525)


@functools.cache
def m_estimate(weight, iterations: int = 200):
    options = IrlsOptions(weight=weight, scale="mad", cofactor="none", iterations=iterations)
    solve = jax.jit(functools.partial(kernels.igg3, options=options))
    return jax.tree.map(np.asarray, solve(DESIGN, np.ones(21), LOSS))


def test_the_table_is_the_published_one():
    data = sm.datasets.stackloss.load_pandas()
    np.testing.assert_array_equal(data.exog.to_numpy(float), STACKLOSS[:, :3])
    np.testing.assert_array_equal(data.endog.to_numpy(float), LOSS)


def test_least_squares_is_r_s():
    estimate = jax.jit(kernels.ls)(DESIGN, np.ones(21), LOSS)
    # Half a unit of the last digit that R prints.
    np.testing.assert_allclose(estimate.state[:3], R_OLS[:3], rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(estimate.state[3], R_OLS[3], rtol=0, atol=5.1e-6)


@pytest.mark.parametrize(
    ("weight", "r_values"), [(HuberWeight(1.345), R_HUBER), (TukeyWeight(4.685), R_TUKEY)], ids=["Huber", "Tukey"]
)
def test_m_estimates_are_r_s(weight, r_values):
    # R stops once the residuals change by less than a relative 1e-4 from one iteration to the next.
    np.testing.assert_allclose(m_estimate(weight).state, r_values, rtol=1e-3)


@pytest.mark.parametrize(
    ("weight", "norm"),
    [(HuberWeight(1.345), sm.robust.norms.HuberT(1.345)), (TukeyWeight(4.685), sm.robust.norms.TukeyBiweight(4.685))],
    ids=["Huber", "Tukey"],
)
def test_m_estimates_are_those_of_statsmodels(weight, norm):
    fit = sm.RLM(LOSS, DESIGN, M=norm).fit(maxiter=500, tol=1e-13, scale_est="mad")
    found = m_estimate(weight)
    # Both have converged; statsmodels' MAD uses the same normal quantile. 1e-7: a linear rate of convergence
    # leaves a multiple of the last step, and the columns are far from orthogonal (condition number 1e3).
    np.testing.assert_allclose(found.state, fit.params, rtol=1e-7)
    np.testing.assert_allclose(found.weights, fit.weights, atol=1e-7)
    assert found.change_m < 1e-9


@pytest.mark.parametrize("weight", [HuberWeight(), TukeyWeight(), kernels.Igg3Weight()])
def test_the_weighted_residuals_are_orthogonal_to_the_design(weight):
    """X'Wr = 0 with the weights of the last solve, converged or not; at convergence with the weights of r too."""
    found = m_estimate(weight)
    bound = 1e-11 * np.abs(DESIGN).sum(axis=0) * np.abs(LOSS).max()
    assert np.all(np.abs(DESIGN.T @ (found.weights * found.residuals_m)) < bound)
    scale = 1.482602218505602 * np.median(np.abs(found.residuals_m))
    again = np.asarray(weight(np.abs(found.residuals_m) / scale))
    np.testing.assert_allclose(again, found.weights, atol=1e-7)


def test_few_iterations_report_that_they_have_not_converged():
    early, late = m_estimate(TukeyWeight(), 2), m_estimate(TukeyWeight(), 200)
    assert early.change_m > 1e-3
    np.testing.assert_allclose(late.change_m, 0, atol=1e-9)


def test_redundancy_numbers_of_appendix_d():
    """Geometry of the ARAIM Algorithm Description Document v3.0, Appendix D, with P = 1 / C_int."""
    g = appendix_d()
    model = jax.jit(linear_model)(g.design, g.sigma_m)
    expected = [
        0.686552, 0.527214, 0.309345, 0.552657, 0.544048, 0.541127, 0.518285, 0.360606, 0.519245, 0.440920,
    ]  # fmt: skip
    np.testing.assert_allclose(model.redundancy, expected, rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(np.sum(model.redundancy), 5, rtol=1e-12)
    np.testing.assert_allclose(model.cofactor[2], 3.16569275, rtol=0, atol=5.1e-9)
    assert model.dof == 5
    assert model.unknowns == 5


@pytest.mark.parametrize("counts", [(5,), (7, 1), (6, 5, 4)])
def test_redundancy_numbers_sum_to_the_redundancy(counts):
    design, sigma, _ = random_sky(np.random.default_rng(9), counts=counts)
    padded = np.vstack([design, np.full((3, design.shape[1]), np.nan)])
    model = jax.jit(linear_model)(padded, np.append(sigma, [np.nan, 0.0, -1.0]), np.arange(len(padded)) < len(design))
    np.testing.assert_allclose(np.sum(model.redundancy), len(design) - design.shape[1], rtol=0, atol=1e-10)
    assert np.all(model.redundancy[len(design) :] == 0)
    assert np.all(np.asarray(model.inverse_residual_sigma)[np.asarray(model.redundancy) < 1e-10] == 0)
