"""Noise and multipath of airborne receivers, RTCA DO-229, appendix J.2.4, as functions of the elevation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Standard deviation of noise and divergence of equipment of the better class (AAD-A) at the least signal [m].
NOISE_AAD_A_M = 0.36


def multipath_sigma_m(elevation_rad: ArrayLike) -> NDArray[np.float64]:
    """0.13 + 0.53 exp(-E / 10 deg), of smoothed code on the airframe [m].

    Args:
        elevation_rad: elevations (...) [rad].
    """
    return 0.13 + 0.53 * np.exp(-np.degrees(np.asarray(elevation_rad, dtype=float)) / 10.0)


def aad_a_sigma_m(elevation_rad: ArrayLike) -> NDArray[np.float64]:
    """Noise and multipath together of a receiver of class AAD-A [m].

    Args:
        elevation_rad: elevations (...) [rad].
    """
    return np.hypot(NOISE_AAD_A_M, multipath_sigma_m(elevation_rad))
