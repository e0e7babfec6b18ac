"""Weight functions of iteratively reweighted least squares: w(u) of a standardised residual u.

Each is a record whose constants are leaves (`pl_mc.kernels.parameters`); all take |u|, of any shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from pl_mc.input_errors import InputError, is_real
from pl_mc.kernels.parameters import checkable, require_positive_leaf, traced


class WeightFunction(Protocol):
    """Equivalent-weight factor of a standardised residual."""

    def __call__(self, size: Array) -> Array:
        """w of |u|, in [0, 1]."""
        ...


@traced
@dataclass(frozen=True)
class Igg3Weight:
    """IGG-III: full weight up to k0, decreasing to zero at k1, zero beyond (Zhao et al. 2021, eq 7)."""

    k0: float | Array = 1.5
    k1: float | Array = 5.0

    def __post_init__(self) -> None:
        sound = is_real(self.k0) and is_real(self.k1)
        if checkable(self.k0, self.k1) and not (sound and 0.0 < self.k0 < self.k1 < float("inf")):
            raise InputError(f"igg3: 0 < k0 < k1 is needed, not k0 = {self.k0!r}, k1 = {self.k1!r}.")

    def __call__(self, size: Array) -> Array:
        # One formula for all three pieces: at k0 and below it is one, from k1 on zero.
        outer = jnp.maximum(size, self.k0)
        fall = jnp.maximum(1.0 - (outer - self.k0) * (1.0 / (self.k1 - self.k0)), 0.0)
        return self.k0 / outer * fall * fall


@traced
@dataclass(frozen=True)
class HuberWeight:
    """Huber's minimax weight: 1 up to k, then k / |u| (Huber 1964, Ann. Math. Statist. 35:73-101)."""

    k: float | Array = 1.345

    def __post_init__(self) -> None:
        require_positive_leaf(self.k, field="huber: k")

    def __call__(self, size: Array) -> Array:
        return self.k / jnp.maximum(size, self.k)


@traced
@dataclass(frozen=True)
class TukeyWeight:
    """Tukey's biweight: (1 - (u / c)^2)^2 up to c, zero beyond (Beaton & Tukey 1974, Technometrics 16:147-185)."""

    c: float | Array = 4.685

    def __post_init__(self) -> None:
        require_positive_leaf(self.c, field="tukey: c")

    def __call__(self, size: Array) -> Array:
        inner = 1.0 - jnp.minimum(size * (1.0 / self.c), 1.0) ** 2
        return inner * inner


@traced
@dataclass(frozen=True)
class HampelWeight:
    """Hampel's three parts: 1 up to a, a / |u| up to b, falling to zero at c, zero beyond.

    After Andrews, Bickel, Hampel, Huber, Rogers & Tukey 1972, Robust Estimates of Location; the constants 2, 4, 8
    are those of R's `MASS::psi.hampel` and of statsmodels (the book also has 1.7, 3.4, 8.5).
    """

    a: float | Array = 2.0
    b: float | Array = 4.0
    c: float | Array = 8.0

    def __post_init__(self) -> None:
        constants = (self.a, self.b, self.c)
        sound = all(map(is_real, constants))
        if checkable(*constants) and not (sound and 0.0 < self.a <= self.b < self.c < float("inf")):
            raise InputError(f"hampel: 0 < a <= b < c is needed, not a = {self.a!r}, b = {self.b!r}, c = {self.c!r}.")

    def __call__(self, size: Array) -> Array:
        fall = jnp.clip((self.c - size) * (1.0 / (self.c - self.b)), 0.0, 1.0)
        return self.a / jnp.maximum(size, self.a) * fall


@traced
@dataclass(frozen=True)
class DanishWeight:
    """The Danish method: 1 up to c, then exp(-((|u| - c) / c)^2), after Krarup, Juhl & Kubik 1980.

    That paper and those after it write several exponentials; this one has no step at c.
    """

    c: float | Array = 2.0

    def __post_init__(self) -> None:
        require_positive_leaf(self.c, field="danish: c")

    def __call__(self, size: Array) -> Array:
        beyond = jnp.maximum(size * (1.0 / self.c) - 1.0, 0.0)
        # Beyond e^-80 nothing is left in single precision either; a bounded square overflows nowhere.
        return jnp.exp(-jnp.minimum(beyond * beyond, 80.0))


@traced
@dataclass(frozen=True)
class L1Weight:
    """Least absolute residuals: 1 / max(|u|, eps), times eps so that the largest weight is one.

    A common factor changes no solution, nor the product of unit-weight error and cofactors. It is Huber's weight
    with k = eps, and its sum of absolute residuals is within n eps / 2 of the smallest (Schlossmacher 1973).
    """

    eps: float | Array = 1e-4

    def __post_init__(self) -> None:
        require_positive_leaf(self.eps, field="l1: eps")

    def __call__(self, size: Array) -> Array:
        return self.eps / jnp.maximum(size, self.eps)
