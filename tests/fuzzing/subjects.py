"""What is damaged and what reads it: sound files of every kind, and what their readers make of them.

A reader returns its numbers by name, for comparison with those of the sound file, and the notes that it gives.
"""

from __future__ import annotations

import gzip
import json
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import hatanaka
import numpy as np
from mutations import fewer_lines, same_columns, same_numbers, same_values, same_words

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / folder) for folder in ("receiver", "geometry")]

import receiver_files  # noqa: E402
import rinex_versions  # noqa: E402
from almanac_files import elements, sem, yuma  # noqa: E402
from ionex_files import ionex  # noqa: E402
from sp3_files import START_GPS_S, constellation, sp3  # noqa: E402

from pl_mc.error_models import Sky, as_error_model  # noqa: E402
from pl_mc.experiments.checking import check_experiment  # noqa: E402
from pl_mc.experiments.loading import load_experiment  # noqa: E402
from pl_mc.experiments.reading import remake_page, write_comparison  # noqa: E402
from pl_mc.geometry.almanac import almanac_slots  # noqa: E402
from pl_mc.geometry.orbits import satellite_positions_m  # noqa: E402
from pl_mc.geometry.sp3 import sp3_orbits  # noqa: E402
from pl_mc.input_errors import InputError  # noqa: E402
from pl_mc.ism import read_ism  # noqa: E402
from pl_mc.noise_models import as_noise_model  # noqa: E402
from pl_mc.receiver import Truth, read_claims, read_receiver_series, read_truth  # noqa: E402
from pl_mc.receiver.fixes import Fixes  # noqa: E402
from pl_mc.report.run_folder import read_run_folder  # noqa: E402

CLAIMS = ROOT / "tests" / "receiver" / "files"
NEAR_GPS_S = receiver_files.NOON_GPS_S


@dataclass(frozen=True)
class Read:
    """What a reader made of a file.

    Attributes:
        numbers: its numbers by name.
        notes: what it says of the file.
    """

    numbers: Mapping[str, float]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Subject:
    """A kind of file.

    Attributes:
        name: what it is called in the table.
        content: a sound file.
        read: reads a file that is at a path.
        suffix: end of the file's name.
        tolerance: how far a number may be from that of the sound file and still count as the same; None where
            every file that is accepted says what its author wants, so that nothing can be compared.
        alike: whether the damaged file is as well formed as the sound one: no rule of form tells them apart.
    """

    name: str
    content: bytes
    read: Callable[[Path], Read]
    suffix: str = ""
    tolerance: float | None = None
    alike: Callable[[bytes, bytes], bool] = same_columns


@cache
def _sky() -> receiver_files.Sky:
    return receiver_files.simulate(seconds=(0.0, 30.0, 60.0))


@cache
def _beside(name: str, content: bytes) -> Path:
    """The sound partner of a file that is damaged."""
    path = Path(tempfile.mkdtemp(prefix="pl_mc_fuzz_"), name)
    path.write_bytes(content)
    return path


def _series(observations: Path, navigation: Path, systems: tuple[str, ...], ionex: Path | None = None) -> Read:
    truth = read_truth(receiver_files.TRUTH_TEXT)
    series = read_receiver_series(observations, navigation, truth, systems=systems, ionex=ionex)
    g = series.geometry
    numbers = {
        f"{g.time_gps_s[epoch]:.3f} {g.names[g.satellite[epoch, row]]}": float(series.errors_m[epoch, row])
        for epoch, row in zip(*np.nonzero(g.in_view), strict=True)
    }
    return Read(numbers, series.notes)


def _observations(partner: bytes, systems: tuple[str, ...]) -> Callable[[Path], Read]:
    return lambda path: _series(path, _beside("sound.nav", partner), systems)


def _navigation(partner: bytes, systems: tuple[str, ...]) -> Callable[[Path], Read]:
    return lambda path: _series(_beside("sound.obs", partner), path, systems)


def _almanac(path: Path) -> Read:
    slots = almanac_slots(path, NEAR_GPS_S)
    positions = satellite_positions_m(slots, NEAR_GPS_S)[0]
    return Read({f"{slot.name} {k}": float(positions[j, k]) for j, slot in enumerate(slots) for k in range(3)})


def _precise(path: Path) -> Read:
    orbits = sp3_orbits(path, START_GPS_S + np.array([3000.0, 4500.0]), constellations=("GPS", "BDS-2"))
    numbers = {
        f"{name} {epoch} {k}": float(orbits.position_m[epoch, j, k])
        for j, name in enumerate(orbits.names)
        for epoch in range(2)
        for k in range(3)
        if np.isfinite(orbits.position_m[epoch, j, k])
    }
    return Read(numbers, orbits.notes)


def _same_unpacked(one: bytes, other: bytes) -> bool:
    """A difference in a compact file goes on to every later epoch; what counts is the file that it stands for."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return same_values(hatanaka.crx2rnx(one), hatanaka.crx2rnx(other))
        except hatanaka.HatanakaException:
            return same_columns(one, other)


def _positions(fixes: Fixes | Truth) -> dict[str, float]:
    return {
        f"{time:.3f} {k}": float(position[k])
        for time, position in zip(fixes.time_gps_s, fixes.position_m, strict=True)
        for k in range(3)
    }


def _track(path: Path) -> Read:
    truth = read_truth(str(path))
    return Read(_positions(truth), tuple(note.removeprefix(path.name) for note in truth.notes))


_ISM = b"satellite,sigma_ura_m,p_sat,b_nom_m,p_const\nG,1.0,1e-5,0.5,1e-8\nE,1.5,1e-5,0.75,1e-4\nG07,2.4,3e-5,,\n"


def _ism(path: Path) -> Read:
    """Values that are within their bounds are what its author wants, so that no number is compared."""
    message = read_ism(path)
    assert message.values("sigma_ura_m", ["G07"], ["G"]) > 0
    return Read({})


def _maps(observations: bytes, navigation: bytes) -> Callable[[Path], Read]:
    """Pseudorange errors with the delays of maps."""
    beside = _beside("sound.obs", observations), _beside("sound.nav", navigation)
    return lambda path: _series(*beside, ("G",), ionex=path)


@cache
def _maps_text() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        days = ("2020 6 25 0 0 0", "2020 6 25 12 0 0", "2020 6 26 0 0 0")
        return ionex(Path(folder), lambda k, *_: 20.0 + 5.0 * k, days).read_bytes()


def _claims(path: Path) -> Read:
    fixes = read_claims(path)
    return Read(_positions(fixes), tuple(note.removeprefix(path.name) for note in fixes.notes))


def _models(path: Path) -> Read:
    """Sigma and law that a file states are what its author wants."""
    sky = Sky("GPS", np.radians([3.0, 40.0, 89.0]), 0.0, 0.5, 0.0)
    assert np.all(as_error_model(str(path)).sigma_m(sky) > 0)
    as_noise_model(str(path))
    return Read({})


_MODELS = b"""[error_model]
name = "by_elevation"
elevation_deg = [0.0, 15.0, 30.0, 90.0]
sigma_m = [2.75, 1.29, 0.57]

[noise]
name = "student_t"
nu = 5.4
match = "core"
of_sigma = 0.44
"""


def _experiment(path: Path) -> Read:
    found = check_experiment(str(path))
    if found.problems:
        raise InputError(found.text())
    load_experiment(str(path))
    return Read({})


def _manifest(path: Path) -> Read:
    refused = None
    try:
        load_experiment(str(path))
    except InputError as error:
        refused = error
    folder = path.parent / "run"
    folder.mkdir(exist_ok=True)
    (folder / "manifest.json").write_bytes(path.read_bytes())
    # Whatever a page is made of.
    run = read_run_folder(folder)
    assert isinstance((run.kind, run.title, run.notes), tuple)
    if refused is not None:
        raise refused
    return Read({})


def _page(name: str) -> Callable[[Path], Read]:
    """The page of a run, one file of whose folder is damaged."""

    def read(path: Path) -> Read:
        folder = path.parent / "page"
        shutil.copytree(ROOT / "results" / "ramp", folder, dirs_exist_ok=True)
        shutil.copyfile(path, folder / name)
        remake_page(folder)
        return Read({})

    return read


def _comparison(name: str) -> Callable[[Path], Read]:
    """A run and the same with a file damaged, side by side."""

    def read(path: Path) -> Read:
        folder = path.parent / "compared"
        shutil.copytree(ROOT / "results" / "ramp", folder, dirs_exist_ok=True)
        shutil.copyfile(path, folder / name)
        write_comparison(ROOT / "results" / "ramp", folder, path.parent / "comparison")
        return Read({})

    return read


def _toml(kind: str) -> bytes:
    """Small experiments that the check builds in no time."""
    geometry = '[geometry]\nsite = "CUT0"\nstart = "2017-11-21T00:00:00"\nepochs = 4\ninterval_s = 30.0\nepoch = 2\n'
    head = f'kind = "{kind}"\ntitle = "A title"\nalert = "LPV-200"\nseed = 7\nprecision = "float64"\n'
    methods = '\n[[methods]]\nname = "ls"\n\n[[methods]]\nname = "igg3"\nk0 = 1.5\nk1 = 3.0\n'
    faults = '\n[faults]\nsatellite = "G01"\nstart_m = 5.0\nstop_m = 100.0\nstep_m = 5.0\n'
    if kind == "service":
        return (head + 'step_deg = 30.0\nduration_s = 600.0\nstep_s = 300.0\noperations = ["LPV-200"]\n').encode()
    return (head + "draws = 1000\n\n" + geometry + faults + methods).encode()


def _manifest_text() -> bytes:
    import tomllib

    experiment = tomllib.loads(_toml("sweep").decode())
    content = {
        "name": "mine",
        "experiment": experiment,
        "inputs": {},
        "notes": ["A note."],
        "versions": {"python": "3.11.7"},
        "seconds": 1.25,
    }
    return (json.dumps(content, indent=2) + "\n").encode()


def _track_text(form: str) -> bytes:
    lines = ["time_gps_s,x_m,y_m,z_m" if form == "xyz" else "# week, seconds of week, latitude, longitude, height"]
    for k in range(12):
        if form == "xyz":
            lines.append(f"{receiver_files.NOON_GPS_S + k:.1f},{3582104.8991 + k:.4f},532590.1966,5232755.2961")
        else:
            lines.append(f"2111,{receiver_files.NOON_SOW + k:.3f},{55.5 + 1e-6 * k:.9f},8.456789012,60.125")
    return ("\n".join(lines) + "\n").encode()


@cache
def subjects() -> Mapping[str, Subject]:
    """All kinds of files, by name."""
    sky = _sky()
    observations, navigation = receiver_files.observation_text(sky), receiver_files.navigation_text(sky.orbits)
    obs, nav = observations.encode(), navigation.encode()
    obs_2, nav_2 = (
        rinex_versions.observations_2(observations).encode(),
        rinex_versions.navigation_2(navigation).encode(),
    )
    nav_4 = rinex_versions.navigation_4(navigation).encode()
    both, gps = ("G", "C"), ("G",)
    compact = hatanaka.rnx2crx(obs)
    made = (
        Subject("RINEX 3 observations", obs, _observations(nav, both), ".rnx", 1.0, same_values),
        Subject("RINEX 2.11 observations", obs_2, _observations(nav, gps), ".20o", 1.0, same_values),
        Subject("RINEX 3 navigation", nav, _navigation(obs, both), ".rnx", 1.0, same_numbers),
        Subject("RINEX 2.11 navigation", nav_2, _navigation(obs, gps), ".20n", 1.0, same_numbers),
        Subject("RINEX 4 navigation", nav_4, _navigation(obs, both), ".rnx", 1.0, same_numbers),
        Subject("gzip observations", gzip.compress(obs, mtime=0), _observations(nav, both), ".rnx.gz", 1.0),
        Subject("Hatanaka observations", compact, _observations(nav, both), ".crx", 1.0, _same_unpacked),
        Subject("YUMA almanac", yuma(elements(8)).encode(), _almanac, ".alm", 1e5, fewer_lines),
        Subject("SEM almanac", sem(elements(8)).encode(), _almanac, ".al3", 1e5, same_words),
        Subject("SP3 orbits", sp3(constellation(gps=4, galileo=0), epochs=12).encode(), _precise, ".sp3", 1.0),
        Subject("track, geodetic", _track_text("geodetic"), _track, ".csv", 1.0, fewer_lines),
        Subject("track, Earth-fixed", _track_text("xyz"), _track, ".csv", 1.0, fewer_lines),
        Subject("track, gzip", gzip.compress(_track_text("xyz"), mtime=0), _track, ".csv.gz", 1.0),
        Subject("ionosphere maps", _maps_text(), _maps(obs, nav), ".20i", 1.0),
        Subject("claims, RTKLIB", (CLAIMS / "esbjerg_llh.pos").read_bytes(), _claims, ".pos", 1.0, fewer_lines),
        Subject("track, NMEA", (CLAIMS / "esbjerg.nmea").read_bytes(), _track, ".nmea", 1.0, fewer_lines),
        Subject("error and noise model", _MODELS, _models, ".toml"),
        Subject("integrity support message", _ISM, _ism, ".csv"),
        Subject("experiment, sweep", _toml("sweep"), _experiment, ".toml"),
        Subject("experiment, service", _toml("service"), _experiment, ".toml"),
        Subject("manifest", _manifest_text(), _manifest, ".json"),
        *(
            Subject(f"page, {name}", (ROOT / "results" / "ramp" / name).read_bytes(), _page(name))
            for name in ("report.json", "manifest.json", "rates.csv", "summary.md")
        ),
        *(
            Subject(f"comparison, {name}", (ROOT / "results" / "ramp" / name).read_bytes(), _comparison(name))
            for name in ("report.json", "manifest.json", "rates.csv")
        ),
        *(
            Subject(f"experiment, {name}", (ROOT / "experiments" / f"{name}.toml").read_bytes(), _experiment, ".toml")
            for name in ("frontier", "integrity-risk", "time-ramps")
        ),
    )
    return {one.name: one for one in made}
