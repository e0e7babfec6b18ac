"""Further geometries of a comparison: which they are, their false-alarm rates, and when an order holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.geometry.record import UP
from pl_mc.input_errors import InputError
from pl_mc.methods import MaxDop, Slope, WTest
from pl_mc.statistics import clopper_pearson
from pl_mc.studies.compare.day import DAY, WORST, comparable_elsewhere, further_geometries, significance_of_largest
from pl_mc.studies.compare.tables import mean_rates, orders
from pl_mc.studies.fault_fields import RampFaults

EVERY, DRAWS, SEED = 2, 300, 5
GEOMETRY = {"epochs": 5, "interval_s": 9_000.0, "epoch": 1}
RAMP = {"satellite": "G22", "otherwise": "median_redundancy", "start_m": 10.0, "stop_m": 20.0, "step_m": 10.0}
SMALL = {
    "kind": "compare", "title": "small", "draws": 700, "seed": SEED, "geometry": GEOMETRY, "faults": RAMP,
    "methods": [{"name": "ls"}], "day": {"every": EVERY, "draws": DRAWS, "equal_draws": DRAWS},
    "equal": {
        "p_fa": 0.05, "draws": 700, "faults": RAMP | {"start_m": 4.0, "stop_m": 8.0, "step_m": 4.0},
        "methods": [{"name": "slope"}, {"name": "max_dop", "p_fa": 0.2}],
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=5, interval_s=9_000.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("compare-day") / "out"
    # Figures are made and not drawn, which takes longer than all the rest.
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("pl_mc.report.files.save_figure", lambda *_: None)
        run_experiment("small", build_experiment(SMALL, source="test"), out)
    return out


def vertical(g: pl_mc.Geometry) -> tuple[float, str]:
    """Standard deviation of the vertical error, and the satellite that moves it most, from the pseudoinverse."""
    gain = np.linalg.pinv(g.design / g.sigma_m[:, None])[UP] / g.sigma_m
    return float(np.linalg.norm(gain * g.sigma_m)), g.names[int(np.argmax(np.abs(gain)))]


def test_geometries_are_the_extremes_and_the_sample_with_the_worst_satellites(series: pl_mc.Geometry) -> None:
    found = {place.name: place for place in further_geometries(series, EVERY)}
    sigma = [vertical(series[k])[0] for k in range(len(series))]
    order = np.argsort(sigma)
    for name, place in (("strongest", 0), ("median", 2), ("weakest", 4)):
        assert found[name].g.epoch.tolist() == [order[place]]
        assert found[name].satellite == vertical(series[int(order[place])])[1]
    day = found[DAY]
    assert day.g.epoch.tolist() == [0, 2, 4]
    assert day.true_names == tuple(vertical(series[k])[1] for k in (0, 2, 4))
    ramp = RampFaults(satellite="G22", start_m=10.0, stop_m=10.0, step_m=1.0)
    assert day.faults(ramp).applies(day.g).all()
    with pytest.raises(InputError, match="day: at least three epochs"):
        further_geometries(series[:2], 1)


def test_the_day_counts_what_sweeps_of_its_epochs_count(folder: Path, series: pl_mc.Geometry) -> None:
    rates = pd.read_csv(folder / "day_rates.csv", keep_default_na=False)
    of_day = rates[(rates.geometry == DAY) & (rates.fault != "none")].set_index("bias_m")
    total = dict.fromkeys((10.0, 20.0), 0)
    for k in (0, 2, 4):
        faults = pl_mc.ramp(series, satellite=vertical(series[k])[1], start_m=10.0, stop_m=20.0, step_m=10.0)
        table = pl_mc.sweep(
            series[k : k + 1], faults, draws=DRAWS, seed=SEED, methods=("ls",), progress=False
        ).set_index("bias_m")
        for bias in total:
            total[bias] += int(table.alarms[bias])
    assert {bias: int(of_day.alarms[bias]) for bias in total} == total
    assert sum(total.values()) > 0
    assert set(of_day.draws) == {3 * DRAWS}
    assert all(label.startswith(WORST) for label in of_day.fault)


def test_the_summary_has_all_geometries_and_tests_of_one_rate(folder: Path) -> None:
    overview = pd.read_csv(folder / "overview.csv")
    names = ["epoch 1", "strongest", "median", "weakest", DAY]
    assert list(dict.fromkeys(overview.geometry)) == names
    tests = pd.read_csv(folder / "equal.csv")
    # The test with a rate of its own is compared nowhere, and asked for at the experiment's epoch alone.
    assert set(tests.geometry[tests.method == "max_dop(p_fa=0.2)"]) == {"epoch 1"}
    assert not tests.fits[tests.method == "max_dop(p_fa=0.2)"].any()
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert "## Findings at epoch 1" in text
    assert "another rate" in text
    assert text.index("## Over the day") < text.index("## Findings at epoch 1")


def test_the_largest_w_keeps_its_false_alarm_rate(series: pl_mc.Geometry, monkeypatch: pytest.MonkeyPatch) -> None:
    """By other draws; and with one redundant satellite, where all |w| are one number, it is the rate itself."""
    p_fa, draws, behind, g = 0.01, 100_000, 200_000, series[0]
    monkeypatch.setattr("pl_mc.studies.compare.day._CALIBRATION", behind)
    alpha = significance_of_largest(g, p_fa, seed=3)
    (test,) = comparable_elsewhere([WTest(exclusions=0, final="local"), MaxDop(p_fa=0.2)], p_fa, g, seed=3)
    assert test.alpha == alpha
    assert comparable_elsewhere([Slope(p_fa=p_fa), WTest()], p_fa, g, seed=3) == (Slope(p_fa=p_fa),)
    whitened = g.design / g.sigma_m[:, None]
    maker = np.eye(len(g.names)) - whitened @ np.linalg.pinv(whitened)
    noise = np.random.default_rng(77).standard_normal((draws, len(g.names)))
    alarms = (np.abs(noise @ maker / np.sqrt(np.diag(maker))).max(axis=1) > test.quantile).mean()
    # Five standard errors of both countings.
    assert abs(alarms - p_fa) < 5 * np.sqrt(p_fa / draws + p_fa / behind)
    rows = np.array([0, 1, 2, 3, g.systems.index("C"), len(g.names) - 1])
    one = pl_mc.Geometry.from_arrays(
        g.design[rows], g.sigma_m[rows], [g.systems[k] for k in rows], [g.names[k] for k in rows]
    )
    assert abs(significance_of_largest(one, p_fa, seed=3) - p_fa) < 5 * np.sqrt(p_fa / behind)


def test_orders_hold_or_turn_where_bounds_lie_apart() -> None:
    """a, b, c with means of 1, 10 and 30 % at first; b and c change places, a and b come too near."""
    rows = []
    for geometry, means in (("first", (0.01, 0.10, 0.30)), ("second", (0.09, 0.30, 0.10))):
        for method, mean in zip("abc", means, strict=True):
            for fault, rate in (("none", 0.9), ("+5m", 0.5 * mean), ("+10m", 1.5 * mean)):
                rows.append({"geometry": geometry, "method": method, "fault": fault, "draws": 1000,
                             "missed_rate": rate})  # fmt: skip
    means = mean_rates(pd.DataFrame(rows), ["missed"])
    first = means[(means.geometry == "first") & (means.method == "b")].iloc[0]
    # 10 % of a thousand draws, not of two thousand.
    low, high = clopper_pearson(100, 1000)
    assert (first.rate, first.low, first.high) == pytest.approx((0.1, float(low), float(high)))
    assert first["rank"] == 2
    same, turned = orders(means, "missed", "first", "second")
    assert set(same) == {("a", "b")}
    assert set(turned) == {("b", "c")}
