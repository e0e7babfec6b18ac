"""Independent Gaussian errors with the sigma that the receiver believes: the noise of Zhao et al. 2021."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jax import Array

from pl_mc.geometry.record import Geometry
from pl_mc.kernels import LinearModel


@dataclass(frozen=True)
class Gaussian:
    """Standard normal numbers as they are."""

    @property
    def name(self) -> str:
        return "gaussian"

    @property
    def inputs_per_row(self) -> int:
        return 1

    @property
    def shifts_only(self) -> bool:
        return True

    def require_geometry(self, g: Geometry) -> None:
        return None

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return units[0]


GAUSSIAN = Gaussian()
