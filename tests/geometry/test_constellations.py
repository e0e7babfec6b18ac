"""Constellation tables: names, numbers, and the pattern of the slots."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pl_mc.error_models import ORBIT_CLASSES
from pl_mc.geometry.constellations import CONSTELLATIONS, constellation_slots
from pl_mc.input_errors import InputError


@pytest.fixture(params=sorted(CONSTELLATIONS))
def slots(request):
    return CONSTELLATIONS[request.param]()


def test_slots_are_named_after_their_system(slots):
    assert all(slot.name[0] == slot.system and len(slot.name) == 3 for slot in slots)
    assert {slot.orbit for slot in slots} <= set(ORBIT_CLASSES)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("GPS", {"GPS": 24}),
        ("BDS-2", {"BDS-GEO": 5, "BDS-IGSO": 5, "BDS-MEO": 4}),
        ("BDS-3", {"BDS-GEO": 3, "BDS-IGSO": 3, "BDS-MEO": 24}),
        ("GAL", {"GAL": 24}),
    ],
)
def test_counts(name, counts):
    assert Counter(slot.orbit for slot in CONSTELLATIONS[name]()) == counts


def test_names_never_meet_when_all_are_in_use():
    names = [slot.name for slot in constellation_slots(list(CONSTELLATIONS))]
    assert len(set(names)) == len(names) == 24 + 14 + 30 + 24
    assert {"C01", "C05", "C06", "C10", "C11", "C14", "C19", "C42", "C43", "C45", "C59", "C61"} <= set(names)


def test_moving_satellites_never_share_a_place():
    places = Counter(
        (slot.orbit, round(slot.raan_rad, 6), round(slot.argument_of_latitude_rad, 6))
        for slot in constellation_slots(["BDS-2", "BDS-3"])
        if slot.orbit != "BDS-GEO"
    )
    assert set(places.values()) == {1}


def test_gps_slots_are_the_performance_standard_s():
    """SPS performance standard 2001, table 3-1, three of its slots: A1, D3 and F4."""
    slots = {slot.name: slot for slot in CONSTELLATIONS["GPS"]()}
    for name, raan_deg, argument_deg in (("G01", 272.847, 268.126), ("G15", 92.847, 35.156), ("G24", 212.847, 135.346)):
        assert np.degrees(slots[name].raan_rad) == pytest.approx(raan_deg)
        assert np.degrees(slots[name].argument_of_latitude_rad) == pytest.approx(argument_deg)
    assert slots["G01"].semi_major_axis_m == 26_559_700.0


@pytest.mark.parametrize(("name", "orbit"), [("GAL", "GAL"), ("BDS-3", "BDS-MEO")])
def test_walker_pattern(name, orbit):
    """24/3/1: planes 120 deg apart, 45 deg within a plane, neighbours 360 * 1 / 24 = 15 deg out of step."""
    slots = [slot for slot in CONSTELLATIONS[name]() if slot.orbit == orbit]
    raan = np.degrees([slot.raan_rad for slot in slots]).reshape(3, 8)
    argument = np.degrees([slot.argument_of_latitude_rad for slot in slots]).reshape(3, 8)
    np.testing.assert_allclose(np.ptp(raan, axis=1), 0, atol=1e-9)
    np.testing.assert_allclose((raan[1:, 0] - raan[:-1, 0]) % 360, 120)
    np.testing.assert_allclose(np.diff(argument, axis=1) % 360, 45)
    np.testing.assert_allclose((argument[1:] - argument[:-1]) % 360, 15)


def test_geostationary_beidou_satellites_have_the_names_of_the_real_ones():
    """Navipedia, "BeiDou Space Segment" and the IGS tables: longitudes by number."""
    real = {
        "C01": 140.0,
        "C02": 80.0,
        "C03": 110.5,
        "C04": 160.0,
        "C05": 58.75,
        "C59": 140.0,
        "C60": 80.0,
        "C61": 110.5,
    }
    slots = {slot.name: slot for slot in constellation_slots(("BDS-2", "BDS-3"))}
    for name, longitude in real.items():
        slot = slots[name]
        assert slot.orbit == "BDS-GEO"
        at = np.degrees(slot.raan_rad + slot.argument_of_latitude_rad - slot.reference_sidereal_rad) % 360
        assert at == pytest.approx(longitude)


def test_a_single_constellation_and_satellite_may_stand_alone():
    assert len(constellation_slots("GPS", "G05")) == 23


@pytest.mark.parametrize(
    ("constellations", "without", "words"),
    [
        ([], (), "at least one is needed .valid: GPS, BDS-2, BDS-3, GAL"),
        (["GPS", "BDS"], (), "'BDS' is unknown .nearest: BDS-"),
        (["GPS", "GPS"], (), "'GPS' appears more than once"),
        ("GPS", ["G25"], "without: 'G25' is not in GPS .nearest: G2"),
        ("GPS", [f"G{k:02d}" for k in range(1, 25)], "every satellite is switched off"),
    ],
)
def test_bad_choices_are_refused(constellations, without, words):
    with pytest.raises(InputError, match=words):
        constellation_slots(constellations, without)
