"""What the M-estimates have in common: everything but the weight function.

Their protection levels are those of Zhao et al. 2021, eqs 17-19, with the weight function w of the method in the
place of IGG-III's. With P_bar = P diag(w) of the last solution, V its residuals and m_R^2 = V' P_bar V / (n - t),
the variance of the position is taken as m_R^2 (A' P_bar A)^-1:

    VPL_R = K_V m_R sqrt(((A' P_bar A)^-1)_UU),   HPL_R = K_H m_R sqrt(((A' P_bar A)^-1)_EE + (...)_NN).

That is the variance of a weighted least-squares solution whose weights were known before; it is not the asymptotic
variance of an M-estimate (Huber 1981, section 7.6), which ``covariance="sandwich"`` puts in its place.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels import Estimate, IrlsOptions, LeastSquaresSolution, LinearModel, WeightFunction, irls
from pl_mc.kernels.parameters import static
from pl_mc.methods.base import Estimator


@dataclass(frozen=True)
class MEstimator(Estimator, ABC):
    """An M-estimate by reweighting; the options are explained at `pl_mc.kernels.IrlsOptions`.

    Attributes:
        iterations: reweighted solutions after the least-squares one; 36 unless given, the number that settles all but
            one draw in a thousand with ``aitken``.
        scale: scale of the residuals: ``posterior_floored``, ``apriori``, ``posterior``, ``mad`` or
            ``mad_floored``.
        cofactor: N of the residuals' standard deviations: ``fault_free``, ``reweighted`` or ``none``.
        redundancy: divisor of the unit-weight error: ``all``, ``kept`` or ``weights``.
        start: first solution: ``ls``, or ``huber`` for five solutions with Huber's weights.
        weight_floor: smallest weight factor; above zero no satellite is thrown out.
        acceleration: ``none`` or ``aitken``; ``aitken`` unless ``iterations`` is given, which alone means plain ones.
        level_scale: what multiplies the cofactors in the levels: ``posterior``, the unit-weight error of the solution;
            ``floored``, max(1, that), which the residuals of a few satellites cannot make small by chance; ``apriori``,
            1, the model's own sigma.
        covariance: of what the levels are: ``weights``, of a solution whose weights were known before; ``sandwich``,
            of the M-estimate, from its influence function (`pl_mc.kernels.sandwich`).
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    iterations: int | None = static(None)
    scale: str = static("posterior_floored")
    cofactor: str = static("fault_free")
    redundancy: str = static("all")
    start: str = static("ls")
    weight_floor: float = 0.0
    acceleration: str | None = static(None)
    level_scale: str = static("posterior")
    covariance: str = static("weights")
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    key = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        # The kernel's own records check the other values, here and not at the first trace.
        _ = self.options

    @property
    @abstractmethod
    def weight(self) -> WeightFunction:
        """The weight function, a hashable record."""

    @property
    def options(self) -> IrlsOptions:
        """The kernel's view of these options."""
        return IrlsOptions(
            self.weight, self.iterations, self.scale, self.cofactor, self.redundancy, self.start, self.weight_floor,
            self.acceleration, self.covariance,
        )  # fmt: skip

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        return irls(model, start, self.options)
