"""Checking an experiment before it runs: every error at once, with its field and line, and what a run will cost.

Costs are scenarios, time on this machine and memory; all but the number of scenarios is an estimate. Times come
from rates that were measured once, on two cores of an AMD EPYC, or are measured here when asked for.
"""

from __future__ import annotations

import re
import time
import tomllib
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from pl_mc.alert import as_limits, is_operation
from pl_mc.detectors.registry import detector
from pl_mc.engine import Execution, plan
from pl_mc.error_models import error_model
from pl_mc.experiments.loading import field_problems
from pl_mc.experiments.source_files import read_source
from pl_mc.faults import Faults, ramp_sizes_m
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Method, as_methods, method
from pl_mc.noise_models import noise_model
from pl_mc.runtime.progress import duration_text
from pl_mc.runtime.threads import cores
from pl_mc.studies.fault_fields import fields_of
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.registry import KINDS, in_todays_words, study_of, with_faults
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.study import Work
from pl_mc.studies.validation import FieldProblem, told_lines
from pl_mc.time_ramps.timing import sequential

_MAKERS = {"methods": method, "tests": detector, "noises": noise_model, "sequential": sequential}
_RAMP = ("start_m", "stop_m", "step_m")

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

# Processor time of start, figures and tables; of one method whose compiled program is kept; and of compiling it first.
START_S, PROGRAM_S, COMPILE_S = 4.0, 0.5, 3.0

# Peak of a sweep of 1e6 scenarios; of 1e8 it was 674 MB.
BASE_MEMORY_MB = 620.0

_STORED = "from rates measured on two cores of an AMD EPYC; another machine may be several times faster or slower"
_MEASURED = "from a rate measured here just now"


_MOST_LINES = 2_000


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: its field, the line of the file unless unknown, and why."""

    field: str
    line: int | None
    reason: str


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
        return f"{number}about {duration_text(self.seconds)}, {memory}. Estimated {self.source}."


@dataclass(frozen=True)
class Checked:
    """What a check found.

    Attributes:
        name: name of the experiment.
        file: the file's name.
        problems: everything that is wrong, in the order of the file.
        experiment: the record, unless something is wrong.
        cost: what a run will cost, unless something is wrong.
    """

    name: str
    file: str
    problems: tuple[Problem, ...]
    experiment: Experiment | None
    cost: Cost | None

    def text(self) -> str:
        """One line for each problem, ``file:line: field: reason``."""
        return told_lines(
            [
                f"{self.file}{f':{one.line}' if one.line else ''}: {f'{one.field}: ' if one.field else ''}{one.reason}"
                for one in self.problems
            ]
        )


def check_experiment(
    which: str, overrides: Mapping[str, Any] | None = None, *, faults: Sequence[str] = (), measure: bool = False
) -> Checked:
    """Check an experiment without running it.

    Args:
        which, overrides, faults: as for `pl_mc.experiments.loading.load_experiment`.
        measure: measure the rate of this machine, see `cost_of`.

    Raises:
        InputError: no such experiment, or a file that cannot be read.
    """
    source = read_source(which)
    content = in_todays_words({**source.content, **(overrides or {})})
    if faults:
        content = with_faults(content, faults)
    # A record names a wrong part as a whole, what follows names it within; each once.
    wrong = list(dict.fromkeys([*field_problems(content), *_further_problems(content)]))
    experiment, cost = None, None
    if not wrong:
        experiment = KINDS[content["kind"]].model.model_validate(content)
        try:
            cost = cost_of(experiment, measure=measure)
        except InputError as error:
            wrong, experiment = [_as_problem(error, "")], None
    # Reading a file again for each of its lines is for files that a person wrote.
    lines = field_lines(source.text) if wrong and source.text.count("\n") < _MOST_LINES else {}
    problems = [Problem(each.field, _line(each.field, lines), each.reason) for each in wrong]
    problems.sort(key=lambda problem: problem.line or 0)
    return Checked(source.name, source.path.name, tuple(problems), experiment, cost)


def field_lines(text: str) -> dict[str, int]:
    """The line, from 1, on which each field and table of a TOML file begins, by its path, ``methods.0.name``."""
    rows, lines, begin = text.split("\n"), dict[str, int](), 0
    for end, row in enumerate(rows):
        if begin == end and not row.partition("#")[0].strip():
            begin += 1
            continue
        try:
            content = tomllib.loads("\n".join(rows[: end + 1]))
        except tomllib.TOMLDecodeError:
            # Within an array or a text of several lines.
            continue
        for path in _paths(content):
            lines.setdefault(path, begin + 1)
        begin = end + 1
    return lines


def _paths(content: Any, prefix: str = "") -> Iterator[str]:
    """All fields and tables by their path; of lists the tables in them."""
    if isinstance(content, list):
        content = {k: value for k, value in enumerate(content) if isinstance(value, dict)}
    for key, value in content.items() if isinstance(content, dict) else ():
        yield f"{prefix}{key}"
        yield from _paths(value, f"{prefix}{key}.")


def _line(field: str, lines: Mapping[str, int]) -> int | None:
    """The line of a field, or of the nearest table or field that holds it."""
    while field and field not in lines:
        field = field.rpartition(".")[0]
    return lines.get(field)


def _further_problems(content: Mapping[str, Any]) -> Iterator[FieldProblem]:
    """What a record cannot tell alone: unknown methods, places, satellites; parts wrong otherwise are left."""
    if content.get("kind") not in KINDS:
        return
    for field, make in _MAKERS.items():
        yield from _named(content.get(field), field, make)
    yield from _named([content.get("noise")], "noise", noise_model)
    equal = content.get("equal")
    if isinstance(equal, Mapping):
        yield from _named(equal.get("methods"), "equal.methods", method)
    if isinstance(content.get("alert"), str):
        yield from _tried("alert", lambda: as_limits(content["alert"]))
    geometry: Geometry | None = None
    for part in ("geometry", "source"):
        given = content.get(part)
        if isinstance(given, Mapping):
            yield from _error_model(part, given)
            geometry = yield from _simulated(part, given)
    sizes = content.get("faults")
    if isinstance(sizes, Mapping) and all(isinstance(sizes.get(field), int | float) for field in _RAMP):
        yield from _tried("faults", lambda: ramp_sizes_m(*(sizes[field] for field in _RAMP)))
    if field_problems(content):
        return
    record = KINDS[content["kind"]].model.model_validate(content)
    # Whatever the kind's own record can be asked for: files, faults, satellites.
    if callable(files := getattr(getattr(record, "source", None), "files", None)):
        yield from _tried("source", files)
    faults = getattr(record, "faults", None)
    build = getattr(faults, "build", None)
    if geometry is not None and callable(build):
        own = set(fields_of(faults))
        where = "faults.biases" if "biases" in own else "faults"
        yield from _tried(where, lambda: build(geometry), own - {"biases"})
    if not isinstance(record.alert, str) or is_operation(record.alert):
        yield from _tried("alert", record.alert_limits)
    if geometry is not None and not list(_named(content.get("methods"), "methods", method)):
        yield from _tried("methods", lambda: as_methods(record.method_records(), geometry))
    for field, act in study_of(record).checks(record, geometry):
        yield from _tried(field, act)


def _named(given: Any, field: str, make: Callable[..., Any]) -> Iterator[FieldProblem]:
    """Methods or tests one by one, as far as each is a table with a name."""
    # A word alone is a name without options, in a list or by itself.
    given = [given] if isinstance(given, str) else given
    if not isinstance(given, Sequence):
        return
    seen: list[str] = []
    for k, one in enumerate({"name": one} if isinstance(one, str) else one for one in given):
        if isinstance(one, Mapping) and isinstance(one.get("name"), str):
            options = {key: value for key, value in one.items() if key != "name"}
            path = field if field == "noise" else f"{field}.{k}"
            try:
                name = make(one["name"], **options).name
            except InputError as error:
                yield _as_problem(error, path)
            except TypeError as error:
                yield FieldProblem(path, f"an option cannot be used ({error}).")
            else:
                if name in seen:
                    yield FieldProblem(path, f"{name} is asked for twice.")
                seen.append(name)


def _error_model(part: str, given: Mapping[str, Any]) -> Iterator[FieldProblem]:
    name, options = given.get("error_model", "residual"), given.get("error_options", {})
    if isinstance(name, str) and isinstance(options, Mapping):
        yield from _tried(f"{part}.error_model", lambda: error_model(name, **options))


def _simulated(part: str, given: Mapping[str, Any]) -> Generator[FieldProblem, None, Geometry | None]:
    """The geometry of a part that simulates one, unless something is wrong with it.

    A wrong field is named and left out, so that the next one can be found.
    """
    if given.get("kind", "site") != "site" or not set(given) & set(SimulatedGeometry.model_fields):
        return None
    fields = {key: value for key, value in given.items() if key in SimulatedGeometry.model_fields}
    sound = not list(_error_model(part, given))
    if not sound:
        fields = {key: value for key, value in fields.items() if not key.startswith("error_")}
    while True:
        try:
            g = SimulatedGeometry.model_validate(fields).build()
        except ValidationError as error:
            # The part's own record has said this already.
            wrong = {str(item["loc"][0]) for item in error.errors() if item["loc"]} & set(fields)
        except InputError as error:
            problem = _as_problem(error, part, SimulatedGeometry.model_fields)
            yield problem
            wrong = {problem.field.rpartition(".")[2]} & set(fields)
        else:
            return g if sound else None
        sound = False
        if not wrong:
            return None
        fields = {key: value for key, value in fields.items() if key not in wrong}


def _tried(field: str, act: Callable[[], Any], inner: Collection[str] = ()) -> Iterator[FieldProblem]:
    try:
        act()
    except InputError as error:
        yield _as_problem(error, field, inner)


def _as_problem(error: InputError, field: str, inner: Collection[str] = ()) -> FieldProblem:
    """An error as a problem of a field, or of one of its ``inner`` fields where its sentence begins with it."""
    head, _, rest = str(error).partition(": ")
    # The singular of a list, "satellite" of "satellites", or the sort of what a table makes, "method" of "methods.0".
    parts = field.split(".")
    if rest and (head == field or head in parts or f"{head}s" in parts):
        return FieldProblem(field, rest)
    if rest and head in inner:
        return FieldProblem(f"{field}.{head}", rest)
    if rest and (head.startswith(f"{field}.") if field else re.fullmatch(r"[a-z_.0-9]+", head)):
        return FieldProblem(head, rest)
    return FieldProblem(field, str(error))


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
    source = _because(_STORED, _first(1), work.remark)
    return Cost(work.scenarios, START_S + PROGRAM_S + work.seconds, BASE_MEMORY_MB, source)


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
        return Cost(scenarios, seconds, memory, _because(_MEASURED, beside.remark))
    gain = SINGLE_PRECISION_GAIN if experiment.precision == "float32" else 1.0
    bases = [[one.name.split("(")[0] for one in methods] for methods in own]
    strange = sorted({base for names in bases for base in names} - set(SCENARIOS_PER_CORE_S))
    rate = SCENARIOS_PER_CORE_S | dict.fromkeys(strange, min(SCENARIOS_PER_CORE_S.values()))
    work = sum(number * sum(1.0 / rate[base] for base in names) for number, names in zip(cases, bases, strict=True))
    taken = f"{', '.join(strange)} taken as fast as the slowest known" if strange else ""
    programs = sum(map(len, own))
    seconds = START_S + PROGRAM_S * programs + work / gain / cores() + beside.seconds
    return Cost(scenarios, seconds, memory, _because(_STORED, _first(programs), taken, beside.remark))


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


def _first(programs: int) -> str:
    """What compiling costs beside; each of ``programs`` is kept for the next run."""
    return f"the first run compiles and takes about {duration_text(COMPILE_S * programs)} more"


def _because(*remarks: str) -> str:
    return "; ".join(filter(None, remarks))
