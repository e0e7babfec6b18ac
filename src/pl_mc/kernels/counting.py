"""Counts of events as a pure function: noise blocks outside, faults innermost. It is the core of every sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from pl_mc.alert import AlertLimits, as_axes, as_limits
from pl_mc.input_errors import InputError, require_whole
from pl_mc.kernels.estimate import LeastSquaresSolution
from pl_mc.kernels.events import EVENTS, counted_events, events, exclusions, limits_of
from pl_mc.kernels.linear_model import LinearModel, product
from pl_mc.kernels.noise import LANES, live_lanes, unit_inputs
from pl_mc.kernels.one_call import in_one_call
from pl_mc.kernels.outcome import Method
from pl_mc.kernels.scenarios import Drawn, FaultRows, each_fault

# Draws that an int32 can count.
MOST_DRAWS = 2**31 - 1

# Stands for limits in an array, which are always two.
_BOTH = AlertLimits("limits", vertical_m=1.0, horizontal_m=1.0)

# The noise (n, LANES) of a block, in units of each satellite's sigma, and the numbers (2, n, LANES) of drawn biases.
BlockNumbers = Callable[[Array], tuple[Array, Array | None]]


class ShapesNoise(Protocol):
    """What `count_events` asks of a noise model (`pl_mc.noise_models`)."""

    @property
    def inputs_per_row(self) -> int: ...

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array: ...


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Biases:
    """Bias vectors (f, n) [m] that all count."""

    bias_m: Array
    applies: Array
    drawn: Drawn | None = None


def count_events(
    key: Array,
    model: LinearModel,
    bias_m: ArrayLike,
    methods: Sequence[Method],
    limits: str | AlertLimits | ArrayLike,
    draws: int,
    *,
    axes: str | Sequence[str] | None = None,
    noise_model: ShapesNoise | None = None,
    together: int = 1,
) -> Array:
    """(f, rows, events), how often each event of `pl_mc.kernels.events.EVENTS` happened in ``draws`` draws (int32).

    Where a method names what it excludes `pl_mc.kernels.events.EXCLUSIONS` follow; rows with a bias have a fault.

    Arrays and pytrees in, an array out: it goes through `jax.jit`, `jax.vmap` (over models, biases, limits, numbers of
    methods) and `jax.shard_map`. With the key ``epoch_key(seed, epoch)`` the counts are those of `pl_mc.sweep`.

    Args:
        key: of `jax.random`; chooses the noise, the same for all faults and methods.
        model: one geometry, of `pl_mc.kernels.linear_model`.
        bias_m: (f, n) or (n,), bias vectors [m]; zeros where there is no fault.
        methods: records, whose numbers may be traced. There is a row for each of them and axis, method by method.
        limits: VAL and HAL [m], (2,), or a record or the name of an operation.
        draws: a whole number, known when it is compiled.
        axes: which limits decide: ``vertical``, ``horizontal``, ``either``; unless given the vertical one, where
            there is one.
        noise_model: one of `pl_mc.noise_models`; Gaussian errors of the model's sigma unless given.
        together: blocks of 256 draws side by side; few suit the caches of a processor, many fill an accelerator.

    Raises:
        InputError: shapes that do not fit, no method, an unknown axis, or one without a limit.
    """
    rows, dtype = model.design.shape[0], model.design.dtype
    number = require_whole(draws, field="draws", low=1, high=MOST_DRAWS)
    together = require_whole(together, field="together", low=1)
    bias = jnp.atleast_2d(jnp.asarray(bias_m, dtype))
    chosen = tuple(methods) if isinstance(methods, Sequence) and not isinstance(methods, str) else ()
    if not chosen or not all(isinstance(one, Method) for one in chosen):
        raise InputError("methods: a sequence of records such as pl_mc.methods.Ls() is needed; names have no numbers.")
    if bias.ndim != 2 or bias.shape[1] != rows:
        raise InputError(f"bias_m: (f, {rows}) is needed for a model of {rows} rows, not {bias.shape}.")
    alert = as_limits(limits) if isinstance(limits, str | AlertLimits) else None
    judged = as_axes(axes, alert or _BOTH)
    limits_m = jnp.asarray(limits if alert is None else limits_of(alert, dtype), dtype)
    if limits_m.shape != (2,):
        raise InputError(f"limits: VAL and HAL are needed, an array (2,), not {limits_m.shape}.")

    def numbers(block: Array) -> tuple[Array, None]:
        units = unit_inputs(key, block, 1 if noise_model is None else noise_model.inputs_per_row, rows, dtype)
        return units[0] if noise_model is None else noise_model.shape(model, units), None

    # Every fault applies.
    faults = Biases(bias, jnp.ones(bias.shape[0], bool))
    full, remainder = divmod(number, LANES)
    return count_blocks(
        model, chosen, [method.prepare(model) for method in chosen], faults, numbers, limits_m, jnp.int32(0),
        jnp.int32(full), jnp.int32(remainder), axes=judged, blocks=full + (remainder > 0), together=together,
    )  # fmt: skip


def count_blocks(
    model: LinearModel,
    methods: tuple[Method, ...],
    prepared: list,
    faults: FaultRows,
    numbers: BlockNumbers,
    limits_m: Array,
    first_block: Array,
    full_blocks: Array,
    remainder: Array,
    *,
    axes: tuple[str, ...],
    blocks: int,
    together: int = 1,
) -> Array:
    """(f, rows, events), how often each of `counted_events` happened in ``blocks`` blocks of noise (int32).

    Blocks below ``full_blocks`` count whole, the block of that number counts its first ``remainder`` draws, later
    ones do not count. ``together`` blocks are taken at a time, side by side. Each method is one function of machine
    code, where one can hold it, if ``model.loop_lanes`` are given.
    """
    counted = counted_events(methods)
    none = jnp.zeros((faults.bias_m.shape[0], len(methods) * len(axes), len(counted)), jnp.int32)

    def add_blocks(total: Array, group: Array) -> tuple[Array, None]:
        live = side_by_side(jax.vmap(lambda block: live_lanes(block, full_blocks, remainder))(group))
        live = live.astype(model.design.dtype)

        def count(start: LeastSquaresSolution, bias_m: Array) -> Array:
            def of_method(method: Method, made: object) -> Array:
                def of_model(model: LinearModel, start: LeastSquaresSolution) -> Array:
                    outcome = method.solve(model, made, start)
                    seen = jnp.stack([events(outcome, limits_m, axis, method.name) for axis in axes])
                    if len(counted) > len(EVENTS):
                        # Where a bias is drawn it is NaN, and a fault.
                        named = exclusions(outcome, bias_m != 0)
                        seen = jnp.concatenate([seen, jnp.broadcast_to(named, (len(axes), *named.shape))], axis=1)
                    # The lanes of a call are fewer than the whole numbers of any precision; this is the fastest sum.
                    return product(seen.astype(live.dtype), live).astype(jnp.int32)

                found = None if model.loop_lanes is None else in_one_call(partial(of_model, model), start)
                # Where operations are called one by one, loops over few lanes would only make more calls.
                return of_model(replace(model, loop_lanes=None), start) if found is None else found

            return jnp.concatenate([of_method(*one) for one in zip(methods, prepared, strict=True)])

        noise, sizes = jax.tree.map(side_by_side, jax.vmap(numbers)(group))
        return total + each_fault(model, faults, noise, count, sizes=sizes, skipped=none[0]), None

    # Groups are filled up with a block that does not count.
    groups = -(-blocks // together)
    place = jnp.arange(groups * together, dtype=jnp.int32)
    of_groups = jnp.where(place < blocks, first_block + place, full_blocks + 1).reshape(groups, together)
    return jax.lax.scan(add_blocks, none, of_groups)[0]


def side_by_side(blocks: Array) -> Array:
    """(..., k lanes) of (k, ..., lanes)."""
    return jnp.moveaxis(blocks, 0, -2).reshape(*blocks.shape[1:-1], -1)
