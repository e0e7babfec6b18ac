"""Draws for a target that is too rare to be counted in them: importance sampling for limits that will move.

The risk at limits k0, k1 is a mean over draws from any density that covers the event, weighted by the ratio of
densities; the weights do not depend on the limits. So one set of draws serves the whole search, as long as the
proposal covers the event wherever the search goes: it is a mixture of proposals adapted at several limits, at a
level of the ratio that is passed more often than the target (`pl_mc.integrity_risk.rare.importance`), and it is
made again where the search ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
class Proposal:
    """What the draws of one fault come from.

    Attributes:
        coordinates: of the mixture, the first ``active`` of all.
        parts: mixtures, in equal shares.
    """

    coordinates: Rotation
    parts: tuple[Mixture, ...]

    def draw(self, rng: np.random.Generator, draws: int) -> tuple[FloatArray, FloatArray]:
        """(draws, n), whitened noise, and (draws,), weights that add up to probabilities."""
        mixture = join([(1.0 / len(self.parts), part) for part in self.parts])
        active = self.coordinates.active
        points = rng.standard_normal((draws, self.coordinates.matrix.shape[1]))
        points[:, :active] = mixture.draw(rng, draws)
        inner = points[:, :active]
        weight = np.exp(log_normal(inner) - mixture.log_density(inner))
        return points @ self.coordinates.matrix.T, weight / draws


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
        seen = np.ones(len(problem.sigma_m), dtype=bool)
        turned = before[k].coordinates if before else rotation(problem.design, problem.sigma_m, seen, bias)
        parts = list(before[k].parts) if before else []
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
            met = points[state.ratio(points) > level]
            found, cost = adapted_proposal(RatioLimit(state, level), rng, met, _MOST)
            spent += _PLAIN + cost
            parts += [found] if found is not None else []
        proposals.append(Proposal(turned, tuple(parts)))
    plain = rng.standard_normal((draws, len(problem.sigma_m)))
    # A fault under which nothing reaches the level has no say; noise as it is then serves.
    each = [one.draw(rng, draws) if one.parts else (plain, np.full(draws, 1.0 / draws)) for one in proposals]
    noise, weight = (np.stack(parts) for parts in zip(*each, strict=True))
    return WeightedNoise(plain, noise, weight), tuple(proposals), spent
