"""Iteratively reweighted least squares with a fixed number of iterations, for one scenario or for many lanes.

Arrays have scenarios along their last axis: (n,) is one scenario, (n, lanes) a batch, and the code is the same. The
computation runs on whitened residuals of the least-squares solution, so that large observations cost no digits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.clock_elimination import eliminate_clocks
from pl_mc.kernels.estimate import Estimate, Iterate, LeastSquaresSolution
from pl_mc.kernels.irls_options import AITKEN_START, HUBER_START, SANDWICH, IrlsOptions
from pl_mc.kernels.linear_model import COORDINATES, LinearModel, add_empty, per_lane, product
from pl_mc.kernels.one_call import by_pieces
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.kernels.sandwich import sandwich
from pl_mc.kernels.small_matrix import eliminate
from pl_mc.kernels.standardised import standardised, weight_of, weights_of
from pl_mc.kernels.weights import HuberWeight, L1Weight

T = TypeVar("T")

# Aitken's acceleration: solutions from each extrapolation to the next one; the largest ratio of
# successive steps that it goes by; the farthest that it goes, and the smallest step that it follows, as lengths of the
# change of all fitted ranges in units of their sigma. Sooner, farther or more often it ends at other fixed points than
# plain iteration; smaller steps may be rounding.
AITKEN_PERIOD, AITKEN_RATIO, AITKEN_REACH, AITKEN_STEP = 3, 0.95, 0.25, 1e-6

# Lanes whose last step before the first extrapolation is shorter than this, in the same measure, have settled and stay;
# the others go on together, a quarter of the lanes at a time, as many quarters as they need.
SETTLED_STEP, QUARTERS = 1e-3, 4

# Squares of residuals are added in so many parts, one row on another, before a matrix product sums what is left: the
# product of all rows would have to wait until all squares are written.
FOLD = 4


def irls(model: LinearModel, start: LeastSquaresSolution, options: IrlsOptions) -> Estimate:
    """The reweighted estimate that starts from least squares.

    A scenario is undetermined as soon as one of its solutions is: fewer than t + 1 satellites with w > 0, or a
    pivot below 1e-10 of that of the fault-free N.
    """
    first, first_weights = first_iterate(model, start), jnp.ones_like(start.residuals)
    if options.start == "huber":
        first, first_weights = _huber_start(model, start, first, first_weights, options)
    return reweighted(model, start, first, first_weights, options)


def first_iterate(model: LinearModel, start: LeastSquaresSolution) -> Iterate:
    """Least squares as an iterate."""
    return Iterate(
        residuals=start.residuals,
        shift=tuple(jnp.zeros_like(start.state)),
        square_sum=start.square_sum,
        determined=jnp.broadcast_to(model.available, start.square_sum.shape),
    )


def reweighted(
    model: LinearModel,
    start: LeastSquaresSolution,
    first: Iterate,
    first_weights: Array,
    options: IrlsOptions,
    *,
    scale: Array | None = None,
) -> Estimate:
    """The reweighted estimate that starts from any solution.

    Args:
        model, start: the geometry, and least squares.
        first: the solution whose residuals give the first weights.
        first_weights: (n, ...), the weights that produced it.
        options: the choices; ``start`` is not among them.
        scale: (...), a scale of the standardised residuals that stays, instead of ``options.scale``.
    """
    shape, same = start.square_sum.shape, options.cofactor != "fault_free"
    plain_model = model
    model = replace(model, design=model.twins.design_same if same else model.twins.design)

    # The last solution stands outside the loop, since it alone is asked for its cofactors.
    plain = AITKEN_START - 1 if options.accelerated else options.solutions - 1
    lanes = _plain(model, start, first, first_weights, options, plain, scale=scale)
    before, weights = _settled(model, lanes, options) if options.accelerated else (lanes.iterate, lanes.weights)
    weights = weights_of(model, before, weights, options, scale)
    last, cofactor = solve_weighted(
        model, start, weights, before.determined, cofactors=True, relative=_relative(options)
    )  # fmt: skip

    kept = _kept(model, weights)
    if options.redundancy == "all":
        dof = jnp.broadcast_to(model.dof, shape)
    elif options.redundancy == "kept":
        dof = kept - model.unknowns
    else:
        dof = jnp.sum(weights * per_lane(model.in_view, weights), axis=0) - model.unknowns
    available = last.determined & (dof > 0)
    dof = jnp.where(available, dof, 1.0)
    unit_error, cofactor_m2 = safe_sqrt(last.square_sum / dof), jnp.stack(cofactor)
    if options.covariance == SANDWICH:
        size = standardised(model, last, weights, options, scale)
        # What twins have in common changes their residuals; influence goes by the design as it is.
        unit_error, cofactor_m2, regular = sandwich(plain_model, last.residuals, size, partial(weight_of, options), dof)
        available = available & regular
    sigma = 1.0 / jnp.where(model.weight_root > 0, model.weight_root, 1.0)
    shift = jnp.stack(last.shift)
    change = jnp.abs(shift[:COORDINATES] - jnp.stack(before.shift[:COORDINATES]))
    return Estimate(
        state=jnp.where(available, start.state + shift, jnp.inf),
        residuals_m=-last.residuals * per_lane(sigma * model.in_view, weights),
        weights=weights,
        unit_error=jnp.where(available, unit_error, jnp.inf),
        cofactor_m2=jnp.where(available, cofactor_m2, jnp.inf),
        kept=kept,
        change_m=jnp.where(available, jnp.max(change, axis=0), jnp.inf),
        available=available,
        tied=available & model.twins.tied(weights, same=same),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Lanes:
    """Scenarios in the middle of their iteration, along the last axis of everything.

    Attributes:
        start: least squares; scale: a scale that stays, or None.
        iterate: the last solution; weights: (n, ...), those that produced it; step: t of (...), its change of the
            state [m].
    """

    start: LeastSquaresSolution
    scale: Array | None
    iterate: Iterate
    weights: Array
    step: tuple[Array, ...]

    @property
    def moving(self) -> Moving:
        """What changes from solution to solution."""
        return self.iterate, self.weights, self.step

    def at(self, moving: Moving) -> _Lanes:
        """The same scenarios at another solution."""
        return _Lanes(self.start, self.scale, *moving)


# Iterate, weights and step of `_Lanes`.
Moving = tuple[Iterate, Array, tuple[Array, ...]]


def _relative(options: IrlsOptions) -> bool:
    return isinstance(options.weight, L1Weight)


def _plain(
    model: LinearModel, start: LeastSquaresSolution, first: Iterate, weights: Array, options: IrlsOptions, count: int,
    *, scale: Array | None = None,
) -> _Lanes:  # fmt: skip
    """So many solutions, one after the other."""
    lanes = _Lanes(start, scale, first, weights, tuple(jnp.zeros_like(one) for one in first.shift))

    def solve(moving: Moving, fixed: tuple[LeastSquaresSolution, Array | None]) -> Moving:
        few = replace(lanes, start=fixed[0], scale=fixed[1]).at(moving)
        return jax.lax.scan(
            lambda moving, _: (_step(model, few.at(moving), options).moving, None), moving, length=count
        )[0]

    return lanes.at(by_pieces(solve, lanes.moving, (start, scale), model.loop_lanes))


def _step(model: LinearModel, lanes: _Lanes, options: IrlsOptions) -> _Lanes:
    """One more solution."""
    before = lanes.iterate
    weights = weights_of(model, before, lanes.weights, options, lanes.scale)
    iterate, _ = solve_weighted(model, lanes.start, weights, before.determined, relative=_relative(options))
    step = tuple(now - was for now, was in zip(iterate.shift, before.shift, strict=True))
    return replace(lanes, iterate=iterate, weights=weights, step=step)


def _settled(model: LinearModel, lanes: _Lanes, options: IrlsOptions) -> tuple[Iterate, Array]:
    """The last solution but one, and the weights that produced it, from solution `AITKEN_START` - 1."""
    moves = _square_fit(model, lanes.step) > SETTLED_STEP**2

    def together(new: tuple[Iterate, Array]) -> tuple[Iterate, Array]:
        old = lanes.iterate, lanes.weights
        return jax.tree.map(lambda one, other: jnp.where(moves, one, other), new, old)

    if moves.ndim != 1 or moves.size % QUARTERS:
        return together(_accelerated(model, lanes, options))

    # The k-th of those that move is where so many have been counted; their results are fetched from where they are
    # computed, since writing to chosen lanes goes one lane at a time.
    number = jnp.arange(moves.size, dtype=jnp.int32)
    count = jnp.cumsum(moves, dtype=jnp.int32)
    order = jnp.minimum(jnp.searchsorted(count, number, side="right", method="scan_unrolled"), moves.size - 1)
    place = jnp.maximum(count - 1, 0)

    def quarter(_: None, given: tuple[Array, Array]) -> tuple[None, tuple[Iterate, Array]]:
        chosen, wanted = given

        def further() -> tuple[Iterate, Array]:
            return _accelerated(model, _fetched(lanes, chosen), options)

        def nothing() -> tuple[Iterate, Array]:
            return jax.tree.map(
                lambda one: jnp.zeros((*one.shape[:-1], chosen.size), one.dtype), (lanes.iterate, lanes.weights)
            )

        return None, jax.lax.cond(wanted, further, nothing)

    few = number.reshape(QUARTERS, -1)[:, 0] < count[-1]
    ahead = jax.lax.scan(quarter, None, (order.reshape(QUARTERS, -1), few))[1]

    def fetched(place: Array) -> tuple[Iterate, Array]:
        return together(
            _fetched(jax.tree.map(lambda one: jnp.moveaxis(one, 0, -2).reshape(*one.shape[1:-1], -1), ahead), place)
        )

    return jax.lax.cond(count[-1] > 0, fetched, lambda _: (lanes.iterate, lanes.weights), place)


def _fetched(tree: T, chosen: Array) -> T:
    """Chosen lanes of everything; all of them exist."""
    return jax.tree.map(lambda one: one.at[..., chosen].get(mode="promise_in_bounds"), tree)


def _accelerated(model: LinearModel, lanes: _Lanes, options: IrlsOptions) -> tuple[Iterate, Array]:
    """The last solution but one, and its weights, from solution `AITKEN_START` - 1."""

    def solve(moving: Moving, number: Array) -> tuple[Moving, None]:
        now = _step(model, lanes.at(moving), options)
        due = (number - AITKEN_START) % AITKEN_PERIOD == 0
        was = moving[2]
        iterate = jax.lax.cond(due, lambda: _extrapolated(model, now, was), lambda: now.iterate)
        return (iterate, now.weights, now.step), None

    numbers = jnp.arange(AITKEN_START, options.solutions, dtype=jnp.int32)
    return jax.lax.scan(solve, lanes.moving, numbers)[0][:2]


def _square_fit(model: LinearModel, step: tuple[Array, ...]) -> Array:
    """(...), the square of the length of the change of all fitted ranges by a step, in units of their sigma."""
    fit = product(model.design, jnp.stack(step))
    return product(model.mask_row, fit * fit)[0]


def _extrapolated(model: LinearModel, lanes: _Lanes, step_before: tuple[Array, ...]) -> Iterate:
    """The last solution, moved on along its step."""
    fit, fit_before = (product(model.design, jnp.stack(one)) for one in (lanes.step, step_before))
    along, square, square_before = (
        product(model.mask_row, one)[0] for one in (fit * fit_before, fit * fit, fit_before * fit_before)
    )
    ratio = jnp.clip(along / jnp.where(square_before > 0, square_before, 1.0), 0.0, AITKEN_RATIO)
    moves = square > AITKEN_STEP**2
    reach = AITKEN_REACH * jax.lax.rsqrt(jnp.where(moves, square, 1.0))
    # From no move at the smallest step to a whole one at twice that, without a jump, for the sake of gradients.
    whole = jnp.clip(safe_sqrt(square) * (1.0 / AITKEN_STEP) - 1.0, 0.0, 1.0)
    factor = jnp.where(moves, whole * jnp.minimum(ratio / (1.0 - ratio), reach), 0.0)
    shift = tuple(one + factor * step for one, step in zip(lanes.iterate.shift, lanes.step, strict=True))
    residuals = _residuals(model, lanes.start, shift)
    square_sum = _weighted_squares(lanes.weights, residuals)
    return replace(lanes.iterate, residuals=residuals, shift=shift, square_sum=square_sum)


def _huber_start(
    model: LinearModel, start: LeastSquaresSolution, first: Iterate, weights: Array, options: IrlsOptions
) -> tuple[Iterate, Array]:
    """The last of the solutions with Huber's weights, and those weights."""
    lanes = _plain(model, start, first, weights, replace(options, weight=HuberWeight()), HUBER_START)
    return lanes.iterate, lanes.weights


def _kept(model: LinearModel, weights: Array) -> Array:
    return jnp.sum(jnp.where(weights > 0, per_lane(model.in_view, weights), 0.0), axis=0)


def solve_weighted(
    model: LinearModel,
    start: LeastSquaresSolution,
    weights: Array,
    determined: Array,
    *,
    cofactors: bool = False,
    relative: bool = False,
) -> tuple[Iterate, tuple[Array, ...]]:
    """One weighted solution about the least-squares one (Zhao et al. 2021, eq 6), and its cofactors if wanted.

    ``relative`` weights count by their ratios alone: a common factor, however small, leaves no pivot too small.
    """
    sums = product(model.products_apart if model.one_clock_per_row else model.products, weights)
    right = product(model.design_rows, weights * start.residuals)
    # The last row, the sum of the weights, stays: cutting it off would copy all others.
    normal = sums
    if relative:
        largest = jnp.max(weights * per_lane(model.in_view, weights), axis=0)
        factor = 1.0 / jnp.where(largest > 0, largest, 1.0)
        normal, right = normal * factor, right * factor
    if model.one_clock_per_row:
        shift, diagonal, regular = eliminate_clocks(
            normal, right, model.apart_floor, model.empty, model.available, cofactors=cofactors
        )
    else:
        sides = right[:, None]
        if cofactors:
            unit = jnp.eye(right.shape[0], COORDINATES, dtype=right.dtype)
            unit = unit.reshape(unit.shape + (1,) * (right.ndim - 1))
            sides = jnp.concatenate([sides, jnp.broadcast_to(unit, unit.shape[:2] + right.shape[1:])], axis=1)
        solved, regular = eliminate(add_empty(normal[:-1], model.empty), sides, model.pivot_floor, model.available)
        shift = tuple(solved[:, 0])
        diagonal = tuple(solved[k, 1 + k] for k in range(COORDINATES) if cofactors)
    if relative:
        diagonal = tuple(one * factor for one in diagonal)
    residuals = _residuals(model, start, shift)
    iterate = Iterate(
        residuals=residuals,
        shift=shift,
        square_sum=_weighted_squares(weights, residuals),
        determined=determined & regular & _enough(model, weights, sums[-1]),
    )
    return iterate, diagonal


def _residuals(model: LinearModel, start: LeastSquaresSolution, shift: tuple[Array, ...]) -> Array:
    residuals = start.residuals
    for k, one in enumerate(shift):
        residuals = residuals - per_lane(model.design[:, k], residuals) * one[None]
    return residuals


def _weighted_squares(weights: Array, residuals: Array) -> Array:
    """(...), the sum of w v^2 over the rows; padding has no residual."""
    squares = weights * residuals * residuals
    rows = -(-squares.shape[0] // FOLD)
    padding = rows * FOLD - squares.shape[0]
    if padding:
        squares = jnp.pad(squares, [(0, padding), *[(0, 0)] * (squares.ndim - 1)])
    folded = squares[:rows]
    for k in range(1, FOLD):
        folded = folded + squares[k * rows : (k + 1) * rows]
    return product(jnp.ones((1, rows), squares.dtype), folded)[0]


def _enough(model: LinearModel, weights: Array, weight_sum: Array) -> Array:
    """Whether at least t + 1 satellites have w > 0; they need counting only where all weights add up to less."""
    needed = model.unknowns + 1
    return jax.lax.cond(
        jnp.all(weight_sum >= needed), lambda: jnp.ones(weight_sum.shape, bool), lambda: _kept(model, weights) >= needed
    )
