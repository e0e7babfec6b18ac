"""A made-up sky for the receiver tests: broadcast ephemerides, the states that follow from them, and RINEX text.

`reference_state` is written from the interface documents alone (IS-GPS-200 table 20-IV; BDS-SIS-ICD-2.1,
5.2.4.12), one satellite and one time at a call; it shares no code with the package.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

C = 299_792_458.0
ALPHA = (4.6566e-09, 1.4901e-08, -5.9605e-08, -1.1921e-07)
BETA = (8.1920e04, 9.8304e04, -6.5536e04, -5.2429e05)

# Noon of 2020-06-25 in GPS time; the ephemerides refer to the same count of seconds in their own time.
WEEK, NOON_SOW = 2111, 4 * 86_400 + 43_200
NOON_GPS_S = WEEK * 604_800.0 + NOON_SOW
BDT_BEHIND_GPS_S, BDS_WEEK_OFFSET = 14.0, 1356

TRUTH_M = np.array([3582104.8991, 532590.1966, 5232755.2961])
TRUTH_TEXT = "3582104.8991, 532590.1966, 5232755.2961"


@dataclass(frozen=True)
class Orbit:
    """Broadcast parameters in the units of the documents (radians, metres, seconds)."""

    name: str
    root_a: float
    e: float
    i0: float
    omega0: float
    omega: float
    m0: float
    toe: float = NOON_SOW
    dn: float = 4.5e-9
    omega_dot: float = -8.0e-9
    idot: float = 2.0e-10
    harmonics: tuple[float, ...] = (2.1e-6, 7.3e-6, 1.1e-7, -9.0e-8, 211.0, 41.0)  # Cuc Cus Cic Cis Crc Crs
    clock: tuple[float, float, float] = (-3.1e-4, 2.7e-12, 0.0)
    group_delay: float = -9.3e-9
    health: int = 0


@dataclass(frozen=True)
class Sky:
    """Satellites, their pseudoranges and the biases that were added."""

    orbits: tuple[Orbit, ...]
    times_gps_s: tuple[float, ...]
    pseudorange_m: NDArray[np.float64]
    bias_m: Mapping[str, float] = field(default_factory=dict)


def orbits() -> tuple[Orbit, ...]:
    """A full GPS constellation of 24, and BeiDou of 24 in medium, 3 in inclined and 2 in geostationary orbits."""
    made = []
    for k in range(24):
        plane, slot = divmod(k, 4)
        angle, node = 2 * math.pi * ((slot / 4 + plane / 9) % 1), plane * math.pi / 3
        clock = (1e-5 * (k - 12), 1e-12 * (k % 5), 0.0)
        made.append(Orbit(f"G{k + 1:02d}", 5153.65, 0.004 + 4e-4 * k, 0.9599, node, 0.7, angle, clock=clock))
    for k in range(24):
        plane, slot = divmod(k, 8)
        angle = 2 * math.pi * ((slot / 8 + plane / 24) % 1)
        made.append(Orbit(f"C{k + 19:02d}", 5282.6, 1e-3, 0.96, 0.4 + plane * 2 * math.pi / 3, -1.1, angle))
    for k, node in enumerate((0.3, 2.4, 4.5)):
        made.append(Orbit(f"C{k + 6:02d}", 6493.4, 0.008, 0.95, node, -2.0, 5.2 - node))
    # In the tilted frame of the geostationary ones the node and the anomalies give the longitude.
    turned = 7.292115e-5 * NOON_SOW
    for k, longitude in enumerate((0.2, 0.6)):
        node = longitude + turned - 1.7 + 3.8
        made.append(Orbit(f"C{k + 2:02d}", 6493.4, 4e-4, 0.12, node % (2 * math.pi), 1.7, -3.8, omega_dot=3e-9))
    return tuple(made)


def reference_state(orbit: Orbit, time_gps_s: float) -> tuple[NDArray[np.float64], float]:
    """Earth-fixed position [m] and clock with relativity, without group delay [s], at a time in GPS time."""
    gps = orbit.name[0] == "G"
    gm = 3.986005e14 if gps else 3.986004418e14
    rate = 7.2921151467e-5 if gps else 7.292115e-5
    tk = time_gps_s - WEEK * 604_800.0 - (0.0 if gps else BDT_BEHIND_GPS_S) - orbit.toe
    a = orbit.root_a**2
    mean = orbit.m0 + (math.sqrt(gm / a**3) + orbit.dn) * tk
    anomaly = mean
    for _ in range(50):
        anomaly = mean + orbit.e * math.sin(anomaly)
    true = math.atan2(math.sqrt(1 - orbit.e**2) * math.sin(anomaly), math.cos(anomaly) - orbit.e)
    u = true + orbit.omega
    cuc, cus, cic, cis, crc, crs = orbit.harmonics
    c2, s2 = math.cos(2 * u), math.sin(2 * u)
    radius = a * (1 - orbit.e * math.cos(anomaly)) + crc * c2 + crs * s2
    inclination = orbit.i0 + orbit.idot * tk + cic * c2 + cis * s2
    u += cuc * c2 + cus * s2
    x, y = radius * math.cos(u), radius * math.sin(u)
    geostationary = orbit.name in ("C01", "C02", "C03", "C04", "C05")
    node = orbit.omega0 + (orbit.omega_dot - (0.0 if geostationary else rate)) * tk - rate * orbit.toe
    position = np.array([
        x * math.cos(node) - y * math.cos(inclination) * math.sin(node),
        x * math.sin(node) + y * math.cos(inclination) * math.cos(node),
        y * math.sin(inclination),
    ])  # fmt: skip
    if geostationary:
        position = _about_z(rate * tk) @ _about_x(math.radians(-5.0)) @ position
    f0, f1, f2 = orbit.clock
    relativity = -2 * math.sqrt(gm) / C**2 * orbit.e * orbit.root_a * math.sin(anomaly)
    return position, f0 + f1 * tk + f2 * tk**2 + relativity


def simulate(
    *,
    seconds: Sequence[float] = (0.0, 30.0, 60.0),
    bias_m: Mapping[str, float] | None = None,
    receiver_clock_m: float = 12_345.678,
    atmosphere: bool = True,
) -> Sky:
    """Pseudoranges at `TRUTH_M` of all satellites 5 degrees or more above the horizon; NaN below it.

    The atmosphere is RTKLIB's own.
    """
    every, bias = orbits(), dict(bias_m or {})
    times = tuple(NOON_GPS_S + s for s in seconds)
    ranges = np.full((len(times), len(every)), np.nan)
    for row, time in enumerate(times):
        for column, orbit in enumerate(every):
            pseudorange = _pseudorange(orbit, time, receiver_clock_m, atmosphere)
            ranges[row, column] = pseudorange + bias.get(orbit.name, 0.0)
    return Sky(every, times, ranges, bias)


def observation_text(sky: Sky, *, version: str = "3.04", names: str = "GC", b1i: str = "C2I") -> str:
    """A RINEX observation file; systems of ``names``, epoch by epoch."""
    lines = [
        f"{version:>9}           OBSERVATION DATA    M                   RINEX VERSION / TYPE",
        f"{'':60}PGM / RUN BY / DATE",
        f"{TRUTH_M[0] + 9:14.4f}{TRUTH_M[1]:14.4f}{TRUTH_M[2] - 5:14.4f}{'':18}APPROX POSITION XYZ",
    ]
    codes = {"G": "C1C S1C", "C": f"{b1i} S2I", "E": "C1C S1C"}
    lines += [f"{f'{letter}    2 {codes[letter]}':60}SYS / # / OBS TYPES" for letter in names]
    lines += [_epoch_line(sky.times_gps_s[0], "TIME OF FIRST OBS"), f"{'':60}END OF HEADER"]
    for time, ranges in zip(sky.times_gps_s, sky.pseudorange_m, strict=True):
        seen = [
            f"{orbit.name}{value:14.3f}  {45:14.3f}"
            for orbit, value in zip(sky.orbits, ranges, strict=True)
            if orbit.name[0] in names and np.isfinite(value)
        ]
        lines += [_epoch_line(time, None).replace("nnn", f"{len(seen):3d}"), *seen]
    return "\n".join(lines) + "\n"


def navigation_text(every: Sequence[Orbit], *, days: int = 0, version: str = "3.04", klobuchar: bool = True) -> str:
    """A RINEX navigation file; ``days`` moves the dates of all records."""
    lines = [f"{version:>9}           NAVIGATION DATA     MIXED               RINEX VERSION / TYPE"]
    if klobuchar:
        for label, values in (("GPSA", ALPHA), ("GPSB", BETA)):
            lines.append(f"{label} " + "".join(f"{v:12.4E}" for v in values) + f"{'':7}IONOSPHERIC CORR")
    lines.append(f"{'':60}END OF HEADER")
    for orbit in every:
        lines += _navigation_record(orbit, days)
    return "\n".join(lines) + "\n"


def write_pair(folder: Path, observations: str, navigation: str) -> tuple[Path, Path]:
    """The two texts as files of a folder."""
    paths = folder / "made.obs", folder / "made.nav"
    for path, text in zip(paths, (observations, navigation), strict=True):
        path.write_text(text, encoding="ascii")
    return paths


def _pseudorange(orbit: Orbit, time: float, receiver_clock_m: float, atmosphere: bool) -> float:
    # The receiver's clock is ahead by this much, so that the signal arrived earlier than the epoch says.
    arrived = time - receiver_clock_m / C
    flight = 0.07
    for _ in range(6):
        position, clock = reference_state(orbit, arrived - flight)
        seen = _about_z(7.2921151467e-5 * flight) @ position
        flight = float(np.linalg.norm(seen - TRUTH_M)) / C
    elevation, azimuth, geodetic = _direction(seen - TRUTH_M)
    if elevation < math.radians(5.0):
        return math.nan
    delay = _atmosphere(orbit.name[0], time, elevation, azimuth, geodetic) if atmosphere else 0.0
    return flight * C - C * (clock - orbit.group_delay) + receiver_clock_m + delay


def _direction(line: NDArray[np.float64]) -> tuple[float, float, tuple[float, float, float]]:
    """Elevation, azimuth [rad] and the geodetic position of `TRUTH_M`, by iteration on the latitude."""
    x, y, z = TRUTH_M
    p, a, e2 = math.hypot(x, y), 6_378_137.0, 6.69437999014e-3
    latitude, height = math.atan2(z, p), 0.0
    for _ in range(20):
        n = a / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
        height = p / math.cos(latitude) - n
        latitude = math.atan2(z, p * (1 - e2 * n / (n + height)))
    longitude = math.atan2(y, x)
    sb, cb, sl, cl = math.sin(latitude), math.cos(latitude), math.sin(longitude), math.cos(longitude)
    east, north, up = line @ np.array([[-sl, -sb * cl, cb * cl], [cl, -sb * sl, cb * sl], [0.0, cb, sb]])
    return math.atan2(up, math.hypot(east, north)), math.atan2(east, north), (latitude, longitude, height)


def _atmosphere(
    system: str, time: float, elevation: float, azimuth: float, geodetic: tuple[float, float, float]
) -> float:
    import pyrtklib as rtklib

    when = rtklib.gpst2time(WEEK, time - WEEK * 604_800.0)
    place, direction = rtk_array(geodetic), rtk_array((azimuth, elevation))
    factor = 1.0 if system == "G" else (1575.42 / 1561.098) ** 2
    ionosphere = rtklib.ionmodel(when, rtk_array((*ALPHA, *BETA)), place, direction)
    return float(factor * ionosphere + rtklib.tropmodel(when, place, direction, 0.7))


def rtk_array(values: Sequence[float]) -> Any:
    """A C array of doubles."""
    import pyrtklib as rtklib

    array = rtklib.Arr1Ddouble(len(values))
    for index, value in enumerate(values):
        array[index] = float(value)
    return array


def _about_z(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def _epoch_line(time_gps_s: float, label: str | None) -> str:
    when = datetime(1980, 1, 6) + timedelta(seconds=time_gps_s)
    seconds = when.second + when.microsecond / 1e6
    if label:
        clock = "".join(f"{part:6d}" for part in (when.year, when.month, when.day, when.hour, when.minute))
        return f"{clock}{seconds:13.7f}     GPS         {label}"
    return f"> {when:%Y %m %d %H %M}{seconds:11.7f}  0nnn"


def _navigation_record(orbit: Orbit, days: int) -> list[str]:
    gps = orbit.name[0] == "G"
    day, seconds = divmod(int(orbit.toe), 86_400)
    epoch = datetime(2020, 6, 21) + timedelta(days=day + days, seconds=seconds)
    moved = (day + days) * 86_400
    week = WEEK - (0 if gps else BDS_WEEK_OFFSET) + moved // 604_800
    toe = moved % 604_800 + seconds
    cuc, cus, cic, cis, crc, crs = orbit.harmonics
    rows = (
        (1.0, crs, orbit.dn, orbit.m0),
        (cuc, orbit.e, cus, orbit.root_a),
        (toe, cic, orbit.omega0, cis),
        (orbit.i0, crc, orbit.omega, orbit.omega_dot),
        (orbit.idot, 0.0, week, 0.0),
        (2.0, orbit.health, orbit.group_delay, 0.0),
        (toe, 4.0 if gps else 0.0),
    )
    first = f"{orbit.name} {epoch:%Y %m %d %H %M %S}" + "".join(f"{v:19.12e}" for v in orbit.clock)
    return [first, *("    " + "".join(f"{v:19.12e}" for v in row) for row in rows)]
