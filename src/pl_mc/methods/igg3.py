"""The IGG-III robust estimate with rebuilt protection levels (Zhao et al. 2021, eqs 6, 7, 17-19)."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.kernels.parameters import traced
from pl_mc.kernels.weights import Igg3Weight
from pl_mc.methods.m_estimator import MEstimator


@traced
@dataclass(frozen=True)
class Igg3(MEstimator):
    """IGG-III reweighting (Zhao et al. 2021, eqs 6, 7): full weight up to k0, falling to zero at k1.

    Iterations, scale, start and so on are options that all M-estimates have: `pl_mc.methods.MEstimator`.

    Attributes:
        k0, k1: standardised residuals where the weight begins to fall and where it reaches zero.

    Example:
        >>> import pl_mc
        >>> pl_mc.igg3(k1=4.0).name
        'igg3(k1=4)'
    """

    k0: float = 1.5
    k1: float = 5.0

    key = "igg3"

    @property
    def weight(self) -> Igg3Weight:
        return Igg3Weight(self.k0, self.k1)
