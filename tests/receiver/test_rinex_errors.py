"""Files that cannot be used: one sentence each, whatever the damage, and never a crash or a hang."""

from __future__ import annotations

import bz2
import gzip
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import hatanaka
import numpy as np
import pytest
import sidereon
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from receiver_files import navigation_text, observation_text, orbits, simulate, write_pair

from pl_mc.input_errors import InputError
from pl_mc.receiver.rinex import read_rinex

SKY = simulate(seconds=(0.0, 30.0))
OBSERVATIONS, NAVIGATION = observation_text(SKY), navigation_text(orbits())


def refused(paths: tuple[Path, Path], **options: object) -> str:
    """The sentence of the refusal."""
    with pytest.raises(InputError) as caught:
        read_rinex(*paths, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith((".", "?"))
    assert "Traceback" not in sentence
    return sentence


def doubled(text: str, name: str) -> str:
    """The first line of a satellite twice, and counted."""
    lines = text.split("\n")
    at = next(k for k, line in enumerate(lines) if line.startswith(name))
    return "\n".join([*lines[: at + 1], *lines[at:]]).replace(" 0 20\nG02", " 0 21\nG02", 1)


def moved(text: str, label: str, name: str) -> str:
    """A line stands before that of a satellite in the last epoch."""
    lines = text.split("\n")
    line = lines.pop(next(k for k, one in enumerate(lines) if label in one))
    at = max(k for k, one in enumerate(lines) if one.startswith(name))
    return "\n".join([*lines[:at], line, *lines[at:]])


def field(text: str, name: str, row: int, column: int, value: str) -> str:
    """A navigation file with another number in the record of a satellite."""
    lines = text.split("\n")
    at = row + next(k for k, line in enumerate(lines) if line.startswith(f"{name} "))
    begin = 4 + 19 * column
    lines[at] = f"{lines[at][:begin]}{value:>19}{lines[at][begin + 19 :]}"
    return "\n".join(lines)


def without_line(text: str, containing: str) -> str:
    return "\n".join(line for line in text.split("\n") if containing not in line)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda t: "", "the file is empty"),
        (lambda t: " \n", "the file is empty"),
        (lambda t: "week,sow\n1,2\n", "not a RINEX file"),
        (lambda t: t.replace("3.04", "2.11", 1), "does not say which columns the values have"),
        (lambda t: t.replace("3.04", "1.00", 1), "this is RINEX 1.00, and RINEX 2, 3 or 4"),
        (lambda t: t.replace("3.04", "5.00", 1), "this is RINEX 5.00, and RINEX 2, 3 or 4"),
        (lambda t: t.replace("3.04", "    ", 1), "names no RINEX version"),
        (lambda t: without_line(t, "END OF HEADER"), "no END OF HEADER"),
        (lambda t: without_line(t, "OBS TYPES"), "lists no SYS"),
        (lambda t: t.replace("C1C S1C", "C1C    "), "does not say which columns .*declares 2 codes but supplies 1"),
        (lambda t: t.replace("OBSERVATION DATA", "METEOROLOGY DATA", 1), "this is a RINEX meteorological file"),
        (lambda t: t.replace("OBSERVATION DATA", f"{'X':16}", 1), "a RINEX file of type"),
        (lambda t: t[: t.index(">")], "no epochs"),
        (
            lambda t: t.replace("C1C S1C", "C5Q S5Q"),
            "no pseudorange of GPS L1 C/A; it has C5Q, S5Q; choose the systems C",
        ),
        (lambda t: t.replace("2C2I", "2C6I").replace("C2I S2I", "C6I S6I"), "no pseudorange of BeiDou B1I"),
        (lambda t: t.replace("     GPS  ", "     GLO  "), "its times are UTC"),
        (lambda t: "\0" * 400, "binary data"),
    ],
)
def test_damaged_observation_files(change: Callable[[str], str], rule: str, tmp_path: Path) -> None:
    text = change(OBSERVATIONS)
    if text == OBSERVATIONS:
        pytest.fail("the change changes nothing")
    paths = write_pair(tmp_path, text, NAVIGATION)
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths, systems=("G", "C"))
    assert "made.obs" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "epochs", "missing", "told"),
    [
        (lambda t: t[:-30], 2, 1, r"line 49 \(the file is cut short in it\)"),
        (lambda t: t[:-300], 2, 9, r"the epoch of line 29 \(2020-06-25 12:00:30; 9 of its 20 lines are missing\)"),
        (lambda t: t[: t.rindex("\n>") + 20], 1, 20, "the epoch of line 29 .*no flag and count"),
        (lambda t: without_line(t, "C28"), 2, 2, "line 8 .*1 of its 20 lines are missing"),
        (lambda t: t.replace("12 00 30.0", "12 00 3x.0"), 1, 20, r"the epoch of line 29 \(2020 06 25 12 00 3x"),
        (lambda t: t.replace("12 00 30.0", "12 00 60.0"), 1, 20, "the epoch of line 29"),
        (lambda t: t.replace("\nG05", "\nG02"), 2, 4, "G02 of the epoch of line 8 .*2 times, with other values"),
        (lambda t: doubled(t, "G05"), 2, 0, "G05 of the epoch of line 8 .*2 times, alike"),
        (lambda t: t + "G01 stray\n", 2, 0, r"line 50 \(of no epoch\)"),
        (lambda t: t.replace("G05", "G\0005", 1), 2, 1, r"line 10 \(G\?5, 2020-06-25 12:00:00\)"),
        (lambda t: t.replace("G05", "G33", 1), 2, 1, r"line 10 \(G33, 2020"),
        (lambda t: t.replace("G05", "R00", 1), 2, 1, r"line 10 \(R00, 2020-06-25 12:00:00\)"),
        (lambda t: t.replace("G05", "R05", 1), 2, 1, r"line 10 \(R05, 2020-06-25 12:00:00\)"),
        (lambda t: t.replace("45.000", "4x.000", 1), 2, 0, ""),
        (lambda t: t.replace(" 0 20\nG02 ", " 0 19\nG02 ", 1), 2, 1, r"line 28 \(of no epoch\)"),
        (lambda t: t.replace("  0 20\nG02", "  x 20\nG02", 1), 1, 20, "line 8 and the 20 lines below"),
        (lambda t: re.sub(r"(\nG05.{10})\.\d{3}", r"\1    ", t, count=1), 2, 1, r"like that: line 10 \(G05, .*'\d{8}'"),
        (
            lambda t: moved(t, "END OF HEADER", ">"),
            1,
            20,
            r"line 7 \(in the header, without a label\); line 8 \(in the header",
        ),
        (lambda t: without_line(t, "TIME OF FIRST"), 2, 0, "does not say of which system its times are"),
        (lambda t: t.replace("  2020     6", "  2o20     6", 1), 2, 0, "the header's TIME OF FIRST OBS"),
        (lambda t: t.replace("APPROX", "??????", 1), 2, 0, ""),
    ],
)
def test_one_bad_line_costs_that_line(
    change: Callable[[str], str], epochs: int, missing: int, told: str, tmp_path: Path
) -> None:
    text = change(OBSERVATIONS)
    assert text != OBSERVATIONS
    sound = read_rinex(*write_pair(tmp_path, OBSERVATIONS, NAVIGATION))
    found = read_rinex(*write_pair(tmp_path, text, NAVIGATION))
    assert len(found.time_gps_s) == epochs
    assert np.isfinite(found.pseudorange_m).sum() == np.isfinite(sound.pseudorange_m).sum() - missing
    for column, name in enumerate(found.names):
        rows = np.searchsorted(sound.time_gps_s, found.time_gps_s)
        theirs = sound.pseudorange_m[rows, sound.names.index(name)]
        kept = np.isfinite(found.pseudorange_m[:, column])
        np.testing.assert_array_equal(found.pseudorange_m[kept, column], theirs[kept])
    if told:
        assert any(re.search(told, note) for note in found.notes), found.notes
    else:
        assert found.notes == ()


def test_systems_that_the_header_does_not_list_are_told(tmp_path: Path) -> None:
    found = read_rinex(*write_pair(tmp_path, without_line(OBSERVATIONS, "C    2 C2I"), NAVIGATION))
    assert set(found.systems) == {"G"}
    assert "line 15 (C22, 2020-06-25 12:00:00); line 16" in found.notes[0]
    assert "and 18 more" in found.notes[0]
    assert found.notes[1:] == (
        "GPS alone is used: made.obs has no BeiDou (C) and no Galileo (E); its systems are G (GPS).",
    )


@pytest.mark.parametrize("systems", [None, ("G", "C")])
@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda t: "", "the file is empty"),
        (lambda t: t[: t.index("G01")], "no ephemeris of GPS that can be used; its systems: none"),
        (lambda t: without_line(without_line(t, "GPSA"), "GPSB"), "no ionosphere coefficients .*--ionosphere none"),
        (lambda t: without_line(t, "GPSA"), "no ionosphere coefficients .*further navigation file"),
        (lambda t: t.replace(" 4.6566E-09", " 4.6566E-01"), "no ionosphere coefficients"),
    ],
)
def test_damaged_navigation_files(
    change: Callable[[str], str], rule: str, systems: tuple[str, ...] | None, tmp_path: Path
) -> None:
    assert change(NAVIGATION) != NAVIGATION
    paths = write_pair(tmp_path, OBSERVATIONS, change(NAVIGATION))
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths, systems=systems)
    assert "made.nav" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "lost", "told"),
    [
        (lambda t: t[:-200], "C03", "the record of C03 at line 421 .truncated"),
        (
            lambda t: field(t, "G05", 2, 3, "5.15365000x000e+03"),
            "G05",
            "the record of G05 at line 37 .'5.15365000x000e.03' at line 39",
        ),
        (lambda t: field(t, "G05", 2, 3, "nan"), "G05", "the record of G05 at line 37"),
        (lambda t: field(t, "G05", 2, 3, "3.000000000000e+03"), "G05", "12:00:00 at line 37 .its sqrt_a is 3000"),
        (lambda t: field(t, "G05", 2, 1, "9.000000000000e-01"), "G05", "its e is 0.9, and no message can say other"),
        (lambda t: field(t, "G05", 6, 2, "1.000000000000e-06"), "G05", "its TGD is 1e-06 s"),
        (lambda t: field(t, "G05", 6, 2, ""), "G05", "its TGD is missing"),
        (lambda t: field(t, "G05", 6, 1, "1.500000000000e+00"), "G05", "its health is 1.5"),
        (lambda t: field(t, "G05", 6, 1, "-1.00000000000e+00"), "G05", "its health is -1"),
        (lambda t: field(t, "G05", 5, 2, "2.112000000000e+03"), "G05", "its week is 2112, not 2111"),
        (lambda t: field(t, "C22", 5, 2, "7.560000000000e+02"), "C22", "its week is 756, not 755"),
        (lambda t: field(t, "G05", 3, 0, "3.889000000000e+05"), "G05", "is 100 s off its time of clock"),
        (lambda t: field(t, "C22", 3, 0, "3.888140000000e+05"), "C22", "is 14 s off its time of clock"),
        (lambda t: t.replace("G05 2020 06 25", "G05 2020 06 26"), "G05", "is 86400 s off its time of clock"),
        (lambda t: t.replace("G05 2020 06 25", "G05 2020 06 31"), "G05", "at line 37"),
        (lambda t: t.replace("\nG05 2020", "\nG33 2020"), "G05", "the record of G33 .*there is no such satellite"),
        (lambda t: t.replace("\nC22 2020", "\nC64 2020"), "C22", "the record of C64 .*there is no such satellite"),
        (lambda t: t.replace("\nG05 2020", "\nX05 2020"), "G05", "the record of X05 at line 37"),
        (lambda t: t.replace("G05 2020", "    2020"), "G05", "is followed by lines beyond its layout"),
    ],
)
def test_one_bad_record_costs_that_record(change: Callable[[str], str], lost: str, told: str, tmp_path: Path) -> None:
    assert change(NAVIGATION) != NAVIGATION
    sound = read_rinex(*write_pair(tmp_path, OBSERVATIONS, NAVIGATION))
    found = read_rinex(*write_pair(tmp_path, OBSERVATIONS, change(NAVIGATION)))
    assert len(found.notes) == 1
    assert re.search(told, found.notes[0]), found.notes
    assert found.names == sound.names
    others = [k for k, name in enumerate(sound.names) if name != lost]
    np.testing.assert_array_equal(found.satellite_position_m[:, others], sound.satellite_position_m[:, others])
    if lost in sound.names:
        assert found.no_ephemeris[:, found.names.index(lost)].all()


@pytest.mark.parametrize(
    ("name", "week"), [("G05", 63.0), ("G05", 2111.0 - 1024), ("C22", 2111.0), ("C22", 63.0), ("C22", 755.0)]
)
def test_weeks_are_resolved_by_the_date(name: str, week: float, tmp_path: Path) -> None:
    sound = read_rinex(*write_pair(tmp_path, OBSERVATIONS, NAVIGATION))
    text = field(NAVIGATION, name, 5, 2, f"{week:.12e}")
    found = read_rinex(*write_pair(tmp_path, OBSERVATIONS, text))
    assert found.notes == ()
    np.testing.assert_array_equal(found.satellite_position_m, sound.satellite_position_m)


@pytest.mark.parametrize(
    ("name", "accuracy_m", "used"),
    [
        ("G05", 2.0, True), ("G05", 0.0, True), ("G05", 6144.0, True), ("G05", 6144.1, False), ("G05", 8192.0, False),
        ("G05", 32767.0, False), ("G05", -1.0, False), ("C22", 4096.0, True), ("C22", 6144.0, False),
        ("C22", 8192.0, False), ("C22", -2.0, False),
    ],
)  # fmt: skip
def test_satellites_without_a_predicted_accuracy_are_left_out(
    name: str, accuracy_m: float, used: bool, tmp_path: Path
) -> None:
    text = field(NAVIGATION, name, 6, 0, f"{accuracy_m:.12e}")
    found = read_rinex(*write_pair(tmp_path, OBSERVATIONS, text))
    column = found.names.index(name)
    assert np.isfinite(found.satellite_clock_m[:, column]).all() == used
    assert found.unpredicted[:, column].all() != used
    assert found.unpredicted.any() != used
    assert not found.unhealthy.any()


def test_exchanged_files_are_named(tmp_path: Path) -> None:
    observations, navigation = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    assert "a RINEX navigation file, and the observation file" in refused((navigation, observations))
    assert "a RINEX observation file, and the navigation file" in refused((observations, observations))


@pytest.mark.parametrize(
    ("arguments", "options", "rule"),
    [
        ((7, "x"), {}, "observation: the path of a file is needed, not 7"),
        (("obs", 7), {}, "navigation: the path of a file is needed, not 7"),
        (("obs", [7]), {}, "navigation: the path of a file is needed, not 7"),
        (("obs", "x"), {"systems": 7}, "systems: a sequence of RINEX letters is needed, not 7"),
        (("obs", "x"), {"systems": (7,)}, "systems: 7 is not read"),
        (("obs", "x"), {"ionosphere": 7}, "ionosphere: 7 is unknown"),
    ],
)
def test_strange_arguments_are_a_sentence(
    arguments: tuple, options: dict, rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "obs").write_text(OBSERVATIONS)
    with pytest.raises(InputError, match=rule):
        read_rinex(*arguments, **options)


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    observations, navigation = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    assert "there is no such file" in refused((tmp_path / "other.obs", navigation))
    assert "cannot be read" in refused((observations, tmp_path))
    assert "cannot be the name of a file" in refused((Path("a\0b"), navigation))


def test_truncated_compression_is_named(tmp_path: Path) -> None:
    _, navigation = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    compact = hatanaka.rnx2crx(OBSERVATIONS.encode())
    path = tmp_path / "cut"
    for content, rule in (
        (gzip.compress(OBSERVATIONS.encode())[:-40], "gzip file is cut short"),
        (gzip.compress(b""), "the file is empty"),
        (compact[: len(compact) * 2 // 3], "Hatanaka compression cannot be undone"),
        (gzip.compress(compact[: len(compact) * 2 // 3]), "Hatanaka compression cannot be undone"),
        (bz2.compress(OBSERVATIONS.encode())[:-20], "bzip2 file is cut short"),
        (b"\x1f\x9d\x90\xff\xff\xff", ".Z file is cut short"),
        (b"PK\x03\x04 and no more", "zip file is cut short"),
    ):
        path.write_bytes(content)
        assert rule in refused((path, navigation))


def test_a_navigation_file_of_another_day_names_both_days(tmp_path: Path) -> None:
    paths = write_pair(tmp_path, OBSERVATIONS, navigation_text(orbits(), days=3))
    sentence = refused(paths)
    assert "the observations are of 2020-06-25, but the ephemerides are of 2020-06-28;" in sentence


def test_the_same_day_is_not_named_twice(tmp_path: Path) -> None:
    late = [replace(orbit, toe=orbit.toe + 4 * 3600) for orbit in orbits()]
    sentence = refused(write_pair(tmp_path, OBSERVATIONS, navigation_text(late)))
    assert "of 2020-06-25 12:00:00 to 2020-06-25 12:00:30, but the ephemerides are of 2020-06-25 16:00:00" in sentence
    assert "a navigation file of that time is needed" in sentence


@pytest.mark.parametrize("systems", [(), ("G", "G"), ("E",), ("G", "R")])
def test_systems_that_are_not_read(systems: tuple[str, ...], tmp_path: Path) -> None:
    assert "systems" in refused(write_pair(tmp_path, OBSERVATIONS, NAVIGATION), systems=systems)


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        (("GC",), "'GC' is not read .*they are separated by commas: G,C"),
        ("G,C", "',' is not read from receiver files"),
        (("G;C",), "separated by commas: G,C"),
    ],
)
def test_systems_in_one_word_are_answered_with_the_right_form(
    given: tuple[str, ...], rule: str, tmp_path: Path
) -> None:
    assert re.search(rule, refused(write_pair(tmp_path, OBSERVATIONS, NAVIGATION), systems=given))


def test_a_system_that_the_file_lacks_is_answered_with_those_it_has(tmp_path: Path) -> None:
    paths = write_pair(tmp_path, observation_text(SKY, names="G"), NAVIGATION)
    sentence = refused(paths, systems=("G", "C"))
    assert "it has no BeiDou (C); its systems are G (GPS); choose the systems G." in sentence
    assert read_rinex(*paths, systems=("G",)).notes == ()
    found = read_rinex(*paths)
    assert found.notes == (
        "GPS alone is used: made.obs has no BeiDou (C) and no Galileo (E); its systems are G (GPS).",
    )
    paths = write_pair(tmp_path, OBSERVATIONS, NAVIGATION[: NAVIGATION.index("C19")])
    assert "no ephemeris of BeiDou that can be used; its systems: GPS; choose the systems G." in refused(
        paths, systems=("G", "C")
    )
    assert "GPS alone is used: made.nav has no ephemeris of BeiDou" in read_rinex(*paths).notes[0]


@pytest.mark.parametrize("error", [BaseException("panicked"), RuntimeError("no"), RecursionError("deep")])
def test_a_library_that_breaks_down_is_a_sentence(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A panic of compiled code is no `Exception`."""

    def broken(text: str) -> None:
        raise error

    paths = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    for name in ("parse_rinex_obs", "parse_rinex_nav_lenient"):
        with monkeypatch.context() as patch:
            patch.setattr(sidereon, name, broken)
            assert str(error) in refused(paths)


def test_an_interruption_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(text: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sidereon, "parse_rinex_obs", stopped)
    with pytest.raises(KeyboardInterrupt):
        read_rinex(*write_pair(tmp_path, OBSERVATIONS, NAVIGATION))


MUTATIONS = st.lists(
    st.tuples(st.sampled_from("odrcx"), st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=4
)


def mutated(content: bytes, mutations: list[tuple[str, float, int]]) -> bytes:
    """Bytes overwritten, deleted, repeated, cut off or exchanged for a digit."""
    for kind, place, value in mutations:
        at = int(place * len(content))
        before, after = content[:at], content[at:]
        if kind == "o":
            content = before + bytes([value]) + after[1:]
        elif kind == "d":
            content = before + after[1 + value :]
        elif kind == "r":
            content = before + after[: 1 + value] + after
        elif kind == "c":
            content = before
        else:
            content = before + b"%d" % (value % 10) + after[1:]
    return content


@pytest.mark.parametrize("which", ["observations", "navigation"])
@settings(deadline=None, max_examples=10, derandomize=True, suppress_health_check=list(HealthCheck))
@given(mutations=MUTATIONS)
def test_mutated_files_give_data_or_a_sentence(which: str, tmp_path: Path, mutations: list) -> None:
    paths = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    path = paths[which == "navigation"]
    path.write_bytes(mutated(path.read_bytes(), mutations))
    epochs, sentence = 1, ""
    try:
        epochs = len(read_rinex(*paths).time_gps_s)
    except InputError as error:
        sentence = str(error)
    assert "\n" not in sentence
    assert epochs in (1, 2)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(content=st.binary(max_size=400))
def test_garbage_is_a_sentence(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage"
    path.write_bytes(content)
    refused((path, path))
