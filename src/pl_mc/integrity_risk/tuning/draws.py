"""Draws for a target that is too rare to be counted in them: importance sampling for limits that will move.

The risk at limits k0, k1 is a mean over draws from any density that covers the event, weighted by the ratio of
densities; the weights do not depend on the limits. So one set of draws serves the whole search, as long as the
proposal covers the event wherever the search goes: it is a mixture of proposals adapted at several limits, at a
level of the ratio that is passed more often than the target (`pl_mc.integrity_risk.rare.importance`), and it is
made again where the search ends.

Ten to thirty per cent of such an event are islands all over the bulk of the noise, too many and too small for any
mixture to be fitted to: a draw that meets one by luck would weigh as much as hundreds of the others, and the last
bits of a processor would decide how many effective draws there are (measured at 1e-4: 7 to 300, from seed to seed).
So half of the draws are plain ones with a ratio above a level that is passed some thirty times as often as the
target. Their density is that of the noise over the probability of that level, which the plain draws among which
they are found tell as well; together the two kinds count as one sample by the balance heuristic (Veach & Guibas
1995), in which no weight is above what such a plain draw has (measured: 180 to 310). For a target so rare that
hardly one of them would be in the event there are none, and the number of effective draws tells what was missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import RatioLimit
from pl_mc.integrity_risk.k_factor.from_curve import climb_ratios, mean_curve
from pl_mc.integrity_risk.rare.importance import adapted_proposal, log_normal
from pl_mc.integrity_risk.rare.limit_state import InCoordinates, Rotation, rotation
from pl_mc.integrity_risk.rare.mixture import Mixture, join
from pl_mc.integrity_risk.tuning.objective import TuningProblem, WeightedNoise

# Populations that find the level, and how much more often than the target it is passed: limits that move, and steps
# that are smooth, look at ratios on either side.
_POPULATIONS, _POINTS, _OFTEN = 2, 2048, 4.0
# Plain draws that look for the event, and evaluations of one search for a proposal, at the most.
_PLAIN, _MOST = 2**16, 500_000
# Share of the draws that are plain ones above a common level, and how much more often than the target it is passed:
# more often where finding those of one place among plain ones would take more than ``_MOST`` evaluations, and none
# at all where that is a level passed so much more often that few would be in the event.
_COMMON_SHARE, _COMMON, _TOO_COMMON = 0.5, 30.0, 1000.0


@dataclass(frozen=True)
class LimitedRatio(InCoordinates):
    """The ratio at limits that are no option of a record, so that one compiled function serves all of them.

    Attributes:
        problem: with the fault.
        fault: which of its faults.
        limits: (2,), k0 and k1.
        coordinates: of the points.
    """

    problem: TuningProblem
    fault: int
    limits: FloatArray
    coordinates: Rotation

    def ratio(self, points: FloatArray) -> FloatArray:
        """(N,), of points (N, dimension)."""
        return np.exp(self.problem.log_ratio(self.limits, self.fault, points @ self.coordinates.matrix.T))


@dataclass(frozen=True)
class CommonPart:
    """Plain noise where the ratio at some limits is above a level that is not rare.

    Attributes:
        state: the ratio at these limits.
        level: of the ratio.
    """

    state: LimitedRatio
    level: float

    def holds(self, points: FloatArray) -> NDArray[np.bool_]:
        """(N,), of points (N, dimension)."""
        return self.state.ratio(points) > self.level

    def draw(self, rng: np.random.Generator, draws: int) -> tuple[FloatArray, float, int]:
        """(draws, dimension), points; the probability of the level; and evaluations."""
        found, spent, held = [np.empty((0, self.state.dimension))], 0, 0
        while held < draws:
            points = rng.standard_normal((_PLAIN, self.state.dimension))
            found.append(points[self.holds(points)])
            spent, held = spent + _PLAIN, held + len(found[-1])
        return np.concatenate(found)[:draws], held / spent, spent


@dataclass(frozen=True)
class Proposal:
    """What the draws of one fault come from.

    Attributes:
        coordinates: of the mixture, the first ``active`` of all.
        parts: mixtures, in equal shares.
        commons: common parts, in equal shares of a share of their own.
    """

    coordinates: Rotation
    parts: tuple[Mixture, ...]
    commons: tuple[CommonPart, ...]

    def draw(self, rng: np.random.Generator, draws: int) -> tuple[FloatArray, FloatArray, int]:
        """(draws, n), whitened noise; (draws,), weights that add up to probabilities; and evaluations."""
        mixture = join([(1.0 / len(self.parts), part) for part in self.parts])
        active = self.coordinates.active
        each = int(_COMMON_SHARE * draws / max(len(self.commons), 1))
        mixed = draws - each * len(self.commons)
        points = rng.standard_normal((mixed, self.coordinates.matrix.shape[1]))
        points[:, :active] = mixture.draw(rng, mixed)
        found = [part.draw(rng, each) for part in self.commons]
        points = np.concatenate([points, *(own for own, _, _ in found)])
        inner = points[:, :active]
        # How many draws there are for one of the noise as it is: each part's number times its density over that.
        many = mixed * np.exp(mixture.log_density(inner) - log_normal(inner))
        for part, (_, probability, _) in zip(self.commons, found, strict=True):
            many += each / probability * part.holds(points)
        spent = sum(cost for _, _, cost in found) + draws * len(self.commons)
        return points @ self.coordinates.matrix.T, 1.0 / many, spent


def weighted_noise(
    problem: TuningProblem,
    places: Sequence[FloatArray],
    rng: np.random.Generator,
    draws: int,
    before: Sequence[Proposal] = (),
) -> tuple[WeightedNoise, tuple[Proposal, ...], int]:
    """Draws for every fault from proposals adapted at limits ``places``, besides those of ``before``.

    Returns:
        The draws, with ``draws`` plain ones for the price; the proposals, one for each fault; and scenarios
        computed.
    """
    proposals, spent = [], 0
    for k, bias in enumerate(problem.bias_m):
        seen, sky = np.ones(len(problem.sigma_m), dtype=bool), (problem.design, problem.sigma_m)
        turned = before[k].coordinates if before else rotation(*sky, seen, bias, problem.axis)
        parts = list(before[k].parts) if before else []
        commons = list(before[k].commons) if before else []
        for limits in places:
            state = LimitedRatio(problem, k, limits, turned)
            often = min(_OFTEN * problem.target, 0.1)
            ladders = [climb_ratios(state, rng, target=often, size=_POINTS) for _ in range(_POPULATIONS)]
            level = mean_curve(ladders, often).k_factor(often, 0.5)[0]
            spent += sum(one.evaluations for one in ladders)
            if not np.isfinite(level):
                continue
            # Where the level is common enough, plain draws meet regions in the proportion in which they count.
            points = rng.standard_normal((_PLAIN, state.dimension))
            ratio = state.ratio(points)
            found, cost = adapted_proposal(RatioLimit(state, level), rng, points[ratio > level], _MOST)
            spent += _PLAIN + cost
            if found is None:
                continue
            parts.append(found)
            least = _COMMON_SHARE * draws / (len(commons) + len(places)) / _MOST
            share = min(max(_COMMON * problem.target, least), 0.5)
            if share <= _TOO_COMMON * problem.target:
                commons.append(CommonPart(state, float(np.quantile(ratio, 1.0 - share))))
        proposals.append(Proposal(turned, tuple(parts), tuple(commons)))
    plain = rng.standard_normal((draws, len(problem.sigma_m)))
    noise, weight = [], []
    for one in proposals:
        # A fault under which nothing reaches the level has no say; noise as it is then serves.
        own, heavy, cost = one.draw(rng, draws) if one.parts else (plain, np.full(draws, 1.0 / draws), 0)
        noise.append(own)
        weight.append(heavy)
        spent += cost
    return WeightedNoise(plain, np.stack(noise), np.stack(weight)), tuple(proposals), spent
