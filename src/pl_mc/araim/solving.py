"""Solution separation: position solutions without the satellites of each fault mode, and the levels that follow.

How far those solutions stand from the one with all satellites decides the thresholds of the tests, and the risk
equations then the protection levels. Everything is whitened (rows of the design divided by sigma). Fault modes and
geometries run along the last two axes; satellites are the outer loop, so that all sums are elementwise and no axis
is short where it matters.
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
from pl_mc.geometry.record import EAST, NORTH, UP
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.kernels.small_matrix import cholesky, lower_triangle, pivot_floor, solve

# Halvings of a first bracket that is at most a few sigma wide: 2e-10 of it is left.
HALVINGS = 32


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Whole:
    """The solution with all satellites in view, for each of ``g`` geometries; meaningless where not regular.

    Attributes:
        sigma_m: (3, g), standard deviation under the integrity model, east, north, up [m].
        bias_m: (3, g), largest effect of the nominal biases [m].
        sigma_accuracy_m: (3, g), standard deviation under the accuracy model [m].
        regular: (g,), whether there is such a solution.
    """

    sigma_m: Array
    bias_m: Array
    sigma_accuracy_m: Array
    regular: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Subsets:
    """The solutions of ``m`` fault modes for each of ``g`` geometries; east, north, up along the axis of length 3.

    Attributes:
        difference: (3, n, m, g), what a whitened observation adds to the difference from the solution with all
            satellites [m]; exactly zero where there is no difference but rounding.
        sigma_m: (3, m, g), standard deviation under the integrity model [m].
        bias_m: (3, m, g), largest effect of the nominal biases [m].
        sigma_separation_m: (3, m, g), standard deviation of that difference under the accuracy model [m].
        regular: (m, g), whether the satellites that are left determine a position; where not, all is finite and
            meaningless.
    """

    difference: Array
    sigma_m: Array
    bias_m: Array
    sigma_separation_m: Array
    regular: Array


def separation_floor(dtype: jax.typing.DTypeLike) -> float:
    """Differences of two solutions below this share of their standard deviation are rounding."""
    return max(1e-9, 1e3 * float(jnp.finfo(dtype).eps))


def fit_subsets(
    design: Array, in_view: Array, excluded: Array, bias_ratio: Array, accuracy_ratio: Array
) -> tuple[Whole, Subsets]:
    """Least squares with all satellites, and without those of each mode (ADD v3.0: S^(k), sigma, b, sigma_ss).

    A clock that no satellite left observes drops out.

    Args:
        design: (n, t, g), whitened design, zero on padding [1/m].
        in_view: (n, g), which rows count; excluded: (n, m, g), which satellites each mode leaves out.
        bias_ratio, accuracy_ratio: (n, g), nominal bias over sigma, accuracy over integrity variance.
    """
    t = design.shape[1]
    places = lower_triangle(t)
    rows, columns = np.array(places).T
    # The first of the modes leaves nothing out.
    kept = in_view[:, None] & ~jnp.concatenate([jnp.zeros_like(excluded[:, :1]), excluded], axis=1)
    mask = kept.astype(design.dtype)
    shape = mask.shape[1:]

    def add_row(packed: Array, row: tuple[Array, Array]) -> tuple[Array, None]:
        a, used = row
        return packed + (a[rows] * a[columns])[:, None] * used[None], None

    # One axis more, of length one, over which east, north and up are spread below.
    packed = jax.lax.scan(add_row, jnp.zeros((len(places), *shape), design.dtype), (design, mask))[0][:, None]
    # A clock that nothing observes has an element of exactly zero, being a sum of products with zeros.
    idle = (packed == 0) & jnp.asarray((rows == columns) & (rows >= COORDINATES))[:, None, None, None]
    packed = jnp.where(idle, 1.0, packed)
    factor = cholesky(packed, pivot_floor(packed[rows == columns]))
    # Columns of the inverse, which are its rows: (3, m, g) for each unknown.
    units = [jnp.broadcast_to(jnp.asarray(unit, design.dtype)[:, None, None], (3, *shape)) for unit in np.eye(t, 3)]
    inverse = solve(factor, units)

    def add_satellite(
        total: tuple[Array, Array, Array], row: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array, Array], Array]:
        bias, square, own = total
        a, used, nominal, accuracy = row
        gain = used[None] * sum(x * a[j][None, None] for j, x in enumerate(inverse))
        step = gain - gain[:, :1]
        scale = accuracy[None, None]
        total = (
            bias + jnp.abs(gain) * nominal[None, None],
            square + step * step * scale,
            own + (gain[:, :1] * gain[:, :1] * scale)[:, 0],
        )
        return total, step[:, 1:]

    start = jnp.zeros((COORDINATES, *shape), design.dtype)
    (bias, square, own), difference = jax.lax.scan(
        add_satellite, (start, start, start[:, 0]), (design, mask, bias_ratio, accuracy_ratio)
    )
    sigma = jnp.sqrt(jnp.stack([jnp.maximum(inverse[q][q], 0.0) for q in range(COORDINATES)]))
    regular = factor.regular[0]
    separation = jnp.sqrt(square)
    differs = (separation > separation_floor(design.dtype) * sigma)[:, 1:]
    whole = Whole(sigma[:, 0], bias[:, 0], jnp.sqrt(own), regular[0])
    modes = Subsets(
        difference=jnp.where(differs[:, None], jnp.moveaxis(difference, 0, 1), 0.0),
        sigma_m=sigma[:, 1:],
        bias_m=bias[:, 1:],
        sigma_separation_m=jnp.where(differs, separation[:, 1:], 0.0),
        regular=regular[1:],
    )
    return whole, modes


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


def solve_levels(whole: Whole, modes: Subsets, probability: Array, p_not_monitored: Array, budget: Budget) -> Levels:
    """Thresholds and levels (ADD v3.0, equations of K_fa, T, VPL, HPL, EMT and sigma_acc).

    Priors are (m, g) of each mode, zero where it is not to be monitored, and (g,) of all faults that are in none.
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
        sigma_m, shift_m: (3, m, g), of the solutions, positive; their biases and, for fault modes, thresholds [m].
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
