"""Fields of an experiment against the record of its kind: every one that is wrong, in words for the person."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from pl_mc.input_errors import InputError, nearest
from pl_mc.report.run_folder import flat_fields

Record = TypeVar("Record", bound=BaseModel)


@dataclass(frozen=True)
class FieldProblem:
    """A field that cannot be used: its path, ``geometry.epochs``, and why, a sentence without the path."""

    field: str
    reason: str


def validated(model: type[Record], content: Mapping[str, Any], *, source: str) -> Record:
    """The record of these fields; an `InputError` names every wrong one."""
    refuse(record_problems(model, content), source=source)
    return model.model_validate(content)


def refuse(problems: Sequence[FieldProblem], *, source: str) -> None:
    """Raise an `InputError` that names every field, if there are any."""
    if problems:
        raise InputError("\n".join(f"{source}: {problem.field}: {problem.reason}" for problem in problems))


def record_problems(model: type[BaseModel], content: Mapping[str, Any]) -> list[FieldProblem]:
    """Every field that a record refuses."""
    problems = [
        FieldProblem(path, f"a finite number is needed, not {value}.")
        for path, value in flat_fields(content).items()
        for number in (value if isinstance(value, list | tuple) else (value,))
        if isinstance(number, float) and not math.isfinite(number)
    ]
    try:
        model.model_validate(content)
    except ValidationError as error:
        named = {problem.field for problem in problems}
        problems += [new for item in error.errors() if (new := _problem(model, item)).field not in named]
    return problems


def _problem(model: type[BaseModel], error: Mapping[str, Any]) -> FieldProblem:
    # Capitalised parts are the forms that a field may take, not names in the file.
    names = [str(part) for part in error["loc"][:-1] if not str(part)[:1].isupper()]
    last = str(error["loc"][-1]) if error["loc"] else ""
    if error["type"] == "extra_forbidden" or not last[:1].isupper():
        names.append(last)
    field = ".".join(names)
    if error["type"] == "extra_forbidden":
        owners = _models_at(model, names[:-1])
        valid = [name for owner in owners for name in owner.model_fields]
        return FieldProblem(field, f"there is no such field ({nearest(str(error['loc'][-1]), valid)}).")
    message = error["msg"].removeprefix("Value error, ").rstrip(".")
    given = "" if error["type"] == "missing" else f", not {error['input']!r}"
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
