"""Huber's M-estimate with rebuilt protection levels: large residuals weigh less, none is thrown out."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.kernels.parameters import traced
from pl_mc.kernels.weights import HuberWeight
from pl_mc.methods.m_estimator import MEstimator


@traced
@dataclass(frozen=True)
class Huber(MEstimator):
    """Weights min(1, k / |u|) (Huber 1964), no satellite thrown out; levels: see `pl_mc.methods.m_estimator`.

    The sum that it makes small is convex: for a fixed scale the solution does not depend on the start.

    Attributes:
        k: standardised residual where the weight begins to fall; 1.345 keeps 95 % of the efficiency of least
            squares under normal errors.
    """

    k: float = 1.345

    key = "huber"

    @property
    def weight(self) -> HuberWeight:
        return HuberWeight(self.k)
