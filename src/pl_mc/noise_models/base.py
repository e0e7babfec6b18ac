"""What a noise model is: a map from standard normal numbers to the errors of one epoch, in units of sigma.

Every model is a deterministic function of independent standard normal numbers, ``inputs_per_row`` of them for each
satellite. So its draws are as reproducible as Gaussian ones, every fault and every method sees the same errors, and
rare events are searched for in the space of those numbers, whatever the errors look like. Where it can be had the
function is continuous: samplers climb along it.

To add a model, write a file beside this one and list its class in `pl_mc.noise_models.registry`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

from jax import Array

from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import plain_number
from pl_mc.kernels import LinearModel


@runtime_checkable
class NoiseModel(Protocol):
    """One model with its options; a frozen, hashable record."""

    @property
    def name(self) -> str:
        """The name in tables, the model's own with its options in brackets."""

    @property
    def inputs_per_row(self) -> int:
        """How many standard normal numbers make the error of one satellite."""

    @property
    def shifts_only(self) -> bool:
        """Whether errors are Gaussian but for a constant; then the whitened noise has no preferred axes."""

    def require_geometry(self, g: Geometry) -> None:
        """Raise `InputError` where the model cannot serve a geometry."""

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        """(n, lanes), errors in units of each satellite's sigma, finite also on padding.

        Args:
            model: the epoch; sigma, elevations and least-squares gains follow from it.
            units: ``inputs_per_row`` arrays (n, lanes), independent standard normal.
        """


class OneNumber:
    """What most models have in common: one number a satellite, errors that are not Gaussian, any geometry."""

    base_name: ClassVar[str]

    @property
    def name(self) -> str:
        return name_with_all_options(self.base_name, self)

    @property
    def inputs_per_row(self) -> int:
        return 1

    @property
    def shifts_only(self) -> bool:
        return False

    def require_geometry(self, g: Geometry) -> None:
        return None


def make_floats(record: Any, *fields: str) -> None:
    """Numbers of a frozen record as floats, so that 4 and 4.0 are one record with one text."""
    for field in fields:
        object.__setattr__(record, field, float(getattr(record, field)))


def name_with_all_options(base: str, record: Any) -> str:
    """``student_t(nu=4,match=sigma)``: all options, since none of them goes without saying; None is left out."""

    def text(value: Any) -> str:
        if isinstance(value, tuple):
            return "[" + " ".join(text(item) for item in value) + "]"
        return plain_number(value) if isinstance(value, float) else str(value)

    fields = {field: getattr(record, field) for field in record.__dataclass_fields__}
    told = ",".join(f"{field}={text(value)}" for field, value in fields.items() if value is not None)
    return f"{base}({told})" if told else base


@dataclass(frozen=True)
class Gaussian(OneNumber):
    """Independent errors with the sigma that the receiver believes: the noise of Zhao et al. 2021."""

    base_name = "gaussian"

    @property
    def shifts_only(self) -> bool:
        return True

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return units[0]


GAUSSIAN = Gaussian()
