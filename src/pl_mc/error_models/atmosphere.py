"""Ionosphere and troposphere: the standard deviations of RTCA DO-229 as functions of the line of sight.

Formulas alone, in NumPy; which of them a model uses, and with what figures, is decided in the files beside this.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import EARTH_RADIUS_DO229_M, IONOSPHERE_SHELL_HEIGHT_M

# RTCA DO-229, appendix A.4.2: standard deviation of the vertical tropospheric delay that the model leaves.
ZENITH_TROPOSPHERE_M = 0.12


def obliquity(elevation_rad: ArrayLike, earth_radius_m: float = EARTH_RADIUS_DO229_M) -> NDArray[np.float64]:
    """Slant over vertical ionospheric delay for a thin shell at 350 km, 1 at the zenith.

    ``1 / sqrt(1 - (R cos E / (R + h))^2)``, RTCA DO-229, appendix A.4.4.10.

    Args:
        elevation_rad: elevations (...) [rad].
        earth_radius_m: radius of the Earth; some programs take the mean one, 6371 km, for 0.04 % less at 5 deg [m].
    """
    ratio = earth_radius_m / (earth_radius_m + IONOSPHERE_SHELL_HEIGHT_M)
    return 1.0 / np.sqrt(1.0 - (ratio * np.cos(np.asarray(elevation_rad, dtype=float))) ** 2)


def troposphere_sigma_m(elevation_rad: ArrayLike, zenith_m: float = ZENITH_TROPOSPHERE_M) -> NDArray[np.float64]:
    """Standard deviation of the residual tropospheric delay [m].

    ``zenith * 1.001 / sqrt(0.002001 + sin^2 E)``, RTCA DO-229, appendix A.4.2.
    Exactly ``zenith_m`` at the zenith, since 1.001^2 = 1.002001.

    Args:
        elevation_rad: elevations (...) [rad].
        zenith_m: standard deviation at the zenith [m].
    """
    return zenith_m * 1.001 / np.sqrt(0.002001 + np.sin(np.asarray(elevation_rad, dtype=float)) ** 2)


def pierce_point_geomagnetic_latitude_rad(
    elevation_rad: ArrayLike, azimuth_rad: ArrayLike, latitude_rad: ArrayLike, longitude_rad: ArrayLike
) -> NDArray[np.float64]:
    """Geomagnetic latitude of the ionospheric pierce point, as the broadcast GPS model approximates it [rad].

    IS-GPS-200, section 20.3.3.5.2.5: Earth angle, latitude of the pierce point (held within 0.416 semicircles),
    its longitude, and the geomagnetic latitude, all in semicircles there.

    Args:
        elevation_rad, azimuth_rad: direction of the satellite [rad].
        latitude_rad, longitude_rad: geodetic position of the user [rad].
    """
    azimuth = np.asarray(azimuth_rad, dtype=float)
    elevation, user_latitude, user_longitude = (
        np.asarray(angle, dtype=float) / np.pi for angle in (elevation_rad, latitude_rad, longitude_rad)
    )
    earth_angle = 0.0137 / (elevation + 0.11) - 0.022
    latitude = np.clip(user_latitude + earth_angle * np.cos(azimuth), -0.416, 0.416)
    longitude = user_longitude + earth_angle * np.sin(azimuth) / np.cos(latitude * np.pi)
    return np.pi * (latitude + 0.064 * np.cos((longitude - 1.617) * np.pi))


def vertical_uire_sigma_m(geomagnetic_latitude_rad: ArrayLike) -> NDArray[np.float64]:
    """Standard deviation of the vertical ionospheric delay that the broadcast GPS model leaves [m].

    9 m up to 20 degrees of geomagnetic latitude, 4.5 m up to 55 degrees, 6 m beyond; RTCA DO-229, appendix J. The
    standard also takes a fifth of the broadcast delay where that is larger; a nominal sky has no broadcast delay,
    so that branch is left out.

    Args:
        geomagnetic_latitude_rad: geomagnetic latitude of the pierce point (...) [rad].
    """
    degrees = np.abs(np.degrees(np.asarray(geomagnetic_latitude_rad, dtype=float)))
    return np.where(degrees <= 20.0, 9.0, np.where(degrees <= 55.0, 4.5, 6.0))
