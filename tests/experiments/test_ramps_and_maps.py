"""The views of a sweep after figure 6: a ramp with every satellite of its epoch, and maps over a series."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment, field_problems, load_experiment
from pl_mc.experiments.running import merge, run_experiment, run_shard
from pl_mc.input_errors import InputError
from pl_mc.studies.sweep import STUDY
from reference.small_sweep import counted_calls, cut

# Experiments as the version stored them that had a kind for each of these views.
FORMER = Path(__file__).parent

# Three plain solutions are compiled in a part of the time that the settled default takes, which the former runs have.
METHODS = ("ls", pl_mc.igg3(iterations=3))
SMALL: dict[str, Any] = {
    "kind": "sweep",
    "methods": ["ls", {"name": "igg3", "iterations": 3}],
    "title": "small",
    "draws": 300,
    "seed": 3,
    "geometry": {"epochs": 3, "interval_s": 7200.0},
    "faults": {"start_m": 10.0, "stop_m": 40.0, "step_m": 30.0},
}


def test_a_ramp_with_every_satellite(tmp_path: Path) -> None:
    content = SMALL | {
        "view": "satellites",
        "draws_per_satellite": 50,
        "geometry": {"epochs": 3, "interval_s": 7200.0, "epoch": 1},
        "faults": SMALL["faults"] | {"satellite": "G02", "otherwise": "median_redundancy"},
    }
    result = run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    ramp = pd.read_csv(tmp_path / "out" / "ramp.csv", keep_default_na=False)
    assert list(ramp[ramp.method == "ls"].bias_m.astype(float)) == [0.0, 10.0, 40.0]
    satellites = pd.read_csv(tmp_path / "out" / "ramp_satellites.csv")
    g = pl_mc.simulate(epochs=3, interval_s=7200.0)[1]
    assert sorted(satellites.satellite.unique()) == sorted(g.names)
    assert (satellites.draws == 50).all()
    assert len(satellites) == 2 * 2 * len(g.names)
    # The faulted satellite's own ramp saw the first of the same draws.
    assert set(ramp.fault.str[:3]) - {"non"} <= set(satellites.fault.str[:3])
    facts = pd.read_csv(tmp_path / "out" / "satellites.csv")
    # One metre on every satellite alike moves the clock alone.
    assert facts.vertical_metres_per_metre.sum() == pytest.approx(0.0, abs=1e-9)
    assert facts.redundancy.sum() == pytest.approx(len(g.names) - g.design.shape[1])
    for figure in ("fig6_vpl_against_bias", "ramp_rates", "ramp_satellites"):
        assert (tmp_path / "out" / f"{figure}.png").stat().st_size > 10_000
    assert "Student's t" in result.summary


@pytest.mark.usefixtures("without_figures")
def test_the_median_satellite_stands_in_and_is_named(tmp_path: Path) -> None:
    name, experiment = load_experiment("zhao2021-ramp", {"draws": 10, "draws_per_satellite": 5, "methods": ["ls"]})
    result = run_experiment(name, experiment, tmp_path / "out")
    # At this epoch of the nominal constellation G02 is below the horizon.
    g = pl_mc.simulate(epochs=546)[545]
    assert "G02" not in g.names
    redundancy = {n: r for n, r in zip(g.names, pl_mc.geometry.redundancy_numbers(g), strict=True) if n[0] == "G"}
    below = sorted(redundancy.values())
    chosen = next(n for n, r in redundancy.items() if r == below[(len(below) - 1) // 2])
    assert any(note.startswith(f"Faulted satellite: {chosen} (G02 is out of view") for note in result.notes)


@pytest.mark.usefixtures("without_figures")
def test_a_map_sums_what_the_sweep_counts(tmp_path: Path) -> None:
    experiment = build_experiment(SMALL | {"view": "map"}, source="test")
    run_experiment("small", experiment, tmp_path / "out")
    places = pd.read_parquet(tmp_path / "out" / "by_epoch_satellite.parquet")
    g = pl_mc.simulate(epochs=3, interval_s=7200.0)
    assert len(places) == 2 * int(g.satellite_count.sum())
    assert (places.draws == 2 * 300).all()
    assert (places.independent_draws == 300).all()
    faults = pl_mc.ramps(g, satellites=g.names, start_m=10.0, stop_m=40.0, step_m=30.0)
    rates = pl_mc.sweep(g, faults, draws=300, seed=3, methods=METHODS)
    for name, column in (("by_bias", "bias_m"), ("by_satellite", "satellite")):
        table = pd.read_csv(tmp_path / "out" / f"{name}.csv")
        assert table.alarms.sum() == rates.alarms.sum() == places.alarms.sum()
        assert table.draws.sum() == rates.draws.sum()
        assert table[column].nunique() == (2 if name == "by_bias" else len(g.names))
        for event in ("alarm", "misleading"):
            assert (table[f"{event}_low"] <= table[f"{event}_rate"]).all()
            assert (table[f"{event}_rate"] <= table[f"{event}_high"]).all()
    # Nothing seen is a bound from the independent draws, not from all of them.
    by_bias = pd.read_csv(tmp_path / "out" / "by_bias.csv")
    unseen = by_bias[by_bias.missed == 0]
    assert (unseen.independent_draws == 900).all()
    np.testing.assert_allclose(unseen.missed_high, 1 - 0.025 ** (1 / 900), rtol=1e-9)


def test_a_ramp_of_satellites_needs_one_epoch(tmp_path: Path) -> None:
    content = SMALL | {"view": "satellites", "draws_per_satellite": 5, "faults": SMALL["faults"] | {"satellite": "G02"}}
    with pytest.raises(InputError, match=r"geometry\.epoch"):
        run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


SATELLITES = {"view": "satellites", "draws_per_satellite": 5, "geometry": {"epochs": 3, "epoch": 1}}


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"draws_per_satellite": 5}, "draws_per_satellite", "in the view faults (nearest: view = 'satellites'), not 5"),
        ({"view": "map", "draws_per_satellite": 5}, "draws_per_satellite", "in the view map"),
        ({"view": "satellites", "geometry": {"epoch": 1}}, "draws_per_satellite", "field required"),
        (SATELLITES | {"geometry": {"epochs": 3}}, "geometry.epoch", "one epoch of 0 to 2 (nearest: 2), not None"),
        ({"view": "maps"}, "view", "'faults', 'satellites' or 'map', not 'maps'"),
        ({}, "faults.satellite", "field required"),
        (SATELLITES, "faults.satellite", "field required"),
        (SATELLITES | {"faults": {"biases": [{}]}}, "faults.biases", "view satellites (nearest: view = 'faults')"),
        ({"view": "map", "faults": {"biases": [{}]}}, "faults.biases", "in the view map (nearest: view = 'faults')"),
        ({"view": "map", "faults": SMALL["faults"] | {"satellite": "G02"}}, "faults.satellite", "not 'G02'"),
        ({"view": "map", "faults": {"start_m": 1.0, "stop_m": 2.0}}, "faults.step_m", "field required"),
        ({"view": "map", "faults": SMALL["faults"] | {"stepm": 1.0}}, "faults.stepm", "nearest: step_m"),
        ({"view": "map", "noise": {"name": "student_t", "nu": 4}}, "noise", "nearest: {'name': 'gaussian'}"),
        (SATELLITES | {"noise": {"name": "laplace"}}, "noise", "the view satellites is of Gaussian noise alone"),
    ],
)
def test_what_has_no_effect_in_a_view_is_refused(changes: dict[str, Any], field: str, words: str) -> None:
    problems = {one.field: one.reason for one in field_problems(SMALL | changes)}
    assert words in problems[field]
    assert problems[field].count(".") == 1
    assert problems[field].endswith(".")


def test_every_wrong_field_of_a_view_is_named_at_once() -> None:
    wrong = SMALL | {"view": "map", "drows": 1, "draws_per_satellite": 5, "noise": {"name": "laplace"}}
    assert [one.field for one in field_problems(wrong)] == ["draws_per_satellite", "noise", "drows"]


def small_of(view: str) -> dict[str, Any]:
    """A small experiment of a view."""
    if view == "map":
        return SMALL | {"view": "map"}
    of_one = SMALL | {"geometry": SMALL["geometry"] | {"epoch": 1}, "faults": SMALL["faults"] | {"satellite": "G20"}}
    return of_one | ({"view": view, "draws_per_satellite": 50} if view == "satellites" else {})


@pytest.mark.parametrize("view", ["faults", "satellites", "map"])
def test_a_run_of_the_study_writes_nothing_but_its_parts(
    view: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = build_experiment(small_of(view), source="test")
    findings = STUDY.run(experiment, Execution(folder=tmp_path / "parts"))
    assert [path.name for path in tmp_path.iterdir()] == ["parts"]
    named = {planned.name for planned in STUDY.sweeps(experiment)}  # type: ignore[misc]
    assert {path.name for path in (tmp_path / "parts").iterdir()} == named
    titles = [table.chart.title for table in findings.tables if table.chart is not None]
    assert len(titles) == len(set(titles)) > 0
    # Tables that are read back from files say the same.
    for name, table in findings.data.items():
        table.to_csv(f"{name}.csv", index=False)
    read = {name: pd.read_csv(f"{name}.csv", keep_default_na=False, na_values=[""]) for name in findings.data}
    assert STUDY.answer(read, experiment) == STUDY.answer(findings.data, experiment)


@pytest.mark.drawn
@pytest.mark.parametrize(("former", "view"), [("satellite_ramps", "satellites"), ("map", "map")])
def test_what_was_begun_under_a_former_kind_goes_on(former: str, view: str, tmp_path: Path) -> None:
    """Its manifest runs, its unfinished folder is resumed and its shares are merged, with the same results."""
    record = FORMER / f"former_{former}.json"
    assert json.loads(record.read_text())["experiment"]["kind"] == former.replace("_", "-")
    name, experiment = load_experiment(str(record))
    assert (experiment.kind, experiment.view) == ("sweep", view)  # type: ignore[attr-defined]
    with cut(1, 1):
        whole = run_experiment(name, experiment, tmp_path / "whole").folder
        shares = [tmp_path / "first", tmp_path / "second"]
        for k, share in enumerate(shares, start=1):
            folder = run_shard(name, experiment, share, Execution(shard=(k, 2))).folder
            shutil.copy(record, folder / "experiment.json")
        shutil.copytree(tmp_path / "first.unfinished", tmp_path / "resumed.unfinished")
        with counted_calls() as calls:
            merge(shares, tmp_path / "merged")
            assert calls == []
            run_experiment(name, experiment, tmp_path / "resumed", execution=Execution(resume=True))
            assert 0 < len(calls) < len(list(tmp_path.glob("*.unfinished/*/part-*.parquet")))
    for path in whole.rglob("*"):
        if path.is_file() and path.name not in ("manifest.json", "report.html"):
            for other in ("merged", "resumed"):
                assert (tmp_path / other / path.relative_to(whole)).read_bytes() == path.read_bytes(), path
