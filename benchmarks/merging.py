"""What it takes to merge very many parts of a sweep: `python benchmarks/merging.py 1000 10000 100000`.

Parts are written as a sweep of 1e13 scenarios would write them, with counts that nobody counted, and are read, held
against their checksums and the plan and summed as a merge does. Prints a line of CSV for each number of parts.
"""

from __future__ import annotations

import dataclasses
import resource
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import pl_mc
from pl_mc.engine.checkpoint_store import _CHECKSUM, _NO_CHECKSUM, CheckpointStore, _with_checksum
from pl_mc.engine.execution import Execution, run_task
from pl_mc.engine.table import FaultTotals
from pl_mc.engine.task import PartCounts, SweepTask
from pl_mc.methods import as_methods

# Parts that are made as a sweep makes them; the others are copies of such with another number.
REALLY_WRITTEN = 1_000
MODEL = 999_999


def task_of(parts: int) -> SweepTask:
    """A ramp of 20 biases at two epochs, by two methods, that is cut into at least so many parts."""
    g = pl_mc.simulate(epochs=2, interval_s=3600.0)
    faults = pl_mc.ramp(g, satellite="G12", start_m=5.0, stop_m=100.0, step_m=5.0)
    draws = -(-parts * 2**25 // (2 * len(faults.labels)))
    return SweepTask(
        geometry=g, faults=faults, draws=draws, seed=1, methods=as_methods(("ls", "igg3"), g), alert=pl_mc.LPV_200,
        precision="float64",
    )  # fmt: skip


def made_up(task: SweepTask, number: int, rng: np.random.Generator) -> PartCounts:
    """A part with counts that contradict nothing: all alarms are false."""
    places, draws = places_and_draws(task, number)
    false = [k for k, event in enumerate(task.events) if event.name in ("alarm", "false_alarm")]
    counts = np.zeros((len(places), task.plan.fault_index.shape[1], task.rows, len(task.events)), np.int64)
    counts[..., false] = rng.integers(0, draws.min(), counts.shape[:-1])[..., None]
    return PartCounts(number, places, draws, counts)


def places_and_draws(task: SweepTask, number: int) -> tuple[np.ndarray, np.ndarray]:
    """The epochs of a part, and the draws at each."""
    drawn = np.zeros(len(task.plan.epochs), np.int64)
    for chunk in task.plan.chunks(number):
        drawn[chunk.first_epoch : chunk.stop_epoch] += task.plan.draws_of(chunk)
    places = np.flatnonzero(drawn)
    return places, drawn[places]


def copies(store: CheckpointStore[PartCounts], numbers: range, rng: np.random.Generator) -> None:
    """Parts that differ from one another in their number alone: made sooner, and read no sooner, than others."""
    models: dict[bytes, bytes] = {}
    for number in numbers:
        key = b"".join(array.tobytes() for array in places_and_draws(store.task, number))
        if key not in models:
            # Of as many digits as any number here has, so that another takes the same room.
            store.write(dataclasses.replace(made_up(store.task, number, rng), number=MODEL))
            content = store.place(MODEL).read_bytes()
            models[key] = _CHECKSUM.sub(b'"sha256": "%s"' % _NO_CHECKSUM.encode(), content)
            store.place(MODEL).unlink()
        content = models[key].replace(b'"part": %d' % MODEL, b'"part": %-6d' % number)
        store.place(number).write_bytes(_with_checksum(content))


def merged(parts: int, folder: Path) -> dict[str, float]:
    """Milliseconds a part to write and to merge, by the wall and of the processor, bytes of a part, and memory [MB]."""
    task = task_of(parts)
    rng = np.random.default_rng(1)
    store = CheckpointStore(folder, task, resume=False)
    store.begin()
    begin, written_so = _now_ms(), min(task.part_count, REALLY_WRITTEN)
    for number in range(written_so):
        store.write(made_up(task, number, rng))
    written = _now_ms()
    copies(store, range(written_so, task.part_count), rng)
    copied = _now_ms()
    totals = FaultTotals.of(task)
    for part in run_task(task, Execution(folder=folder, stored_only=True, progress=False), lambda *_: iter(())):
        assert not isinstance(part, str), part
        totals.add(task, part)
    done = _now_ms()
    size = sum(path.stat().st_size for path in folder.glob("part-*"))
    write_ms, write_processor_ms = (written - begin) / written_so
    merge_ms, merge_processor_ms = (done - copied) / task.part_count
    return {
        "parts": task.part_count, "write_ms": write_ms, "write_processor_ms": write_processor_ms,
        "merge_ms": merge_ms, "merge_processor_ms": merge_processor_ms, "part_bytes": size / task.part_count,
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }  # fmt: skip


def _now_ms() -> np.ndarray:
    """By the wall, and of the processor: user and system time of this process, which other work hardly moves."""
    return 1e3 * np.array([time.perf_counter(), time.process_time()])


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    for count in map(int, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as place:
            found = merged(count, Path(place, "parts"))
            print(*(f"{name}={value:.6g}" for name, value in found.items()), flush=True)
