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
from pl_mc.studies.registry import KINDS
from pl_mc.time_ramps.timing import SEQUENTIAL

# What the literature calls two of the events.
_LITERATURE = {"misleading": ("MI", "misleading information"), "missed": ("HMI", "hazardously misleading information")}
_BOUNDS = {"_low": "lower", "_high": "upper"}
# What has bounds, beside rates.
_BOUNDED = ("k_50",)

# Quantities of the field, and columns that no record has a line for.
_TERMS = {
    "VAL": "vertical alert limit, the vertical error that an operation tolerates without an alarm",
    "HAL": "horizontal alert limit, the horizontal error that an operation tolerates without an alarm",
    "limit": "alert limit, VAL or HAL",
    "level": "protection level, VPL or HPL: what a method says that its error is within",
    "VPL": "vertical protection level; the column is vpl_m",
    "HPL": "horizontal protection level; the column is hpl_m",
    "VPL_R": "vertical protection level of the IGG-III estimate (Zhao et al. 2021, eqs 17-19)",
    "vpl_m": "vertical protection level [m]; missing where there is no solution",
    "hpl_m": "horizontal protection level [m]; missing where there is no solution",
    "east_m": "east error of the position [m]",
    "north_m": "north error of the position [m]",
    "up_m": "up error of the position [m]",
    "fault": "the fault's label, as --fault takes it",
    "bias_m": "bias of a fault on one satellite [m]; 0 without a fault, missing for several satellites",
    "k_50": "median over geometries of the multiplier that keeps the budget, k_50_low and k_50_high that of its bounds",
    "k_99": "multiplier that is enough at 99 % of the geometries",
    "level_mean_m": "mean protection level without a fault, over the geometries [m]",
    "kept": "geometries at which the budget is kept",
    "discontinuity": "alarms of an approach: of its independent samples without a fault, and the prior of each "
    "satellite times the alarms under its worst size",
    "slope": "largest error of a fault per unit of its trace in the residuals, in sigma of the error",
}


def explain(word: str) -> list[str]:
    """Sentences about a word, each beginning with what it is; capital letters do not matter, a blank is an underscore.

    Raises:
        InputError: a word that nothing is called by.
    """
    known = _sentences()
    asked = word.strip().casefold()
    asked = asked if asked in known else "_".join(asked.split())
    for ending, which in _BOUNDS.items():
        base = asked.removesuffix(ending)
        if asked not in known and base != asked:
            rate = base if base in _BOUNDED else f"{base}_rate"
            if rate in known:
                of = f"the rate of {base}" if f"{base}_rate" in known else base
                return [f"column: {which} end of the 95 % interval of {of}.", *known[rate]]
    if asked not in known:
        raise InputError(f"explain: {shown(word)} is no event, term, field, method or option ({nearest(word, known)}).")
    return list(known[asked])


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
        short, name = _LITERATURE.get(event.name, ("", ""))
        also = f"; {name} ({short}) in the literature" if short else ""
        for word in filter(None, (event.name, short)):
            yield word, f"event {event.name}", "", f"{event.meaning}{also}"
        yield event.count, "column", "", f"draws with the event {event.name}, {event.meaning}"
        yield f"{event.name}_rate", "column", "", f"share of the draws with the event {event.name}, {event.meaning}"
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
