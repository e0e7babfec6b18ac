"""Weight functions of iteratively reweighted least squares: w(u) of a standardised residual u.

Each is a frozen record, so that it can be a static argument of a jitted kernel; all take |u|, of any shape.
"""

from __future__ import annotations

import numbers
from dataclasses import dataclass
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from pl_mc.input_errors import InputError, require_positive


class WeightFunction(Protocol):
    """Equivalent-weight factor of a standardised residual."""

    def __call__(self, size: Array) -> Array:
        """w of |u|, in [0, 1]."""
        ...


@dataclass(frozen=True)
class Igg3Weight:
    """IGG-III: full weight up to k0, decreasing to zero at k1, zero beyond (Zhao et al. 2021, eq 7)."""

    k0: float = 1.5
    k1: float = 5.0

    def __post_init__(self) -> None:
        sound = all(isinstance(value, numbers.Real) for value in (self.k0, self.k1))
        if not sound or not 0.0 < self.k0 < self.k1 < float("inf"):
            raise InputError(f"igg3: 0 < k0 < k1 is needed, not k0 = {self.k0!r}, k1 = {self.k1!r}.")

    def __call__(self, size: Array) -> Array:
        # One formula for all three pieces: at k0 and below it is one, from k1 on zero.
        outer = jnp.maximum(size, self.k0)
        fall = jnp.maximum(1.0 - (outer - self.k0) * (1.0 / (self.k1 - self.k0)), 0.0)
        return self.k0 / outer * fall * fall


@dataclass(frozen=True)
class HuberWeight:
    """Huber's minimax weight: 1 up to k, then k / |u| (Huber 1964, Ann. Math. Statist. 35:73-101)."""

    k: float = 1.345

    def __post_init__(self) -> None:
        require_positive(self.k, field="huber: k")

    def __call__(self, size: Array) -> Array:
        return self.k / jnp.maximum(size, self.k)


@dataclass(frozen=True)
class TukeyWeight:
    """Tukey's biweight: (1 - (u / c)^2)^2 up to c, zero beyond (Beaton & Tukey 1974, Technometrics 16:147-185)."""

    c: float = 4.685

    def __post_init__(self) -> None:
        require_positive(self.c, field="tukey: c")

    def __call__(self, size: Array) -> Array:
        inner = 1.0 - jnp.minimum(size / self.c, 1.0) ** 2
        return inner * inner
