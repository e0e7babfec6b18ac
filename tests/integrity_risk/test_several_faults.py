"""Faults of several satellites: the direction that residuals show least, and the event under it by an exact law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

import pl_mc
from pl_mc.integrity_risk.given_residuals import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import LevelRisk
from pl_mc.integrity_risk.given_residuals.draws import EpochParts
from pl_mc.integrity_risk.given_residuals.several import _ROOTS, CONSTELLATIONS, PAIRS, least_shown, sets_of, several
from pl_mc.methods import method
from reference.problems import appendix_d

G = appendix_d()
N = len(G.names)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_no_other_direction_moves_the_error_more(axis):
    """Of a noncentrality of one; against a search over all directions of each pair."""
    parts = EpochParts.of(G, axis)
    residual = np.eye(N) - parts.basis[:N] @ parts.basis[:N].T
    sets, members = sets_of(G, PAIRS, parts.in_view.size)
    assert len(members) == N * (N - 1) // 2
    for chosen, places in list(zip(sets, members, strict=True))[::7]:
        bias = least_shown(parts, chosen)[:N] / G.sigma_m
        assert bias @ residual @ bias == pytest.approx(1.0, rel=1e-9)
        assert np.flatnonzero(bias).tolist() == list(places)

        def shift(angle, places=places):
            w = np.zeros(N)
            w[list(places)] = np.cos(angle), np.sin(angle)
            return -np.linalg.norm(parts.gain_m[:, :N] @ w) / np.sqrt(w @ residual @ w)

        angles = np.linspace(0, np.pi, 721)
        start = angles[np.argmin([shift(angle) for angle in angles])]
        best = optimize.minimize_scalar(shift, bounds=(start - 0.01, start + 0.01), method="bounded")
        assert np.linalg.norm(parts.gain_m[:, :N] @ bias) == pytest.approx(-best.fun, rel=1e-6)


def test_the_event_has_its_exact_probability():
    """Least squares with a-priori levels and a chi-square test: residuals and error are independent."""
    one = method("parity", form="sigma")
    risk = LevelRisk(G, one, RiskBudget(), "vertical", draws=4096, seed=3)
    sets, members = sets_of(G, PAIRS, risk.prior.size)
    some = np.arange(0, len(members), 9)
    found = several(risk, 1.0, sets[some])
    sigma = float(np.sqrt(risk.parts.covariance_m2[0, 0]))
    threshold = stats.chi2.isf(one.p_fa, N - 5)
    for k, place in enumerate(some):
        slope = abs(float((risk.parts.gain_m @ (least_shown(risk.parts, sets[place]) / risk.parts.sigma_m))[0])) / sigma
        shift, passes = slope * _ROOTS, stats.ncx2.cdf(threshold, N - 5, _ROOTS**2)
        exact = passes * (stats.norm.sf(one.k_vertical - shift) + stats.norm.sf(one.k_vertical + shift))
        # The best of a grid of draws may lie beside the best; four standard errors of the draws.
        assert found.probability[k] < exact.max() + 4 * found.error[k]
        assert found.probability[k] > 0.7 * exact.max() - 4 * found.error[k]
    assert not found.unseen.any()


def test_what_no_residual_shows_is_certain():
    """Both constellations, which are all that is there; one of them where the other determines no position."""
    risk = LevelRisk(G, method("parity", form="sigma"), RiskBudget(), "vertical", draws=1024, seed=3)
    sets, members = sets_of(G, CONSTELLATIONS, risk.prior.size)
    assert [len(places) for places in members] == [5, 5]
    found = several(risk, 1.0, np.concatenate([sets, sets.any(axis=0)[None]]))
    # Five satellites determine four unknowns: what is left of five residuals shows a constellation's fault.
    assert found.unseen.tolist() == [False, False, True]
    assert found.probability[2] == 1.0
    few = pl_mc.Geometry.from_arrays(
        G.design[[0, 1, 2, 3, 5, 6]], G.sigma_m[[0, 1, 2, 3, 5, 6]], "GGGGEE", list("abcdef")
    )
    parts = EpochParts.of(few, "vertical")
    assert least_shown(parts, np.arange(parts.in_view.size) < 4) is None
