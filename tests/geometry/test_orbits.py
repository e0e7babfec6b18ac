"""Orbits: closed forms and the longitudes at which satellites have to be."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.geometry.constellations import CONSTELLATIONS, Slot, constellation_slots
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.orbits import mean_motion_rad_s, satellite_positions_m

SIDEREAL_DAY_S = 86_164.0905
START_S = gps_seconds("2017-11-21")


def by_name(name: str) -> Slot:
    return next(slot for slot in constellation_slots(list(CONSTELLATIONS)) if slot.name == name)


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between positions, without the loss of digits of an arc cosine near zero."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def test_every_satellite_stays_on_its_sphere_and_below_its_inclination():
    slots = constellation_slots(list(CONSTELLATIONS))
    positions = satellite_positions_m(slots, START_S + np.linspace(0, 86_400, 97))
    assert positions.shape == (97, len(slots), 3)
    radius = np.array([slot.semi_major_axis_m for slot in slots])
    np.testing.assert_allclose(np.linalg.norm(positions, axis=-1), np.tile(radius, (97, 1)), rtol=1e-12)
    highest = np.abs(positions[..., 2] / radius).max(axis=0)
    assert (highest <= np.sin([slot.inclination_rad for slot in slots]) + 1e-12).all()
    assert highest[[slot.orbit != "BDS-GEO" for slot in slots]].min() > 0.8


def test_kepler_s_third_law_for_gps():
    """Half a sidereal day is 43 082 s; the radius of the table, meant for an oblate Earth, gives 4 to 5 s less."""
    period_s = 2 * np.pi / mean_motion_rad_s(26_559.7e3)
    assert 4 < SIDEREAL_DAY_S / 2 - period_s < 5.5


@pytest.mark.parametrize(
    ("name", "longitude_deg"),
    [("C01", 140.0), ("C02", 80.0), ("C03", 110.5), ("C04", 160.0), ("C05", 58.75), ("C59", 140.0), ("C61", 110.5)],
)
def test_geostationary_satellites_stand_still_at_their_longitude(name, longitude_deg):
    x, y, z = satellite_positions_m([by_name(name)], START_S + np.arange(0, 10 * 86_400, 7_200.0))[:, 0].T
    np.testing.assert_allclose(np.degrees(np.arctan2(y, x)), longitude_deg, atol=1e-9)
    np.testing.assert_allclose(z, 0.0, atol=1e-6)
    np.testing.assert_allclose(np.hypot(x, y), 42_164e3)


@pytest.mark.parametrize(
    ("names", "longitude_deg"), [(("C06", "C07", "C08"), 118.0), (("C09", "C10"), 95.0), (("C43", "C44", "C45"), 118.0)]
)
def test_inclined_satellites_cross_the_equator_at_their_longitude(names, longitude_deg):
    """Both crossings, northward and southward, of a figure of eight lie at one longitude."""
    time = START_S + np.arange(0, 86_400, 10.0)
    positions = satellite_positions_m([by_name(name) for name in names], time)
    for k in range(len(names)):
        x, y, z = positions[:, k].T
        crossings = np.flatnonzero(z[:-1] * z[1:] < 0)
        assert crossings.size == 2
        share = z[crossings] / (z[crossings] - z[crossings + 1])
        longitude = np.degrees(np.arctan2(y, x))
        at = longitude[crossings] + share * (longitude[crossings + 1] - longitude[crossings])
        np.testing.assert_allclose(at, longitude_deg, atol=1e-4)


def test_inclined_satellites_of_a_group_follow_each_other_at_eight_hours():
    """Over one place, a third of a sidereal day after each other: the very same track."""
    group = [by_name(name) for name in ("C06", "C07", "C08")]
    first = satellite_positions_m([group[0]], START_S)[0, 0]
    for k, satellite in enumerate(group):
        # Mean anomaly 120 k: satellite k is ahead by k thirds, so it was there that much earlier.
        then = satellite_positions_m([satellite], START_S - k * SIDEREAL_DAY_S / 3)[0, 0]
        assert angle_deg(first, then) < 1e-5


def test_beidou_3_crosses_four_hours_from_beidou_2():
    there = satellite_positions_m([by_name("C06")], START_S)[0, 0]
    then = satellite_positions_m([by_name("C43")], START_S - SIDEREAL_DAY_S / 6)[0, 0]
    assert angle_deg(there, then) < 1e-5


def test_ground_tracks_repeat_after_a_sidereal_day():
    now, later = satellite_positions_m(constellation_slots(["GPS", "BDS-2"]), START_S + np.array([0, SIDEREAL_DAY_S]))
    moved = angle_deg(now, later)
    # GPS comes back but for the 9 to 10 s that its radius gains on a round Earth.
    assert moved[:24].max() < 0.1
    assert moved[24:34].max() < 1e-5
    # Four MEO satellites go round 13 times in seven days, not twice in one.
    assert moved[34:].min() > 10


def test_beidou_medium_orbits_repeat_after_thirteen_turns_in_seven_days():
    slots = [slot for slot in CONSTELLATIONS["BDS-3"]() if slot.orbit == "BDS-MEO"]
    now, later = satellite_positions_m(slots, START_S + np.array([0, 7 * SIDEREAL_DAY_S]))
    assert angle_deg(now, later).max() < 1.0


def test_gps_slots_are_where_the_table_puts_them_at_its_epoch():
    """Equator crossing at RAAN - Greenwich hour angle, and sin(latitude) = sin(u) sin(55 deg)."""
    positions = satellite_positions_m(CONSTELLATIONS["GPS"](), gps_seconds("1993-07-01"))[0] / 26_559.7e3
    a1, f4 = positions[0], positions[23]
    assert a1[2] == pytest.approx(np.sin(np.radians(268.126)) * np.sin(np.radians(55)), abs=1e-12)
    assert f4[2] == pytest.approx(np.sin(np.radians(135.346)) * np.sin(np.radians(55)), abs=1e-12)
    u = np.radians(135.346)
    longitude = 212.847 - 279.06 + np.degrees(np.arctan2(np.cos(np.radians(55)) * np.sin(u), np.cos(u)))
    assert np.degrees(np.arctan2(f4[1], f4[0])) == pytest.approx(longitude, abs=1e-9)


def test_satellites_move_as_a_rotating_frame_demands():
    """Speed seen from the turning Earth: v + omega x r, against a difference quotient."""
    slot, step_s = by_name("G07"), 0.5
    before, here, after = satellite_positions_m([slot], START_S + np.array([-step_s, 0, step_s]))[:, 0]
    velocity = (after - before) / (2 * step_s)
    inertial = velocity + np.cross([0, 0, 7.2921158e-5], here)
    assert np.linalg.norm(inertial) == pytest.approx(mean_motion_rad_s(26_559.7e3) * 26_559.7e3, rel=1e-6)
    assert inertial @ here == pytest.approx(0.0, abs=1e-6 * np.linalg.norm(inertial) * 26_559.7e3)
    assert np.cross(here, inertial)[2] > 0
