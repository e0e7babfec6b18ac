"""Tracks and claims of other programs: RTKLIB's solutions, NMEA logs, tables."""

from __future__ import annotations

import functools
import operator
from pathlib import Path

import numpy as np
import pytest

from pl_mc.geometry.frames import from_geodetic, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_claims, read_truth
from pl_mc.receiver.truth import is_file

FILES = Path(__file__).parent / "files"
# Solutions of one day by RTKLIB, in three of its forms.
FORMS = ("esbjerg_llh.pos", "esbjerg_xyz.pos", "esbjerg.nmea")
FIRST_GPS_S = gps_seconds("2020-06-25T00:00:00")


def sentence(body: str) -> str:
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}"


def gga(time: str, *, minutes: str = "5529.6148135", quality: int = 1, height: str = "18.827", geoid: str = "40.602"):
    return sentence(f"GNGGA,{time},{minutes},N,00827.4096296,E,{quality},16,1.0,{height},M,{geoid},M,0.0,0000")


def rmc(time: str, date: str, status: str = "A") -> str:
    return sentence(f"GNRMC,{time},{status},5529.6148135,N,00827.4096296,E,0.01,0.00,{date},0.0,E,A,V")


def written(folder: Path, *lines: str, name: str = "log.nmea") -> Path:
    path = folder / name
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def test_three_forms_of_one_solution_are_one_track() -> None:
    tracks = [read_truth(str(FILES / name)) for name in FORMS]
    for track in tracks:
        # The log begins before midnight of UTC and has 18 leap seconds behind it.
        np.testing.assert_allclose(track.time_gps_s, FIRST_GPS_S + 30.0 * np.arange(8), atol=1e-5)
        # RTKLIB writes degrees to 1e-9, metres and heights to 1e-4; NMEA minutes to 1e-7 and heights to 1e-3.
        np.testing.assert_allclose(track.position_m, tracks[1].position_m, atol=2e-3)
        assert np.abs(track.position_m - [3582104.8991, 532590.1966, 5232755.2961]).max() < 3.0
    assert tracks[0].notes == ("esbjerg_llh.pos: 8 positions (8 single) of RTKLIB's form.",)
    assert tracks[2].notes == ("esbjerg.nmea: 8 positions of GGA sentences.",)


def test_standard_deviations_of_a_solution_are_one_ellipsoid_in_either_form() -> None:
    llh, xyz = (read_claims(FILES / name) for name in FORMS[:2])
    assert llh.covariance_m2 is not None
    # 1.3458 m east, 1.8422 north, 3.0266 up; the covariance of north and east is the square of 0.7798.
    np.testing.assert_allclose(np.sqrt(np.diag(llh.covariance_m2[0])), [1.3458, 1.8422, 3.0266], atol=1e-9)
    assert llh.covariance_m2[0, 0, 1] == pytest.approx(0.7798**2)
    # Rounded to 1e-4 m of the standard deviation, near 3 m.
    np.testing.assert_allclose(xyz.covariance_m2, llh.covariance_m2, atol=2e-3)
    assert llh.satellites is not None
    assert llh.satellites.tolist() == [16] * 8
    with pytest.raises(InputError, match=r"esbjerg\.nmea: it says nothing of the errors .* GST sentences are needed"):
        read_claims(FILES / FORMS[2])


HEAD = "%  GPST          latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
ROW = "55.493580225    8.456827161    59.4284   1  16   1.5   1.0   3.0"


@pytest.mark.parametrize(
    ("head", "row"),
    [
        (HEAD, f"2020/06/25 00:00:30.000 {ROW}"),
        (HEAD, f"2020/06/24 23:59:90.000 {ROW}"),
        (HEAD, f"2111 345630.000 {ROW}"),
        (HEAD.replace("GPST", "UTC"), f"2020/06/25 00:00:12.000 {ROW}"),
        (HEAD.replace("GPST", "JST"), f"2020/06/25 09:00:12.000 {ROW}"),
        (",".join(HEAD.split()).replace("%,", "%  "), ",".join(f"2020/06/25 00:00:30.000 {ROW}".split())),
        (HEAD.replace("(deg)", "(d'\")"),
         "2020/06/25 00:00:30.000 55 29 36.88881 8 27 24.577780 59.4284 1 16 1.5 1.0 3.0"),
    ],
)  # fmt: skip
def test_times_separators_and_angles_of_a_solution_in_any_form(head: str, row: str, tmp_path: Path) -> None:
    fixes = read_claims(written(tmp_path, head, row, name="any.pos"))
    assert fixes.time_gps_s == pytest.approx(FIRST_GPS_S + 30.0)
    expected = from_geodetic(np.radians(55.493580225), np.radians(8.456827161), np.array(59.4284))
    np.testing.assert_allclose(fixes.position_m[0], expected, atol=1e-3)
    np.testing.assert_allclose(np.diag(fixes.covariance_m2[0]), [1.0, 2.25, 9.0])


def test_southern_and_western_angles_keep_their_sign(tmp_path: Path) -> None:
    head, row = HEAD.replace("(deg)", "(d'\")"), "2020/06/25 00:00:30 -0 30 36.0 -8 27 36.0 59.4 1 16 1.5 1.0 3.0"
    latitude, longitude, _ = geodetic(read_claims(written(tmp_path, head, row, name="south.pos")).position_m[0])
    assert np.degrees([latitude, longitude]) == pytest.approx([-0.51, -8.46])


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("% program : RTKLIB", f"2020/06/25 00:00:30 {ROW}"), "line 2: no heading names the columns"),
        ((HEAD,), "the solution has no positions"),
        ((HEAD, f"2020/06/25 00:00:30 {ROW} 7"), "line 2: 10 columns are needed, as its heading says, not 11"),
        ((HEAD, f"2020/13/25 00:00:30 {ROW}"), "line 2: '2020/13/25 00:00:30' is no time"),
        ((HEAD, f"2020/06/25 00:00:30 {ROW.replace('59.4284', 'x')}"), "line 2: the height 'x' is not a finite"),
        ((HEAD, f"2020/06/25 00:00:30 {ROW.replace('55.49', '95.49')}"), "line 2: the latitude 95.4936 is outside"),
        (("% (lat/lon/height=WGS84/geodetic,Q=1:fix)", HEAD), "line 1: its heights are above the geoid"),
        (("%  GPST e-baseline(m) n-baseline(m) u-baseline(m) Q",), "line 1: it holds baselines to a station"),
        (("%  UTC latitude(deg) longitude(deg) height(m)", "2111 345630.0 55 8 59"), "weeks count in GPST"),
        ((HEAD, f"2020/06/25 00:00:30 {ROW}", f"2020/06/25 00:00:31 {ROW.replace('55.4', '54.4')}"), "track jumps by"),
    ],
)  # fmt: skip
def test_damaged_solutions_name_line_and_rule(lines: tuple[str, ...], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"any\.pos") as caught:
        read_truth(str(written(tmp_path, *lines, name="any.pos")))
    assert words in str(caught.value)


def test_a_log_takes_the_date_that_is_near_across_midnight_and_leaves_out_what_is_damaged(tmp_path: Path) -> None:
    gst = sentence("GNGST,235959.50,1.1,,,,0.9,0.6,1.7")
    lines = [
        "12:00 " + gga("235959.00"), rmc("235959.00", "311216"), gst, gga("235959.50"),
        gga("000000.00"), gga("000000.50").replace("16", "17", 1), rmc("000000.00", "010117"),
        gga("000001.00", quality=0), gga("000001.50", geoid=""), gga("000002.00", minutes="5575.0"),
        gga("000000.00"), "$GNGGA,0000", "$GPGSV,3,1,11,10,63,137,17,07*41", "noise",
    ]  # fmt: skip
    fixes = read_claims(written(tmp_path, *lines))
    # A leap second came with 2017: 17 s before, 18 s after it.
    np.testing.assert_allclose(
        fixes.time_gps_s, [gps_seconds("2016-12-31T23:59:59") + 17 + k for k in (0.0, 0.5)] + [
            gps_seconds("2017-01-01T00:00:00") + 18
        ]
    )  # fmt: skip
    assert np.isnan(fixes.covariance_m2[0]).all()
    np.testing.assert_allclose(np.diag(fixes.covariance_m2[1]), [0.36, 0.81, 2.89])
    said = " ".join(fixes.notes)
    for words in (
        "4 positions of GGA", "1 NMEA sentences with another checksum", "1 NMEA sentences of GGA without a fix",
        "1 NMEA sentences of GGA without a height above", "1 NMEA sentences with fields that are none",
        "1 NMEA sentences without the form", "1 positions have the time of another one",
    ):  # fmt: skip
        assert words in said, words
    # The height of GGA is above the geoid, and its separation makes it one above the ellipsoid.
    assert geodetic(fixes.position_m[0])[2] == pytest.approx(59.429)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ((gga("000000.00"),), "it has no date; RMC or ZDA sentences are needed"),
        ((rmc("000000.00", "010117"),), "no GGA sentence gives a position"),
        ((gga("000000.00"), rmc("000000.00", "010117", "V")), "it has no date"),
        ((gga("000000.00", quality=0),), "no GGA sentence gives a position. log.nmea: 1 NMEA sentences of GGA without"),
    ],
)
def test_logs_that_give_no_track(lines: tuple[str, ...], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"log\.nmea") as caught:
        read_truth(str(written(tmp_path, *lines)))
    assert words in str(caught.value)


def test_dates_of_zda_serve_as_well(tmp_path: Path) -> None:
    path = written(tmp_path, sentence("GPZDA,000012.00,25,06,2020,00,00"), gga("000012.00"))
    assert read_truth(str(path)).time_gps_s == pytest.approx(FIRST_GPS_S + 30.0)


@pytest.mark.parametrize(
    ("heading", "row", "time_gps_s"),
    [
        ("time_gps_s", str(FIRST_GPS_S + 30), 30.0), ("week,tow_s", "2111,345630", 30.0),
        ("week,itow_ms", "2111,345630500", 30.5), ("time_gps", "2020-06-25T00:00:30", 30.0),
        ("time_utc", "2020-06-25T00:00:12Z", 30.0), ("time_utc", "2020-06-25T02:00:12+02:00", 30.0),
    ],
)  # fmt: skip
def test_times_of_a_table(heading: str, row: str, time_gps_s: float, tmp_path: Path) -> None:
    path = written(tmp_path, f"{heading},east_m,north_m,up_m,hpl_m", f"{row},1,2,3,4", name="a.csv")
    assert read_claims(path).time_gps_s == pytest.approx(FIRST_GPS_S + time_gps_s)


def test_a_table_gives_accuracies_and_levels_and_may_leave_cells_empty(tmp_path: Path) -> None:
    lines = (
        "# of a receiver", "week,tow_s,latitude_deg,longitude_deg,height_m,hAcc_m,vAcc_m,HPL_m,VPL_m,satellites",
        "2111,345601,55.5,8.4,59,2,3,9,10,12", "2111,345600,55.5,8.4,59,,3,nan,11,12",
    )  # fmt: skip
    fixes = read_claims(written(tmp_path, *lines, name="u.csv"))
    np.testing.assert_allclose(np.diag(fixes.covariance_m2[1]), [2.0, 2.0, 9.0])
    assert np.isnan(fixes.covariance_m2[0]).all()
    np.testing.assert_array_equal(fixes.level_m["hpl"], [np.nan, 9.0])
    np.testing.assert_array_equal(fixes.level_m["vpl"], [11.0, 10.0])
    expected = from_geodetic(np.radians(55.5), np.radians(8.4), np.array(59.0))
    np.testing.assert_allclose(fixes.position_m[0], expected)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("time_gps_s,hpl_m", "1,2"), "columns x_m, y_m, z_m; latitude_deg"),
        (("tow,east_m,north_m,up_m,hpl_m", "1,2,3,4,5"), "columns time_gps_s; week, tow_s"),
        (("time_gps_s,east_m,north_m,up_m", "1,2,3,4"), "no column says what is claimed"),
        (("time_gps_s,east_m,north_m,up_m,hpl_m", "1,2,3,4,x"), "line 2: the hpl_m 'x' is not a finite number"),
        (("time_gps_s,east_m,north_m,up_m,hpl_m", "1,2,3,4"), "line 2: 5 columns are needed, not 4"),
        (("time_gps_s,east_m,north_m,up_m,hpl_m,hpl_m", "1,2,3,4,5,6"), "line 1: two columns have one name"),
        (("time_utc,east_m,north_m,up_m,hpl_m", "noon,2,3,4,5"), "line 2: the time_utc 'noon' is no date"),
        (("",), "the table is empty"),
    ],
)
def test_tables_that_say_nothing(lines: tuple[str, ...], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.csv") as caught:
        read_claims(written(tmp_path, *lines, name="a.csv"))
    assert words in str(caught.value)


def test_a_file_and_a_position_are_told_apart() -> None:
    assert all(map(is_file, ("a.pos", "b.NMEA", "c.csv.gz", "d.txt", " e.pos ", "f.ubx.zip")))
    assert not any(map(is_file, ("1,2,3", "3582104.8991,532590.1966,5232755.2961", "", "here")))
