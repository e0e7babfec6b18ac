"""What lies between a satellite's clock and a pseudorange: Earth rotation, ionosphere, troposphere.

Plain NumPy formulas, broadcast over any axes, each with the document that it is taken from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import BDT_BEHIND_GPS_S, EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S

# Saastamoinen (1972) with the standard atmosphere: sea level, 15 degrees Celsius, lapse 6.5 K/km.
SEA_LEVEL_PRESSURE_HPA = 1013.25
SEA_LEVEL_TEMPERATURE_K = 288.16
LAPSE_RATE_K_M = 6.5e-3
RELATIVE_HUMIDITY = 0.7

# Heights between which the standard atmosphere is used as it stands; outside it there is no delay.
TROPOSPHERE_FLOOR_M, TROPOSPHERE_CEILING_M = -100.0, 1e4

SECONDS_PER_DAY = 86_400.0

# BDS-SIS-ICD-2.1, 5.2.4.7: mean radius of the Earth and height of the ionosphere.
BDS_EARTH_RADIUS_M, BDS_SHELL_HEIGHT_M = 6_378_000.0, 375_000.0


def klobuchar_delay_m(
    *,
    time_gps_s: ArrayLike,
    latitude_rad: ArrayLike,
    longitude_rad: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
) -> NDArray[np.float64]:
    """Ionospheric delay of GPS L1 by the broadcast model (IS-GPS-200, 20.3.3.5.2.5, figure 20-4) [m].

    The formulas of the document count angles in semicircles.

    Args:
        time_gps_s: GPS time [s since 1980-01-06].
        latitude_rad, longitude_rad: geodetic position of the user [rad].
        azimuth_rad, elevation_rad: direction of the satellite [rad].
        alpha, beta: (4,), coefficients of amplitude and period, in seconds over powers of a semicircle.
    """
    elevation = np.asarray(elevation_rad, float) / np.pi
    azimuth = np.asarray(azimuth_rad, float)
    alpha, beta = np.asarray(alpha, float), np.asarray(beta, float)
    earth_angle = 0.0137 / (elevation + 0.11) - 0.022
    latitude = np.clip(np.asarray(latitude_rad, float) / np.pi + earth_angle * np.cos(azimuth), -0.416, 0.416)
    longitude = np.asarray(longitude_rad, float) / np.pi + earth_angle * np.sin(azimuth) / np.cos(latitude * np.pi)
    geomagnetic = latitude + 0.064 * np.cos((longitude - 1.617) * np.pi)
    local_s = np.mod(43_200.0 * longitude + np.asarray(time_gps_s, float), SECONDS_PER_DAY)
    slant = 1.0 + 16.0 * (0.53 - elevation) ** 3
    amplitude_s = np.maximum(_cubic(alpha, geomagnetic), 0.0)
    period_s = np.maximum(_cubic(beta, geomagnetic), 72_000.0)
    phase = 2 * np.pi * (local_s - 50_400.0) / period_s
    wave = np.where(np.abs(phase) < 1.57, amplitude_s * (1 - phase**2 / 2 + phase**4 / 24), 0.0)
    return SPEED_OF_LIGHT_M_S * slant * (5e-9 + wave)


def bds_klobuchar_delay_m(
    *,
    time_gps_s: ArrayLike,
    latitude_rad: ArrayLike,
    longitude_rad: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
) -> NDArray[np.float64]:
    """Ionospheric delay of BeiDou B1I by the model that BeiDou broadcasts (BDS-SIS-ICD-2.1, 5.2.4.7) [m].

    Klobuchar's cosine over a shell at 375 km, in powers of the geographic latitude of the point in it.

    Args:
        time_gps_s: GPS time [s since 1980-01-06]; BeiDou time is 14 s behind.
        latitude_rad, longitude_rad: geodetic position of the user [rad].
        azimuth_rad, elevation_rad: direction of the satellite [rad].
        alpha, beta: (4,), coefficients of amplitude and period, in seconds over powers of a semicircle.
    """
    latitude, elevation = np.asarray(latitude_rad, float), np.asarray(elevation_rad, float)
    azimuth = np.asarray(azimuth_rad, float)
    sine_at_point = BDS_EARTH_RADIUS_M / (BDS_EARTH_RADIUS_M + BDS_SHELL_HEIGHT_M) * np.cos(elevation)
    earth_angle = np.pi / 2 - elevation - np.arcsin(sine_at_point)
    sine = np.sin(latitude) * np.cos(earth_angle) + np.cos(latitude) * np.sin(earth_angle) * np.cos(azimuth)
    point_latitude = np.arcsin(np.clip(sine, -1.0, 1.0))
    turn = np.clip(np.sin(earth_angle) * np.sin(azimuth) / np.cos(point_latitude), -1.0, 1.0)
    longitude = np.asarray(longitude_rad, float) + np.arcsin(turn)
    bdt_s = np.asarray(time_gps_s, float) - BDT_BEHIND_GPS_S
    local_s = np.mod(bdt_s + longitude / np.pi * SECONDS_PER_DAY / 2, SECONDS_PER_DAY)
    powers_of = np.abs(point_latitude) / np.pi
    amplitude_s = np.maximum(_cubic(np.asarray(alpha, float), powers_of), 0.0)
    period_s = np.clip(_cubic(np.asarray(beta, float), powers_of), 72_000.0, 172_800.0)
    phase = local_s - 50_400.0
    wave = np.where(np.abs(phase) < period_s / 4, amplitude_s * np.cos(2 * np.pi * phase / period_s), 0.0)
    return SPEED_OF_LIGHT_M_S * (5e-9 + wave) / np.sqrt(1 - sine_at_point**2)


def troposphere_delay_m(
    *, latitude_rad: ArrayLike, height_m: ArrayLike, elevation_rad: ArrayLike, humidity: float = RELATIVE_HUMIDITY
) -> NDArray[np.float64]:
    """Tropospheric delay by Saastamoinen's model with the standard atmosphere [m].

    Hydrostatic part with the gravity term of Davis et al. (1985) in latitude and height, wet part from the
    temperature and vapour pressure at that height, both over the cosine of the zenith distance. The height is
    taken as that above sea level: the geoid's 100 m at most change the delay by about 1 percent.

    Args:
        latitude_rad: geodetic latitude [rad].
        height_m: height; below 0 the sea-level atmosphere, below -100 m or above 10 km no delay [m].
        elevation_rad: elevation; no delay at or below the horizon [rad].
        humidity: relative humidity, 0 to 1.
    """
    latitude, elevation = np.asarray(latitude_rad, float), np.asarray(elevation_rad, float)
    given = np.asarray(height_m, float)
    inside = (given >= TROPOSPHERE_FLOOR_M) & (given <= TROPOSPHERE_CEILING_M) & (elevation > 0)
    height = np.clip(given, 0.0, TROPOSPHERE_CEILING_M)
    pressure_hpa = SEA_LEVEL_PRESSURE_HPA * (1 - 2.2557e-5 * height) ** 5.2568
    temperature_k = SEA_LEVEL_TEMPERATURE_K - LAPSE_RATE_K_M * height
    vapour_hpa = 6.108 * humidity * np.exp((17.15 * temperature_k - 4684.0) / (temperature_k - 38.45))
    hydrostatic_m = 0.0022768 * pressure_hpa / (1 - 0.00266 * np.cos(2 * latitude) - 0.00028 * height / 1e3)
    wet_m = 0.002277 * (1255.0 / temperature_k + 0.05) * vapour_hpa
    return np.where(inside, (hydrostatic_m + wet_m) / np.sin(np.where(inside, elevation, np.pi / 2)), 0.0)


def line_of_sight(satellite_m: ArrayLike, receiver_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Geometric range [m] and unit vector from receiver to satellite, with the Earth's rotation while in flight.

    The satellite's position is given in the Earth-fixed axes of the time of transmission; those axes turn about
    the pole while the signal travels (IS-GPS-200, 20.3.3.4.3.3.2). The position is turned back into the axes of
    the time of reception.

    Args:
        satellite_m: (..., 3), positions at transmission [m].
        receiver_m: (..., 3), positions at reception [m].

    Returns:
        The range (...) and the unit vector (..., 3) in the axes at reception.
    """
    satellite, receiver = np.asarray(satellite_m, float), np.asarray(receiver_m, float)
    turned = satellite
    # Each pass shrinks the error of the travel time by rotation speed over c, about 1e-6: two give rounding error.
    for _ in range(2):
        flight_s = np.linalg.norm(turned - receiver, axis=-1) / SPEED_OF_LIGHT_M_S
        cos, sin = np.cos(EARTH_ROTATION_RAD_S * flight_s), np.sin(EARTH_ROTATION_RAD_S * flight_s)
        x, y, z = np.moveaxis(satellite, -1, 0)
        turned = np.stack([cos * x + sin * y, cos * y - sin * x, z + 0 * cos], axis=-1)
    difference = turned - receiver
    range_m = np.linalg.norm(difference, axis=-1)
    return range_m, difference / range_m[..., None]


def _cubic(coefficients: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.polynomial.polynomial.polyval(at, coefficients), dtype=np.float64)
