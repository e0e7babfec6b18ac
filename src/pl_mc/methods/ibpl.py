"""The isotropy-based protection level: no sigma, only the length of the residuals and a symmetry of the errors."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import covariance_of
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.methods.base import Named, Outcome
from pl_mc.methods.raim_levels import at_dof, decided, require_risks, sigma_levels


@dataclass(frozen=True)
class Ibpl(Named):
    """HPL = k_2 |r| d_major and VPL = k_1 |r| d_U (US patent 8,203,482; Azaola et al. 2009, ION GNSS).

    r are the whitened residuals of least squares. If the whitened error vector of n satellites has no preferred
    direction, then of its n - t directions in the residuals and m directions that move m components of the position
    none is likelier than another, and the ratio of their lengths has a known law, whatever the length of the whole is.
    With dof = n - t, k_m is where that ratio is exceeded with probability alpha,

        k_1 = Student's quantile of alpha / 2 over sqrt(dof),   k_2 = sqrt(alpha^(-2 / dof) - 1),

    the closed forms of the patent's integral over the m-ball. VPL is then exact, HPL holds alpha with d_major, the
    longest half axis of the horizontal cofactor, in the place of both axes. A fault on few satellites has a direction:
    then nothing is promised. The vertical level is that of ``ls`` with Student's quantile for K.

    Attributes:
        alpha_vertical, alpha_horizontal: probabilities that the errors exceed their levels; those for which the
            multipliers 5.33 and 6.18 stand unless given.
    """

    key = "ibpl"

    alpha_vertical: float = 1e-7
    alpha_horizontal: float = 5e-9

    def __post_init__(self) -> None:
        require_risks("ibpl", alpha_vertical=self.alpha_vertical, alpha_horizontal=self.alpha_horizontal)

    def prepare(self, model: LinearModel) -> ProtectionLevels:
        """Levels for residuals of length one."""
        n = model.design.shape[0]
        horizontal, vertical = _factors(n, self.alpha_vertical, self.alpha_horizontal)
        unit = sigma_levels(covariance_of(model.gain[:COORDINATES]), k_horizontal=1.0, k_vertical=1.0)
        return ProtectionLevels(
            hpl_m=at_dof(horizontal, model.dof) * unit.hpl_m, vpl_m=at_dof(vertical, model.dof) * unit.vpl_m
        )

    def solve(self, model: LinearModel, prepared: ProtectionLevels, start: LeastSquaresSolution) -> Outcome:
        length: Array = safe_sqrt(start.square_sum)
        levels = ProtectionLevels(hpl_m=prepared.hpl_m * length, vpl_m=prepared.vpl_m * length)
        return decided(model.available, start.state[:COORDINATES], levels, jnp.zeros(length.shape, bool))


@functools.lru_cache(maxsize=64)
def _factors(most: int, alpha_vertical: float, alpha_horizontal: float) -> tuple[FloatArray, FloatArray]:
    """(2 of (most + 1,)), k_2 and k_1 by degrees of freedom; zero for none, where there is no level."""
    dof = np.arange(1, most + 1)
    vertical = -special.stdtrit(dof, alpha_vertical / 2.0) / np.sqrt(dof)
    # expm1 of the logarithm: many degrees of freedom leave a small difference.
    horizontal = np.sqrt(np.expm1(-2.0 * np.log(alpha_horizontal) / dof))
    return np.concatenate([[0.0], horizontal]), np.concatenate([[0.0], vertical])
