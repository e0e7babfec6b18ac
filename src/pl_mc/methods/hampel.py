"""Hampel's estimate in three parts with rebuilt protection levels."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.kernels.parameters import traced
from pl_mc.kernels.weights import HampelWeight
from pl_mc.methods.m_estimator import MEstimator


@traced
@dataclass(frozen=True)
class Hampel(MEstimator):
    """Weights 1 up to a, a / |u| up to b, falling to zero at c; levels: see `pl_mc.methods.m_estimator`.

    After Andrews et al. 1972; the constants are those of R's ``MASS::psi.hampel`` (the book also has 1.7, 3.4,
    8.5).

    Attributes:
        a, b, c: standardised residuals where the weight begins to fall, falls faster, and reaches zero.
    """

    a: float = 2.0
    b: float = 4.0
    c: float = 8.0

    key = "hampel"

    @property
    def weight(self) -> HampelWeight:
        return HampelWeight(self.a, self.b, self.c)
