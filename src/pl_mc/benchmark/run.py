"""The benchmark: the sweep beside batched NumPy, statsmodels and a hand-written kernel; how fast and how exact."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd

import pl_mc
from pl_mc.alert import LPV_200
from pl_mc.benchmark import accuracy, measure, problem
from pl_mc.benchmark.batched_numpy import Numbers, NumpyOutcome, both_methods, sweep_numpy
from pl_mc.benchmark.limit import Limit, limits
from pl_mc.benchmark.measure import Contestant, Rate, Ratio, timed
from pl_mc.benchmark.report import Bench, Sizes, bench_text, write_bench
from pl_mc.engine.compiling import require_devices
from pl_mc.engine.plan import SCENARIOS_PER_CALL, make_plan
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_whole
from pl_mc.kernels.noise import LANES
from pl_mc.report.text import rate_text
from pl_mc.runtime.precision import PRECISIONS
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import cores

SWEEP, NUMPY, RLM, LIMIT = "pl_mc.sweep", "batched NumPy", "statsmodels RLM", "hand-written kernel"
SETTLED, PLAIN = f"{SWEEP}, settled", f"{SWEEP}, {problem.PLAIN_ITERATIONS} iterations"
_METHODS = {SWEEP: problem.METHODS, SETTLED: problem.SETTLED_METHODS, PLAIN: problem.PLAIN_METHODS}

SEED = 20_251

# Fits of statsmodels take a share of the time of the others: one scenario a call says enough.
_RLM_SHARE = 0.1
_NUMPY_DRAWS = 256


def run_bench(
    *,
    seconds: float = 10.0,
    precisions: Sequence[str] = PRECISIONS,
    devices: int | None = None,
    limit: Path | str | None = None,
    out: Path | str | None = None,
    sizes: Sizes | None = None,
    progress: bool | None = None,
) -> tuple[Bench, str]:
    """Measure this machine.

    Args:
        seconds: time for each computation, over all its repetitions [s].
        precisions: ``float64``, ``float32`` or both.
        devices: devices of JAX over which sweeps are spread too. On a processor they are set up for this process,
            which must not have used JAX before.
        limit: a hand-written kernel, see `pl_mc.benchmark.limit`: a C++ source or a program.
        out: folder for bench.json, bench.csv and bench.md.
        sizes: all sizes at once, instead of ``seconds``.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        The record, and the same as a text with tables.

    Raises:
        InputError: options that cannot be used, devices that are not there, a kernel that does not run.
    """
    sizes = Sizes(seconds=seconds) if sizes is None else sizes
    if not precisions:
        raise InputError(f"precision: at least one of {', '.join(PRECISIONS)} is needed.")
    chosen = [p for p in PRECISIONS if p in {require_choice(p, PRECISIONS, field="precision") for p in precisions}]
    _set_devices(devices)
    told = measure.describe_machine()
    g = problem.reference_geometry()
    tables: dict[tuple[str, str], pd.DataFrame] = {}
    errors_m = problem.reference_errors_m(g, sizes.limit_scenarios, seed=SEED)
    with contextlib.ExitStack() as stack:
        kernels: list[Limit] = []
        if limit is not None:
            kernels = stack.enter_context(limits(limit, g, errors_m, threads=cores(), precisions=chosen))
        contestants = [*_sweeps(g, chosen, devices, sizes, tables), _numpy(g), *_rlm(g), *_kernels(kernels)]
        rates = measure.measure(
            contestants, seconds=sizes.seconds, rounds=sizes.repetitions,
            rounds_with_progress=lambda rounds: with_progress(
                rounds, total=sizes.repetitions, what="Benchmark", show=progress
            ),
        )  # fmt: skip
        hand_written = [(kernel.precision, kernel.vpl_m) for kernel in kernels]
    told["load_average_after"] = measure.load_average()

    compared = problem.reference_errors_m(g, sizes.accuracy_scenarios, seed=SEED + 1)
    reference = both_methods(g, compared)
    found = {precision: accuracy.solved(g, compared, precision) for precision in chosen}
    rows = [
        row for precision in chosen for row in accuracy.differences("pl_mc", precision, found[precision], reference)
    ]
    if hand_written:
        rows += _limit_differences(hand_written, both_methods(g, errors_m))
    event_rates = accuracy.event_rates({precision: tables[SWEEP, precision] for precision in chosen})
    disagreements = accuracy.disagreements(found["float32"], found["float64"]) if len(chosen) == 2 else ()
    bench = Bench(
        machine=told, problem=problem.DESCRIPTION, sizes=sizes, rates=tuple(rates), ratios=tuple(_ratios(rates)),
        differences=tuple(rows), disagreements=tuple(disagreements), event_rates=tuple(event_rates),
        notes=(*_notes(rates, event_rates), *_unsettled(tables)),
    )  # fmt: skip
    text = bench_text(bench)
    if out is not None:
        write_bench(bench, text, Path(out))
    return bench, text


def _set_devices(devices: int | None) -> None:
    if devices is None:
        return
    devices = require_whole(devices, field="devices", low=1)
    # Devices of a processor are set before its first use; afterwards what is there has to do.
    with contextlib.suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", devices)
    require_devices(devices)


def _sweeps(
    g: Geometry, precisions: Sequence[str], devices: int | None, sizes: Sizes,
    tables: dict[tuple[str, str], pd.DataFrame],
) -> list[Contestant]:  # fmt: skip
    """Sweeps of each precision; the last counts of each sort go into ``tables``."""
    faults = problem.reference_faults(g)
    draws = sizes.draws
    if draws is None:
        # So many draws that several calls are needed; all of them have the shape of a full one.
        draws = make_plan(g, faults, 2**30).blocks_per_call * LANES
    width = len(faults)

    def sweep(what: str, precision: str, workers: int, devices: int, scenarios: int) -> float:
        start = time.perf_counter()
        tables[what, precision] = pl_mc.sweep(
            g, faults, draws=scenarios // width, seed=SEED, methods=_METHODS[what], precision=precision,
            workers=workers, devices=devices, progress=False,
        )  # fmt: skip
        return time.perf_counter() - start

    layouts = [(SWEEP, workers, 1) for workers in sorted({1, cores()})]
    if devices is not None and devices > 1:
        layouts.append((SWEEP, 1, devices))
    if sizes.settled:
        layouts += [(what, cores(), 1) for what in (SETTLED, PLAIN)]
    return [
        Contestant(
            what=what, precision=precision, threads=workers, devices=spread, unit=draws * width,
            run=partial(sweep, what, precision, workers, spread), compiles=workers == 1,
        )
        for precision in precisions
        for what, workers, spread in layouts
    ]  # fmt: skip


def _numpy(g: Geometry) -> Contestant:
    bias_m = problem.reference_faults(g).bias_m

    def run(scenarios: int) -> float:
        draws = scenarios // len(bias_m)
        return timed(lambda: sweep_numpy(g, bias_m, draws=draws, seed=SEED, vertical_m=LPV_200.val_m))

    return Contestant(NUMPY, "float64", 1, 0, unit=_NUMPY_DRAWS * len(bias_m), run=run)


def _rlm(g: Geometry) -> list[Contestant]:
    """Robust regression of statsmodels, one scenario a fit, with Tukey's weights: it knows no IGG-III."""
    if importlib.util.find_spec("statsmodels") is None:
        return []
    sm: Any = importlib.import_module("statsmodels.api")
    root = 1.0 / g.sigma_m
    design = g.design * root[:, None]
    whitened = problem.reference_errors_m(g, 1000, seed=SEED) * root
    norm = sm.robust.norms.TukeyBiweight()
    iterations = problem.ROBUST.iterations

    def fits(count: int) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for k in range(count):
                sm.RLM(whitened[k % len(whitened)], design, M=norm).fit(maxiter=iterations, tol=0.0)

    def run(scenarios: int) -> float:
        return timed(lambda: fits(scenarios))

    return [Contestant(RLM, "float64", 1, 0, unit=1, run=run, share=_RLM_SHARE)]


def _kernels(kernels: Sequence[Limit]) -> list[Contestant]:
    def run(kernel: Limit, _: int) -> float:
        return kernel.seconds()

    return [
        Contestant(LIMIT, k.precision, k.threads, 0, unit=k.scenarios, run=partial(run, k), most=1) for k in kernels
    ]


def _limit_differences(
    found: Sequence[tuple[str, Numbers]], reference: dict[str, NumpyOutcome]
) -> list[accuracy.Difference]:
    """Its protection levels against those of NumPy: whether it did the same work."""
    name = problem.ROBUST.name
    expected = reference[name]
    rows = []
    for precision, vpl_m in found:
        # It does not tell where there is no solution.
        outcome = replace(expected, vpl_m=vpl_m, available=expected.available & np.isfinite(vpl_m))
        made = accuracy.differences(LIMIT, precision, {name: outcome}, {name: expected})
        rows += [row for row in made if row.quantity == "VPL"]
    return rows


def _ratios(rates: Sequence[Rate]) -> list[Ratio]:
    """The sweeps with all threads, or all devices, to everything else of their precision; to NumPy in any case.

    Settled estimates to plain ones.
    """
    sweeps = [rate for rate in rates if rate.what == SWEEP]
    found = []
    for precision in dict.fromkeys(rate.precision for rate in sweeps):
        own = [rate for rate in sweeps if rate.precision == precision]
        fastest = max(own, key=lambda rate: rate.median_rate)
        others = [r for r in rates if r.what in (NUMPY, RLM) or (r.what == LIMIT and r.precision == precision)]
        found += [Ratio.of(fastest, other) for other in others]
        settled, plain = ([r for r in rates if (r.what, r.precision) == (what, precision)] for what in (SETTLED, PLAIN))
        found += [Ratio.of(one, other) for one, other in zip(settled, plain, strict=True)]
    return found


def _notes(rates: Sequence[Rate], event_rates: Sequence[accuracy.EventRate]) -> list[str]:
    whats = {rate.what for rate in rates}
    notes = [
        f"{SWEEP} and {NUMPY} draw noise, run both methods and count events; NumPy is called from one thread, its "
        "linear algebra may use more."
    ]
    for rate in rates:
        if rate.what in _METHODS and (share := _busy_share(rate)) < 0.95:
            notes.append(
                f"{rate.what} in {rate.precision} on {rate.threads} threads: a repetition is so short that at most "
                f"{100 * share:.0f} % of the threads' time can be used; a longer time makes it fair."
            )
    if RLM in whats:
        notes.append(f"{RLM} does one robust fit a call, with Tukey's weights and nothing else.")
    if LIMIT in whats:
        notes.append(
            f"The {LIMIT} does the robust estimate and its vertical level alone, on given observations, and its "
            "time is the best of three in each round."
        )
    if {rate.precision for rate in event_rates} == set(PRECISIONS):
        overlap, pairs = accuracy.overlapping(event_rates)
        notes.append(
            f"Single precision draws other noise, none beyond 5.42 sigma: the intervals of {overlap} of {pairs} "
            "event rates overlap with those of double precision."
        )
    return notes


def _unsettled(tables: Mapping[tuple[str, str], pd.DataFrame]) -> list[str]:
    """The share of the draws that had not settled, of each sort of sweep but the ten iterations of the others."""
    notes = []
    for (what, precision), table in tables.items():
        if what != SWEEP:
            robust = _METHODS[what][-1].name
            (one,) = (
                rate for rate in accuracy.event_rates({precision: table})
                if (rate.method, rate.event) == (robust, "unconverged")
            )  # fmt: skip
            told = rate_text(one.count, one.draws, one.low, one.high)
            notes.append(f"{what} in {precision}, {robust}: draws that had not settled to 1 cm: {told}.")
    return notes


def _busy_share(rate: Rate) -> float:
    """The most of its threads' time that a sweep can use: calls are not divided."""
    calls = math.ceil(rate.scenarios / SCENARIOS_PER_CALL)
    return calls / rate.threads / math.ceil(calls / rate.threads)
