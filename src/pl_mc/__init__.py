"""pl_mc: how often does a protection level alarm, how often does it miss, under which fault, at which confidence?

The public names are those of ``__init__.pyi`` beside this file. They are found on first use, so that importing the
package costs nothing.
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import Any

__version__ = "0.2.0"

# Before anybody forks.
importlib.import_module("pl_mc.runtime.forks")

_LINES = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body

# Public name -> where it is, and its name there.
_PUBLIC = {
    name.asname: (str(line.module), name.name)
    for line in _LINES
    if isinstance(line, ast.ImportFrom)
    for name in line.names
    if name.asname
} | {
    ast.unparse(line.targets[0]): (f"pl_mc.{ast.unparse(line.value.value)}", line.value.attr)
    for line in _LINES
    if isinstance(line, ast.Assign) and isinstance(line.value, ast.Attribute)
}

__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'pl_mc' has no attribute {name!r}")
    place, inside = _PUBLIC[name]
    # Rooms that are public as a whole are modules of this package.
    value = importlib.import_module(f"{place}.{inside}") if place == __name__ else _inside(place, inside)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})


def _inside(place: str, name: str) -> Any:
    return getattr(importlib.import_module(place), name)
