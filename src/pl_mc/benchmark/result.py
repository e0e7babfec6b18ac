"""What a benchmark measures, and how much of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from pl_mc.benchmark.accuracy import Difference, Disagreement, EventRate
from pl_mc.benchmark.measure import Rate, Ratio
from pl_mc.input_errors import InputError, require_positive, require_whole


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
    """

    seconds: float = 10.0
    repetitions: int = 5
    draws: int | None = None
    accuracy_scenarios: int = 20_000
    limit_scenarios: int = 2**18

    def __post_init__(self) -> None:
        require_positive(self.seconds, field="seconds")
        require_whole(self.repetitions, field="repetitions", low=1)
        require_whole(self.accuracy_scenarios, field="accuracy_scenarios", low=1)
        if require_whole(self.limit_scenarios, field="limit_scenarios", low=16) % 16:
            raise InputError(f"limit_scenarios: a multiple of 16 is needed, not {self.limit_scenarios}.")


@dataclass(frozen=True)
class Bench:
    """What was measured.

    Attributes:
        machine: processor, cores, versions, load average before and after.
        problem: what was computed.
        sizes: how much of it.
        rates: one for each computation.
        ratios: of the sweeps to the others, round by round.
        differences: against the NumPy form, on the same observations.
        disagreements: decisions that single precision changes, on the same observations.
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
