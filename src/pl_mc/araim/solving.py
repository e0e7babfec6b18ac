"""Thresholds of the solution-separation tests, and the protection levels that the risk equations give.

Modes and geometries run along the last two axes, as in `pl_mc.araim.subsets`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import erfc, ndtri
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from pl_mc.araim.budget import Budget
from pl_mc.araim.subsets import Subsets, Whole
from pl_mc.geometry.record import EAST, NORTH, UP

# Halvings of a first bracket that is at most a few sigma wide: 2e-10 of it is left.
HALVINGS = 32


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Levels:
    """Levels of ``g`` geometries; infinite where there are none.

    Attributes:
        level_m: (3, g), protection levels east, north, up [m].
        threshold_m: (3, m, g), largest separation that passes the test of each mode [m]; infinite where the mode is
            not monitored.
        emt_m: (g,), effective monitor threshold [m].
        sigma_v_acc_m: (g,), standard deviation of the vertical error under the accuracy model [m].
        p_not_monitored: (g,), prior probability of faults that no test looks for.
        available: (g,), whether there are levels.
    """

    level_m: Array
    threshold_m: Array
    emt_m: Array
    sigma_v_acc_m: Array
    p_not_monitored: Array
    available: Array


def solve_levels(
    whole: Whole, modes: Subsets, probability: Array, p_not_monitored: Array, budget: Budget
) -> Levels:
    """Thresholds and levels (ADD v3.0, equations of K_fa, T, VPL, HPL, EMT and sigma_acc).

    Args:
        whole: the solution with all satellites.
        modes: those of the fault modes.
        probability: (m, g), prior of each mode; zero where it is not to be monitored.
        p_not_monitored: (g,), prior of all faults that are in no mode.
        budget: the operation's risks.
    """
    monitored = modes.regular & (probability > 0)
    lost = jnp.sum(jnp.where(monitored, 0.0, probability), axis=0)
    p_not_monitored = p_not_monitored + lost
    count = jnp.sum(monitored, axis=0, dtype=jnp.int32)
    # K_fa by number of tests, for which the false-alert risk is shared out.
    number = np.maximum(np.arange(probability.shape[0] + 1), 1)
    horizontal, vertical = (
        stats.norm.isf(p / number) for p in (budget.p_fa_horizontal / 4.0, budget.p_fa_vertical / 2.0)
    )
    factor = jnp.asarray(_by_axis(horizontal, vertical), probability.dtype)[:, count]
    threshold = factor[:, None] * modes.sigma_separation_m
    p_hmi = _by_axis(budget.p_hmi_horizontal / 2.0, budget.p_hmi_vertical)
    share = 1.0 - p_not_monitored / budget.p_hmi
    available = whole.regular & (share > 0)
    # The fault-free case stands beside the modes, with a prior of two for its two tails.
    mode_sigma = jnp.where(monitored[None], modes.sigma_m, 1.0)
    shift = jnp.where(monitored[None], threshold + modes.bias_m, 0.0)
    level = protection_level(
        jnp.concatenate([jnp.where(available[None], whole.sigma_m, 1.0)[:, None], mode_sigma], axis=1),
        jnp.concatenate([jnp.where(available[None], whole.bias_m, 0.0)[:, None], shift], axis=1),
        jnp.concatenate([jnp.full_like(share, 2.0)[None], jnp.where(monitored, probability, 0.0)]),
        jnp.asarray(p_hmi, share.dtype)[:, None] * jnp.where(available, share, 1.0)[None],
    )
    probable = monitored & (probability >= budget.p_emt)
    return Levels(
        level_m=jnp.where(available[None], level, jnp.inf),
        threshold_m=jnp.where((monitored & available[None])[None], threshold, jnp.inf),
        emt_m=jnp.where(available, jnp.max(jnp.where(probable, threshold[UP], 0.0), axis=0), jnp.inf),
        sigma_v_acc_m=jnp.where(whole.regular, whole.sigma_accuracy_m[UP], jnp.inf),
        p_not_monitored=p_not_monitored,
        available=available,
    )


def protection_level(sigma_m: Array, shift_m: Array, probability: Array, risk: Array) -> Array:
    """(3, g), the smallest levels L [m] with sum_k p_k Qbar((L - shift_k) / sigma_k) <= risk.

    Q is the tail of the normal distribution, and Qbar is Q for positive arguments and 1 for others. By bisection,
    with a fixed number of halvings; the upper end is returned, so that the risk is met.

    Args:
        sigma_m: (3, m, g), standard deviations of the solutions, positive [m].
        shift_m: (3, m, g), their biases and, for fault modes, thresholds [m].
        probability: (m, g), priors; modes of prior zero do not count.
        risk: (3, g), the risk that is allowed, positive.
    """
    live = probability > 0
    inverse = 1.0 / sigma_m

    def total(level: Array) -> Array:
        u = (level[:, None] - shift_m) * inverse
        tail = 0.5 * erfc(u * math.sqrt(0.5))
        return jnp.sum(jnp.where(u > 0, tail, 1.0) * probability[None], axis=1)

    # Below, a single term is more than the risk; above, each is no more than its part of it.
    terms = jnp.sum(live, axis=0, dtype=risk.dtype)[None]
    ratio = jnp.stack([risk, risk / terms])[:, :, None] / jnp.where(live, probability, 1.0)
    # A mode less probable than that needs no level at all; one not much more probable needs its shift.
    alone = shift_m - sigma_m * ndtri(jnp.minimum(ratio, 0.5))
    low = jnp.max(jnp.where(live & (ratio[0] < 1.0), alone[0], 0.0), axis=1)
    high = jnp.max(jnp.where(live, alone[1], 0.0), axis=1)

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        above = total(middle) > risk
        return jnp.where(above, middle, low), jnp.where(above, high, middle)

    return jax.lax.fori_loop(0, HALVINGS, halve, (low, high))[1]


def _by_axis(horizontal: ArrayLike, vertical: ArrayLike) -> NDArray[np.float64]:
    """(3, ...), what belongs to each axis."""
    values = {EAST: horizontal, NORTH: horizontal, UP: vertical}
    return np.stack([np.asarray(values[q], dtype=float) for q in sorted(values)])
