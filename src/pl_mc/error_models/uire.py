"""The model ``uire``: equation 3 with the user ionospheric range error of RTCA DO-229.

An upper bound for single-frequency users without corrections, not a model of noise: protection levels made with it
are far larger than those of ``residual``, and errors drawn from it are too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.error_models.atmosphere import (
    ZENITH_TROPOSPHERE_M,
    obliquity,
    pierce_point_geomagnetic_latitude_rad,
    troposphere_sigma_m,
    vertical_uire_sigma_m,
)
from pl_mc.error_models.base import Sky, require_options
from pl_mc.error_models.equation3 import PAPER_SIGMA0, Sigma0


@dataclass(frozen=True)
class Uire:
    """Equation 3 with sigma_UIRE by the geomagnetic latitude of each pierce point, and the DO-229 troposphere.

    Attributes:
        name: ``uire``.
        sigma0: the first term of the equation.
    """

    name: str = "uire"
    sigma0: Sigma0 = PAPER_SIGMA0

    def sigma_m(self, sky: Sky) -> NDArray[np.float64]:
        """Standard deviation of each pseudorange error, in the shape of ``sky`` [m].

        Raises:
            InputError: what `Sky.checked` refuses; an elevation of 0 or less among it.
        """
        sky = sky.checked()
        geomagnetic = pierce_point_geomagnetic_latitude_rad(
            sky.elevation_rad, sky.azimuth_rad, sky.latitude_rad, sky.longitude_rad
        )
        ionosphere = vertical_uire_sigma_m(geomagnetic) * obliquity(sky.elevation_rad)
        troposphere = troposphere_sigma_m(sky.elevation_rad)
        return np.sqrt(self.sigma0.variance_m2(sky) + ionosphere**2 + troposphere**2)

    def describe(self) -> dict[str, Any]:
        """Name and every figure of the model."""
        return {
            "name": self.name,
            "vertical_ionosphere": "DO-229 sigma_UIRE: 9, 4.5, 6 m to 20, 55, 90 deg of geomagnetic latitude",
            "zenith_troposphere_m": ZENITH_TROPOSPHERE_M,
            **self.sigma0.describe(),
        }


def uire(**options: Any) -> Uire:
    """The bound of DO-229 for single-frequency users. No options."""
    require_options("uire", options, ())
    return Uire()
