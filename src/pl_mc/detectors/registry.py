"""Detectors by name, as experiment files and `pl_mc.detect` call them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pl_mc.detectors.base import Detector
from pl_mc.detectors.chi2 import Chi2
from pl_mc.detectors.mean_check import MeanCheck
from pl_mc.named import as_records, build_named, registry

DETECTORS = registry("test", {"chi2": Chi2, "mean_check": MeanCheck})


def detector(name: str, **options: Any) -> Detector:
    """A detector by name with its options; an `InputError` names what is unknown and the nearest choice."""
    return build_named(name, DETECTORS, options, what="test")


def as_detectors(tests: Sequence[str | Detector]) -> tuple[Detector, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name."""
    return as_records(tests, DETECTORS, Detector, what="test")
