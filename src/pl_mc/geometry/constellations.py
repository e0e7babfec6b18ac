"""Constellations: tables of nominal orbital slots, one record for each satellite.

Nominal satellites are not the real ones of a day: every slot is filled, orbits are circles, planes stand still.
They give the number and the spread of satellites that a constellation was designed for, at any place and time,
without files. Names follow reality only in kind: C06 is an inclined geosynchronous satellite here as it is there.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from pl_mc.geometry.gps_time import gmst_rad, gps_seconds
from pl_mc.input_errors import InputError, nearest, require_choice, require_list, shown


@dataclass(frozen=True)
class Slot:
    """An orbit and a place in it; a circle, but for satellites of an almanac.

    The ascending node lies at ``raan_rad - reference_sidereal_rad`` of Earth longitude at the reference time.

    Attributes:
        name: satellite name, "G05".
        system: RINEX letter of the system.
        orbit: class of orbit, as error models know it ("GPS", "BDS-GEO").
        semi_major_axis_m: semi-major axis, the radius of a circular orbit [m].
        inclination_rad: inclination [rad].
        raan_rad: right ascension of the ascending node [rad].
        argument_of_latitude_rad: angle from the node to the satellite at the reference time [rad]; in an eccentric
            orbit argument of perigee and mean anomaly.
        reference_gps_s: reference time, GPS seconds [s].
        reference_sidereal_rad: Greenwich sidereal time at the reference time, as the table takes it [rad].
        geosynchronous: True where the satellite is held in step with the rotation of the Earth.
        eccentricity: eccentricity.
        perigee_rad: argument of perigee [rad].
        raan_rate_rad_s: rate at which the node moves in inertial space [rad/s].
    """

    name: str
    system: str
    orbit: str
    semi_major_axis_m: float
    inclination_rad: float
    raan_rad: float
    argument_of_latitude_rad: float
    reference_gps_s: float
    reference_sidereal_rad: float
    geosynchronous: bool = False
    eccentricity: float = 0.0
    perigee_rad: float = 0.0
    raan_rate_rad_s: float = 0.0


def _slots(
    first: int, places: Sequence[tuple[float, float]], *, system: str, inclination_deg: float, reference: str,
    sidereal_deg: float, **shared: Any,
) -> tuple[Slot, ...]:  # fmt: skip
    """Slots numbered from ``first`` on, one for each (RAAN, argument of latitude) [deg]; the rest they share."""
    return tuple(
        Slot(
            name=f"{system}{first + k:02d}",
            system=system,
            inclination_rad=float(np.radians(inclination_deg)),
            raan_rad=float(np.radians(raan % 360)),
            argument_of_latitude_rad=float(np.radians(argument % 360)),
            reference_gps_s=gps_seconds(reference),
            reference_sidereal_rad=float(np.radians(sidereal_deg)),
            **shared,
        )
        for k, (raan, argument) in enumerate(places)
    )


def _walker(raan_deg: float, argument_deg: float) -> list[tuple[float, float]]:
    """Places of a Walker 24/3/1 pattern, plane by plane, from those of its first satellite [deg].

    Planes are 120 degrees apart, satellites in a plane 45, and neighbouring planes out of step by 360 / 24.
    """
    return [(raan_deg + 120 * plane, argument_deg + 45 * k + 15 * plane) for plane in range(3) for k in range(8)]


# GPS Standard Positioning Service Performance Standard (2001), table 3-1: 24 slots A1 to F4, RAAN and argument of
# latitude at 1993-07-01 00:00:00, Greenwich hour angle 18 h 36 min 14.4 s. Its 26 559.7 km are meant together with
# the oblateness of the Earth; without it the period is 5 s short of half a sidereal day, and the ground track
# moves by 0.04 deg a day.
_GPS = partial(
    _slots, system="G", orbit="GPS", semi_major_axis_m=26_559.7e3, inclination_deg=55.0,
    reference="1993-07-01T00:00:00", sidereal_deg=279.06,
)  # fmt: skip
_GPS_PLACES = [
    (raan, argument)
    for raan, arguments in (
        (272.847, (268.126, 161.786, 11.676, 41.806)),
        (332.847, (80.956, 173.336, 309.976, 204.376)),
        (32.847, (111.876, 11.796, 339.666, 241.556)),
        (92.847, (135.226, 265.446, 35.156, 167.356)),
        (152.847, (197.046, 302.596, 66.066, 333.686)),
        (212.847, (238.886, 345.226, 105.206, 135.346)),
    )
    for argument in arguments
]

# Navipedia, "BeiDou Space Segment": classes of orbit, GEO longitudes, IGSO group at 118 deg E, MEO Walker 24/3/1.
# The MEO radius is that of the 21 528 km altitude in the BeiDou performance standard. Angles refer to a sidereal
# time of 100 deg at 2006-01-01 00:00:00; the second IGSO group, at 95 deg E, is the first one turned.
_BDS_SIDEREAL_DEG = 100.0
_BDS = partial(_slots, system="C", reference="2006-01-01T00:00:00", sidereal_deg=_BDS_SIDEREAL_DEG)
_MEO = partial(_BDS, orbit="BDS-MEO", semi_major_axis_m=27_906.0e3, inclination_deg=55.0)
_IGSO = partial(_BDS, orbit="BDS-IGSO", semi_major_axis_m=42_164.0e3, inclination_deg=55.0, geosynchronous=True)
_GEO = partial(_BDS, orbit="BDS-GEO", semi_major_axis_m=42_164.0e3, inclination_deg=0.0, geosynchronous=True)
_IGSO_118_E = [(218.0, 0.0), (98.0, 120.0), (338.0, 240.0)]
_IGSO_95_E = [(195.0, 0.0), (75.0, 120.0), (315.0, 240.0)]

# European GNSS Service Centre, reference constellation: Walker 24/3/1 at 2016-11-21 00:00:00; the sidereal time of
# that moment is the computed one.
_GALILEO_REFERENCE = "2016-11-21T00:00:00"
_GALILEO = partial(
    _slots, system="E", orbit="GAL", semi_major_axis_m=29_599.8e3, inclination_deg=56.0,
    reference=_GALILEO_REFERENCE, sidereal_deg=float(np.degrees(gmst_rad(gps_seconds(_GALILEO_REFERENCE))) % 360),
)  # fmt: skip

# The 24 + 24 satellites for which ARAIM is studied (Working Group C), as the almanacs almmops and almgalileo24 of
# Stanford's MAAST have them at their time zero, read off its lines of sight: GPS is the table above, with 26 559.8 km
# and 4.6394 deg further; Galileo is a Walker 24/3/1 of its own, with an eccentricity of 1e-4 and the perigee at the
# node. Longitudes are those at time zero, for which we take the date of the ARAIM description (ADD v3.0).
_ADD_TIME: dict[str, Any] = {"reference": "2017-11-15T00:00:00", "sidereal_deg": 0.0}
_ADD_GPS_DEG = 4.639362448


def add_24_24() -> tuple[Slot, ...]:
    """The 24 GPS and 24 Galileo satellites of the ARAIM description: G01 to G24 (A1, ... F4) and E01 to E24."""
    places = [(raan, argument + _ADD_GPS_DEG) for raan, argument in _GPS_PLACES]
    return (
        *_GPS(1, places, semi_major_axis_m=26_559.8e3, **_ADD_TIME),
        *_GALILEO(1, _walker(25.0, 338.22345), eccentricity=1e-4, **_ADD_TIME),
    )


def _geostationary(longitudes_deg: Mapping[int, float]) -> tuple[Slot, ...]:
    """Satellites by number and longitude, in the order given, which is from west to east."""
    return tuple(_GEO(number, [(at + _BDS_SIDEREAL_DEG, 0.0)])[0] for number, at in longitudes_deg.items())


def gps() -> tuple[Slot, ...]:
    """The 24 slots of GPS: G01 to G24 in the order A1, A2, ... F4."""
    return _GPS(1, _GPS_PLACES)


def beidou_2() -> tuple[Slot, ...]:
    """BeiDou-2: C01-C05 GEO, C06-C10 IGSO (three crossing at 118 deg E, two at 95), C11-C14 MEO.

    The GEO satellites stand at 140, 80, 110.5, 160 and 58.75 deg E, and in tables from west to east. The MEO satellites
    take the last two places of the first plane and the third and fourth of the second.
    """
    meo = _walker(0.0, 0.0)
    return (
        *_geostationary({5: 58.75, 2: 80.0, 3: 110.5, 1: 140.0, 4: 160.0}),
        *_IGSO(6, _IGSO_118_E + _IGSO_95_E[:2]),
        *_MEO(11, [meo[8 * plane + k] for plane, k in ((0, 6), (0, 7), (1, 2), (1, 3))]),
    )


def beidou_3() -> tuple[Slot, ...]:
    """BeiDou-3: C19-C42 MEO, C43-C45 IGSO, C59-C61 GEO (140, 80, 110.5 deg E); other real numbers are spread otherwise.

    Our choice keeps moving satellites of BeiDou-2 and BeiDou-3 apart, which the nominal tables would put into the
    very same places: the MEO pattern is moved by half a spacing (22.5 deg), the IGSO satellites cross at 118 deg E
    four hours after those of BeiDou-2. The GEO satellites share longitudes with BeiDou-2, as the real ones do.
    """
    return (
        *_MEO(19, _walker(0.0, 22.5)),
        *_IGSO(43, [(raan - 60, argument + 60) for raan, argument in _IGSO_118_E]),
        *_geostationary({60: 80.0, 61: 110.5, 59: 140.0}),
    )


def galileo() -> tuple[Slot, ...]:
    """Galileo, Walker 24/3/1: E01 to E24, plane by plane; without spares and the pair in eccentric orbits."""
    return _GALILEO(1, _walker(317.632, 225.153))


CONSTELLATIONS: Mapping[str, Callable[[], tuple[Slot, ...]]] = MappingProxyType(
    {"GPS": gps, "BDS-2": beidou_2, "BDS-3": beidou_3, "GAL": galileo}
)

# Several constellations under one name, which stands alone.
SETS: Mapping[str, Callable[[], tuple[Slot, ...]]] = MappingProxyType({"ADD-24+24": add_24_24})


def constellation_slots(
    constellations: str | Sequence[str], without: str | Sequence[str] = (), *, gps_slots: Sequence[Slot] | None = None
) -> tuple[Slot, ...]:
    """The slots of one or several constellations, in order, less those switched off.

    Args:
        constellations: names of `CONSTELLATIONS`, of which a single one may stand alone, or one name of `SETS`.
        without: names of satellites to leave out.
        gps_slots: what stands in for the nominal GPS, such as the satellites of an almanac.

    Raises:
        InputError: no constellation, an unknown or repeated one, an unknown satellite, or no satellite left.
    """
    wanted = (
        [constellations]
        if isinstance(constellations, str)
        else require_list(constellations, field="constellations", of="names")
    )
    if not wanted:
        raise InputError(f"constellations: at least one is needed (valid: {', '.join(CONSTELLATIONS)}).")
    for name in wanted:
        require_choice(name, [*CONSTELLATIONS, *SETS], field="constellations")
        if wanted.count(name) > 1:
            raise InputError(f"constellations: {shown(name)} appears more than once.")
        if name in SETS and len(wanted) > 1:
            raise InputError(f"constellations: {name} stands alone, not together with others.")
    if gps_slots is not None and "GPS" not in wanted:
        raise InputError(f"almanac: it holds GPS satellites, but the constellations are {', '.join(wanted)}; add GPS.")
    made = {name: {**CONSTELLATIONS, **SETS}[name]() for name in wanted}
    if gps_slots is not None:
        made["GPS"] = tuple(require_list(gps_slots, field="gps_slots", of="slots"))
        if not all(isinstance(slot, Slot) for slot in made["GPS"]):
            raise InputError(f"gps_slots: slots such as those of an almanac are needed, not {shown(gps_slots)}.")
    slots = tuple(itertools.chain(*made.values()))
    names = [slot.name for slot in slots]
    off = [without] if isinstance(without, str) else require_list(without, field="without", of="names")
    for name in off:
        if not isinstance(name, str) or name not in names:
            raise InputError(f"without: {shown(name)} is not in {', '.join(wanted)} ({nearest(str(name), names)}).")
    left = tuple(slot for slot in slots if slot.name not in off)
    if not left:
        raise InputError("without: every satellite is switched off; at least one has to stay.")
    return left
