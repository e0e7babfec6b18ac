"""Robust estimates by reweighting: the M-estimates, which differ in their weight function alone, L1 and MM.

Protection levels of M-estimates are those of Zhao et al. 2021, eqs 17-19, with the weight function w of the method
in the place of IGG-III's. With P_bar = P diag(w) of the last solution, V its residuals and
m_R^2 = V' P_bar V / (n - t), the variance of the position is taken as m_R^2 (A' P_bar A)^-1:

    VPL_R = K_V m_R sqrt(((A' P_bar A)^-1)_UU),   HPL_R = K_H m_R sqrt(((A' P_bar A)^-1)_EE + (...)_NN).

That is the variance of a weighted least-squares solution whose weights were known before; it is not the asymptotic
variance of an M-estimate (Huber 1981, section 7.6).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import jax.numpy as jnp
from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_choice
from pl_mc.kernels import (
    Estimate,
    IrlsOptions,
    LeastSquaresSolution,
    LinearModel,
    WeightFunction,
    irls,
    protection_levels,
)
from pl_mc.kernels.linear_model import COORDINATES, per_lane, product
from pl_mc.kernels.reweighting import reweighted
from pl_mc.kernels.s_estimate import SOptions, s_estimate
from pl_mc.kernels.weights import DanishWeight, HampelWeight, HuberWeight, Igg3Weight, L1Weight, TukeyWeight
from pl_mc.methods.base import Estimator, Outcome, outcome_of
from pl_mc.methods.raim_levels import at_dof, require_risks, thresholds

GATES = ("weighted", "unweighted", "ls")
FLOORED, BARE = "s_floored", "s"
SCALES = (FLOORED, BARE)


@dataclass(frozen=True)
class MEstimator(Estimator, ABC):
    """An M-estimate by reweighting; the options are explained at `pl_mc.kernels.IrlsOptions`.

    Attributes:
        iterations: reweighted solutions after the least-squares one.
        scale: scale of the residuals: ``posterior_floored``, ``apriori``, ``posterior``, ``mad`` or
            ``mad_floored``.
        cofactor: N of the residuals' standard deviations: ``fault_free``, ``reweighted`` or ``none``.
        redundancy: divisor of the unit-weight error: ``all``, ``kept`` or ``weights``.
        start: first solution: ``ls``, or ``huber`` for five solutions with Huber's weights.
        weight_floor: smallest weight factor; above zero no satellite is thrown out.
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    iterations: int = 10
    scale: str = "posterior_floored"
    cofactor: str = "fault_free"
    redundancy: str = "all"
    start: str = "ls"
    weight_floor: float = 0.0
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
            self.weight, self.iterations, self.scale, self.cofactor, self.redundancy, self.start, self.weight_floor
        )

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        return irls(model, start, self.options)


@dataclass(frozen=True)
class Igg3(MEstimator):
    """IGG-III reweighting (Zhao et al. 2021, eqs 6, 7): full weight up to k0, falling to zero at k1.

    Iterations, scale, start and so on are options that all M-estimates have: `pl_mc.methods.MEstimator`.

    Attributes:
        k0, k1: standardised residuals where the weight begins to fall and where it reaches zero.
    """

    k0: float = 1.5
    k1: float = 5.0

    key = "igg3"

    @property
    def weight(self) -> Igg3Weight:
        return Igg3Weight(self.k0, self.k1)


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

    p_fa: float = 1e-3
    gate: str = "weighted"

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
        levels = protection_levels(estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        rejects = estimate.available & (self._square_sum(model, start, estimate) > prepared)
        return replace(outcome_of(estimate, levels), rejects=rejects)

    def _square_sum(self, model: LinearModel, start: LeastSquaresSolution, estimate: Estimate) -> Array:
        if self.gate == "ls":
            return start.square_sum
        whitened = estimate.residuals_m * per_lane(model.weight_root, estimate.residuals_m)
        squares = whitened * whitened
        return product(model.mask_row, estimate.weights * squares if self.gate == "weighted" else squares)[0]


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


@dataclass(frozen=True)
class L1(Estimator):
    """The position with the smallest sum of |residual| / sigma, by weights 1 / max(|u|, eps) (Schlossmacher 1973).

    Residuals are standardised with sigma itself: t of them vanish at the minimum, and a scale would change nothing.

    With these weights V' P_bar V of Zhao et al. 2021, eq 17, is the sum of the absolute residuals. But N_bar^-1,
    N_bar = A' P_bar A, goes to zero with eps, since t residuals vanish and their satellites get weights of 1 / eps:
    eqs 18 and 19 would protect nothing. The levels therefore have the asymptotic variance of least absolute
    residuals under normal errors (Bassett & Koenker 1978), pi/2 s^2 (A'PA)^-1, with the s that belongs to the mean
    absolute residual, s = sqrt(pi/2) sum |u| / (n - t):

        VPL = K_V pi/2 (sum |u| / (n - t)) sqrt(((A'PA)^-1)_UU), and HPL likewise.

    Attributes:
        iterations: reweighted solutions after the least-squares one. They come near slowly where two sets of t
            satellites fit almost equally well.
        eps: absolute residual, in units of sigma, below which the weight grows no more; the sum is within n eps / 2
            of the smallest.
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    key = "l1"

    iterations: int = 50
    eps: float = 1e-4
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.options

    @property
    def options(self) -> IrlsOptions:
        """The kernel's view of these options."""
        return IrlsOptions(L1Weight(self.eps), self.iterations, scale="apriori", cofactor="none")

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        """With pi/2 times the mean absolute residual for a unit error, and the cofactors of least squares."""
        estimate = irls(model, start, self.options)
        absolute = jnp.abs(estimate.residuals_m) * per_lane(model.weight_root, estimate.residuals_m)
        mean = jnp.sum(absolute, axis=0) / jnp.maximum(model.dof, 1)
        cofactor = per_lane(model.cofactor[:COORDINATES], estimate.cofactor_m2)
        return replace(
            estimate,
            unit_error=jnp.where(estimate.available, 0.5 * math.pi * mean, jnp.inf),
            cofactor_m2=jnp.where(estimate.available, cofactor, jnp.inf),
        )


@dataclass(frozen=True)
class MM(Estimator):
    """An S-estimate, then Tukey's weights from its residuals with its scale, which stays fixed (Yohai 1987).

    The S-estimate withstands close to (n - t) / 2 faulted satellites, as far as its few starts find it (see
    `pl_mc.kernels.s_estimate`); the second part gives the efficiency of its constant c. The variance of the levels
    is that of `pl_mc.methods.m_estimator`, with the weights of the last solution.

    Attributes:
        c: standardised residual where the weight reaches zero; 4.685 keeps 95 % of the efficiency of least squares
            under normal errors.
        iterations: reweighted solutions after the S-estimate.
        s_steps: reweighted solutions of the S-estimate from each of its starts.
        scale: ``s_floored`` max(1, s), s the scale of the S-estimate in units of sigma; or ``s`` itself.
        cofactor: N of the residuals' standard deviations in the second part: ``fault_free``, ``reweighted`` or
            ``none``.
        redundancy: divisor of the unit-weight error: ``all``, ``kept`` or ``weights``.
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    key = "mm"

    c: float = 4.685
    iterations: int = 10
    s_steps: int = 10
    scale: str = FLOORED
    cofactor: str = "fault_free"
    redundancy: str = "all"
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
        return IrlsOptions(weight, self.iterations, cofactor=self.cofactor, redundancy=self.redundancy)

    def _estimate(self, model: LinearModel, start: LeastSquaresSolution) -> Estimate:
        first, weights, scale = s_estimate(model, start, SOptions(self.s_steps))
        # Without a scale there is no solution either, and any finite number serves.
        scale = jnp.where(jnp.isfinite(scale), scale, 1.0)
        if self.scale == FLOORED:
            scale = jnp.maximum(scale, 1.0)
        return reweighted(model, start, first, weights, self.options, scale=scale)
