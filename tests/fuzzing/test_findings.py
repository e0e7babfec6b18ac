"""What the study of damaged files and strange arguments found, one case each: refused or told, and never again."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import subjects as kinds

import pl_mc
from pl_mc import methods
from pl_mc.error_models import error_model
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import build_experiment
from pl_mc.faults import parse_fault
from pl_mc.geometry.flight import fly, survey_plan
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.noise_models.gauss_markov import GaussMarkov
from pl_mc.report.run_folder import read_run_folder


def read(name: str, change: Callable[[str], str], folder: Path) -> kinds.Read:
    """A file of that kind, changed, as its reader takes it."""
    subject = kinds.subjects()[name]
    sound = subject.content.decode("latin-1")
    changed = change(sound)
    assert changed != sound, "the change changes nothing"
    path = folder / f"damaged{subject.suffix}"
    path.write_bytes(changed.encode("latin-1"))
    return subject.read(path)


def without_line(text: str, pattern: str, which: int = 0) -> str:
    lines = text.split("\n")
    found = [k for k, line in enumerate(lines) if re.search(pattern, line)]
    return "\n".join(lines[: found[which]] + lines[found[which] + 1 :])


def twice(text: str, pattern: str) -> str:
    lines = text.split("\n")
    at = next(k for k, line in enumerate(lines) if re.search(pattern, line))
    return "\n".join([*lines[: at + 1], *lines[at:]])


def swapped(text: str, one: str, other: str) -> str:
    lines = text.split("\n")
    j, k = (next(k for k, line in enumerate(lines) if re.search(pattern, line)) for pattern in (one, other))
    lines[j], lines[k] = lines[k], lines[j]
    return "\n".join(lines)


def clock_and(text: str, line: str) -> str:
    """The empty line of the second epoch's clock and a satellite's line of the third have changed places."""
    lines = text.split("\n")
    clock = lines.index("", lines.index("") + 1)
    satellite = lines.index(line)
    lines[clock], lines[satellite] = lines[satellite], lines[clock]
    return "\n".join(lines)


OBS_3, OBS_2, NAV_3, NAV_4 = (
    "RINEX 3 observations",
    "RINEX 2.11 observations",
    "RINEX 3 navigation",
    "RINEX 4 navigation",
)
COMPACT = "Hatanaka observations"
HEALTH = r"^     2\.0{12}e\+00 0\.0{12}e\+00-9\.3"


SKY = pl_mc.simulate(epochs=1)[0]


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        (OBS_3, lambda t: t.replace("G    2 C1C S1C", "G    3 C1C S1C"), "declares 3 codes but supplies 2"),
        # Compact files: letters for digits, a satellite's differences for those of the clock, lines of the header.
        (COMPACT, lambda t: t.replace("115751 0", "x15751 0"), "no line of Hatanaka compression"),
        (COMPACT, lambda t: t.replace("115751 0", "\u00ea15751 0"), "no line of Hatanaka compression"),
        (COMPACT, lambda t: re.sub(r"^(>.{30})0...", r"\g<1>40 0", t, count=1, flags=re.M), "Hatanaka compression"),
        (COMPACT, lambda t: clock_and(t, "72367 0"), 'CRINEX clock delta "72367 0" is not an integer'),
        (COMPACT, lambda t: t.replace("-13067609 0", "-1306760P 0"), "cannot be undone"),
        (COMPACT, lambda t: swapped(t, "APPROX", "^115751 0"), "no line of Hatanaka compression"),
        (COMPACT, lambda t: t[: t.rindex("\n", 0, -1)] + "\n", "cannot be undone"),
        # Messages without health, and coefficients without a head.
        (NAV_3, lambda t: re.sub(HEALTH, f"     2.000000000000e+00{'':19}-9.3", t, flags=re.M), "missing health field"),
        (NAV_4, lambda t: t.replace("> ION G10 LNAV\n", ""), "no ionosphere coefficients"),
        # Almanacs that contradict themselves.
        ("SEM almanac", lambda t: t.replace(" 2.826563", " .826563"), "line 53: a number with digits before its point"),
        ("YUMA almanac", lambda t: t.replace("PRN-05", "PRN-06"), "the heading says week 63 and PRN 6"),
        ("YUMA almanac", lambda t: t[: t.rindex("63")] + "6", "the heading says week 63"),
        ("YUMA almanac", lambda t: t.replace("63", "3", 2), "days apart"),
        ("YUMA almanac", lambda t: re.sub(r"Mean Anom\(rad\)", "Mean Anom(r", t, count=1), "unit in"),
        ("YUMA almanac", lambda t: re.sub(r"(at Week\(rad\):).*", r"\1 00", t), "on both sides of its point"),
        ("YUMA almanac", lambda t: re.sub(r"(Anom\(rad\): +)\d", r"\1", t, count=1), "on both sides of its point"),
        ("YUMA almanac", lambda t: re.sub(r"ID: +05", "ID: 1_0", t), "a number is needed"),
        ("SEM almanac", lambda t: t.replace("\n0\n11\n\n", "\n\n11\n0\n", 1), "eight lines of 1, 1, 1, 3, 3, 3, 1"),
        ("SEM almanac", lambda t: t.replace("\n0\n11\n", "\n0 11\n", 1), "eight lines of 1, 1, 1, 3, 3, 3, 1"),
        ("SEM almanac", lambda t: t.replace("405504\n", "40550", 1), "line 3: a blank line is needed above the record"),
        # Tracks that are cut in a number, jump, or hold figures beyond all bounds.
        ("track, geodetic", lambda t: t[:-4], "cut short in its last line, 13"),
        ("track, Earth-fixed", lambda t: t.replace("532590.1966", "1000", 1), "jumps by 531.59 km within 1 s"),
        ("track, Earth-fixed", lambda t: t.replace("532590.1966", "1e308", 1), "km from the Earth's centre"),
        ("track, Earth-fixed", lambda t: t.replace("1277121600.0", "-1", 1), "outside GPS weeks 0 to 9999"),
        ("track, Earth-fixed", lambda t: t.replace("1277121600.0", "0", 1), "line 3: its time is 14782 days after"),
        ("track, geodetic", lambda t: t.replace("60.125", "6_0.125", 1), "'6_0.125' is not a finite number"),
        # Experiments.
        ("experiment, service", lambda t: t.replace("600.0", "inf"), "duration_s: a finite number is needed"),
        ("experiment, service", lambda t: t.replace("600.0", "1e308"), "duration_s: a number of at most"),
        ("experiment, service", lambda t: t.replace("300.0", "1e-320"), "step_s: .* at most 20,000 are possible"),
        ("experiment, service", lambda t: t.replace("title", "Ftitle"), "Ftitle: there is no such field .*title"),
        ("experiment, sweep", lambda t: t.replace("k1 = 3.0", "k1 = nan"), "methods.1.k1: a finite number"),
        ("experiment, sweep", lambda t: t.replace("epochs = 4", "epochs = 99999999999"), "at most 1000000"),
    ],
)  # fmt: skip
def test_what_was_taken_for_data_is_refused(
    name: str, change: Callable[[str], str], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=sentence):
        read(name, change, tmp_path)


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        # Values of RINEX 2 after a line too many or too few were taken for an event.
        (OBS_2, lambda t: twice(t, r" 7 +1\.230 +1\.230"), "it has more lines than its 9 satellites need"),
        (OBS_2, lambda t: without_line(t, r"^ 20  6 25", 1), "lines? .*of no epoch|more lines than its"),
        (OBS_2, lambda t: swapped(t, r"\d{8}\.\d{3} 7", r"^ {9}1\.230 {11}1\.230$"), "is like that|cannot be read"),
        (OBS_2, lambda t: swapped(t, r"^something", r"22799358\.782"), r"cannot be read: line \d+ \(G12"),
        # Columns that have moved, and digits that are none.
        (OBS_3, lambda t: re.sub(r"\n(G\d\d)  (\d)", r"\n\1 \2", t, count=1), ": line 9"),
        (OBS_3, lambda t: re.sub(r"(\d{8})\.(\d{3})", r"\1-\2", t, count=1), "cannot be read: line 9"),
        (OBS_3, lambda t: re.sub(r"(\d{8})\.(\d{3})", r"\1    ", t, count=1), ": line 9"),
        (OBS_3, lambda t: re.sub(r"\n(G\d\d .*)", r"\n\1          1.000", t, count=1), ""),
        (OBS_3, lambda t: re.sub(r"(45\.00)0", r"\1x", t, count=1), ""),
        (OBS_3, lambda t: re.sub(r"\nG\d\d .*", "\nG02  0", t, count=1), ": line 9"),
        # A cut within the words of an event, and within a difference.
        (OBS_2, lambda t: t[: t.index("something") + 32], "the file is cut short in it"),
        (OBS_2, lambda t: t[: t.index("COMMENT\n 20  6 25") + 3], "the file is cut short in it"),
        (COMPACT, lambda t: t.rstrip("\n")[:-3], "the file is cut short in it"),
        # Satellites and systems that were skipped in silence.
        (OBS_3, lambda t: re.sub(r"\nG\d\d", "\nG77", t, count=1), r"line 9 \(G77"),
        (OBS_3, lambda t: re.sub(r"\nG(\d)", r"\nE\1", t, count=1), r"line 9 \(E02"),
        (OBS_3, lambda t: re.sub(r"\nG(\d)", r"\n?\1", t, count=1), r"line 9 \(\?02"),
        # Times in columns that have moved, or that are none.
        (OBS_3, lambda t: t.replace("  2020     6    25", "  2020  58042    25", 1), "the header's TIME OF FIRST OBS"),
        (OBS_3, lambda t: t.replace("  2020     6    25", "  0     6    25", 1), "TIME OF FIRST OBS"),
        (OBS_3, lambda t: t.replace("0.0000000  0 20", "0.0000000  2020 20", 1), "line 8"),
        (OBS_3, lambda t: t.replace("> 2020 06 25", "> 2020 06 31", 1), r"the epoch of line 8 \(2020-06-31"),
        (OBS_3, lambda t: t.replace("0.0000000  0 20", "0.0000000  9 20", 1), "line 8 and the 20 lines below"),
        # Numbers of an orbit that no satellite can send, or that have lost a digit.
        (NAV_3, lambda t: t.replace(" 4.500000000000e-09", " 1.700000000000e+00", 1), "its delta_n is 1.7"),
        (NAV_3, lambda t: re.sub(r"e-09(\d|-| )", r"e-0\1", t, count=1), "G01 .*at line 5"),
        (NAV_3, lambda t: re.sub(r"(C\d\d 2020 06 )25", r"\g<1>26", t, count=1), "86400 s off its time of clock"),
        (NAV_3, lambda t: re.sub(r"-09\n", r"-07?[mY\n", t, count=1), "G01 .*at line 5"),
        (NAV_3, lambda t: re.sub(r"\nC19", "\nC99", t, count=1), "the record of C99 .*no such satellite"),
    ],
)  # fmt: skip
def test_what_was_taken_for_data_is_told(name: str, change: Callable[[str], str], told: str, tmp_path: Path) -> None:
    found = read(name, change, tmp_path)
    if told:
        assert any(re.search(told, note) for note in found.notes), found.notes
    else:
        subject = kinds.subjects()[name]
        (tmp_path / "sound").write_bytes(subject.content)
        assert found == subject.read(tmp_path / "sound")


def test_an_orbit_elsewhere_is_told(tmp_path: Path) -> None:
    """A satellite whose damaged orbit lies below the horizon was left out without a word."""
    moved = read(NAV_3, lambda t: re.sub(r"(G05 .*\n.{61}).{19}", r"\1 3.000000000000e+00", t), tmp_path)
    sound = kinds.subjects()[NAV_3]
    path = tmp_path / "sound.rnx"
    path.write_bytes(sound.content)
    assert any(key.endswith("G05") for key in sound.read(path).numbers)
    assert not any(key.endswith("G05") for key in moved.numbers)
    assert any("G05 (3 epochs): left out below the mask" in note for note in moved.notes)


def test_a_header_position_beyond_all_bounds_is_none(tmp_path: Path) -> None:
    sound = kinds.subjects()[OBS_2].content.decode().split("APPROX")[0].splitlines()[-1].split()[2]
    found = read(OBS_2, lambda t: t.replace(sound, "-1e308".rjust(len(sound)), 1), tmp_path)
    assert found.notes == ("Left out of damaged.20o, as it cannot be read: the header's APPROX POSITION XYZ.",)


def test_a_table_that_is_a_link_to_itself_is_refused(tmp_path: Path) -> None:
    shutil.copytree(kinds.ROOT / "results" / "ramp", tmp_path / "ramp")
    table = tmp_path / "ramp" / "rates.csv"
    table.unlink()
    table.symlink_to(table)
    with pytest.raises(InputError, match=r"rates\.csv.*: (it is a link|the file cannot be read)"):
        read_run_folder(tmp_path / "ramp")


def test_a_kind_that_is_no_word_is_refused() -> None:
    with pytest.raises(InputError, match="kind: "):
        build_experiment({"kind": ["sweep"]}, source="mine")


def test_numbers_that_are_none_are_named_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = kinds.subjects()["experiment, sweep"].content.decode()
    path.write_text(text.replace("stop_m = 100.0", "stop_m = nan"))
    line = text.split("\n").index("stop_m = 100.0") + 1
    assert ("faults.stop_m", line) in [(one.field, one.line) for one in check_experiment(str(path)).problems]


G = pl_mc.simulate(site="CUT0", epochs=2)
ROWS: dict[str, Any] = {
    "design": G.design, "sigma_m": G.sigma_m, "in_view": G.in_view, "clocks": G.clocks,
    "names": [f"G{k:02d}" for k in range(G.design.shape[1])], "systems": ["G"] * G.design.shape[1],
}  # fmt: skip


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: pl_mc.simulate(almanac=b"x"), "almanac: the path"),
        (lambda: pl_mc.simulate(almanac="a\0b"), "cannot be the name of an almanac"),
        (lambda: pl_mc.simulate(almanac="."), "no regular file"),
        (lambda: pl_mc.simulate(constellations=7), "constellations: a sequence of names is needed, not 7"),
        (lambda: pl_mc.simulate(constellations=np.array(7)), "constellations: a sequence of names"),
        (lambda: pl_mc.simulate(without=2), "without: a sequence of names"),
        (lambda: pl_mc.simulate(visible=[[1.0], [2.0, 3.0]]), "visible: True or False"),
        (lambda: pl_mc.simulate(epochs=10**30), "epochs: .* too many for one series"),
        (lambda: pl_mc.simulate(interval_s=1e308), "interval_s: .* at most"),
        (lambda: pl_mc.simulate(interval_s=10**400), "interval_s: a finite number is needed"),
        (
            lambda: pl_mc.statistics.fault_effects(SKY, pl_mc.no_fault(SKY), "GPS"),
            "quantities: those of pl_mc.statistics.ls_quantities are needed, not 'GPS'",
        ),
        (lambda: pl_mc.simulate(start=np.ones((2, 2))), r"start: array\(\[\[1., 1.\], .* is not a date"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS | {"names": object()}), "names: a sequence of names"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS | {"clocks": 5e-324}), "clocks: a sequence of names"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS, epoch=np.nan), "epoch: 2 different whole numbers"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS, epoch={}), "epoch: it cannot be read as an array"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS, time_gps_s="x"), "time_gps_s: it cannot be read"),
        (lambda: pl_mc.Geometry.from_rows(**ROWS, time_gps_s=[1.0]), "time_gps_s: one time per epoch"),
        (lambda: G[False], "an epoch is chosen by a whole number"),
        (lambda: fly(survey_plan(), epochs=-1), "epochs: a whole number (of at least|from) 1"),
        (lambda: fly(survey_plan(), epochs=np.int64(3), interval_s=1e308), "flight: it can last up to"),
        (lambda: fly(survey_plan(), epochs=5, interval_s=np.nan), "interval_s: a finite number"),
        (lambda: pl_mc.AlertLimits("x", "float16", 40.0), "alert.vertical_m: an alert limit is positive"),
        (lambda: pl_mc.biases(G[0], len), "biases: a table by satellite such as"),
        (lambda: pl_mc.ramps(G[0], satellites=5.0, start_m=0, stop_m=1, step_m=1), "satellites: a sequence"),
        (lambda: pl_mc.ramp(G[0], satellite=np.zeros(0), start_m=0, stop_m=1, step_m=1), "is not in view"),
        (lambda: pl_mc.ramp(G[0], satellite="G01", start_m=0, stop_m=1e308, step_m=5), "more than 1000000 steps"),
        (lambda: pl_mc.ramp(G[0], satellite="G01", start_m=0, stop_m=10**400, step_m=5), "a finite number"),
        (lambda: pl_mc.statistics.joint_exceedance(1, 3, 0, "x", 0), "slope: it cannot be read as an array"),
        (lambda: pl_mc.statistics.joint_exceedance(1, 3, 0, 1, None), "shift: it cannot be read as an array"),
        (lambda: pl_mc.reliability(G[0], p_fa="x"), "p_fa: a finite number is needed"),
        (lambda: pl_mc.reliability(G[0], p_fa=5e-324), "p_fa: 5e-324 is too small"),
        (lambda: pl_mc.exact.ls_rates(G[0], [np.nan]), "faults: use ramp, biases or no_fault to make faults"),
        (lambda: pl_mc.exact.ls_rates(G[0], pl_mc.no_fault(G[0]), alert=7), "alert: alert limits such as"),
        (lambda: parse_fault(b"G01"), "is no fault; the form is"),
        (lambda: parse_fault("G01:1_0m"), "'G01:1_0m' is no fault; the form is"),
        (lambda: methods.method(np.zeros((2, 2))), r"is unknown"),
        (lambda: error_model(np.zeros(0)), "is unknown"),
        (lambda: gps_seconds(np.ones((2, 2))), "is not a date"),
        (lambda: fly(survey_plan(), epochs=np.ones((3, 3))), "epochs: a whole number (of at least|from) 1"),
        (lambda: pl_mc.receiver.read_truth(7), "truth: X,Y,Z or the path of a track is needed"),
    ],
)  # fmt: skip
def test_arguments_that_broke_something_are_refused(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_correlation_time_in_single_precision() -> None:
    """Its comparison with what only doubles hold was a warning."""
    assert GaussMarkov(np.float32(1.5)).tau_s == 1.5
