"""The multiplier from a curve of P(event) against it, checked by an estimator that knows nothing of the curve.

The curve comes from one run of subset simulation on the ratio. A population climbs through ratios r1 < r2 < ...;
its points above r_j are distributed as the noise is where the ratio is above r_j, so that the share of them above K
is P(ratio > K) / P(ratio > r_j), for every K beyond. Several populations, each with random numbers of its own, give
the mean curve and, by their scatter, its error; the curve at one multiplier is the estimate of Au & Beck 2001
(Probabilistic Engineering Mechanics 16:263-277).

Importance sampling, with random numbers of its own, gives the probability at the multiplier that the curve names.
The event of a robust estimate lies in as many regions as there are sets of satellites to reject, of which a search
from stronger noise alone meets too few; so the proposals start from populations of nominal noise besides, which
share nothing with those of the curve. Where the two estimates do not bear each other out there is a warning and no
number.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.k_factor.calibrated import NO_CHECK, RARE, KFactor
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import Ratio, RatioState
from pl_mc.integrity_risk.rare.importance import ImportanceRun, importance_sampling
from pl_mc.integrity_risk.rare.risk import judge
from pl_mc.integrity_risk.rare.subset import (
    LEVEL_FRACTION,
    MOST_LEVELS,
    MOVES,
    Sampled,
    SubsetRun,
    climb,
    move,
    systematic,
)

# Points of a population; populations at the least and at the most.
POPULATION = 4096
_FEWEST, _MOST = 6, 40
# Multipliers of a curve, in equal steps of the logarithm.
_STEPS = 1200
# The curve gets this share of the evaluations, and the check's own populations this one, at the most.
_CURVE_SHARE, _START_SHARE = 0.5, 0.15
_STARTS, _START_POINTS = 4, 2048


@dataclass(frozen=True)
class Ladder:
    """One population's way: the ratios of its points above each level, ascending.

    Attributes:
        levels: (j,), ratios that were climbed, the first of them zero.
        log_probabilities: (j,), logarithm of the estimated probability of a ratio above each.
        ratios: j of (points,), ascending.
        evaluations: ratios computed.
    """

    levels: FloatArray
    log_probabilities: FloatArray
    ratios: tuple[FloatArray, ...]
    evaluations: int

    def probability(self, k: FloatArray) -> FloatArray:
        """(m,), estimated P(ratio > k), each from the points above the highest level that is not above k."""
        rung = np.searchsorted(self.levels, k, side="right") - 1
        found = np.empty(k.shape)
        for j, ratios in enumerate(self.ratios):
            at = rung == j
            above = ratios.size - np.searchsorted(ratios, k[at], side="right")
            found[at] = np.exp(self.log_probabilities[j]) * above / ratios.size
        return found


@dataclass(frozen=True)
class ExceedanceCurve:
    """The mean curve of several populations.

    Attributes:
        k: (m,), multipliers, ascending.
        probability: (m,), P(event) at each.
        standard_error: (m,), from the scatter between the populations.
        populations: how many.
        evaluations: ratios computed by all of them.
    """

    k: FloatArray
    probability: FloatArray
    standard_error: FloatArray
    populations: int
    evaluations: int

    def bounds(self, confidence: float) -> tuple[FloatArray, FloatArray]:
        """Bounds of the probability at each multiplier, each with the confidence; its logarithm is about Student's.

        Where no population has a point left nothing bounds the curve: zero and one.
        """
        known = self.probability > 0
        cov = self.standard_error / np.where(known, self.probability, 1.0)
        reach = np.exp(np.minimum(special.stdtrit(self.populations - 1, confidence) * cov, 300.0))
        low, high = self.probability / reach, np.minimum(self.probability * reach, 1.0)
        return np.where(known, low, 0.0), np.where(known, high, 1.0)

    def at(self, k: float) -> tuple[float, float]:
        """Probability and standard error at one multiplier within the curve, between its points on logarithms."""
        place = np.log(self.k)
        known = self.probability > 0
        probability, error = (
            float(np.exp(np.interp(np.log(k), place[known], np.log(np.maximum(values[known], 1e-300)))))
            for values in (self.probability, self.standard_error)
        )
        return probability, error

    def k_factor(self, target: float, confidence: float) -> tuple[float, float, float]:
        """The multiplier at which the curve is the target, and bounds that each have the confidence.

        The upper bound is the smallest beyond which the curve's upper bound stays at or below the target, as far as
        points of all populations reach; the lower one likewise. They are infinite and zero where there is none.
        """
        low, high = self.bounds(confidence)
        k_low, k_high = self._crossing(low, target, none=0.0), self._crossing(high, target, none=np.inf)
        return self._crossing(self.probability, target), k_low, k_high

    def reaching(self, probability: float, *, none: float) -> float:
        """The multiplier at which the curve passes a probability; ``none`` where it never does."""
        return self._crossing(self.probability, probability, none)

    def _crossing(self, values: FloatArray, target: float, none: float = np.nan) -> float:
        """Where values that fall on the whole last pass the target."""
        reached = self.probability > 0
        above = np.flatnonzero((values > target) & reached)
        if above.size == 0:
            return none
        last = int(above[-1])
        if last + 1 >= self.k.size or not reached[last + 1] or values[last + 1] <= 0:
            return none
        x0, x1 = np.log(self.k[last : last + 2])
        y0, y1 = np.log(values[last : last + 2] / target)
        return float(np.exp(x0 + (x1 - x0) * y0 / (y0 - y1)))


def climb_ratios(state: Ratio, rng: np.random.Generator, *, target: float, size: int = POPULATION) -> Ladder:
    """One population of ``size`` points, until the probability of the ratios it has climbed is at most the target.

    Points go on for a decade or two beyond.
    """
    points = rng.standard_normal((size, state.dimension))
    values = state.ratio(points)
    sigma = np.ones(state.dimension)
    levels, logs, kept, spent = [0.0], [0.0], [np.sort(values)], size
    step = 0.5
    for _ in range(MOST_LEVELS):
        if logs[-1] <= np.log(target):
            break
        level = float(np.quantile(values, 1.0 - LEVEL_FRACTION, method="lower"))
        inside = values > level
        if not inside.any() or not np.isfinite(level):
            break
        chosen = systematic(rng, inside.astype(float), size)
        points, values, step = move(state.ratio, rng, points[chosen], values[chosen], level, sigma, step, MOVES)
        spent += MOVES * size
        levels.append(level)
        logs.append(logs[-1] + float(np.log(inside.mean())))
        kept.append(np.sort(values))
    return Ladder(np.array(levels), np.array(logs), tuple(kept), spent)


def exceedance_curve(
    state: Ratio,
    rng: np.random.Generator,
    *,
    target: float,
    target_cov: float,
    most_evaluations: int,
    size: int = POPULATION,
    fewest: int = _FEWEST,
) -> ExceedanceCurve:
    """The curve from populations of ``size`` points, ``fewest`` of them (two or more) at the least.

    They are added until standard error over probability at the target is ``target_cov``, or another one might need
    more than ``most_evaluations`` in all.
    """
    ladders: list[Ladder] = []
    spent = 0
    while True:
        ladders.append(climb_ratios(state, rng, target=target, size=size))
        spent += ladders[-1].evaluations
        if len(ladders) < min(fewest, _MOST):
            continue
        curve = mean_curve(ladders, target)
        k = curve.k_factor(target, 0.5)[0]
        if np.isfinite(k):
            probability, error = curve.at(k)
            if error <= target_cov * probability:
                break
        if len(ladders) >= _MOST or spent + ladders[-1].evaluations > most_evaluations:
            break
    return curve


def mean_curve(ladders: list[Ladder], target: float) -> ExceedanceCurve:
    """The mean of populations, as far as each of them has points, from where the event is common."""
    positive = [ladder.ratios[0][ladder.ratios[0] > 0] for ladder in ladders]
    last, spent = min(float(one.ratios[-1][-1]) for one in ladders), sum(one.evaluations for one in ladders)
    if not all(each.size for each in positive) or not 0.0 < last < np.inf:
        # No event at all, or levels of zero among the points: there is no curve.
        nothing = np.zeros(1)
        return ExceedanceCurve(np.ones(1), nothing, nothing, len(ladders), spent)
    first = min(float(np.median(each)) for each in positive)
    k = np.geomspace(first, last, _STEPS)
    each = np.stack([ladder.probability(k) for ladder in ladders])
    # Beyond a decade or two below the target few points are left, and a curve of few is none.
    probability, error = each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(len(ladders))
    enough = probability > target / 100.0
    return ExceedanceCurve(k[enough], probability[enough], error[enough], len(ladders), spent)


@dataclass(frozen=True)
class Calibrated:
    """A multiplier, and the curve that it comes from."""

    found: KFactor
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
    """The multiplier with which P(event) is the target, and bounds that each have the confidence.

    ``key``, seed and epoch, and ``name``, of method, event and fault, choose the random numbers; ``target_cov`` is
    asked of both estimates, ``most_evaluations`` counts those of both together.
    """
    seeds = np.random.SeedSequence((*key, zlib.crc32(name.encode()))).spawn(2)
    first, second = (np.random.default_rng(seed) for seed in seeds)
    budget = int(_CURVE_SHARE * most_evaluations)
    curve = exceedance_curve(state, first, target=target, target_cov=target_cov, most_evaluations=budget)
    k, low, high = curve.k_factor(target, confidence)

    def nothing(spent: int, note: str, checked: dict[str, float] = NO_CHECK) -> Calibrated:
        return Calibrated(KFactor(np.nan, 0.0, np.inf, np.nan, 0.0, 1.0, RARE, spent, note, checked), curve)

    if not np.isfinite(k):
        return nothing(curve.evaluations, "no population of subset simulation came down to the target")
    probability, error = curve.at(k)
    known, spent = starting_points(state.at(k), second, int(_START_SHARE * most_evaluations))
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
        return nothing(spent, "; ".join(notes), checked)
    low, high = holding_both(curve, run, (low, high), target=target, confidence=confidence)
    if not np.isfinite(high):
        notes.append("no upper bound was reached")
    if low <= 0.0:
        notes.append("no lower bound was reached")
    reached, lower, upper = np.nan, 0.0, 1.0
    if np.isfinite(high):
        reached = curve.at(high)[0]
        lower, upper = (float(np.interp(np.log(high), np.log(curve.k), values)) for values in curve.bounds(confidence))
    found = KFactor(k, low, high, reached, lower, min(upper, 1.0), RARE, spent, "; ".join(notes), checked)
    return Calibrated(found, curve)


def holding_both(
    curve: ExceedanceCurve, run: ImportanceRun, bounds: tuple[float, float], *, target: float, confidence: float
) -> tuple[float, float]:
    """Bounds of the multiplier that hold those of the curve and those that importance sampling asks for.

    The latter are where the curve, moved to the probability that importance sampling bounds at the curve's own
    multiplier, is the target: both then use the curve's slope alone.
    """
    reach = float(np.exp(min(special.stdtrit(run.dof, confidence) * run.standard_error / run.probability, 300.0)))
    asked = target**2 / run.probability
    low, high = bounds
    return min(low, curve.reaching(asked * reach, none=0.0)), max(high, curve.reaching(asked / reach, none=np.inf))


def starting_points(limit: Sampled, rng: np.random.Generator, most_evaluations: int) -> tuple[FloatArray, int]:
    """Points in the event from populations of nominal noise, as many from each, and what they cost."""
    points, spent = [np.empty((0, limit.dimension))], 0
    for _ in range(_STARTS):
        run = climb(limit, rng, size=_START_POINTS, most_evaluations=most_evaluations - spent)
        spent += run.evaluations
        points.append(run.points[: _START_POINTS // _STARTS])
    return np.concatenate(points), spent
