"""IGG-III with a chi-square gate: a global test of the residuals beside the rebuilt protection level.

A gate on the robust-weighted residuals looks like a safeguard and is none against a large error: the weight of the
satellite that carries it falls faster than its residual grows, so what is tested is the fit of the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from jax import Array

from pl_mc.input_errors import require_choice
from pl_mc.kernels import Estimate, LeastSquaresSolution, LinearModel, irls
from pl_mc.kernels.linear_model import per_lane, product
from pl_mc.kernels.parameters import static, traced
from pl_mc.methods.base import Outcome, outcome_of
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.raim_levels import at_dof, require_risks, thresholds

GATES = ("weighted", "unweighted", "ls")


@traced
@dataclass(frozen=True)
class GatedIgg3(Igg3):
    """IGG-III that also rejects where a square sum of residuals exceeds its chi-square threshold.

    The threshold is that of n - t degrees of freedom, n all satellites in view. It is exact for ``ls`` alone; the
    two square sums of robust residuals have no known distribution. A gate on robust-weighted residuals looks like a
    safeguard and is none against a large error: the weight of the satellite that carries it falls faster than its
    residual grows, so what is tested is the fit of the others.

    Attributes:
        p_fa: probability at which a chi-square variable exceeds the threshold.
        gate: the square sum: ``weighted`` V_bar' P_bar V_bar, the one in the robust unit-weight error (Zhao et al.
            2021, eq 17); ``unweighted`` V_bar' P V_bar, the same residuals with the weights of least squares;
            ``ls`` V' P V of least squares, the usual test (Guo et al. 2022, eqs 14-15).
    """

    p_fa: float = static(1e-3)
    gate: str = static("weighted")

    key = "igg3_gated"
    scales_with_k = "k_vertical"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self.gate, GATES, field="igg3_gated: gate")
        require_risks("igg3_gated", p_fa=self.p_fa)

    def prepare(self, model: LinearModel) -> Array:
        """The threshold; with nothing redundant there is no solution to reject."""
        return at_dof(thresholds(model.design.shape[0], self.p_fa), model.dof)

    def solve(self, model: LinearModel, prepared: Array, start: LeastSquaresSolution) -> Outcome:
        estimate = irls(model, start, self.options)
        rejects = estimate.available & (self._square_sum(model, start, estimate) > prepared)
        return replace(outcome_of(estimate, self._levels(estimate)), rejects=rejects)

    def _square_sum(self, model: LinearModel, start: LeastSquaresSolution, estimate: Estimate) -> Array:
        if self.gate == "ls":
            return start.square_sum
        whitened = estimate.residuals_m * per_lane(model.weight_root, estimate.residuals_m)
        squares = whitened * whitened
        return product(model.mask_row, estimate.weights * squares if self.gate == "weighted" else squares)[0]
