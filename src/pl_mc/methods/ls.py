"""Least squares with protection levels from the posterior variance (Zhao et al. 2021, eqs 4, 12-16)."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels import Estimate, LeastSquaresSolution, LinearModel, least_squares
from pl_mc.kernels.levels import APRIORI, FLOORED
from pl_mc.kernels.parameters import static, traced
from pl_mc.methods.base import Estimator
from pl_mc.statistics.exact import AprioriLaw, Law, LeastSquaresLaw


@traced
@dataclass(frozen=True)
class Ls(Estimator):
    """Weighted least squares, levels from the posterior variance (Zhao et al. 2021, eqs 4, 12-16).

    Attributes:
        level_scale: what multiplies the cofactors in the levels: ``posterior``, the unit-weight error of the solution;
            ``floored``, max(1, that), which the residuals of a few satellites cannot make small by chance; ``apriori``,
            1, the model's own sigma.
        k_horizontal, k_vertical: multipliers of the protection levels.

    Example:
        >>> import pl_mc
        >>> pl_mc.ls(level_scale="apriori").name
        'ls(level_scale=apriori)'
    """

    key = "ls"

    level_scale: str = static("posterior")
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    @property
    def levels_from_geometry(self) -> bool:
        return self.level_scale == APRIORI

    @property
    def exact_law(self) -> Law | None:
        if self.level_scale == APRIORI:
            return AprioriLaw(self.k_vertical, self.k_horizontal)
        return None if self.level_scale == FLOORED else LeastSquaresLaw(self.k_vertical, self.k_horizontal)

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        return least_squares(model, start)
