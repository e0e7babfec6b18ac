"""Flight: the track and the bank of a small fixed-wing aircraft, and the satellites that its banking hides.

The flight is made up, not recorded: manoeuvres one after another, over the ellipsoid and without wind, with every
turn coordinated. Speed, turn rate and climb rate change smoothly, and position follows from them by integration,
so that track, heading, speed and bank always fit each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.constellations import Slot
from pl_mc.geometry.frames import enu_rotation, from_geodetic, geodetic
from pl_mc.geometry.orbits import satellite_positions_m
from pl_mc.input_errors import InputError, require_list, require_positive, require_whole, shown

# Standard gravity, 3rd General Conference on Weights and Measures, 1901.
GRAVITY_M_S2 = 9.80665

# WGS 84: semi-major axis and first eccentricity squared, for metres on the ground per radian.
_WGS84_AXIS_M = 6_378_137.0
_WGS84_ECCENTRICITY_2 = 6.694379990141e-3

# Time from wings level to full bank: at 25 degrees a roll rate of 9 degrees a second at the most.
ROLL_S = 4.0

# The longest flight that is integrated, two weeks: no aircraft of the kind stays up for a day.
_LONGEST_FLIGHT_S = 1_209_600.0

# The plain east of Zhengzhou, Henan, where a flight begins: a place of our choosing, since the paper names none.
# Height of the runway above the ellipsoid, and heading of the take-off, clockwise from north.
ZHENGZHOU_PLAIN = SimpleNamespace(latitude_deg=34.80, longitude_deg=114.00, height_m=62.0, heading_deg=90.0)

# Step of the integration; positions at whole seconds are accurate to a millimetre.
_STEP_S = 0.05


@dataclass(frozen=True)
class Manoeuvre:
    """A stretch of a flight: straight, or a coordinated turn at constant speed.

    Attributes:
        duration_s: how long a straight stretch takes; None for a turn, whose angle and bank decide [s].
        speed_m_s: speed over ground at the end of a straight stretch; None to keep it [m/s].
        climb_m: height gained by the end [m].
        turn_deg: angle turned through, positive to the right [deg].
        bank_deg: bank held in the turn, positive whichever way it goes [deg].
    """

    duration_s: float | None = None
    speed_m_s: float | None = None
    climb_m: float = 0.0
    turn_deg: float = 0.0
    bank_deg: float = 0.0


@dataclass(frozen=True)
class Flight:
    """A flight, epoch by epoch; e epochs.

    Attributes:
        time_s: (e,), time since the first epoch [s].
        track_m: (e, 3), Earth-fixed positions [m].
        height_m: (e,), height above the ellipsoid [m].
        speed_m_s: (e,), speed over ground [m/s].
        climb_m_s: (e,), rate of climb [m/s].
        heading_rad: (e,), direction of flight, clockwise from north and not reduced to one turn [rad].
        bank_rad: (e,), bank of the wings, positive with the right wing down [rad].
    """

    time_s: NDArray[np.float64]
    track_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    speed_m_s: NDArray[np.float64]
    climb_m_s: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    bank_rad: NDArray[np.float64]


def straight(duration_s: float, *, speed_m_s: float | None = None, climb_m: float = 0.0) -> Manoeuvre:
    """A straight stretch with its speed at the end and the height gained."""
    return Manoeuvre(duration_s=duration_s, speed_m_s=speed_m_s, climb_m=climb_m)


def turn(angle_deg: float, *, bank_deg: float = 25.0, climb_m: float = 0.0) -> Manoeuvre:
    """A coordinated turn, positive to the right."""
    return Manoeuvre(turn_deg=angle_deg, bank_deg=bank_deg, climb_m=climb_m)


def survey_plan() -> tuple[Manoeuvre, ...]:
    """A survey flight of 2 h 23 min at 28 m/s: what a small fixed-wing aircraft with a camera does.

    Engine start, take-off to the east, a climbing circuit to 350 m, 24 parallel legs of 5.3 km joined by turns of
    180 degrees at 25 degrees of bank, three circles up to 600 m, nine longer crossing legs, the way back with two
    circles down, an approach of two minutes, landing on the same runway after 8476 s, and standing.
    """
    lanes = [part for k in range(12) for part in (straight(190), turn(180), straight(190), turn(-180))]
    crossing = [part for k in range(5) for part in (straight(214), turn(-180), straight(214), turn(180))]
    # The lengths of the westward and the southward stretch that end on the runway.
    west_s, south_s = 271.0, 73.47
    return (
        straight(150),
        straight(15, speed_m_s=26),
        straight(55, speed_m_s=28, climb_m=110),
        turn(-90, bank_deg=20, climb_m=30),
        straight(80, climb_m=160),
        turn(-90, bank_deg=20, climb_m=20),
        straight(40, climb_m=30),
        *lanes[:-1],
        straight(30),
        turn(360, bank_deg=20, climb_m=80),
        turn(360, bank_deg=20, climb_m=90),
        turn(360, bank_deg=20, climb_m=80),
        turn(90),
        straight(60),
        *crossing[:-3],
        turn(90),
        straight(west_s, climb_m=-180),
        turn(-360, bank_deg=20, climb_m=-85),
        turn(-360, bank_deg=20, climb_m=-85),
        turn(-90, bank_deg=20, climb_m=-20),
        straight(south_s, climb_m=-30),
        turn(-90, bank_deg=20, climb_m=-20),
        straight(120, speed_m_s=24, climb_m=-180),
        straight(16, speed_m_s=0),
    )


def fly(plan: Sequence[Manoeuvre], *, epochs: int, interval_s: float = 1.0) -> Flight:
    """Fly a plan; after its end the aircraft goes on straight at its last speed (a plan that lands: it stands).

    Bank follows from the turn, ``tan(bank) = v^2 / (r g) = v w / g`` with the turn rate w (coordinated turn; any
    textbook of flight mechanics, such as Etkin and Reid, Dynamics of Flight, section 4.9 on steady turns).

    Args:
        plan: the manoeuvres; each begins with the speed that the last one ended with, the first from standing.
        epochs: number of epochs.
        interval_s: time from one epoch to the next [s].

    Raises:
        InputError: a turn while standing, or one too short for rolling in and out; a series that is none, or of
            more than two weeks.
    """
    epochs = require_whole(epochs, field="epochs", low=1, high=10_000_000)
    interval_s = require_positive(interval_s, field="interval_s")
    if (epochs - 1) * interval_s > _LONGEST_FLIGHT_S:
        raise InputError(f"flight: it can last up to {_LONGEST_FLIGHT_S:g} s, and more is asked for.")
    end_s = (epochs - 1) * interval_s
    time = np.arange(int(np.ceil(end_s / _STEP_S)) + 2, dtype=np.float64) * _STEP_S
    speed, climb, rate = (np.zeros(time.size) for _ in range(3))
    begin_s, v = 0.0, 0.0
    for number, one in enumerate(require_list(plan, field="plan", of="manoeuvres"), start=1):
        if not isinstance(one, Manoeuvre):
            raise InputError(f"plan: manoeuvres are needed, not {shown(one)}.")
        v_end = v if one.speed_m_s is None else one.speed_m_s
        turn_rate, duration_s = _turn_rate_and_duration(number, one, v)
        during = slice(*np.searchsorted(time, (begin_s, begin_s + duration_s)).tolist())
        after = slice(during.stop, None)
        part = (time[during] - begin_s) / duration_s
        speed[during] = v + (v_end - v) * _smooth(part)
        speed[after] = v_end
        climb[during] = one.climb_m / duration_s * _smooth_rate(part)
        into, out_of = part * duration_s / ROLL_S, (1 - part) * duration_s / ROLL_S
        rate[during] = turn_rate * _smooth(np.minimum(into, 1)) * _smooth(np.minimum(out_of, 1))
        begin_s, v = begin_s + duration_s, v_end
    heading = np.radians(ZHENGZHOU_PLAIN.heading_deg) + _integral(rate)
    height = ZHENGZHOU_PLAIN.height_m + _integral(climb)
    latitude0, longitude0 = np.radians([ZHENGZHOU_PLAIN.latitude_deg, ZHENGZHOU_PLAIN.longitude_deg])
    north_m_rad, east_m_rad = _metres_per_radian(latitude0, ZHENGZHOU_PLAIN.height_m)
    latitude = latitude0 + _integral(speed * np.cos(heading)) / north_m_rad
    longitude = longitude0 + _integral(speed * np.sin(heading)) / east_m_rad
    bank = np.arctan(speed * rate / GRAVITY_M_S2)

    at = np.arange(epochs, dtype=np.float64) * interval_s
    latitude, longitude, height, speed, climb, heading, bank = (
        np.interp(at, time, values) for values in (latitude, longitude, height, speed, climb, heading, bank)
    )
    return Flight(at, from_geodetic(latitude, longitude, height), height, speed, climb, heading, bank)


def banked_visibility(
    flight: Flight, slots: Sequence[Slot], time_gps_s: NDArray[np.float64], *, mask_deg: float
) -> NDArray[np.bool_]:
    """(e, m), whether each satellite stands at least ``mask_deg`` above the plane of wings and fuselage.

    In a turn the plane of the aircraft leans with it, so that the raised wing hides satellites on the outer side.
    The fuselage is taken as level; the pitch of a climb, a few degrees, is left out.

    Args:
        flight: the flight.
        slots: the m satellites.
        time_gps_s: (e,), GPS time of each epoch [s].
        mask_deg: lowest elevation above the aircraft's plane [deg].
    """
    latitude, longitude, _ = geodetic(flight.track_m)
    sight = satellite_positions_m(slots, time_gps_s) - flight.track_m[:, None]
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    enu = np.einsum("eij,emj->emi", enu_rotation(latitude, longitude), sight)
    # The aircraft's own up leans towards the lower wing, which points to the centre of the turn.
    right = np.stack([np.cos(flight.heading_rad), -np.sin(flight.heading_rad), 0 * flight.heading_rad], axis=-1)
    up = np.cos(flight.bank_rad)[:, None] * np.array([0.0, 0.0, 1.0]) + np.sin(flight.bank_rad)[:, None] * right
    return np.einsum("emi,ei->em", enu, up) >= np.sin(np.radians(mask_deg))


def _turn_rate_and_duration(number: int, one: Manoeuvre, speed_m_s: float) -> tuple[float, float]:
    """Turn rate at full bank [rad/s], positive to the right, and duration [s] of a manoeuvre."""
    if one.duration_s is not None:
        return 0.0, one.duration_s
    if speed_m_s <= 0:
        raise InputError(f"flight: manoeuvre {number} is a turn, but the aircraft stands.")
    rate = GRAVITY_M_S2 * np.tan(np.radians(one.bank_deg)) / speed_m_s
    angle = np.radians(abs(one.turn_deg))
    # Rolling in and out together turn as far as one roll time at full rate.
    if angle < rate * ROLL_S:
        raise InputError(
            f"flight: manoeuvre {number} turns {one.turn_deg:g} deg, too few for a bank of {one.bank_deg:g} deg; "
            f"at least {np.degrees(rate * ROLL_S):.0f} deg are needed."
        )
    return float(np.copysign(rate, one.turn_deg)), float(angle / rate + ROLL_S)


def _smooth(part: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 to 1 with level ends and level slopes of the slope: 10 x^3 - 15 x^4 + 6 x^5."""
    return part**3 * (10 - 15 * part + 6 * part**2)


def _smooth_rate(part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivative of `_smooth`."""
    return 30 * part**2 * (1 - part) ** 2


def _integral(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integral from the first sample by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) * (_STEP_S / 2))])


def _metres_per_radian(latitude_rad: float, height_m: float) -> tuple[float, float]:
    """Metres to the north and to the east per radian of latitude and longitude on WGS 84."""
    root = np.sqrt(1 - _WGS84_ECCENTRICITY_2 * np.sin(latitude_rad) ** 2)
    meridian = _WGS84_AXIS_M * (1 - _WGS84_ECCENTRICITY_2) / root**3
    normal = _WGS84_AXIS_M / root
    return meridian + height_m, (normal + height_m) * np.cos(latitude_rad)
