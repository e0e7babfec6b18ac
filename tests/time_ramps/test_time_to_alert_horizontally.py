"""Time to alert by the horizontal limit."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import AlertLimits
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.statistics import ls_quantities
from pl_mc.time_ramps import KalmanInnovation, SequentialParity

OPTIONS: dict[str, Any] = {
    "tau_s": 20.0, "draws": 64, "seed": 3, "onset_s": 5.0, "p_fa": 0.1, "calibration_draws": 128, "progress": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=36, interval_s=1.0)


def test_the_hazard_is_that_of_the_horizontal_error(series: pl_mc.Geometry) -> None:
    """A ramp of 5 m/s moves the mean horizontal error through the limit at a known time."""
    rate, hal_m = 5.0, 20.0
    alert = AlertLimits("rail", horizontal_m=hal_m)
    methods = ("ls", "slope", SequentialParity(windows_s=(1.0, 4.0)))
    table = pl_mc.time_to_alert(series, "G12", [rate], methods, alert=alert, **OPTIONS)
    assert set(table.axis) == {"horizontal"}
    gain = ls_quantities(series).horizontal_gain[:, :, series.names.index("G12")]
    seconds = np.arange(len(series)) - 5.0
    mean_m = np.hypot(*gain.T) * rate * np.maximum(seconds, 0.0)
    passed = seconds[np.argmax(mean_m > hal_m)]
    assert (table.hazards == OPTIONS["draws"]).all()
    # Noise of about a metre against two metres a second.
    after = table.alert_after_onset_50_s - table.alert_after_hazard_50_s
    np.testing.assert_allclose(after, passed, atol=2.0)


def test_the_level_is_the_horizontal_one(series: pl_mc.Geometry) -> None:
    """A threshold is a ratio of level and limit, so that it grows as the limit falls."""
    near, far = (
        pl_mc.time_to_alert(series, "G12", [3.0], ("ls",), alert=AlertLimits("x", None, hal_m), **OPTIONS).iloc[0]
        for hal_m in (10.0, 20.0)
    )
    assert near.threshold == pytest.approx(2.0 * far.threshold, rel=1e-12)
    assert near.hazards >= far.hazards


def test_the_vertical_named_is_the_vertical(series: pl_mc.Geometry) -> None:
    alone = pl_mc.time_to_alert(series, "G12", [3.0], ("ls",), **OPTIONS)
    named = pl_mc.time_to_alert(series, "G12", [3.0], ("ls",), axis="vertical", **OPTIONS)
    assert "axis" not in alone
    assert named.drop(columns="axis").equals(alone)


def test_what_cannot_be(series: pl_mc.Geometry) -> None:
    own = KalmanInnovation(windows_s=(1.0, 4.0), guards="filter")
    changes: list[tuple[dict[str, Any], str]] = [
        ({"axis": "either"}, "axis: a time to alert is that of one error; choose vertical or horizontal"),
        ({"axis": "vertical", "alert": "NPA"}, "axis: vertical needs a vertical limit, and NPA has HAL 556 m alone"),
        ({"methods": (own,), "axis": "horizontal"}, "axis: the position of a Kalman filter's own is vertical alone"),
    ]
    for change, words in changes:
        with pytest.raises(pl_mc.InputError, match=words):
            pl_mc.time_to_alert(series, "G12", [3.0], **OPTIONS | change)


def test_an_experiment_by_the_horizontal_limit(tmp_path: Path) -> None:
    content = {
        "kind": "time-ramps", "title": "rail", "seed": 3, "alert": {"name": "rail", "horizontal_m": 20.0},
        "geometry": {"epochs": 36, "interval_s": 1.0}, "satellite": "G12", "rates_m_per_s": [2.0, 5.0],
        "taus_s": [20.0], "draws": 64, "calibration_draws": 128, "p_fa": 0.1, "onset_s": 5.0,
        "methods": ["ls", "slope"], "sequential": [{"name": "sequential_parity", "windows_s": [1.0, 4.0]}],
    }  # fmt: skip
    folder = run_experiment("rail", build_experiment(content, source="test"), tmp_path / "out").folder
    said = (folder / "summary.md").read_text() + (folder / "report.json").read_text()
    assert not re.search("VAL|VPL|vertical", said)
    assert "its horizontal slope" in said
    assert "HAL 20 m" in said
    assert set(pd.read_csv(folder / "time_to_alert.csv").axis) == {"horizontal"}
    geometry = pd.read_csv(folder / "geometry.csv")
    assert (geometry.horizontal_metres_per_metre > 0).all()
    with pytest.raises(pl_mc.InputError, match="axes: this kind of experiment has one error and one level"):
        build_experiment(content | {"alert": "LPV-200", "axes": "either"}, source="test")
