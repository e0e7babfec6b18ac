"""What a run will cost: scenarios, time on this machine, memory. All but the number of scenarios is an estimate.

Times come from rates that were measured once, on two cores of an AMD EPYC, or are measured here when asked for.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pl_mc.engine import Execution, plan
from pl_mc.engine.noise import LANES
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.methods import Method
from pl_mc.runtime.threads import cores
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.registry import study_of
from pl_mc.studies.spec import Experiment
from pl_mc.studies.study import Work

# Scenarios a second of one core, method by method, for 16 satellites in double precision: processor time of
# sweeps of 256,000 scenarios. Methods that are not here are taken as the slowest that is.
SCENARIOS_PER_CORE_S = {
    "ls": 9.7e6,
    "igg3": 0.78e6,
    "igg3_gated": 0.67e6,
    "araim": 8.6e6,
    "huber": 0.8e6,
    "hampel": 0.8e6,
    "danish": 0.7e6,
    "l1": 0.2e6,
}
SINGLE_PRECISION_GAIN = 1.25

# Start, figures and tables; and the compilation of one method.
START_S, COMPILE_S = 5.0, 4.0

# Peak of a sweep of 1e6 scenarios; of 1e8 it was 674 MB.
BASE_MEMORY_MB = 620.0

_STORED = "from rates measured on two cores of an AMD EPYC; another machine may be several times faster or slower"
_MEASURED = "from a rate measured here just now"


@dataclass(frozen=True)
class Cost:
    """What a run will cost.

    Attributes:
        scenarios: cases of fault and noise, times methods; None where the kind has no such number.
        seconds: estimated time on this machine.
        memory_mb: estimated memory [MB].
        source: how time and memory were estimated.
    """

    scenarios: int | None
    seconds: float
    memory_mb: float
    source: str

    def text(self) -> str:
        """The cost in a sentence or two."""
        number = "" if self.scenarios is None else f"{self.scenarios:,} scenarios over all methods, "
        memory = f"about {self.memory_mb / 1000:.1f} GB of memory"
        return f"{number}about {_duration(self.seconds)}, {memory}. Estimated {self.source}."


def cost_of(experiment: Experiment, *, measure: bool = False) -> Cost:
    """What a run of the experiment will cost.

    Args:
        experiment: a sound one.
        measure: run a small part of its first sweep twice, the second time against the clock; and of the first
            with other methods.

    Raises:
        InputError: what only its geometry or faults can tell is wrong with it.
    """
    study = study_of(experiment)
    if study.work is None:
        assert study.sweeps is not None
        beside = study.beside(experiment) if study.beside is not None else Work(None, 0.0)
        return _cost_of_sweeps(experiment, study.sweeps(experiment), beside, measure=measure)
    work = study.work(experiment)
    # These rates are of two cores; what does not run in threads gains nothing from more of them.
    return Cost(work.scenarios, START_S + COMPILE_S + work.seconds, BASE_MEMORY_MB, _STORED + _said(work.remark))


def _cost_of_sweeps(experiment: Experiment, planned: Sequence[Any], beside: Work, *, measure: bool) -> Cost:
    # A sweep may have methods of its own.
    own = [one.methods_of(experiment) for one in planned]
    cases = [int(one.faults.applies(one.g).sum()) * one.draws for one in planned]
    scenarios = sum(number * len(methods) for number, methods in zip(cases, own, strict=True))
    arrays = sum(_bytes(one.g, one.faults) for one in planned) / 1e6
    memory = BASE_MEMORY_MB + 3.0 * arrays + 25.0 * max(0, max(map(len, own), default=0) - 2)
    if measure and scenarios:
        # Once for each set of methods.
        rates: dict[tuple[Method, ...], tuple[float, float]] = {}
        for one, methods in zip(planned, own, strict=True):
            if methods not in rates:
                rates[methods] = _measured(experiment, one)
        work = sum(number * rates[methods][0] for number, methods in zip(cases, own, strict=True))
        seconds = START_S + sum(first for _, first in rates.values()) + work + beside.seconds
        return Cost(scenarios, seconds, memory, _MEASURED + _said(beside.remark))
    slowest = min(SCENARIOS_PER_CORE_S.values())
    gain = SINGLE_PRECISION_GAIN if experiment.precision == "float32" else 1.0
    bases = [[one.name.split("(")[0] for one in methods] for methods in own]
    work = sum(
        number * sum(1.0 / SCENARIOS_PER_CORE_S.get(base, slowest) for base in names)
        for number, names in zip(cases, bases, strict=True)
    )
    strange = sorted({base for names in bases for base in names if base not in SCENARIOS_PER_CORE_S})
    taken = f"; {', '.join(strange)} taken as fast as the slowest known" if strange else ""
    seconds = START_S + COMPILE_S * sum(map(len, own)) + work / gain / cores() + beside.seconds
    return Cost(scenarios, seconds, memory, _STORED + taken + _said(beside.remark))


def _measured(experiment: Experiment, planned: PlannedSweep) -> tuple[float, float]:
    """Seconds for a case by all methods, and seconds of the first call, which compiles; about one call's work."""
    width = int(planned.faults.applies(planned.g).sum(axis=1).max())
    blocks = max(1, plan.SCENARIOS_PER_CALL // (4 * max(1, width) * LANES))
    draws = min(planned.draws, blocks * LANES * cores())
    series = planned.g.as_series()
    first = int(np.flatnonzero(planned.faults.applies(planned.g).any(axis=1))[0])
    small = replace(planned, g=series[first : first + 1], draws=draws)
    times = []
    for _ in range(2):
        begin = time.perf_counter()
        small.run(experiment, Execution(progress=False))
        times.append(time.perf_counter() - begin)
    cases = int(small.faults.applies(small.g).sum()) * draws
    return times[1] / cases, times[0]


def _bytes(g: Geometry, faults: Faults) -> int:
    series = g.as_series()
    arrays = (series.design, series.sigma_m, series.in_view, series.satellite, faults.bias_m)
    # The index of faults by epoch is the largest of all in a map.
    return sum(array.nbytes for array in arrays) + 8 * len(series) * len(faults)


def _said(remark: str) -> str:
    return f"; {remark}" if remark else ""


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
