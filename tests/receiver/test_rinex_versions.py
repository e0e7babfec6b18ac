"""RINEX 2.11 and 4 give what RINEX 3 gives, digit for digit, and say in a sentence what is not read of them."""

from __future__ import annotations

import gzip
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


def require_same(one: ReceiverData, other: ReceiverData) -> None:
    for field in fields(ReceiverData):
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
    require_same(read_rinex(*write_pair(tmp_path, text, texts[1]), systems=GPS), expected)


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
        (lambda t: t.replace("    C1", "    C5"), "no C1 or P1 pseudoranges; it has L1, L2, C5"),
        (lambda t: t.replace("     7    L1", "     8    L1"), "promises 8 observation types and lists 7"),
        (lambda t: "\n".join(line for line in t.split("\n") if "TYPES OF" not in line), "lists no # / TYPES"),
        (lambda t: t.replace("COMMENT", "# / TYPES OF OBSERV"), "changes in the middle of the file"),
        (lambda t: t[: len(t) * 2 // 3], "cut short|not a number with three decimals"),
        (lambda t: t[: t.rindex("\n 20")] + "\n 20  6\n", "no flag and number of satellites"),
        (lambda t: t.replace("     GPS  ", "     GLO  "), "its times are GLO"),
        (lambda t: t.replace(" 12  0  0.0000000", " 12  0 61.0000000"), "is no date and time"),
        (lambda t: t.replace(" 20  6 25", " 20 13 25", 1), "is no date and time"),
        (lambda t: t.replace("R07", t[t.index("R07") - 3 : t.index("R07")], 1), "twice in one epoch"),
        (lambda t: t.replace("R07", "R7 ", 1), "'R7 ' is no satellite's name"),
        (lambda t: t.replace("E11", "G99", 1), "'G99' is no satellite that exists"),
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
    ("write", "change", "rule"),
    [
        (navigation_2, lambda t: t[:-100], "cut short|not a number of 19"),
        (navigation_2, lambda t: t.replace(" 1 20  6", " 1 20 13", 1), "no date and time that exists"),
        (navigation_2, lambda t: t.replace(" 1 20  6", "99 20  6", 1), "no satellite that exists"),
        (navigation_2, lambda t: t.replace(" 1 20  6", " 1 21  6", 1), "apart; one of them is damaged"),
        (navigation_2, lambda t: t.replace("ION ALPHA", "COMMENT  "), "lacks the GPS ionosphere.*ION ALPHA"),
        (navigation_4, lambda t: t.replace("> ION G10 LNAV", "> ION E10 IFNV"), "lacks the GPS .* ION G.. LNAV"),
        (navigation_4, lambda t: t.replace("> EPH G02 LNAV", "> EPH G03 LNAV"), "begins with another name"),
        (navigation_4, lambda t: t.replace("> EPH G02 LNAV", "> EPHG02 LNAV"), "no start of a navigation record"),
        (navigation_4, lambda t: t.replace("LNAV", "CNAV"), "no ephemeris of GPS; its systems: G CNAV"),
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
    with pytest.raises(InputError, match=r"RINEX 2.11, of which GPS alone is read, not BeiDou; choose"):
        read_rinex(*paths)
    paths = write_pair(tmp_path, texts[0], navigation_2(texts[1]))
    with pytest.raises(InputError, match=r"made.nav: this is RINEX 2.11, of which GPS alone is read"):
        read_rinex(*paths)
