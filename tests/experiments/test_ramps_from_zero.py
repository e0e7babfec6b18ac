"""Ramps from zero on every satellite: what they have without a fault is one case, and no satellite's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError

DRAWS = 100
ZERO: dict[str, Any] = {
    "kind": "sweep", "title": "from zero", "methods": ["ls"], "draws": DRAWS, "seed": 3,
    "geometry": {"epochs": 2, "interval_s": 7200.0}, "faults": {"start_m": 0.0, "stop_m": 60.0, "step_m": 30.0},
}  # fmt: skip
OF_ONE = {
    "view": "satellites", "draws_per_satellite": DRAWS, "geometry": ZERO["geometry"] | {"epoch": 1},
    "faults": ZERO["faults"] | {"satellite": "G01", "otherwise": "median_redundancy"},
}  # fmt: skip


def test_every_satellite_of_an_epoch_has_its_faults_alone(tmp_path: Path) -> None:
    result = run_experiment("zero", build_experiment(ZERO | OF_ONE, source="test"), tmp_path / "out")
    g = pl_mc.simulate(epochs=2, interval_s=7200.0)[1]
    table = pd.read_csv(tmp_path / "out" / "ramp_satellites.csv")
    assert table[["satellite", "bias_m"]].to_numpy().tolist() == [[name, size] for name in g.names for size in (30, 60)]
    # The ramp beside has the case without a fault.
    assert pd.read_csv(tmp_path / "out" / "ramp.csv", keep_default_na=False).fault[0] == "none"
    assert not [note for note in result.notes if "could not be drawn" in note]


def test_a_map_has_the_case_without_a_fault_once_and_on_no_satellite(tmp_path: Path) -> None:
    result = run_experiment("zero", build_experiment(ZERO | {"view": "map"}, source="test"), tmp_path / "out")
    g = pl_mc.simulate(epochs=2, interval_s=7200.0)
    of_bias = pd.read_csv(tmp_path / "out" / "by_bias.csv")
    of_satellite = pd.read_csv(tmp_path / "out" / "by_satellite.csv")
    in_view = int(g.satellite_count.sum())
    assert of_bias.draws.tolist() == [2 * DRAWS, in_view * DRAWS, in_view * DRAWS]
    assert (of_bias.independent_draws == 2 * DRAWS).all()
    assert not set(of_satellite.satellite) - set(g.names)
    assert of_satellite.draws.sum() == 2 * in_view * DRAWS
    assert not [note for note in result.notes if "could not be drawn" in note]


@pytest.mark.parametrize("view", [OF_ONE, {"view": "map"}], ids=["satellites", "map"])
def test_nothing_but_zero_is_refused(view: dict[str, Any], tmp_path: Path) -> None:
    content = ZERO | view
    content |= {"faults": content["faults"] | {"stop_m": 0.0}}
    with pytest.raises(InputError, match=r"faults\.stop_m: .* above zero \(nearest: 30\), not 0"):
        run_experiment("zero", build_experiment(content, source="test"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
