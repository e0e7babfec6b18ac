"""Passes: time by a scan, scenarios along the last axis, ramps of all rates on the same errors.

A first scan makes the errors and runs what is recursive (sums of residuals, filters) without any fault; since all
of that is linear a ramp only adds its known response. A second scan goes through the monitored samples and asks
every method at every rate.

To compare methods of single epochs at one false-alarm rate each needs a statistic whose threshold can be moved.
Here it is a ratio that is 1 at the method's nominal alarm: its test statistic over the threshold
(`pl_mc.methods.capabilities`), of which exclusions and levels that depend on the geometry alone are no part; else,
where the level is a multiple of K, level / limit, so that another threshold is another multiplier.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.alert import VERTICAL
from pl_mc.constants import EAST, NORTH, UP
from pl_mc.engine.core import EpochBatch, prepare_epoch
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.events import sizes_and_levels
from pl_mc.kernels.linear_model import has_one_clock_per_row, product
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.kernels.scenarios import each_fault
from pl_mc.methods import Method
from pl_mc.methods.capabilities import levels_from_geometry, scales_with_k, statistic
from pl_mc.noise_models.gauss_markov import step
from pl_mc.time_ramps.sequential import Sample, SequentialPlan, SequentialTest
from pl_mc.time_ramps.signals import LANES, NoiseInTime, Rows, pass_key, step_numbers
from pl_mc.time_ramps.windows import WindowTests, largest_ratio

Test = Method | SequentialTest


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PassPlan:
    """What all passes over a series share.

    Attributes:
        models: of every epoch (leading axis T).
        prepared: what the snapshot methods make of them.
        sigma_m: (T, m) [m].
        ramp_m: (T, m), the ramp of 1 m/s [m].
        correlation, share: () of the slow part of the errors; code_correlation: () of the rest.
        limit_m: (), alert limit of the axis [m].
        sequential: what the sequential tests make of them.
    """

    models: LinearModel
    prepared: list[Any]
    sigma_m: Array
    ramp_m: Array
    correlation: Array
    share: Array
    code_correlation: Array
    limit_m: Array
    sequential: tuple[SequentialPlan, ...]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Watched:
    """What became of each pass, (methods, rates, lanes).

    Attributes:
        largest: largest ratio of statistic and nominal threshold.
        alarm: samples from the onset to the first alarm; -1 for none.
        hazard: samples from the onset to the first error beyond the limit; -1 for none.
        error_m: the error's size at the alarm [m]; zero without one.
    """

    largest: Array
    alarm: Array
    hazard: Array
    error_m: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Signals:
    """Fault-free passes, (T, ..., lanes).

    Attributes:
        noise: (T, m, lanes), errors in units of sigma, zero out of view.
        sums: for each sequential test (T, m, lanes), its vectors summed from the first sample on; of one that
            looks at the last alone (windows of no sample) these themselves.
        up_m: for each (T, lanes), its own vertical error [m].
    """

    noise: Array
    sums: tuple[Array, ...]
    up_m: tuple[Array, ...]


def pass_plan(
    tests: tuple[Test, ...], rows: Rows, noise: NoiseInTime, ramp_m: np.ndarray, onset: int, limit_m: float
) -> PassPlan:
    """Everything that the geometry and the correlation of the errors decide; in double precision."""
    methods = snapshot_methods(tests)
    batch = EpochBatch(
        design=jnp.asarray(rows.design),
        sigma_m=jnp.asarray(rows.sigma_m),
        in_view=jnp.asarray(rows.in_view),
        bias_m=jnp.asarray(np.zeros((len(rows.design), 1, len(rows.names)))),
        applies=jnp.asarray(np.ones((len(rows.design), 1), bool)),
        epoch=jnp.asarray(np.arange(len(rows.design), dtype=np.uint32)),
        one_clock_per_row=has_one_clock_per_row(rows.design),
        satellite=None if rows.codes is None else jnp.asarray(np.broadcast_to(rows.codes, rows.sigma_m.shape)),
    )
    models, prepared = _prepare_all(batch, as_trees(methods))
    return PassPlan(
        models=models,
        prepared=prepared,
        sigma_m=batch.sigma_m,
        ramp_m=jnp.asarray(ramp_m),
        correlation=jnp.asarray(noise.correlation(rows.interval_s)),
        share=jnp.asarray(noise.share),
        code_correlation=jnp.asarray(noise.code_correlation(rows.interval_s)),
        limit_m=jnp.asarray(limit_m),
        sequential=tuple(t.plan(rows, noise, ramp_m, onset) for t in tests if isinstance(t, SequentialTest)),
    )


def has_ratio(method: object) -> bool:
    """Whether a method has a ratio that errors move."""
    return statistic(method) is not None or (scales_with_k(method) is not None and not levels_from_geometry(method))


def alarm_ratio(
    method: Method, model: LinearModel, prepared: Any, start: LeastSquaresSolution, limit_m: Array, axis: str
) -> tuple[Array, Array]:
    """The statistic over its nominal threshold and the size of the error on the axis [m], each (lanes,).

    A test guards the position of least squares, a level the method's own. Where there is no solution the ratio is
    infinite and so is the error; where a test beside a level rejects the ratio alone, an alarm for any multiplier.
    """
    test = statistic(method)
    if test is not None:
        ratio, size_m = test(model, prepared, start), size_on(axis, start.state)
        available = model.available & jnp.isfinite(ratio)
    else:
        outcome = method.solve(model, prepared, start)
        ((size_m, level_m),) = sizes_and_levels(outcome, axis)
        ratio, available = level_m / limit_m, outcome.available
        ratio = jnp.where(outcome.rejects, jnp.inf, ratio)
    return jnp.where(available, ratio, jnp.inf), jnp.where(available, size_m, jnp.inf)


def size_on(axis: str, state: Array) -> Array:
    """(...), the size of the error (position unknowns, ...) on an axis [m]."""
    return jnp.abs(state[UP]) if axis == VERTICAL else jnp.hypot(state[EAST], state[NORTH])


def snapshot_methods(tests: tuple[Test, ...]) -> tuple[Method, ...]:
    """Those that look at single epochs."""
    return tuple(test for test in tests if not isinstance(test, SequentialTest))


@jax.jit
def _prepare_all(batch: EpochBatch, methods: Trees) -> tuple[LinearModel, list]:
    chosen = of_trees(methods)
    return jax.lax.map(lambda one: prepare_epoch(one, chosen), batch)


def fault_free_signals(plan: PassPlan, key: Array) -> Signals:
    """One block of passes without a fault; every test, rate and method sees these errors."""
    models = plan.models
    epochs, rows = models.in_view.shape
    motions = max((each.motions for each in plan.sequential), default=0)

    def at_epoch(carry: tuple, x: tuple) -> tuple[tuple, Signals]:
        code, slow, states = carry
        time, model, sigma_m, epoch = x
        white, fresh, motion = step_numbers(key, time, rows, motions)
        slow = jnp.where(time == 0, fresh, step(slow, fresh, plan.correlation))
        code = jnp.where(time == 0, white, step(code, white, plan.code_correlation))
        noise = jnp.sqrt(1.0 - plan.share) * code + jnp.sqrt(plan.share) * slow
        noise = noise * model.in_view[:, None]
        fitted = product(model.design, product(model.gain, noise))
        sample = Sample(time, noise, fitted, noise * sigma_m[:, None], motion, model.in_view)
        plans = zip(plan.sequential, epoch, states, strict=True)
        after = [each.advance(own, state, sample) for each, own, state in plans]
        sums, up = tuple(total for _, total, _ in after), tuple(up for *_, up in after)
        return (code, slow, tuple(state for state, *_ in after)), Signals(noise, sums, up)

    start = tuple(each.begin() for each in plan.sequential)
    own = tuple(each.epochs() for each in plan.sequential)
    xs = (jnp.arange(epochs, dtype=jnp.int32), models, plan.sigma_m, own)
    return jax.lax.scan(at_epoch, (*jnp.zeros((2, rows, LANES)), start), xs)[1]


@functools.partial(jax.jit, static_argnames=("onset", "axis"))
def watch_block(
    plan: PassPlan, seed: Array, purpose: Array, block: Array, rates: Array, thresholds: Array,
    trees: Trees, *, onset: int, axis: str = VERTICAL,
) -> Watched:  # fmt: skip
    """One block of passes with ramps that begin at the sample ``onset``.

    ``trees`` are the tests of `as_trees`, and ``plan`` is theirs and that of ``onset``; ``seed``, ``purpose`` and
    ``block`` choose the errors;
    ``rates``: (f,) [m/s]; ``thresholds``: (methods,), of the ratios.
    """
    tests: tuple[Test, ...] = of_trees(trees)
    signals = fault_free_signals(plan, pass_key(seed, purpose, block))
    methods = snapshot_methods(tests)
    epochs = plan.sigma_m.shape[0]

    def sums(values: Array, tests_: WindowTests, time: Array) -> list[Array]:
        now = jax.lax.dynamic_index_in_dim(values, time, keepdims=False)
        return [
            now - jax.lax.dynamic_index_in_dim(values, time - w, keepdims=False) if w else now for w in tests_.samples
        ]

    def at_epoch(watched: Watched, x: tuple) -> tuple[Watched, None]:
        time, model, prepared, ramp_m, noise, windows, ups, up_ramps = x
        epoch = EpochBatch(
            design=model.design,
            sigma_m=model.weight_root,
            in_view=model.in_view,
            bias_m=rates[:, None] * ramp_m[None],
            applies=jnp.ones(rates.shape, bool),
            epoch=time,
        )

        def ask(start: LeastSquaresSolution, _: Array) -> tuple[list[tuple[Array, Array]], Array]:
            asked = [
                alarm_ratio(method, model, made, start, plan.limit_m, axis)
                for method, made in zip(methods, prepared, strict=True)
            ]
            return asked, size_on(axis, start.state)

        asked, ls_size_m = each_fault(model, epoch, noise, ask)
        sequential = []
        parts = zip(plan.sequential, windows, signals.sums, ups, up_ramps, strict=True)
        for each, own, total, up, up_ramp in parts:
            size_m = jnp.abs(up[None] + rates[:, None] * up_ramp) if each.own_position else ls_size_m
            sequential.append((largest_ratio(own, sums(total, own, time), rates), size_m))
        single, others = iter(asked), iter(sequential)
        pairs = [next(others if isinstance(test, SequentialTest) else single) for test in tests]
        stacked = jnp.stack([ratio for ratio, _ in pairs]), jnp.stack([size_m for _, size_m in pairs])
        return watch_sample(watched, time - onset, *stacked, thresholds, plan.limit_m), None

    shape = (len(tests), rates.shape[0], LANES)
    never = jnp.full(shape, -1, jnp.int32)
    first = Watched(jnp.zeros(shape), never, never, jnp.zeros(shape))
    tail = slice(onset, epochs)
    xs = (
        jnp.arange(onset, epochs, dtype=jnp.int32),
        *jax.tree.map(lambda part: part[tail], (plan.models, plan.prepared, plan.ramp_m, signals.noise)),
        tuple(each.tests for each in plan.sequential),
        *jax.tree.map(lambda part: part[tail], (signals.up_m, tuple(each.up_m for each in plan.sequential))),
    )
    return jax.lax.scan(at_epoch, first, xs)[0]


def watch_sample(
    before: Watched, time: Array, ratios: Array, size_m: Array, thresholds: Array, limit_m: Array
) -> Watched:
    """What became of the passes with one more sample, ``time`` samples since the onset.

    ``ratios``, ``size_m``: (methods, rates, lanes), statistic over nominal threshold and size of the error [m].
    """
    # Where there is no solution there is an alarm and no error.
    hazard = jnp.isfinite(size_m) & (size_m > limit_m)
    # No threshold keeps a method quiet that has no solution.
    alarms = (ratios > thresholds[:, None, None]) | jnp.isinf(ratios)
    begins = alarms & (before.alarm < 0)
    return Watched(
        largest=jnp.maximum(before.largest, ratios),
        alarm=jnp.where(begins, time, before.alarm),
        hazard=jnp.where(hazard & (before.hazard < 0), time, before.hazard),
        error_m=jnp.where(begins, size_m, before.error_m),
    )
