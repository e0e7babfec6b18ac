"""What a word of tables, files and pages means: events and their columns, fields of experiments, options of methods.

The words are those of the records themselves, from which templates, pages and refusals take them too.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from pl_mc.alert import OPERATIONS
from pl_mc.detectors.registry import DETECTORS
from pl_mc.error_models.registry import ERROR_MODELS
from pl_mc.experiments.field_meanings import first_sentence, meaning, rule
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.methods.registry import METHODS
from pl_mc.noise_models.registry import NOISE_MODELS
from pl_mc.report.columns import LITERATURE, bounded, column_meaning, named_columns
from pl_mc.studies.registry import KINDS
from pl_mc.time_ramps.timing import SEQUENTIAL

# Quantities of the field.
_TERMS = {
    "VAL": "vertical alert limit, the vertical error that an operation tolerates without an alarm",
    "HAL": "horizontal alert limit, the horizontal error that an operation tolerates without an alarm",
    "limit": "alert limit, VAL or HAL",
    "level": "protection level, VPL or HPL: what a method says that its error is within",
    "VPL": "vertical protection level; the column is vpl_m",
    "HPL": "horizontal protection level; the column is hpl_m",
    "VPL_R": "vertical protection level of the IGG-III estimate (Zhao et al. 2021, eqs 17-19)",
}


def explain(word: str) -> list[str]:
    """Sentences about a word, each beginning with what it is; capital letters do not matter, a blank is an underscore.

    Raises:
        InputError: a word that nothing is called by.
    """
    known = _sentences()
    asked = word.strip().casefold()
    asked = asked if asked in known else "_".join(asked.split())
    if asked in known:
        return list(known[asked])
    if not (text := column_meaning(asked)):
        raise InputError(
            f"explain: {shown(word)} is no event, term, column, field, method or option ({nearest(word, known)})."
        )
    return [f"column: {text}.", *(explain(of) if (of := bounded(asked)) else ())]


@functools.cache
def _sentences() -> dict[str, list[str]]:
    """The sentences about each word."""
    found: dict[str, dict[tuple[str, str], list[str]]] = {}
    for name, sort, owner, text in _words():
        found.setdefault(name.casefold(), {}).setdefault((sort, text), []).append(owner)
    return {name: [_said(*key, owners) for key, owners in of.items()] for name, of in found.items()}


def _said(sort: str, text: str, owners: list[str]) -> str:
    """``option of methods (ls, igg3): ...``; what many have alike is said once."""
    names = ", ".join(dict.fromkeys(filter(None, owners)))
    return f"{sort} ({names}): {text}." if names else f"{sort}: {text}."


def _words() -> Iterator[tuple[str, str, str, str]]:
    """Every word, with what it is, whose it is, and what it means."""
    for event in (*EVENTS, *EXCLUSIONS):
        short, name = LITERATURE.get(event.name, ("", ""))
        also = f"; {name} ({short}) in the literature" if short else ""
        for word in filter(None, (event.name, short)):
            yield word, f"event {event.name}", "", f"{event.meaning}{also}"
    for term, text in _TERMS.items():
        yield term, "term", "", text
    for name, limits in OPERATIONS.items():
        given = ((limits.vertical_m, "VAL"), (limits.horizontal_m, "HAL"))
        yield name, "operation", "", ", ".join(f"{what} {value:g} m" for value, what in given if value is not None)
    sorts: tuple[tuple[str, Mapping[str, Any]], ...] = (
        ("method", METHODS), ("test", DETECTORS | SEQUENTIAL), ("noise model", NOISE_MODELS),
        ("error model", ERROR_MODELS),
    )  # fmt: skip
    for sort, registry in sorts:
        for name, cls in registry.items():
            yield name, sort, "", first_sentence(cls)
            if dataclasses.is_dataclass(cls):
                for option in dataclasses.fields(cls):
                    if text := meaning(typing.cast(type, cls), option.name):
                        yield option.name, f"option of {sort}s", name, text
    for kind, study in KINDS.items():
        yield kind, "kind of experiment", "", first_sentence(study.model)
        yield from _fields(study.model, kind)
    for column in named_columns():
        yield column, "column", "", column_meaning(column)


def _fields(record: type[BaseModel], kind: str, above: str = "") -> Iterator[tuple[str, str, str, str]]:
    """The fields of a record and of the records in it."""
    for field, info in record.model_fields.items():
        path, text, allowed = f"{above}{field}", meaning(record, field), rule(info)
        if text:
            yield field, f"field {path}", kind, f"{text}{f' ({allowed})' if allowed else ''}"
        for inner in _records(info.annotation):
            yield from _fields(inner, kind, f"{path}.")


def _records(annotation: Any) -> Iterator[type[BaseModel]]:
    """The records that a field may hold."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from _records(part)
