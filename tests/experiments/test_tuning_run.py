"""The experiment about tuned limits: its table against the engine and exact rates, its words, bad input."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.tuning import tune
from pl_mc.methods import Igg3

# Draws are many here, and compilations few.
pytestmark = pytest.mark.counting

# Seven satellites: of pairs there are a sixth as many as of sixteen.
SKY = {"epochs": 1, "constellations": ("GPS",), "without": ("G19",)}
# The room exports the function under the name of its file.
TUNE = sys.modules[tune.__module__]

TUNING = {
    "kind": "tuning",
    "title": "small",
    "seed": 5,
    "geometry": SKY | {"epoch": 0},
    "targets": [1e-2],
    "objectives": ["vpl"],
    # Which is tuned is no matter; ten plain solutions are compiled and solved sooner than the settled ones.
    "methods": ["ls", {"name": "igg3", "iterations": 10}],
    "faults": [{"G22": 5.0}],
    "draws": 4096,
    "search_draws": 1024,
    "steps": 4,
    "target_cov": 0.3,
    "max_evaluations": 500_000,
    "worst": [2],
}


def test_the_tuning_experiment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # One descent says as much here as three.
    monkeypatch.setattr(TUNE, "_STARTS", ())
    result = run_experiment("small", build_experiment(TUNING, source="test"), tmp_path / "out")
    g = pl_mc.simulate(**SKY)[0]
    table = pd.read_csv(tmp_path / "out" / "tuned.csv", keep_default_na=False, na_values=[""])
    rows = table.set_index("limits")
    assert list(rows.index) == ["exact", "start", "tuned"]
    # Least squares: the multiplier of the calibration, mean level and alarms against draws.
    faults = pl_mc.biases(g, {"G22": 5.0})
    expected = pl_mc.calibrate(g, method="ls", target=1e-2, faults=faults, event="misleading")
    exact = rows.loc["exact"]
    assert exact.k_vertical == pytest.approx(expected.k_vertical.max(), rel=1e-9)
    tuned = rows.loc["tuned"]
    methods = [
        pl_mc.ls(k_vertical=exact.k_vertical),
        Igg3(k0=tuned.k0, k1=tuned.k1, k_vertical=tuned.k_vertical, iterations=10),
    ]
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), draws=4096, seed=1, methods=methods)
    for row, (_, part) in zip((exact, tuned), drawn.groupby("method", sort=False), strict=True):
        error = part.vpl_m.std() / math.sqrt(4096)
        # Both means are of as many draws, one of them exact: at the most root two, one in a million.
        assert abs(part.vpl_m.mean() - row.vpl_m) < 4.9 * math.sqrt(2.0) * error
    # What tuning is for: a lower level at the same risk, on draws of its own.
    assert tuned.change < 2.0 * tuned.change_error
    assert rows.loc["start", ["k0", "k1"]].tolist() == [1.5, 5.0]
    limit = 4096 * 1e-2 + 4.9 * math.sqrt(4096 * 1.6e-2)
    assert (rows.risk.iloc[1:] * 4096 < limit).all()
    np.testing.assert_array_equal(rows.alarms.iloc[1:] / rows.draws.iloc[1:], rows.alarm_rate.iloc[1:])
    assert "At 0.01: mean level" in result.summary
    assert "Least squares: a mean VPL" in result.summary
    # The worst pair of each, with the multiplier that it has; that of least squares is exact.
    worst = pd.read_csv(tmp_path / "out" / "worst.csv").set_index("limits")
    assert list(worst.index) == ["exact", "start", "tuned"]
    pairs = pl_mc.worst_case(g, method=methods[0], satellites=2, event="misleading")
    assert worst.loc["exact", "fault"] == pairs.fault.iloc[0]
    assert worst.loc["exact", "probability"] == pytest.approx(pairs.probability.iloc[0], rel=1e-9)
    assert (worst.probability > 0).all()
    assert "two satellites" in result.summary
    assert (tmp_path / "out" / "tuning.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"geometry": {"epochs": 2}}, r"geometry\.epoch"),
        ({"methods": [{"name": "huber"}]}, "methods: this takes igg3"),
        ({"faults": [{"G99": 1.0}]}, "'G99' is not in view"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path: Path, change: dict, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        run_experiment("small", build_experiment(TUNING | change, source="test"), tmp_path / "out")
    assert "\n" not in str(caught.value)
