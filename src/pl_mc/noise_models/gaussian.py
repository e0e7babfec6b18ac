"""Independent Gaussian errors with the sigma that the receiver believes: the noise of Zhao et al. 2021."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jax import Array

from pl_mc.kernels import LinearModel
from pl_mc.noise_models.base import OneNumber


@dataclass(frozen=True)
class Gaussian(OneNumber):
    """Standard normal numbers as they are."""

    base_name = "gaussian"

    @property
    def shifts_only(self) -> bool:
        return True

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return units[0]


GAUSSIAN = Gaussian()
