"""Least squares with the chi-square test and protection levels from the largest slope."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.input_errors import require_choice
from pl_mc.kernels import LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import before_observations, projections, slopes
from pl_mc.methods.raim_levels import FORMS, NONCENTRAL, P_FA, P_MD, ChiSquareTested, require_risks, slope_levels


@dataclass(frozen=True)
class Slope(ChiSquareTested):
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

    key = "slope"

    p_fa: float = P_FA
    p_md: float = P_MD
    form: str = NONCENTRAL

    def __post_init__(self) -> None:
        require_risks("slope", p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.form, FORMS, field="slope: form")

    def _levels(self, model: LinearModel) -> ProtectionLevels:
        parts = projections(model)
        whole = before_observations(model, parts)
        return slope_levels(
            slopes(parts, whole), whole.covariance_m2, model.dof, most=model.design.shape[0], p_fa=self.p_fa,
            p_md=self.p_md, form=self.form,
        )  # fmt: skip
