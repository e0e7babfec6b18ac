"""The multiplier from a curve of P(event) against it, checked by an estimator that knows nothing of the curve.

Subset simulation on the ratio gives the curve; importance sampling, with random numbers of its own, the probability
at the multiplier that the curve names. The event of a robust estimate lies in as many regions as there are sets of
satellites to reject, of which a search from stronger noise alone meets too few; so the proposals start from
populations of nominal noise besides, which share nothing with those of the curve. Where the two estimates do not
bear each other out there is a warning and no number.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import RatioState
from pl_mc.integrity_risk.k_factor.exceedance_curve import ExceedanceCurve, exceedance_curve
from pl_mc.integrity_risk.k_factor.record import RARE, Found
from pl_mc.integrity_risk.rare.importance import importance_sampling
from pl_mc.integrity_risk.rare.risk import judge
from pl_mc.integrity_risk.rare.subset import Sampled, SubsetRun, climb

# The curve gets this share of the evaluations, and the check's own populations this one, at the most.
_CURVE_SHARE, _START_SHARE = 0.5, 0.15
_POPULATIONS, _POPULATION = 4, 2048


@dataclass(frozen=True)
class Calibrated:
    """A multiplier, and the curve that it comes from."""

    found: Found
    curve: ExceedanceCurve


def from_curve(
    state: RatioState,
    *,
    target: float,
    confidence: float,
    key: tuple[int, int],
    name: str,
    target_cov: float,
    most_evaluations: int,
) -> Calibrated:
    """The multiplier with which P(event) is the target.

    Args:
        state: the ratio of the event.
        target: the probability that is wanted.
        confidence: of either bound of the multiplier.
        key: seed and epoch; with ``name`` they choose the random numbers.
        name: of method, event and fault.
        target_cov: relative standard error of both estimates.
        most_evaluations: of both together.
    """
    seeds = np.random.SeedSequence((*key, zlib.crc32(name.encode()))).spawn(2)
    first, second = (np.random.default_rng(seed) for seed in seeds)
    budget = int(_CURVE_SHARE * most_evaluations)
    curve = exceedance_curve(state, first, target=target, target_cov=target_cov, most_evaluations=budget)
    k, low, high = curve.k_factor(target, confidence)

    def nothing(spent: int, note: str, **checked: float) -> Calibrated:
        return Calibrated(Found(np.nan, 0.0, np.inf, np.nan, 0.0, 1.0, RARE, spent, note, **checked), curve)

    if not np.isfinite(k):
        return nothing(curve.evaluations, "no population of subset simulation came down to the target")
    probability, error = curve.at(k)
    known, spent = _start(state.at(k), second, int(_START_SHARE * most_evaluations))
    left = most_evaluations - curve.evaluations - spent
    run = importance_sampling(state.at(k), second, target_cov=target_cov, most_evaluations=left, known=known)
    spent += curve.evaluations + run.evaluations
    if np.isnan(run.probability):
        where = f"at K = {k:.4g}, where subset simulation puts {target:g}"
        return nothing(spent, f"importance sampling never met the event {where}")
    check = SubsetRun(probability, error, curve.populations, curve.evaluations)
    verdict = judge(run, check, evaluations=run.evaluations, target_cov=target_cov)
    notes = [f"at K = {k:.4g}: {verdict.warning}"] if verdict.warning else []
    checked = {"check_probability": run.probability, "check_low": verdict.low, "check_high": verdict.high}
    if np.isnan(verdict.probability):
        # Neither is known to be right: no multiplier, and no bound of it.
        return nothing(spent, "; ".join(notes), **checked)
    if not np.isfinite(high):
        notes.append("no upper bound was reached")
    if low <= 0.0:
        notes.append("no lower bound was reached")
    reached = curve.at(high)[0] if np.isfinite(high) else np.nan
    places = curve.bounds(confidence)
    lower, upper = (
        float(np.interp(np.log(high), np.log(curve.k), values)) if np.isfinite(high) else value
        for values, value in zip(places, (0.0, 1.0), strict=True)
    )
    found = Found(k, low, high, reached, lower, min(upper, 1.0), RARE, spent, "; ".join(notes), **checked)
    return Calibrated(found, curve)


def _start(limit: Sampled, rng: np.random.Generator, most_evaluations: int) -> tuple[FloatArray, int]:
    """Points in the event from populations of nominal noise, as many from each, and what they cost."""
    points, spent = [np.empty((0, limit.dimension))], 0
    for _ in range(_POPULATIONS):
        run = climb(limit, rng, size=_POPULATION, most_evaluations=most_evaluations - spent)
        spent += run.evaluations
        points.append(run.points[: _POPULATION // _POPULATIONS])
    return np.concatenate(points), spent
