"""Least squares with the chi-square test and protection levels from the largest slope."""

from __future__ import annotations

from dataclasses import dataclass

from jax import Array

from pl_mc.input_errors import require_choice
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import before_observations, projections, slopes
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.methods.base import Outcome, name_with_options
from pl_mc.methods.raim_levels import (
    FORMS,
    NONCENTRAL,
    P_FA,
    P_MD,
    at_dof,
    decided,
    require_risks,
    slope_levels,
    thresholds,
)


@dataclass(frozen=True)
class Slope:
    """Slope-based RAIM: V'PV > T rejects, PL = largest slope times a protected size of the fault.

    slope_q,i = |G_q,i| / sqrt(r_i) in units of sigma_i, G = N^-1 A' and r the redundancy numbers (Parkinson &
    Axelrad 1988 for the test; Brown & Chin 1994 for the parity bias; Walter & Enge 1995 for weights). The forms and
    what each bounds are in `pl_mc.methods.raim_levels`. The levels depend on the geometry alone: a fault shows in
    the test.

    An alarm means that V'PV exceeds the threshold, or that the geometry could not protect VAL. Where a satellite
    moves the position and nothing checks it the slope is infinite and there is no solution.

    Attributes:
        p_fa: false-alarm probability of the test, for each sample: 0.002 an hour over two minutes.
        p_md: probability with which the test may miss a fault that the level protects against.
        form: ``noncentral``, ``arp``, ``line``, ``noncentral_noise`` or ``arp_noise``.
    """

    p_fa: float = P_FA
    p_md: float = P_MD
    form: str = NONCENTRAL

    def __post_init__(self) -> None:
        require_risks("slope", p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.form, FORMS, field="slope: form")

    @property
    def name(self) -> str:
        return name_with_options("slope", self, Slope())

    levels_from_geometry = True

    def prepare(self, model: LinearModel) -> tuple[Array, ProtectionLevels]:
        """Threshold and levels."""
        most = model.design.shape[0]
        parts = projections(model)
        whole = before_observations(model, parts)
        levels = slope_levels(
            slopes(parts, whole), whole.covariance_m2, model.dof,
            most=most, p_fa=self.p_fa, p_md=self.p_md, form=self.form,
        )  # fmt: skip
        return at_dof(thresholds(most, self.p_fa), model.dof), levels

    def statistic(
        self, model: LinearModel, prepared: tuple[Array, ProtectionLevels], start: LeastSquaresSolution
    ) -> Array:
        return start.square_sum / prepared[0]

    def solve(
        self, model: LinearModel, prepared: tuple[Array, ProtectionLevels], start: LeastSquaresSolution
    ) -> Outcome:
        threshold, levels = prepared
        return decided(model.available, start.state[:COORDINATES], levels, start.square_sum > threshold)
