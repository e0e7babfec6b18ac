"""Checking an experiment before it runs: every error at once, with its field and line, and what a run will cost."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from pl_mc.alert import BY_NAME
from pl_mc.detectors.registry import detector
from pl_mc.error_models import error_model
from pl_mc.experiments.cost import Cost, cost_of
from pl_mc.experiments.loading import field_problems, read_source
from pl_mc.faults import ramp_sizes_m
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.methods import method
from pl_mc.noise_models import noise_model
from pl_mc.studies.registry import KINDS, in_todays_words, study_of
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.validation import FieldProblem
from pl_mc.time_ramps.timing import sequential

_HEADING = re.compile(r"^\s*(\[{1,2})\s*([^\[\]]+?)\s*\]{1,2}\s*(?:#.*)?$")
_FIELD = re.compile(r"^\s*((?:[\w-]+|\"[^\"]*\")(?:\s*\.\s*(?:[\w-]+|\"[^\"]*\"))*)\s*=")

_RAMP = ("start_m", "stop_m", "step_m")


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: its field, the line of the file unless unknown, and why."""

    field: str
    line: int | None
    reason: str


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
        return "\n".join(
            f"{self.file}{f':{one.line}' if one.line else ''}: {f'{one.field}: ' if one.field else ''}{one.reason}"
            for one in self.problems
        )


def check_experiment(which: str, overrides: Mapping[str, Any] | None = None, *, measure: bool = False) -> Checked:
    """Check an experiment without running it.

    Args:
        which, overrides: as for `pl_mc.experiments.loading.load_experiment`.
        measure: measure the rate of this machine, see `cost_of`.

    Raises:
        InputError: no such experiment, or a file that cannot be read.
    """
    source = read_source(which)
    content = in_todays_words({**source.content, **(overrides or {})})
    # A record names a wrong part as a whole, what follows names it within; each once.
    wrong = list(dict.fromkeys([*field_problems(content), *_further_problems(content)]))
    experiment, cost = None, None
    if not wrong:
        experiment = KINDS[content["kind"]].model.model_validate(content)
        try:
            cost = cost_of(experiment, measure=measure)
        except InputError as error:
            wrong.append(_as_problem(error, ""))
    lines = field_lines(source.text)
    problems = [Problem(each.field, _line(each.field, lines), each.reason) for each in wrong]
    return Checked(
        name=source.name,
        file=source.path.name,
        problems=tuple(sorted(problems, key=lambda problem: problem.line or 0)),
        experiment=None if problems else experiment,
        cost=None if problems else cost,
    )


def field_lines(text: str) -> dict[str, int]:
    """The line, from 1, on which each field and table of a TOML file begins, by its path, ``methods.0.name``."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix, depth, quoted = "", 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        # Within an array or a text of several lines there are no fields to find.
        if quoted:
            quoted = "" if quoted in line else quoted
            continue
        if depth == 0:
            heading, field = _HEADING.match(line), _FIELD.match(line)
            if heading:
                path = _path(heading[2], counts)
                if heading[1] == "[[":
                    counts[path] = counts.get(path, -1) + 1
                    path = f"{path}.{counts[path]}"
                prefix = f"{path}."
                lines.setdefault(path, number)
                lines.setdefault(path.rsplit(".", 1)[0], number)
                continue
            if field:
                lines.setdefault(prefix + _path(field[1], {}), number)
        bare = re.sub(r"#.*$", "", re.sub(r"\"(?:[^\"\\]|\\.)*\"|'[^']*'", "", line))
        quoted = next((mark for mark in ('"""', "'''") if line.count(mark) % 2), "")
        depth = max(0, depth + bare.count("[") + bare.count("{") - bare.count("]") - bare.count("}"))
    return lines


def _path(text: str, counts: Mapping[str, int]) -> str:
    """A dotted key without blanks and quotes; parts that are arrays of tables get the place of the last table."""
    path = ""
    parts = [part.strip().strip('"') for part in text.split(".")]
    for k, part in enumerate(parts):
        path = f"{path}.{part}" if path else part
        if k < len(parts) - 1 and path in counts:
            path = f"{path}.{counts[path]}"
    return path


def _line(field: str, lines: Mapping[str, int]) -> int | None:
    """The line of a field, or of the nearest table or field that holds it."""
    while field:
        if field in lines:
            return lines[field]
        field = field.rpartition(".")[0]
    return None


def _further_problems(content: Mapping[str, Any]) -> Iterator[FieldProblem]:
    """What a record cannot tell alone: unknown methods, places, satellites; parts wrong otherwise are left."""
    if content.get("kind") not in KINDS:
        return
    yield from _named(content.get("methods"), "methods", method)
    yield from _named(content.get("tests"), "tests", detector)
    yield from _named(content.get("noises"), "noises", noise_model)
    yield from _named([content.get("noise")], "noise", noise_model)
    yield from _named(content.get("sequential"), "sequential", sequential)
    equal = content.get("equal")
    if isinstance(equal, Mapping):
        yield from _named(equal.get("methods"), "equal.methods", method)
    if isinstance(content.get("alert"), str):
        yield from _tried("alert", lambda: require_choice(content["alert"], BY_NAME, field="alert"))
    geometry: Geometry | None = None
    for part in ("geometry", "source"):
        given = content.get(part)
        if isinstance(given, Mapping):
            yield from _error_model(part, given)
            geometry = yield from _simulated(part, given)
    sizes = content.get("faults")
    if isinstance(sizes, Mapping) and all(isinstance(sizes.get(field), int | float) for field in _RAMP):
        yield from _tried("faults", lambda: ramp_sizes_m(*(float(sizes[field]) for field in _RAMP)))
    if field_problems(content):
        return
    record = KINDS[content["kind"]].model.model_validate(content)
    # Whatever the kind's own record can be asked for: files, faults, satellites.
    files = getattr(getattr(record, "source", None), "files", None)
    if callable(files):
        yield from _tried("source", files)
    if geometry is not None:
        build = getattr(getattr(record, "faults", None), "build", None)
        if callable(build):
            yield from _tried("faults", lambda: build(geometry))
    for field, act in study_of(record).checks(record, geometry):
        yield from _tried(field, act)


def _named(given: Any, field: str, make: Callable[..., Any]) -> Iterator[FieldProblem]:
    """Methods or tests one by one, as far as each is a table with a name."""
    if not isinstance(given, Sequence) or isinstance(given, str):
        return
    seen: list[str] = []
    for k, one in enumerate(given):
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
        field = f"{part}.error_model" if part else "error_model"
        yield from _tried(field, lambda: error_model(name, **options))


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
    if rest and head in (field, field.rpartition(".")[2]):
        return FieldProblem(field, rest)
    if rest and head in inner:
        return FieldProblem(f"{field}.{head}", rest)
    if rest and (head.startswith(f"{field}.") if field else re.fullmatch(r"[a-z_.0-9]+", head)):
        return FieldProblem(head, rest)
    return FieldProblem(field, str(error))
