"""The experiments after figure 6: a ramp with every satellite of its epoch, and maps over a series."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError

SMALL = {
    "title": "small",
    "draws": 300,
    "seed": 3,
    "geometry": {"epochs": 3, "interval_s": 7200.0},
    "faults": {"start_m": 10.0, "stop_m": 40.0, "step_m": 30.0},
}


def test_a_ramp_with_every_satellite(tmp_path: Path) -> None:
    content = SMALL | {
        "kind": "satellite-ramps",
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


def test_the_median_satellite_stands_in_and_is_named(tmp_path: Path) -> None:
    name, experiment = load_experiment("zhao2021-ramp", {"draws": 10, "draws_per_satellite": 5})
    result = run_experiment(name, experiment, tmp_path / "out")
    # At this epoch of the nominal constellation G02 is below the horizon.
    g = pl_mc.simulate(epochs=546)[545]
    assert "G02" not in g.names
    redundancy = {n: r for n, r in zip(g.names, pl_mc.geometry.redundancy_numbers(g), strict=True) if n[0] == "G"}
    below = sorted(redundancy.values())
    chosen = next(n for n, r in redundancy.items() if r == below[(len(below) - 1) // 2])
    assert any(note.startswith(f"Faulted satellite: {chosen} (G02 is out of view") for note in result.notes)


def test_a_map_sums_what_the_sweep_counts(tmp_path: Path) -> None:
    experiment = build_experiment(SMALL | {"kind": "map"}, source="test")
    run_experiment("small", experiment, tmp_path / "out")
    places = pd.read_parquet(tmp_path / "out" / "by_epoch_satellite.parquet")
    g = pl_mc.simulate(epochs=3, interval_s=7200.0)
    assert len(places) == 2 * int(g.satellite_count.sum())
    assert (places.draws == 2 * 300).all()
    assert (places.independent_draws == 300).all()
    faults = pl_mc.ramps(g, satellites=g.names, start_m=10.0, stop_m=40.0, step_m=30.0)
    rates = pl_mc.sweep(g, faults, draws=300, seed=3)
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
    content = SMALL | {
        "kind": "satellite-ramps",
        "draws_per_satellite": 5,
        "faults": SMALL["faults"] | {"satellite": "G02"},
    }
    with pytest.raises(InputError, match=r"geometry\.epoch"):
        run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
