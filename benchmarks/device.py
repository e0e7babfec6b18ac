"""A device in under four minutes, as JSON: python benchmarks/device.py [--quick] [--seconds 200] [--out FILE].

Whether what JAX finds first, a GPU or the processor, counts rightly, and how fast: a ramp of biases by least squares
and IGG-III against the exact law, the same counts twice, and on the processor of the same machine in a process of its
own; scenarios a second by satellites, precision and scenarios a call, up to the memory, over all devices; what share
that is of what the device can multiply and add; and how it compares with batched solves of PyTorch or CuPy. Exit code 1
where a check fails; what there was no time for is named under ``left_out``.

JAX, NumPy, SciPy and pandas are enough: in a checkout the script finds ``src`` by itself.
"""

# ruff: noqa: E402

from __future__ import annotations

import argparse
import importlib
import importlib.util
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas  # noqa: F401  Before the modules that stand for others, of which it would take one for a library.

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src"))
# Libraries of files and coordinates, which nothing here uses: where they are missing an empty module will do.
for _name in ("pyarrow", "pyarrow.parquet", "pymap3d"):
    try:
        importlib.import_module(_name)
    except ModuleNotFoundError:
        sys.modules[_name] = ModuleType(_name)

import jax
import jax.numpy as jnp
import numpy as np

import pl_mc
from pl_mc.benchmark.measure import Rate, processor_name, timed, versions
from pl_mc.benchmark.problem import METHODS, ROBUST, reference_geometry
from pl_mc.engine import plan
from pl_mc.engine.table import COUNT_COLUMNS
from pl_mc.kernels.noise import LANES
from pl_mc.runtime.precision import dtype_of, precision_scope
from pl_mc.runtime.threads import cores
from pl_mc.statistics.intervals import binomial_p_value

SEED, FAULTED = 20_251, "G04"
# Least probability of all comparisons with the exact law together.
LEAST_P = 1e-6
# What a process of its own may take of the time.
PROCESSOR_SHARE = 0.3

# Multiply-adds of a chain of the arithmetic limit, and chains side by side, so that none waits for the one before.
_CHAIN, _SIDE_BY_SIDE = 64, 8
Rows = list[dict[str, Any]]
_COLUMNS = ("north_m", "east_m", "up_m", "hpl_m", "vpl_m")


class Scope:
    """What is asked for, and the time that is left.

    Args:
        quick: whether seconds are to do: one number of satellites, few draws.
        seconds: time in all [s].
    """

    def __init__(self, quick: bool, seconds: float) -> None:
        self.end = time.monotonic() + seconds
        self.satellites = (12,) if quick else (24, 12, 40)
        self.precisions = ("float64", "float32")
        self.sampled = 256 if quick else 4096
        self.steps = 2 if quick else 20
        self.each_s = 0.2 if quick else 2.0
        # Scenarios a call, beside those of a sweep.
        self.calls = () if quick else (2**22, 2**24, 2**26, 2**28, 2**30)
        self.own_call = 2**13 if quick else plan.SCENARIOS_PER_CALL
        # Whole calls, of one program with those that are timed.
        self.draws = self.own_call // self.steps if quick else 50_000
        self.left_out: list[str] = []
        # The longest that anything took to compile so far [s].
        self.compiling_s = 1.0

    def time_for(self, what: str) -> bool:
        """Whether there is time for another program; else it is named."""
        if self.end - time.monotonic() > 1.5 * self.compiling_s + 2 * self.each_s:
            return True
        self.left_out.append(what)
        return False

    def problem(self, n: int) -> tuple[pl_mc.Geometry, pl_mc.Faults]:
        """So many satellites, and a ramp up to 100 m on one of them."""
        g = reference_geometry(n)
        return g, pl_mc.ramp(g, satellite=FAULTED, start_m=5.0, stop_m=100.0, step_m=95.0 / (self.steps - 1))


def counts(scope: Scope, n: int, precision: str, **execution: int) -> np.ndarray:
    """(methods, faults, events), counts of the ramp."""
    g, faults = scope.problem(n)
    plan.SCENARIOS_PER_CALL = scope.own_call
    table = pl_mc.sweep(
        g, faults, draws=scope.draws, seed=SEED, methods=METHODS, precision=precision, progress=False, **execution
    )
    return table[COUNT_COLUMNS[1:]].to_numpy(np.int64).reshape(len(METHODS), len(faults), -1)


def sampled(scope: Scope, n: int, precision: str) -> np.ndarray:
    """(rows, 8), draws one by one: position error, levels, and whether there is a solution and an alarm."""
    g, faults = scope.problem(n)
    table = pl_mc.sample(g, faults, draws=scope.sampled // len(faults), seed=SEED, methods=METHODS, precision=precision)
    return table[[*_COLUMNS, "available", "alarm"]].to_numpy(np.float64)


def rate(scope: Scope, n: int, precision: str, per_call: int, *, threads: int, devices: int = 1) -> Rate:
    """Scenarios a second of sweeps in calls of that size."""
    g, faults = scope.problem(n)
    plan.SCENARIOS_PER_CALL = per_call
    draws = plan.make_plan(g, faults, 2**30).blocks_per_call * LANES

    def run(calls: int) -> float:
        return timed(
            lambda: pl_mc.sweep(
                g, faults, draws=calls * draws, seed=SEED, methods=METHODS, precision=precision, workers=threads,
                devices=devices, progress=False,
            )
        )  # fmt: skip

    first = run(1)
    scope.compiling_s = max(scope.compiling_s, first)
    calls = max(1, int(scope.each_s / 3 / max(run(threads) / threads, 1e-6)))
    times = tuple(run(calls) for _ in range(3))
    what = f"n={n}, {per_call} scenarios a call"
    return Rate(what, precision, threads, devices, calls * draws * len(faults), times, first)


def rate_record(found: Rate, n: int, per_call: int) -> dict[str, Any]:
    return {
        "satellites": n, "precision": found.precision, "devices": found.devices, "threads": found.threads,
        "scenarios_per_call": per_call, "scenarios": found.scenarios, "seconds": found.seconds,
        "first_call_s": found.first_call_s, "million_scenarios_per_s": found.median_rate,
    }  # fmt: skip


def arithmetic_limit(precision: str, size: int) -> float:
    """Floating-point operations a second that the device does where nothing but arithmetic is asked of it."""
    with precision_scope(precision):
        dtype = dtype_of(precision)

        @jax.jit
        def chains(x: jax.Array, factor: jax.Array, shift: jax.Array) -> jax.Array:
            side = [x + k for k in range(_SIDE_BY_SIDE)]
            for _ in range(_CHAIN):
                side = [one * factor + shift for one in side]
            return sum(side[1:], side[0])

        given = (jnp.linspace(0.0, 1.0, size, dtype=dtype), jnp.asarray(0.999, dtype), jnp.asarray(1e-3, dtype))
        chains(*given).block_until_ready()
        best = min(timed(lambda: chains(*given).block_until_ready()) for _ in range(5))
    return 2.0 * _CHAIN * _SIDE_BY_SIDE * size / best


def operations(n: int, faults: int) -> float:
    """Floating-point operations that a scenario needs by both methods, with one clock a satellite and nothing twice.

    A solution: for each satellite its weight (9), 14 sums of the normal equations and 4 of the residual, two
    operations each, and its share of the sum of squares (4); t^3 / 3 + 2 t^2 for the equations, t = 5. Noise, about 90
    a satellite, serves all faults; least squares is a sum of projections.
    """
    solution = n * (9 + 2 * 14 + 2 * 4 + 4) + 5**3 / 3 + 2 * 5**2
    return ROBUST.options.solutions * solution + 10 * n + 90 * n / faults


def batched_solves(quick: bool) -> Rows:
    """Million 5 x 5 equations a second of the array libraries that are installed."""
    size, found = 2**12 if quick else 2**20, []
    matrix = np.eye(5) + 0.05 * np.random.default_rng(1).random((size, 5, 5))
    for name in ("torch", "cupy"):
        if importlib.util.find_spec(name) is None:
            continue
        library: Any = importlib.import_module(name)
        for precision in ("float64", "float32"):
            row: dict[str, Any] = {"library": name, "precision": precision}
            given = [array.astype(precision) for array in (matrix, np.ones((size, 5, 1)))]
            try:
                row |= (_torch if name == "torch" else _cupy)(library, given)
                row["million_solves_per_s"] = size / row.pop("seconds") / 1e6
            except Exception as error:  # Whatever is wrong with that library is not ours.
                row["failed"] = f"{type(error).__name__}: {error}"[:200]
            found.append(row)
    return found


def _torch(torch: Any, given: list[np.ndarray]) -> dict[str, Any]:
    on_gpu = torch.cuda.is_available()
    there = [torch.from_numpy(array).to("cuda" if on_gpu else "cpu") for array in given]

    def solve() -> None:
        torch.linalg.solve(*there)
        if on_gpu:
            torch.cuda.synchronize()

    solve()
    return {"on": "GPU" if on_gpu else "processor", "seconds": min(timed(solve) for _ in range(3))}


def _cupy(cupy: Any, given: list[np.ndarray]) -> dict[str, Any]:
    there = [cupy.asarray(array) for array in given]

    def solve() -> None:
        cupy.linalg.solve(*there)
        cupy.cuda.Device().synchronize()

    solve()
    return {"on": "GPU", "seconds": min(timed(solve) for _ in range(3))}


def measured(scope: Scope, *, processor: bool) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The checks' numbers and the rates of this process's backend, of the processor those that are compared alone."""
    arrays: dict[str, np.ndarray] = {}
    n = scope.satellites[0]
    for precision in scope.precisions:
        arrays[f"counts {precision}"] = counts(scope, n, precision)
        start = time.monotonic()
        arrays[f"sample {precision}"] = sampled(scope, n, precision)
        # Nearly all of it is compilation.
        scope.compiling_s = max(scope.compiling_s, time.monotonic() - start)
        if not processor:
            arrays[f"again {precision}"] = counts(scope, n, precision)
    rates = []
    on_processor = jax.default_backend() == "cpu"
    threads = cores() if on_processor else 2
    asked = [(size, precision, scope.own_call, 1) for size in scope.satellites for precision in scope.precisions]
    if not processor:
        devices = jax.local_device_count()
        if devices > 1:
            for precision in scope.precisions:
                arrays[f"spread {precision}"] = counts(scope, n, precision, devices=devices)
            asked += [(n, precision, scope.own_call, devices) for precision in scope.precisions]
        asked += [(n, precision, per_call, 1) for per_call in scope.calls for precision in scope.precisions]
    full: set[str] = set()
    for size, precision, per_call, devices in asked:
        what = f"{size} satellites, {precision}, {per_call} scenarios a call, {devices} devices"
        if precision in full or not scope.time_for(what):
            continue
        try:
            found = rate(scope, size, precision, per_call, threads=threads if devices == 1 else 1, devices=devices)
        except (MemoryError, jax.errors.JaxRuntimeError) as error:
            full.add(precision)
            scope.left_out.append(f"{what} and more: {str(error).splitlines()[0][:120]}")
            continue
        rates.append(rate_record(found, size, per_call))
    return {"rates": rates, "left_out": scope.left_out}, arrays


def on_processor(arguments: argparse.Namespace) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """`measured` in a process that knows the processor alone."""
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, __file__, "--processor", name, "--seconds", str(PROCESSOR_SHARE * arguments.seconds)]
        done = subprocess.run(
            command + ["--quick"] * arguments.quick, env=os.environ | {"JAX_PLATFORMS": "cpu"}, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"the process on the processor failed:\n{done.stderr[-2000:]}")
        with np.load(Path(name, "arrays.npz")) as stored:
            arrays = dict(stored)
        return json.loads(Path(name, "record.json").read_text()), arrays


def checks(scope: Scope, ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> Rows:
    """Each comparison, whether it passes, and the numbers that it is about."""
    n, found = scope.satellites[0], []
    g, faults = scope.problem(n)
    exact = pl_mc.exact.ls_rates(g, faults)
    for precision in scope.precisions:
        own = ours[f"counts {precision}"]
        about = {"precision": precision, "satellites": n, "scenarios": scope.draws * len(faults)}
        # Whatever a device may give.
        possible = own.clip(0, scope.draws)
        least = min(
            float(binomial_p_value(possible[0, :, column], scope.draws, exact[f"{event}_rate"].to_numpy()).min())
            for column, event in ((0, "alarm"), (1, "hazard"), (3, "exceeded"), (4, "misleading"))
        )
        p = min(1.0, 4 * len(faults) * least) if np.array_equal(possible, own) else 0.0
        found.append({"what": "least squares against the exact law", "passed": p > LEAST_P, "probability": p} | about)
        for what, key in (("counted again", "again"), ("spread over all devices", "spread")):
            if f"{key} {precision}" in ours:
                same = np.array_equal(own, ours[f"{key} {precision}"])
                found.append({"what": f"{what}: bitwise equal", "passed": same} | about)
        apart = np.abs(own - theirs[f"counts {precision}"]).max(axis=(1, 2))
        one, other = ours[f"sample {precision}"], theirs[f"sample {precision}"]
        both = (one[:, -2] > 0) & (other[:, -2] > 0)
        move_m = np.abs(one - other)[both][:, :5].max(axis=1)
        decided = int((one[:, -2:] != other[:, -2:]).any(axis=1).sum())
        # Decisions at an edge that rounding tips: seldom, and rarer still in double precision.
        most = max(2, len(one) * (1e-3 if precision == "float64" else 1e-2))
        row = {
            "what": "against the processor, draw by draw", "passed": decided <= most, "draws": len(one),
            "decided_otherwise": decided, "moved_by_1_cm": int((move_m > 0.01).sum()),
            "median_difference_m": float(np.median(move_m)),
            "largest_difference_of_counts": {m.name: int(a) for m, a in zip(METHODS, apart, strict=True)},
        }  # fmt: skip
        found.append(row | about)
    return found


def ratios(scope: Scope, ours: Rows, theirs: Rows, peak: dict[str, float], solves: Rows) -> Rows:
    """Of the fastest calls of each number of satellites, by one device."""
    found = []
    for n, precision in itertools.product(scope.satellites, scope.precisions):

        def fastest(rates: Rows, case: tuple[int, str, int] = (n, precision, 1)) -> float:
            same = [one for one in rates if (one["satellites"], one["precision"], one["devices"]) == case]
            return max((one["million_scenarios_per_s"] for one in same), default=0.0)

        if not (best := fastest(ours)):
            continue
        row = {"satellites": n, "precision": precision, "million_scenarios_per_s": best}
        if other := fastest(theirs):
            row["to_all_cores_of_the_processor"] = best / other
        row["of_the_arithmetic_limit"] = best * 1e6 * operations(n, scope.steps) / peak[precision]
        for one in solves:
            if one["precision"] == precision and "failed" not in one:
                # As if its solves were all that a scenario takes.
                row[f"to_solves_of_{one['library']}"] = best * ROBUST.options.solutions / one["million_solves_per_s"]
        found.append(row)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes: whether it runs")
    parser.add_argument("--seconds", type=float, default=200.0, help="time for all of it")
    parser.add_argument("--out", type=Path, help="a file for the JSON too")
    parser.add_argument("--processor", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    start = time.monotonic()
    scope = Scope(arguments.quick, arguments.seconds)
    if arguments.processor is not None:
        record, arrays = measured(scope, processor=True)
        np.savez(arguments.processor / "arrays.npz", **arrays)
        (arguments.processor / "record.json").write_text(json.dumps(record))
        return
    there, their_arrays = on_processor(arguments)
    here, arrays = measured(scope, processor=False)
    size = 2**16 if arguments.quick else 2**24
    peak = {precision: arithmetic_limit(precision, size) for precision in scope.precisions}
    solves = batched_solves(arguments.quick)
    judged = checks(scope, arrays, their_arrays)
    result = {
        "passed": all(one["passed"] for one in judged),
        "backend": jax.default_backend(),
        "devices": [device.device_kind for device in jax.local_devices()],
        "processor": processor_name(), "cores": cores(), "versions": {"python": platform.python_version()} | versions(),
        "checks": judged,
        "rates": here["rates"], "rates_of_the_processor": there["rates"],
        "arithmetic_limit_gflops": {precision: value / 1e9 for precision, value in peak.items()},
        "batched_solves": solves,
        "ratios": ratios(scope, here["rates"], there["rates"], peak, solves),
        "left_out": [*here["left_out"], *(f"on the processor: {one}" for one in there["left_out"])],
        "seconds": time.monotonic() - start,
    }  # fmt: skip
    text = json.dumps(result, indent=2)
    print(text)
    if arguments.out is not None:
        arguments.out.write_text(text + "\n")
    sys.exit(0 if result["passed"] else 1)


if __name__ == "__main__":
    main()
