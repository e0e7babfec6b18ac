"""Files that cannot be used: one sentence each, whatever the damage, and never a crash or a hang."""

from __future__ import annotations

import gzip
import time
from collections.abc import Callable
from pathlib import Path

import hatanaka
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from receiver_files import navigation_text, observation_text, orbits, simulate, write_pair

from pl_mc.input_errors import InputError
from pl_mc.receiver import rinex
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


def without_line(text: str, containing: str) -> str:
    return "\n".join(line for line in text.split("\n") if containing not in line)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda t: "", "the file is empty"),
        (lambda t: " \n", "the file is empty"),
        (lambda t: "week,sow\n1,2\n", "not a RINEX file"),
        (lambda t: t.replace("3.04", "2.11", 1), "this is RINEX 2.11, of which GPS alone is read, not BeiDou"),
        (lambda t: t.replace("3.04", "1.00", 1), "this is RINEX 1.00, and RINEX 2, 3 or 4"),
        (lambda t: t.replace("3.04", "5.00", 1), "this is RINEX 5.00, and RINEX 2, 3 or 4"),
        (lambda t: t.replace("3.04", "    ", 1), "names no RINEX version"),
        (lambda t: without_line(t, "END OF HEADER"), "no END OF HEADER"),
        (lambda t: without_line(t, "OBS TYPES"), "lists no SYS"),
        (lambda t: t.replace("OBSERVATION DATA", "METEOROLOGY DATA", 1), "this is a RINEX meteorological file"),
        (lambda t: t.replace("OBSERVATION DATA", f"{'X':16}", 1), "a RINEX file of type"),
        (lambda t: t[: t.index(">")], "no epochs"),
        (lambda t: t.replace("C1C S1C", "C1W S1W"), "no C1C pseudoranges of GPS; it has C1W, S1W"),
        (lambda t: without_line(t, "C    2 C2I"), "it has no BeiDou"),
        (lambda t: t[:-30], "cut short"),
        (lambda t: t[:-300], "cut short"),
        (lambda t: t[: t.rindex("\n>") + 20], "epoch line has no flag|cannot be read"),
        (lambda t: without_line(t, "C06"), "the epoch of line [0-9]+ lacks 1 of its satellites"),
        (lambda t: t.replace("12 00 30.0", "11 59 30.0"), "does not come after"),
        (lambda t: t.replace("12 00 30.0", "12 00 00.0"), "does not come after"),
        (lambda t: t.replace("12 00 30.0", "12 00 3x.0"), "cannot be read"),
        (lambda t: t.replace("\nG05", "\nG02"), "G02 appears twice in one epoch"),
        (lambda t: t + "G01 stray\n", "belongs to no epoch"),
        (lambda t: t.replace("G05", "G\0005", 1), "binary data"),
    ],
)
def test_damaged_observation_files(change: Callable[[str], str], rule: str, tmp_path: Path) -> None:
    text = change(OBSERVATIONS)
    if text == OBSERVATIONS:
        pytest.fail("the change changes nothing")
    paths = write_pair(tmp_path, text, NAVIGATION)
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths)
    assert "made.obs" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda t: "", "the file is empty"),
        (lambda t: t.replace("3.04", "2.10", 1), "this is RINEX 2.10"),
        (lambda t: t[: t.index("G01")], "no ephemeris of GPS; its systems: none"),
        (lambda t: t[: t.index("C19")], "no ephemeris of BeiDou; its systems: GPS"),
        (lambda t: t[:-200], "has 5 lines, and 8 are needed; the file is cut short"),
        (lambda t: t.replace("5.153650000000e+03", "5.15365000x000e+03", 1), "line 7: '5.15365000x000e[+]03'"),
        (lambda t: t.replace("5.153650000000e+03", "               nan", 1), "is not a number"),
        (lambda t: t.replace("G01 2020", "G01 2o20", 1), "no start of a navigation record"),
        (lambda t: t.replace("END OF HEADER\n", "END OF HEADER\n    1.0\n"), "belongs to no record"),
        (lambda t: without_line(without_line(t, "GPSA"), "GPSB"), "ionosphere coefficients"),
    ],
)
def test_damaged_navigation_files(change: Callable[[str], str], rule: str, tmp_path: Path) -> None:
    paths = write_pair(tmp_path, OBSERVATIONS, change(NAVIGATION))
    with pytest.raises(InputError, match=rule) as caught:
        read_rinex(*paths)
    assert "made.nav" in str(caught.value)


def test_exchanged_files_are_named(tmp_path: Path) -> None:
    observations, navigation = write_pair(tmp_path, OBSERVATIONS, NAVIGATION)
    assert "a RINEX navigation file, and the observation file" in refused((navigation, observations))
    assert "a RINEX observation file, and the navigation file" in refused((observations, observations))


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
        (b"BZh91AY&SY", ".bz2 files are not read"),
        (b"\x1f\x9d\x90", ".Z files are not read"),
    ):
        path.write_bytes(content)
        assert rule in refused((path, navigation))


def test_a_navigation_file_of_another_day_names_both_days(tmp_path: Path) -> None:
    paths = write_pair(tmp_path, OBSERVATIONS, navigation_text(orbits(), days=3))
    sentence = refused(paths)
    assert "2020-06-25" in sentence
    assert "2020-06-28" in sentence


@pytest.mark.parametrize("systems", [(), ("G", "G"), ("E",), ("G", "R")])
def test_systems_that_are_not_read(systems: tuple[str, ...], tmp_path: Path) -> None:
    assert "systems" in refused(write_pair(tmp_path, OBSERVATIONS, NAVIGATION), systems=systems)


def test_a_system_that_the_file_lacks_is_answered_with_those_it_has(tmp_path: Path) -> None:
    paths = write_pair(tmp_path, observation_text(SKY, names="G"), NAVIGATION)
    assert "it has no BeiDou (C); its systems are G (GPS)" in refused(paths)
    read_rinex(*paths, systems=("G",))


@pytest.mark.parametrize(
    ("program", "rule"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "cannot evaluate them"),
        ("raise ValueError('no')", "ValueError: no"),
        ("import sys; sys.stderr.write('gone'); sys.exit(3)", "pyrtklib cannot be loaded here (gone)"),
        ("import time; time.sleep(60)", "given up after"),
    ],
)
def test_a_library_that_breaks_down_is_a_sentence(
    program: str, rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "program.py").write_text(program, encoding="ascii")
    monkeypatch.setattr(rinex.worker, "__file__", str(tmp_path / "program.py"))
    monkeypatch.setattr(rinex, "_START_LIMIT_S", 2.0)
    start = time.monotonic()
    assert rule in refused(write_pair(tmp_path, OBSERVATIONS, NAVIGATION))
    assert time.monotonic() - start < 20


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
