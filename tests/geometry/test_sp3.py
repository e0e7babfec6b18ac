"""Precise orbits: exact orbits come back from samples, gaps stay gaps, damaged files are told in a sentence."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sp3_files import GM_M3_S2, START_GPS_S, TURN_RAD_S, changed, constellation, sp3

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.geometry import sp3 as adapter
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.sites import site_position_m
from pl_mc.geometry.sp3 import PreciseOrbits, sp3_orbits
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
    the last interval. Where the eccentricity is 0.16 the derivatives are larger.
    """
    error_m = errors_m(read, times_s)
    inside = (times_s > START_GPS_S + 5 * 900) & (times_s < START_GPS_S + DAY_S - 5 * 900)
    eccentric = np.array([ORBITS[name].eccentricity > 0.1 for name in read.names])
    assert error_m[inside][:, ~eccentric].max() < np.sqrt(3) * 0.5e-3 * 1.63 + 1e-5
    assert error_m[inside].max() < 1e-2
    assert error_m[:, ~eccentric].max() < np.sqrt(3) * 0.5e-3 * 29.9 + 1e-3
    assert error_m.max() < 1.0


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
    # Of the eleven positions for a time six are before it and five after it; at the time of a position either six.
    np.testing.assert_array_equal(gap, (after_s >= -5 * 900) & (after_s <= 6 * 900))
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


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda t: t.replace("#d", "#a", 1), "this is SP3-a, and SP3-c or SP3-d is needed"),
        (lambda t: "x" + t, "it is not an SP3 file"),
        (lambda t: "", "the file is empty"),
        (lambda t: t.replace("#dP2024  3", "#dP2024 13"), "line 1: '2024 13 20"),
        (lambda t: t.replace("#dP2024  3", "#dP2024  4"), "line 2: its GPS week and second are not the date"),
        (lambda t: t.replace("   900.0", "  9000.0", 1), "line 2: its epochs are 9000 s apart; at most 900 s"),
        (lambda t: t.replace("   900.0", "   300.0", 1), "is needed here, one every 300 s"),
        (lambda t: t.replace("     12 ORBIT", "     13 ORBIT"), "line 1: it promises 13 epochs, but the file"),
        (lambda t: t.replace("+    3   G01", "+    4   G01"), "line 3: it promises 4 satellites, but 3 are listed"),
        (lambda t: t.replace("+    3   G01G02", "+    3   G02G02"), "line 3: 'G02' appears twice"),
        (lambda t: t.replace(" cc GPS", " cc UTC"), "its times are in the system 'UTC'; GPS and GAL"),
        (lambda t: t.replace("%f", "?f", 1), "this is no line of the header"),
        (lambda t: t[: t.index("EOF")], "the file ends without EOF; is it cut short?"),
        (lambda t: "\n".join(t.split("\n")[:-4]), "the epoch ends here without G02 of the header; is it cut"),
        (lambda t: t[: t.rindex("PG02") + 30], "is no coordinate of an SP3 file"),
        (lambda t: "\n".join(LINES[: FIRST + 1] + LINES[FIRST + 2 :]), "without G01 of the header; the file"),
        (lambda t: t.replace("PG02", "PG01", 1), "'G01' appears twice in its epoch"),
        (lambda t: re.sub(r"(PG02.{14}).{14}", r"\1 999999.999999", t, count=1), "km from the Earth's centre"),
        (lambda t: t.replace("PG02", "PG05", 1), "'G05' is not a satellite of the header"),
        (lambda t: t.replace("PG02", "VG02", 1), "a velocity has no place here"),
        (lambda t: "\n".join([*LINES[:FIRST], *LINES[FIRST + 4 :]]), "the epoch 2024-03-20T00:00:00 is"),
        (lambda t: t.replace("EOF", "EOF\nEOF"), "an epoch or EOF at the end of the file"),
        (lambda t: t.replace("\0", "") + "\0", "it holds binary data"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused_in_a_sentence(tmp_path: Path, damage: Callable[[str], str], words: str) -> None:
    path = written(tmp_path, damage(SHORT))
    with pytest.raises(InputError) as caught:
        sp3_orbits(path, [START_GPS_S], constellations=("GPS",))
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_digit_that_is_wrong_is_found_by_the_orbit(tmp_path: Path) -> None:
    def kilometre(name: str, epoch: int, line: str) -> str:
        if (name, epoch) != ("G02", 5):
            return line
        x, y, z = (float(line[k : k + 14]) for k in (4, 18, 32))
        return changed(line, x, y + 1, z)

    few = {name: ORBITS[name] for name in ("G01", "G02")}
    path = written(tmp_path, sp3(few, epochs=12, position=kilometre))
    line = FIRST + 5 * 3 + 2 + 1
    with pytest.raises(InputError, match=rf"line {line}: this position of G02 .* lie 10\d\d m off an orbit"):
        sp3_orbits(path, [START_GPS_S], constellations=("GPS",))
    assert sp3_orbits(path, [START_GPS_S], constellations=("GPS",), without=("G02",)).names == ("G01",)
    sunk = written(tmp_path, sp3(few, epochs=12, position=lambda n, k, line: changed(line, 6e3, 0, 0)))
    with pytest.raises(InputError, match=r"line \d+: G01 is 6000 km from the Earth's centre"):
        sp3_orbits(sunk, [START_GPS_S], constellations=("GPS",))


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


def test_a_library_that_breaks_down_or_hangs_is_a_sentence(
    day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_worker(program: str) -> str:
        monkeypatch.setattr(adapter.worker, "__file__", str(written(tmp_path, program, "worker.py")))
        with pytest.raises(InputError) as caught:
            sp3_orbits(day, [START_GPS_S], constellations=("GPS",))
        return str(caught.value)

    assert "RTKLIB cannot evaluate it (exit code" in with_worker("import os; os.abort()")
    assert "pyrtklib cannot be loaded here" in with_worker("raise SystemExit(3)")
    monkeypatch.setattr(adapter, "_START_LIMIT_S", 0.3)
    assert "given up" in with_worker("import time; time.sleep(30)")


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
