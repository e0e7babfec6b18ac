"""What the fields of experiment files mean, in the words of their records.

A field's description comes from its record: ``Field(description=...)``, or its line under ``Attributes:`` of the
record's docstring or of a parent's. Fields that many records share, or whose record says nothing, are described
here.
"""

from __future__ import annotations

import inspect
import re
import types
import typing
from typing import Any, Literal

from pydantic.fields import FieldInfo

SHARED: dict[str, str] = {
    "kind": "what sort of experiment this is",
    "title": "heading of the summary, the figures and the page",
    "methods": "methods to compare, each a table with a name and options of its own",
    "tests": "tests to compare, each a table with a name and options of its own",
    "name": "its name",
    "alert": "alert limits by operation: APV-I (vertical 50 m), LPV-200 (35 m), APV-II (20 m), CAT-I, CAT-II "
    "or CAT-IIIB; or {name = 'mine', vertical_m = 25, horizontal_m = 10}, or one of the two",
    "vertical_m": "vertical alert limit",
    "horizontal_m": "horizontal alert limit",
    "figures": "how figures are drawn and stored; no number depends on it",
    "seed": "chooses the noise; the same seed gives the same counts",
    "precision": "precision of the computation",
    "draws": "noise draws for each fault at each epoch",
    "geometry": "the satellites in view",
    "faults": "which satellites are biased, by how much",
    "source": "where the series of epochs comes from: a site, a flight or a receiver's files",
    "site": "a named place, such as CUT0 or JFNG, Earth-fixed X,Y,Z in metres, or latitude, longitude and height",
    "start": "GPS time of the first epoch",
    "epochs": "number of epochs",
    "interval_s": "time between epochs",
    "mask_deg": "elevation mask",
    "constellations": "nominal constellations: GPS, BDS-2, BDS-3, GAL; or ADD-24+24 alone",
    "without": "satellites that are switched off, by name",
    "error_model": "standard deviations of the pseudoranges: residual, none, uire, user, constant or dual_frequency",
    "error_options": "options of the error model, as an inline table; any model takes an ism",
    "epoch": "one epoch of the series, counted from 0; leave out for all of them",
    "observations": "RINEX 2 (GPS alone), 3 or 4 observation file, packed or not, or a list of them, in any order",
    "navigation": "RINEX 2, 3 or 4 navigation file with broadcast ephemerides of that day, or a list of them",
    "truth": "the true position, Earth-fixed X,Y,Z in metres, or a file with a track: CSV, .pos of RTKLIB, NMEA, UBX",
    "claims": "files in which a receiver says how good its positions are: .pos of RTKLIB, NMEA with GST, UBX, CSV",
    "ionex": "maps of the ionosphere, IONEX files, in place of the broadcast coefficients",
    "snr_dbhz": "least strength of a signal that is read",
    "residuals": "whether the errors of all satellites are stored, for pl_mc.fit_overbound and the noise empirical",
    "claim_multiplier": "what makes a claimed standard deviation a level; 6.18 and 5.33 unless given",
    "systems": "systems to use: G (GPS), C (BeiDou), E (Galileo), R (GLONASS), J (QZSS); the first three unless given",
    "signals": "other signals than L1 C/A, B1I and E1, such as L5; pairs such as E1+E5b where two are combined",
    "ionosphere": "broadcast (coefficients of the navigation files), none (its delay is left in), dual (two carriers)",
    "satellite": "name of the biased satellite",
    "otherwise": "what stands in for a satellite that is out of view: the one of its system with the median "
    "redundancy number",
    "biases": "faults one by one, each a table of biases by satellite or a text such as G01+G13:+30m, "
    "G15:+0.1m/s:100- or G:uniform(5,100)m independent; an empty table and none are the fault-free case",
    "start_m": "first bias",
    "stop_m": "last bias",
    "step_m": "step from bias to bias",
    "method": "the method's name",
    "event": "the event that counts",
    "p_sat": "prior probability of a satellite fault, one for all or by satellite",
    "p_const": "prior probability of a constellation fault, one for all or by constellation",
    "noise": "model of the noise, a table with a name and options of its own",
    "constellation": "whether the biases of a faulty constellation are independent or common",
    "pairs": "pairs of satellites that are computed, the most likely ones first, or all; the rest is bounded by "
    "its prior",
    "samples_per_approach": "independent samples of the noise in one approach",
    "target": "risk that is allowed per approach",
    "target_cov": "relative standard error at which an estimate stops",
    "max_evaluations": "evaluations at which an estimate stops at the latest",
    "variants": "the variants, each with what differs from the default",
    "budgets": "risk budgets over the fault modes",
}

# What a record says in passing, where the reader has the rest of it in view; alone it would say too little.
_START = "first solution: ls, or huber for five solutions with Huber's weights"
ALONE = {
    "Igg3.scale": "scale of the standardised residuals: posterior_floored, apriori, posterior, mad or mad_floored",
    "Igg3.start": _START,
    "GatedIgg3.start": _START,
}

_UNITS = (("_m", "m"), ("_s", "s"), ("_deg", "deg"))

# The names of an entry, and its text with the lines that are indented deeper.
_ENTRY = re.compile(r"^ {4}([a-z_0-9]+(?:, [a-z_0-9]+)*): (.*(?:\n(?: {5}.*)?)*)", re.MULTILINE)


def meaning(record: type, field: str) -> str:
    """What a field means, without a full stop; empty where nobody says."""
    info = getattr(record, "model_fields", {}).get(field)
    said = info.description if isinstance(info, FieldInfo) and info.description else None
    owners = record.__mro__
    alone = next((ALONE[key] for owner in owners if (key := f"{owner.__name__}.{field}") in ALONE), None)
    documented = (_attributes(owner.__dict__.get("__doc__") or "").get(field) for owner in owners)
    text = said or alone or next(filter(None, documented), None) or SHARED.get(field, "")
    # A rate names its own unit: m_per_s is not in seconds.
    rate = field.endswith("_per_s")
    unit = None if rate else next((unit for ending, unit in _UNITS if field.endswith(ending)), None)
    if text and unit and f"[{unit}" not in text and f" {unit}" not in text:
        text = f"{text} [{unit}]"
    return text


def first_sentence(documented: Any) -> str:
    """The first sentence of a docstring, without marks of code and full stop."""
    text = inspect.getdoc(documented) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("`", "").rstrip(".")


def rule(info: FieldInfo) -> str:
    """What values a field may have, in words; empty where any of its type will do."""
    parts = []
    choices = [str(one) for one in _choices(info.annotation)]
    if len(choices) > 1:
        parts.append(f"{', '.join(choices[:-1])} or {choices[-1]}")
    for name, words in (("ge", "at least"), ("gt", "more than"), ("le", "at most"), ("lt", "less than")):
        bound = next((b for one in info.metadata if (b := getattr(one, name, None)) is not None), None)
        if bound is not None:
            parts.append(f"{words} {bound:,}" if isinstance(bound, int) else f"{words} {bound:g}")
    return ", ".join(parts)


def _choices(annotation: Any) -> tuple[Any, ...]:
    if typing.get_origin(annotation) is Literal:
        return typing.get_args(annotation)
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        parts = [part for part in typing.get_args(annotation) if part is not type(None)]
        return _choices(parts[0]) if len(parts) == 1 else ()
    return ()


def _attributes(docstring: str) -> dict[str, str]:
    """The lines under every ``Attributes:`` by field; continued lines are joined, marks of code left out."""
    _, *sections = inspect.cleandoc(docstring).split("\nAttributes:\n")
    return {
        name: " ".join(text.split()).replace("`", "").rstrip(".")
        for section in sections
        for names, text in _ENTRY.findall(re.split(r"^(?=\S)", section, maxsplit=1, flags=re.MULTILINE)[0])
        for name in names.split(", ")
    }
