"""The S-estimate: the solution whose residuals have the smallest robust scale (Rousseeuw & Yohai 1984).

The scale s of whitened residuals e solves sum rho(e_i / s) = (n - t) / 2 with Tukey's rho, which is bounded: up to
(n - t) / 2 residuals may be as large as they like. Divided by n - t instead of n, s is positive wherever the fit is
not exact, and a satellite alone in its system changes nothing.

The smallest s is looked for from a few starts that the data and the geometry decide, all at once, each as a lane
of its own, with a fixed number of steps (Salibian-Barrera & Yohai 2006): least squares; least absolute residuals;
least squares of the half of the satellites that those fit best; and least squares of each system with little weight
on the others, for a system that is faulty as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.input_errors import hold_whole
from pl_mc.kernels.estimate import Iterate, LeastSquaresSolution
from pl_mc.kernels.linear_model import COORDINATES, LinearModel, per_lane
from pl_mc.kernels.reweighting import first_iterate, solve_weighted
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.kernels.standardised import MAD_TO_SIGMA
from pl_mc.kernels.weights import L1Weight, TukeyWeight

# Tukey's rho with this constant has the mean 1/2 under a standard normal variable (Rousseeuw & Yohai 1984).
HALF_BREAKDOWN = 1.547645

# Solutions that lead to the start of least absolute residuals.
L1_STEPS = 10

# Weight of satellites that a start does not want: they keep it determined.
_UNWANTED = 1e-3

# Steps of the scale alone, once the residuals stay.
_SCALE_STEPS = 30


@dataclass(frozen=True)
class SOptions:
    """The choices of an S-estimate.

    Attributes:
        steps: reweighted solutions from each start.
    """

    steps: int = 10

    def __post_init__(self) -> None:
        hold_whole(self, "steps", field="s_steps", low=1)


def s_estimate(model: LinearModel, start: LeastSquaresSolution, options: SOptions) -> tuple[Iterate, Array, Array]:
    """The solution with the smallest scale.

    Returns:
        The solution; (n, ...), the weights that produced it; and (...), its scale in units of sigma, infinite where
        no start led to a determined solution.
    """
    lanes = start.square_sum.shape
    n = model.in_view.shape[0]
    systems = model.design[:, COORDINATES:] != 0
    model = replace(model, design=model.twins.design_same)
    wanted = _starting_weights(model, start, systems)
    starts = wanted.shape[1]

    def flat(array: Array) -> Array:
        """(rows, ...) as (rows, starts times lanes)."""
        repeated = jnp.broadcast_to(array[:, None], (array.shape[0], starts, *lanes))
        return repeated.reshape(array.shape[0], -1)

    def apart(array: Array) -> Array:
        """(starts times lanes,) as (starts, ...)."""
        return array.reshape(starts, *lanes)

    every = LeastSquaresSolution(flat(start.residuals), flat(start.state), flat(start.square_sum[None])[0])
    determined = jnp.broadcast_to(model.available, every.square_sum.shape)
    first_weights = wanted.reshape(n, -1)
    first, _ = solve_weighted(model, every, first_weights, determined)
    weight = TukeyWeight(HALF_BREAKDOWN)

    def step(carry: tuple[Iterate, Array, Array], _: None) -> tuple[tuple[Iterate, Array, Array], None]:
        iterate, scale = carry[0], carry[2]
        scale = _next_scale(model, iterate.residuals, scale)
        weights = weight(_over(jnp.abs(iterate.residuals), scale))
        return (solve_weighted(model, every, weights, iterate.determined)[0], weights, scale), None

    carry = (first, first_weights, _first_scale(model, first.residuals))
    (last, weights, scale), _ = jax.lax.scan(step, carry, None, length=options.steps)
    scale = jax.lax.fori_loop(0, _SCALE_STEPS, lambda _, s: _next_scale(model, last.residuals, s), scale)
    scale = apart(jnp.where(last.determined, scale, jnp.inf))
    best = jnp.argmin(scale, axis=0)[None]

    def pick(array: Array) -> Array:
        return jnp.take_along_axis(apart(array), best, axis=0)[0]

    def pick_rows(array: Array) -> Array:
        whole = array.reshape(array.shape[0], starts, *lanes)
        return jnp.take_along_axis(whole, best[None], axis=1)[:, 0]

    iterate = Iterate(
        residuals=pick_rows(last.residuals),
        shift=tuple(pick(one) for one in last.shift),
        square_sum=pick(last.square_sum),
        determined=pick(last.determined),
    )
    return iterate, pick_rows(weights), jnp.take_along_axis(scale, best, axis=0)[0]


def _starting_weights(model: LinearModel, start: LeastSquaresSolution, systems: Array) -> Array:
    """(n, starts, ...), weights whose solutions are the starts; ``systems`` (n, t - 3), which clock a row has."""
    absolute = L1Weight()

    def step(carry: tuple[Iterate, Array], _: None) -> tuple[tuple[Iterate, Array], None]:
        iterate = carry[0]
        weights = absolute(jnp.abs(iterate.residuals))
        return (solve_weighted(model, start, weights, iterate.determined, relative=True)[0], weights), None

    ones = jnp.ones_like(start.residuals)
    (l1, l1_weights), _ = jax.lax.scan(step, (first_iterate(model, start), ones), None, length=L1_STEPS)
    size = _sizes(model, l1.residuals)
    # As many as least trimmed squares keeps for the largest breakdown, (n + t + 1) / 2 (Rousseeuw & Leroy 1987).
    half = (jnp.round(jnp.sum(model.in_view) + model.unknowns).astype(jnp.int32) + 1) // 2
    border = jnp.take(jnp.sort(size, axis=0), jnp.maximum(half - 1, 0), axis=0)
    # With the twins of the last of them, whatever rounding makes of it.
    border = border * (1.0 + 10.0 * float(jnp.finfo(size.dtype).eps))
    fitted = jnp.where(size <= border[None], 1.0, _UNWANTED).astype(ones.dtype)
    own = jnp.where(systems, 1.0, _UNWANTED).astype(ones.dtype)
    alone = [jnp.broadcast_to(per_lane(own[:, k], ones), ones.shape) for k in range(own.shape[1])]
    return jnp.stack([ones, l1_weights, fitted, *alone], axis=1)


def _sizes(model: LinearModel, residuals: Array) -> Array:
    """|e|, infinite out of view."""
    return jnp.where(per_lane(model.in_view, residuals) > 0, jnp.abs(residuals), jnp.inf)


def _first_scale(model: LinearModel, residuals: Array) -> Array:
    """1.4826 times the median of |e| without the t smallest, which any fit can make vanish."""
    ordered = jnp.sort(_sizes(model, residuals), axis=0)
    dof = jnp.round(model.dof).astype(jnp.int32)
    place = jnp.round(model.unknowns).astype(jnp.int32) + (dof + 1) // 2 - 1
    middle = jnp.take(ordered, jnp.clip(place, 0, ordered.shape[0] - 1), axis=0)
    return MAD_TO_SIGMA * jnp.where(jnp.isfinite(middle), middle, 1.0)


def _next_scale(model: LinearModel, residuals: Array, scale: Array) -> Array:
    """One step of s^2 <- s^2 sum rho(e / s) / ((n - t) / 2)."""
    inner = 1.0 - jnp.minimum(_over(jnp.abs(residuals), scale) * (1.0 / HALF_BREAKDOWN), 1.0) ** 2
    mean = jnp.sum(1.0 - inner * inner * inner, axis=0) / jnp.maximum(model.dof, 1)
    return scale * safe_sqrt(2.0 * mean)


def _over(size: Array, scale: Array) -> Array:
    """Standardised sizes; an exact fit leaves no scale, and any finite number serves."""
    return size * (1.0 / jnp.where(scale > 0, scale, 1.0))[None]
