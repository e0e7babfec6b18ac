"""The risk equations of ARAIM: thresholds of the tests and the protection levels that follow from the solutions.

Source: ADD v3.0; priors over an exposure, the cap and the two other horizontal levels as the code of the algorithm's
authors for ADD v4.2 has them (MAAST for ARAIM: `mhss_raim_baseline_v5`, `compute_protection_level`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import erfc, ndtri
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.araim.budget import Budget
from pl_mc.araim.solving import Subsets, Whole, by_axis
from pl_mc.geometry.record import EAST, UP

# Halvings of a first bracket that is at most a few sigma wide: 2e-10 of it is left.
HALVINGS = 32


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Figures:
    """What the equations take from a budget, as numbers that a compiled function is given.

    Attributes:
        factor: (3, m + 1), K_fa by number of tests, for which the false-alert risk of a sample is shared out.
        p_hmi: (3,), integrity risk of each axis; p_hmi_sum: () of all.
        samples: (), N_es for integrity; p_emt: ().
        capped: (), whether a fault counts no more often than it exists.
        sigma_acc_m: (3,), limits of the adjusted estimator, zero where there is none [m].
    """

    factor: ArrayLike
    p_hmi: ArrayLike
    p_hmi_sum: ArrayLike
    samples: ArrayLike
    p_emt: ArrayLike
    capped: ArrayLike
    sigma_acc_m: ArrayLike


def figures(budget: Budget, modes: int) -> Figures:
    """The figures of a budget, for up to so many modes."""
    number = np.maximum(np.arange(modes + 1), 1) * budget.samples_continuity
    horizontal, vertical = (
        -special.ndtri(p / number) for p in (budget.p_fa_horizontal / 4.0, budget.p_fa_vertical / 2.0)
    )
    return Figures(
        factor=by_axis(horizontal, vertical),
        p_hmi=by_axis(budget.p_hmi_horizontal / 2.0, budget.p_hmi_vertical),
        p_hmi_sum=np.asarray(budget.p_hmi),
        samples=np.asarray(float(budget.samples_integrity)),
        p_emt=np.asarray(budget.p_emt),
        capped=np.asarray(budget.capped),
        sigma_acc_m=by_axis(budget.sigma_acc_horizontal_m or 0.0, budget.sigma_acc_vertical_m or 0.0),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Priors:
    """Priors of the fault modes of ``g`` geometries.

    Attributes:
        instant: (m, g), of each mode at an instant, zero where it is not to be monitored.
        not_monitored: (g,), of all faults that are in none, over the exposure.
        exposure: (m, g), of each mode over the exposure; None in v3.0, which knows one prior.
        share: (g,), the part of the integrity risk that this position may take; None for all of it.
    """

    instant: Array
    not_monitored: Array
    exposure: Array | None = None
    share: Array | None = None


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
        horizontal_m: (3, g), other horizontal levels with priors over an exposure: by the norms of thresholds and
            sigmas, by planes, and by planes with the sign of the code [m]; None in v3.0.
    """

    level_m: Array
    threshold_m: Array
    emt_m: Array
    sigma_v_acc_m: Array
    p_not_monitored: Array
    available: Array
    horizontal_m: Array | None = None


def solve_levels(
    whole: Whole, modes: Subsets, priors: Priors, given: Figures, bias_ratio_continuity: Array | None = None,
    horizontal_wanted: Array | None = None,
) -> Levels:  # fmt: skip
    """Thresholds and levels (equations of K_fa, T, VPL, HPL, EMT and sigma_acc).

    A mode without a solution has no test: in v3.0 its prior joins what is not monitored, and over an exposure it is
    taken from what each sample may risk.

    Args:
        whole, modes: the solutions.
        priors: of the modes.
        given: figures of the operation's budget.
        bias_ratio_continuity: (n, g), b_acc over sigma, which widens the thresholds; none unless given.
        horizontal_wanted: (), whether the other horizontal levels are; if not they are zero, and cost nothing.
    """
    probability = priors.instant
    dtype = probability.dtype
    figure = jax.tree.map(lambda x: jnp.asarray(x, bool if np.result_type(x) == np.bool_ else dtype), given)
    live = probability > 0
    monitored = modes.regular & live
    cap, at_most = None, probability
    if priors.exposure is not None:
        often = priors.exposure / jnp.where(live, probability * figure.samples, 1.0)
        cap = jnp.where(figure.capped, jnp.minimum(1.0, often), 1.0)
        at_most = probability * cap
    lost = jnp.sum(jnp.where(monitored, 0.0, at_most), axis=0)
    p_not_monitored = priors.not_monitored if priors.exposure is not None else priors.not_monitored + lost
    count = jnp.sum(monitored, axis=0, dtype=jnp.int32)
    threshold = figure.factor[:, count][:, None] * modes.sigma_separation_m
    if bias_ratio_continuity is not None:
        threshold = threshold + jnp.sum(jnp.abs(modes.difference) * bias_ratio_continuity[None, :, None], axis=1)
    share = 1.0 - p_not_monitored / figure.p_hmi_sum
    if priors.share is not None:
        share = share * priors.share
    risk = figure.p_hmi[:, None] * share[None] / figure.samples
    if priors.exposure is not None:
        risk = risk - lost[None]
    available = whole.regular & (share > 0)
    there = available[None] & (risk > 0)
    risk = jnp.where(there, risk, 1.0)
    # The fault-free case stands beside the modes, with a prior of two for its two tails.
    mode_sigma = jnp.where(monitored[None], modes.sigma_m, 1.0)
    shift = jnp.where(monitored[None], threshold + modes.bias_m, 0.0)
    sigma = jnp.concatenate([jnp.where(available[None], whole.sigma_m, 1.0)[:, None], mode_sigma], axis=1)
    shift = jnp.concatenate([jnp.where(available[None], whole.bias_m, 0.0)[:, None], shift], axis=1)
    weight = jnp.concatenate([jnp.full_like(share, 2.0)[None], jnp.where(monitored, probability, 0.0)])
    caps = None if cap is None else jnp.concatenate([jnp.ones_like(share)[None], cap])
    horizontal = None
    if priors.exposure is not None:

        def further() -> Array:
            return _horizontal_levels(sigma[:UP], shift[:UP], weight, caps, risk[EAST])

        if horizontal_wanted is None:
            found = further()
        else:
            found = jax.lax.cond(horizontal_wanted, further, lambda: jnp.zeros((3, *share.shape), dtype))
        horizontal = jnp.where(there[EAST], found, jnp.inf)
    level = protection_level(sigma, shift, weight, risk, caps)
    probable = monitored & (probability >= figure.p_emt)
    return Levels(
        level_m=jnp.where(there, level, jnp.inf),
        threshold_m=jnp.where((monitored & available[None])[None], threshold, jnp.inf),
        emt_m=jnp.where(available, jnp.max(jnp.where(probable, threshold[UP], 0.0), axis=0), jnp.inf),
        sigma_v_acc_m=jnp.where(whole.regular, whole.sigma_accuracy_m[UP], jnp.inf),
        p_not_monitored=p_not_monitored,
        available=available,
        horizontal_m=horizontal,
    )


def protection_level(
    sigma_m: Array, shift_m: Array, probability: Array, risk: Array, cap: Array | None = None
) -> Array:
    """(q, g), the smallest levels L [m] with sum_k p_k min(c_k, Qbar((L - shift_k) / sigma_k)) <= risk.

    Q is the tail of the normal distribution, and Qbar is Q for positive arguments and 1 for others. By bisection,
    with a fixed number of halvings; the upper end is returned, so that the risk is met.

    Args:
        sigma_m, shift_m: (q, m, g), of the solutions, positive; their biases and, for fault modes, thresholds [m].
        probability: (m, g), priors; modes of prior zero do not count.
        risk: (q, g), the risk that is allowed, positive.
        cap: (m, g), c_k; one unless given.
    """
    live = probability > 0
    inverse = 1.0 / sigma_m
    # Below, a single term is more than the risk; above, each is no more than its part of it.
    ratio = jnp.stack([risk, risk / _terms(live, risk)])[:, :, None] / jnp.where(live, probability, 1.0)
    # A mode less probable than that needs no level at all; one not much more probable needs its shift.
    alone = shift_m - sigma_m * ndtri(jnp.minimum(ratio, 0.5))
    low = jnp.max(jnp.where(live & (ratio[0] < (1.0 if cap is None else cap)), alone[0], 0.0), axis=1)
    high = jnp.max(jnp.where(live, alone[1], 0.0), axis=1)

    def total(level: Array) -> Array:
        return jnp.sum(_capped(_tail((level[:, None] - shift_m) * inverse), cap) * probability[None], axis=1)

    return _halved(total, low, high, risk)


def _horizontal_levels(sigma_m: Array, shift_m: Array, probability: Array, cap: Array | None, risk: Array) -> Array:
    """(3, g), horizontal levels of one equation each: by norms, by planes, and by planes as the code has them [m].

    Norms (Racelis et al., ION GNSS+ 2022): thresholds and sigmas of both axes by their lengths. Planes (Blanch and
    Walter, 2023): an error beyond L lies beyond one of three planes. With s = hypot(sigma_1, sigma_2), a and c the
    parts of the shift along and across (sigma_1, sigma_2), the corner that is K sigma from the shift lies at the
    distance L where (s K + a)^2 + c^2 = L^2; the code has the other sign of c^2, which makes the level smaller.

    Args:
        sigma_m, shift_m: (2, m, g), east and north; the fault-free case is the first of the m.
        probability, cap: (m, g), of which that of the fault-free case is two.
        risk: (g,), half of what is horizontal, as a single axis has it.
    """
    live = probability > 0
    # Modes once for two tails, as the fault-free case has them already.
    weight = probability.at[0].divide(2.0)
    one, other = sigma_m
    s, length = jnp.hypot(one, other), jnp.hypot(*shift_m)
    along, across = (shift_m[0] * one + shift_m[1] * other) / s, (shift_m[0] * other - shift_m[1] * one) / s
    # The argument of the tails at which each term is its part of the risk.
    part = jnp.minimum(risk / _terms(live, risk[None])[0] / jnp.where(live, 2.0 * weight, 1.0), 0.5)
    enough = -ndtri(part)
    alone = (sigma_m[:, :1] * enough[None] - shift_m + shift_m[:, :1]) / sigma_m
    least = jnp.maximum(enough, jnp.max(alone, axis=0))
    corner = jnp.hypot(s * least + along, across)

    def by_norms(level: Array) -> Array:
        return jnp.sum(2.0 * weight * _capped(_tail((level[None] - length) / s), cap), axis=0)

    def by_planes(level: Array, sign: float) -> Array:
        k = (jnp.sqrt(jnp.maximum(level[None] ** 2 + sign * across**2, 0.0)) - along) / s
        axes = (sigma_m * k[None] + shift_m - shift_m[:, :1]) / sigma_m[:, :1]
        return jnp.sum(weight * _capped(_tail(k) + jnp.sum(_tail(axes), axis=0) / 2.0, cap), axis=0)

    ends = (length + s * enough, corner, corner)
    equations = (by_norms, lambda level: by_planes(level, -1.0), lambda level: by_planes(level, 1.0))
    return jnp.stack(
        [
            _halved(equation, jnp.zeros_like(risk), jnp.max(jnp.where(live, end, 0.0), axis=0), risk)
            for equation, end in zip(equations, ends, strict=True)
        ]
    )


def _tail(u: Array) -> Array:
    """Qbar: the tail of the normal distribution for positive arguments, 1 for others."""
    return jnp.where(u > 0, 0.5 * erfc(u * math.sqrt(0.5)), 1.0)


def _capped(tail: Array, cap: Array | None) -> Array:
    return tail if cap is None else jnp.minimum(tail, cap)


def _terms(live: Array, risk: Array) -> Array:
    """(1, g), the number of terms of an equation."""
    return jnp.sum(live, axis=0, dtype=risk.dtype)[None]


def _halved(total: Callable[[Array], Array], low: Array, high: Array, risk: Array) -> Array:
    """The upper end of the halved bracket of the root of ``total`` = risk."""

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        above = total(middle) > risk
        return jnp.where(above, middle, low), jnp.where(above, high, middle)

    return jax.lax.fori_loop(0, HALVINGS, halve, (low, high))[1]
