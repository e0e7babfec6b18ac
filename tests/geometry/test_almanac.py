"""Almanacs: positions as RTKLIB has them, both text forms alike, and sentences for files that are none."""

from __future__ import annotations

import numpy as np
import pyrtklib
import pytest
from almanac_files import TOA_S, WEEK, elements, sem, yuma
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pl_mc
from pl_mc.geometry.almanac import almanac_slots
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.orbits import satellite_positions_m

WEEK_S = 604_800
START = "2020-06-25T06:00:00"


def written(tmp_path, text: str, name: str = "almanac.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_positions_are_those_of_rtklib(tmp_path):
    records = elements(12)
    slots = almanac_slots(written(tmp_path, yuma(records)), gps_seconds(START))
    assert [slot.name for slot in slots] == [f"G{r['prn']:02d}" for r in records if r["health"] == 0]
    time_s = gps_seconds(START) + np.arange(0.0, 86_400.0, 7_000.0)
    found = satellite_positions_m(slots, time_s)
    for column, slot in enumerate(slots):
        r = records[int(slot.name[1:]) - 1]
        alm = pyrtklib.alm_t()
        alm.sat = pyrtklib.satno(pyrtklib.SYS_GPS, r["prn"])
        alm.toa, alm.toas = pyrtklib.gpst2time(WEEK, TOA_S), TOA_S
        alm.A, alm.e, alm.i0, alm.OMG0 = r["root"] ** 2, r["e"], r["i"], r["raan"]
        alm.omg, alm.M0, alm.OMGd = r["perigee"], r["mean"], r["rate"]
        for row, moment in enumerate(time_s):
            position, clock = pyrtklib.Arr1Ddouble(3), pyrtklib.Arr1Ddouble(1)
            week, second = divmod(float(moment), WEEK_S)
            pyrtklib.alm2pos(pyrtklib.gpst2time(int(week), second), alm, position, clock)
            # The Earth turns by mean sidereal time here, which precession makes 7e-12 rad/s faster than the rate of
            # GPS: 16 m for each day from the almanac's time.
            np.testing.assert_allclose(found[row, column], [position[k] for k in range(3)], atol=30.0)


def test_both_forms_say_the_same(tmp_path):
    records = elements(8, seed=2)
    near_s = gps_seconds(START)
    one = almanac_slots(written(tmp_path, yuma(records), "a.alm"), near_s)
    other = almanac_slots(written(tmp_path, sem(records), "a.al3"), near_s)
    times = near_s + np.arange(0, 50_000, 9_000.0)
    # Seven to nine decimals of radians, at 26,560 km.
    np.testing.assert_allclose(satellite_positions_m(one, times), satellite_positions_m(other, times), atol=0.5)


def test_the_week_is_the_one_nearest_to_the_simulation(tmp_path):
    path = written(tmp_path, yuma(elements(2)))
    for near, week in ((START, WEEK), ("2001-01-01", WEEK - 1024), ("2039-01-01", WEEK + 1024)):
        assert almanac_slots(path, gps_seconds(near))[0].reference_gps_s == week * WEEK_S + TOA_S
    whole = almanac_slots(written(tmp_path, yuma(elements(2), week=WEEK)), gps_seconds(START))
    assert whole == almanac_slots(path, gps_seconds(START))


def test_a_simulation_with_an_almanac(tmp_path):
    path = written(tmp_path, yuma(elements(32, seed=3)))
    g = pl_mc.simulate(site="CUT0", start=START, epochs=4, constellations=("GPS", "BDS-2"), almanac=path, without="G05")
    assert "G04" not in g.names
    assert "G05" not in g.names
    nominal = pl_mc.simulate(site="CUT0", start=START, epochs=4, constellations=("GPS", "BDS-2"))
    assert {"C06"} <= set(g.names)
    assert {n for n in g.names if n[0] == "C"} == {n for n in nominal.names if n[0] == "C"}
    assert {n for n in g.names if n[0] == "G"} != {n for n in nominal.names if n[0] == "G"}
    with pytest.raises(pl_mc.InputError, match="almanac: it holds GPS satellites"):
        pl_mc.simulate(start=START, epochs=1, constellations="BDS-2", almanac=path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no YUMA or SEM almanac"),
        ("     3.04           OBSERVATION DATA\n", "no YUMA or SEM almanac"),
        (
            yuma(elements(1)).replace("Eccentricity", "Excentricity"),
            "line 1: the record of a satellite lacks eccentricity",
        ),
        (yuma(elements(2)).replace("PRN-02", "PRN-01").replace(": " + " " * 24 + "02", ": 1"), "PRN 1 appears twice"),
        (yuma(elements(1)).replace("5153", "51x3"), "line 8: a number is needed"),
        (yuma(elements(1)).replace("Health:                     000", "Health: 063"), "no healthy satellite"),
        (sem(elements(3))[:-40], "is it cut short"),
        (sem(elements(3)).replace("03 CURRENT", "05 CURRENT"), "promises 5 satellites"),
        (yuma(elements(1)).replace("SQRT(A)  (m 1/2):           5", "SQRT(A)  (m 1/2):           9"), "root_axis is 9"),
        ("\0" * 10, "binary data"),
    ],
)
def test_bad_files(tmp_path, text, sentence):
    with pytest.raises(pl_mc.InputError, match=sentence) as caught:
        almanac_slots(written(tmp_path, text), gps_seconds(START))
    assert "almanac.txt" in str(caught.value)
    with pytest.raises(pl_mc.InputError, match="cannot be read"):
        almanac_slots(tmp_path / "nothing", gps_seconds(START))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), form=st.sampled_from([yuma, sem]))
def test_mutated_files_are_read_or_refused(tmp_path, data, form):
    """Never another exception, and never an orbit that is none."""
    text = bytearray(form(elements(3)).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        how = data.draw(st.sampled_from(["change", "cut", "repeat"]))
        if how == "change":
            text[at] = data.draw(st.integers(0, 255))
        elif how == "cut":
            del text[at : at + data.draw(st.integers(1, 60))]
        else:
            text[at:at] = text[at : at + 80]
        if not text:
            break
    path = tmp_path / "mutated"
    path.write_bytes(bytes(text))
    try:
        slots = almanac_slots(path, gps_seconds(START))
    except pl_mc.InputError as refused:
        said = str(refused)
        slots = ()
    else:
        said = "mutated"
    assert "mutated" in said
    radius = np.linalg.norm(satellite_positions_m(slots, gps_seconds(START)), axis=-1) if slots else np.array([3e7])
    assert ((radius > 1e7) & (radius < 7.4e7)).all()
