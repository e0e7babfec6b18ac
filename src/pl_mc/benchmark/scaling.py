"""Time and memory of a sweep against its number of scenarios, each point in a fresh process."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.benchmark.measure import load_average, processor_name
from pl_mc.benchmark.problem import reference_faults, reference_geometry
from pl_mc.benchmark.report import write_texts
from pl_mc.engine.checks import LARGEST_DRAWS
from pl_mc.input_errors import InputError, require_choice, require_path, require_whole
from pl_mc.report.figures import in_common_look, new_figure, save_figure
from pl_mc.report.look import series_style
from pl_mc.report.text import markdown_table
from pl_mc.runtime.precision import PRECISIONS
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import cores

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def scenario_counts(text: str) -> tuple[int, ...]:
    """``1e6,1e7`` as whole numbers.

    Raises:
        InputError: something that is no whole number of at least 1.
    """
    found = []
    for word in text.split(","):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value >= 1 and value == math.floor(value)):
            raise InputError(
                f"scaling: {word.strip()!r} is no number of scenarios; whole numbers are needed, as in 1e6,1e7."
            )
        found.append(int(value))
    return tuple(found)


def scaling(
    scenarios: Sequence[int], *, precision: str = "float64", workers: int | None = None,
    parts: Path | str | None = None, progress: bool | None = None,
) -> pd.DataFrame:  # fmt: skip
    """Measure each number of scenarios of the reference problem; one is a noise draw under one of its 20 biases.

    Args:
        scenarios: how many; each is rounded up to a multiple of 20.
        precision, workers, progress: as for `pl_mc.sweep`.
        parts: where finished parts of each point are stored, so that a point that was stopped goes on with them; its
            seconds are then those of all its processes. Nowhere unless given.

    Returns:
        One row per number: ``scenarios, precision, threads, process_s`` (from the start of the process to its end,
        imports and compilation included), ``processor_s`` (user and system time of all its threads, which other work
        on the machine hardly changes), ``sweep_s`` (the sweep with its compilation), ``scenarios_per_s`` (of the
        sweep), ``peak_memory_mb`` (largest resident memory of the process).

    Raises:
        InputError: numbers that cannot be used, or a process that failed, as one without enough memory would.
    """
    if not scenarios:
        raise InputError("scaling: at least one number of scenarios is needed.")
    faults = len(reference_faults(reference_geometry()))
    numbers = [require_whole(number, field="scaling", low=1, high=LARGEST_DRAWS * faults) for number in scenarios]
    require_choice(precision, PRECISIONS, field="precision")
    threads = cores() if workers is None else require_whole(workers, field="workers", low=1)
    folder = None if parts is None else require_path(parts, field="parts")
    rows = [
        _point(math.ceil(number / faults), precision, threads, folder)
        for number in with_progress(numbers, total=len(numbers), what="Scaling", show=progress)
    ]
    return pd.DataFrame(rows)


def _point(draws: int, precision: str, threads: int, parts: Path | None) -> dict[str, Any]:
    command = [sys.executable, "-m", "pl_mc.benchmark.scaling_point", str(draws), precision, str(threads)]
    if parts is not None:
        command.append(str(parts / f"{draws}-{precision}"))
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - start
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise InputError(f"scaling: the process with {draws} draws ended with code {done.returncode} ({reason}).")
    found = json.loads(done.stdout.splitlines()[-1])
    earlier, scenarios = found["earlier"], found["scenarios"]
    sweep_s = earlier["sweep_s"] + found["sweep_s"]
    return {
        "scenarios": scenarios, "precision": precision, "threads": threads,
        "process_s": earlier["process_s"] + seconds, "processor_s": earlier["processor_s"] + found["processor_s"],
        "sweep_s": sweep_s, "scenarios_per_s": scenarios / sweep_s, "peak_memory_mb": found["peak_bytes"] / 1e6,
    }  # fmt: skip


def run_scaling(
    scenarios: Sequence[int], *, precision: str = "float64", workers: int | None = None,
    parts: Path | str | None = None, out: Path | str | None = None, progress: bool | None = None,
) -> tuple[pd.DataFrame, str]:  # fmt: skip
    """`scaling` with a text; into ``out`` go scaling.csv, scaling.md, scaling.png and scaling.svg."""
    table = scaling(scenarios, precision=precision, workers=workers, parts=parts, progress=progress)
    text = scaling_text(table)
    if out is not None:
        csv = table.to_csv(index=False, lineterminator="\n")
        write_texts({"scaling.csv": csv, "scaling.md": text + "\n"}, Path(out))
        save_figure(scaling_figure(table), Path(out), "scaling")
    return table, text


def scaling_text(table: pd.DataFrame) -> str:
    """The table for a reader."""
    rows = [
        (
            f"{row.scenarios:,}", row.precision, row.threads, f"{row.process_s:.1f}", f"{row.processor_s:.1f}",
            f"{row.sweep_s:.1f}", f"{row.scenarios_per_s / 1e6:.3g}", f"{row.peak_memory_mb:.0f}",
        )
        for row in table.itertuples()
    ]  # fmt: skip
    head = (
        "scenarios", "precision", "threads", "process [s]", "processor [s]", "sweep [s]", "rate [M/s]",
        "peak memory [MB]",
    )  # fmt: skip
    averages = load_average()
    load = "" if averages is None else f", load average {averages[0]} at the end"
    return (
        "# Time and memory against the number of scenarios\n\n"
        f"{processor_name()}, cores: {cores()}{load}"
        ". Each row is a process of its own; its time includes imports and compilation.\n\n"
        + markdown_table(head, rows)
    )


@in_common_look
def scaling_figure(table: pd.DataFrame) -> Figure:
    """Time and peak memory against scenarios, both on logarithmic scales."""
    figure, (left, right) = new_figure(1, 2, width_in=9.0, height_in=3.8, sharex=True)
    title = "Cost of a sweep against its size, each point a process of its own"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    ordered = table.sort_values("scenarios")
    time_style, memory_style = series_style(0), series_style(1)
    left.plot(
        ordered.scenarios, ordered.process_s, time_style.line, marker=time_style.marker, color=time_style.colour,
        label="process, imports and compilation included",
    )  # fmt: skip
    # A line through the last point: what time would be if it were nothing but proportional.
    ends = np.array([ordered.scenarios.iloc[0], ordered.scenarios.iloc[-1]], dtype=float)
    left.plot(ends, ordered.process_s.iloc[-1] * ends / ends[-1], color="0.5", linewidth=1.0, linestyle=":",
              label="in proportion to the last point")  # fmt: skip
    left.set(xscale="log", yscale="log", xlabel="scenarios", ylabel="wall time [s]")
    left.set_title("Time")
    left.legend(loc="upper left")
    right.plot(
        ordered.scenarios, ordered.peak_memory_mb, memory_style.line, marker=memory_style.marker,
        color=memory_style.colour,
    )  # fmt: skip
    right.set(xscale="log", yscale="log", xlabel="scenarios", ylabel="peak resident memory [MB]", ylim=(10, 10_000))
    right.set_title("Memory")
    return figure
