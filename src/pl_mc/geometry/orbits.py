"""Orbits: where the satellites of slots are, in Earth-fixed coordinates.

Circles about a point mass in planes that stand still in inertial space, or the ellipses and slowly turning planes
of an almanac; the Earth turns below by Greenwich mean sidereal time. Geosynchronous satellites are held in step
with that rotation, as station keeping holds the real ones, so that they cross the equator at their longitude for
ever. Oblateness, signal travel time and the rotation of the Earth during it are left out: they move a line of
sight by far less than a nominal orbit is off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.constants import EARTH_GM_M3_S2
from pl_mc.geometry.constellations import Slot
from pl_mc.geometry.gps_time import gmst_rad
from pl_mc.input_errors import InputError, require_list, require_numbers, require_true, shown

# A navigation satellite is between 1.9e7 m (medium orbit) and 4.6e7 m (apogee of QZSS) from the Earth's centre; what
# says otherwise is damaged.
ORBIT_RADIUS_M = (1.9e7, 4.6e7)

# BeiDou: synchronous orbits have a semi-major axis of 42,164 km, medium ones 27,906 km; geostationary ones are
# inclined by under 10 degrees, the inclined ones by 55 (BDS-SIS-ICD-2.1, section 3.1).
_SYNCHRONOUS_RADIUS_M = 3.5e7
_GEO_INCLINATION_RAD = np.radians(20.0)

# Newton steps of Kepler's equation: from the mean anomaly four reach 1e-15 for eccentricities below 0.1, the most
# that an almanac can hold takes a few more.
_KEPLER_STEPS = 12
_LATEST_GPS_S = 3.2e11


def bds_orbit(radius_m: float, inclination_rad: float) -> str:
    """Class of orbit of a BeiDou satellite, as error models know it: BDS-MEO, BDS-IGSO or BDS-GEO."""
    if radius_m < _SYNCHRONOUS_RADIUS_M:
        return "BDS-MEO"
    return "BDS-GEO" if inclination_rad < _GEO_INCLINATION_RAD else "BDS-IGSO"


def mean_motion_rad_s(semi_major_axis_m: ArrayLike) -> NDArray[np.float64]:
    """Angular rate in a circular orbit, ``sqrt(GM / a^3)`` (Kepler's third law) [rad/s].

    Args:
        semi_major_axis_m: radii of the orbits (...) [m].
    """
    return np.sqrt(EARTH_GM_M3_S2 / np.asarray(semi_major_axis_m, dtype=float) ** 3)


@ordinary_arithmetic
def satellite_positions_m(slots: Sequence[Slot], time_gps_s: ArrayLike) -> NDArray[np.float64]:
    """Earth-fixed positions of satellites (epochs, m, 3) [m].

    The angles are those of IS-GPS-200, table 20-IV, without its harmonic corrections: argument of latitude u and
    Earth longitude of the node give x, y, z.

    Args:
        slots: the m satellites.
        time_gps_s: (epochs,), seconds since 1980-01-06 in GPS time [s].
    """
    slots = require_list(slots, field="slots", of="slots")
    if not slots or not all(isinstance(slot, Slot) for slot in slots):
        raise InputError(f"slots: slots such as those of constellation_slots are needed, not {shown(slots)}.")
    time = np.atleast_1d(require_numbers(time_gps_s, field="time_gps_s"))
    require_true(np.abs(time) <= _LATEST_GPS_S, field="time_gps_s", rule="a time within 9999 years is needed", of=time)
    if time.ndim != 1:
        raise InputError(f"time_gps_s: one row of times is needed, not shape {time.shape}.")
    time = time[:, None]
    numbers = (np.array([getattr(slot, field.name) for slot in slots], dtype=float) for field in fields(Slot)[3:])
    radius, inclination, raan, start, reference, sidereal, geosynchronous, *ellipse = numbers
    eccentricity, perigee, raan_rate = ellipse
    turned = gmst_rad(time) - gmst_rad(reference)
    argument = start + np.where(geosynchronous, turned, mean_motion_rad_s(radius) * (time - reference))
    node = raan - sidereal - turned
    if_stationary = (inclination == 0) & (geosynchronous > 0)
    # Both angles of a geostationary satellite grow without end and cancel; their sum keeps its digits.
    argument = np.where(if_stationary, start, argument)
    node = np.where(if_stationary, raan - sidereal, node)
    node = node + raan_rate * (time - reference)
    distance = np.broadcast_to(radius, argument.shape)
    if (eccentricity > 0).any():
        eccentric = _eccentric_anomaly_rad(argument - perigee, eccentricity)
        root = np.sqrt(1.0 - eccentricity**2)
        true = np.arctan2(root * np.sin(eccentric), np.cos(eccentric) - eccentricity)
        argument = np.where(eccentricity > 0, perigee + true, argument)
        distance = distance * (1.0 - eccentricity * np.cos(eccentric))
    along, across = np.cos(argument), np.sin(argument)
    x = along * np.cos(node) - across * np.cos(inclination) * np.sin(node)
    y = along * np.sin(node) + across * np.cos(inclination) * np.cos(node)
    z = across * np.sin(inclination)
    return distance[..., None] * np.stack([x, y, z], axis=-1)


def _eccentric_anomaly_rad(mean_rad: NDArray[np.float64], eccentricity: NDArray[np.float64]) -> NDArray[np.float64]:
    """E with E - e sin E = M (Kepler's equation)."""
    found = mean_rad + eccentricity * np.sin(mean_rad)
    for _ in range(_KEPLER_STEPS):
        found = found - (found - eccentricity * np.sin(found) - mean_rad) / (1.0 - eccentricity * np.cos(found))
    return found
