"""What counts tell: exact confidence bounds of a rate, and whether a count fits a known rate.

Both rest on the binomial distribution itself, not on a normal approximation, since the counts of interest are
often 0, 1 or 2 in millions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.input_errors import require_fraction, require_one_shape, require_true

# Beyond this a count is no longer a whole number that a double holds.
MOST_DRAWS = 2**53

# A bound is taken where its tail is what it should be to this share, else halved down within exp(this) of the rate.
_CLOSE = 1e-6
_LOG_REACH = 80.0
_HALVINGS = 64


@ordinary_arithmetic
def clopper_pearson(
    events: ArrayLike, draws: ArrayLike, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact two-sided bounds of a probability, from how often it happened.

    Source: Clopper & Pearson (1934), Biometrika 26(4):404-413; each side leaves out at most half of
    ``1 - confidence``. Without an event the bounds are 0 and 1 - ((1 - confidence)/2)^(1/draws); without a draw
    they are 0 and 1.

    Args:
        events: (...), number of events, whole numbers from 0 to ``draws``.
        draws: (...), number of draws; broadcast against ``events``.
        confidence: probability that the bounds hold the true rate, at the least; between 0 and 1, both excluded.

    Returns:
        Lower and upper bounds, each (...).

    Raises:
        InputError: counts that are negative, not whole or more than the draws; a confidence outside (0, 1).
    """
    count, total = require_one_shape(events=events, draws=draws)
    _require_events(count, total)
    return _beta_bounds(count, total, confidence)


def rate_columns(name: str, rate: Any, low: Any, high: Any) -> dict[str, Any]:
    """``<name>_rate, <name>_low, <name>_high``, the columns that a rate and its bounds have in every table."""
    return {f"{name}_rate": rate, f"{name}_low": low, f"{name}_high": high}


@ordinary_arithmetic
def shared_noise_bounds(
    rate: ArrayLike, independent_draws: ArrayLike, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds of a rate that is averaged over several faults of the same noise draws.

    Events of different faults under one noise draw are not independent, so their number is no binomial count. Their
    mean under one draw lies between 0 and 1, and of all such variables the one that is 0 or 1 has the largest
    variance; hence the bounds of ``rate * independent_draws`` events in ``independent_draws`` draws, after
    Clopper and Pearson, are wide enough (as Korn & Graubard 1998, Survey Methodology 24:193-201, use an effective
    sample size).

    Args:
        rate: (...), mean rate over faults and draws.
        independent_draws: (...), number of independent noise draws behind it.
        confidence: as for `clopper_pearson`.
    """
    mean, total = require_one_shape(rate=rate, independent_draws=independent_draws)
    _require_rates(mean, field="rate")
    _require_counts(total, field="independent_draws")
    return _beta_bounds(mean * total, total, confidence)


@ordinary_arithmetic
def wilson(
    events: ArrayLike, draws: ArrayLike, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Score bounds of a probability, approximate but between 0 and 1; what `difference_bounds` is made of.

    Source: Wilson (1927), J. Am. Stat. Assoc. 22:209-212. Without a draw they are 0 and 1.

    Args:
        events: (...), number of events; an effective number, of draws that are not all independent, need not be
            whole.
        draws: (...), number of draws, or effective number of them.
        confidence: probability that the bounds hold the true rate, about; between 0 and 1, both excluded.

    Raises:
        InputError: fewer than no events, more than draws, or a confidence outside (0, 1).
    """
    require_fraction(confidence, field="confidence")
    count, total = require_one_shape(events=events, draws=draws)
    _require_within(count, total)
    z2 = special.ndtri(0.5 + confidence / 2.0) ** 2
    some = np.maximum(total, np.finfo(float).tiny)
    rate = count / some
    middle = (count + z2 / 2.0) / (total + z2)
    # Zero events have the bound 0 exactly, which rounding would miss.
    half = np.sqrt(z2 * total * rate * (1.0 - rate) + z2**2 / 4.0) / (total + z2)
    low = np.where(count == 0, 0.0, np.maximum(middle - half, 0.0))
    high = np.where(count == total, 1.0, np.minimum(middle + half, 1.0))
    return low, high


@ordinary_arithmetic
def difference_bounds(
    first_events: ArrayLike,
    first_draws: ArrayLike,
    second_events: ArrayLike,
    second_draws: ArrayLike,
    confidence: float = 0.95,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds of the difference of two probabilities, second minus first, of independent draws.

    Source: Newcombe (1998), Statistics in Medicine 17:873-890, method 10 (hybrid score): each bound joins the
    distances of both rates from their own `wilson` bounds. Draws that both counts share are taken as independent
    too: where events then go together the bounds are wider than they had to be.

    Args:
        first_events, first_draws, second_events, second_draws: (...), counts as for `wilson`.
        confidence: probability that the bounds hold the true difference, about.

    Raises:
        InputError: as for `wilson`.
    """
    first_low, first_high = wilson(first_events, first_draws, confidence)
    second_low, second_high = wilson(second_events, second_draws, confidence)
    first, second = (
        np.asarray(events, dtype=float) / np.maximum(np.asarray(draws, dtype=float), 1e-300)
        for events, draws in ((first_events, first_draws), (second_events, second_draws))
    )
    difference = second - first
    low = difference - np.hypot(second - second_low, first_high - first)
    high = difference + np.hypot(second_high - second, first - first_low)
    return np.maximum(low, -1.0), np.minimum(high, 1.0)


def _beta_bounds(
    count: NDArray[np.float64], total: NDArray[np.float64], confidence: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The bounds of `clopper_pearson`; ``count`` need not be whole."""
    require_fraction(confidence, field="confidence")
    half = (1.0 - confidence) / 2.0
    other = total - count
    # The beta function has no zero parameter: those counts get their closed forms below.
    some_count, some_other, some = (
        np.where(count > 0, count, 1.0),
        np.where(other > 0, other, 1.0),
        np.maximum(total, 1.0),
    )
    low = special.betaincinv(some_count, other + 1.0, half)
    low = _where_it_is(low, special.betainc, some_count, other + 1.0, half, -_LOG_REACH, 0.0)
    high = special.betainccinv(count + 1.0, some_other, half)
    high = _where_it_is(high, special.betaincc, count + 1.0, some_other, half, 0.0, _LOG_REACH)
    low = np.where(other == 0, np.exp(np.log(half) / some), low)
    high = np.where(count == 0, -np.expm1(np.log(half) / some), high)
    return np.where(count == 0, 0.0, low), np.where(other == 0, 1.0, high)


def _where_it_is(
    found: NDArray[np.float64], tail: Any, a: NDArray[np.float64], b: NDArray[np.float64], half: float,
    below: float, above: float,
) -> NDArray[np.float64]:  # fmt: skip
    """``found``, the bounds at which ``tail`` is ``half``; halved down in log p where it is not that there.

    The library's inverses are NaN or off from some 1e12 draws on, and at 1000 events earlier: by a factor of 30.
    """
    found = np.array(found)
    wrong = ~(np.abs(tail(a, b, found) - half) <= _CLOSE * half)
    if wrong.any():
        a, b = a[wrong], b[wrong]
        middle = np.log(a / (a + b))
        low, high = middle + below, np.minimum(middle + above, 0.0)
        falls = tail is special.betaincc
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            short = (tail(a, b, np.exp(middle)) < half) != falls
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        found[wrong] = np.exp(high)
    return found


@ordinary_arithmetic
def binomial_p_value(events: ArrayLike, draws: ArrayLike, probability: ArrayLike) -> NDArray[np.float64]:
    """How surprising a count is where the rate is known: twice the smaller tail of the binomial, 1 at the most.

    Both tails hold the observed count, so under the known rate P(value <= a) <= a for every a. Doubling differs
    from the test that adds up all counts as improbable as the one seen; it is the one that agrees with
    `clopper_pearson`: the value is below 1 - confidence exactly where the bounds leave the rate out.

    Args:
        events: (...), number of events, whole numbers from 0 to ``draws``.
        draws: (...), number of draws.
        probability: (...), the known rate; the three broadcast.

    Raises:
        InputError: counts that do not fit each other, or a probability outside [0, 1].
    """
    count, total, rate = require_one_shape(events=events, draws=draws, probability=probability)
    _require_events(count, total)
    _require_rates(rate, field="probability")
    other = total - count
    # P(X >= k) = I_p(k, n-k+1) and P(X <= k) = 1 - I_p(k+1, n-k); the complement by its own function, since a
    # difference from 1 would lose the tail.
    at_least = np.where(count == 0, 1.0, special.betainc(np.maximum(count, 1.0), other + 1.0, rate))
    at_most = np.where(other == 0, 1.0, special.betaincc(count + 1.0, np.maximum(other, 1.0), rate))
    return np.minimum(1.0, 2.0 * np.minimum(at_least, at_most))


def _require_rates(rate: NDArray[np.float64], *, field: str) -> None:
    require_true((rate >= 0.0) & (rate <= 1.0), field=field, rule="a rate lies between 0 and 1", of=rate)


def _require_counts(count: NDArray[np.float64], *, field: str) -> None:
    valid = (count >= 0) & (count <= MOST_DRAWS) & (count == np.floor(count))
    require_true(valid, field=field, rule=f"a count is a whole number from 0 to {MOST_DRAWS}", of=count)


def _require_events(count: NDArray[np.float64], total: NDArray[np.float64]) -> None:
    _require_counts(total, field="draws")
    _require_counts(count, field="events")
    _require_within(count, total)


def _require_within(count: NDArray[np.float64], total: NDArray[np.float64]) -> None:
    require_true((total >= 0) & (total <= MOST_DRAWS), field="draws", rule=f"there are up to {MOST_DRAWS}", of=total)
    rule = "there are no fewer than 0, and there cannot be more events than draws"
    require_true((count >= 0) & (count <= total), field="events", rule=rule, of=count)
