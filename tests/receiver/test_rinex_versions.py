"""RINEX 2.11 and 4 give what RINEX 3 gives, digit for digit, and say in a sentence what is not read of them."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import hatanaka
import numpy as np
import pytest
from receiver_files import TRUTH_TEXT, Sky, navigation_text, observation_text, write_pair
from rinex_versions import navigation_2, navigation_4, observations_2, observations_4

from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverData, read_receiver_series, read_rinex, read_truth

ESBC = "ESBC00DNK_R_20201770000_01D_30S_GC.rnx.gz", "ESBC00DNK_R_20201770000_01D_GC_nav.rnx.gz"
GPS = ("G",)


def require_same(one: ReceiverData, other: ReceiverData, *notes: str) -> None:
    """The same numbers, and these notes about the first."""
    assert (one.notes, other.notes) == (notes, ())
    for field in fields(ReceiverData):
        if field.name == "notes":
            continue
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


@pytest.fixture(scope="module")
def texts(made_sky: Sky) -> tuple[str, str]:
    return observation_text(made_sky), navigation_text(made_sky.orbits)


@pytest.fixture(scope="module")
def real_texts(data_folder: Path) -> tuple[str, str]:
    """Five epochs of the real day, at its third hour."""
    observations, navigation = (gzip.decompress((data_folder / name).read_bytes()).decode() for name in ESBC)
    head, *epochs = observations.split("\n>")
    return "\n>".join([head, *epochs[360:365]]) + "\n", navigation


@pytest.mark.parametrize("packed", [False, True])
def test_rinex_2_is_rinex_3_of_gps(packed: bool, texts: tuple[str, str], tmp_path: Path) -> None:
    expected = read_rinex(*write_pair(tmp_path, *texts), systems=GPS)
    paths = write_pair(tmp_path, observations_2(texts[0]), navigation_2(texts[1]))
    if packed:
        paths[0].write_bytes(gzip.compress(hatanaka.rnx2crx(paths[0].read_bytes())))
    require_same(read_rinex(*paths, systems=GPS), expected)


def test_rinex_4_is_rinex_3(texts: tuple[str, str], tmp_path: Path) -> None:
    expected = read_rinex(*write_pair(tmp_path, *texts))
    require_same(read_rinex(*write_pair(tmp_path, observations_4(texts[0]), navigation_4(texts[1]))), expected)


def test_the_two_files_may_be_of_different_versions(texts: tuple[str, str], tmp_path: Path) -> None:
    expected = read_rinex(*write_pair(tmp_path, *texts), systems=GPS)
    pair = write_pair(tmp_path, observations_2(texts[0]), navigation_4(texts[1]))
    require_same(read_rinex(*pair, systems=GPS), expected)


def test_a_real_day_gives_the_same_positions_in_every_version(real_texts: tuple[str, str], tmp_path: Path) -> None:
    truth = read_truth(TRUTH_TEXT)
    written = {
        "2": (observations_2(real_texts[0]), navigation_2(real_texts[1]), GPS),
        "3": (*real_texts, ("G", "C")),
        "4": (observations_4(real_texts[0]), navigation_4(real_texts[1]), ("G", "C")),
    }
    series = {}
    for version, (observations, navigation, systems) in written.items():
        paths = write_pair(tmp_path, observations, navigation)
        series[version] = read_receiver_series(*paths, truth, systems=systems)
        series[f"{version} G"] = read_receiver_series(*paths, truth, systems=GPS)
    assert len(series["3"].geometry) == 5
    assert series["3"].geometry.satellite_count.min() > 15
    for one, other in (("4", "3"), ("2 G", "3 G"), ("4 G", "3 G")):
        assert series[one].notes == series[other].notes
        assert series[one].geometry.names == series[other].geometry.names
        np.testing.assert_array_equal(series[one].errors_m, series[other].errors_m)
        np.testing.assert_array_equal(series[one].geometry.design, series[other].geometry.design)


def test_a_file_without_c_a_code_is_read_from_its_p_code(texts: tuple[str, str], tmp_path: Path) -> None:
    expected = read_rinex(*write_pair(tmp_path, *texts), systems=GPS)
    text = observations_2(texts[0], types=("P1", "P2", "L1", "L2"))
    note = "GPS is read from P1; made.obs has no C1C of it."
    require_same(read_rinex(*write_pair(tmp_path, text, texts[1]), systems=GPS), expected, note)


def test_satellites_without_a_letter_are_of_gps(texts: tuple[str, str], tmp_path: Path) -> None:
    expected = read_rinex(*write_pair(tmp_path, *texts), systems=GPS)
    lines = observations_2(texts[0]).replace("M (MIXED)", "G (GPS)  ", 1).split("\n")
    text = "\n".join(
        line[:32] + line[32:].replace("G", " ") if "R07" in line or "E11" in line else line for line in lines
    )
    assert " 05" in text
    require_same(read_rinex(*write_pair(tmp_path, text, texts[1]), systems=GPS), expected)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda t: t.replace("    C1", "    C5"), "no pseudorange of GPS L1 C/A; it has L1, L2, C5"),
        (lambda t: t.replace("     7    L1", "     8    L1"), "declares 8 codes but supplies 7"),
        (lambda t: "\n".join(line for line in t.split("\n") if "TYPES OF" not in line), "lists no # / TYPES"),
        (lambda t: t.replace("     GPS  ", "     GLO  "), "its times are UTC .*needed; convert it"),
    ],
)
def test_damaged_observations_of_rinex_2(
    change: Callable[[str], str], rule: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    text = observations_2(texts[0])
    paths = write_pair(tmp_path, change(text), texts[1])
    assert change(text) != text
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths, systems=GPS)
    assert "made.obs" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "missing", "told"),
    [
        (lambda t: t.replace("COMMENT", "# / TYPES OF OBSERV"), 0, r"the event \(flag 4\) of line 25"),
        (lambda t: t[: len(t) * 2 // 3], 14, r"line 27 \(2020-06-25 12:00:30; it has fewer lines than its 9"),
        (lambda t: t[: t.rindex("\n 20")] + "\n 20  6\n", 14, "line 27 .*it has more lines than its 9"),
        (lambda t: t.replace(" 12  0  0.0000000", " 12  0 61.0000000"), 7, "the epoch of line 6 .2020-06-25 12:00:61"),
        (lambda t: t.replace(" 20  6 25", " 20 13 25", 1), 7, "the epoch of line 6 .2020-13-25"),
        (lambda t: t.replace("R07", "G06", 1), 1, "G06 of the epoch of line 6 .*2 times, with other values"),
        (lambda t: t.replace("R07", "R00", 1), 0, r"line 13 \(R00, 2020-06-25 12:00:00\)"),
        (lambda t: t.replace("E11", "G99", 1), 0, r"line 23 \(G99, 2020"),
        (lambda t: twice(t, 7), 7, "line 6 .*it has more lines than its 9 satellites need"),
        (lambda t: "\n".join(t.split("\n")[:7] + t.split("\n")[8:]), 7, "line 6 .*it has fewer lines"),
        (lambda t: changed(t, 7, 34, "x"), 1, r"line 7 \(G02, 2020-06-25 12:00:00\)"),
        (lambda t: changed(t, 7, 8, "x"), 0, ""),
        (lambda t: changed(t, 8, 8, "x"), 0, ""),
    ],
)
def test_one_bad_line_of_rinex_2_costs_a_satellite_or_an_epoch(
    change: Callable[[str], str], missing: int, told: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    text = observations_2(texts[0])
    assert change(text) != text
    sound = read_rinex(*write_pair(tmp_path, text, texts[1]), systems=GPS)
    found = read_rinex(*write_pair(tmp_path, change(text), texts[1]), systems=GPS)
    assert np.isfinite(found.pseudorange_m).sum() == np.isfinite(sound.pseudorange_m).sum() - missing
    assert np.isfinite(found.satellite_clock_m).sum() == np.isfinite(found.pseudorange_m).sum()
    if told:
        assert any(re.search(told, note) for note in found.notes), found.notes
    else:
        assert found.notes == ()


def twice(text: str, number: int) -> str:
    """A line twice."""
    lines = text.split("\n")
    return "\n".join([*lines[:number], *lines[number - 1 :]])


def changed(text: str, number: int, column: int, character: str) -> str:
    """Another character in a line."""
    lines = text.split("\n")
    line = lines[number - 1]
    lines[number - 1] = f"{line[: column - 1]}{character}{line[column:]}"
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("write", "change", "told"),
    [
        (navigation_2, lambda t: t[:-100], "the record of 24 at line 189"),
        (navigation_2, lambda t: t.replace(" 1 20  6", " 1 20 13", 1), "the record of 1 at line 5"),
        (navigation_2, lambda t: t.replace(" 1 20  6", "99 20  6", 1), "the record of G99 .*no such satellite"),
        (navigation_2, lambda t: t.replace(" 1 20  6", " 1 21  6", 1), "86400 s off its time of clock"),
        (navigation_4, lambda t: t.replace("> EPH G02 LNAV", "> EPH G03 LNAV"), "the record of G03 at line 33"),
        (navigation_4, lambda t: t.replace("> EPH G02 LNAV", "> EPHG02 LNAV"), "the record of G02 at line 33"),
    ],
)
def test_one_bad_record_of_other_versions_costs_that_record(
    write: Callable[[str], str], change: Callable[[str], str], told: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    text = write(texts[1])
    assert change(text) != text
    found = read_rinex(*write_pair(tmp_path, texts[0], change(text)), systems=GPS)
    assert len(found.notes) == 1
    assert told.split()[0] in found.notes[0]
    assert re.search(told, found.notes[0]), found.notes


@pytest.mark.parametrize(
    ("write", "change", "rule"),
    [
        (navigation_2, lambda t: t.replace("ION ALPHA", "COMMENT  "), "no ionosphere coefficients"),
        (navigation_4, lambda t: t.replace("> ION G10 LNAV", "> ION E10 IFNV"), "no ionosphere coefficients"),
        (navigation_4, lambda t: t.replace("LNAV", "CNAV"), "no ephemeris of GPS that can be used"),
    ],
)
def test_damaged_navigation(
    write: Callable[[str], str], change: Callable[[str], str], rule: str, texts: tuple[str, str], tmp_path: Path
) -> None:
    text = write(texts[1])
    paths = write_pair(tmp_path, texts[0], change(text))
    assert change(text) != text
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths, systems=GPS)
    assert "made.nav" in str(caught.value)


def test_beidou_is_not_read_from_rinex_2(texts: tuple[str, str], tmp_path: Path) -> None:
    paths = write_pair(tmp_path, observations_2(texts[0]), texts[1])
    with pytest.raises(InputError, match=r"it has no BeiDou \(C\); .*choose the systems G"):
        read_rinex(*paths, systems=("G", "C"))
    assert "GPS alone is used" in read_rinex(*paths).notes[0]
    paths = write_pair(tmp_path, texts[0], navigation_2(texts[1]))
    with pytest.raises(InputError, match=r"made.nav: it has no ephemeris of BeiDou .*choose the systems G"):
        read_rinex(*paths, systems=("G", "C"))
    assert "GPS alone is used" in read_rinex(*paths).notes[0]
