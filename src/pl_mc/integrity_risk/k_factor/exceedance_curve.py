"""P(event) against the multiplier, from one run of subset simulation on the ratio.

A population climbs through ratios r1 < r2 < ...; its points above r_j are distributed as the noise is where the
ratio is above r_j, so that the share of them above K is P(ratio > K) / P(ratio > r_j), for every K beyond. Several
populations, each with random numbers of its own, give the mean curve and, by their scatter, its error; the curve at
one multiplier is the estimate of Au & Beck 2001 (Probabilistic Engineering Mechanics 16:263-277).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import Ratio
from pl_mc.integrity_risk.rare.subset import LEVEL_FRACTION, MOST_LEVELS, MOVES, move, systematic

# Points of a population; populations at the least and at the most.
POPULATION = 4096
_FEWEST, _MOST = 6, 40
# Multipliers of a curve, in equal steps of the logarithm.
_STEPS = 1200


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
        reach = np.exp(np.minimum(stats.t.ppf(confidence, self.populations - 1) * cov, 300.0))
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
        return (
            self._crossing(self.probability, target),
            self._crossing(low, target, none=0.0),
            self._crossing(high, target, none=np.inf),
        )

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


def climb_ratios(
    state: Ratio, rng: np.random.Generator, *, target: float, size: int = POPULATION, moves: int = MOVES
) -> Ladder:
    """One population, until the probability of the ratios that it has climbed is at most the target.

    Args:
        state: the ratio.
        rng: its random numbers.
        target: probability down to which the curve is wanted; points go on for a decade or two beyond.
        size, moves: points, and moves of each at every level.
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
        points, values, step = move(state.ratio, rng, points[chosen], values[chosen], level, sigma, step, moves)
        spent += moves * size
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
    """The curve from populations that are added until its error at the target is what is asked for.

    Args:
        state: the ratio.
        rng: random numbers of this estimator alone.
        target: probability at which the multiplier is wanted.
        target_cov: standard error over probability there that is aimed at.
        most_evaluations: or until another population might need more than this in all.
        size, fewest: points of a population; populations, two at the least.
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
    last = min(float(ladder.ratios[-1][-1]) for ladder in ladders)
    if not all(each.size for each in positive) or not 0.0 < last < np.inf:
        # No event at all, or levels of zero among the points: there is no curve.
        nothing = np.zeros(1)
        return ExceedanceCurve(np.ones(1), nothing, nothing, len(ladders), sum(one.evaluations for one in ladders))
    first = min(float(np.median(each)) for each in positive)
    k = np.geomspace(first, last, _STEPS)
    each = np.stack([ladder.probability(k) for ladder in ladders])
    # Beyond a decade or two below the target few points are left, and a curve of few is none.
    enough = each.mean(axis=0) > target / 100.0
    error = each.std(axis=0, ddof=1) / np.sqrt(len(ladders))
    return ExceedanceCurve(
        k=k[enough],
        probability=each.mean(axis=0)[enough],
        standard_error=error[enough],
        populations=len(ladders),
        evaluations=sum(ladder.evaluations for ladder in ladders),
    )
