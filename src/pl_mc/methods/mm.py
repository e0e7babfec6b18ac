"""The MM-estimate: Tukey's biweight with the scale of a highly robust solution (Yohai 1987)."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_choice
from pl_mc.kernels import Estimate, IrlsOptions, LeastSquaresSolution, LinearModel
from pl_mc.kernels.parameters import static, traced
from pl_mc.kernels.reweighting import reweighted
from pl_mc.kernels.s_estimate import SOptions, s_estimate
from pl_mc.kernels.weights import TukeyWeight
from pl_mc.methods.base import Estimator

FLOORED, BARE = "s_floored", "s"
SCALES = (FLOORED, BARE)


@traced
@dataclass(frozen=True)
class MM(Estimator):
    """An S-estimate, then Tukey's weights from its residuals with its scale, which stays fixed (Yohai 1987).

    The S-estimate withstands close to (n - t) / 2 faulted satellites, as far as its few starts find it (see
    `pl_mc.kernels.s_estimate`); the second part gives the efficiency of its constant c. The variance of the levels
    is that of `pl_mc.methods.m_estimator`, with the weights of the last solution.

    Attributes:
        c: standardised residual where the weight reaches zero; 4.685 keeps 95 % of the efficiency of least squares
            under normal errors.
        iterations: reweighted solutions after the S-estimate; unless given 36, accelerated, as of an M-estimate. A
            number alone means plain ones.
        s_steps: reweighted solutions of the S-estimate from each of its starts.
        scale: ``s_floored`` max(1, s), s the scale of the S-estimate in units of sigma; or ``s`` itself.
        cofactor: N of the residuals' standard deviations in the second part: ``fault_free``, ``reweighted`` or
            ``none``.
        redundancy: divisor of the unit-weight error: ``all``, ``kept`` or ``weights``.
        level_scale: what multiplies the cofactors in the levels: ``posterior``, the unit-weight error of the solution;
            ``floored``, max(1, that), which the residuals of a few satellites cannot make small by chance; ``apriori``,
            1, the model's own sigma.
        covariance: of what the levels are: ``weights``, of a solution whose weights were known before; ``sandwich``,
            of the M-estimate, from its influence function (`pl_mc.kernels.sandwich`).
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    key = "mm"

    c: float = 4.685
    iterations: int | None = static(None)
    s_steps: int = static(10)
    scale: str = static(FLOORED)
    cofactor: str = static("fault_free")
    redundancy: str = static("all")
    level_scale: str = static("posterior")
    covariance: str = static("weights")
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self.scale, SCALES, field="mm: scale")
        _ = self.options, SOptions(self.s_steps)

    @property
    def options(self) -> IrlsOptions:
        """The kernel's view of the second part."""
        weight = TukeyWeight(self.c)
        return IrlsOptions(
            weight, self.iterations, cofactor=self.cofactor, redundancy=self.redundancy, covariance=self.covariance
        )

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        first, weights, scale = s_estimate(model, start, SOptions(self.s_steps))
        # Without a scale there is no solution either, and any finite number serves.
        scale = jnp.where(jnp.isfinite(scale), scale, 1.0)
        if self.scale == FLOORED:
            scale = jnp.maximum(scale, 1.0)
        return reweighted(model, start, first, weights, self.options, scale=scale)
