"""A calibrated multiplier, the alarms that come with it, and three ways to it: exact, counted, searched for.

Exact where the method has a law. Counted as an order statistic of drawn ratios, whose confidence is exact: the
number of ratios above a quantile is binomial, whatever the law of the ratio. Searched for where an estimator of the
caller's own gives the probability at one multiplier at a time, each trial an estimate; methods of the package need
no such search, since one curve serves every multiplier (`pl_mc.integrity_risk.k_factor.from_curve`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd
from scipy import special

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.engine import sample
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import EXCEEDED, MISLEADING
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, k_of, with_k
from pl_mc.statistics.exact import LeastSquaresLaw
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.student import student_factor

NO_CHECK = dict.fromkeys(("check_probability", "check_low", "check_high"), math.nan)
EXACT, COUNTING, RARE = "exact", "counting", "rare events"

# The axes that have a level of their own.
LevelAxis = Literal["vertical", "horizontal"]

# Multipliers beyond these are no protection levels; K is searched for between them.
LARGEST_FACTOR, SMALLEST_FACTOR = 1e9, 1e-6

# An alert limit that no protection level passes: an alarm in spite of it is the method's own test.
NO_LIMIT = AlertLimits("none", vertical_m=1e9)
_DRAWS_PER_CALL = 50_000

# Multipliers that a search may try, and how close to the target it has to come.
_MOST_TRIALS, _MOST_STEPS = 12, 12
_STRIDE, _CLOSE, _TOLERANCE = 1.25, 1.02, 1e-4
# The ratios from whose tail it starts.
_TAIL = 200


@dataclass(frozen=True)
class KFactor:
    """A multiplier, bounds of it that each have the confidence, and the event's probability at the upper one.

    ``check`` has another estimator's, at the multiplier itself, with an interval of 95 %; missing where none ran.
    """

    k: float
    low: float
    high: float
    probability: float
    probability_low: float
    probability_high: float
    found: str
    draws: int
    warning: str = ""
    check: dict[str, float] = field(default_factory=lambda: NO_CHECK)


# At an epoch without a solution there is no event, whatever the multiplier.
ALWAYS_ALARMS = KFactor(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, EXACT, 0)


def exact_rates(
    g: Geometry, faults: Faults, method: Method, alert: AlertLimits, k: float, axis: LevelAxis, what: str
) -> FloatArray:
    """One of the rates of `ls_rates`, "misleading" or another, by fault and epoch, for another multiplier ``k``.

    The method has an exact law.
    """
    law = exact_law(with_k(method, k, axis))
    assert law is not None
    least = {"exceeded": False} if isinstance(law, LeastSquaresLaw) and what != EXCEEDED else {}
    return law.rates(g, faults, alert, axis, **least)[f"{what}_rate"].to_numpy()


def exact_k_factor(
    g: Geometry,
    fault: Faults,
    method: Method,
    event: str,
    alert: AlertLimits,
    target: float,
    axis: LevelAxis = "vertical",
) -> tuple[KFactor, dict[str, float]]:
    """Of a method with an exact law; ``g`` is a series over which the mean risk counts."""
    quantities, kept = ls_quantities(g), fault.applies(g)[:, 0]
    dof, law = quantities.dof[kept & quantities.available], exact_law(method)

    def mean_rate(k: float, what: str) -> float:
        return float(exact_rates(g, fault, method, alert, k, axis, what).mean())

    def risk(k: float) -> float:
        return mean_rate(k, event)

    if dof.size == 0 or risk(SMALLEST_FACTOR) <= target:
        k = 0.0
    elif (
        isinstance(law, LeastSquaresLaw) and axis == VERTICAL and event == EXCEEDED and not fault.bias_m.any()
        and kept.sum() == dof.size == 1
    ):  # fmt: skip
        # Student's quantile is the multiplier of m VDOP, of which the field may be a multiple.
        k = float(student_factor(dof, target)[0]) / (law.k_vertical / k_of(method))
    else:
        k = _root_of(risk, target)
    at_k = risk(k) if k > 0 else risk(SMALLEST_FACTOR)
    found = KFactor(k, k, k, at_k, at_k, at_k, EXACT, 0)
    before, after = (mean_rate(max(value, SMALLEST_FACTOR), "alarm") for value in (k_of(method, axis), k))
    return found, alarm_columns((before, before, before), (after, after, after))


def _root_of(risk: Callable[[float], float], target: float) -> float:
    """The multiplier at which a risk that falls with it is the target."""
    from scipy import optimize

    last = 1.0
    while risk(last) > target:
        last *= 4.0
        if last > LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    first = last / 4.0
    while risk(first) <= target and first > SMALLEST_FACTOR:
        first /= 4.0

    def excess(log_k: float) -> float:
        # Logarithms, in which tails are close to straight; what underflows is below any target.
        return math.log(max(risk(math.exp(log_k)), 1e-320)) - math.log(target)

    return math.exp(optimize.brentq(excess, math.log(first), math.log(last), xtol=1e-12, rtol=1e-12))


def alarm_rate(unit_m: FloatArray, k: float, limit_m: float, confidence: float) -> tuple[float, float, float]:
    """Share of the draws that alarm with this multiplier, with its bounds."""
    # Where there is no solution, or the method's test rejects, there is an alarm even for a multiplier of zero.
    alarms = int((np.isinf(unit_m) | (unit_m > limit_m / max(k, SMALLEST_FACTOR))).sum())
    low, high = clopper_pearson(alarms, unit_m.size, confidence)
    return alarms / unit_m.size, float(low), float(high)


def alarm_columns(before: tuple[float, ...], after: tuple[float, ...]) -> dict[str, float]:
    """Alarm rates with their bounds at the record's multiplier and at the calibrated one."""
    return {
        f"alarm_rate_{when}{bound}": value
        for when, values in (("before", before), ("after", after))
        for bound, value in zip(("", "_low", "_high"), values, strict=True)
    }


def order_bounds(draws: int, target: float, confidence: float) -> tuple[int, int]:
    """Which of the largest ratios bound the quantile: ranks (high, low), counted from 1 for the largest of all.

    With N ratios, the number of those whose exceedance probability is at most ``target`` is binomial (N, target).
    The r-th largest has at most that probability where the number is at least r, so the largest r with
    P(number >= r) >= confidence gives the upper bound; the smallest r with P(number <= r - 1) >= confidence gives
    the lower one. Where the law of the ratio has atoms both hold the more. For ratios from several epochs in equal
    parts the number is a sum of different Bernoulli variables, whose tails are no heavier (Hoeffding 1956, Annals
    of Mathematical Statistics 27:713-721).

    The first rank is 0 where the draws are too few for any, the second N + 1 likewise.
    """
    from scipy import stats

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
    g: Geometry,
    fault: Faults,
    method: Method,
    event: str,
    alert: AlertLimits,
    *,
    draws: int,
    seed: int,
    axis: LevelAxis = "vertical",
) -> tuple[FloatArray, FloatArray]:
    """The level for a multiplier of one [m] and the ratio of each draw.

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
        vertical = axis == VERTICAL
        level_m = np.where(available, table["vpl_m" if vertical else "hpl_m"], np.inf) / k_of(method, axis)
        size_m = np.abs(table["up_m"]) if vertical else np.hypot(table["east_m"], table["north_m"])
        error_m = np.where(available, size_m, 0.0)
        silent = available & ~rejects
        worth_m = np.minimum(error_m, alert.limit_m[axis]) if event == MISLEADING else error_m
        counts = silent if event == MISLEADING else available
        # A perfect fit has a level of zero, which every error exceeds.
        ratio = np.divide(worth_m, level_m, out=np.full(worth_m.shape, np.inf), where=level_m > 0)
        units.append(np.where(silent, level_m, np.inf))
        ratios.append(np.where(counts, ratio, 0.0))
    return np.concatenate(units), np.concatenate(ratios)


def counted(ratio: FloatArray, target: float, confidence: float, high: int, low: int) -> KFactor:
    """The multiplier and its bounds as order statistics of the ratios."""
    descending = -np.sort(-ratio)
    middle = max(1, min(round(ratio.size * target), ratio.size))
    k, k_high = float(descending[middle - 1]), float(descending[high - 1])
    k_low = float(descending[low - 1]) if low <= ratio.size else 0.0
    events = int((ratio > k_high).sum())
    # The bounds of an order statistic's exceedance probability are those of so many events in a fixed rank.
    bounds = [float(bound) for bound in clopper_pearson(events, ratio.size, confidence)]
    doubt = "" if np.isfinite(k_high) else "levels of zero are among the draws: no multiplier keeps the target"
    return KFactor(k, k_low, k_high, events / ratio.size, bounds[0], bounds[1], COUNTING, ratio.size, doubt)


def bounds_of(row: pd.Series, confidence: float) -> tuple[float, float, float]:
    """An estimated probability with bounds that each have the confidence, its logarithm being about normal.

    Where the estimator takes its number back, the middle of its interval, and its ends; where nothing reached the
    event, zero, with the bound that it gives.
    """
    value, error = float(row["probability"]), float(row["standard_error"])
    if value > 0:
        # An exponential beyond 700 is more than a double holds.
        reach = min(float(special.ndtri(confidence)) * error / value, 700.0)
        return value, value * math.exp(-reach), min(value * math.exp(reach), 1.0)
    low = float(row["low"]) if np.isfinite(row["low"]) else 0.0
    high = float(row["high"]) if np.isfinite(row["high"]) else 1.0
    return math.sqrt(low * high), low, high


def first_guess(ratio: FloatArray, target: float) -> float:
    """A multiplier near the one that is looked for: the tail of the drawn ratios, continued as a power law."""
    known = np.sort(ratio[np.isfinite(ratio) & (ratio > 0)])[::-1]
    if known.size < _TAIL:
        return float(known[0]) if known.size else 1.0
    far, near = known[_TAIL // 10 - 1], known[_TAIL - 1]
    steep = math.log(far / near) / math.log(10.0)
    decades = math.log(_TAIL / 10 / ratio.size / target)
    # A power law overstates a lighter tail: half of its way is a start from which either side is near.
    return float(far * math.exp(0.5 * steep * max(decades, 0.0)))


def searched(trial: Callable[[float], tuple[float, float, float, str]], first: float, target: float) -> KFactor:
    """The multiplier by estimates: bracket the target, narrow the bracket, then step to where the bounds clear it.

    ``trial`` gives for a multiplier the event's probability, its bounds, each at the confidence, and a warning.
    """
    seen: dict[float, tuple[float, float, float, str]] = {}

    def surplus(k: float) -> float:
        if k not in seen:
            seen[k] = trial(k)
        return math.log(max(seen[k][0], 1e-300) / target)

    low = high = min(max(first, SMALLEST_FACTOR), LARGEST_FACTOR)
    while surplus(high) > 0:
        low, high = high, high * _STRIDE
        if high > LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    while surplus(low) <= 0:
        low, high = low / _STRIDE, low
        if low < SMALLEST_FACTOR:
            value, lower, upper, warning = seen[high]
            return KFactor(0.0, 0.0, 0.0, value, lower, upper, RARE, 0, warning)
    k = high
    for _ in range(_MOST_TRIALS):
        if high / low < 1.0 + _TOLERANCE:
            break
        # On logarithms a tail bends downwards, so that its chord lies below it; half-way where an end has no
        # events.
        above, below = surplus(low), surplus(high)
        share = above / (above - below) if below > -50.0 else 0.5
        k = low * (high / low) ** min(max(share, 0.05), 0.95)
        if abs(surplus(k)) < math.log(_CLOSE):
            break
        low, high = (k, high) if surplus(k) > 0 else (low, k)
    steep = max((surplus(low) - surplus(high)) / math.log(high / low), 1.0) if high > low else 1.0
    bounds, warnings = [], [seen[k][3]]
    for side, clears in ((1.0, lambda row: row[2] <= target), (-1.0, lambda row: row[1] >= target)):
        bound = k
        for _ in range(_MOST_STEPS):
            surplus(bound)
            value, lower, upper, _ = seen[bound]
            if clears(seen[bound]):
                break
            gap = math.log(upper / target) if side > 0 else math.log(target / max(lower, 0.1 * value, 1e-300))
            bound *= math.exp(side * min(1.1 * max(gap, 1e-3) / steep, 5.0))
        if bound not in seen or not clears(seen[bound]):
            warnings.append(f"no {'upper' if side > 0 else 'lower'} bound was reached")
            bound = math.inf if side > 0 else 0.0
        bounds.append(bound)
    k_high, k_low = bounds
    reached = seen[k_high] if math.isfinite(k_high) else seen[max(seen)]
    warnings.append(reached[3])
    note = "; ".join(dict.fromkeys(filter(None, warnings)))
    return KFactor(k, k_low, k_high, reached[0], reached[1], reached[2], RARE, 0, note)
