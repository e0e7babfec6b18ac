"""The multiplier that a protection level should have, so that an event has the probability that is asked for.

With VPL = K u, u what the method makes of a scenario, every event here ends at one value of K: an error beyond the
level at |e| / u; a misleading one (no alarm besides, K u <= VAL) at min(|e|, VAL) / u. Call this value the
scenario's ratio. P(event) at K is the probability that the ratio is above K, and the multiplier is a quantile of
the ratio. For least squares it is computed; for other methods it is an order statistic of drawn ratios, whose
confidence is exact because the number of ratios above a quantile is binomial, or, where no count reaches, it is
searched for with the rare-event estimator.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize, stats

from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.engine import sample
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_geometry_and_alert, require_inputs
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_positive, require_whole
from pl_mc.integrity_risk.worst_case import Estimator, rare_event_estimator
from pl_mc.methods import Ls, Method, as_methods
from pl_mc.statistics.exact import ls_rates
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.student import student_factor

FloatArray = NDArray[np.float64]

EXCEEDED, MISLEADING = "exceeded", "misleading"
EVENTS = (EXCEEDED, MISLEADING)
EXACT, COUNTING, RARE = "exact", "counting", "rare events"

# An alert limit that no protection level passes: an alarm in spite of it is the method's own test.
_NO_LIMIT = AlertLimits("none", vertical_m=1e300, horizontal_m=1e300)
_DRAWS_PER_CALL = 50_000
# Multipliers beyond this are no protection levels; K is searched for below.
_LARGEST_FACTOR, _SMALLEST_FACTOR = 1e9, 1e-6
# Multipliers that the search by rare events may try, and how close to the target it has to come.
_MOST_TRIALS, _MOST_STEPS = 12, 12
_STRIDE, _CLOSE, _TOLERANCE = 1.25, 1.02, 1e-4
# The ratios from whose tail the search by rare events starts.
_TAIL = 200


@dataclass(frozen=True)
class Found:
    """A multiplier, bounds of it that each have the confidence, and the event's probability at the upper one."""

    k: float
    low: float
    high: float
    probability: float
    probability_low: float
    probability_high: float
    found: str
    draws: int
    warning: str = ""


def calibrate(
    g: Geometry,
    *,
    method: str | Method = "ls",
    target: float = 1e-7,
    faults: Faults | None = None,
    event: Literal["exceeded", "misleading"] = "exceeded",
    alert: AlertLimits = LPV_200,
    confidence: float = 0.95,
    pooled: bool = False,
    draws: int = 200_000,
    seed: int = 0,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
    estimator: Callable[[Method], Estimator] | None = None,
) -> pd.DataFrame:
    """The multiplier of the vertical protection level with which P(event) is ``target``, and its cost in alarms.

    Least squares is exact: fault-free, ``exceeded`` needs Student's quantile for n - t degrees of freedom, both
    signs together, and everything else the root of an exact probability. For other methods the multiplier comes
    from ``draws`` ratios where that many can tell, draws >= log(1 - confidence) / log(1 - target), about 3 /
    target for 95 %; else from the rare-event estimator, one epoch at a time.

    Args:
        g: the geometry, one epoch or a series.
        method: name or record of a method, with the multiplier that is compared.
        target: probability of the event per sample.
        faults: the faults under which the target shall hold, each for itself; the fault-free case unless given.
        event: ``exceeded``, |vertical error| > VPL, alarm or not; ``misleading``, the same and no alarm.
        alert: alert limits; the vertical one, VAL, decides on alarms.
        confidence: with which ``k_high`` keeps the target, and ``k_low`` does not: each for itself.
        pooled: for a series: one multiplier for all epochs, with which the mean risk over them is the target,
            instead of one for each.
        draws, seed: of the ratios, per epoch and fault; not used by least squares.
        target_cov, max_evaluations: of the rare-event estimator, as for `pl_mc.worst_case`.
        estimator: a function of a method that gives the function of faults, coefficient of variation and seed
            described at `pl_mc.worst_case`; it takes the place of the rare-event estimator.

    Returns:
        One row per epoch (or one for all where ``pooled``) and fault: ``epoch`` (missing where pooled), ``method,
        fault, bias_m, event, target, found`` (``exact``, ``counting`` or ``rare events``), ``draws``,
        ``k_vertical`` (best estimate), ``k_low, k_high``, ``inflation`` (k_high over the multiplier of the record),
        ``probability, probability_low, probability_high`` of the event at ``k_high`` (two-sided bounds at the
        confidence, equal where exact), and ``alarm_rate_before, alarm_rate_after`` (with ``_low`` and ``_high``,
        likewise) at the record's multiplier and at ``k_high``; an unavailable solution counts as an alarm.
        ``decides`` marks the fault that needs the largest ``k_high`` at its epoch. Zero means that any multiplier
        keeps the target. ``warning`` is empty, or says what is in doubt.

    Raises:
        InputError: options outside their range, faults of another geometry, a pooled multiplier whose target is too
            rare to count.
    """
    require_geometry_and_alert(g, alert)
    faults = no_fault(g) if faults is None else faults
    require_inputs(g, faults, alert)
    require_choice(event, EVENTS, field="event")
    for field, value in (("target", target), ("confidence", confidence)):
        if not require_positive(value, field=field) < 1.0:
            raise InputError(f"{field}: it lies between 0 and 1, both excluded, not {value!r}.")
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    (chosen,) = as_methods([method])
    if not hasattr(chosen, "k_vertical") or not dataclasses.is_dataclass(chosen):
        raise InputError(f"method: {chosen.name} has no multiplier k_vertical to calibrate.")
    series = g.as_series()
    epochs = [series] if pooled else [series[k : k + 1] for k in range(len(series))]
    rows = []
    for part in epochs:
        for k in range(len(faults)):
            fault = Faults(faults.bias_m[k : k + 1], faults.names, faults.labels[k : k + 1])
            if not fault.applies(part).any():
                continue
            keys = {
                "epoch": np.nan if pooled else int(part.epoch[0]),
                "method": chosen.name,
                "fault": fault.labels[0],
                "bias_m": float(fault.scalar_bias_m[0]),
                "event": event,
                "target": float(target),
            }
            if isinstance(chosen, Ls) and estimator is None:
                found, alarm = _exact(part, fault, chosen, event, alert, target)
            else:
                found, alarm = _estimated(
                    part,
                    fault,
                    chosen,
                    event,
                    alert,
                    target=target,
                    confidence=confidence,
                    draws=draws,
                    seed=seed,
                    target_cov=target_cov,
                    max_evaluations=max_evaluations,
                    estimator=estimator,
                )
            rows.append(keys | _columns(found, float(chosen.k_vertical)) | alarm | {"warning": found.warning})
    if not rows:
        raise InputError("faults: none of them has all of its satellites in view at any epoch of this geometry.")
    table = pd.DataFrame(rows)
    if not pooled:
        table["epoch"] = table["epoch"].astype(np.int64)
    largest = table.groupby("epoch", dropna=False)["k_high"].transform("max")
    table.insert(table.columns.get_loc("warning"), "decides", table["k_high"] == largest)
    return table


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


def _exact(
    g: Geometry, fault: Faults, method: Ls, event: str, alert: AlertLimits, target: float
) -> tuple[Found, dict[str, float]]:
    """Least squares; ``g`` is a series over which the mean risk counts."""
    column = f"{event}_rate"
    quantities, kept = ls_quantities(g), fault.applies(g)[:, 0]
    dof = quantities.dof[kept & quantities.available]

    def risk(k: float) -> float:
        return float(ls_rates(g, fault, alert=alert, k_vertical=k)[column].mean())

    if dof.size == 0 or risk(_SMALLEST_FACTOR) <= target:
        k = 0.0
    elif event == EXCEEDED and not fault.bias_m.any() and kept.sum() == dof.size == 1:
        k = float(student_factor(dof, target)[0])
    else:
        k = _root_of(risk, target)
    at_k = risk(k) if k > 0 else risk(_SMALLEST_FACTOR)
    found = Found(k, k, k, at_k, at_k, at_k, EXACT, 0)
    before, after = (
        float(ls_rates(g, fault, alert=alert, k_vertical=max(value, _SMALLEST_FACTOR))["alarm_rate"].mean())
        for value in (method.k_vertical, k)
    )
    return found, _alarm_columns((before, before, before), (after, after, after))


def _root_of(risk: Callable[[float], float], target: float) -> float:
    """The multiplier at which a risk that falls with it is the target."""
    last = 1.0
    while risk(last) > target:
        last *= 4.0
        if last > _LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {_LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    first = last / 4.0
    while risk(first) <= target and first > _SMALLEST_FACTOR:
        first /= 4.0

    def excess(log_k: float) -> float:
        # Logarithms, in which tails are close to straight; what underflows is below any target.
        return math.log(max(risk(math.exp(log_k)), 1e-320)) - math.log(target)

    return math.exp(optimize.brentq(excess, math.log(first), math.log(last), xtol=1e-12, rtol=1e-12))


def _estimated(
    g: Geometry,
    fault: Faults,
    method: Any,
    event: str,
    alert: AlertLimits,
    *,
    target: float,
    confidence: float,
    draws: int,
    seed: int,
    target_cov: float,
    max_evaluations: int,
    estimator: Callable[[Method], Estimator] | None,
) -> tuple[Found, dict[str, float]]:
    unit_m, ratio = _ratios(g, fault, method, event, alert, draws=draws, seed=seed)
    high, low = order_bounds(ratio.size, target, confidence)
    if estimator is None and high >= 1:
        found = _counted(ratio, target, confidence, high, low)
    elif not ls_quantities(g).available.any():
        # An alarm always, and no event.
        found = Found(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, EXACT, 0)
    elif len(g) > 1:
        needed = math.ceil(fewest_draws(target, confidence) / int(fault.applies(g).sum()))
        raise InputError(
            f"draws: a pooled multiplier is counted, which at {target:g} with confidence {confidence:g} needs at "
            f"least {needed} draws per epoch, not {draws} (or a larger target, or one multiplier per epoch)."
        )
    else:
        one = g[0]
        local = Faults.from_array(one, fault.bias_m[:, [g.names.index(name) for name in one.names]])

        def trial(k: float) -> tuple[float, float, float, str]:
            changed = dataclasses.replace(method, k_vertical=k)
            estimate = (
                rare_event_estimator(
                    one, changed, event, alert, target_cov=target_cov, max_evaluations=max_evaluations
                )
                if estimator is None
                else estimator(changed)
            )
            row = estimate(local, target_cov, seed).iloc[0]
            return *_bounds_of(row, confidence), str(row["warning"])

        found = _searched(trial, _first_guess(ratio, target), target)
    alarm = [_alarm_rate(unit_m, k, alert, confidence) for k in (float(method.k_vertical), found.high)]
    return found, _alarm_columns(*alarm)


def _bounds_of(row: pd.Series, confidence: float) -> tuple[float, float, float]:
    """An estimated probability with bounds that each have the confidence, its logarithm being about normal.

    Where the estimator takes its number back, the middle of its interval, and its ends; where nothing reached the
    event, zero, with the bound that it gives.
    """
    value, error = float(row["probability"]), float(row["standard_error"])
    if value > 0:
        # An exponential beyond 700 is more than a double holds.
        reach = min(float(stats.norm.ppf(confidence)) * error / value, 700.0)
        return value, value * math.exp(-reach), min(value * math.exp(reach), 1.0)
    low = float(row["low"]) if np.isfinite(row["low"]) else 0.0
    high = float(row["high"]) if np.isfinite(row["high"]) else 1.0
    return math.sqrt(low * high), low, high


def _ratios(
    g: Geometry, fault: Faults, method: Any, event: str, alert: AlertLimits, *, draws: int, seed: int
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
        table = sample(g, fault, draws=count, seed=int(seeds[k]), methods=(method,), alert=_NO_LIMIT)
        available, rejects = table["available"].to_numpy(bool), table["alarm"].to_numpy(bool)
        level_m = np.where(available, table["vpl_m"], np.inf) / method.k_vertical
        error_m = np.where(available, np.abs(table["up_m"]), 0.0)
        silent = available & ~rejects
        worth_m = np.minimum(error_m, alert.vertical_m) if event == MISLEADING else error_m
        counts = silent if event == MISLEADING else available
        # A perfect fit has a level of zero, which every error exceeds.
        ratio = np.divide(worth_m, level_m, out=np.full(worth_m.shape, np.inf), where=level_m > 0)
        units.append(np.where(silent, level_m, np.inf))
        ratios.append(np.where(counts, ratio, 0.0))
    return np.concatenate(units), np.concatenate(ratios)


def _counted(ratio: FloatArray, target: float, confidence: float, high: int, low: int) -> Found:
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


def _first_guess(ratio: FloatArray, target: float) -> float:
    """A multiplier near the one that is looked for: the tail of the drawn ratios, continued as a power law."""
    known = np.sort(ratio[np.isfinite(ratio) & (ratio > 0)])[::-1]
    if known.size < _TAIL:
        return float(known[0]) if known.size else 1.0
    far, near = known[_TAIL // 10 - 1], known[_TAIL - 1]
    steep = math.log(far / near) / math.log(10.0)
    decades = math.log(_TAIL / 10 / ratio.size / target)
    # A power law overstates a lighter tail: half of its way is a start from which either side is near.
    return float(far * math.exp(0.5 * steep * max(decades, 0.0)))


def _searched(trial: Callable[[float], tuple[float, float, float, str]], first: float, target: float) -> Found:
    """The multiplier by estimates: bracket the target, narrow the bracket, then step to where the bounds clear it.

    Args:
        trial: from a multiplier to the event's probability, its bounds, each at the confidence, and a warning.
        first: where to begin.
        target: the probability that is wanted.
    """
    seen: dict[float, tuple[float, float, float, str]] = {}

    def surplus(k: float) -> float:
        if k not in seen:
            seen[k] = trial(k)
        return math.log(max(seen[k][0], 1e-300) / target)

    low = high = min(max(first, _SMALLEST_FACTOR), _LARGEST_FACTOR)
    while surplus(high) > 0:
        low, high = high, high * _STRIDE
        if high > _LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {_LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    while surplus(low) <= 0:
        low, high = low / _STRIDE, low
        if low < _SMALLEST_FACTOR:
            value, lower, upper, warning = seen[high]
            return Found(0.0, 0.0, 0.0, value, lower, upper, RARE, 0, warning)
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
    return Found(k, k_low, k_high, reached[0], reached[1], reached[2], RARE, 0, note)


def _alarm_rate(unit_m: FloatArray, k: float, alert: AlertLimits, confidence: float) -> tuple[float, float, float]:
    """Share of the draws that alarm with this multiplier, with its bounds."""
    # Where there is no solution, or the method's test rejects, there is an alarm even for a multiplier of zero.
    alarms = int((np.isinf(unit_m) | (unit_m > alert.vertical_m / max(k, _SMALLEST_FACTOR))).sum())
    low, high = clopper_pearson(alarms, unit_m.size, confidence)
    return alarms / unit_m.size, float(low), float(high)


def _columns(found: Found, k_before: float) -> dict[str, object]:
    return {
        "found": found.found,
        "draws": found.draws,
        "k_vertical": found.k,
        "k_low": found.low,
        "k_high": found.high,
        "inflation": found.high / k_before,
        "probability": found.probability,
        "probability_low": found.probability_low,
        "probability_high": found.probability_high,
    }


def _alarm_columns(before: tuple[float, ...], after: tuple[float, ...]) -> dict[str, float]:
    return {
        f"alarm_rate_{when}{bound}": value
        for when, values in (("before", before), ("after", after))
        for bound, value in zip(("", "_low", "_high"), values, strict=True)
    }
