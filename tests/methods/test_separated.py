"""The separated level: its parts against plain NumPy, what it promises, and its refusals."""

from __future__ import annotations

import functools
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import optimize, stats

import pl_mc
from pl_mc.araim import Ism
from pl_mc.ism import satellite_codes
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods import Separated, method
from pl_mc.methods.registry import METHODS
from reference.problems import random_series

G = random_series(np.random.default_rng(3), np.ones((1, 11), bool), "GGGGGGEEEEE", noise=1.0)[0]
LANES = 40


PLAIN = method("separated", p_const=0.0, b_nom_m=0.0)
BY_OPTIONS = {
    "ls": replace(PLAIN, estimate="ls"),
    "midrange": replace(PLAIN, estimate="midrange"),
    "biases": replace(PLAIN, estimate="huber", b_nom_m=0.3),
    "none refuted": replace(PLAIN, p_refuted=0.0),
}
NEVER = replace(BY_OPTIONS["midrange"], p_refuted=0.0)
CONSTELLATIONS = method("separated", b_nom_m=0.0)
# In one program, for as many lanes.
EVERY = (*BY_OPTIONS.values(), NEVER, CONSTELLATIONS, PLAIN)


@functools.partial(jax.jit, static_argnames="methods")
def solved(design, sigma_m, observed_m, codes, *, methods: tuple[Separated, ...]):
    model = linear_model(design, sigma_m, satellite=codes)
    start = start_from(model, observed_m)
    return [of.solve(model, of.prepare(model), start) for of in methods]


def outcome(one: Separated, observed_m: np.ndarray):
    return solved(np.asarray(G.design), np.asarray(G.sigma_m), observed_m, None, methods=EVERY)[EVERY.index(one)]


def observations() -> np.ndarray:
    """(n, lanes): noise, then two sizes of a fault on two satellites."""
    errors_m = np.random.default_rng(8).standard_normal((11, LANES)) * G.sigma_m[:, None]
    errors_m[2, 10:20] += 12.0
    errors_m[7, 20:30] -= 60.0
    # Two faults at once refute every mode of one.
    errors_m[[1, 8], 30:] += 80.0
    return errors_m


@functools.cache
def known_before(one: Separated):
    """What the geometry says: gains, satellites, largest residuals of the modes, and levels (3,) without separation."""
    design, sigma = np.asarray(G.design), np.asarray(G.sigma_m)
    n = len(sigma)
    p_sat, budget = one.p_sat, one.budget
    none = (1 - p_sat) ** n
    modes = [(np.ones(n, bool), 1.0, one.p_refuted * 1e-4)]
    for k in range(n):
        modes.append((np.arange(n) != k, none * p_sat / (1 - p_sat), one.p_refuted))
    lost = 1.0 - none - sum(prior for _, prior, _ in modes[1:]) + sum(prior * p for _, prior, p in modes)
    share = 1 - lost / budget.p_hmi
    gains, largest = [], []
    for kept, _, p in modes:
        whitened = design[kept] / sigma[kept, None]
        gain = np.zeros((5, n))
        gain[:, kept] = np.linalg.pinv(whitened) / sigma[kept]
        root = np.sqrt(stats.chi2.isf(p, kept.sum() - 5)) + one.b_nom_m * np.sqrt((sigma[kept] ** -2.0).sum())
        gains.append(gain)
        largest.append(np.inf if p == 0 else root)
    position = np.array(gains)[:, :3]
    sigma_k = np.sqrt(((position * sigma) ** 2).sum(axis=2))
    bias_k = np.abs(position).sum(axis=2) * one.b_nom_m
    priors = np.array([prior for _, prior, _ in modes])
    level = []
    for q, risk in enumerate((budget.p_hmi_horizontal / 2, budget.p_hmi_horizontal / 2, budget.p_hmi_vertical)):

        def excess(t: float, q: int = q, risk: float = risk) -> float:
            u = (t - bias_k[:, q]) / sigma_k[:, q]
            tails = 2 * priors * np.where(u > 0, stats.norm.sf(u), 1.0)
            return tails.sum() / (risk * share) - 1

        level.append(optimize.brentq(excess, 1e-3, 1e3, xtol=1e-13))
    return gains, [kept for kept, _, _ in modes], largest, np.array(level)


def by_hand(one: Separated, observed_m: np.ndarray, estimate_m: np.ndarray | None):
    """Position, levels (3,) and rejection of one lane: subset by subset, by LAPACK and SciPy."""
    design, sigma = np.asarray(G.design), np.asarray(G.sigma_m)
    gains, modes, largest, level = known_before(one)
    stands = []
    for gain, kept, root in zip(gains, modes, largest, strict=True):
        residuals = (observed_m - design @ (gain @ observed_m))[kept] / sigma[kept]
        stands.append(np.linalg.norm(residuals) <= root)
    solutions = (np.array(gains)[:, :3] @ observed_m)[np.array(stands)]
    if not len(solutions):
        return None, None, True
    at = 0.5 * (solutions.min(axis=0) + solutions.max(axis=0)) if estimate_m is None else estimate_m
    return at, level + np.abs(solutions - at).max(axis=0), False


@pytest.mark.parametrize("one", BY_OPTIONS.values(), ids=BY_OPTIONS)
def test_levels_are_those_of_a_plain_computation(one) -> None:
    observed_m = observations()
    found = outcome(one, observed_m)
    assert bool(found.available.all())
    refuted = 0
    for lane in range(LANES):
        estimate = None if one.estimate == "midrange" else np.asarray(found.error_m[:, lane])
        position, level, rejects = by_hand(one, observed_m[:, lane], estimate)
        assert bool(found.rejects[lane]) == rejects, lane
        refuted += rejects
        if not rejects:
            np.testing.assert_allclose(found.error_m[:, lane], position, atol=1e-9)
            np.testing.assert_allclose(found.vpl_m[lane], level[2], rtol=1e-7)
            np.testing.assert_allclose(found.hpl_m[lane], np.hypot(*level[:2]), rtol=1e-7)
    assert refuted == (10 if one.p_refuted else 0)


def test_a_large_fault_leaves_the_mode_that_holds_it() -> None:
    """The level does not grow with the fault, and it is no wider than that of its own mode and the separation."""
    observed_m = np.repeat(np.random.default_rng(1).standard_normal((11, 1)) * G.sigma_m[:, None], LANES, axis=1)
    observed_m[4] += np.resize([100.0, 300.0, 3000.0], LANES)
    found = outcome(BY_OPTIONS["midrange"], observed_m)
    assert not found.rejects.any()
    np.testing.assert_allclose(found.vpl_m, found.vpl_m[0], rtol=1e-9)
    np.testing.assert_allclose(found.error_m[:, 0], found.error_m[:, 2], atol=1e-7)
    # What no fault can refute grows with it.
    kept = outcome(NEVER, observed_m)
    assert kept.vpl_m[2] > 5 * kept.vpl_m[1] > 10 * found.vpl_m[1]


# Few solutions: the budget is kept whatever the estimate is.
@pytest.mark.parametrize("estimate", ["midrange", pl_mc.igg3(iterations=10), "ls"], ids=["midrange", "igg3", "ls"])
def test_the_level_keeps_its_budget_whatever_the_estimate(estimate) -> None:
    budget = pl_mc.RiskBudget(target=9.8e-8)
    for axis, more in (("vertical", {}), ("horizontal", {"target": 2e-9})):
        one = method("separated", p_const=0.0, b_nom_m=0.0, estimate=estimate)
        row = pl_mc.level_risk(G, method=one, budget=replace(budget, **more), axis=axis, draws=1024, seed=3).iloc[0]
        assert row["kept"], row
        assert 0 <= row["contribution_fault_free"] < row["risk"] < row["risk_high"]


def test_constellations_and_an_ism_count() -> None:
    both, lone = (outcome(one, observations()) for one in (CONSTELLATIONS, PLAIN))
    assert bool((both.vpl_m > 1.2 * lone.vpl_m)[:10].all())
    said = method("separated", ism=Ism(b_nom_m=0.0, p_sat=1e-5, p_const=0.0))
    codes = satellite_codes(G.as_series(), G.as_series().satellite[0])
    (same,) = solved(np.asarray(G.design), np.asarray(G.sigma_m), observations(), codes, methods=(said,))
    np.testing.assert_allclose(same.vpl_m, lone.vpl_m, rtol=1e-12)


def test_names_and_refusals() -> None:
    assert METHODS["separated"]().name == "separated"
    assert method("separated", estimate="midrange").name == "separated(estimate=midrange)"
    assert method("separated", estimate=pl_mc.igg3(k0=2.0)).name == "separated(estimate=igg3(k0=2))"
    for options, words in (
        ({"estimate": "araim"}, "separated: estimate: 'araim'"),
        ({"estimate": 3}, "separated: estimate: one of ls, igg3"),
        ({"p_refuted": 0.5}, "separated: p_refuted: from 0 to below 0.1, not 0.5"),
        ({"accuracy_ratio": 0.5}, "the option 'accuracy_ratio' is unknown"),
        ({"p_sat": 0.0}, "p_sat"),
    ):
        with pytest.raises(pl_mc.InputError, match="separated") as caught:
            method("separated", **options)
        assert words in str(caught.value)
