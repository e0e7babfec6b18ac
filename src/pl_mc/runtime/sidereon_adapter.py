"""The one file that speaks to the library of receiver and orbit files (sidereon): text in, its records out.

To exchange the library, rewrite this file. Whatever the library meets in a text, a panic of its compiled code
included, comes out as `Unreadable`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

# Its names of the systems that RINEX knows.
SYSTEMS: Mapping[str, str] = {
    "G": "GPS", "C": "BEIDOU", "E": "GALILEO", "J": "QZSS", "R": "GLONASS", "I": "NAVIC", "S": "SBAS",
}  # fmt: skip

# The library counts seconds from 2000-01-01 12:00.
_J2000_GPS_S = 630_763_200.0

_GPS_EPOCH_JD = 2_444_244.5

# Of what the library says of a text, so much is passed on.
_LONGEST_REASON = 160


class Unreadable(Exception):
    """What the library says of a text that it cannot read, within a sentence."""


def without_hatanaka(text: str) -> str:
    """The RINEX text that a Hatanaka-compressed one stands for."""
    return str(_call("decode_crinex", text))


def observations(text: str) -> Any:
    """A ``RinexObs`` of RINEX text, versions 2, 3 and 4."""
    return _call("parse_rinex_obs", text)


def navigation(text: str) -> Any:
    """A ``RinexNavParse`` of RINEX text, versions 2, 3 and 4; records that cannot be read are listed in it."""
    return _call("parse_rinex_nav_lenient", text)


class GlonassOrbit:
    """A record of a GLONASS satellite, and where that satellite is at other times.

    Attributes:
        record: the library's record.
        toe_gps_s: its reference time [s since 1980-01-06, GPS time].
    """

    def __init__(self, text: str) -> None:
        (self.record,) = _call("parse_rinex_glonass_records", text)
        self.toe_gps_s = float(self.record.toe_gpst_j2000_s) + _J2000_GPS_S
        # The library's own choice among records leaves out those that are unhealthy, so there is one in each store.
        self._store = _call("parse_rinex_nav", text)

    def evaluate(self, since_toe_s: float) -> GlonassState:
        """The state so many seconds after the reference time, by numerical integration (GLONASS ICD 5.1, A.3.1.2)."""
        import numpy as np
        import sidereon

        at = np.array([self.record.toe_gpst_j2000_s + since_toe_s])
        found = sidereon.observable_states_at_j2000_s(self._store, [self.record.satellite], at)
        x_m, y_m, z_m = found.positions_ecef_m[0].tolist()
        return GlonassState(x_m, y_m, z_m, float(found.clocks_s[0]), 0.0)


class GlonassState(NamedTuple):
    """Earth-fixed position [m] and clock [s], with the names that the library has for other systems."""

    x_m: float
    y_m: float
    z_m: float
    clock_polynomial_s: float
    relativistic_clock_s: float


def orbits(text: str) -> Any:
    """An ``Sp3`` of SP3 text, versions a to d."""
    return _call("load_sp3", text.encode())


def seconds_behind_gps(product: Any, julian_dates: Sequence[float]) -> list[float]:
    """GPS time less the time that an ``Sp3`` counts in, at Julian dates [s]."""
    import sidereon

    # GLO is "the GLONASS UTC time system" in SP3 as in RINEX, without the three hours of Moscow (IGSMAIL-5399).
    header = product.header
    scales: Any = sidereon.TimeScale
    scale = scales.UTC if header.time_system == "GLO" else header.time_scale
    return [sidereon.timescale_offset_at(scale, scales.GPST, float(date)) for date in julian_dates]


def ionosphere_maps(content: bytes) -> Any:
    """An ``Ionex`` of an IONEX file."""
    return _call("load_ionex", content)


def map_times_s(product: Any) -> list[int]:
    """Times of the maps of an ``Ionex`` [s of UTC since 2000-01-01 12:00]."""
    return [int(time_s) for time_s in product.map_epochs_j2000_s]


def goes_round(product: Any) -> bool:
    """Whether the maps of an ``Ionex`` have every longitude."""
    longitudes = product.lon_nodes_deg
    return bool(longitudes[-1] - longitudes[0] + product.dlon_deg >= 360.0)


def slant_delays_m(
    product: Any, time_s: int, rays_deg: Sequence[Sequence[float]], carrier_hz: float
) -> list[float | str]:
    """Delays by the map of a time of UTC [m], or why there is none; latitude, longitude, azimuth, elevation [deg]."""
    import sidereon

    made = [
        sidereon.IonexSlantRequest(latitude, longitude, azimuth, elevation, time_s, carrier_hz)
        for latitude, longitude, azimuth, elevation in rays_deg
    ]
    found: Any = sidereon.ionex_slant_delay_results(product, made)
    return [float(one.delay_m) if one.is_ok else str(one.refusal.message) for one in found]


def utc_j2000_s(time_gps_s: float) -> float:
    """Seconds of UTC since 2000-01-01 12:00 of a GPS time [s]."""
    return time_gps_s - gps_minus_utc_s(_GPS_EPOCH_JD + time_gps_s / 86_400.0) - _J2000_GPS_S


def gps_minus_utc_s(julian_date: float) -> float:
    """GPS time less UTC at a Julian date in UTC [s]."""
    import sidereon

    return float(sidereon.gps_utc_offset_s(julian_date))


def codes(header: Any, system: str) -> list[str]:
    """Observation codes of a system letter in a header, column by column; of RINEX 2 by their names in RINEX 3."""
    return list(header.declared_obs_codes(_system(system)))


def policy(chosen: Mapping[str, Sequence[str]]) -> Any:
    """What ``RinexObs.pseudoranges`` takes of each system letter: its codes, the first that a satellite has."""
    import sidereon

    return sidereon.SignalPolicy([(_system(letter), list(listed)) for letter, listed in chosen.items()])


def _system(letter: str) -> Any:
    import sidereon

    return getattr(sidereon.GnssSystem, SYSTEMS[letter])


def _call(name: str, text: str | bytes) -> Any:
    import sidereon

    try:
        return getattr(sidereon, name)(text)
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:
        # A panic of compiled code is no `Exception`.
        reason = (
            " ".join(str(error).split()).removeprefix("SP3 parse failed: ").removeprefix("parse error: ").rstrip(".")
        )
        raise Unreadable("".join(c if c.isprintable() else "?" for c in reason)[:_LONGEST_REASON]) from None
