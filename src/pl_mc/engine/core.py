"""The jitted heart of a sweep: geometry outside, noise blocks inside, faults innermost.

Everything that scenarios share is computed once: the model of a geometry for all its noise, the projections of a
noise block for all its faults. Least squares of noise plus fault is then a sum of two projections.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import jax
import numpy as np
from jax import Array

from pl_mc.engine.drawn_biases import DrawnBiases, bias_numbers
from pl_mc.kernels import LinearModel, linear_model
from pl_mc.kernels.counting import count_blocks
from pl_mc.kernels.noise import epoch_key, unit_inputs
from pl_mc.kernels.parameters import Trees, of_trees
from pl_mc.kernels.scenarios import each_outcome
from pl_mc.methods.base import Method, Outcome
from pl_mc.noise_models import GAUSSIAN, NoiseModel


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
        satellite: (e, n), codes of the satellites, `pl_mc.ism.satellite_codes`.
    """

    design: Array
    sigma_m: Array
    in_view: Array
    bias_m: Array
    applies: Array
    epoch: Array
    drawn: DrawnBiases | None = None
    one_clock_per_row: bool = field(default=False, metadata={"static": True})
    satellite: Array | None = None


def count_epochs(
    batch: EpochBatch,
    seed: Array,
    first_block: Array,
    full_blocks: Array,
    remainder: Array,
    limits_m: Array,
    methods: Trees,
    *,
    axes: tuple[str, ...],
    blocks: int,
    together: int = 1,
    loop_lanes: int | None = None,
    noise_model: NoiseModel = GAUSSIAN,
) -> Array:
    """(e, f, rows, events), how often each event of `EVENTS` happened in ``blocks`` blocks of noise (int32).

    There is a row for each method and axis, method by method. ``limits_m`` (2,) are VAL and HAL; ``methods`` are those
    of `as_trees`, so that their numbers are arguments like any array.
    Blocks and ``together`` are as for `pl_mc.kernels.counting.count_blocks`, ``loop_lanes`` as for `LinearModel`.
    """
    chosen = of_trees(methods)

    def count_epoch(one: EpochBatch) -> Array:
        model, prepared = prepare_epoch(one, chosen)
        model = replace(model, loop_lanes=loop_lanes)

        def numbers(block: Array) -> tuple[Array, Array | None]:
            return block_noise(model, one, seed, block, noise_model), block_sizes(one, seed, block)

        return count_blocks(
            model, chosen, prepared, one, numbers, limits_m, first_block, full_blocks, remainder, axes=axes,
            blocks=blocks, together=together,
        )  # fmt: skip

    return jax.lax.map(count_epoch, batch)


def block_outcomes(
    batch: EpochBatch, seed: Array, block: Array, methods: Trees, *, noise_model: NoiseModel = GAUSSIAN
) -> list[Outcome]:
    """The outcomes themselves of one block of noise, per method, with leading axes (e, f)."""
    chosen = of_trees(methods)

    def one_epoch(one: EpochBatch) -> list[Outcome]:
        model, prepared = prepare_epoch(one, chosen)
        noise = block_noise(model, one, seed, block, noise_model)
        sizes = block_sizes(one, seed, block)
        return each_outcome(model, prepared, chosen, one, noise, lambda outcomes: outcomes, sizes=sizes)

    return jax.lax.map(one_epoch, batch)


def prepare_epoch(one: EpochBatch, methods: tuple[Method, ...]) -> tuple[LinearModel, list]:
    """The model of one epoch, and what each method makes of it before any noise."""
    model = linear_model(
        one.design, one.sigma_m, one.in_view, one_clock_per_row=one.one_clock_per_row, satellite=one.satellite
    )
    return model, [method.prepare(model) for method in methods]


def block_noise(
    model: LinearModel, one: EpochBatch, seed: Array, block: Array, noise_model: NoiseModel = GAUSSIAN
) -> Array:
    """(n, LANES), the noise of one block at one epoch, in units of each satellite's sigma."""
    rows, dtype = model.design.shape[0], model.design.dtype
    # Epochs that a model draws together share their numbers.
    together = np.uint32(getattr(noise_model, "epochs_together", 1))
    key = epoch_key(seed, one.epoch if together == 1 else one.epoch // together)
    return noise_model.shape(model, unit_inputs(key, block, noise_model.inputs_per_row, rows, dtype))


def block_sizes(one: EpochBatch, seed: Array, block: Array) -> Array | None:
    """(2, n, LANES), the numbers of one block at one epoch from which biases are drawn; None where none is."""
    return None if one.drawn is None else bias_numbers(seed, one.epoch, block, one.design.shape[0], one.design.dtype)
