"""Experiment files and manifests beyond all bounds, and values in every form: a sentence, soon."""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.cli.main import main
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import load_experiment
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.studies.fault_fields import RampFaults

SOUND = """kind = "sweep"
title = "mine"
draws = 1000
seed = 7
methods = [{name = "ls"}]

[geometry]
start = "2017-11-21"
epochs = 4
epoch = 2

[faults]
satellite = "G01"
start_m = 5
stop_m = 100
step_m = 5
"""


def written(text: str, folder: Path, name: str = "mine.toml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def changed(old: str, new: str) -> str:
    assert old in SOUND
    return SOUND.replace(old, new, 1)


def manifest(**fields: object) -> str:
    return json.dumps({"name": "mine", "experiment": {"kind": "sweep"}} | fields)


def refused(path: str) -> str:
    """What is said of a file, by ``check`` and by ``run`` alike; it takes neither time nor memory."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said = []
    try:
        said.append(check_experiment(path).text())
    except InputError as error:
        said.append(str(error))
    with pytest.raises(InputError) as caught:
        load_experiment(path)
    said.append(str(caught.value))
    assert all(said)
    assert all(line.endswith((".", "?")) for text in said for line in text.split("\n"))
    assert max(map(len, said)) < 30_000
    assert time.perf_counter() - begin < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000
    return said[1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (changed("1000", "9" * 5001), "a number has too many digits"),
        (changed("1000", "1" + "0" * 400), "draws: a whole number of at most 274877906944 is needed"),
        (changed("1000", "1e18"), "draws: a whole number of at most 274877906944 is needed"),
        (changed("1000", "1_000_000_000_000"), "draws: a whole number of at most"),
        (changed("1000", '"1000"'), "draws: a number is needed, not '1000'"),
        (changed("1000", "true"), "draws: a number is needed, not True"),
        (changed("1000", "1000.5"), "draws: "),
        (changed("7", "1" + "0" * 400), "seed: "),
        (changed("stop_m = 100", "stop_m = 1" + "0" * 400), "faults.stop_m: "),
        (changed("epochs = 4", "epochs = " + "8" * 4000), "geometry.epochs: "),
        (changed("1000", "[" * 900 + "]" * 900), "nested too deeply"),
        (changed("1000", "{a = " * 900 + "1" + "}" * 900), "nested too deeply"),
        (changed('title = "mine"', f'title = "mine"\n{"x" * 100_000} = 1'), "there is no such field"),
        ("".join(f"field_{k} = 1\n" for k in range(20_000)) + SOUND, "And .* more"),
        ("\n" * 9_000_000, "more than 8 MB"),
        ('kind = "Map"', "kind: 'Map' is unknown .nearest: map"),
        ('title = "mine"', "kind: it has to be given .valid: compare"),
        (changed('"ls"', '"igg3(k0=2)"'), None),
    ],
)
def test_files_beyond_all_bounds(text: str, words: str | None, tmp_path: Path) -> None:
    path = written(text, tmp_path)
    if words is None:
        (problem,) = check_experiment(path).problems
        assert 'options do not stand in a name; in an experiment file they are fields beside name = "igg3"' in (
            problem.reason
        )
        return
    with pytest.raises(InputError, match=words):
        raise InputError(refused(path))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 900 + "]" * 900, "nested too deeply"),
        ('{"name": ' + "9" * 5001 + "}", "too many digits"),
        (manifest(name=None), "name: the name of a folder is needed"),
        (manifest(name=7), "name: the name of a folder is needed"),
        (manifest(experiment=[]), "no manifest of a run"),
        (manifest(experiment={"kind": "sweep", "draws": 10**400}), "draws: "),
        ("[]", "no manifest of a run"),
        ("null", "no manifest of a run"),
        ('{"name": "a", ', "it is not JSON"),
    ],
)
def test_manifests_beyond_all_bounds(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        raise InputError(refused(written(text, tmp_path, "manifest.json")))


def _pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe.toml")
    return folder / "pipe.toml"


def _device(folder: Path) -> Path:
    (folder / "zero.toml").symlink_to("/dev/zero")
    return folder / "zero.toml"


def _folder(folder: Path) -> Path:
    (folder / "folder.json").mkdir()
    return folder / "folder.json"


def _nul(folder: Path) -> Path:
    return folder / "a\0b.toml"


@pytest.mark.parametrize("make", [_pipe, _device, _folder, _nul])
def test_what_is_no_file(make: Callable[[Path], Path], tmp_path: Path) -> None:
    assert "cannot be read" in refused(str(make(tmp_path)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "ramp", "--shard", "²/³"], "shard: i/n is needed"),
        (["run", "ramp", "--shard", f"{'1' * 5000}/{'9' * 5000}"], "shard: i/n is needed"),
        (["run", "ramp", "--scheduler", "local:²"], "local:N needs a number of processes"),
        (["run", "ramp", "--draws", "²"], "'²' is no whole number"),
        (["run", "ramp", "--draws", "1.5"], "'1.5' is no whole number"),
        (["run", "ramp", "--draws", "1e18"], "draws: a whole number of at most"),
        (["run", "ramp", "--draws", "9" * 5001], "is no whole number"),
        (["run", "ramp", "--out", "a\0b"], "NUL"),
        (["check", "ramp", "--draws", "1e400"], "'1e400' is no whole number"),
    ],
)
def test_arguments_beyond_all_bounds(
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert not any(tmp_path.rglob("*.html"))


@pytest.mark.parametrize(
    "text",
    [
        changed("1000", "1e3"),
        changed("1000", "1000.0"),
        changed('[{name = "ls"}]', '"ls"'),
        changed('[{name = "ls"}]', '["ls"]'),
        changed('"2017-11-21"', "2017-11-21"),
        changed('"2017-11-21"', "2017-11-21T00:00:00"),
        changed("epochs = 4", 'epochs = 4\nconstellations = ["GPS", "BDS-2"]'),
    ],
)
def test_one_rule_in_files(text: str, tmp_path: Path) -> None:
    """Numbers, dates and names in every form are the same experiment."""
    one, other = (load_experiment(written(each, tmp_path, f"{k}.toml"))[1] for k, each in enumerate((SOUND, text)))
    start = gps_seconds(one.geometry.start)  # type: ignore[attr-defined]
    assert gps_seconds(other.geometry.start) == start  # type: ignore[attr-defined]
    same = {"geometry": {"start"}}
    assert one.model_dump(exclude=same) == other.model_dump(exclude=same)


def test_one_rule_in_python() -> None:
    g = pl_mc.simulate(site="CUT0", epochs=1)[0]
    faults = pl_mc.no_fault(g)
    given = [(1e2, ("ls",), pl_mc.LPV_200), (np.int64(100), "ls", "LPV-200"), (100, pl_mc.ls(), "LPV-200")]
    one, *others = (pl_mc.sweep(g, faults, draws=n, seed=np.uint8(1), methods=m, alert=a) for n, m, a in given)  # type: ignore[arg-type]
    for other in others:
        pd.testing.assert_frame_equal(one, other)
    assert "is not judged" in one.attrs["unjudged"]
    for date in (
        "2017-11-21",
        np.datetime64("2017-11-21"),
        pd.Timestamp("2017-11-21"),
        pd.Timestamp("2017-11-21").date(),
    ):
        np.testing.assert_array_equal(pl_mc.simulate(start=date, epochs=1).design[0], g.design)


@pytest.mark.parametrize("name", ["G99", "G33", "G00", "X01", "g01", "G1", "", "R28"])
def test_no_fallback_for_a_satellite_that_does_not_exist(name: str) -> None:
    g = pl_mc.simulate(site="CUT0", epochs=1)[0]
    sizes = {"start_m": 5.0, "stop_m": 10.0, "step_m": 5.0}
    with pytest.raises(InputError, match=f"satellite: '{name}' is no satellite that exists .nearest|valid"):
        RampFaults(satellite=name, otherwise="median_redundancy", **sizes).build(g)
    hidden = next(f"G{k:02d}" for k in range(1, 33) if f"G{k:02d}" not in g.names)
    _, (note,) = RampFaults(satellite=hidden, otherwise="median_redundancy", **sizes).build(g)
    assert f"{hidden} is out of view" in note


def test_a_satellite_twice() -> None:
    g = pl_mc.simulate(site="CUT0", epochs=1)[0]
    with pytest.raises(InputError, match="satellites: 'G01' is named twice"):
        pl_mc.ramps(g, satellites=["G01", "G01"], start_m=0, stop_m=5, step_m=5)


def test_a_manifest_of_the_first_version_means_ten_iterations(tmp_path: Path) -> None:
    """Its default is another one today; what was told stays, and so do methods whose default is what it was."""
    experiment = {
        "kind": "sweep",
        "title": "T",
        "methods": [*({"name": one} for one in ("ls", "igg3", "mm", "l1")), {"name": "huber", "iterations": 5}],
        "geometry": {"epochs": 1, "epoch": 0},
        "draws": 10,
        "faults": {"satellite": "G02", "start_m": 5.0, "stop_m": 10.0, "step_m": 5.0},
    }
    place = tmp_path / "manifest.json"
    for version, ten in (("0.1.0", "(iterations=10)"), ("0.2.0", "")):
        content = {"name": "t", "experiment": experiment, "versions": {"pl_mc": version}}
        place.write_text(json.dumps(content), encoding="utf-8")
        _, record = load_experiment(str(place))
        names = ["ls", f"igg3{ten}", f"mm{ten}", "l1", "huber(iterations=5)"]
        assert [method.name for method in record.method_records()] == names
