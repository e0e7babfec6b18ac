"""Least squares with protection levels from the posterior variance (Zhao et al. 2021, eqs 4, 12-16)."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels import Estimate, LeastSquaresSolution, LinearModel, least_squares
from pl_mc.kernels.parameters import traced
from pl_mc.methods.base import Estimator
from pl_mc.statistics.exact import LeastSquaresLaw


@traced
@dataclass(frozen=True)
class Ls(Estimator):
    """Weighted least squares, levels from the posterior variance (Zhao et al. 2021, eqs 4, 12-16).

    Attributes:
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    key = "ls"

    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    @property
    def exact_law(self) -> LeastSquaresLaw:
        return LeastSquaresLaw(self.k_vertical, self.k_horizontal)

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        return least_squares(model, start)
