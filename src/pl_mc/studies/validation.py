"""Fields of an experiment held against its record: every wrong one, with the nearest valid name."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.report.run_folder import flat_fields
from pl_mc.studies.spec import Experiment

# So many problems are told, and so many more counted.
MOST_TOLD = 50


@dataclass(frozen=True)
class FieldProblem:
    """A field that cannot be used: its path, ``geometry.epochs``, and why, a sentence without the path."""

    field: str
    reason: str


def validated(model: type[Experiment], content: Mapping[str, Any], *, source: str) -> Experiment:
    """The record of an experiment's fields; an `InputError` names every wrong one."""
    problems = problems_of(model, content)
    if problems:
        raise InputError(told_lines([f"{source}: {problem.field}: {problem.reason}" for problem in problems]))
    return model.model_validate(content)


def told_lines(lines: Sequence[str]) -> str:
    """A line for each problem, as many as anyone reads."""
    more = [f"And {len(lines) - MOST_TOLD} more."] if len(lines) > MOST_TOLD else []
    return "\n".join([*lines[:MOST_TOLD], *more])


def problems_of(model: type[BaseModel], content: Mapping[str, Any]) -> list[FieldProblem]:
    """Every field that its record refuses, as far as the record alone can tell."""
    problems = [
        FieldProblem(path, f"a finite number is needed, not {value}.")
        for path, value in flat_fields(content).items()
        for one in (value if isinstance(value, list | tuple) else (value,))
        if isinstance(one, float) and not math.isfinite(one)
    ]
    try:
        model.model_validate(content)
    except ValidationError as error:
        named = {one.field for one in problems}
        # What is close to a wrong name is searched for, which takes its time.
        found = error.errors(include_url=False, include_context=False)
        # A list is not too short because its entries are wrong.
        inner = {item["loc"][:k] for item in found for k in range(len(item["loc"]))}
        found = [item for item in found if not (item["type"] == "too_short" and item["loc"] in inner)]
        problems += [one for item in found[: 4 * MOST_TOLD] if (one := _problem(model, item)).field not in named]
        problems += [FieldProblem("", "it is wrong too.")] * max(0, len(found) - 4 * MOST_TOLD)
    return problems


def _problem(model: type[BaseModel], error: Mapping[str, Any]) -> FieldProblem:
    # Capitalised parts are the forms that a field may take, not names in the file.
    names = [str(part) for part in error["loc"][:-1] if not str(part)[:1].isupper()]
    last = str(error["loc"][-1]) if error["loc"] else ""
    if error["type"] == "extra_forbidden" or not last[:1].isupper():
        names.append(last)
    field = ".".join(name if len(name) <= 60 else f"{name[:60]}..." for name in names)
    if error["type"] == "extra_forbidden":
        if field == "axes":
            # A field of other kinds, and no slip.
            judged = "by the vertical limit, or by limits that it names itself; leave the field out"
            return FieldProblem(field, f"an experiment of this kind judges {judged}.")
        owners = _models_at(model, names[:-1])
        valid = [name for owner in owners for name in owner.model_fields]
        return FieldProblem(field, f"there is no such field ({nearest(str(error['loc'][-1]), valid)}).")
    message = error["msg"].removeprefix("Value error, ").rstrip(".")
    given = "" if error["type"] in ("missing", "axes") else f", not {shown(error['input'])}"
    return FieldProblem(field, f"{message[:1].lower()}{message[1:]}{given}.")


def _models_at(model: type[BaseModel], path: list[str]) -> list[type[BaseModel]]:
    """The records that may stand at a path of field names."""
    found = [model]
    for part in path:
        if part.isdigit():
            continue
        annotations = [owner.model_fields[part].annotation for owner in found if part in owner.model_fields]
        found = [inner for annotation in annotations for inner in _models_in(annotation)]
    return found


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return [annotation] if issubclass(annotation, BaseModel) else []
    return [inner for argument in typing.get_args(annotation) for inner in _models_in(argument)]
