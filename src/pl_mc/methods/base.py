"""What a method is: from a least-squares start to an error, protection levels and a decision.

A method is a frozen record of its options with a `name` and two functions. It never sees the sweep: it is given one
geometry and a batch of scenarios, and says what a receiver that ran it would have said. To add one, write a file
beside this one and list its class in `pl_mc.methods.registry`.
"""

from __future__ import annotations

import inspect
from typing import Any, ClassVar

import jax

from pl_mc.input_errors import plain_number, require_choice
from pl_mc.kernels import Estimate, LeastSquaresSolution, LinearModel, ProtectionLevels, protection_levels
from pl_mc.kernels.levels import LEVEL_SCALES
from pl_mc.kernels.outcome import Method as Method
from pl_mc.kernels.outcome import Outcome as Outcome
from pl_mc.kernels.parameters import is_array, require_positive_leaf


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
        if is_array(value := getattr(options, field)) or value != getattr(defaults, field)
    ]
    return f"{base}({','.join(changed)})" if changed else base


def require_multipliers(method: Any) -> None:
    """Raise `InputError` unless both multipliers of the levels of a `Named` method are positive."""
    for field in ("k_horizontal", "k_vertical"):
        require_positive_leaf(getattr(method, field), field=f"{method.key}: {field}")


class Named:
    """A record whose name is its key, with the options that are not the default."""

    key: ClassVar[str]

    @property
    def name(self) -> str:
        return name_with_options(self.key, self, type(self)())

    def __str__(self) -> str:
        """The name, as it stands in that of a method which uses this one."""
        return self.name


class Estimator(Named):
    """An estimate with protection levels of its posterior or a-priori variance, and no test of its own.

    Attributes:
        apriori: unit-weight error that the sigma of the model lead to expect.
    """

    k_horizontal: float
    k_vertical: float
    level_scale: str

    apriori: ClassVar[float] = 1.0

    scales_with_k = "k_vertical"

    def __post_init__(self) -> None:
        require_multipliers(self)
        require_choice(self.level_scale, LEVEL_SCALES, field=f"{self.key}: level_scale")

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        raise NotImplementedError

    def prepare(self, model: LinearModel) -> Any:
        return ()

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        estimate = self._estimate(model, start)
        return outcome_of(estimate, self._levels(estimate))

    def _levels(self, estimate: Estimate) -> ProtectionLevels:
        return protection_levels(
            estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical, level_scale=self.level_scale,
            apriori=self.apriori,
        )  # fmt: skip
