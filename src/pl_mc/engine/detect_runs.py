"""Runs of the detection core over many epochs: calibration of thresholds, counts of detections, verdicts.

Work is cut into calls of one shape, so that each jitted function compiles once, and given to a few threads. No
count depends on the number of threads or on how the work was cut.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.detectors.base import SYSTEM_LETTERS, Detector, Verdict, View
from pl_mc.engine.calls import Chunk, Cut, run_calls
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.engine.core import EpochBatch
from pl_mc.engine.detect_core import (
    MethodTest,
    TestBatch,
    as_tests,
    count_detections,
    examine_errors,
    fault_free_statistics,
)
from pl_mc.engine.drawn_biases import DrawnBiases
from pl_mc.geometry.record import Geometry
from pl_mc.injection import DrawnRows
from pl_mc.input_errors import InputError, require_fraction, require_whole
from pl_mc.ism import satellite_codes
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Method
from pl_mc.methods.registry import fit_for
from pl_mc.runtime.precision import dtype_of, on_device, precision_scope
from pl_mc.runtime.threads import cores
from pl_mc.statistics.least_squares import ls_quantities

NOMINAL, EQUAL_P_FA = "nominal", "equal_p_fa"
LEVELS = (NOMINAL, EQUAL_P_FA)

# First blocks of the noise that finds thresholds and of the noise that measures them; power starts at block 0.
_CALIBRATION_BLOCK = 2**29
_CHECK_BLOCK = 2**30
MOST_DRAWS = _CALIBRATION_BLOCK * LANES

# Statistics that a call may hold at once, and draws times faults that it may count.
_STATISTICS_PER_CALL = 2**21
_SCENARIOS_PER_CALL = 2**20

_statistics = jax.jit(fault_free_statistics, static_argnames=("tests", "p_fa", "blocks"))
_count = jax.jit(count_detections, static_argnames=("tests", "p_fa", "blocks"))
_examine = jax.jit(examine_errors, static_argnames=("tests", "p_fa"))


@dataclass(frozen=True)
class Options:
    """What stays the same in all calls of one analysis: tests, nominal P_FA, seed, precision, threads, progress."""

    tests: tuple[Detector, ...]
    p_fa: float
    seed: int
    precision: str
    workers: int
    progress: bool | None


@dataclass(frozen=True)
class Calibration:
    """Thresholds of each test at each epoch and the false alarms measured with them.

    Attributes:
        thresholds: (e, tests, 2), by `LEVELS`; NaN where a test is not defined.
        false_alarms: (e, tests, 2), fault-free draws above them, of ``draws`` draws.
        draws: draws at each epoch behind each count; as many others found each threshold of the second level.
    """

    thresholds: FloatArray
    false_alarms: NDArray[np.int64]
    draws: int


def checked_options(
    tests: Sequence[str | Detector | Method], p_fa: float, seed: int, precision: str = "float64",
    workers: int | None = None, progress: bool | None = False,
) -> Options:  # fmt: skip
    """The options after a check of each; an `InputError` names the one that cannot be used."""
    dtype_of(precision)
    made, p_fa = as_tests(tests), require_fraction(p_fa, field="p_fa")
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    threads = cores() if workers is None else require_whole(workers, field="workers", low=1)
    return Options(made, p_fa, seed, precision, threads, progress)


def defined_at(g: Geometry, tests: tuple[Detector, ...]) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """(e, tests), where each test is defined, and a sentence for each reason why one is not.

    Raises:
        InputError: a single epoch at which a test is not defined, or a series at which one never is.
    """
    fit_for(tuple(test.method for test in tests if isinstance(test, MethodTest)), g)
    series = g.as_series()
    defined = np.ones((len(series), len(tests)), dtype=bool)
    views = _views(series)
    notes = []
    for k, test in enumerate(tests):
        against = [test.reason_against(view) for view in views]
        defined[:, k] = [reason is None for reason in against]
        reasons = Counter(reason for reason in against if reason is not None)
        if not defined[:, k].any():
            others = [other.name for other in tests if other is not test and _some(other, views)]
            first = reasons.most_common(1)[0][0]
            where = "defined at no epoch of the series" if g.is_series else "not defined at this epoch"
            hint = f"; without it there is {' and '.join(others)}" if others else ""
            raise InputError(f"test {test.name}: it is {where}: {first}{hint}.")
        notes += [
            f"{test.name} is not defined at {count} of {len(series)} epochs, which give no row: {reason}."
            for reason, count in reasons.items()
        ]
    return defined, tuple(notes)


def calibrate(
    series: Geometry, options: Options, *, draws: int, defined: NDArray[np.bool_] | None = None
) -> Calibration:
    """Thresholds at each epoch, nominal and of equal false-alarm rate, and the false alarms measured with them.

    The second threshold is the k-th largest of ``draws`` fault-free statistics, k = floor(p_fa (draws + 1)): a
    further draw is above it with probability k / (draws + 1) on average, whatever the distribution.

    Raises:
        InputError: fewer draws than one expected false alarm needs.
    """
    draws = require_whole(draws, field="calibration_draws", low=1, high=MOST_DRAWS)
    rank = math.floor(options.p_fa * (draws + 1) * (1 + 1e-12))
    if rank < 1:
        raise InputError(
            f"calibration_draws: {draws} draws cannot place a threshold of P_FA {options.p_fa:g}; at least "
            f"{1 / options.p_fa - 1:.9g} are needed."
        )
    tests = len(options.tests)
    cut = _cut(len(series), draws, most=_STATISTICS_PER_CALL // (tests * LANES), noise_from=_CALIBRATION_BLOCK)

    def statistics(chunk: Chunk, first_block: np.int32, *others: np.int32) -> tuple[Array, Array]:
        # One compiled function for the draws that find thresholds and for those that measure them.
        return _statistics(
            _batch(series, cut.places(chunk), options), np.uint32(options.seed), first_block, tests=options.tests,
            p_fa=options.p_fa, blocks=cut.blocks_per_call,
        )  # fmt: skip

    parts = []
    found = _results(cut, statistics, options, "Thresholds")
    for _, group in groupby(found, key=lambda result: result[0].first_epoch):
        results = [values for _, values in group]
        values = np.concatenate([free for free, _ in results], axis=-1)[..., :draws]
        calibrated = np.partition(values, draws - rank, axis=-1)[..., draws - rank]
        parts.append(np.stack([results[0][1], calibrated], axis=-1).astype(float))
    thresholds = np.concatenate(parts)[: len(series)]
    if defined is not None:
        thresholds = np.where(defined[:, :, None], thresholds, np.nan)
    alarms = np.zeros(thresholds.shape, dtype=np.int64)
    limits = thresholds.astype(dtype_of(options.precision))
    fresh = replace(cut, noise_from=_CHECK_BLOCK)
    for chunk, (values, _) in _results(fresh, statistics, options, "False alarms"):
        here = slice(chunk.first_epoch, chunk.stop_epoch)
        drawn = values[: chunk.size, :, : fresh.draws_of(chunk)]
        for level in range(len(LEVELS)):
            alarms[here, :, level] += (drawn > limits[here, :, level, None]).sum(axis=-1)
    return Calibration(thresholds, alarms, draws)


def power_counts(
    series: Geometry, bias_m: FloatArray, applies: NDArray[np.bool_], thresholds: FloatArray, options: Options, *,
    draws: int, drawn: DrawnRows | None = None,
) -> NDArray[np.int64]:  # fmt: skip
    """(e, f, tests, levels, 2), detections, and those of them whose suspect is faulted.

    Args:
        series: e epochs.
        bias_m: (e, f, n), bias vectors over the rows of each epoch [m]; applies: (e, f), which of them count.
        thresholds: (e, tests, levels).
        draws: noise draws at each epoch, the same for all faults.
        drawn: (e, f, n), what is drawn of the biases, beside ``bias_m``.
    """
    faults = bias_m.shape[1]
    cut = _cut(len(series), draws, most=_SCENARIOS_PER_CALL // (faults * LANES))

    def count(chunk: Chunk, *noise: np.int32) -> Array:
        places = cut.places(chunk)
        return _count(
            _batch(series, places, options, bias_m, applies, drawn), np.uint32(options.seed), *noise,
            on_device(thresholds[places], dtype_of(options.precision)), tests=options.tests, p_fa=options.p_fa,
            blocks=cut.blocks_per_call,
        )  # fmt: skip

    total = np.zeros((len(series), faults, *thresholds.shape[1:], 2), dtype=np.int64)
    for chunk, counts in _results(cut, count, options, "Detections"):
        total[chunk.first_epoch : chunk.stop_epoch] += counts[: chunk.size]
    return total


def verdicts_on(series: Geometry, errors_m: FloatArray, options: Options) -> list[Verdict]:
    """The verdict of each test on errors (e, n) [m], with NumPy arrays of a leading axis (e,)."""
    with precision_scope(options.precision):
        batch = _batch(series, np.arange(len(series)), options)
        errors = on_device(np.where(series.in_view, errors_m, 0.0), dtype_of(options.precision))
        found = _examine(batch, errors, tests=options.tests, p_fa=options.p_fa)
        return jax.tree.map(np.asarray, found)


def system_places(series: Geometry) -> NDArray[np.int32]:
    """(e, n), place of each row's system in `SYSTEM_LETTERS`; -1 on padding."""
    places = np.array([SYSTEM_LETTERS.index(letter) for letter in series.systems], dtype=np.int32)
    return np.where(series.in_view, places[series.satellite], np.int32(-1)).astype(np.int32)


def _batch(
    series: Geometry, places: NDArray[np.int64], options: Options, bias_m: FloatArray | None = None,
    applies: NDArray[np.bool_] | None = None, drawn: DrawnRows | None = None,
) -> TestBatch:  # fmt: skip
    """The arrays of one call, made in the precision scope in which it runs."""
    dtype = dtype_of(options.precision)
    shape = (len(places), 1, series.sigma_m.shape[1])
    return TestBatch(
        epochs=EpochBatch(
            design=on_device(series.design[places], dtype),
            sigma_m=on_device(series.sigma_m[places], dtype),
            in_view=on_device(series.in_view[places]),
            bias_m=on_device(np.zeros(shape) if bias_m is None else bias_m[places], dtype),
            applies=on_device(np.ones(shape[:2], bool) if applies is None else applies[places]),
            epoch=on_device(series.epoch[places], np.uint32),
            drawn=None if drawn is None else DrawnBiases.of_rows(drawn.at(places), dtype),
            satellite=on_device(satellite_codes(series)[places]),
        ),
        system=on_device(system_places(series)[places]),
    )


def _cut(epochs: int, draws: int, *, most: int, noise_from: int = 0) -> Cut:
    """Calls of at most so many blocks of noise, over all their epochs, with equally many epochs in each."""
    blocks = math.ceil(draws / LANES)
    epochs_at_most = max(1, most // blocks)
    each = math.ceil(epochs / math.ceil(epochs / epochs_at_most))
    return Cut(
        epoch_count=epochs, draws=draws, epochs_per_call=each, blocks_per_call=min(blocks, max(1, most)),
        noise_from=noise_from,
    )  # fmt: skip


def _results(cut: Cut, function: Callable[..., Any], options: Options, what: str) -> Iterator[tuple[Chunk, Any]]:
    return run_calls(
        cut, function, precision=options.precision, threads=options.workers, what=what, show=options.progress
    )


def _views(series: Geometry) -> list[View]:
    """What each epoch offers."""
    quantities = ls_quantities(series)
    system = system_places(series)
    counts = np.stack([(system == k).sum(axis=1) for k in range(len(SYSTEM_LETTERS))], axis=1)
    return [
        View(
            counts={letter: int(n) for letter, n in zip(SYSTEM_LETTERS, counts[e], strict=True) if n},
            dof=int(quantities.dof[e]),
            determined=bool(~np.isnan(quantities.vdop_m[e])),
        )
        for e in range(len(series))
    ]


def _some(test: Detector, views: Sequence[View]) -> bool:
    return any(test.reason_against(view) is None for view in views)
