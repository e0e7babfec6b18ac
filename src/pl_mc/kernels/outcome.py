"""What a method is to a kernel, and what it says of a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax
from jax import Array

from pl_mc.kernels.estimate import LeastSquaresSolution
from pl_mc.kernels.linear_model import LinearModel


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """What a method says in each scenario (``...``, the lanes).

    Attributes:
        error_m: (3, ...), east, north, up error of its position [m].
        hpl_m, vpl_m: (...), protection levels [m]; HPL is None of a method that no horizontal limit can judge.
        available: (...), whether there is a solution; where not, the numbers are infinite and count for nothing.
        rejects: (...), whether the method's own test rejects the scenario; all False for methods without a test.
        change_m: (...), largest change of a position component in the last iteration [m]; None without iterations.
        tied: (...), whether satellites that no residual tells apart share a weight below one; None without weights.
        excluded: (...), the row that was left out, -1 for none; None of methods that do not say.
    """

    error_m: Array
    hpl_m: Array
    vpl_m: Array
    available: Array
    rejects: Array
    change_m: Array | None = None
    tied: Array | None = None
    excluded: Array | None = None


@runtime_checkable
class Method(Protocol):
    """One method with its options; a frozen, hashable record."""

    @property
    def name(self) -> str:
        """The name in tables, the method's own with the options that are not the default in brackets."""

    def prepare(self, model: LinearModel) -> Any:
        """What depends on the geometry alone, computed once for all its scenarios (any pytree, () for nothing)."""

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        """The outcome of each lane of ``start``."""
