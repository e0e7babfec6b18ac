"""The nominal sky against one that Stanford's MAAST computed.

MAAST's almanac of GPS is the table of 24 slots at another time; that of Galileo another Walker 24/3/1 pattern. One
advance along the orbits and one turn of the Earth take ours to theirs; both are read off the almanacs' first
satellites, and then every line of sight at every place and time of the file has to agree. MAAST numbers the slots
as we do, but for PRN 19 and 20, which are E4 and E3.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pl_mc.geometry.constellations import Slot, galileo, gps
from pl_mc.geometry.frames import enu_rotation, from_geodetic
from pl_mc.geometry.gps_time import gmst_rad
from pl_mc.geometry.orbits import mean_motion_rad_s, satellite_positions_m

ROWS = np.genfromtxt(Path(__file__).parent / "maast_rows.csv", delimiter=",", skip_header=3)


def check(slots: tuple[Slot, ...], first_prn: int, node_deg: float, argument_deg: float, tolerance: float) -> None:
    """Compare all rows of a system; node longitude and argument of latitude are its first satellite's at t = 0."""
    first = slots[0]
    advance = (np.radians(argument_deg) - first.argument_of_latitude_rad) % (2 * np.pi)
    start_s = first.reference_gps_s + advance / mean_motion_rad_s(first.semi_major_axis_m)
    node = first.raan_rad - first.reference_sidereal_rad - gmst_rad(start_s) + gmst_rad(first.reference_gps_s)
    turn = np.radians(node_deg) - node
    cos, sin = np.cos(turn), np.sin(turn)
    turn_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    mine = ROWS[(ROWS[:, 4] >= first_prn) & (ROWS[:, 4] < first_prn + 24)]
    assert len(mine) > 80
    for _, t_s, latitude_deg, longitude_deg, prn, *row in mine:
        slot = slots[{19: 20, 20: 19}.get(int(prn), int(prn)) - first_prn]
        place = np.radians([latitude_deg, longitude_deg])
        sight = turn_z @ satellite_positions_m([slot], start_s + t_s)[0, 0] - from_geodetic(*place, 0.0)
        enu = enu_rotation(*place) @ sight
        np.testing.assert_allclose(-enu / np.linalg.norm(enu), row, atol=tolerance)


@pytest.mark.parametrize(
    ("slots", "first_prn", "node_deg", "argument_deg", "tolerance"),
    [
        # 268.126 deg of the table and 4.639 deg of travel; MAAST rounds its radius to 26 559.8 km.
        (gps(), 1, 272.847, 272.765, 1e-4),
        (galileo(), 75, 25.0, 338.222, 4e-4),
    ],
    ids=["gps", "galileo"],
)
def test_lines_of_sight_agree(slots, first_prn, node_deg, argument_deg, tolerance):
    check(slots, first_prn, node_deg, argument_deg, tolerance)
