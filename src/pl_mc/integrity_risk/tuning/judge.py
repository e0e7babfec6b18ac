"""Limits of IGG-III as they are, not smoothed: the multiplier that they need, and what it costs, on fresh noise.

A target that is common enough is counted: the multiplier is an order statistic. A rarer one takes the curve of the
risk against the multiplier from subset simulation, with the check of importance sampling beside it
(`pl_mc.integrity_risk.k_factor.from_curve`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.k_factor.calibrated import COUNTING, NO_CHECK, RARE, order_bounds
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import EXCEEDED, MISLEADING, ratio_state
from pl_mc.integrity_risk.k_factor.from_curve import from_curve
from pl_mc.integrity_risk.tuning.objective import ALARMS, Draws, TuningProblem, cost, weighted_quantile
from pl_mc.methods import Igg3
from pl_mc.statistics.intervals import clopper_pearson, rate_columns

SAMPLES = 200
# Ratios that may come into a resampled quantile, for each rank.
_TAIL_FACTOR, _TAIL_LEAST = 4, 200


@dataclass(frozen=True)
class Judged:
    """One pair of limits on fresh noise.

    Attributes:
        objective: the price at the multiplier that keeps the target with the confidence; NaN where none is known.
        resampled: (SAMPLES,), the same of resampled draws, which are the same for every pair of limits.
        columns: what `pl_mc.tune` says of them besides.
        warning: empty, or what is in doubt.
    """

    objective: float
    resampled: FloatArray
    columns: dict[str, Any]
    warning: str = ""


def counted_limits(
    problem: TuningProblem, limits: FloatArray, fresh: FloatArray, last: FloatArray, weights: NDArray[np.uint8],
    faults: Faults, confidence: float,
) -> Judged:  # fmt: skip
    """Limits (k0, k1) at the order statistic that keeps the target.

    ``fresh`` and ``last`` are whitened noise (N, n), for multiplier and price and for the risk at that multiplier;
    ``weights`` (SAMPLES, N) say how often each draw of the former is in a resample.
    """
    drawn = problem.draws(limits, fresh)
    unit = drawn.log_unit_m
    rank, low_rank = order_bounds(len(fresh), problem.target, confidence)
    tail = min(_TAIL_FACTOR * rank + _TAIL_LEAST, len(fresh))
    largest = [np.argsort(-row, kind="stable")[:tail] for row in drawn.log_ratio]
    resampled = np.empty(len(weights))
    for sample, weight in enumerate(weights):
        ranks = [int(np.searchsorted(weight[order].cumsum(dtype=np.int64), rank)) for order in largest]
        again = max(
            float(np.exp(row[order[min(at, tail - 1)]]))
            for row, order, at in zip(drawn.log_ratio, largest, ranks, strict=True)
        )
        resampled[sample] = price(problem, again, unit, weight)
    k = k_factor(drawn, problem.target, confidence)
    best = ranked(drawn.log_ratio, max(1, round(len(fresh) * problem.target)))
    k_low = ranked(drawn.log_ratio, low_rank) if low_rank <= len(fresh) else 0.0
    events = (problem.draws(limits, last).log_ratio > np.log(k)).sum(axis=1)
    worst = int(events.argmax())
    low, high = clopper_pearson(int(events[worst]), len(last), confidence)
    risk = (events[worst] / len(last), float(low), float(high))
    columns = _columns(problem, (k, best, k_low), COUNTING, unit, confidence, risk, faults.labels[worst])
    return Judged(price(problem, k, unit), resampled, columns | NO_CHECK)


def estimated_limits(
    g: Geometry, problem: TuningProblem, limits: FloatArray, fresh: FloatArray, weights: NDArray[np.uint8],
    faults: Faults, confidence: float, *, record: Igg3, alert: AlertLimits, seed: int, target_cov: float,
    max_evaluations: int,
) -> Judged:  # fmt: skip
    """Limits at the upper bound of the multiplier that the curve of each fault gives; else as `counted_limits`.

    ``fresh`` is for the price alone, ``record`` the estimate, whose limits are of no account; the last three are
    those of the curves and their checks, for each fault.
    """
    k0, k1 = (float(value) for value in limits)
    method = replace(record, k0=k0, k1=k1)
    event = MISLEADING if problem.misleading else EXCEEDED
    # The vertical is not named: it has had these random numbers all along.
    named = () if problem.axis == VERTICAL else (problem.axis,)
    found = [
        from_curve(
            ratio_state(g, faults.only(k), method, event, alert, problem.axis), target=problem.target,
            confidence=confidence, key=(seed, int(g.epoch)), target_cov=target_cov, most_evaluations=max_evaluations,
            name="/".join(("tuned", method.name, event, label, *named)),
        )
        for k, label in enumerate(faults.labels)
    ]  # fmt: skip
    rows = [one.found for one in found]
    notes = [f"{label}: {row.warning}" for label, row in zip(faults.labels, rows, strict=True) if row.warning]
    if not np.isfinite([(row.k, row.high) for row in rows]).all():
        return unknown_limits(problem, "; ".join(notes) or "no multiplier is known", draws=len(fresh))
    worst = int(np.argmax([row.high for row in rows]))
    row, k = rows[worst], rows[worst].high
    unit = replace(problem, bias_m=np.zeros((1, len(problem.sigma_m)))).draws(limits, fresh).log_unit_m
    k_all = (k, max(row.k for row in rows), max(row.low for row in rows))
    risk = (row.probability, row.probability_low, row.probability_high)
    columns = _columns(problem, k_all, RARE, unit, confidence, risk, faults.labels[worst]) | row.check
    reach = special.stdtrit(found[worst].curve.populations - 1, confidence)
    spread = np.log(row.high / max(row.low, 1e-300)) / 2.0 / reach
    # Errors of the multiplier, other ones for other limits.
    key = (seed, 2, *np.asarray(limits, dtype=float).view(np.uint32).tolist())
    factors = [float(np.exp(spread * shift)) for shift in np.random.default_rng(key).standard_normal(len(weights))]
    resampled = np.array([price(problem, k * by, unit, own) for by, own in zip(factors, weights, strict=True)])
    return Judged(price(problem, k, unit), resampled, columns, "; ".join(notes))


def unknown_limits(problem: TuningProblem, reason: str, draws: int = 0) -> Judged:
    """Limits of which nothing is said but why, and of how many fault-free draws."""
    columns: dict[str, Any] = dict.fromkeys((f"k_{problem.axis}", "k_best", "k_low"), np.nan) | {"found": RARE}
    columns |= dict.fromkeys((f"{problem.level}_m", "alarm_rate", "alarm_low", "alarm_high"), np.nan) | {"alarms": 0}
    columns |= {"draws": draws, "risk": np.nan, "risk_low": 0.0, "risk_high": 1.0, "risk_fault": ""} | NO_CHECK
    return Judged(np.nan, np.full(SAMPLES, np.nan), columns, reason)


def k_factor(drawn: Draws, target: float, confidence: float) -> float:
    """The order statistic that keeps the target with the confidence; of weighted draws a quantile."""
    if drawn.weight is not None:
        pairs = zip(drawn.log_ratio, drawn.weight, strict=True)
        return float(np.exp(max(weighted_quantile(row, weight, target) for row, weight in pairs)))
    rank, _ = order_bounds(drawn.log_ratio.shape[1], target, confidence)
    return ranked(drawn.log_ratio, rank)


def ranked(log_ratio: FloatArray, rank: int) -> float:
    """The largest, over the faults, of their ratios with this rank, counted from 1 for the largest."""
    place = log_ratio.shape[1] - rank
    return float(np.exp(max(np.partition(row, place)[place] for row in log_ratio)))


def price(problem: TuningProblem, k: float, log_unit_m: FloatArray, weight: NDArray[np.uint8] | None = None) -> float:
    """The objective as it is: the mean over draws that have one."""
    each = cost(problem.objective, k, log_unit_m, problem.limit_m)
    known = ~np.isnan(each)
    return float(np.average(each[known], weights=None if weight is None else weight[known]))


def _columns(
    problem: TuningProblem, k: tuple[float, float, float], found: str, log_unit_m: FloatArray, confidence: float,
    risk: tuple[float, float, float], fault: str,
) -> dict[str, Any]:  # fmt: skip
    """Multipliers, then mean level and alarms, fault-free, whichever of them is the objective, and the risk."""
    alarms = int(cost(ALARMS, k[0], log_unit_m, problem.limit_m).sum())
    low, high = clopper_pearson(alarms, len(log_unit_m), confidence)
    return {
        **dict(zip((f"k_{problem.axis}", "k_best", "k_low"), k, strict=True)),
        "found": found,
        f"{problem.level}_m": float(np.nanmean(cost(problem.level, k[0], log_unit_m, problem.limit_m))),
        "alarms": alarms,
        "draws": len(log_unit_m),
        **rate_columns("alarm", alarms / len(log_unit_m), float(low), float(high)),
        **dict(zip(("risk", "risk_low", "risk_high"), risk, strict=True)),
        "risk_fault": fault,
    }
