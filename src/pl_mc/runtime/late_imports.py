"""Libraries that wait until something of them is asked for, in commands that may need nothing of them.

Files import pandas or SciPy at their top, as they should; within `late_imports` that costs nothing until a table is
made. A module that waits is the module itself, empty: the first attribute that it lacks fills it.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

_LATE = ("pandas", "pyarrow", "scipy.special")
# What importing gives to a module, where it has it at all, and asks for.
_BY_IMPORT = ("__cached__", "__file__", "__path__")

# Another thread waits until all of a module is there.
_FILLING = threading.RLock()


class _Waiting(ModuleType):
    """A module without content."""

    def __getattr__(self, name: str) -> Any:
        if name in _BY_IMPORT:
            raise AttributeError(name)
        with _FILLING:
            _fill(self)
        if isinstance(self, _Waiting):
            # Asked for by its own files, before it has it.
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(self, name)


class _Loader:
    """Makes modules that wait, and remembers what fills them."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Waiting(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Nothing yet."""


class _Finder(MetaPathFinder):
    """Finds the libraries that wait, and modules within them as long as they do."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: Any = None) -> ModuleSpec | None:
        above = sys.modules.get(name.rpartition(".")[0])
        if name not in _LATE and not (isinstance(above, _Waiting) and _waits(above)):
            return None
        spec = PathFinder.find_spec(name, path)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)  # type: ignore[assignment]
        return spec


def _waits(module: ModuleType) -> bool:
    """Whether nothing of it has been asked for: its own files are loaded as it says."""
    return isinstance(getattr(module.__spec__, "loader", None), _Loader)


def _fill(module: ModuleType) -> None:
    """Load a module that waits, after the one that it is in; one that is being loaded is left alone."""
    above = sys.modules.get(module.__name__.rpartition(".")[0])
    if above is not None:
        _fill(above)
    if isinstance(module, _Waiting) and _waits(module):
        spec: Any = module.__spec__
        loader = spec.loader
        spec.loader = module.__loader__ = loader.loader
        try:
            loader.loader.exec_module(module)
        except BaseException:
            spec.loader = loader
            raise
        module.__class__ = ModuleType  # type: ignore[assignment]


@contextmanager
def late_imports() -> Iterator[None]:
    """Within it, heavy libraries are loaded when they are first used; those that still wait at its end wait on."""
    finder = _Finder()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
