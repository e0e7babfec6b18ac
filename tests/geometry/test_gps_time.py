"""Dates and the angle of the Earth against published values."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

from pl_mc.geometry.gps_time import gmst_rad, gps_seconds
from pl_mc.input_errors import InputError


def test_gps_seconds_count_from_the_gps_epoch():
    assert gps_seconds("1980-01-06T00:00:00") == 0.0
    # GPS week 1976 began on 2017-11-19, a Sunday.
    assert gps_seconds("2017-11-21") == (1976 * 7 + 2) * 86_400.0
    assert gps_seconds(datetime(1980, 1, 6, 0, 0, 30)) == 30.0
    assert gps_seconds("1980-01-06T00:00:00.25") == 0.25


@pytest.mark.parametrize(
    ("date", "words"),
    [
        ("yesterday", "start: 'yesterday' is not a date"),
        ("2017-13-01", "is not a date"),
        (20171121, "is not a date"),
        ("2017-11-21T00:00:00Z", "has a time zone.*none: 2017-11-21T00:00:00"),
        ("1979-12-31", "before GPS time began; the first is 1980-01-06T00:00:00"),
    ],
)
def test_bad_dates_are_refused(date, words):
    with pytest.raises(InputError, match=words):
        gps_seconds(date)


@pytest.mark.parametrize(
    ("moment", "expected_deg"),
    [
        # Vallado, Fundamentals of Astrodynamics and Applications, example 3-5: 152.578787810 deg.
        ("1992-08-20T12:14:00", 152.578787810),
        # Meeus, Astronomical Algorithms, examples 12.a and 12.b: 13 h 10 min 46.3668 s and 8 h 34 min 57.0896 s.
        ("1987-04-10T00:00:00", 15 * (13 + 10 / 60 + 46.3668 / 3600)),
        ("1987-04-10T19:21:00", 15 * (8 + 34 / 60 + 57.0896 / 3600)),
        # GPS performance standard 2001, table 3-1: Greenwich hour angle 18 h 36 min 14.4 s, to about a second.
        ("1993-07-01T00:00:00", 279.06),
    ],
)
def test_sidereal_time_is_the_published_one(moment, expected_deg):
    tolerance_deg = 5e-3 if expected_deg == 279.06 else 1e-6
    assert np.degrees(gmst_rad(gps_seconds(moment))) % 360 == pytest.approx(expected_deg, abs=tolerance_deg)


def test_a_sidereal_day_is_one_turn():
    assert gmst_rad(86_164.09053) - gmst_rad(0.0) == pytest.approx(2 * np.pi, abs=1e-8)
