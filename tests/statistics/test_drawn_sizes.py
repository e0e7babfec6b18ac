"""Exact rates under drawn sizes: the mean of the rates of fixed ones, and what a sweep counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats

import pl_mc
from pl_mc.faults import Faults
from pl_mc.statistics.exact import RATE_COLUMNS, ls_rates

CAT_I = "CAT I"


@pytest.fixture(scope="module")
def sky() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=1)[0]


def at_sizes(g: pl_mc.Geometry, text: str, sizes_m: np.ndarray, **options: Any) -> pd.DataFrame:
    """A row for each size of a fault that is fixed."""
    return ls_rates(g, Faults.joined([pl_mc.biases(g, text.format(size)) for size in sizes_m]), **options)


@pytest.mark.parametrize(
    ("drawn", "fixed", "law"),
    [
        ("G12:uniform(1,9)m", "G12:{:+.9f}m", stats.uniform(1.0, 8.0)),
        ("G12:normal(2,3)m", "G12:{:+.9f}m", stats.norm(2.0, 3.0)),
        ("G12+G22:uniform(1,9)m,C01:+3m", "G12+G22:{:+.9f}m,C01:+3m", stats.uniform(1.0, 8.0)),
        ("G:uniform(5,20)m", "G:{:+.9f}m", stats.uniform(5.0, 15.0)),
    ],
)
def test_rates_are_the_mean_over_the_distribution(sky: pl_mc.Geometry, drawn: str, fixed: str, law: Any) -> None:
    rates = ls_rates(sky, pl_mc.biases(sky, drawn), alert=CAT_I).iloc[0]
    assert rates.fault == drawn
    assert np.isnan(rates.bias_m)
    points = np.linspace(*law.ppf([1e-14, 1.0 - 1e-14]), 401)
    known = at_sizes(sky, fixed, np.where(np.abs(points) > 1e-6, points, 1e-6), alert=CAT_I)
    for column in ("alarm_rate", "misleading_rate"):
        values = law.pdf(points) * known[column].to_numpy()
        assert rates[column] == pytest.approx(integrate.simpson(values, x=points), rel=2e-5)


def test_either_sign_is_the_mean_of_both(sky: pl_mc.Geometry) -> None:
    text = "G12:{}8m,C01:+3m"
    found = ls_rates(sky, pl_mc.biases(sky, text.format("+-")), alert=CAT_I).iloc[0]
    both = [ls_rates(sky, pl_mc.biases(sky, text.format(sign)), alert=CAT_I).iloc[0] for sign in "+-"]
    for column in RATE_COLUMNS:
        assert found[column] == pytest.approx((both[0][column] + both[1][column]) / 2.0, rel=1e-12)


def test_drawn_and_fixed_faults_stand_in_their_order(sky: pl_mc.Geometry) -> None:
    faults = pl_mc.no_fault(sky) + pl_mc.biases(sky, "G12:+-5m") + pl_mc.biases(sky, "G22:+9m")
    table = ls_rates(sky, faults, alert=CAT_I)
    assert table.fault.tolist() == list(faults.labels)
    np.testing.assert_array_equal(table.bias_m, [0.0, np.nan, 9.0])
    alone = ls_rates(sky, faults.only(0, 2), alert=CAT_I)
    np.testing.assert_allclose(table.iloc[[0, 2]][list(RATE_COLUMNS)], alone[list(RATE_COLUMNS)], rtol=1e-13)


def test_ramps_in_time_with_a_drawn_rate() -> None:
    g = pl_mc.simulate(epochs=4, interval_s=600.0)
    table = ls_rates(g, pl_mc.biases(g, "G12:uniform(0.001,0.02)m/s"), alert=CAT_I)
    assert table.epoch.tolist() == [0, 1, 2, 3]
    for epoch in (1, 3):
        one = pl_mc.biases(g[epoch], f"G12:uniform({0.6 * epoch},{12 * epoch})m")
        expected = ls_rates(g[epoch], one, alert=CAT_I).alarm_rate[0]
        assert table.alarm_rate[epoch] == pytest.approx(expected, rel=1e-9)
    # At its beginning a ramp is no bias.
    free = ls_rates(g[0], pl_mc.no_fault(g[0]), alert=CAT_I).alarm_rate[0]
    assert table.alarm_rate[0] == pytest.approx(free, rel=1e-9)


def test_a_sweep_counts_what_is_exact_horizontally(sky: pl_mc.Geometry) -> None:
    near = pl_mc.AlertLimits("near", horizontal_m=6.0)
    drawn = pl_mc.biases(sky, "G12:uniform(2,6)m")
    exact = ls_rates(sky, drawn, alert=near).iloc[0]
    counted = pl_mc.sweep(sky, drawn, draws=20_000, seed=1, methods="ls", alert=near, progress=False).iloc[0]
    for event, column in (("alarm", "alarms"), ("exceeded", "exceeded")):
        p = pl_mc.statistics.binomial_p_value(int(counted[column]), 20_000, float(exact[f"{event}_rate"]))
        assert p > 1e-4, event


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G:uniform(1,5)m independent", "draws several sizes or signs independently of each other"),
        ("G:+5m independent", "draws several sizes or signs independently of each other"),
        ("G12:uniform(1,5)m,G22:+-3m", "draws several sizes or signs independently of each other"),
        ("G12:uniform(1,1000000)m", "too far for exact rates; use pl_mc.sweep"),
    ],
)
def test_what_has_no_exact_rates(sky: pl_mc.Geometry, text: str, words: str) -> None:
    with pytest.raises(pl_mc.InputError, match=words):
        ls_rates(sky, pl_mc.biases(sky, text))


def test_the_axis_of_exact_rates(sky: pl_mc.Geometry) -> None:
    free = pl_mc.no_fault(sky)
    unasked = ls_rates(sky, free, alert="RNP 0.1")
    np.testing.assert_array_equal(unasked.values, ls_rates(sky, free, alert="RNP 0.1", axis="horizontal").values)
    with pytest.raises(pl_mc.InputError, match="axis: either needs a vertical limit"):
        ls_rates(sky, free, alert="NPA", axis="either")
