"""Exact rates of either limit: against plain draws, the two single axes, independent errors, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

import pl_mc
from pl_mc.faults import Faults
from pl_mc.methods import Ls
from pl_mc.statistics import binomial_p_value, ls_rates
from pl_mc.statistics.either import JointErrors, either_beyond
from pl_mc.statistics.length import length_beyond
from reference.problems import random_series

G = random_series(np.random.default_rng(2), np.ones((1, 9), bool), "GGGGGCCCC", noise=2.0)[0]
LIMITS = pl_mc.AlertLimits("own", vertical_m=14.0, horizontal_m=9.0)
RATES = ["alarm_rate", "hazard_rate", "missed_rate", "misleading_rate", "exceeded_rate", "false_alarm_rate"]


def some_errors(correlation: float, count: int = 20) -> JointErrors:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    means = rng.normal(0.0, 1.5, (3, count))
    ratio, with_major, with_minor = rng.uniform(0.1, 1.0, count), np.cos(turn), np.sin(turn)
    return JointErrors(means[0], ratio, means[1], means[2], correlation * with_major, correlation * with_minor)


@pytest.mark.parametrize("limit", [1.0, 4.0, 7.0])
def test_independent_errors_multiply(limit: float) -> None:
    errors, limits = some_errors(0.0), np.full(20, limit)
    within, beyond = either_beyond(limits, limits, errors)
    upward = special.ndtr(errors.vertical - limit) + special.ndtr(-errors.vertical - limit)
    inside, sideways = length_beyond(limits, errors.ratio, errors.major, errors.minor)
    np.testing.assert_allclose(beyond, sideways + upward * inside, rtol=1e-9)
    np.testing.assert_allclose(within, (1.0 - upward) * inside, rtol=1e-9)


@pytest.mark.parametrize("correlation", [0.3, 0.75, 0.95])
def test_both_sides_sum_to_one_and_are_bounded_by_their_parts(correlation: float) -> None:
    errors = some_errors(correlation)
    for upward, sideways in ((1.0, 1.5), (3.0, 2.0), (6.0, 7.0)):
        limits = np.full(20, upward), np.full(20, sideways)
        within, beyond = either_beyond(*limits, errors)
        np.testing.assert_allclose(within + beyond, 1.0, rtol=1e-9)
        alone = special.ndtr(errors.vertical - upward) + special.ndtr(-errors.vertical - upward)
        length = length_beyond(limits[1], errors.ratio, errors.major, errors.minor)[1]
        assert (beyond >= np.maximum(alone, length) * (1.0 - 1e-6)).all()
        assert (beyond <= (alone + length) * (1.0 + 1e-6)).all()


def test_a_line_through_three_components() -> None:
    """A vertical error that is the major one to a hair, narrow across: the larger of two normal tails."""
    one = np.ones(1)
    errors = JointErrors(0.0 * one, 0.001 * one, 0.0 * one, 0.0 * one, np.sqrt(1.0 - 1e-4) * one, 0.0 * one)
    found = either_beyond(3.0 * one, 2.0 * one, errors)[1]
    np.testing.assert_allclose(found, 2.0 * stats.norm.sf(2.0), rtol=1e-4)


@pytest.mark.counting
def test_a_sweep_has_the_exact_rates() -> None:
    bias = np.zeros((3, 9))
    bias[1, 1], bias[2, 6] = 12.0, 30.0
    faults, draws = Faults.from_array(G, bias), 60_000
    ls = Ls(k_vertical=2.0, k_horizontal=2.5)
    found = pl_mc.sweep(G, faults, draws=draws, seed=9, methods=(ls,), alert=LIMITS, axes="either", progress=False)
    exact = ls_rates(G, faults, alert=LIMITS, axis="either", k_vertical=2.0, k_horizontal=2.5)
    for row, truth in zip(found.to_dict("records"), exact.to_dict("records"), strict=True):
        for name, count in zip(
            RATES, ("alarms", "hazards", "missed", "misleading", "exceeded", "false_alarms"), strict=True
        ):
            assert binomial_p_value(int(row[count]), draws, truth[name]) > 1e-5, (row["fault"], name)


def test_rates_lie_between_the_larger_part_and_the_sum() -> None:
    bias = np.zeros((3, 9))
    bias[1, 2], bias[2, 7] = 6.0, -20.0
    faults = Faults.from_array(G, bias)
    parts = [ls_rates(G, faults, alert=LIMITS, axis=axis)[RATES].to_numpy() for axis in ("vertical", "horizontal")]
    either = ls_rates(G, faults, alert=LIMITS, axis="either")[RATES].to_numpy()
    alarm_hazard_exceeded = [0, 1, 4]
    low, high = np.maximum(*parts), np.add(*parts)
    assert (either[:, alarm_hazard_exceeded] >= low[:, alarm_hazard_exceeded] * (1.0 - 1e-6)).all()
    assert (either[:, :5] <= high[:, :5] * (1.0 + 1e-6)).all()
    # Alarms follow the one level that comes first.
    np.testing.assert_allclose(either[:, 0], low[:, 0], rtol=1e-10)


def test_a_priori_levels_and_chi_square_alarms() -> None:
    faults = Faults.from_array(G, np.eye(9)[:2] * 8.0)
    law = Ls(level_scale="apriori", k_vertical=2.0, k_horizontal=2.0).exact_law
    assert law is not None
    table = law.rates(G, faults, LIMITS, "either")
    count = pl_mc.sweep(
        G, faults, draws=40_000, seed=3, methods=(Ls(level_scale="apriori", k_vertical=2.0, k_horizontal=2.0),),
        alert=LIMITS, axes="either", progress=False,
    )  # fmt: skip
    for k in range(2):
        assert binomial_p_value(int(count.exceeded[k]), 40_000, table.exceeded_rate[k]) > 1e-5
        assert binomial_p_value(int(count.hazards[k]), 40_000, table.hazard_rate[k]) > 1e-5
    tested = ls_rates(G, faults, alert=LIMITS, axis="either", alarm="chi2")
    np.testing.assert_allclose(
        tested.alarm_rate, ls_rates(G, faults, alert=LIMITS, alarm="chi2").alarm_rate, rtol=1e-12
    )
    np.testing.assert_allclose(tested.hazard_rate, table.hazard_rate, rtol=1e-9)
