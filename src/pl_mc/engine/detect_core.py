"""Tests side by side, jitted: statistics of fault-free noise, counts under faults, verdicts on given errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.detectors import DETECTORS, Detector, Verdict, View
from pl_mc.detectors.base import nothing_redundant, suspected
from pl_mc.engine.core import EpochBatch, block_noise, block_sizes
from pl_mc.kernels import LeastSquaresSolution, LinearModel, linear_model, start_from
from pl_mc.kernels.noise import LANES, live_lanes
from pl_mc.kernels.scenarios import each_fault
from pl_mc.methods import METHODS, Method
from pl_mc.methods.capabilities import refusal, statistic
from pl_mc.named import as_records

Tests = tuple[Detector, ...]


@dataclass(frozen=True)
class MethodTest:
    """The test of a method that has a statistic (`pl_mc.methods.capabilities.Statistic`), as a detector.

    The statistic is the ratio, so that the nominal threshold is 1, whatever false-alarm probability is asked for.
    Where the method has no solution the ratio is infinite. The suspect is that of the chi-square test.
    """

    method: Method

    label = "own threshold"

    @property
    def test(self) -> str:
        return self.method.name

    name = test

    def reason_against(self, view: View) -> str | None:
        return nothing_redundant(view)

    def prepare(self, model: LinearModel, system: Array, p_fa: float) -> Any:
        return self.method.prepare(model)

    def examine(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Verdict:
        own = statistic(self.method)
        assert own is not None
        ratio = own(model, prepared, start)
        one = jnp.ones((), ratio.dtype)
        return Verdict(ratio, one, ratio > one, *suspected(model, start))


def as_tests(tests: Sequence[str | Detector | Method]) -> tuple[Detector, ...]:
    """Names and records of detectors and of methods with a statistic, made detectors.

    Raises:
        InputError: none, strangers, two of one name, a method without a statistic.
    """
    made = as_records(tests, DETECTORS | METHODS, Detector | Method, what="test")
    for test in made:
        if not isinstance(test, Detector) and statistic(test) is None:
            raise refusal(test, "statistic", able=statistic, field="tests", also=DETECTORS)
    return tuple(test if isinstance(test, Detector) else MethodTest(test) for test in made)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TestBatch:
    """The epochs of one call.

    ``system``: (e, n), place of each row's system in `pl_mc.detectors.base.SYSTEM_LETTERS`; -1 on padding.
    """

    __test__ = False

    epochs: EpochBatch
    system: Array


def fault_free_statistics(
    batch: TestBatch, seed: Array, first_block: Array, *, tests: Tests, p_fa: float, blocks: int
) -> tuple[Array, Array]:
    """(e, tests, blocks LANES), the statistics of noise alone; and (e, tests), the nominal thresholds."""

    def one_epoch(one: TestBatch) -> tuple[Array, Array]:
        model, prepared = _prepare(one, tests, p_fa)

        def one_block(block: Array) -> tuple[Array, Array]:
            noise = block_noise(model, one.epochs, seed, block)
            start = _start(model, noise)
            verdicts = [test.examine(model, p, start) for test, p in zip(tests, prepared, strict=True)]
            return jnp.stack([v.statistic for v in verdicts]), jnp.stack([v.threshold for v in verdicts])

        found, thresholds = jax.lax.map(one_block, first_block + jnp.arange(blocks, dtype=jnp.int32))
        return jnp.moveaxis(found, 0, 1).reshape(len(tests), blocks * LANES), thresholds[0]

    return jax.lax.map(one_epoch, batch)


def count_detections(
    batch: TestBatch, seed: Array, first_block: Array, full_blocks: Array, remainder: Array, thresholds: Array, *,
    tests: Tests, p_fa: float, blocks: int,
) -> Array:  # fmt: skip
    """(e, f, tests, levels, 2), how often each test was above each threshold, and suspected a faulted satellite.

    Blocks count as for `pl_mc.kernels.counting.count_blocks`; ``thresholds``: (e, tests, levels).
    """
    levels = thresholds.shape[-1]

    def one_epoch(parts: tuple[TestBatch, Array]) -> Array:
        one, limits = parts
        model, prepared = _prepare(one, tests, p_fa)

        def add_block(total: Array, block: Array) -> tuple[Array, None]:
            live = live_lanes(block, full_blocks, remainder)

            def count(start: LeastSquaresSolution, bias_m: Array) -> Array:
                counts = []
                for k, (test, p) in enumerate(zip(tests, prepared, strict=True)):
                    verdict = test.examine(model, p, start)
                    above = (verdict.statistic > limits[k, :, None]) & live
                    right = above & (bias_m != 0)[verdict.satellite]
                    counts.append(jnp.stack([above, right], axis=1).sum(axis=-1, dtype=jnp.int32))
                return jnp.stack(counts)

            noise = block_noise(model, one.epochs, seed, block)
            nothing = jnp.zeros((len(tests), levels, 2), jnp.int32)
            return total + each_fault(
                model, one.epochs, noise, count, sizes=block_sizes(one.epochs, seed, block), skipped=nothing
            ), None

        none = jnp.zeros((one.epochs.bias_m.shape[0], len(tests), levels, 2), jnp.int32)
        return jax.lax.scan(add_block, none, first_block + jnp.arange(blocks, dtype=jnp.int32))[0]

    return jax.lax.map(one_epoch, (batch, thresholds))


def examine_errors(batch: TestBatch, errors_m: Array, *, tests: Tests, p_fa: float) -> list[Verdict]:
    """The verdict of each test on given pseudorange errors (e, n) [m]; leading axis (e,)."""

    def one_epoch(parts: tuple[TestBatch, Array]) -> list[Verdict]:
        one, errors = parts
        model, prepared = _prepare(one, tests, p_fa)
        start = start_from(model, errors)
        return [test.examine(model, p, start) for test, p in zip(tests, prepared, strict=True)]

    return jax.lax.map(one_epoch, (batch, errors_m))


def _prepare(one: TestBatch, tests: Tests, p_fa: float) -> tuple[LinearModel, list]:
    given = one.epochs
    model = linear_model(given.design, given.sigma_m, given.in_view, satellite=given.satellite)
    return model, [test.prepare(model, one.system, p_fa) for test in tests]


def _start(model: LinearModel, noise: Array) -> LeastSquaresSolution:
    """The least-squares start of noise in units of sigma (n, lanes)."""
    sigma = jnp.where(model.weight_root > 0, 1.0 / jnp.where(model.weight_root > 0, model.weight_root, 1.0), 0.0)
    return start_from(model, noise * sigma[:, None])
