"""Public names of earlier versions that have others today: they warn, and do what they did for two minor versions.

One table holds all of them. They are found by the ``__getattr__`` of the module in which they were, which is
`moved_names` of its name.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple


class Moved(NamedTuple):
    """Where a name is found, what to write in its place, and the version that no longer knows it."""

    found: str
    instead: str
    gone_with: str


MOVED = {
    "pl_mc.engine.events": Moved("pl_mc.kernels.events", "pl_mc.kernels.events", "0.4.0"),
    "pl_mc.engine.noise": Moved("pl_mc.kernels.noise", "pl_mc.kernels.noise", "0.4.0"),
    "pl_mc.injection.Injection": Moved("pl_mc.injection._injection", "pl_mc.faults.Bias", "0.4.0"),
    "pl_mc.injection.parse_injection": Moved("pl_mc.injection._parse_injection", "pl_mc.biases", "0.4.0"),
}


def warn(old: str, row: Moved) -> None:
    """Say it where the name was used: the first place outside of this package and of the import system."""
    frame = sys._getframe(1)
    while frame.f_back and str(frame.f_globals.get("__name__")).split(".")[0] in ("pl_mc", "importlib"):
        frame = frame.f_back
    warnings.warn_explicit(
        f"{old} is {row.instead} since pl_mc 0.2.0; {row.gone_with} will not know the old name.", DeprecationWarning,
        frame.f_code.co_filename, frame.f_lineno, str(frame.f_globals.get("__name__")),
        frame.f_globals.setdefault("__warningregistry__", {}),
    )  # fmt: skip


def moved_names(module: str) -> Callable[[str], Any]:
    """``__getattr__`` of a module that some names have left, or all of them."""

    def find(name: str) -> Any:
        inner = f"{module}.{name}"
        old = inner if inner in MOVED else module
        if old not in MOVED or name.startswith("__"):
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        row = MOVED[old]
        place, _, inside = row.found.rpartition(".") if old == inner else (row.found, "", name)
        value = getattr(importlib.import_module(place), inside)
        warn(old, row)
        return value

    return find
