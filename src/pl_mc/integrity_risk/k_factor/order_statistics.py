"""The multiplier as an order statistic of drawn ratios, whose confidence is exact.

The number of ratios above a quantile is binomial, whatever the law of the ratio.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from pl_mc.alert import AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.engine import sample
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import MISLEADING
from pl_mc.integrity_risk.k_factor.record import COUNTING, Found
from pl_mc.methods import Method
from pl_mc.methods.capabilities import k_of
from pl_mc.statistics.intervals import clopper_pearson

# An alert limit that no protection level passes: an alarm in spite of it is the method's own test.
NO_LIMIT = AlertLimits("none", vertical_m=1e300, horizontal_m=1e300)
_DRAWS_PER_CALL = 50_000


def order_bounds(draws: int, target: float, confidence: float) -> tuple[int, int]:
    """Which of the largest ratios bound the quantile: ranks (high, low), counted from 1 for the largest of all.

    With N ratios, the number of those whose exceedance probability is at most ``target`` is binomial (N, target).
    The r-th largest has at most that probability where the number is at least r, so the largest r with
    P(number >= r) >= confidence gives the upper bound; the smallest r with P(number <= r - 1) >= confidence gives
    the lower one. Where the law of the ratio has atoms both hold the more. For ratios from several epochs in equal
    parts the number is a sum of different Bernoulli variables, whose tails are no heavier (Hoeffding 1956, Annals
    of Mathematical Statistics 27:713-721).

    Args:
        draws: N.
        target: exceedance probability of the quantile.
        confidence: of each bound.

    Returns:
        Ranks; the first is 0 where the draws are too few for any, the second N + 1 likewise.
    """
    # P(number >= r) >= c is P(number <= r - 1) <= 1 - c.
    high = int(stats.binom.ppf(1.0 - confidence, draws, target))
    while high > 0 and stats.binom.sf(high - 1, draws, target) < confidence:
        high -= 1
    while stats.binom.sf(high, draws, target) >= confidence:
        high += 1
    low = int(stats.binom.ppf(confidence, draws, target)) + 1
    return high, min(low, draws + 1)


def fewest_draws(target: float, confidence: float) -> int:
    """The number of draws from which the largest ratio keeps the target with that confidence."""
    return math.ceil(math.log1p(-confidence) / math.log1p(-target))


def drawn_ratios(
    g: Geometry, fault: Faults, method: Method, event: str, alert: AlertLimits, *, draws: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """VPL for a multiplier of one [m] and the ratio of each draw.

    Where the method's own test rejects, or there is no solution, the first is infinite and the ratio zero: an alarm
    and no event, whatever the multiplier.
    """
    calls = math.ceil(draws / _DRAWS_PER_CALL)
    seeds = np.random.SeedSequence(seed).generate_state(calls)
    units, ratios = [], []
    for k in range(calls):
        count = min(_DRAWS_PER_CALL, draws - k * _DRAWS_PER_CALL)
        table = sample(g, fault, draws=count, seed=int(seeds[k]), methods=(method,), alert=NO_LIMIT)
        available, rejects = table["available"].to_numpy(bool), table["alarm"].to_numpy(bool)
        level_m = np.where(available, table["vpl_m"], np.inf) / k_of(method)
        error_m = np.where(available, np.abs(table["up_m"]), 0.0)
        silent = available & ~rejects
        worth_m = np.minimum(error_m, alert.vertical_m) if event == MISLEADING else error_m
        counts = silent if event == MISLEADING else available
        # A perfect fit has a level of zero, which every error exceeds.
        ratio = np.divide(worth_m, level_m, out=np.full(worth_m.shape, np.inf), where=level_m > 0)
        units.append(np.where(silent, level_m, np.inf))
        ratios.append(np.where(counts, ratio, 0.0))
    return np.concatenate(units), np.concatenate(ratios)


def counted(ratio: FloatArray, target: float, confidence: float, high: int, low: int) -> Found:
    """The multiplier and its bounds as order statistics of the ratios."""
    descending = -np.sort(-ratio)
    middle = max(1, min(round(ratio.size * target), ratio.size))
    k, k_high = float(descending[middle - 1]), float(descending[high - 1])
    k_low = float(descending[low - 1]) if low <= ratio.size else 0.0
    events = int((ratio > k_high).sum())
    # The bounds of an order statistic's exceedance probability are those of so many events in a fixed rank.
    bounds = [float(bound) for bound in clopper_pearson(events, ratio.size, confidence)]
    doubt = "" if np.isfinite(k_high) else "levels of zero are among the draws: no multiplier keeps the target"
    return Found(k, k_low, k_high, events / ratio.size, bounds[0], bounds[1], COUNTING, ratio.size, doubt)
