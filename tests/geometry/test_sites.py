"""Sites: the named ones are where they should be, and what is no position is refused."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.geometry.frames import geodetic
from pl_mc.geometry.sites import SITES, site_position_m
from pl_mc.input_errors import InputError


@pytest.mark.parametrize(
    ("name", "latitude_deg", "longitude_deg"),
    [("CUT0", -32.004, 115.895), ("JFNG", 30.516, 114.491), ("ESBC", 55.494, 8.457)],
)
def test_named_sites_are_on_the_map(name, latitude_deg, longitude_deg):
    latitude, longitude, height = geodetic(site_position_m(name))
    assert np.degrees(latitude) == pytest.approx(latitude_deg, abs=1e-3)
    assert np.degrees(longitude) == pytest.approx(longitude_deg, abs=1e-3)
    assert -50 < height < 200
    assert SITES[name].source


def test_a_position_may_be_text_or_numbers():
    expected = SITES["ESBC"].position_m
    np.testing.assert_array_equal(site_position_m("3582104.8991, 532590.1966, 5232755.2961"), expected)
    np.testing.assert_array_equal(site_position_m(expected), expected)


def test_the_answer_is_the_caller_s_own():
    site_position_m("CUT0")[:] = 0.0
    assert site_position_m("CUT0")[0] == SITES["CUT0"].position_m[0]


@pytest.mark.parametrize(
    ("site", "words"),
    [
        ("CUT1", "site: 'CUT1' is unknown .nearest: CUT0"),
        ("Atlantis", "valid: CUT0, JFNG, ESBC"),
        ("1,2,north", "is X,Y,Z in metres"),
        ("1,2", "3 coordinates in metres"),
        (np.zeros((2, 3)), "not shape .2, 3."),
        (("a", "b", "c"), "cannot be read"),
        ((np.nan, 6.4e6, 0.0), "finite number"),
        ((91.0, 0.0, 0.0), r"inside the Earth as X,Y,Z in metres, and no latitude .up to 90 deg."),
        ((45.0, 7.0), "3 coordinates in metres, or latitude, longitude and height, are needed, not 2"),
        # Kilometres where metres belong.
        ((-2364.3, 4870.3, -3360.8), "inside the Earth"),
        ((6_370_000.0, 0.0, 0.0), "-8137 m is below the limit, -1000 m"),
        ((7_000_000.0, 0.0, 0.0), "621863 m is above the limit, 100000 m"),
    ],
)
def test_bad_sites_are_refused(site, words):
    with pytest.raises(InputError, match=words):
        site_position_m(site)
