"""Why jackknife ARAIM is no method of its own here: under Gaussian errors it tests what solution separation tests."""

from __future__ import annotations

import jax
import numpy as np
from scipy import stats

from pl_mc.araim.budget import LPV_200
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods import Araim
from reference.problems import appendix_d

G = appendix_d()


def test_the_jackknife_residual_of_a_satellite_decides_what_its_separation_decides() -> None:
    """The observation less what the others predict of it, over its sigma: on every axis the separation over its own."""
    a, sigma = np.asarray(G.design), np.asarray(G.sigma_m)
    observed = sigma[:, None] * np.random.default_rng(3).standard_normal((sigma.size, 50))
    observed[2] += 9.0
    p = np.diag(1.0 / sigma**2)
    gain = np.linalg.inv(a.T @ p @ a) @ a.T @ p
    ratios = np.empty((sigma.size, 50))
    for k in range(sigma.size):
        rest = np.delete(np.arange(sigma.size), k)
        others = np.zeros_like(gain)
        others[:, rest] = np.linalg.inv(a[rest].T @ p[rest][:, rest] @ a[rest]) @ a[rest].T @ p[rest][:, rest]
        jackknife = np.eye(sigma.size)[k] - a[k] @ others
        ratios[k] = np.abs(jackknife @ observed) / np.linalg.norm(jackknife * sigma)
        separation = gain - others
        # One number for each satellite, S_qk times the jackknife residual.
        np.testing.assert_allclose(separation, np.outer(gain[:, k], jackknife), atol=1e-12)
        for axis in range(3):
            own = np.abs(separation[axis] @ observed) / np.linalg.norm(separation[axis] * sigma)
            np.testing.assert_allclose(own, ratios[k], rtol=1e-9)
    # And so the test of ARAIM is that of the largest of them, with the axis whose share of false alarms is largest.
    one = Araim(p_const=0.0, b_nom_m=0.0)

    @jax.jit
    def statistic(design, sigma_m, observed_m):
        model = linear_model(design, sigma_m)
        return one.statistic(model, one.prepare(model), start_from(model, observed_m))

    found = statistic(a, sigma, observed)
    k_fa = stats.norm.isf(LPV_200.p_fa_vertical / (2 * sigma.size))
    np.testing.assert_allclose(found, ratios.max(axis=0) / k_fa, rtol=1e-6)
    # A single test of each satellite could take the shares of all axes: a threshold of less than a tenth of a per cent
    # below, and that of all levels with it.
    whole = stats.norm.isf((LPV_200.p_fa_vertical + LPV_200.p_fa_horizontal) / (2 * sigma.size))
    assert 0.999 < whole / k_fa < 1.0
    assert found.max() > 1.0 > found.min()
