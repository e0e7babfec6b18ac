"""Real files with what real files have: repeated epochs, events, no ionosphere, a truth that is another, and so on.

Two epochs each of a permanent station (RINEX 3, four systems; RINEX 2, GPS), and what editors, converters, splices
and moves make of them.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverSeries, read_receiver_series, read_rinex, read_truth
from pl_mc.receiver.navigation_records import read_navigation

FILES = Path(__file__).parent / "files"
OBS, NAV = ((FILES / name).read_text() for name in ("mixed_3.obs", "mixed_3.nav"))
OBS_2, NAV_2 = ((FILES / name).read_text() for name in ("gps_2.05o", "gps_2.05n"))
TRUTH = "4075580.8863,931853.5784,4801567.9707"
TRUTH_2 = "-3976219.5082,3382372.5671,3652512.9849"
NO_GALILEO = (
    "GPS and BeiDou alone are used: made.nav has no ephemeris of Galileo that can be used; its systems: BeiDou, GPS."
)
WANTING = "G08 (2 epochs), G18 (2 epochs), G27 (2 epochs): left out for want of a usable ephemeris."
EVENT = ">                              4  1"
NEW_SITE = "  4075680.8863   931853.5784  4801567.9707                  APPROX POSITION XYZ"

Change = Callable[[str], str]


@pytest.fixture(autouse=True)
def no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def read(folder: Path, obs: str = OBS, nav: str = NAV, truth: str = TRUTH, **options: object) -> ReceiverSeries:
    paths = folder / "made.obs", folder / "made.nav"
    for path, text in zip(paths, (obs, nav), strict=True):
        path.write_bytes(text.encode("utf-8"))
    return read_receiver_series(*paths, read_truth(truth), **options)


def fixes_m(series: ReceiverSeries) -> np.ndarray:
    """East, north, up of the weighted least-squares solution of each epoch [m]."""
    g, found = series.geometry, []
    for epoch, rows in enumerate(g.in_view):
        design = g.design[epoch][rows] / g.sigma_m[epoch][rows][:, None]
        errors = series.errors_m[epoch][rows] / g.sigma_m[epoch][rows]
        found.append(np.linalg.lstsq(design, errors, rcond=None)[0][:3])
    return np.array(found)


def before_second(text: str, *lines: str) -> str:
    """Lines before the second epoch; of RINEX 2 too."""
    at = list(re.finditer(r"^(> 2020|> +2020| 05  4  2)", text, flags=re.M))[1].start()
    return text[:at] + "".join(f"{line}\n" for line in lines) + text[at:]


def first_epoch(text: str) -> str:
    """The lines of the first epoch."""
    found = list(re.finditer(r"^(> 2020|> +2020| 05  4  2)", text, flags=re.M))
    return text[found[0].start() : found[1].start()].rstrip("\n")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> ReceiverSeries:
    return read(tmp_path_factory.mktemp("sound"))


def test_the_sound_pairs(sound: ReceiverSeries, tmp_path: Path) -> None:
    assert sound.notes == (NO_GALILEO, WANTING)
    assert sound.geometry.satellite_count.tolist() == [13, 13]
    np.testing.assert_allclose(np.abs(fixes_m(sound)).max(axis=0), [0.451, 2.432, 0.392], atol=6e-4)
    old = read(tmp_path, OBS_2, NAV_2, TRUTH_2, systems=("G",))
    assert old.notes == ()
    np.testing.assert_allclose(np.abs(fixes_m(old)).max(axis=0), [0.882, 0.171, 0.456], atol=6e-4)


@pytest.mark.parametrize(
    "change",
    [
        lambda t: "\ufeff" + t,
        lambda t: "\n" + t,
        lambda t: "  \n\n" + t,
        lambda t: t + "\n\n   \n",
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t.replace("\n", "\r"),
        lambda t: before_second(t, "", "   "),
        lambda t: t.replace("\nE01", "\n\nE01", 1),
        lambda t: before_second(t, EVENT, f"{'SPLICED':60}COMMENT"),
        lambda t: before_second(t, ">                              5  0"),
        lambda t: before_second(t, EVENT, f"{'MARKER':60}MARKER NAME"),
        lambda t: before_second(t, EVENT, next(x for x in t.split("\n") if "APPROX" in x)),
        lambda t: before_second(t, EVENT, f"{'G    2 C1C L1C':60}SYS / # / OBS TYPES"),
        lambda t: before_second(t, EVENT, f"{'E    1 C5Q':60}SYS / # / OBS TYPES"),
        lambda t: re.sub(r"(\nE\d\d).{14}", r"\1              ", t),
        lambda t: re.sub(r"(\nG\d\d.{16}).*", r"\1   12x456789.123", t),
        lambda t: t.replace("END OF HEADER", f"SOMETHING THAT NOBODY KNOWS\n{'':60}END OF HEADER", 1),
        lambda t: t.replace("R    2 C1C L1C", "R    9 C1C L1C", 1),
    ],
)  # fmt: skip
def test_what_is_harmless_changes_nothing(change: Change, sound: ReceiverSeries, tmp_path: Path) -> None:
    changed = change(OBS)
    assert changed != OBS
    found = read(tmp_path, changed, systems=("G", "C"))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert found.notes == (WANTING,)


@pytest.mark.parametrize("change", [lambda t: "\ufeff" + t, lambda t: "\n" + t, lambda t: t.rstrip("\n") + "\n\n \n"])
def test_what_is_harmless_in_navigation(change: Change, sound: ReceiverSeries, tmp_path: Path) -> None:
    found = read(tmp_path, nav=change(NAV))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert found.notes == sound.notes


def test_repeated_header_lines_of_a_splice_are_harmless_in_rinex_2(tmp_path: Path) -> None:
    types = next(line for line in OBS_2.split("\n") if "TYPES OF OBSERV" in line)
    expected = read(tmp_path, OBS_2, NAV_2, TRUTH_2, systems=("G",))
    found = read(tmp_path, before_second(OBS_2, f"{'':28}4  1", types), NAV_2, TRUTH_2, systems=("G",))
    np.testing.assert_array_equal(found.errors_m, expected.errors_m)
    assert found.notes == ()


def test_columns_that_really_change_are_followed(sound: ReceiverSeries, tmp_path: Path) -> None:
    types = f"{'G    2 L1C C1C':60}SYS / # / OBS TYPES"
    at = before_second(OBS, "@@@").index("@@@")
    second = re.sub(r"^(G\d\d)(.{14})..(.{14}).*$", r"\1\3  \2", OBS[at:], flags=re.M)
    found = read(tmp_path, OBS[:at] + f"{EVENT}\n{types}\n" + second)
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert found.notes == sound.notes
    gone = read(tmp_path, before_second(OBS, EVENT, types.replace("C1C", "C5Q")))
    assert "From line 51 of made.obs on it has no C1C of GPS." in gone.notes


@pytest.mark.parametrize("version", [2, 3])
def test_repeated_epochs_that_agree_are_left_out_and_counted(
    version: int, sound: ReceiverSeries, tmp_path: Path
) -> None:
    obs, nav, truth, systems = (OBS, NAV, TRUTH, ("G", "C")) if version == 3 else (OBS_2, NAV_2, TRUTH_2, ("G",))
    expected = read(tmp_path, obs, nav, truth, systems=systems)
    repeated = before_second(obs, *[first_epoch(obs)] * 2)
    found = read(tmp_path, repeated, nav, truth, systems=systems)
    np.testing.assert_array_equal(found.errors_m, expected.errors_m)
    (note,) = set(found.notes) - set(expected.notes)
    assert note.startswith("2 epochs of made.obs left out as repeated, with the same pseudoranges: line ")
    other = re.sub(r"(\d{8})\.\d{3}", r"\1.999", first_epoch(obs))
    found = read(tmp_path, before_second(obs, other), nav, truth, systems=systems)
    np.testing.assert_array_equal(found.errors_m, expected.errors_m)
    (note,) = set(found.notes) - set(expected.notes)
    assert "1 epoch of made.obs left out as repeated, with other pseudoranges than the first time" in note


def test_systems_written_one_after_the_other_are_one_epoch(sound: ReceiverSeries, tmp_path: Path) -> None:
    lines = first_epoch(OBS).split("\n")
    parts = [[line for line in lines if line[0] in letters] for letters in ("CE", "GR")]
    epochs = [f"{lines[0][:32]}{len(part):3d}\n" + "\n".join(part) for part in parts]
    found = read(tmp_path, OBS.replace(first_epoch(OBS), "\n".join(epochs)))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert found.notes == sound.notes


def test_an_epoch_out_of_order_is_left_out(sound: ReceiverSeries, tmp_path: Path) -> None:
    third = first_epoch(OBS).replace("2020 06 25 00 00 00", "2020 06 25 00 01 00", 1)
    odd = first_epoch(OBS).replace("2020 06 25 00 00 00", "2020 06 24 00 00 00", 1)
    found = read(tmp_path, OBS + third + "\n" + odd + "\n")
    assert len(found.geometry) == 3
    assert any("1 epoch of made.obs left out as out of the order of time: line " in note for note in found.notes)


@pytest.mark.parametrize(
    ("event", "told"),
    [
        (["> 2020  6 25  0  0 15.0000000  2  0"], r"line 51 \(2020-06-25 00:00:15\): the antenna begins to move\."),
        ([">                              2  0"], r"line 51 \(2020-06-25 00:00:00\): the antenna begins to move\."),
        (
            ["> 2020  6 25  0  0 30.0000000  3  2", f"{'OTHER':60}MARKER NAME", NEW_SITE],
            r"line 51 \(2020-06-25 00:00:30\): a new site, MARKER NAME becomes OTHER, APPROX POSITION XYZ becomes 4",
        ),
        ([">                              3  1", f"{'MARKER':60}MARKER NAME"], r"line 51 .*: a new site\."),
        ([EVENT, NEW_SITE], r"line 51 .*: APPROX POSITION XYZ becomes 4075680"),
        (
            [EVENT, f"{'        1.5000        0.0000        0.0':60}ANTENNA: DELTA H/E/N"],
            "line 51 .*: ANTENNA: DELTA H/E/N becomes 1.5000",
        ),
        ([EVENT, f"{'0          OTHER':60}ANT # / TYPE"], r"line 51 .*: ANT # / TYPE becomes 0 OTHER\."),
    ],
)  # fmt: skip
def test_events_that_move_the_antenna_are_told(
    event: list[str], told: str, sound: ReceiverSeries, tmp_path: Path
) -> None:
    found = read(tmp_path, before_second(OBS, *event))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert re.search(f"^The antenna or the site changes within the observation file: {told}", found.notes[0])
    assert "split the file there, or give a track" in found.notes[0]
    track = tmp_path / "track.csv"
    rows = [f"{time},{TRUTH}" for time in sound.geometry.time_gps_s.tolist()]
    track.write_text("\n".join(["time_gps_s,x_m,y_m,z_m", *rows, ""]))
    assert read(tmp_path, before_second(OBS, *event), truth=str(track)).notes == sound.notes


def test_events_of_rinex_2_are_told(tmp_path: Path) -> None:
    moved = "-3976119.5082  3382372.5671  3652512.9849"
    found = read(
        tmp_path, before_second(OBS_2, f"{'':28}4  1", f"{moved:60}APPROX POSITION XYZ"), NAV_2, TRUTH_2, systems=("G",)
    )
    assert re.search(r"line \d+ \(2005-04-02 00:00:00\): APPROX POSITION XYZ becomes -3976119.5082", found.notes[0])


def test_only_what_is_there_of_the_default_systems(tmp_path: Path) -> None:
    count = len(re.findall(r"^G", first_epoch(OBS), flags=re.M))
    gps = re.sub(r"(\.0000000  0) 35", rf"\1{count:3d}", re.sub(r"(?<=\n)[CER][ \d].*\n", "", OBS))
    found = read(tmp_path, gps)
    assert found.geometry.clocks == ("G",)
    alone = "GPS alone is used: made.obs has no BeiDou (C) and no Galileo (E); its systems are G (GPS)."
    assert found.notes[0] == alone
    with pytest.raises(InputError, match=r"it has no BeiDou \(C\); its systems are G \(GPS\); choose the systems G\."):
        read(tmp_path, gps, systems=("G", "C"))
    old = read(tmp_path, OBS_2, NAV_2, TRUTH_2)
    assert old.notes == (alone,)
    np.testing.assert_allclose(np.abs(fixes_m(old)).max(axis=0), [0.882, 0.171, 0.456], atol=6e-4)


@pytest.mark.parametrize(
    ("codes", "version", "told"),
    [
        ("C2X L2X", "3.04", "BeiDou is read from C2X; made.obs has no C2I of it."),
        ("C2Q L2Q", "3.05", "BeiDou is read from C2Q; made.obs has no C2I of it."),
        ("C1X L1X", "3.02", "BeiDou is read from C1X; made.obs has no C2I of it."),
        ("C1Q L1Q", "3.02", "BeiDou is read from C1Q; made.obs has no C2I of it."),
        ("C1I L1I", "3.02", ""),
        ("C1I L1I", "3.04", ""),
    ],
)
def test_other_tracking_modes_of_b1(codes: str, version: str, told: str, sound: ReceiverSeries, tmp_path: Path) -> None:
    found = read(tmp_path, OBS.replace("C2I L2I", codes).replace("3.04", version, 1))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert found.notes == ((told, NO_GALILEO, WANTING) if told else (NO_GALILEO, WANTING))


def test_b1c_is_not_taken_for_b1i(tmp_path: Path) -> None:
    """The same name means another carrier in versions that know B1C."""
    found = read(tmp_path, OBS.replace("C2I L2I", "C1X L1X"))
    assert found.notes[0] == "GPS alone is used: made.obs holds no pseudorange of BeiDou B1I; it has C1X, L1X."


@pytest.mark.parametrize("code", ["C1P", "C1W", "C1X"])
def test_other_tracking_modes_of_l1(code: str, sound: ReceiverSeries, tmp_path: Path) -> None:
    found = read(tmp_path, OBS.replace("G    2 C1C", f"G    2 {code}"))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert f"GPS is read from {code}; made.obs has no C1C of it." in found.notes


def test_a_code_that_is_listed_and_never_there_is_not_read(sound: ReceiverSeries, tmp_path: Path) -> None:
    text = re.sub(r"^(C\d\d)(.+)$", r"\1                \2", OBS, flags=re.M)
    found = read(tmp_path, text.replace("C    2 C2I L2I", "C    3 C2I C2X L2I"))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)


WITHOUT = re.sub(r".*IONOSPHERIC CORR.*\n", "", NAV)
BDS = (
    "BDSA   1.1176E-08  2.9802E-08 -4.1723E-07  6.5565E-07       IONOSPHERIC CORR\n"
    "BDSB   1.1059E+05 -3.2768E+04 -2.2938E+06  4.5875E+06       IONOSPHERIC CORR\n"
)


def with_lines(lines: str) -> str:
    return WITHOUT.replace(f"{'':60}END OF HEADER", f"{lines}{'':60}END OF HEADER", 1)


def test_without_ionosphere_there_are_ways(sound: ReceiverSeries, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no ionosphere coefficients of GPS or BeiDou .*--ionosphere none"):
        read(tmp_path, nav=WITHOUT)
    left_in = read(tmp_path, nav=WITHOUT, ionosphere="none")
    assert left_in.notes == (NO_GALILEO, "The ionosphere's delay is left in (ionosphere none).", WANTING)
    np.testing.assert_allclose(fixes_m(left_in)[:, 2], fixes_m(sound)[:, 2] + 2.74, atol=0.1)
    with pytest.raises(InputError, match="ionosphere: 'klobuchar' is unknown"):
        read(tmp_path, ionosphere="klobuchar")


def test_the_ionosphere_of_beidou_stands_in(sound: ReceiverSeries, tmp_path: Path) -> None:
    found = read(tmp_path, nav=with_lines(BDS))
    assert found.notes[1] == "The ionosphere is corrected with the coefficients of BeiDou; there are none of GPS."
    # Two models of one night sky: a metre or two of delay, most of which the clock takes.
    difference = np.abs(fixes_m(found) - fixes_m(sound)).max()
    assert 1e-3 < difference < 1.5
    alone = read(tmp_path, nav=with_lines(BDS), systems=("C",))
    assert not any("ionosphere" in note for note in alone.notes)
    both = read(tmp_path, nav=NAV.replace(f"{'':60}END OF HEADER", f"{BDS}{'':60}END OF HEADER", 1))
    np.testing.assert_array_equal(both.errors_m, sound.errors_m)
    gps_for_beidou = read(tmp_path, systems=("C",))
    assert all("ionosphere" not in note for note in gps_for_beidou.notes)


def test_zeros_are_coefficients_unless_there_are_others(sound: ReceiverSeries, tmp_path: Path) -> None:
    zeros = "".join(f"{label}   0.0000E+00  0.0000E+00  0.0000E+00  0.0000E+00       IONOSPHERIC CORR\n"
                    for label in ("GPSA", "GPSB"))  # fmt: skip
    found = read(tmp_path, nav=with_lines(zeros))
    assert found.notes[1] == (
        "The ionosphere coefficients of GPS are all zero: its model gives 5 ns overhead, day and night."
    )
    # At night these are what the model gives anyway.
    np.testing.assert_allclose(found.errors_m, sound.errors_m, atol=1e-6)
    assert "coefficients of BeiDou" in read(tmp_path, nav=with_lines(zeros + BDS)).notes[1]


def test_several_navigation_files_are_one(sound: ReceiverSeries, tmp_path: Path) -> None:
    head, body = WITHOUT[: WITHOUT.index("END OF HEADER") + 14], WITHOUT[WITHOUT.index("END OF HEADER") + 14 :]
    records = re.findall(r"^[A-Z]\d\d .*\n(?: {4}.*\n)+", body, flags=re.M)
    texts = {
        "gps.nav": head + "".join(record for record in records if record[0] == "G"),
        "bds.nav": head + "".join(record for record in records if record[0] != "G"),
        "all.nav": NAV,
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "made.obs").write_text(OBS)
    for names in (["gps.nav", "bds.nav", "all.nav"], ["all.nav", "gps.nav"], ["all.nav"] * 3):
        paths = tuple(tmp_path / name for name in names)
        found = read_receiver_series(tmp_path / "made.obs", paths, read_truth(TRUTH))
        np.testing.assert_array_equal(found.errors_m, sound.errors_m)
        assert found.notes == (NO_GALILEO.replace("made.nav", " and ".join(names)), WANTING)
        once = read_navigation([tmp_path / "all.nav"], ("G", "C")).ephemerides
        merged = read_navigation(paths, ("G", "C")).ephemerides
        assert {name: len(every) for name, every in merged.items()} == {n: len(e) for n, e in once.items()}
    glonass = f"{'2.10':>9}{'':11}{'GLONASS NAV DATA':40}RINEX VERSION / TYPE\n{'':60}END OF HEADER\n"
    (tmp_path / "other.20g").write_text(glonass)
    paths = tmp_path / "all.nav", tmp_path / "other.20g"
    found = read_receiver_series(tmp_path / "made.obs", paths, read_truth(TRUTH))
    np.testing.assert_array_equal(found.errors_m, sound.errors_m)
    assert "Left out of other.20g: all of it, which is of other systems." in found.notes
    with pytest.raises(InputError, match=r"gps.nav and .*bds.nav: no ionosphere coefficients"):
        read_rinex(tmp_path / "made.obs", [tmp_path / "gps.nav", tmp_path / "bds.nav"])
    with pytest.raises(InputError, match="a navigation file is needed, and none is given"):
        read_rinex(tmp_path / "made.obs", [])


def test_of_two_messages_that_differ_the_one_that_forbids_the_use_counts(tmp_path: Path) -> None:
    """Two files of the same message, one of them with the health of another moment."""
    bad = re.sub(r"(\nG07 2020 06 25 00(?:.*\n){6} {4}.{19}) 0\.0{12}e\+00", r"\1 1.000000000000e+00", NAV)
    assert bad != NAV
    for names in (("good", "bad"), ("bad", "good")):
        (tmp_path / "good").write_text(NAV)
        (tmp_path / "bad").write_text(bad)
        (tmp_path / "made.obs").write_text(OBS)
        found = read_rinex(tmp_path / "made.obs", [tmp_path / name for name in names])
        assert found.unhealthy[:, found.names.index("G07")].all()


def test_a_truth_that_every_epoch_contradicts_is_told(sound: ReceiverSeries, tmp_path: Path) -> None:
    found = read(tmp_path, truth="4075780.8863,931853.5784,4801767.9707")
    assert re.match(
        r"At 2 of 2 epochs the pseudoranges fit a position 28\d m from the true position that was given .*, with "
        r"residuals of 0\.\d m: either the truth is not the antenna's, or all pseudoranges are faulted alike\.",
        found.notes[0],
    )
    near = read(tmp_path, truth="4075588.8863,931853.5784,4801567.9707")
    assert near.notes == sound.notes


def test_nothing_usable_says_why(tmp_path: Path) -> None:
    ill = re.sub(r"(\n[GC]\d\d (?:.*\n){6} {4}.{19}) 0\.0{12}e\+00", r"\1 1.000000000000e+00", NAV)
    with pytest.raises(InputError, match=r"no epoch can be used; .*left out as unhealthy"):
        read(tmp_path, nav=ill)


@pytest.mark.parametrize(("name", "record"), [("G07", "G07 2020"), ("C20", "C20 2020")])
def test_a_blank_accuracy_promises_none(name: str, record: str, sound: ReceiverSeries, tmp_path: Path) -> None:
    """It was read with a note that said that it was left out."""
    lines = NAV.split("\n")
    for k in [k for k, line in enumerate(lines) if line.startswith(record)]:
        lines[k + 6] = lines[k + 6][:4] + " " * 19 + lines[k + 6][23:]
    series = read(tmp_path, nav="\n".join(lines))
    assert name in sound.geometry.names
    assert series.geometry.satellite_count.tolist() == [12, 12]
    assert f"{name} (2 epochs): left out, as no accuracy is predicted (URA, SISA)." in series.notes
    assert any(
        note.startswith("Read from made.nav without one of their fields: the record of") for note in series.notes
    )


def test_a_field_that_is_not_needed_costs_nothing(sound: ReceiverSeries, tmp_path: Path) -> None:
    """A fit interval below zero."""
    series = read(
        tmp_path, nav=NAV.replace("3.384180000000e+05 4.000000000000e+00", "3.384180000000e+05-1.000000000000e+00")
    )
    np.testing.assert_array_equal(series.errors_m, sound.errors_m)
    assert "without one of their fields: the record of G05 at line 102 (bad/missing fit" in series.notes[0]
    assert not any("Left out of made.nav" in note for note in series.notes)


@pytest.mark.parametrize(("letter", "behind_s"), [("G", 0.0), ("E", 0.0), ("C", 14.0), ("M", 0.0), ("R", None)])
def test_a_file_that_names_no_time_has_that_of_its_system(letter: str, behind_s: float | None, tmp_path: Path) -> None:
    text = OBS.replace("GPS         TIME OF FIRST", "            TIME OF FIRST").replace(
        "DATA    M", f"DATA    {letter}"
    )
    (tmp_path / "made.obs").write_text(text)
    (tmp_path / "made.nav").write_text(NAV)
    if behind_s is None:
        with pytest.raises(InputError, match=r"its times are UTC .*; convert it"):
            read_rinex(tmp_path / "made.obs", tmp_path / "made.nav")
        return
    data = read_rinex(tmp_path / "made.obs", tmp_path / "made.nav")
    assert data.time_gps_s[0] == pytest.approx(2111 * 604_800.0 + 4 * 86_400.0 + behind_s)
    assert any("GPS is assumed" in note for note in data.notes) == (letter == "M")


def test_a_mask_that_is_no_number(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="mask_deg: a finite number is needed, not '10'"):
        read(tmp_path, mask_deg="10")
