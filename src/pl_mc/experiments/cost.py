"""What a run will cost: scenarios, time on this machine, memory. All but the number of scenarios is an estimate.

Times come from rates that were measured once, on two cores of an AMD EPYC, or are measured here when asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pl_mc.engine import Execution, plan
from pl_mc.engine.noise import LANES
from pl_mc.faults import Faults, ramps
from pl_mc.geometry import Geometry
from pl_mc.integrity_risk.rare.exposure import samples_of
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, levels_from_geometry
from pl_mc.runtime.threads import cores
from pl_mc.service.grid import world_grid
from pl_mc.service.volume import require_epochs
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.registry import KINDS
from pl_mc.studies.spec import Experiment

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

# Kinds that are no sweeps: units of work a second on two cores, from the seconds in the manifests of shipped
# experiments.
UNITS_PER_S = {
    "guo": 1.7e6,
    "readings": 3.1e4,
    "risk": 0.25,
    "series": 1.05e5,
    "service": 4.8e5,
    "stanford": 3.4e5,
    "time-ramps": 2.0e6,
    "tuning": 6.0e5,
}

# Of the kind noise, besides its sweeps: exposures as timed alone, rare events by what they leave of the seconds in
# the manifest of the shipped experiment; of evaluations those that are allowed.
EXPOSURE_SAMPLES_PER_S, RARE_EVALUATIONS_PER_S = 2.0e6, 5.9e4

# Peak of a sweep of 1e6 scenarios; of 1e8 it was 674 MB.
BASE_MEMORY_MB = 620.0

_STORED = "from rates measured on two cores of an AMD EPYC; another machine may be several times faster or slower"
_MEASURED = "from a rate measured here just now"


@dataclass(frozen=True)
class Cost:
    """What a run will cost.

    Attributes:
        scenarios: cases of fault and noise, times methods; None where the kind has no such number.
        seconds: estimated time on this machine; None where it is not known.
        memory_mb: estimated memory [MB]; None where it is not known.
        source: how time and memory were estimated.
    """

    scenarios: int | None
    seconds: float | None
    memory_mb: float | None
    source: str

    def text(self) -> str:
        """The cost in a sentence or two."""
        number = "" if self.scenarios is None else f"{self.scenarios:,} scenarios over all methods, "
        if self.seconds is None:
            return f"{number}time and memory not known beforehand ({self.source})."
        memory = "" if self.memory_mb is None else f", about {self.memory_mb / 1000:.1f} GB of memory"
        return f"{number}about {_duration(self.seconds)}{memory}. Estimated {self.source}."


def cost_of(experiment: Experiment, *, measure: bool = False) -> Cost:
    """What a run of the experiment will cost.

    Args:
        experiment: a sound one.
        measure: run a small part of its first sweep twice, the second time against the clock; and of the first
            with other methods.

    Raises:
        InputError: what only its geometry or faults can tell is wrong with it.
    """
    kind = str(experiment.kind)  # type: ignore[attr-defined]
    sweeps, count = KINDS[kind].sweeps, _COUNTS.get(kind)
    if sweeps is not None and count is None:
        return _cost_of_sweeps(experiment, sweeps(experiment), measure=measure)
    if count is None:
        return Cost(None, None, None, "no rate is known for this kind")
    scenarios, units = count(experiment)
    # These rates are of two cores; what does not run in threads gains nothing from more of them.
    seconds = START_S + COMPILE_S + units / UNITS_PER_S[kind]
    return Cost(scenarios, seconds, BASE_MEMORY_MB, _STORED)


def _cost_of_sweeps(experiment: Experiment, planned: Sequence[PlannedSweep], *, measure: bool) -> Cost:
    # A sweep may have methods of its own.
    own = [one.methods_of(experiment) for one in planned]
    cases = [int(one.faults.applies(one.g).sum()) * one.draws for one in planned]
    scenarios = sum(number * len(methods) for number, methods in zip(cases, own, strict=True))
    arrays = sum(_bytes(one.g, one.faults) for one in planned) / 1e6
    memory = BASE_MEMORY_MB + 3.0 * arrays + 25.0 * max(0, max(map(len, own), default=0) - 2)
    beside, about = _beside_sweeps(experiment)
    if measure and scenarios:
        # Once for each set of methods.
        rates: dict[tuple[Method, ...], tuple[float, float]] = {}
        for one, methods in zip(planned, own, strict=True):
            if methods not in rates:
                rates[methods] = _measured(experiment, one)
        work = sum(number * rates[methods][0] for number, methods in zip(cases, own, strict=True))
        seconds = START_S + sum(first for _, first in rates.values()) + work + beside
        return Cost(scenarios, seconds, memory, _MEASURED + about)
    slowest = min(SCENARIOS_PER_CORE_S.values())
    gain = SINGLE_PRECISION_GAIN if experiment.precision == "float32" else 1.0
    bases = [[one.name.split("(")[0] for one in methods] for methods in own]
    work = sum(
        number * sum(1.0 / SCENARIOS_PER_CORE_S.get(base, slowest) for base in names)
        for number, names in zip(cases, bases, strict=True)
    )
    strange = sorted({base for names in bases for base in names if base not in SCENARIOS_PER_CORE_S})
    taken = f"; {', '.join(strange)} taken as fast as the slowest known" if strange else ""
    seconds = START_S + COMPILE_S * sum(map(len, own)) + work / gain / cores() + beside
    return Cost(scenarios, seconds, memory, _STORED + taken + about)


def _beside_sweeps(experiment: Any) -> tuple[float, str]:
    """Seconds of what a kind does besides its sweeps, and words about it; only noise does much."""
    if experiment.kind != "noise":
        return 0.0, ""
    rare, given = experiment.rare, experiment.exposure
    estimates = len(experiment.noises) * len(set(rare.sizes_m)) * len(rare.methods)
    samples = samples_of(given.duration_s, given.interval_s) * given.draws
    solved = samples * len(set(given.sizes_m)) * len(set(given.taus_s)) * len(experiment.method_records())
    seconds = estimates * rare.max_evaluations / RARE_EVALUATIONS_PER_S + solved / EXPOSURE_SAMPLES_PER_S
    return seconds, f"; as if all {estimates} rare events had to be estimated, which only a run can tell"


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


def _stanford(experiment: Any) -> tuple[int, float]:
    g = experiment.geometry.build()
    cases = len(g.as_series())
    if experiment.faults is not None:
        sizes, names = experiment.faults, experiment.satellites or g.names
        faults = ramps(g, satellites=names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)
        cases = int(faults.applies(g).sum())
    scenarios = cases * experiment.draws * len(experiment.method_records())
    # The rate is of two methods, counted once.
    return scenarios, scenarios / 2


def _series(experiment: Any) -> tuple[int | None, float]:
    # Of a receiver's files the number of epochs is not known before they are read: a day of 30 s is taken.
    epochs = getattr(experiment.source, "epochs", None)
    solved = (epochs or 2880) * (experiment.redraws + 1) * len(experiment.method_records())
    return (solved if epochs else None), float(solved)


def _readings(experiment: Any) -> tuple[int | None, float]:
    parts = [_series(experiment.series(reading)) for reading in experiment.readings]
    numbers = [number for number, _ in parts if number is not None]
    return (sum(numbers) if len(numbers) == len(parts) else None), sum(units for _, units in parts)


def _guo(experiment: Any) -> tuple[int | None, float]:
    epochs = getattr(experiment.source, "epochs", None)
    a_day = experiment.draws * (len(experiment.biases_m) + 1) + 2 * experiment.calibration_draws
    curves = experiment.curves
    sizes = 1 + round((curves.stop_m - curves.start_m) / curves.step_m)
    # About 25 satellites are in view.
    one_epoch = 25 * sizes * curves.draws + 2 * curves.calibration_draws
    units = ((epochs or 2880) * a_day + one_epoch) * len(experiment.tests)
    return None, float(units)


def _time_ramps(experiment: Any) -> tuple[int | None, float]:
    """Epochs solved: passes of every rate and those of the calibration, by every test, at every correlation."""
    passes = len(experiment.rates_m_per_s) * experiment.draws + 2 * experiment.calibration_draws
    return None, float(len(experiment.taus_s) * passes * experiment.geometry.epochs * len(experiment.tests()))


def _service(experiment: Any) -> tuple[int, float]:
    """Solutions at all sites and epochs; one draw tells all of a method whose levels depend on geometry alone."""
    epochs = require_epochs(experiment.duration_s, experiment.step_s)
    draws = sum(1 if levels_from_geometry(one) else experiment.draws for one in experiment.method_records())
    scenarios = len(world_grid(experiment.step_deg)) * epochs * draws
    return scenarios, float(scenarios)


def _risk(experiment: Any) -> tuple[int | None, float]:
    """Estimates of rare events; least squares is exact and costs nothing beside them."""
    curves, worst, calibration = experiment.curves, experiment.worst, experiment.calibration
    estimated = sum(exact_law(method) is None for method in experiment.method_records())
    satellites = 16 if worst.estimated == ("all",) else len(worst.estimated)
    number = estimated * len(curves.satellites) * (len(curves.misleading_m) + len(curves.missed_m))
    number += estimated * satellites * len(worst.estimated_events)
    number += sum(1 + 16 * len(one.sizes_m) for one in experiment.budgets if one.method != "ls" and one.sizes_m)
    number += estimated * len(calibration.faults) * len(calibration.targets)
    return None, float(number)


def _tuning(experiment: Any) -> tuple[int | None, float]:
    """Scenarios of proposals, descents and judgements; rare targets take about half of what they may."""
    faults, number = len(experiment.faults), 0.0
    for target in experiment.targets:
        proposals = 4 * faults * 450_000
        descents = 4 * 15 * 4 * (faults + 1) * experiment.search_draws
        counted = target * experiment.draws >= 20
        judged = 4 * faults * (experiment.draws if counted else experiment.max_evaluations / 2)
        number += len(experiment.objectives) * (proposals + descents + judged)
    return None, number


_COUNTS: dict[str, Callable[[Any], tuple[int | None, float]]] = {
    "guo": _guo,
    "readings": _readings,
    "risk": _risk,
    "series": _series,
    "service": _service,
    "stanford": _stanford,
    "time-ramps": _time_ramps,
    "tuning": _tuning,
}


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
