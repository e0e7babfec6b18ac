"""Bounds of a rate averaged over faults of the same noise: they hold, and equal Clopper-Pearson for one fault."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.input_errors import InputError
from pl_mc.statistics import binomial_p_value, clopper_pearson, shared_noise_bounds


def test_one_fault_is_the_binomial_case() -> None:
    events, draws = np.array([0, 1, 7, 40, 99, 100]), np.full(6, 100)
    np.testing.assert_allclose(
        shared_noise_bounds(events / draws, draws), clopper_pearson(events, draws), rtol=1e-12, atol=0
    )


def test_bounds_hold_where_events_of_several_faults_come_together() -> None:
    # Twenty faults that all fail under the same draws are the worst case; that each fails on its own is the best.
    rng = np.random.default_rng(20171121)
    rate, draws, faults, repeats = 0.02, 400, 20, 4000
    together = rng.binomial(draws, rate, repeats) / draws
    apart = rng.binomial(draws * faults, rate, repeats) / (draws * faults)
    missed_together, missed_apart = (
        int(np.sum((low > rate) | (high < rate)))
        for low, high in (shared_noise_bounds(mean, draws) for mean in (together, apart))
    )
    # At most 5 % may miss; the count of misses fits that level or lies below it.
    assert missed_together <= 0.05 * repeats or binomial_p_value(missed_together, repeats, 0.05) > 1e-6
    assert missed_apart == 0
    # Treating the sum of dependent counts as binomial would miss far more often.
    low, high = clopper_pearson(np.round(together * draws * faults), draws * faults)
    assert np.mean((low > rate) | (high < rate)) > 0.5


def test_what_is_no_rate_is_refused() -> None:
    with pytest.raises(InputError, match="rate"):
        shared_noise_bounds(1.5, 10)
    with pytest.raises(InputError, match="draws"):
        shared_noise_bounds(0.5, 10.5)
