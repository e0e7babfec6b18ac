"""What a method can do beside `solve`: members that its class may have, and that analyses ask for.

A capability is declared next to the `solve` and `prepare` that it speaks of. A subclass that overrides one of these
does not inherit it, since what it says need not be true any more; it declares again what still is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.alert import VERTICAL
from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.methods.base import Method
from pl_mc.methods.registry import METHODS
from pl_mc.statistics.exact import Law

AnyMethod = TypeVar("AnyMethod", bound=Method)


@runtime_checkable
class LevelsFromGeometry(Protocol):
    """Levels that no error changes, so that one draw tells all."""

    @property
    def levels_from_geometry(self) -> bool:
        """Whether the levels are those of `prepare`, whatever the errors are; options may decide."""


@runtime_checkable
class BatchedLevels(Protocol):
    """Levels from the geometry alone, by a function for many geometries at once that has threads of its own."""

    def batched_levels(
        self, design: FloatArray, sigma_m: FloatArray, in_view: NDArray[np.bool_], systems: NDArray[np.str_]
    ) -> tuple[FloatArray, FloatArray]:
        """HPL and VPL (g,) [m], infinite where there is no solution.

        Args:
            design: (g, n, t) [m/m]; sigma_m: (g, n) [m]; in_view: (g, n); systems: (g, n), RINEX letters, empty on
                padding.
        """


@runtime_checkable
class Statistic(Protocol):
    """A test of the least-squares solution: its statistic and threshold, as their ratio."""

    def statistic(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Array:
        """(...), test statistic over its threshold, no unit: above 1 it rejects, before anything is excluded.

        Infinite where the method has no solution. The arguments are those of `Method.solve`.
        """


@runtime_checkable
class ExactLaw(Protocol):
    """Exact rates of alarm, hazard, missed and misleading information under any fault."""

    @property
    def exact_law(self) -> Law | None:
        """The law of its error, level and alarm, under Gaussian errors with the sigma of the model; options decide."""


@runtime_checkable
class NamesExclusions(Protocol):
    """Outcomes that say which satellite was left out, so that sweeps count `pl_mc.kernels.events.EXCLUSIONS`."""

    @property
    def names_exclusions(self) -> bool:
        """Whether ``Outcome.excluded`` is given; options decide."""


@runtime_checkable
class ScalesWithK(Protocol):
    """Levels that are K times what the method makes of a scenario.

    The field of the horizontal level is called as that of the vertical one, with ``horizontal`` for ``vertical``.
    """

    @property
    def scales_with_k(self) -> str | None:
        """Name of the dataclass field that is K of the vertical level; None where the levels are no multiples."""


_MEANINGS = {
    "statistic": "statistic(model, prepared, start), its test statistic over the threshold",
    "exact_law": "exact_law, the LeastSquaresLaw that its rates follow exactly",
    "scales_with_k": "scales_with_k, the name of the field that its vertical level is a multiple of",
}


def declared(method: object, capability: str) -> Any:
    """The member of that name; None where the class lacks it, or overrides `solve` or `prepare` without it."""
    for cls in type(method).__mro__:
        if capability in vars(cls):
            return getattr(method, capability)
        if "solve" in vars(cls) or "prepare" in vars(cls):
            break
    return None


def levels_from_geometry(method: object) -> bool:
    """Whether the levels of a method depend on the geometry alone; see `LevelsFromGeometry`."""
    return bool(declared(method, "levels_from_geometry"))


def statistic(method: object) -> Callable[[LinearModel, Any, LeastSquaresSolution], Array] | None:
    """The test statistic of a method, if it has one; see `Statistic`."""
    return declared(method, "statistic")


def exact_law(method: object) -> Law | None:
    """The exact law of a method, if it has one; see `ExactLaw`."""
    return declared(method, "exact_law")


def scales_with_k(method: object) -> str | None:
    """The field that is K, if the level is a multiple of one; see `ScalesWithK`."""
    return declared(method, "scales_with_k")


def require_k(method: Method, axis: str = VERTICAL) -> None:
    """Raise `InputError` unless the level of a method on an axis is a multiple of one of its fields."""
    if scales_with_k(method) is None:
        raise refusal(method, "scales_with_k", able=scales_with_k, field="method")
    name = _k_field(method, axis)
    if not dataclasses.is_dataclass(method) or name not in method.__dataclass_fields__:
        level = "" if axis == VERTICAL else f", the multiplier of its {axis} level"
        raise InputError(f"method: {method.name}: scales_with_k: {name!r} is no field of this dataclass{level}.")


def k_of(method: Method, axis: str = VERTICAL) -> float:
    """The multiplier of the level of an axis, of a method that scales with it."""
    return float(getattr(method, _k_field(method, axis)))


def with_k(method: AnyMethod, k: float, axis: str = VERTICAL) -> AnyMethod:
    """The same method with another multiplier of the level of an axis."""
    return dataclasses.replace(method, **{_k_field(method, axis): k})  # type: ignore[type-var]


def _k_field(method: object, axis: str) -> str:
    return str(scales_with_k(method)).replace(VERTICAL, axis)


def refusal(
    method: Method, *capabilities: str, able: Callable[[Method], Any], field: str, also: Iterable[str] = ()
) -> InputError:
    """The error for a method that lacks what an analysis needs: what that is, and who has it.

    Args:
        method: the method.
        capabilities: names of which one would do.
        able: whether a registered method could be used.
        field: the argument that gave the method.
        also: further names that could be.
    """
    lacks = ", nor ".join(_MEANINGS[name] for name in capabilities)
    known = [name for name, cls in METHODS.items() if able(cls())]
    # Where options decide a capability is a property.
    other = [
        name
        for name, cls in METHODS.items()
        if name not in known and any(isinstance(getattr(cls, each, None), property) for each in capabilities)
    ]
    with_options = f"; with other options {', '.join(other)}" if other else ""
    return InputError(
        f"{field}: {method.name} has no {lacks} (methods that have: {', '.join([*known, *also])}{with_options})."
    )
