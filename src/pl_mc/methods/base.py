"""What a method is: from a least-squares start to an error, protection levels and a decision.

A method is a frozen record of its options with a `name` and two functions. It never sees the sweep: it is given one
geometry and a batch of scenarios, and says what a receiver that ran it would have said. To add one, write a file
beside this one and list its class in `pl_mc.methods.registry`.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import jax
from jax import Array

from pl_mc.input_errors import plain_number, require_positive
from pl_mc.kernels import Estimate, LeastSquaresSolution, LinearModel, ProtectionLevels, protection_levels


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
    """

    error_m: Array
    hpl_m: Array
    vpl_m: Array
    available: Array
    rejects: Array
    change_m: Array | None = None
    tied: Array | None = None


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


def outcome_of(estimate: Estimate, levels: ProtectionLevels) -> Outcome:
    """The outcome of an estimator with protection levels and no test of its own."""
    return Outcome(
        error_m=estimate.state[:3],
        hpl_m=levels.hpl_m,
        vpl_m=levels.vpl_m,
        available=estimate.available,
        rejects=jax.numpy.zeros_like(estimate.available),
        change_m=estimate.change_m,
        tied=estimate.tied,
    )


def name_with_options(base: str, options: Any, defaults: Any) -> str:
    """``igg3``, or ``igg3(k1=4,scale=apriori)`` where options differ from the defaults."""
    # What a class has of its own comes before what it shares with others.
    own = inspect.get_annotations(type(options))
    changed = [
        f"{field}={plain_number(value)}" if isinstance(value, float) else f"{field}={value}"
        for field in sorted(options.__dataclass_fields__, key=lambda field: field not in own)
        if (value := getattr(options, field)) != getattr(defaults, field)
    ]
    return f"{base}({','.join(changed)})" if changed else base


def require_multipliers(method: Any) -> None:
    """Raise `InputError` unless both multipliers of the levels of a `Named` method are positive."""
    for field in ("k_horizontal", "k_vertical"):
        require_positive(getattr(method, field), field=f"{method.key}: {field}")


class Named:
    """A record whose name is its key, with the options that are not the default."""

    key: ClassVar[str]

    @property
    def name(self) -> str:
        return name_with_options(self.key, self, type(self)())


class Estimator(Named):
    """An estimate with the protection levels of its posterior variance, and no test of its own."""

    k_horizontal: float
    k_vertical: float

    scales_with_k = "k_vertical"

    def __post_init__(self) -> None:
        require_multipliers(self)

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        raise NotImplementedError

    def prepare(self, model: LinearModel) -> Any:
        return ()

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        estimate = self._estimate(model, start)
        levels = protection_levels(estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        return outcome_of(estimate, levels)
