"""Protection levels from the posterior variance of a solution (Zhao et al. 2021, eqs 12-19)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels.estimate import Estimate


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ProtectionLevels:
    """Horizontal and vertical protection levels (...) [m]; infinite where the solution is not available."""

    hpl_m: Array
    vpl_m: Array


def protection_levels(
    estimate: Estimate, *, k_horizontal: float = K_HORIZONTAL, k_vertical: float = K_VERTICAL
) -> ProtectionLevels:
    """HPL = K_H m HDOP and VPL = K_V m VDOP, the "DOPs" from (A' P_bar A)^-1 and therefore in metres.

    Of a least-squares estimate these are HPL and VPL (eqs 14-16); of a robust one the rebuilt HPL_R and VPL_R
    (eqs 17-19).
    """
    east, north, up = estimate.cofactor_m2
    return ProtectionLevels(
        hpl_m=k_horizontal * estimate.unit_error * jnp.sqrt(east + north),
        vpl_m=k_vertical * estimate.unit_error * jnp.sqrt(up),
    )
