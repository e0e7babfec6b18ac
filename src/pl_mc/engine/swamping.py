"""Which satellites a reweighted estimate throws out and which it keeps, counted under known faults.

Rates of alarms do not tell why an estimate fails. Swamping is when the error of one satellite spreads over the
residuals of others and good satellites are thrown out in its place; collapse is when so many are thrown out that
nothing is left to check the rest. Both show in the weights of the last solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array

from pl_mc.engine.calls import Chunk, run_calls
from pl_mc.engine.core import EpochBatch, block_noise, block_sizes, each_fault
from pl_mc.engine.noise import live_lanes
from pl_mc.engine.plan import make_plan
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.kernels import IrlsOptions, LeastSquaresSolution, LinearModel, irls, linear_model
from pl_mc.runtime.precision import dtype_of
from pl_mc.runtime.threads import cores
from pl_mc.statistics.intervals import clopper_pearson, rate_columns

# Satellites beyond the t + 1 that a solution needs, up to which it counts as one that little is left to check.
FEW = 1

WATCHED = {
    "undetermined": "no determined solution; the events below count determined ones alone",
    "good_out": "at least one satellite without a fault has the smallest weight (zero, or the floor)",
    "faulted_full": "at least one faulted satellite keeps its full weight",
    "swamped": "both: a good satellite is thrown out while a faulted one keeps its full weight",
    "separated": "all faulted satellites have the smallest weight, and no other satellite has",
    "few_left": f"at most t + {1 + FEW} satellites have a weight above zero",
}
# Events that mean nothing without a fault.
_OF_FAULTS = ("faulted_full", "swamped", "separated")


def watch_weights(
    g: Geometry, faults: Faults, options: Sequence[IrlsOptions], *, draws: int, seed: int, precision: str
) -> pd.DataFrame:
    """How often each event of `WATCHED` happens, in the first draws of the sweep with the same seed.

    Args:
        g, faults, draws, seed, precision: as for `pl_mc.sweep`.
        options: the estimates. Those that differ in ``redundancy`` alone have the same weights and are solved once.

    Returns:
        One row per epoch, fault and estimate: ``epoch, fault, estimate`` (the place in ``options``), ``draws``, and
        for every event ``<event>_count``, ``<event>_rate``, ``<event>_low`` and ``<event>_high`` (95 %
        Clopper-Pearson); those of faulted satellites are missing where there is no fault.
    """
    same_weights = [replace(estimate, redundancy="all") for estimate in options]
    distinct = tuple(dict.fromkeys(same_weights))
    plan = make_plan(g, faults, draws).block_by_block()

    def counted(chunk: Chunk, *noise: np.int32) -> Array:
        return _count_block(plan.batch(chunk, dtype_of(precision)), np.uint32(seed), *noise, distinct)

    total = np.zeros((*plan.fault_index.shape, len(distinct), len(WATCHED)), dtype=np.int64)
    for chunk, counts in run_calls(plan, counted, precision=precision, threads=cores()):
        total[chunk.first_epoch : chunk.stop_epoch] += counts[: chunk.size]
    place, slot = np.nonzero(plan.fault_index >= 0)
    fault = plan.fault_index[place, slot]
    parts = []
    for k, estimate in enumerate(same_weights):
        counts = total[place, slot, distinct.index(estimate)]
        columns: dict[str, object] = {
            "epoch": plan.geometry.epoch[plan.epochs[place]],
            "fault": np.array(faults.labels, dtype=object)[fault],
            "estimate": k,
            "draws": draws,
        }
        for event, count in zip(WATCHED, counts.T, strict=True):
            means = (faults.bias_m[fault] != 0).any(axis=1) if event in _OF_FAULTS else True
            rates = rate_columns(event, count / draws, *clopper_pearson(count, draws))
            values = {f"{event}_count": count} | rates
            columns |= {name: np.where(means, value, np.nan) for name, value in values.items()}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


@jax.jit
def _count_block(
    batch: EpochBatch, seed: Array, block: Array, full_blocks: Array, remainder: Array,
    options: tuple[IrlsOptions, ...],
) -> Array:  # fmt: skip
    """(e, f, estimates, events), counts of one block of noise (int32)."""

    def one_epoch(one: EpochBatch) -> Array:
        model = linear_model(one.design, one.sigma_m, one.in_view)
        noise = block_noise(model, one, seed, block)
        live = live_lanes(block, full_blocks, remainder)

        def count(start: LeastSquaresSolution, bias_m: Array) -> Array:
            seen = jnp.stack([_events(model, start, bias_m, estimate) for estimate in options])
            return jnp.sum(seen & live, axis=-1, dtype=jnp.int32)

        nothing = jnp.zeros((len(options), len(WATCHED)), jnp.int32)
        return each_fault(model, one, noise, count, sizes=block_sizes(one, seed, block), skipped=nothing)

    return jax.lax.map(one_epoch, batch)


def _events(model: LinearModel, start: LeastSquaresSolution, bias_m: Array, options: IrlsOptions) -> Array:
    """(events, lanes), which of `WATCHED` each scenario is."""
    estimate = irls(model, start, options)
    in_view, faulted = (model.in_view > 0)[:, None], (bias_m != 0)[:, None]
    out, full = estimate.weights <= options.weight_floor, estimate.weights >= 1
    good_out = jnp.any(out & in_view & ~faulted, axis=0)
    faulted_full = jnp.any(full & in_view & faulted, axis=0)
    all_faulted_out = jnp.all(out | ~in_view | ~faulted, axis=0)
    few = estimate.kept <= model.unknowns + (1 + FEW)
    of_solutions = jnp.stack([good_out, faulted_full, good_out & faulted_full, all_faulted_out & ~good_out, few])
    return jnp.concatenate([~estimate.available[None], of_solutions & estimate.available])
