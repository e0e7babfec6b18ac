"""Detectors by name, as experiment files and `pl_mc.detect` call them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from pl_mc.detectors.base import Detector
from pl_mc.detectors.chi2 import Chi2
from pl_mc.detectors.mean_check import MeanCheck
from pl_mc.input_errors import InputError, nearest, require_choice

DETECTORS: dict[str, type] = {"chi2": Chi2, "mean_check": MeanCheck}


def detector(name: str, **options: Any) -> Detector:
    """A detector by name with its options; an `InputError` names what is unknown and the nearest choice."""
    cls = DETECTORS[require_choice(name, DETECTORS, field="test")]
    fields = [field.name for field in dataclasses.fields(cls)]
    for option in options:
        if option not in fields:
            raise InputError(f"test {name}: the option {option!r} is unknown ({nearest(option, fields)}).")
    # Lists are what experiment files have; records are hashable.
    return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in options.items()})


def as_detectors(tests: Sequence[str | Detector]) -> tuple[Detector, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name."""
    if isinstance(tests, str):
        raise InputError(f"tests: a sequence of tests is needed, such as ({tests!r},), not a word.")
    made = tuple(detector(item) if isinstance(item, str) else item for item in tests)
    if not made:
        raise InputError("tests: at least one test is needed.")
    for item in made:
        if not isinstance(item, Detector):
            raise InputError(f"tests: {item!r} is no test (valid names: {', '.join(DETECTORS)}).")
    names = [item.name for item in made]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"tests: {name} is asked for twice.")
    return made
