"""Equation 3 of Zhao et al. (2021): the models ``residual``, ``none``, ``user`` and ``uire``.

``sigma^2 = sigma0^2 / sin E + sigma_ion^2 + sigma_trop^2``. The paper gives sigma0 and leaves both atmospheric
terms open; the first three models differ in nothing but the figures that fill them, the last has the user
ionospheric range error of RTCA DO-229.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
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
from pl_mc.error_models.base import FromVariance, Scale, Sky, by_orbit, require_figure, require_options

# What single-frequency corrections leave of the vertical ionosphere on an ordinary day; our choice, since the
# paper is silent.
RESIDUAL_IONOSPHERE_M = 0.5


@dataclass(frozen=True)
class Sigma0:
    """The term of equation 3 that stands for orbit, satellite clock and receiver noise: sigma0 by class of orbit.

    GPS and BeiDou are the figures of the paper. Galileo and GLONASS are not in it: our choice is to treat Galileo
    as GPS, and GLONASS, with its coarser code, as the BeiDou satellites in medium orbits.

    Attributes:
        gps_m, bds_meo_m, bds_igso_m, bds_geo_m, gal_m, glo_m: sigma0 of each class of orbit [m].
    """

    gps_m: float = 0.3
    bds_meo_m: float = 0.6
    bds_igso_m: float = 0.6
    bds_geo_m: float = 1.0
    gal_m: float = 0.3
    glo_m: float = 0.6

    def __post_init__(self) -> None:
        for option in fields(self):
            value = require_figure(f"sigma0_{option.name}", getattr(self, option.name))
            object.__setattr__(self, option.name, value)

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """``sigma0^2 / sin E`` of each satellite of a checked sky [m^2]; sin E, not its square, as printed."""
        sigma0 = by_orbit(self, [option.name for option in fields(self)], sky)
        return sigma0**2 / np.sin(np.asarray(sky.elevation_rad))

    def describe(self) -> dict[str, float]:
        """The six figures, named as the options of the model ``user`` are."""
        return {f"sigma0_{key}": value for key, value in asdict(self).items()}


PAPER_SIGMA0 = Sigma0()


class _ThreeTerms(FromVariance):
    """Noise, ionosphere and troposphere; of one carrier in the band of L1 as they stand."""

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        raise NotImplementedError

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """The three terms of the equation, added [m^2]."""
        return self.scaled_variance_m2(sky, 1.0, 1.0)


@dataclass(frozen=True)
class Equation3(_ThreeTerms):
    """Equation 3 with an ionosphere and a troposphere that depend on elevation alone.

    Attributes:
        name: name of the model.
        vertical_ionosphere_m: standard deviation of the vertical ionospheric delay, times the obliquity [m].
        zenith_troposphere_m: standard deviation of the tropospheric delay at the zenith [m].
        sigma0: the first term of the equation.
    """

    name: str
    vertical_ionosphere_m: float
    zenith_troposphere_m: float
    sigma0: Sigma0 = PAPER_SIGMA0

    def __post_init__(self) -> None:
        for option in ("vertical_ionosphere_m", "zenith_troposphere_m"):
            object.__setattr__(self, option, require_figure(option, getattr(self, option), allow_zero=True))

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """The three terms of the equation, the first two scaled, added [m^2]; sigma0 counts as noise."""
        delay_m = ionosphere * self.vertical_ionosphere_m * obliquity(sky.elevation_rad)
        troposphere = troposphere_sigma_m(sky.elevation_rad, self.zenith_troposphere_m)
        return np.square(noise) * self.sigma0.variance_m2(sky) + delay_m**2 + troposphere**2

    def describe(self) -> dict[str, Any]:
        """Name and every figure of the model."""
        return {
            "name": self.name,
            "vertical_ionosphere_m": self.vertical_ionosphere_m,
            "zenith_troposphere_m": self.zenith_troposphere_m,
            **self.sigma0.describe(),
        }


def residual(**options: Any) -> Equation3:
    """What is left after correction: 0.5 m of vertical ionosphere, 0.12 m of zenith troposphere. No options."""
    require_options("residual", options, ())
    return Equation3("residual", RESIDUAL_IONOSPHERE_M, ZENITH_TROPOSPHERE_M)


def none(**options: Any) -> Equation3:
    """The sigma0 term alone, no atmosphere. No options."""
    require_options("none", options, ())
    return Equation3("none", 0.0, 0.0)


def user(**options: Any) -> Equation3:
    """Every figure as the user gives it; those not given are the ones of ``residual``.

    Args:
        options: any of ``vertical_ionosphere_m``, ``zenith_troposphere_m`` (zero or more), ``sigma0_gps_m``,
            ``sigma0_bds_meo_m``, ``sigma0_bds_igso_m``, ``sigma0_bds_geo_m``, ``sigma0_gal_m``, ``sigma0_glo_m``
            (over zero) [m].

    Raises:
        InputError: an unknown option, with the nearest names, or a figure that cannot be a standard deviation.
    """
    require_options("user", options, USER_OPTIONS)
    sigma0 = {key.removeprefix("sigma0_"): value for key, value in options.items() if key.startswith("sigma0_")}
    return Equation3(
        "user",
        options.get("vertical_ionosphere_m", RESIDUAL_IONOSPHERE_M),
        options.get("zenith_troposphere_m", ZENITH_TROPOSPHERE_M),
        Sigma0(**sigma0),
    )


USER_OPTIONS = ("vertical_ionosphere_m", "zenith_troposphere_m", *(f"sigma0_{f.name}" for f in fields(Sigma0)))


@dataclass(frozen=True)
class Uire(_ThreeTerms):
    """Equation 3 with sigma_UIRE by the geomagnetic latitude of each pierce point, and the DO-229 troposphere.

    An upper bound for single-frequency users without corrections, not a model of noise: protection levels made with
    it are far larger than those of ``residual``, and errors drawn from it are too.

    Attributes:
        name: ``uire``.
        sigma0: the first term of the equation.
    """

    name: str = "uire"
    sigma0: Sigma0 = PAPER_SIGMA0

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """The three terms of the equation, the first two scaled, added [m^2]; sigma0 counts as noise."""
        geomagnetic = pierce_point_geomagnetic_latitude_rad(
            sky.elevation_rad, sky.azimuth_rad, sky.latitude_rad, sky.longitude_rad
        )
        delay_m = ionosphere * vertical_uire_sigma_m(geomagnetic) * obliquity(sky.elevation_rad)
        troposphere = troposphere_sigma_m(sky.elevation_rad)
        return np.square(noise) * self.sigma0.variance_m2(sky) + delay_m**2 + troposphere**2

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
