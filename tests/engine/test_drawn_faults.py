"""Faults whose sizes are drawn: held to exact laws, the same whatever counts them, and nothing else is changed."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.engine.drawn_biases import bias_numbers
from pl_mc.engine.stanford import Grid, stanford_counts
from pl_mc.engine.swamping import watch_weights
from pl_mc.engine.table import COUNT_COLUMNS
from pl_mc.kernels.noise import epoch_key, unit_inputs
from pl_mc.methods import Igg3, as_methods
from pl_mc.runtime.precision import precision_scope

# Few solutions: what is counted here is who draws what, whatever a method makes of it.
METHODS = ("ls", Igg3(iterations=2))
EVENTS = ("alarm", "hazard", "missed", "exceeded", "misleading", "false_alarm")


@pytest.fixture(scope="module")
def g() -> pl_mc.Geometry:
    return pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", epochs=546)[545]


def counted(g: pl_mc.Geometry, text: str, **options: Any) -> Any:
    given: dict[str, Any] = {"draws": 60_000, "seed": 5, "methods": "ls", "alert": "CAT-I", "progress": False} | options
    return pl_mc.sweep(g, pl_mc.biases(g, text), **given).iloc[0]


def require_binomial(row: Any, exact: dict[str, float]) -> None:
    for event in EVENTS:
        name = {"misleading": "misleading", "missed": "missed", "exceeded": "exceeded"}.get(event, f"{event}s")
        p_value = stats.binomtest(int(row[name]), int(row.draws), min(max(exact[event], 0.0), 1.0)).pvalue
        assert p_value > 1e-5, (event, row[name], exact[event] * row.draws)


def mixture(g: pl_mc.Geometry, rows: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Exact rates, averaged over sizes."""
    rates = pl_mc.exact.ls_rates(g, pl_mc.Faults.from_array(g, rows), alert="CAT-I")
    return {event: float(weights @ rates[f"{event}_rate"]) for event in EVENTS}


@pytest.mark.parametrize("sign", ["", "+-"])
def test_one_drawn_size_is_the_mixture_of_its_sizes(g: pl_mc.Geometry, sign: str) -> None:
    direction = np.array([name == "G21" for name in g.names], dtype=float)
    points, weights = np.polynomial.legendre.leggauss(200)
    sizes, weights = 1.0 + 8.0 * (points + 1.0) / 2.0, weights / 2.0
    signs = [1.0, -1.0] if sign else [1.0]
    rows = np.concatenate([np.outer(one * sizes, direction) for one in signs])
    exact = mixture(g, rows, np.tile(weights, len(signs)) / len(signs))
    assert 0.05 < exact["alarm"] < 0.95
    require_binomial(counted(g, f"G21:{sign}uniform(1,9)m"), exact)


def test_a_normal_size_is_the_mixture_and_a_larger_variance(g: pl_mc.Geometry) -> None:
    k = g.names.index("G21")
    points, weights = np.polynomial.hermite_e.hermegauss(120)
    rows = np.outer(4.0 + 6.0 * points, np.eye(len(g.names))[k])
    row = counted(g, "G21:normal(4,6)m")
    require_binomial(row, mixture(g, rows, weights / weights.sum()))
    # A Gaussian bias is Gaussian noise of its own: variances add up, along the gain of the satellite.
    sample = pl_mc.sample(g, pl_mc.biases(g, "G21:normal(4,6)m"), draws=20_000, seed=9, methods="ls")
    law = pl_mc.statistics.ls_quantities(g)
    spread = float(np.hypot(law.vdop_m, law.gain[k] * 6.0))
    assert stats.kstest(sample.up_m, "norm", args=(float(law.gain[k]) * 4.0, spread)).pvalue > 1e-4


def test_common_sizes_are_one_number_and_independent_ones_each_their_own(g: pl_mc.Geometry) -> None:
    system = np.array([name[0] == "C" for name in g.names])
    pair = np.array([name in ("G21", "C01") for name in g.names])
    gain = pl_mc.statistics.ls_quantities(g).gain
    vdop = float(pl_mc.statistics.ls_quantities(g).vdop_m)

    def spread(text: str, **options: Any) -> Any:
        return pl_mc.sample(g, pl_mc.biases(g, text), draws=20_000, seed=4, methods="ls", **options).up_m

    for text, variance in (
        ("C:normal(0,8)m", float(gain[system].sum() * 8.0) ** 2),
        ("C:normal(0,8)m independent", float((gain[system] ** 2).sum() * 64.0)),
        ("G21+C01:normal(0,8)m", float(gain[pair].sum() * 8.0) ** 2),
        ("G21:normal(0,8)m,C01:normal(0,8)m", float((gain[pair] ** 2).sum() * 64.0)),
        ("G21+C01:normal(0,8)m independent", float((gain[pair] ** 2).sum() * 64.0)),
        # Fixed sizes of independent signs have the variance of their square.
        ("C:+20m independent", float((gain[system] ** 2).sum() * 400.0)),
    ):
        found = spread(text)
        expected = vdop**2 + variance
        assert found.var() == pytest.approx(expected, rel=0.05), text
        assert abs(found.mean()) < 5.0 * np.sqrt(expected / len(found))
    signs = counted(g, "G21+C01:+-9m")
    rows = np.outer([9.0, -9.0], pair.astype(float))
    require_binomial(signs, mixture(g, rows, np.array([0.5, 0.5])))
    patterns = np.zeros((4, len(g.names)))
    patterns[:, pair] = [[9, 9], [9, -9], [-9, 9], [-9, -9]]
    require_binomial(counted(g, "G21+C01:+9m independent"), mixture(g, patterns, np.full(4, 0.25)))


def test_a_drawn_rate_grows_with_time() -> None:
    series = pl_mc.simulate(site="CUT0", epochs=5, interval_s=30.0)
    satellite = series.names[0]
    table = pl_mc.sample(
        series, pl_mc.biases(series, f"{satellite}:normal(0,0.1)m/s:1-"), draws=5000, seed=2, methods="ls"
    )
    assert sorted(set(table.epoch)) == [1, 2, 3, 4]
    law = pl_mc.statistics.ls_quantities(series)
    for k in (1, 2, 4):
        row = int(np.flatnonzero((series.satellite[k] == 0) & series.in_view[k])[0])
        expected = law.vdop_m[k] ** 2 + (law.gain[k, row] * 0.1 * 30.0 * (k - 1)) ** 2
        assert table.up_m[table.epoch == k].var() == pytest.approx(expected, rel=0.1)


def test_other_faults_of_the_list_count_as_they_do_alone(g: pl_mc.Geometry) -> None:
    fixed = pl_mc.no_fault(g) + pl_mc.biases(g, "G21:+12m") + pl_mc.biases(g, "C:+3m")
    drawn = pl_mc.biases(g, "G21:uniform(2,20)m")
    options: dict[str, Any] = {"draws": 3000, "seed": 8, "methods": METHODS, "progress": False}
    alone = pl_mc.sweep(g, fixed, **options)
    together = pl_mc.sweep(g, fixed + drawn + fixed.only(1), **options)
    for fault in fixed.labels:
        for method in alone.method.unique():
            rows = together[(together.fault == fault) & (together.method == method)]
            expected = alone[(alone.fault == fault) & (alone.method == method)]
            for _, row in rows.iterrows():
                assert row[COUNT_COLUMNS].tolist() == expected.iloc[0][COUNT_COLUMNS].tolist()


def test_numbers_of_biases_are_none_of_the_noise(g: pl_mc.Geometry) -> None:
    with precision_scope("float64"):
        numbers = np.asarray(bias_numbers(np.uint32(3), np.uint32(9), np.int32(0), 6, np.float64))
        wider = np.asarray(bias_numbers(np.uint32(3), np.uint32(9), np.int32(0), 9, np.float64))
        key = epoch_key(np.uint32(3), np.uint32(9))
        noise = np.stack([np.asarray(part) for part in unit_inputs(key, np.int32(0), 3, 6, np.float64)])
    np.testing.assert_array_equal(wider[:, :6], numbers)
    assert not np.isin(numbers, noise).any()
    assert len(np.unique(numbers)) == numbers.size
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-4


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    return pl_mc.simulate(site="CUT0", epochs=6, interval_s=3600.0)


def test_counts_do_not_depend_on_who_counts(series: pl_mc.Geometry, tmp_path, monkeypatch) -> None:
    faults = sum(
        (pl_mc.biases(series, text) for text in ("G:+-20m:1-4", "C01:uniform(5,50)m", "C:normal(0,9)m independent")),
        pl_mc.biases(series, "C01:+0.001m/s"),
    )
    options: dict[str, Any] = {"draws": 1000, "seed": 8, "methods": METHODS, "progress": False}
    whole = pl_mc.sweep(series, faults, **options)
    monkeypatch.setattr("pl_mc.engine.plan.SCENARIOS_PER_CALL", 2048)
    monkeypatch.setattr("pl_mc.engine.plan.CALLS_PER_PART", 2)
    cut = pl_mc.sweep(series, faults, workers=2, **options)
    assert cut[COUNT_COLUMNS].equals(whole[COUNT_COLUMNS])
    for shard in (1, 2):
        pl_mc.sweep(series, faults, folder=tmp_path / "parts", shard=(shard, 2), **options)
    merged = pl_mc.sweep(series, faults, folder=tmp_path / "parts", resume=True, **options)
    assert merged[COUNT_COLUMNS].equals(whole[COUNT_COLUMNS])
    assert merged.fault.tolist() == whole.fault.tolist()
    other = pl_mc.sweep(series, faults, **options | {"seed": 9})
    assert not other[COUNT_COLUMNS].equals(whole[COUNT_COLUMNS])
    # An epoch alone has the numbers that it has in the series.
    label = "C01:uniform(5,50)m"
    by_epoch = pl_mc.sweep(series, faults, by_epoch=True, **options)
    alone = pl_mc.sweep(series[3], pl_mc.biases(series[3], label), **options)
    there = by_epoch[(by_epoch.epoch == 3) & (by_epoch.fault == label)]
    assert alone[COUNT_COLUMNS].to_numpy().tolist() == there[COUNT_COLUMNS].to_numpy().tolist()


def test_parts_of_other_times_are_not_taken_for_those_of_a_ramp(series: pl_mc.Geometry, tmp_path) -> None:
    faults = pl_mc.biases(series, "C01:+0.001m/s")
    options: dict[str, Any] = {
        "draws": 300,
        "seed": 8,
        "methods": "ls",
        "progress": False,
        "folder": tmp_path / "parts",
    }
    pl_mc.sweep(series, faults, **options)
    slower = dataclasses.replace(
        series, time_gps_s=series.time_gps_s[0] + 2 * (series.time_gps_s - series.time_gps_s[0])
    )
    with pytest.raises(pl_mc.InputError):
        pl_mc.sweep(slower, pl_mc.biases(slower, "C01:+0.001m/s"), resume=True, **options)


def test_single_precision_and_other_noise_draw_too(g: pl_mc.Geometry) -> None:
    exact = counted(g, "G21:uniform(2,20)m")
    single = counted(g, "G21:uniform(2,20)m", precision="float32")
    assert single.alarm_rate == pytest.approx(exact.alarm_rate, abs=0.02)
    multipath = counted(g, "G21:uniform(2,20)m", noise="multipath", draws=5000)
    assert 0.0 < multipath.alarm_rate < 1.0


def test_diagrams_and_swamping_draw_too(g: pl_mc.Geometry) -> None:
    faults = pl_mc.biases(g, "G21:uniform(2,40)m")
    grid = Grid(cell_m=1.0, reach_m=60.0)
    found = stanford_counts(g, faults, draws=2000, seed=3, methods=as_methods("ls"), alert=pl_mc.LPV_200, grid=grid)
    table = pl_mc.sweep(g, faults, draws=2000, seed=3, methods="ls", progress=False).iloc[0]
    assert 0 < table.alarms < 2000
    assert found.counts[0, :, :, 35:].sum() == table.alarms
    options = [as_methods("igg3")[0].options]  # type: ignore[attr-defined]
    watched = watch_weights(g, faults, options, draws=512, seed=3, precision="float64").iloc[0]
    # Known as faulted though no size stands in the list: most of them are found.
    assert watched.separated_count + watched.swamped_count + watched.faulted_full_count > 0
    assert watched.separated_rate > 0.3
