"""The 24 + 24 satellites for which ARAIM is studied, by one name, against the sky that Stanford's MAAST computed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pl_mc
from pl_mc.geometry.constellations import SETS, add_24_24, constellation_slots
from pl_mc.geometry.frames import enu_rotation, from_geodetic
from pl_mc.geometry.orbits import satellite_positions_m

ROWS = np.genfromtxt(Path(__file__).parent / "maast_rows.csv", delimiter=",", skip_header=3)


def test_lines_of_sight_are_those_of_maast():
    """Every satellite at every place and time of the file; MAAST counts E4 before E3, and Galileo from 75 on.

    1e-6 is what angles of six digits leave.
    """
    slots = {slot.name: slot for slot in add_24_24()}
    start_s = slots["G01"].reference_gps_s
    seen = set()
    for _, t_s, latitude_deg, longitude_deg, prn, *row in ROWS:
        number = {19: 20, 20: 19}.get(int(prn), int(prn))
        name = f"G{number:02d}" if number < 75 else f"E{number - 74:02d}"
        place = np.radians([latitude_deg, longitude_deg])
        sight = satellite_positions_m([slots[name]], start_s + t_s)[0, 0] - from_geodetic(*place, 0.0)
        enu = enu_rotation(*place) @ sight
        np.testing.assert_allclose(-enu / np.linalg.norm(enu), row, atol=2e-6, err_msg=f"{name} at {t_s} s")
        seen.add(name)
    assert seen == set(slots)
    assert len(slots) == 48


def test_one_name_says_it():
    g = pl_mc.simulate(site=(48.0, 11.0, 500.0), constellations="ADD-24+24", epochs=1, mask_deg=5.0)[0]
    assert set(g.systems) == {"G", "E"}
    assert constellation_slots(["ADD-24+24"], "E24") == add_24_24()[:-1]
    assert list(SETS) == ["ADD-24+24"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"constellations": ("ADD-24+24", "GPS")}, "constellations: ADD-24.24 stands alone, not together with others"),
        ({"constellations": "ADD-24"}, "constellations: 'ADD-24' is unknown .nearest: ADD-24.24"),
        ({"constellations": ("GPS", "ADD-24+24"), "sp3": "day.sp3"}, "ADD-24.24 is nominal as a whole.* GPS and GAL"),
        ({"constellations": "ADD-24+24", "almanac": "week.alm"}, "ADD-24.24 is nominal as a whole.* GPS and GAL"),
    ],
)
def test_what_it_cannot_be(options, words):
    with pytest.raises(pl_mc.InputError, match=words):
        pl_mc.simulate(**options)
