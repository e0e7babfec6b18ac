"""Bounds of a difference of two rates: Newcombe's, against statsmodels and against what bounds have to be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.stats.proportion import confint_proportions_2indep, proportion_confint

from pl_mc.input_errors import InputError
from pl_mc.statistics.intervals import difference_bounds, wilson

counted = st.integers(1, 10**6).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counted, counted)
def test_bounds_are_those_of_statsmodels(first: tuple[int, int], second: tuple[int, int]) -> None:
    low, high = difference_bounds(*first, *second)
    expected = confint_proportions_2indep(*second, *first, method="newcomb", compare="diff", correction=False)
    np.testing.assert_allclose([low, high], expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(wilson(*first), proportion_confint(*first, method="wilson"), rtol=1e-9, atol=1e-12)


@given(counted, counted)
def test_bounds_hold_the_difference_and_turn_with_the_order(first: tuple[int, int], second: tuple[int, int]) -> None:
    low, high = difference_bounds(*first, *second)
    difference = second[0] / second[1] - first[0] / first[1]
    assert -1 <= low <= difference <= high <= 1
    back = difference_bounds(*second, *first)
    np.testing.assert_allclose([low, high], [-back[1], -back[0]], rtol=0, atol=1e-15)
    wider = difference_bounds(*first, *second, 0.99)
    assert wider[0] <= low
    assert wider[1] >= high


def test_bounds_cover_as_often_as_they_say() -> None:
    """20,000 pairs of counts; Newcombe's own study finds 0.93 to 0.97 for such rates."""
    rng = np.random.default_rng(11)
    first, second = rng.binomial(300, 0.03, 20_000), rng.binomial(500, 0.05, 20_000)
    low, high = difference_bounds(first, 300, second, 500)
    covered = ((low <= 0.02) & (high >= 0.02)).mean()
    assert 0.94 < covered < 0.97


def test_counts_that_cannot_be_are_refused() -> None:
    for wrong in ((-1, 5, 0, 5), (6, 5, 0, 5), (0, 5, 0, float("inf"))):
        with pytest.raises(InputError, match=r"events|draws"):
            difference_bounds(*wrong)
    with pytest.raises(InputError, match="confidence"):
        wilson(1, 5, 1.0)
