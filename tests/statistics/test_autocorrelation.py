"""The effective number of independent epochs, against processes whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.input_errors import InputError
from pl_mc.statistics.autocorrelation import effective_number
from pl_mc.statistics.intervals import shared_noise_bounds


def markov(count: int, rho: float, seed: int) -> np.ndarray:
    """A stationary first-order process of unit variance, whose autocorrelation time is (1 + rho) / (1 - rho)."""
    fresh = np.random.default_rng(seed).standard_normal(count)
    values = np.empty(count)
    values[0] = fresh[0]
    for k in range(1, count):
        values[k] = rho * values[k - 1] + np.sqrt(1.0 - rho * rho) * fresh[k]
    return values


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.97])
def test_a_markov_process_has_its_known_number(rho: float) -> None:
    count = 20_000
    expected = count * (1.0 - rho) / (1.0 + rho)
    found = np.mean([effective_number(markov(count, rho, seed)) for seed in range(20)])
    assert found == pytest.approx(expected, rel=0.1)


def test_gaps_and_missing_values_leave_the_time_as_it_is() -> None:
    values = markov(20_000, 0.9, 3)
    whole = effective_number(values) / values.size
    gone = values.copy()
    gone[np.random.default_rng(0).random(values.size) < 0.4] = np.nan
    assert effective_number(gone) / np.isfinite(gone).sum() == pytest.approx(whole / 0.6, rel=0.35)
    kept = np.flatnonzero(np.arange(values.size) % 4000 < 3000)
    assert effective_number(values[kept], kept) / kept.size == pytest.approx(whole, rel=0.2)


def test_a_level_that_never_moves_is_one_value_and_few_are_what_they_are() -> None:
    assert effective_number(np.ones(100)) == 1.0
    assert effective_number([]) == 0.0
    assert effective_number([np.nan, 3.0]) == 1.0
    assert effective_number(np.linspace(0.0, 1.0, 50)) < 5.0
    with pytest.raises(InputError, match="places: whole numbers that increase"):
        effective_number([1.0, 2.0], [3, 3])


def test_series_share_their_correlation_and_an_offset_of_one_counts() -> None:
    values = np.stack([markov(2000, 0.9, seed) for seed in range(10)])
    series, places = np.repeat(np.arange(10), 2000), np.tile(np.arange(2000), 10)
    shuffled = np.random.default_rng(0).permutation(values.size)
    found = effective_number(values.ravel()[shuffled], places[shuffled], series[shuffled])
    assert found == pytest.approx(20_000 / 19, rel=0.2)
    # Offsets as large as the noise stay for a whole series: half of the variance has ten independent values.
    offset = values + np.random.default_rng(1).standard_normal((10, 1))
    assert effective_number(offset.ravel(), places, series) < 100


@pytest.mark.parametrize("threshold", [1.3, 2.0])
def test_bounds_with_it_hold_the_rate_of_a_crossed_threshold(threshold: float) -> None:
    """95 % bounds of 200 correlated series hold the true rate in 95 % of them or more; plain ones in far fewer."""
    from scipy.special import ndtr

    rate, held, plain = float(ndtr(-threshold)), 0, 0
    for seed in range(200):
        values = markov(3000, 0.95, seed)
        seen = float((values > threshold).mean())
        for number, count in ((effective_number(values), 0), (3000.0, 1)):
            low, high = shared_noise_bounds(seen, np.floor(number))
            inside = bool(low <= rate <= high)
            held, plain = held + (inside and not count), plain + (inside and count)
    assert held >= 184
    assert plain < 150
