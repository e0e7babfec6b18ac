"""The made-up flight: kinematics that fit each other, a landing where it began, and what banking hides."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.flight import (
    GRAVITY_M_S2,
    ZHENGZHOU_PLAIN,
    Flight,
    banked_visibility,
    fly,
    straight,
    survey_plan,
    turn,
)
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.orbits import satellite_positions_m
from pl_mc.input_errors import InputError

EPOCHS = 8622
START_S = gps_seconds("2018-08-07T12:52:13")


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(survey_plan(), epochs=EPOCHS)


def velocity_m_s(flight: Flight) -> np.ndarray:
    """East, north, up velocity between the epochs before and after each inner one, from positions alone."""
    latitude, longitude, _ = geodetic(flight.track_m)
    moved = (flight.track_m[2:] - flight.track_m[:-2]) / (flight.time_s[2:] - flight.time_s[:-2])[:, None]
    return np.einsum("eij,ej->ei", enu_rotation(latitude, longitude)[1:-1], moved)


def test_the_flight_lasts_as_long_as_the_paper_says(flight: Flight) -> None:
    assert flight.track_m.shape == (EPOCHS, 3)
    assert START_S + flight.time_s[-1] == gps_seconds("2018-08-07T15:15:54")


def test_speed_and_heading_are_those_of_the_track(flight: Flight) -> None:
    east, north, up = velocity_m_s(flight).T
    # Chords over two seconds are shorter than arcs by (rate dt)^2 / 6 at the most, 0.5 % at 25 degrees of bank; the
    # ellipsoid's curvature over 10 km adds less than 0.1 %.
    np.testing.assert_allclose(np.hypot(east, north), flight.speed_m_s[1:-1], rtol=0.006, atol=0.15)
    np.testing.assert_allclose(up, flight.climb_m_s[1:-1], atol=0.1)
    moving = flight.speed_m_s[1:-1] > 5
    off = np.arctan2(east, north) - flight.heading_rad[1:-1]
    assert np.abs((off[moving] + np.pi) % (2 * np.pi) - np.pi).max() < 0.02


def test_bank_is_that_of_a_coordinated_turn(flight: Flight) -> None:
    # v^2 / r with the curvature of the heading, from differences of the record itself.
    rate = (flight.heading_rad[2:] - flight.heading_rad[:-2]) / 2
    steady = np.abs(np.diff(flight.bank_rad, 2)) < 1e-9
    expected = np.arctan(flight.speed_m_s[1:-1] * rate / GRAVITY_M_S2)
    np.testing.assert_allclose(flight.bank_rad[1:-1][steady], expected[steady], atol=1e-6)
    assert np.degrees(np.abs(flight.bank_rad).max()) == pytest.approx(25.0, abs=1e-6)


def test_a_full_circle_has_the_radius_of_its_bank() -> None:
    plan = (straight(20, speed_m_s=28), turn(720, bank_deg=20))
    circling = fly(plan, epochs=130)
    steady = np.abs(circling.bank_rad - np.radians(20)) < 1e-9
    enu = enu_rotation(*np.radians([ZHENGZHOU_PLAIN.latitude_deg, ZHENGZHOU_PLAIN.longitude_deg]))
    plane = (circling.track_m[steady] - circling.track_m[steady].mean(axis=0)) @ enu[:2].T
    # Circle through points: |p|^2 = 2 c.p + (r^2 - |c|^2), linear in centre and constant.
    columns = np.column_stack([2 * plane, np.ones(len(plane))])
    *centre, rest = np.linalg.lstsq(columns, (plane**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(rest + np.square(centre).sum())
    assert radius == pytest.approx(28**2 / (GRAVITY_M_S2 * np.tan(np.radians(20))), rel=1e-3)


def test_nothing_jumps(flight: Flight) -> None:
    assert np.abs(np.diff(flight.speed_m_s)).max() < 4.0
    assert np.abs(np.diff(flight.climb_m_s)).max() < 1.0
    # Bank and heading in degrees from one second to the next.
    assert np.degrees(np.abs(np.diff(flight.bank_rad)).max()) < 13.0
    assert np.degrees(np.abs(np.diff(flight.heading_rad)).max()) < 10.0
    assert np.linalg.norm(np.diff(flight.track_m, n=2, axis=0), axis=1).max() < 6.0


def test_it_begins_and_ends_on_its_runway(flight: Flight) -> None:
    apart = np.linalg.norm(flight.track_m[-1] - flight.track_m[0])
    assert apart < 1.0
    assert flight.height_m.min() == pytest.approx(ZHENGZHOU_PLAIN.height_m, abs=1e-3)
    assert flight.height_m[-1] == pytest.approx(ZHENGZHOU_PLAIN.height_m, abs=1e-3)
    assert flight.speed_m_s[0] == 0
    assert flight.speed_m_s[-1] == 0
    assert 590 < np.ptp(flight.height_m) < 610


def test_fewer_epochs_are_the_beginning_of_the_same_flight(flight: Flight) -> None:
    short = fly(survey_plan(), epochs=600)
    np.testing.assert_allclose(short.track_m, flight.track_m[:600], atol=1e-6)


def test_banking_hides_satellites_on_the_outer_side_alone(flight: Flight) -> None:
    slots = constellation_slots(("GPS", "BDS-2"))
    time_gps_s = START_S + flight.time_s
    seen = banked_visibility(flight, slots, time_gps_s, mask_deg=10.0)
    latitude, longitude, _ = geodetic(flight.track_m)
    sight = satellite_positions_m(slots, time_gps_s) - flight.track_m[:, None]
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    east, north, up = np.moveaxis(np.einsum("eij,emj->emi", enu_rotation(latitude, longitude), sight), -1, 0)
    above = np.degrees(np.arcsin(up)) >= 10.0
    level = flight.bank_rad == 0
    np.testing.assert_array_equal(seen[level], above[level])
    right_of_heading = np.sin(np.arctan2(east, north) - flight.heading_rad[:, None])
    hidden = above & ~seen
    assert hidden.any()
    # In a right turn the left wing is up: what it hides lies to the left. Straight ahead and behind, the leaning
    # plane hides a little too: with elevation e and s = sin of the bearing, the sine of the elevation above it is
    # cos(bank) sin(e) + sin(bank) cos(e) s, so that e over the mask needs s < tan(mask) tan(bank / 2) to be hidden.
    limit = np.tan(np.radians(10.0)) * np.tan(np.radians(25.0 / 2))
    assert (np.sign(flight.bank_rad)[:, None] * right_of_heading)[hidden].max() < limit
    # No more than the bank hides satellites above the mask.
    lost = np.degrees(np.arcsin(up))[hidden] - 10.0
    assert lost.max() <= 25.0 + 1e-9


def test_turns_that_cannot_be_flown_are_refused() -> None:
    with pytest.raises(InputError, match="manoeuvre 1 is a turn, but the aircraft stands"):
        fly((turn(90),), epochs=10)
    with pytest.raises(InputError, match="manoeuvre 2 turns 5 deg, too few for a bank of 25 deg"):
        fly((straight(10, speed_m_s=28), turn(5)), epochs=100)
