"""What counts tell: exact confidence bounds of a rate, and whether a count fits a known rate.

Both rest on the binomial distribution itself, not on a normal approximation, since the counts of interest are
often 0, 1 or 2 in millions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.input_errors import InputError, require_fraction


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
    count, total = _require_counts(events, draws)
    return _beta_bounds(count, total, confidence)


def rate_columns(name: str, rate: Any, low: Any, high: Any) -> dict[str, Any]:
    """``<name>_rate, <name>_low, <name>_high``, the columns that a rate and its bounds have in every table."""
    return {f"{name}_rate": rate, f"{name}_low": low, f"{name}_high": high}


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
    mean, total = np.broadcast_arrays(np.asarray(rate, dtype=float), np.asarray(independent_draws, dtype=float))
    if not ((mean >= 0.0) & (mean <= 1.0)).all():
        raise InputError("rate: a rate lies between 0 and 1.")
    _require_counts(0, total)
    return _beta_bounds(mean * total, total, confidence)


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
    count, total = np.broadcast_arrays(np.asarray(events, dtype=float), np.asarray(draws, dtype=float))
    if not ((count >= 0) & (count <= total) & np.isfinite(total)).all():
        raise InputError("events: there are no fewer than 0 and no more than draws.")
    z2 = special.ndtri(0.5 + confidence / 2.0) ** 2
    some = np.maximum(total, np.finfo(float).tiny)
    rate = count / some
    middle = (count + z2 / 2.0) / (total + z2)
    # Zero events have the bound 0 exactly, which rounding would miss.
    half = np.sqrt(z2 * total * rate * (1.0 - rate) + z2**2 / 4.0) / (total + z2)
    low = np.where(count == 0, 0.0, np.maximum(middle - half, 0.0))
    high = np.where(count == total, 1.0, np.minimum(middle + half, 1.0))
    return low, high


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
    first = np.asarray(first_events, dtype=float) / np.maximum(np.asarray(first_draws, dtype=float), 1e-300)
    second = np.asarray(second_events, dtype=float) / np.maximum(np.asarray(second_draws, dtype=float), 1e-300)
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
    low = special.betaincinv(np.where(count > 0, count, 1.0), other + 1.0, half)
    high = special.betainccinv(count + 1.0, np.where(other > 0, other, 1.0), half)
    some = np.maximum(total, 1.0)
    low = np.where(other == 0, np.exp(np.log(half) / some), low)
    high = np.where(count == 0, -np.expm1(np.log(half) / some), high)
    return np.where(count == 0, 0.0, low), np.where(other == 0, 1.0, high)


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
    count, total = _require_counts(events, draws)
    rate = np.asarray(probability, dtype=float)
    if not ((rate >= 0.0) & (rate <= 1.0)).all():
        raise InputError("probability: a rate lies between 0 and 1.")
    other = total - count
    # P(X >= k) = I_p(k, n-k+1) and P(X <= k) = 1 - I_p(k+1, n-k); the complement by its own function, since a
    # difference from 1 would lose the tail.
    at_least = np.where(count == 0, 1.0, special.betainc(np.maximum(count, 1.0), other + 1.0, rate))
    at_most = np.where(other == 0, 1.0, special.betaincc(count + 1.0, np.maximum(other, 1.0), rate))
    return np.minimum(1.0, 2.0 * np.minimum(at_least, at_most))


def _require_counts(events: ArrayLike, draws: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both counts as floats of one shape."""
    try:
        count, total = np.broadcast_arrays(np.asarray(events, dtype=float), np.asarray(draws, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(f"events, draws: they cannot be read as counts of one shape ({error}).") from None
    for name, value in (("events", count), ("draws", total)):
        if not (np.isfinite(value) & (value >= 0) & (value == np.floor(value))).all():
            raise InputError(f"{name}: a count is a whole number and not negative.")
    if (count > total).any():
        raise InputError("events: there cannot be more events than draws.")
    return count, total
