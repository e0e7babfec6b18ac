"""Protection levels from the posterior variance of a solution (Zhao et al. 2021, eqs 12-19)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels.estimate import Estimate

POSTERIOR, FLOORED, APRIORI = "posterior", "floored", "apriori"
LEVEL_SCALES = (POSTERIOR, FLOORED, APRIORI)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ProtectionLevels:
    """Horizontal and vertical protection levels (...) [m]; infinite where the solution is not available."""

    hpl_m: Array
    vpl_m: Array


def protection_levels(
    estimate: Estimate,
    *,
    k_horizontal: float = K_HORIZONTAL,
    k_vertical: float = K_VERTICAL,
    level_scale: str = POSTERIOR,
    apriori: float = 1.0,
) -> ProtectionLevels:
    """HPL = K_H m HDOP and VPL = K_V m VDOP, the "DOPs" from (A' P_bar A)^-1 and therefore in metres.

    Of a least-squares estimate these are HPL and VPL (eqs 14-16); of a robust one the rebuilt HPL_R and VPL_R
    (eqs 17-19). ``level_scale`` says what stands for m: ``posterior``, the unit-weight error of the estimate;
    ``floored``, that or ``apriori`` if it is larger; ``apriori`` itself, the unit-weight error that the sigma of the
    model lead to expect.
    """
    east, north, up = estimate.cofactor_m2
    if level_scale != POSTERIOR:
        # Infinite where there is no solution, whatever the scale.
        scale = jnp.maximum(estimate.unit_error, apriori) if level_scale == FLOORED else jnp.asarray(apriori)
        estimate = replace(estimate, unit_error=jnp.where(estimate.available, scale, jnp.inf))
    return ProtectionLevels(
        hpl_m=k_horizontal * estimate.unit_error * jnp.sqrt(east + north),
        vpl_m=k_vertical * estimate.unit_error * jnp.sqrt(up),
    )
