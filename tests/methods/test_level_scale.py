"""What stands for the unit-weight error in the levels: that of the solution, at least one, or one."""

from __future__ import annotations

import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods import L1, Igg3, Ls, method
from pl_mc.methods.base import Estimator
from pl_mc.methods.capabilities import exact_law, levels_from_geometry
from pl_mc.methods.registry import METHODS
from pl_mc.statistics import binomial_p_value, ls_quantities
from reference.problems import appendix_d

G = appendix_d()
FAULTS = pl_mc.no_fault(G) + pl_mc.biases(G, {"G03": 8.0})
ESTIMATES = sorted(name for name, made in METHODS.items() if issubclass(made, Estimator))


def model_and_start():
    """The geometry, and least squares of 60 draws, half of them with a fault."""
    errors_m = np.random.default_rng(4).standard_normal((60, len(G.names))) * G.sigma_m
    errors_m[30:, 2] += 8.0
    model = jax.jit(linear_model)(np.asarray(G.design), np.asarray(G.sigma_m))
    return model, jax.jit(start_from)(model, errors_m.T)


def levels(one) -> np.ndarray:
    """(draws, 2), VPL and HPL [m]."""
    model, start = model_and_start()
    outcome = jax.jit(lambda start: one.solve(model, one.prepare(model), start))(start)
    return np.stack([outcome.vpl_m, outcome.hpl_m], axis=-1)


def test_floored_levels_are_the_larger_of_the_two_others() -> None:
    """One estimate of each method, with levels of every scale."""
    scales = ("posterior", "apriori", "floored")
    few = [replace(method(name), **({} if name == "ls" else {"iterations": 3})) for name in ESTIMATES]
    assert replace(few[0], level_scale="floored").name.endswith("level_scale=floored)")
    model, start = model_and_start()

    def every(start):
        estimates = [(one, one._estimate(model, start)) for one in few]
        return [[replace(one, level_scale=scale)._levels(found) for one, found in estimates] for scale in scales]

    found = np.array([[[one.vpl_m, one.hpl_m] for one in part] for part in jax.jit(every)(start)])
    np.testing.assert_allclose(found[2], np.maximum(found[0], found[1]), rtol=1e-12)
    # What a method says are these levels.
    for name in ("igg3_gated", "l1", "ls"):
        place = ESTIMATES.index(name)
        said = levels(replace(few[place], level_scale="floored"))
        np.testing.assert_allclose(said, found[2, place].T, rtol=1e-12)
    # There are errors of either kind for each.
    assert (found[1] > found[0]).any(axis=(1, 2)).all()
    assert (found[1] < found[0]).any(axis=(1, 2)).all()


def test_the_apriori_level_of_least_squares_is_its_standard_deviation() -> None:
    found = levels(Ls(level_scale="apriori"))
    quantities = ls_quantities(G)
    np.testing.assert_allclose(found[:, 0], 5.33 * float(quantities.vdop_m), rtol=1e-12)
    np.testing.assert_allclose(found[:, 1], 6.18 * float(quantities.hdop_m), rtol=1e-12)
    # A unit-weight error of least absolute residuals that is what normal errors lead to expect.
    assert L1.apriori == pytest.approx(math.sqrt(math.pi / 2))
    assert levels_from_geometry(Ls(level_scale="apriori"))
    assert not levels_from_geometry(Ls())


def test_the_multiplier_of_an_apriori_level_is_that_of_the_normal_law() -> None:
    for target in (1e-3, 1e-7, 2e-9):
        one = pl_mc.calibrate(G, method=Ls(level_scale="apriori"), target=target).iloc[0]
        assert one.k_vertical == pytest.approx(stats.norm.isf(target / 2), rel=1e-9)
        assert one.k_low == one.k_vertical == one.k_high


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
@pytest.mark.parametrize("limit_m", [8.0, 16.0])
def test_counts_follow_the_exact_law(axis: str, limit_m: float) -> None:
    """Of every event, within what a count of 60,000 draws can tell at one in 10,000."""
    draws, alert = 60_000, pl_mc.AlertLimits("own", limit_m, limit_m)
    one = Ls(level_scale="apriori", k_vertical=2.0, k_horizontal=1.5)
    faults = FAULTS + pl_mc.biases(G, {"G03": 25.0, "E08": -10.0})
    exact = exact_law(one).rates(G, faults, alert, axis)
    table = pl_mc.sweep(G, faults, draws=draws, seed=9, methods=(one,), alert=alert, axes=axis, progress=False)
    for event in ("alarm", "hazard", "missed", "exceeded", "misleading", "false_alarm"):
        counts = table[{"missed": "missed", "exceeded": "exceeded", "misleading": "misleading"}.get(event, f"{event}s")]
        for count, rate in zip(counts, exact[f"{event}_rate"], strict=True):
            assert binomial_p_value(int(count), draws, min(max(float(rate), 0.0), 1.0)) > 1e-4, (event, rate)


def test_floored_levels_have_no_closed_form_and_other_words_are_refused() -> None:
    assert exact_law(Ls(level_scale="floored")) is None
    with pytest.raises(pl_mc.InputError, match=r"^igg3: level_scale: 'floor' is unknown \(nearest: floored\)"):
        Igg3(level_scale="floor")
