"""The Danish method, with weights that fall exponentially, and rebuilt protection levels."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.kernels.parameters import traced
from pl_mc.kernels.weights import DanishWeight
from pl_mc.methods.m_estimator import MEstimator


@traced
@dataclass(frozen=True)
class Danish(MEstimator):
    """Weights 1 up to c, then exp(-((|u| - c) / c)^2); levels: see `pl_mc.methods.m_estimator`.

    After Krarup, Juhl & Kubik 1980. Papers differ in the exponential; this one has no step at c. No weight is zero.

    Attributes:
        c: standardised residual where the weight begins to fall; 2 to 3 is usual.
    """

    c: float = 2.0

    key = "danish"

    @property
    def weight(self) -> DanishWeight:
        return DanishWeight(self.c)
