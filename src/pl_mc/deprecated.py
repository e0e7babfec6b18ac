"""Public names of earlier versions that have others today: they warn, and do what they did for two minor versions.

One table holds all of them. Those of modules are found by an importer that comes after all others, those inside of a
module by the module's own ``__getattr__``, which is `moved_names` of its name.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
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
    """``__getattr__`` of a module that some names have left."""

    def find(name: str) -> Any:
        row = MOVED.get(f"{module}.{name}")
        if row is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn(f"{module}.{name}", row)
        place, _, inside = row.found.rpartition(".")
        return getattr(importlib.import_module(place), inside)

    return find


class _Importer(MetaPathFinder, Loader):
    """Modules under their former names: empty ones that ask today's for everything."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        row = MOVED[module.__name__]
        warn(module.__name__, row)
        today = importlib.import_module(row.found)
        module.__getattr__ = lambda name: getattr(today, name)  # type: ignore[method-assign]
        module.__all__ = [name for name in vars(today) if not name.startswith("_")]  # type: ignore[attr-defined]


sys.meta_path.append(_Importer())
