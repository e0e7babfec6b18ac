"""The true position: a point, a track, and the sentences about everything else."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from receiver_files import TRUTH_M, TRUTH_TEXT

from pl_mc.geometry.frames import geodetic
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_truth

HEADING = "time_gps_s,x_m,y_m,z_m"


def track(folder: Path, *lines: str, name: str = "track.csv") -> str:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def xyz(time_s: float, offset_m: float) -> str:
    x, y, z = (TRUTH_M + np.array([offset_m, 0.0, 0.0])).tolist()
    return f"{time_s},{x},{y},{z}"


def test_a_point_is_known_at_all_times() -> None:
    position, known = read_truth(TRUTH_TEXT).at([0.0, 1.0, 1e9])
    np.testing.assert_array_equal(position, np.broadcast_to(TRUTH_M, (3, 3)))
    assert known.all()


def test_a_track_is_interpolated_between_near_samples_only(tmp_path: Path) -> None:
    path = track(tmp_path, HEADING, xyz(100.0, 0.0), xyz(102.0, 8.0), xyz(105.0, 20.0))
    position, known = read_truth(path).at([99.9, 100.0, 101.0, 101.75, 102.0, 103.0, 105.0, 105.1])
    assert known.tolist() == [False, True, True, True, True, False, True, False]
    np.testing.assert_allclose(position[known][:, 0] - TRUTH_M[0], [0.0, 4.0, 7.0, 8.0, 20.0], atol=1e-9)
    assert np.isnan(position[~known]).all()


def test_a_geodetic_track_has_weeks_and_degrees(tmp_path: Path) -> None:
    latitude, longitude, height = (float(v) for v in geodetic(TRUTH_M))
    place = f"{float(np.degrees(latitude))},{float(np.degrees(longitude))},{height}"
    path = tmp_path / "track.csv.gz"
    path.write_bytes(
        gzip.compress(f"# comment\nweek,sow,lat,lon,h\n2111,10.000,{place}\n2111,11.000,{place}\n".encode())
    )
    truth = read_truth(str(path))
    np.testing.assert_array_equal(truth.time_gps_s, 2111 * 604_800 + np.array([10.0, 11.0]))
    np.testing.assert_allclose(truth.position_m, np.stack([TRUTH_M, TRUTH_M]), atol=1e-6)


def test_a_single_sample_is_known_at_its_time(tmp_path: Path) -> None:
    _, known = read_truth(track(tmp_path, HEADING, xyz(100.0, 0.0))).at([99.0, 100.0, 101.0])
    assert known.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("3582.1048991, 532.5901966, 5232.7552961", "kilometres"),
        ("55.49, 8.45, 59.5", "latitude, longitude"),
        ("1e7, 1e7, 1e7", "Earth-fixed X, Y, Z"),
        ("1, 2", "neither X,Y,Z"),
        ("1, 2, nan", "neither X,Y,Z"),
        ("1, 2, three", "neither X,Y,Z"),
        ("", "neither X,Y,Z"),
        ("nowhere.csv", "no such file"),
        ("no\0where.csv", "cannot be the name of a file"),
    ],
)
def test_other_texts_are_refused(text: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        read_truth(text)


@pytest.mark.parametrize(
    ("lines", "rule"),
    [
        ([HEADING], "no samples"),
        (["# nothing"], "no samples"),
        ([HEADING, "1,2,3"], "line 2: 4 columns"),
        ([HEADING, "1,2,3,x"], "line 2: the z_m 'x'"),
        ([HEADING, "1,3582,532,5232"], "line 2: .*kilometres"),
        ([HEADING, xyz(2.0, 0.0), xyz(1.0, 0.0)], "line 3: its time"),
        ([HEADING, xyz(2.0, 0.0), xyz(2.0, 0.0)], "line 3: its time"),
        (["a,b,c,d", "1,2,3,4"], "line 1: a track has"),
        (["1,2,3,4"], "line 1: a track has"),
        (["2111,10,95,8,0"], "line 1: the latitude 95"),
        (["2111,700000,55,8,0"], "line 1: the seconds of week"),
        (["2111.5,10,55,8,0"], "line 1: the GPS week 2111.5"),
        (["2111,10,55,8,1e6"], "line 1: the height"),
        (["2111,10,55,8,0", "2111,11,55,8,inf"], "line 2: the height 'inf'"),
    ],
)
def test_damaged_tracks_name_file_and_line(lines: list[str], rule: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rule) as caught:
        read_truth(track(tmp_path, *lines))
    assert "track.csv" in str(caught.value)


def test_a_damaged_gzip_file_is_refused(tmp_path: Path) -> None:
    whole = gzip.compress("\n".join([HEADING, xyz(1.0, 0.0)]).encode())
    for count, content in enumerate((whole[:-12], whole[:15] + b"\xff\xff" + whole[17:])):
        path = tmp_path / f"{count}.csv.gz"
        path.write_bytes(content)
        with pytest.raises(InputError, match="cut short or damaged"):
            read_truth(str(path))
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="not a text file"):
        read_truth(str(path))


@settings(deadline=None, max_examples=200)
@given(st.text(max_size=40))
def test_no_text_gives_anything_but_a_truth_or_a_sentence(text: str) -> None:
    sentence = "."
    try:
        read_truth(text)
    except InputError as error:
        sentence = str(error)
    assert sentence.endswith((".", "?"))
