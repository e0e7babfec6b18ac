"""Confidence bounds and p-values of counts, against other computations of the same distribution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from pl_mc.input_errors import InputError
from pl_mc.statistics import binomial_p_value, clopper_pearson


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999999])
@pytest.mark.parametrize(
    ("events", "draws"), [(0, 1), (1, 1), (0, 50), (3, 20), (10, 20), (50, 50), (7, 1_000_000), (999_998, 1_000_000)]
)
def test_bounds_are_those_of_scipy(events: int, draws: int, confidence: float) -> None:
    expected = stats.binomtest(events, draws).proportion_ci(confidence, method="exact")
    low, high = clopper_pearson(events, draws, confidence)
    # The reference solves for a root, to 2e-12.
    np.testing.assert_allclose([low, high], [expected.low, expected.high], rtol=1e-10, atol=4e-12)
    half = (1 - confidence) / 2
    if events > 0:
        assert stats.binom.sf(events - 1, draws, low) == pytest.approx(half, rel=1e-8)
    if events < draws:
        assert stats.binom.cdf(events, draws, high) == pytest.approx(half, rel=1e-8)


def test_textbook_values() -> None:
    # Ten of a hundred: 4.90 to 17.62 per cent; the rule of three at one side: 3/n.
    np.testing.assert_allclose(clopper_pearson(10, 100), (0.04900469, 0.17622260), atol=5e-9)
    assert clopper_pearson(0, 10_000, 0.9)[1] == pytest.approx(3 / 10_000, rel=2e-3)


def test_no_event_all_events_no_draw() -> None:
    low, high = clopper_pearson([0, 8, 0], [8, 8, 0])
    np.testing.assert_array_equal(low[[0, 2]], 0.0)
    np.testing.assert_array_equal(high[[1, 2]], 1.0)
    assert high[0] == pytest.approx(1 - 0.025 ** (1 / 8), rel=1e-14)
    assert low[1] == pytest.approx(0.025 ** (1 / 8), rel=1e-14)
    assert clopper_pearson(0, 10**12)[1] == pytest.approx(-np.log(0.025) / 1e12, rel=1e-11)


@pytest.mark.parametrize("draws", [1, 2, 7, 40])
def test_coverage_is_at_least_nominal(draws: int) -> None:
    """Exact enumeration: the mass of all counts whose bounds hold the rate."""
    counts = np.arange(draws + 1)
    low, high = clopper_pearson(counts, draws, 0.95)
    rates = np.linspace(0.0, 1.0, 501)[:, None]
    mass = stats.binom.pmf(counts, draws, rates)
    coverage = (mass * ((low <= rates) & (rates <= high))).sum(axis=1)
    assert coverage.min() >= 0.95 - 1e-12


def test_bounds_are_wider_with_more_confidence_and_move_with_the_count() -> None:
    counts = np.arange(31)
    narrow, wide = clopper_pearson(counts, 30, 0.9), clopper_pearson(counts, 30, 0.99)
    assert (wide[0] <= narrow[0]).all()
    assert (wide[1] >= narrow[1]).all()
    assert (np.diff(narrow[0]) > 0).all()
    assert (np.diff(narrow[1]) > 0).all()
    mirrored = clopper_pearson(30 - counts, 30, 0.9)
    np.testing.assert_allclose(narrow[0], 1 - mirrored[1], rtol=1e-12, atol=1e-15)


def test_arguments_broadcast() -> None:
    low, high = clopper_pearson(np.zeros((3, 1)), np.array([10, 20]))
    assert low.shape == high.shape == (3, 2)
    assert binomial_p_value(1, [10, 20], np.full((4, 1), 0.1)).shape == (4, 2)


@pytest.mark.parametrize("rate", [1e-15, 1e-7, 1e-3, 0.2, 0.5, 0.97])
@pytest.mark.parametrize("draws", [1, 30, 200_000])
def test_p_value_is_twice_the_smaller_one_sided(draws: int, rate: float) -> None:
    centre = round(draws * rate)
    for events in sorted({0, 1, max(centre - 3, 0), centre, min(centre + 5, draws), draws}):
        tails = [stats.binomtest(events, draws, rate, alternative=side).pvalue for side in ("less", "greater")]
        got = binomial_p_value(events, draws, rate)
        assert got == pytest.approx(min(1.0, 2 * min(tails)), rel=1e-9, abs=1e-300)


def test_p_value_is_valid_under_the_known_rate() -> None:
    counts = np.arange(61)
    for rate in (0.01, 0.3, 0.5):
        mass = stats.binom.pmf(counts, 60, rate)
        values = binomial_p_value(counts, 60, rate)
        for level in (1e-6, 1e-3, 0.05, 0.3):
            assert mass[values <= level].sum() <= level * (1 + 1e-9)


def test_p_value_agrees_with_the_bounds() -> None:
    counts = np.arange(26)[:, None]
    rates = np.linspace(0.001, 0.999, 333)
    low, high = clopper_pearson(counts, 25, 0.95)
    outside = (rates < low) | (rates > high)
    np.testing.assert_array_equal(binomial_p_value(counts, 25, rates) < 0.05, outside)


def test_p_value_at_the_ends() -> None:
    np.testing.assert_array_equal(binomial_p_value([0, 1, 5], 5, 0.0), [1, 0, 0])
    np.testing.assert_array_equal(binomial_p_value([0, 4, 5], 5, 1.0), [0, 0, 1])
    assert binomial_p_value(0, 0, 0.3) == 1.0
    # One event in a million where the rate is 1e-15: 2e-9, not 0 and not 1.
    assert binomial_p_value(1, 10**6, 1e-15) == pytest.approx(2e-9, rel=1e-6)


@pytest.mark.parametrize(
    ("events", "draws", "message"),
    [(-1, 5, "events"), (6, 5, "more events"), (1.5, 5, "events"), (1, 2.5, "draws"), (np.nan, 5, "events"),
     ("many", 5, "cannot be read"), ([1, 2], [3, 4, 5], "do not go together"),
     (1, 1e17, "draws: a count is a whole number from 0"),
     (True, 5, "cannot be read"), (1, "5", "cannot be read"), (1j, 5, "cannot be read")],
)  # fmt: skip
def test_counts_that_do_not_fit(events: object, draws: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        clopper_pearson(events, draws)  # type: ignore[arg-type]


@pytest.mark.parametrize(("events", "draws"), [(1000, 200_573_750_402), (999, 10**11), (10**15, 2**53), (3, 2**53)])
def test_bounds_of_huge_counts(events: int, draws: int) -> None:
    """The library's inverse is NaN or off there, at 1000 of 2e11 by a factor of three; the tails say what is right."""
    low, high = clopper_pearson(events, draws)
    assert low < events / draws < high
    assert special.betainc(events, draws - events + 1.0, low) == pytest.approx(0.025, rel=2e-6)
    assert special.betaincc(events + 1.0, draws - events, high) == pytest.approx(0.025, rel=2e-6)
    deviation = (events * (1 - events / draws)) ** 0.5 / draws
    for bound, sign in ((low, -1), (high, 1)):
        # As far as the normal approximation goes.
        assert (bound - events / draws) / deviation == pytest.approx(1.96 * sign, abs=4.0 / events**0.5 + 1e-3)


def test_levels_outside_their_range() -> None:
    for confidence in (0.0, 1.0, -0.1, np.nan):
        with pytest.raises(InputError, match="confidence"):
            clopper_pearson(1, 5, confidence)
    for rate in (-1e-9, 1.1, np.nan):
        with pytest.raises(InputError, match="probability"):
            binomial_p_value(1, 5, rate)
