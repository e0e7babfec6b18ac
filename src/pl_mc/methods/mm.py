"""The MM-estimate: Tukey's biweight with the scale of a highly robust solution (Yohai 1987)."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_choice, require_positive
from pl_mc.kernels import IrlsOptions, LeastSquaresSolution, LinearModel, TukeyWeight, protection_levels
from pl_mc.kernels.reweighting import reweighted
from pl_mc.kernels.s_estimate import SOptions, s_estimate
from pl_mc.methods.base import Outcome, name_with_options, outcome_of

FLOORED, BARE = "s_floored", "s"
SCALES = (FLOORED, BARE)


@dataclass(frozen=True)
class MM:
    """An S-estimate, then Tukey's weights from its residuals with its scale, which stays fixed.

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

    c: float = 4.685
    iterations: int = 10
    s_steps: int = 10
    scale: str = FLOORED
    cofactor: str = "fault_free"
    redundancy: str = "all"
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        for field in ("k_horizontal", "k_vertical"):
            require_positive(getattr(self, field), field=f"mm: {field}")
        require_choice(self.scale, SCALES, field="mm: scale")
        _ = self.options, SOptions(self.s_steps)

    @property
    def name(self) -> str:
        return name_with_options("mm", self, MM())

    @property
    def options(self) -> IrlsOptions:
        """The kernel's view of the second part."""
        return IrlsOptions(
            weight=TukeyWeight(self.c),
            iterations=self.iterations,
            cofactor=self.cofactor,
            redundancy=self.redundancy,
        )

    scales_with_k = "k_vertical"

    def prepare(self, model: LinearModel) -> tuple[()]:
        return ()

    def solve(self, model: LinearModel, prepared: tuple[()], start: LeastSquaresSolution) -> Outcome:
        first, weights, scale = s_estimate(model, start, SOptions(self.s_steps))
        # Without a scale there is no solution either, and any finite number serves.
        scale = jnp.where(jnp.isfinite(scale), scale, 1.0)
        if self.scale == FLOORED:
            scale = jnp.maximum(scale, 1.0)
        estimate = reweighted(model, start, first, weights, self.options, scale=scale)
        levels = protection_levels(estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        return outcome_of(estimate, levels)
