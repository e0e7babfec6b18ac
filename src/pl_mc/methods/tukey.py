"""Tukey's biweight with rebuilt protection levels."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.kernels.parameters import traced
from pl_mc.kernels.weights import TukeyWeight
from pl_mc.methods.m_estimator import MEstimator


@traced
@dataclass(frozen=True)
class Tukey(MEstimator):
    """Weights (1 - (u / c)^2)^2 up to c, zero beyond (Beaton & Tukey 1974); levels as in `MEstimator`.

    Attributes:
        c: standardised residual where the weight reaches zero; 4.685 keeps 95 % of the efficiency of least
            squares under normal errors.
    """

    c: float = 4.685

    key = "tukey"

    @property
    def weight(self) -> TukeyWeight:
        return TukeyWeight(self.c)
