"""The jitted heart of a sweep: geometry outside, noise blocks inside, faults innermost.

Everything that scenarios share is computed once: the model of a geometry for all its noise, the projections of a
noise block for all its faults. Least squares of noise plus fault is then a sum of two projections.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.engine.drawn_biases import DrawnBiases, bias_numbers
from pl_mc.engine.events import EVENTS, events
from pl_mc.engine.noise import epoch_key, live_lanes, unit_inputs
from pl_mc.kernels import LeastSquaresSolution, LinearModel, linear_model
from pl_mc.kernels.linear_model import product
from pl_mc.methods.base import Method, Outcome
from pl_mc.noise_models import GAUSSIAN, NoiseModel

Result = TypeVar("Result")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EpochBatch:
    """The epochs of one call, with the faults that apply at each.

    Attributes:
        design: (e, n, t) [m/m]; sigma_m: (e, n) [m]; in_view: (e, n).
        bias_m: (e, f, n), bias vectors [m].
        applies: (e, f), which of them are faults of this call; the others are skipped.
        epoch: (e,), epoch numbers, which choose the noise.
        drawn: biases that are drawn with the noise; None where none is.
        one_clock_per_row: whether every satellite has one clock at most, see `pl_mc.kernels.LinearModel`.
    """

    design: Array
    sigma_m: Array
    in_view: Array
    bias_m: Array
    applies: Array
    epoch: Array
    drawn: DrawnBiases | None = None
    one_clock_per_row: bool = field(default=False, metadata={"static": True})


def count_events(
    batch: EpochBatch,
    seed: Array,
    first_block: Array,
    full_blocks: Array,
    remainder: Array,
    limits_m: Array,
    *,
    methods: tuple[Method, ...],
    axes: tuple[str, ...],
    blocks: int,
    together: int = 1,
    noise_model: NoiseModel = GAUSSIAN,
) -> Array:
    """(e, f, rows, events), how often each event of `EVENTS` happened in ``blocks`` blocks of noise (int32).

    There is a row for each method and axis, method by method. ``limits_m`` (2,) are VAL and HAL.
    Blocks below ``full_blocks`` count whole, the block of that number counts its first ``remainder`` draws, later
    ones do not count. ``together`` blocks are taken at a time, side by side: few suit the caches of a processor,
    many fill an accelerator.
    """

    def count_epoch(one: EpochBatch) -> Array:
        model, prepared = prepare_epoch(one, methods)

        def add_blocks(total: Array, group: Array) -> tuple[Array, None]:
            live = side_by_side(jax.vmap(lambda block: live_lanes(block, full_blocks, remainder))(group))
            live = live.astype(model.design.dtype)

            def count(outcomes: list[Outcome]) -> Array:
                seen = jnp.stack([events(outcome, limits_m, axis) for outcome in outcomes for axis in axes])
                # The lanes of a call are fewer than the whole numbers of any precision; this is the fastest sum.
                return product(seen.astype(live.dtype), live).astype(jnp.int32)

            noise = side_by_side(jax.vmap(lambda block: block_noise(model, one, seed, block, noise_model))(group))
            sizes = jax.tree.map(side_by_side, jax.vmap(lambda block: block_sizes(one, seed, block))(group))
            nothing = jnp.zeros((len(methods) * len(axes), len(EVENTS)), jnp.int32)
            return total + each_outcome(model, prepared, methods, one, noise, count, sizes=sizes, skipped=nothing), None

        # Groups are filled up with a block that does not count.
        groups = -(-blocks // together)
        place = jnp.arange(groups * together, dtype=jnp.int32)
        numbers = jnp.where(place < blocks, first_block + place, full_blocks + 1).reshape(groups, together)
        none = jnp.zeros((one.bias_m.shape[0], len(methods) * len(axes), len(EVENTS)), jnp.int32)
        return jax.lax.scan(add_blocks, none, numbers)[0]

    return jax.lax.map(count_epoch, batch)


def side_by_side(blocks: Array) -> Array:
    """(..., k lanes) of (k, ..., lanes)."""
    return jnp.moveaxis(blocks, 0, -2).reshape(*blocks.shape[1:-1], -1)


def block_outcomes(
    batch: EpochBatch, seed: Array, block: Array, *, methods: tuple[Method, ...], noise_model: NoiseModel = GAUSSIAN
) -> list[Outcome]:
    """The outcomes themselves of one block of noise, per method, with leading axes (e, f)."""

    def one_epoch(one: EpochBatch) -> list[Outcome]:
        model, prepared = prepare_epoch(one, methods)
        noise = block_noise(model, one, seed, block, noise_model)
        sizes = block_sizes(one, seed, block)
        return each_outcome(model, prepared, methods, one, noise, lambda outcomes: outcomes, sizes=sizes)

    return jax.lax.map(one_epoch, batch)


def prepare_epoch(one: EpochBatch, methods: tuple[Method, ...]) -> tuple[LinearModel, list]:
    """The model of one epoch, and what each method makes of it before any noise."""
    model = linear_model(one.design, one.sigma_m, one.in_view, one_clock_per_row=one.one_clock_per_row)
    return model, [method.prepare(model) for method in methods]


def block_noise(
    model: LinearModel, one: EpochBatch, seed: Array, block: Array, noise_model: NoiseModel = GAUSSIAN
) -> Array:
    """(n, LANES), the noise of one block at one epoch, in units of each satellite's sigma."""
    rows, dtype = model.design.shape[0], model.design.dtype
    key = epoch_key(seed, one.epoch)
    return noise_model.shape(model, unit_inputs(key, block, noise_model.inputs_per_row, rows, dtype))


def block_sizes(one: EpochBatch, seed: Array, block: Array) -> Array | None:
    """(2, n, LANES), the numbers of one block at one epoch from which biases are drawn; None where none is."""
    return None if one.drawn is None else bias_numbers(seed, one.epoch, block, one.design.shape[0], one.design.dtype)


def each_fault(
    model: LinearModel,
    one: EpochBatch,
    noise: Array,
    reduce: Callable[[LeastSquaresSolution, Array], Result],
    *,
    sizes: Array | None = None,
    skipped: Result | None = None,
) -> Result:
    """``reduce`` of the least-squares start and the bias vector (n,) [m], NaN where drawn, for each fault of one epoch.

    Every fault is added to the same noise (n, lanes). Where a fault does not apply the result is ``skipped``, at no
    cost, unless that is None. ``sizes`` (2, n, lanes) are the numbers of drawn biases, where there are any.
    """
    noise = noise * model.in_view[:, None]
    noise_state = product(model.gain, noise)
    noise_residuals = noise - product(model.design, noise_state)
    noise_square_sum = jnp.sum(noise_residuals * noise_residuals, axis=0)

    bias = one.bias_m * model.weight_root[None]
    bias_state = product(bias, model.gain.T)
    bias_residuals = bias - product(bias_state, model.design.T)
    cross = product(bias_residuals, noise_residuals)
    noise_residuals, bias_residuals = model.twins.alike(noise_residuals), model.twins.alike(bias_residuals.T).T

    def one_fault(parts: tuple[Array, Array, Array, Array, Array, DrawnBiases | None]) -> Result:
        applies, bias_m, state, residuals, cross_sum, drawn = parts

        def solve() -> Result:
            square_sum = noise_square_sum + 2.0 * cross_sum + jnp.sum(residuals * residuals)
            start = LeastSquaresSolution(
                residuals=noise_residuals + residuals[:, None],
                state=noise_state + state[:, None],
                # A square sum, but for the rounding of its three parts.
                square_sum=jnp.maximum(square_sum, 0.0),
            )
            if drawn is None:
                return reduce(start, bias_m)
            assert sizes is not None, "biases are drawn from numbers"
            return reduce(shifted(start, drawn.lanes(sizes)), jnp.where(drawn.rows, jnp.nan, bias_m))

        def shifted(start: LeastSquaresSolution, drawn_m: Array) -> LeastSquaresSolution:
            bias = drawn_m * model.weight_root[:, None]
            state = product(model.gain, bias)
            residuals = start.residuals + model.twins.alike(bias - product(model.design, state))
            # As it was where nothing is drawn.
            square_sum = jnp.where(jnp.any(drawn_m != 0), jnp.sum(residuals * residuals, axis=0), start.square_sum)
            return LeastSquaresSolution(residuals=residuals, state=start.state + state, square_sum=square_sum)

        return solve() if skipped is None else jax.lax.cond(applies, solve, lambda: skipped)

    return jax.lax.map(one_fault, (one.applies, one.bias_m, bias_state, bias_residuals, cross, one.drawn))


def each_outcome(
    model: LinearModel,
    prepared: list,
    methods: tuple[Method, ...],
    one: EpochBatch,
    noise: Array,
    reduce: Callable[[list[Outcome]], Result],
    *,
    sizes: Array | None = None,
    skipped: Result | None = None,
) -> Result:
    """``reduce`` of the methods' outcomes for each fault; the rest as for `each_fault`."""

    def solve(start: LeastSquaresSolution, _: Array) -> Result:
        return reduce([m.solve(model, p, start) for m, p in zip(methods, prepared, strict=True)])

    return each_fault(model, one, noise, solve, sizes=sizes, skipped=skipped)
