"""What a benchmark measures, and how much of it; as a text with tables, and as files."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pl_mc.benchmark.accuracy import Difference, Disagreement, EventRate
from pl_mc.benchmark.measure import Rate, Ratio
from pl_mc.input_errors import InputError, hold_whole, require_positive
from pl_mc.report.text import markdown_table, rate_text
from pl_mc.runtime.whole_files import write_whole


@dataclass(frozen=True)
class Sizes:
    """How much is measured.

    Attributes:
        seconds: time for each computation, over all its repetitions [s].
        repetitions: how often each is timed, in turns with the others.
        draws: draws for each bias in the smallest repetition of a sweep; None for those of one full call of the
            compiled function, of which larger repetitions are multiples, so that they compile nothing again.
        accuracy_scenarios: observations on which precisions are compared.
        limit_scenarios: scenarios of a hand-written kernel, a multiple of 16.
        settled: whether settled estimates are timed too, beside forty plain solutions.
    """

    seconds: float = 10.0
    repetitions: int = 5
    draws: int | None = None
    accuracy_scenarios: int = 20_000
    limit_scenarios: int = 2**18
    settled: bool = True

    def __post_init__(self) -> None:
        require_positive(self.seconds, field="seconds")
        hold_whole(self, "repetitions", low=1)
        hold_whole(self, "accuracy_scenarios", low=1)
        hold_whole(self, "limit_scenarios", low=16)
        if self.limit_scenarios % 16:
            raise InputError(f"limit_scenarios: a multiple of 16 is needed, not {self.limit_scenarios}.")


@dataclass(frozen=True)
class Bench:
    """What was measured.

    Attributes:
        machine: processor, cores, versions, load average before and after.
        problem, sizes: what was computed, and how much of it.
        rates, ratios: of each computation; of the sweeps to the others and of settled estimates to
            plain ones, round by round.
        differences, disagreements: from the NumPy form, and decisions that single precision changes, on the same
            observations.
        event_rates: rates of both precisions, each with its own noise.
        notes: what else a reader needs to know.
    """

    machine: dict[str, Any]
    problem: str
    sizes: Sizes
    rates: tuple[Rate, ...]
    ratios: tuple[Ratio, ...]
    differences: tuple[Difference, ...]
    disagreements: tuple[Disagreement, ...]
    event_rates: tuple[EventRate, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, fit for JSON; rates in million scenarios per second."""
        found = dataclasses.asdict(self)
        for row, rate in zip(found["rates"], self.rates, strict=True):
            row |= {"median_rate": rate.median_rate, "best_rate": rate.best_rate}
        return found


def bench_text(bench: Bench) -> str:
    """Everything for a reader, in Markdown that is also plain text."""
    parts = ["# Benchmark", _machine_text(bench), f"Problem: {bench.problem}.", "## Rates", _rates(bench.rates)]
    if bench.ratios:
        parts += ["## Side by side, in the same run", _ratios(bench.ratios)]
    title_exact = "## Exactness: differences from batched NumPy on the same observations"
    parts += [title_exact, _differences(bench.differences)]
    title = "## Events over the whole ramp"
    if bench.disagreements:
        title += ": each precision with its own noise, and what differs on the same observations"
    parts += [title, _events(bench.event_rates, bench.disagreements)]
    parts.append("\n".join(f"- {note}" for note in bench.notes))
    return "\n\n".join(parts)


def write_bench(bench: Bench, text: str, folder: Path) -> None:
    """bench.json with everything, bench.csv with the rates, bench.md."""
    rows = [
        {
            "what": rate.what, "precision": rate.precision, "threads": rate.threads, "devices": rate.devices,
            "scenarios": rate.scenarios, "repetitions": len(rate.seconds), "first_call_s": rate.first_call_s,
            "median_million_per_s": rate.median_rate, "best_million_per_s": rate.best_rate,
        }
        for rate in bench.rates
    ]  # fmt: skip
    files = {
        "bench.json": json.dumps(bench.as_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        "bench.csv": pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"),
        "bench.md": text + "\n",
    }
    write_texts(files, folder)


def write_texts(files: dict[str, str], folder: Path) -> None:
    """Files by name, each whole or not at all; an `InputError` where the folder cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            write_whole(folder / name, content)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{folder}: the results cannot be written ({reason}).") from None


def _machine_text(bench: Bench) -> str:
    m = bench.machine
    loads = [m["load_average"], m["load_average_after"]]
    load = "" if None in loads else f", load average {loads[0][0]} before and {loads[1][0]} after"
    options = ", ".join(f"{name}={value}" for name, value in m["compiler_options"].items()) or "none"
    versions = ", ".join(f"{name} {version}" for name, version in m["versions"].items())
    memory = "" if m["memory_gb"] is None else f", {m['memory_gb']} GB"
    return (
        f"{m['processor']} ({m['instruction_set']}), cores: {m['cores']}{memory}, {m['system']}{load}. "
        f"{versions}; {m['blas']}; backend {m['backend']}, devices: {m['devices']}, compiler options: {options}."
    )


def _rates(rates: tuple[Rate, ...]) -> str:
    rows = [
        (
            rate.what, rate.precision, rate.threads, rate.devices or "-", f"{rate.scenarios:,}", len(rate.seconds),
            "-" if rate.first_call_s is None else f"{rate.first_call_s:.2f}", f"{rate.median_rate:.3g}",
            f"{rate.best_rate:.3g}",
        )
        for rate in rates
    ]  # fmt: skip
    head = (
        "what", "precision", "threads", "devices", "scenarios", "repetitions", "first call [s]", "median [M/s]",
        "best [M/s]",
    )  # fmt: skip
    return markdown_table(head, rows)


def _ratios(ratios: tuple[Ratio, ...]) -> str:
    rows = [(r.what, r.precision, r.to, f"{r.median:.3g}", f"{r.low:.3g} to {r.high:.3g}") for r in ratios]
    return markdown_table(("what", "precision", "compared with", "times as fast", "least to most"), rows)


def _differences(differences: tuple[Difference, ...]) -> str:
    rows = [
        (
            d.what, d.precision, d.method, d.quantity, f"{d.scenarios:,}", f"{d.median_m:.2g}",
            f"{d.largest_m:.2g}", d.availability_differs,
        )
        for d in differences
    ]  # fmt: skip
    head = (
        "what", "precision", "method", "quantity", "observations", "median [m]", "largest [m]",
        "solution in one alone",
    )  # fmt: skip
    return markdown_table(head, rows)


def _events(rates: tuple[EventRate, ...], disagreements: tuple[Disagreement, ...]) -> str:
    precisions = list(dict.fromkeys(rate.precision for rate in rates))
    cells: dict[tuple[str, str], list[str]] = {}
    for rate in rates:
        told = rate_text(rate.count, rate.draws, rate.low, rate.high)
        cells.setdefault((rate.method, rate.event), []).append(told)
    draws = {rate.precision: rate.independent_draws for rate in rates}
    head = [f"{precision}, {draws[precision]:,} draws" for precision in precisions]
    for d in disagreements:
        told = rate_text(d.count, d.scenarios, d.low, d.high)
        cells[d.method, d.event].append(told if d.count == 0 else f"{d.count}: {told}")
    if disagreements:
        head.append(f"differs on the same {disagreements[0].scenarios:,}")
    return markdown_table(("method", "event", *head), [(*key, *found) for key, found in cells.items()])
