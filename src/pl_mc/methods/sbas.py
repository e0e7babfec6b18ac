"""Least squares with the protection levels of a satellite-based augmentation system: a-priori sigma, no test."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from pl_mc.constants import K_VERTICAL
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import covariance_of
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.kernels.parameters import traced
from pl_mc.methods.base import Named, Outcome, require_multipliers
from pl_mc.methods.raim_levels import decided, sigma_levels

# RTCA DO-229, appendix J: K_H of precision approach; K_H of less precise operations is 6.18, K_V is 5.33.
K_HORIZONTAL_APPROACH = 6.0


@traced
@dataclass(frozen=True)
class Sbas(Named):
    """HPL = K_H d_major and VPL = K_V d_U (RTCA DO-229, appendix J), with the variances of N^-1 = (A'PA)^-1.

    d_major^2 = (d_E^2 + d_N^2) / 2 + sqrt(((d_E^2 - d_N^2) / 2)^2 + d_EN^2). The model's own sigma takes the place
    of what an augmentation system sends. The levels know nothing of the residuals, and nothing is rejected: that no
    satellite is faulted is for the system's ground segment to say. An alarm means that the geometry is too weak for
    VAL, whatever the errors are. With as many satellites as unknowns the levels stand too, as those of the standard do.

    Attributes:
        k_horizontal, k_vertical: multipliers; those of precision approach unless given (6.18 horizontally
            otherwise).
    """

    key = "sbas"

    k_horizontal: float = K_HORIZONTAL_APPROACH
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        require_multipliers(self)

    scales_with_k = "k_vertical"
    levels_from_geometry = True
    levels_without_redundancy = True

    def prepare(self, model: LinearModel) -> ProtectionLevels:
        covariance = covariance_of(model.gain[:COORDINATES])
        return sigma_levels(covariance, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)

    def solve(self, model: LinearModel, prepared: ProtectionLevels, start: LeastSquaresSolution) -> Outcome:
        nothing = jnp.zeros(start.square_sum.shape, bool)
        return decided(model.determined, start.state[:COORDINATES], prepared, nothing)
