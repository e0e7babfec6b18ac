"""Least squares with the chi-square test and protection levels from the dilution of precision of subsets."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_choice
from pl_mc.kernels import LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import Projections, covariance_of, effect_floor, projections
from pl_mc.kernels.linear_model import COORDINATES, redundancy_floor
from pl_mc.kernels.parameters import static, traced
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.methods.base import require_multipliers
from pl_mc.methods.raim_levels import NONCENTRAL, P_FA, P_MD, ChiSquareTested, at_dof, protected_sizes, require_risks

CHANGE, SUBSET = "change", "subset"


@traced
@dataclass(frozen=True)
class MaxDop(ChiSquareTested):
    """RAIM by the largest change of the DOP, or by the largest DOP, of all sets that leave one satellite out.

    With weights the DOPs are standard deviations in metres. ``change``: delta_i = sqrt(DOP_i^2 - DOP^2), and
    PL = max delta_i times the parity bias sqrt(lambda). Since DOP_i^2 = DOP^2 + G_q,i^2 / r_i that delta is the
    slope of the satellite (Brown 1992 on the equivalence of RAIM methods), and the levels are those of ``slope``
    with ``form="noncentral"``. ``subset``: PL = K max DOP_i, the level that would still hold, fault-free, after any
    one satellite were excluded; it says nothing of what the test may miss. HDOP^2 is the sum of the east and north
    variances.

    V'PV > T rejects, T the chi-square quantile. An alarm means that, or a geometry that could not protect VAL.
    Where some set determines no position there is no solution.

    Attributes:
        p_fa: false-alarm probability of the test, for each sample.
        p_md: missed-detection probability, for ``change`` alone.
        form: ``change`` or ``subset``.
        k_horizontal, k_vertical: multipliers, for ``subset`` alone.
    """

    key = "max_dop"

    p_fa: float = static(P_FA)
    p_md: float = static(P_MD)
    form: str = static(CHANGE)
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        require_risks("max_dop", p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.form, (CHANGE, SUBSET), field="max_dop: form")
        require_multipliers(self)

    @property
    def scales_with_k(self) -> str | None:
        return "k_vertical" if self.form == SUBSET else None

    def _levels(self, model: LinearModel) -> ProtectionLevels:
        whole, subsets = dop_squared(model, projections(model))
        if self.form == SUBSET:
            largest = jnp.max(subsets, axis=1)
            factors = jnp.asarray([self.k_horizontal, self.k_vertical], largest.dtype)
        else:
            largest = jnp.max(subsets - whole[:, None], axis=1)
            size = at_dof(protected_sizes(model.design.shape[0], self.p_fa, self.p_md, NONCENTRAL), model.dof)
            factors = jnp.stack([size, size])
        finite = jnp.isfinite(largest)
        root = safe_sqrt(jnp.where(finite, largest, 1.0))
        horizontal, vertical = jnp.where(finite, root * factors, jnp.inf)
        return ProtectionLevels(hpl_m=horizontal, vpl_m=vertical)


def dop_squared(model: LinearModel, parts: Projections) -> tuple[Array, Array]:
    """(2,), HDOP^2 and VDOP^2 of all satellites, and (2, n), those without each one of them [m^2].

    Infinite for a set that determines no position. On padding, that of all.
    """
    east, north, up, _ = covariance_of(parts.rows[-COORDINATES:])
    whole = jnp.stack([east + north, up])
    moved = parts.rows[-COORDINATES:] ** 2
    effect = jnp.stack([moved[0] + moved[1], moved[2]])
    redundancy = jnp.where(parts.free, 0.0, model.redundancy)
    checked = redundancy >= redundancy_floor(redundancy.dtype)
    growth = jnp.where(checked, effect / jnp.where(checked, redundancy, 1.0), jnp.inf)
    floor = effect_floor(effect.dtype) ** 2 * whole[:, None]
    return whole, whole[:, None] + jnp.where(checked | (effect > floor), growth, 0.0)
