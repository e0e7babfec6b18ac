"""Precise orbits: exact orbits come back from samples, gaps stay gaps, damaged files are told in a sentence."""

from __future__ import annotations

import bz2
import gzip
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import ncompress
import numpy as np
import pytest
import sidereon
from sp3_files import GM_M3_S2, START_GPS_S, TURN_RAD_S, Orbit, changed, constellation, sp3

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.sites import site_position_m
from pl_mc.geometry.sp3 import PreciseOrbits, sp3_orbits
from pl_mc.geometry.sp3_reader import iso_date
from pl_mc.input_errors import InputError
from pl_mc.studies.sources import SiteSource
from pl_mc.studies.spec import SimulatedGeometry

ORBITS = constellation()
EVERY = ("GPS", "GAL", "BDS-2", "BDS-3")
DAY_S = 86_400.0


def written(folder: Path, text: str, name: str = "week.sp3") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("sp3"), sp3(ORBITS))


@pytest.fixture(scope="module")
def times_s() -> np.ndarray:
    return START_GPS_S + np.arange(0.0, DAY_S + 1, 30.0)


@pytest.fixture(scope="module")
def read(day: Path, times_s: np.ndarray) -> PreciseOrbits:
    return sp3_orbits(day, times_s, constellations=EVERY)


def errors_m(read: PreciseOrbits, times_s: np.ndarray) -> np.ndarray:
    exact = np.stack([ORBITS[name].position_m(times_s) for name in read.names], axis=1)
    return np.linalg.norm(read.position_m - exact, axis=-1)


def test_an_orbit_comes_back_from_its_quarter_hours(read: PreciseOrbits, times_s: np.ndarray) -> None:
    """With h = 900 s a polynomial of degree ten is off by under 1e-6 m beside the middle of its eleven points and
    1e-4 m in its first interval: h^11 / 11! times the products of distances, 1.2e-4 and 1e-2, and the eleventh
    derivative, a n^11 in a circle of 26,560 km. What is left is the rounding of the file, half a millimetre in each
    coordinate, times the Lebesgue constants of eleven even points: 1.63 beside the middle, 29.9 in the first and
    the last interval. In the eccentric anomaly an ellipse is as smooth as a circle, and its eleven points, no longer
    even, have constants up to 1.8 and 54 (taken from the weights of the two orbits with eccentricity 0.16).
    """
    error_m = errors_m(read, times_s)
    inside = (times_s > START_GPS_S + 5 * 900) & (times_s < START_GPS_S + DAY_S - 5 * 900)
    eccentric = np.array([ORBITS[name].eccentricity > 0.1 for name in read.names])
    rounding_m = np.sqrt(3) * 0.5e-3
    assert error_m[inside][:, ~eccentric].max() < rounding_m * 1.63 + 1e-5
    assert error_m[inside].max() < rounding_m * 1.8 + 1e-5
    assert error_m[:, ~eccentric].max() < rounding_m * 29.9 + 1e-3
    assert error_m.max() < rounding_m * 54
    assert read.notes == ()


def test_what_is_promised_of_eccentric_satellites_holds_wherever_their_perigee_is(tmp_path: Path) -> None:
    """Orbits like those of E14 and E18, at 36 places of the ellipse when the file begins; see docs/how-to/geometry."""
    orbits = {
        f"E{k + 1:02d}": Orbit(27_977e3, 0.162, np.radians(50.0), 0.3 * k, 2.1 * k, np.pi / 18 * k) for k in range(36)
    }
    moments = START_GPS_S + np.arange(0.0, DAY_S + 1, 60.0)
    read = sp3_orbits(written(tmp_path, sp3(orbits)), moments, constellations=("GAL",))
    exact = np.stack([orbit.position_m(moments) for orbit in orbits.values()], axis=1)
    error_m = np.linalg.norm(read.position_m - exact, axis=-1)
    inside = (moments > START_GPS_S + 5 * 900) & (moments < START_GPS_S + DAY_S - 5 * 900)
    assert error_m[inside].max() < 1.3e-3
    assert error_m.max() < 2e-2
    assert read.notes == ()


def test_sidereon_interpolates_alike(day: Path, read: PreciseOrbits, times_s: np.ndarray) -> None:
    """Its polynomials are in time: alike where orbits are round."""
    product = sidereon.load_sp3(day)
    seconds = product.epochs_j2000_seconds[0] + times_s - START_GPS_S
    for column, name in enumerate(read.names):
        if ORBITS[name].eccentricity < 0.1:
            other_m = product.interpolate(name, seconds).position_m
            assert np.linalg.norm(read.position_m[:, column] - other_m, axis=-1).max() < 1e-2


HERE = Path(__file__).parent


def test_real_orbits_of_an_eccentric_satellite() -> None:
    """E14 on 2020-06-24 every 15 minutes, by an analysis centre: no position of it is off an orbit."""
    path = HERE / "e14.sp3"
    read = sp3_orbits(path, gps_seconds("2020-06-24") + 900.0 * np.arange(96), constellations=("GAL",))
    given_km = [
        [float(line[k : k + 14]) for k in (4, 18, 32)]
        for line in path.read_text().split("\n")
        if line.startswith("PE14")
    ]
    assert (read.names, read.notes) == (("E14",), ())
    np.testing.assert_allclose(read.position_m[:, 0], 1e3 * np.array(given_km), atol=1e-6)
    options = {"start": "2020-06-24T12:00:00", "epochs": 2, "interval_s": 60.0, "mask_deg": 0.0}
    g = pl_mc.simulate(site="-2.6e6,2.6e6,-5.2e6", sp3=path, constellations=("GAL",), **options)
    assert (g.names, g.notes) == (("E14",), ())


def test_a_satellite_that_epochs_leave_out_is_missing_there() -> None:
    """Real orbits, E02 left out of four epochs from 10:00 on: hidden to 12:07:30, and not one epoch longer."""
    options = {"site": "JFNG", "sp3": HERE / "left_out.sp3", "constellations": ("GAL",), "mask_deg": 0.0}
    g = pl_mc.simulate(start="2020-06-24T08:30:00", epochs=521, interval_s=30.0, **options)
    read = sp3_orbits(HERE / "left_out.sp3", g.time_gps_s, constellations=("GAL",))
    after_s = g.time_gps_s - gps_seconds("2020-06-24T10:00:00")
    np.testing.assert_array_equal(np.isnan(read.position_m[:, 1, 0]), (after_s >= -4950) & (after_s < 2700 + 4950))
    assert not np.isnan(read.position_m[:, [0, 2]]).any()
    (note,) = g.notes
    assert note.startswith("left_out.sp3: E02 lacks 4 of 96 positions, the first at 2020-06-24T10:00:00; it is out of ")
    assert g[3].notes == g[2:5].notes == (note,)
    assert pl_mc.sweep(g, pl_mc.no_fault(g), draws=10, seed=1, methods=("ls",)).attrs["notes"] == [note]
    early = pl_mc.simulate(start="2020-06-24T02:00:00", epochs=2, interval_s=60.0, **options)
    assert early.notes == ()


def test_satellites_and_their_orbits(read: PreciseOrbits) -> None:
    kinds = dict(zip(read.names, read.orbits, strict=True))
    assert read.names == tuple(name for name in ORBITS if name != "R01")
    assert {name: kinds[name] for name in ("G01", "E01", "C01", "C06", "C11", "C19", "C59")} == {
        "G01": "GPS", "E01": "GAL", "C01": "BDS-GEO", "C06": "BDS-IGSO", "C11": "BDS-MEO", "C19": "BDS-MEO",
        "C59": "BDS-GEO",
    }  # fmt: skip


def test_a_geometry_is_that_of_the_exact_positions(day: Path) -> None:
    options = {"start": "2024-03-20T06:00:10", "epochs": 3, "interval_s": 45.5, "mask_deg": 5.0}
    g = pl_mc.simulate(sp3=day, constellations=EVERY, **options)
    site = site_position_m("CUT0")
    rotation = enu_rotation(*geodetic(site)[:2])
    assert g.clocks == ("G", "C", "E")
    for epoch, moment in enumerate(g.time_gps_s):
        shown = {
            name: rotation @ (sight / np.linalg.norm(sight))
            for name, sight in ((name, ORBITS[name].position_m(moment) - site) for name in ORBITS if name != "R01")
        }
        rows = np.flatnonzero(g.in_view[epoch])
        seen = [g.names[k] for k in g.satellite[epoch, rows]]
        assert sorted(seen) == sorted(name for name, up in shown.items() if up[2] >= np.sin(np.radians(5.0)))
        # A centimetre at 19,000 km.
        np.testing.assert_allclose(-g.design[epoch, rows, :3], [shown[name] for name in seen], atol=1e-9)


def test_beidou_is_split_by_numbers_and_satellites_can_be_off(day: Path, times_s: np.ndarray) -> None:
    def names(*constellations: str, without: tuple[str, ...] = ()) -> tuple[str, ...]:
        return sp3_orbits(day, times_s[:2], constellations=constellations, without=without).names

    assert names("BDS-2") == ("C01", "C06", "C11")
    assert names("BDS-3", "BDS-2", without=("C06",)) == ("C19", "C59", "C01", "C11")
    with pytest.raises(InputError, match=r"without: 'G01' is not among the BDS-2 of .*week\.sp3 \(nearest"):
        names("BDS-2", without=("G01",))


def test_velocities_versions_and_compression_change_nothing(tmp_path: Path, times_s: np.ndarray) -> None:
    few = {name: ORBITS[name] for name in ("G01", "C06")}
    plain = written(tmp_path, sp3(few, epochs=13))
    other = tmp_path / "other.sp3.gz"
    text = sp3(few, epochs=13, version="c", velocities=True, time_system="GAL").replace("\n", "\r\n")
    other.write_bytes(gzip.compress(text.encode()))
    one, same = (sp3_orbits(path, times_s[:200:20], constellations=("GPS", "BDS-2")) for path in (plain, other))
    np.testing.assert_array_equal(one.position_m, same.position_m)
    assert np.isfinite(one.position_m).all()


@pytest.mark.parametrize("lacking", ["zero", "nines", "manoeuvre"])
def test_a_missing_position_leaves_a_gap_and_no_number(tmp_path: Path, times_s: np.ndarray, lacking: str) -> None:
    def position(name: str, epoch: int, line: str) -> str:
        if name == "G02":
            return changed(line, 0, 0, 0)
        if (name, epoch) != ("G01", 20):
            return line
        if lacking == "manoeuvre":
            return f"{line:<78}M"
        return changed(line, *[0.0 if lacking == "zero" else 999_999.999999] * 3)

    few = {name: ORBITS[name] for name in ("G01", "G02", "G03")}
    path = written(tmp_path, sp3(few, epochs=41, position=position))
    moments = times_s[: 40 * 30 + 1 : 5]
    read = sp3_orbits(path, moments, constellations=("GPS",))
    assert read.names == ("G01", "G03")
    gap = np.isnan(read.position_m[:, 0, 0])
    after_s = moments - START_GPS_S - 20 * 900
    # The eleven positions nearest to a time.
    np.testing.assert_array_equal(gap, (after_s >= -5.5 * 900) & (after_s < 5.5 * 900))
    assert read.notes[0] == "week.sp3: no position of G02, left out."
    assert re.match(
        r"week\.sp3: G01 lacks 1 of 41 positions, the first at 2024-03-20T05:00:00; it is out", read.notes[1]
    )
    assert not np.isnan(read.position_m[:, 1]).any()
    assert np.nanmax(errors_m(read, moments)) < 5e-2


def test_more_satellites_than_two_digits_count(tmp_path: Path, times_s: np.ndarray) -> None:
    many = {
        f"{letter}{k:02d}": ORBITS["G01"]
        for letter, last in (("G", 32), ("E", 36), ("C", 63))
        for k in range(1, last + 1)
    }
    read = sp3_orbits(written(tmp_path, sp3(many, epochs=11)), times_s[150:151], constellations=EVERY)
    assert len(read.names) == 131
    np.testing.assert_allclose(read.position_m[0], [ORBITS["G01"].position_m(times_s[150])] * 131, atol=1e-2)


SHORT = sp3({name: ORBITS[name] for name in ("G01", "G02", "C06")}, epochs=12)
LINES = SHORT.split("\n")
FIRST = next(k for k, line in enumerate(LINES) if line.startswith("*"))


MOMENTS = START_GPS_S + np.array([3000.0, 4500.0])


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda t: t.replace("#d", "#e", 1), "it is not an SP3 file; its first line does not begin with #a"),
        (lambda t: "x" + t, "it is not an SP3 file"),
        (lambda t: "", "the file is empty"),
        (lambda t: "\n" * 50, "the file is empty"),
        (lambda t: t.split("\n")[0], "its times have no system (%c)"),
        (lambda t: sp3({"G01": ORBITS["G01"]}, interval_s=1800.0), "its epochs are 1800 s apart; up to 900 s can be"),
        (lambda t: t.replace(" cc GPS", " cc XYZ"), "its times are in the system 'XYZ'; GPS, GAL, QZS, IRN, BDT, TAI"),
        (lambda t: t.replace(" cc GPS", " cc ccc"), "its times are in the system 'ccc'"),
        (lambda t: t.replace("+    3", "?    3"), "its head has no list of satellites"),
        (lambda t: t[: len(t) // 2], "it holds 4 epochs; interpolation needs at least 11"),
        (lambda t: t.replace("\0", "") + "\0", "it holds binary data"),
        (lambda t: t.replace("PG", "PG\u2212"), "it holds no position of GPS that can be used"),
    ],
)  # fmt: skip
def test_files_that_are_none_are_refused_in_a_sentence(
    tmp_path: Path, damage: Callable[[str], str], words: str
) -> None:
    path = written(tmp_path, damage(SHORT))
    with pytest.raises(InputError) as caught:
        sp3_orbits(path, MOMENTS, constellations=("GPS",))
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def version_a(text: str) -> str:
    """A file that says nothing of its time system."""
    return text.replace("#d", "#a").replace("%c M  cc GPS", "%c cc cc ccc")


def of_line(number: int, change: Callable[[str], str]) -> str:
    """The short file with another line at an index."""
    return "\n".join([*LINES[:number], change(LINES[number]), *LINES[number + 1 :]])


@pytest.mark.parametrize(
    "harmless",
    [
        lambda t: "\ufeff" + t,
        lambda t: "\n\n" + t.replace("\n*", "\n\n   \n*") + "\n\n",
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t.replace("\n", "\r"),
        lambda t: t.replace("/*", "/* \u00e9"),
        lambda t: "\n".join(line for line in t.split("\n") if not line.startswith(("/*", "%f", "%i", "++"))),
        lambda t: t.replace("\n*  2024", "\n/* Between epochs.\n*  2024"),
        lambda t: t + "What follows the end.\n",
        lambda t: of_line(FIRST + 3, lambda line: "PC06 nothing here is used"),
        lambda t: of_line(FIRST + 3, lambda line: f"{line}\nPR99 nor here\nEP  55  55  55     222 1234567\nV"),
        lambda t: of_line(FIRST + 2, lambda line: f"{line}\n{line}"),
        lambda t: of_line(FIRST + 4, lambda line: f"{line}\n{line}"),
        lambda t: version_a(t).replace("G0", "  ").replace("C06", " 33"),
        lambda t: version_a(t).replace("#a", "#b"),
        lambda t: t.replace("%c M  cc GPS", "%R G  cc GPS"),
    ],
)  # fmt: skip
def test_what_is_not_used_costs_nothing(tmp_path: Path, harmless: Callable[[str], str]) -> None:
    """Version a has numbers alone for satellites, and neither it nor b a time system; "%R" was in files of the IGS."""
    sound = sp3_orbits(written(tmp_path, SHORT), MOMENTS, constellations=("GPS",))
    path = tmp_path / "other.sp3"
    path.write_text(harmless(SHORT), encoding="utf-8", newline="")
    read = sp3_orbits(path, MOMENTS, constellations=("GPS",))
    assert (read.names, read.notes) == (("G01", "G02"), ())
    np.testing.assert_array_equal(read.position_m, sound.position_m)


sixth, of_g02 = partial(of_line, FIRST + 20), partial(of_line, FIRST + 22)


@pytest.mark.parametrize(
    ("damage", "words", "gone"),
    [
        (lambda: SHORT.replace("EOF\n", ""), "it ends without EOF; is it cut short?", ""),
        (lambda: SHORT[: SHORT.rindex("PG02") + 40], "it ends without EOF; is it cut short?", ""),
        (lambda: SHORT.replace("     12 ORBIT", "     13 ORBIT"), "it promises 13 epochs and holds 12", ""),
        (lambda: SHORT.replace("#dP2024  3", "#dP2024  4"), "its head does not fit its epochs", ""),
        (lambda: SHORT.replace("   900.0", "   300.0", 1), "and come every 900 s; these were taken", ""),
        (lambda: of_g02(lambda line: line[:30]), "is no record of SP3 and was left out", "G02"),
        (lambda: of_g02(lambda line: line[:20] + line[21:]), f"line {FIRST + 23} ('PG02", "G02"),
        (lambda: of_g02(lambda line: line.replace(".", "\xb5", 1)), "is no record of SP3", "G02"),
        (lambda: of_g02(lambda line: line.replace("PG02", "PG05")), f"line {FIRST + 23} ('PG05", "G02"),
        (lambda: of_g02(lambda line: line.replace("PG02", "PG01")), "G01 at the epoch 2024  3 20  1 15", "G01 G02"),
        (lambda: of_g02(lambda line: "garbage"), f"line {FIRST + 23} ('garbage') is no record", "G02"),
        (lambda: of_g02(lambda line: changed(line, 6e3, 0, 0)), "G02 at 2024-03-20T01:15:00, 6000 km", "G02"),
        (lambda: sixth(lambda line: line.replace(" 1 15 ", " 1 16 ")), "2024-03-20T01:16:00 is out of step", "G01 G02"),
        (lambda: sixth(lambda line: line.replace(" 1 15 ", " 1 75 ")), "('*  2024  3 20  1 75", "G01 G02"),
        (lambda: sixth(lambda line: line.replace(" 3 20 ", " 2 30 ")), "('*  2024  2 30  1 15", "G01 G02"),
        (lambda: sixth(lambda line: line.replace("*  2024", "*  2094")), "epoch 2094-03-20T01:15:00 is", "G01 G02"),
        (lambda: "\n".join(LINES[: FIRST + 20] + LINES[FIRST + 24 :]), "it promises 12 epochs and holds 11", "G01 G02"),
        (lambda: "\n".join(LINES[: FIRST + 20] + LINES[FIRST + 21 :]), "G01 at the epoch 2024  3 20  1  0", "G01 G02"),
    ],
)  # fmt: skip
def test_one_bad_record_costs_that_record_and_is_told(
    tmp_path: Path, damage: Callable[[], str], words: str, gone: str
) -> None:
    """Files of 12 epochs, damaged at the sixth of them; satellites that lose it have no position at any moment."""
    path = tmp_path / "week.sp3"
    path.write_bytes(damage().encode("latin-1"))
    read = sp3_orbits(path, MOMENTS, constellations=("GPS",))
    assert words in " ".join(read.notes)
    lost = " ".join(name for k, name in enumerate(read.names) if np.isnan(read.position_m[:, k]).any())
    assert lost == gone
    for name in gone.split():
        assert f"{name} lacks" in " ".join(read.notes)
    kept = [k for k, name in enumerate(read.names) if name not in gone]
    assert errors_m(read, MOMENTS)[:, kept].max(initial=0.0) < 5e-2


@pytest.mark.parametrize(
    ("system", "ahead_s"),
    list({"GPS": 0, "GAL": 0, "QZS": 0, "IRN": 0, "TAI": -19, "BDT": 14, "UTC": 18, "GLO": 18}.items()),
)
def test_other_time_systems_become_gps_time(tmp_path: Path, system: str, ahead_s: int) -> None:
    """GPS time is behind TAI by 19 s and ahead of BeiDou time by 14 s, of UTC in 2024 by 18 s; GLO stands for UTC."""
    read = sp3_orbits(
        written(tmp_path, SHORT.replace("cc GPS", f"cc {system}")), MOMENTS + ahead_s, constellations=("GPS",)
    )
    assert read.notes == ()
    assert errors_m(read, MOMENTS).max() < 5e-2
    with pytest.raises(InputError, match=re.escape(f"it covers {iso_date(START_GPS_S + ahead_s)} to")):
        sp3_orbits(tmp_path / "week.sp3", [START_GPS_S + ahead_s - 1], constellations=("GPS",))


def test_packed_files_are_the_plain_ones(tmp_path: Path) -> None:
    plain = sp3_orbits(written(tmp_path, SHORT), MOMENTS, constellations=("GPS",))
    for name, packed in (("a.Z", ncompress.compress(SHORT.encode())), ("a.bz2", bz2.compress(SHORT.encode()))):
        (tmp_path / name).write_bytes(packed)
        read = sp3_orbits(tmp_path / name, MOMENTS, constellations=("GPS",))
        np.testing.assert_array_equal(read.position_m, plain.position_m)


def test_a_library_that_panics_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Panic(BaseException):
        pass

    def panics(source: bytes) -> None:
        raise Panic("index out of bounds")

    monkeypatch.setattr(sidereon, "load_sp3", panics)
    with pytest.raises(InputError, match=r"cannot be read as an SP3 file \(index out of bounds\)"):
        sp3_orbits(written(tmp_path, SHORT), MOMENTS, constellations=("GPS",))


def test_a_position_off_its_orbit_is_missing_and_told(tmp_path: Path) -> None:
    """Ten metres are found in files of five minutes, a hundred in those of fifteen."""

    def off(name: str, epoch: int, line: str, by_km: float) -> str:
        if (name, epoch) != ("G02", 7):
            return line
        x, y, z = (float(line[k : k + 14]) for k in (4, 18, 32))
        return changed(line, x, y + by_km, z)

    few = {name: ORBITS[name] for name in ("G01", "G02")}
    for interval_s, off_m, found in (
        (900.0, 1000.0, True),
        (900.0, 100.0, True),
        (300.0, 10.0, True),
        (900.0, 1.0, False),
    ):
        text = sp3(few, epochs=15, interval_s=interval_s, position=partial(off, by_km=off_m / 1e3))
        moments = START_GPS_S + interval_s * np.array([7.25, 0.5])
        read = sp3_orbits(written(tmp_path, text), moments, constellations=("GPS",))
        assert np.isnan(read.position_m[:, 1, 0]).all() == found
        assert not np.isnan(read.position_m[:, 0]).any()
        if found:
            moment = iso_date(START_GPS_S + 7 * interval_s)
            told = rf"G02 lies off the orbit of the positions before and after at {moment} \((\d+) m\)"
            (match,) = [re.search(told, note) for note in read.notes if "lies off" in note]
            assert float(match[1]) == pytest.approx(off_m, abs=5.0 * (interval_s / 900) ** 2)


def test_a_satellite_that_is_on_no_orbit_is_left_out(tmp_path: Path) -> None:
    few = {name: ORBITS[name] for name in ("G01", "G02")}
    path = written(
        tmp_path,
        sp3(
            few,
            epochs=15,
            position=lambda n, k, t: changed(t, 2e4 + 9 * k * k * (n == "G02"), 1e4, 1e4) if n == "G02" else t,
        ),
    )
    read = sp3_orbits(path, MOMENTS, constellations=("GPS",))
    assert read.names == ("G01",)
    assert read.notes == (
        "week.sp3: the positions of G02 lie on no orbit.", "week.sp3: no position of G02, left out."
    )  # fmt: skip
    assert sp3_orbits(path, MOMENTS, constellations=("GPS",), without=("G02",)).notes == ()


def test_oblateness_is_no_damage(tmp_path: Path) -> None:
    """Orbits of GPS, and of Galileo with eccentricity 0.16, integrated with J2 by Runge and Kutta's rule."""
    j2, radius_m = 1.0826e-3, 6_378_137.0
    orbits = [ORBITS["G08"], ORBITS["E01"]]

    def pull(r: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(r, axis=-1, keepdims=True)
        factor = 1.5 * j2 * (radius_m / distance) ** 2
        ratio = 5 * (r[:, 2:] / distance) ** 2
        return -GM_M3_S2 * r / distance**3 * (1 + factor * (np.array([1.0, 1.0, 3.0]) - ratio))

    def rate(state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[:, 3:], pull(state[:, :3])], axis=-1)

    def turned(positions_m: np.ndarray, angle: float) -> np.ndarray:
        x, y, z = positions_m.T
        return np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z], axis=-1)

    near = [
        turned(np.stack([one.position_m(START_GPS_S + dt) for one in orbits]), TURN_RAD_S * dt) for dt in (-1, 0, 1)
    ]
    state, step_s = np.concatenate([near[1], (near[2] - near[0]) / 2], axis=-1), 60.0
    places = []
    for step in range(60 * 15 + 1):
        if step % 15 == 0:
            places.append(turned(state[:, :3], -TURN_RAD_S * step * step_s))
        k1 = rate(state)
        k2 = rate(state + step_s / 2 * k1)
        k3 = rate(state + step_s / 2 * k2)
        k4 = rate(state + step_s * k3)
        state = state + step_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def position(name: str, epoch: int, line: str) -> str:
        return changed(line, *places[epoch][0 if name == "G08" else 1] / 1e3)

    path = written(tmp_path, sp3({name: ORBITS[name] for name in ("G08", "E01")}, epochs=61, position=position))
    read = sp3_orbits(path, START_GPS_S + np.array([0.0, 45_000.0]), constellations=("GPS", "GAL"))
    np.testing.assert_allclose(read.position_m, np.stack([places[0], places[50]]), atol=2e-3)
    # It is there: kilometres after half a day.
    assert np.linalg.norm(places[50][0] - ORBITS["G08"].position_m(START_GPS_S + 45_000.0)) > 1e3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"start": "2024-03-19T23:59:30"}, "it covers 2024-03-20T00:00:00 to 2024-03-21T00:00:00 (GPS time), but"),
        ({"start": "2024-03-20T23:59:00", "epochs": 4}, "for are 2024-03-20T23:59:00 to 2024-03-21T00:00:30"),
        ({"start": "9999-12-31T23:59:59"}, "9999-12-31T23:59:59 to after the year 9999"),
        ({"start": "2024-03-20", "almanac": "a.alm"}, "sp3: an almanac is given too"),
        ({"start": "2024-03-20", "constellations": "GLO"}, "constellations: "),
        ({"start": "2024-03-20", "sp3": 3}, "sp3: the path of an SP3 file is needed, not 3"),
        ({"start": "2024-03-20", "sp3": "none.sp3"}, "none.sp3: there is no such file"),
    ],
)  # fmt: skip
def test_what_cannot_be_asked_of_a_file(day: Path, options: dict, words: str) -> None:
    with pytest.raises(InputError) as caught:
        pl_mc.simulate(**{"sp3": day, "epochs": 2, **options})
    assert words in str(caught.value)


def test_a_constellation_or_an_orbit_that_is_not_there(tmp_path: Path) -> None:
    def lost(name: str, epoch: int, line: str) -> str:
        return changed(line, 0, 0, 0) if name[0] == "C" else line

    path = written(tmp_path, sp3({name: ORBITS[name] for name in ("G01", "C06")}, epochs=12, position=lost))
    with pytest.raises(InputError, match="no satellite of GAL, E01 to E36"):
        sp3_orbits(path, [START_GPS_S], constellations=("GPS", "GAL"))
    with pytest.raises(InputError, match="it holds no position of BDS-2"):
        sp3_orbits(path, [START_GPS_S], constellations=("BDS-2",))
    short = written(tmp_path, sp3({"G01": ORBITS["G01"]}, epochs=10))
    with pytest.raises(InputError, match="it holds 10 epochs; interpolation needs at least 11"):
        sp3_orbits(short, [START_GPS_S], constellations=("GPS",))


def test_an_experiment_takes_and_hashes_the_file(day: Path) -> None:
    options = {"start": "2024-03-20T06:00:00", "epochs": 2, "sp3": str(day)}
    g = SimulatedGeometry.model_validate({**options, "constellations": ["GPS", "BDS-2"]}).build()
    assert set(g.names) <= set(ORBITS)
    content = {
        "kind": "sweep",
        "title": "t",
        "draws": 10,
        "geometry": options,
        "faults": {"satellite": "G01", "start_m": 5.0, "stop_m": 10.0, "step_m": 5.0},
    }
    assert build_experiment(content, source="t").input_files() == {"geometry.sp3": day}
    source = SiteSource.model_validate(options)
    assert "under the GPS + BDS-2 of the precise orbits week.sp3, mask" in source.describe()
