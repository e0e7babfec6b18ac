"""Importance sampling of a rare event, with mixtures adapted to every region in which the event was found.

Populations explore from the nominal noise and from stronger ones; mixtures are fitted to what they found and
refined in rounds (cross-entropy: de Boer et al. 2005, Annals of Operations Research 134:19-67). The estimate comes
from a last, independent sample of a fixed proposal, which always keeps a part of the first mixture and of noise of
several strengths (a defensive part: Hesterberg 1995, Technometrics 37:185-194). But for the choice to stop at the
precision asked for it is unbiased, whatever was explored.

A region that no draw met is missing from an estimate and from its error alike. So all of this is done several
times, each time from the start, and where the results scatter more than their weights explain the scatter is the
error. What this cannot see is an event scattered over many small islands, each of which a search meets by luck:
then most seeds give too little, and few give far too much with an error to match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.rare.mixture import Mixture, fit, join, normal
from pl_mc.integrity_risk.rare.subset import MOVES, Sampled, climb, rejuvenate

# Searches, each with an exploration, a proposal and a last sample of its own: at least, and at most.
FEWEST_SEARCHES, _MOST_SEARCHES = 4, 16
# Noise in which the exploring populations start, their size, and how many of their points are fitted. The strong
# ones come first: where evaluations run out, it is they that reach the rarest events.
_EXPLORING_NOISE = (3.0, 2.0, 1.5, 1.0)
_POPULATION = 1024
_FITTED = 2048
# Shares and strengths of the defensive noise, and the share of the one whose strength is found.
_DEFENSIVE = ((0.03, 1.0), (0.03, 1.5), (0.03, 2.0), (0.03, 3.0))
_STRENGTH_SHARE = 0.08
_EXPLORED_SHARE = 0.2
_COMPONENTS = 20
# Draws of each round of adaptation: the last one is large enough to meet what the first ones overlooked.
_ROUND_SIZES = (8192, 16384, 32768)
_REJUVENATED = 2048
# Draws of the last sample of a search are added in such batches.
_BATCH = 32768


@dataclass(frozen=True)
class ImportanceRun:
    """What importance sampling found.

    Attributes:
        probability: the estimate; NaN where the event was never met.
        standard_error: its standard error, from the weights or from the scatter between searches, if that is more.
        dof: degrees of freedom behind the standard error.
        ess: effective sample size of the draws in the event, (sum w)^2 / sum w^2.
        largest_share: share of the sum of weights that the heaviest draw carries.
        evaluations: limit states computed, exploration and rounds included.
    """

    probability: float
    standard_error: float
    dof: float
    ess: float
    largest_share: float
    evaluations: int


class Tally:
    """Running sums of weights, without overflow or underflow whatever their size."""

    def __init__(self) -> None:
        self.log_scale = -np.inf
        self.first, self.second, self.largest, self.draws = 0.0, 0.0, 0.0, 0

    def add(self, log_weights: FloatArray, draws: int) -> None:
        """Weights of the draws in the event, of ``draws`` draws."""
        if not log_weights.size:
            self._add(-np.inf, 0.0, 0.0, 0.0, draws)
            return
        scale = float(log_weights.max())
        weight = np.exp(log_weights - scale)
        self._add(scale, float(weight.sum()), float((weight**2).sum()), 1.0, draws)

    def merge(self, other: Tally) -> None:
        """The draws of another tally."""
        self._add(other.log_scale, other.first, other.second, other.largest, other.draws)

    def _add(self, log_scale: float, first: float, second: float, largest: float, draws: int) -> None:
        self.draws += draws
        scale = max(self.log_scale, log_scale)
        if scale == -np.inf:
            return
        here, there = np.exp(self.log_scale - scale), np.exp(log_scale - scale)
        self.first = self.first * here + first * there
        self.second = self.second * here**2 + second * there**2
        self.largest = max(self.largest * here, largest * there)
        self.log_scale = scale

    @property
    def probability(self) -> float:
        """Mean weight; 0 where no draw was in the event."""
        return float(np.exp(self.log_scale) * self.first / self.draws) if self.first else 0.0

    @property
    def relative_error(self) -> float:
        """Standard error of the mean weight over the mean; infinite where no draw was in the event."""
        if not self.first:
            return np.inf
        return float(np.sqrt(max(self.second / self.first**2 - 1.0 / self.draws, 0.0)))


def importance_sampling(
    limit: Sampled, rng: np.random.Generator, *, target_cov: float, most_evaluations: int,
    known: FloatArray | None = None, fewest_searches: int = FEWEST_SEARCHES,
) -> ImportanceRun:  # fmt: skip
    """Estimate P(limit state > 0), with random numbers of this estimator alone.

    The samples grow until standard error / estimate is at most ``target_cov``, or more would need more limit states
    than ``most_evaluations``. Every search starts from the points (N, dimension) ``known`` to be in the event too.
    ``fewest_searches`` share a budget at the least.
    """
    known = np.empty((0, limit.dimension)) if known is None else known
    searches: list[tuple[Mixture, Tally]] = []
    spent = 0
    # A single search leaves no more than two batches to be drawn.
    each = most_evaluations // (fewest_searches + 1) if fewest_searches > 1 else most_evaluations - 2 * _BATCH

    def search() -> None:
        nonlocal spent
        proposal, cost = adapted_proposal(limit, rng, known, each - _BATCH)
        spent += cost
        if proposal is not None:
            searches.append((proposal, Tally()))

    for _ in range(fewest_searches):
        search()
    if not searches:
        return ImportanceRun(np.nan, np.nan, np.nan, 0.0, np.nan, spent)
    batches = 1
    while True:
        for proposal, tally in searches:
            # A search that came later draws as much as the others have.
            while tally.draws < batches * _BATCH:
                _, log_weight = _sample(limit, rng, proposal, _BATCH)
                spent += _BATCH
                tally.add(log_weight, _BATCH)
        found = _together([tally for _, tally in searches], spent)
        if found.standard_error <= target_cov * found.probability:
            return found
        # More searches where they differ, more draws where each is uncertain.
        differ = found.dof == len(searches) - 1 and len(searches) < _MOST_SEARCHES
        cost = each + batches * _BATCH if differ else len(searches) * _BATCH
        if spent + cost > most_evaluations:
            return found
        if differ:
            search()
        else:
            batches += 1


def _together(tallies: list[Tally], evaluations: int) -> ImportanceRun:
    """The estimate of searches with equally many draws."""
    whole = Tally()
    for tally in tallies:
        whole.merge(tally)
    if not whole.first:
        return ImportanceRun(np.nan, np.nan, np.nan, 0.0, np.nan, evaluations)
    ess = float(whole.first**2 / whole.second)
    error, dof = whole.probability * whole.relative_error, max(ess - 1.0, 1.0)
    if len(tallies) > 1:
        scatter = float(np.std([tally.probability for tally in tallies], ddof=1) / np.sqrt(len(tallies)))
        if scatter > error:
            error, dof = scatter, float(len(tallies) - 1)
    return ImportanceRun(whole.probability, error, dof, ess, float(whole.largest / whole.first), evaluations)


def adapted_proposal(
    limit: Sampled, rng: np.random.Generator, known: FloatArray, most_evaluations: int
) -> tuple[Mixture | None, int]:
    """One search: a proposal, none where the event was not reached; and what it cost.

    Its density is over the first ``limit.active`` coordinates; ``known`` are points in the event (N, dimension).
    """
    adapting = sum(_ROUND_SIZES) + len(_ROUND_SIZES) * _REJUVENATED * (MOVES + 1)
    found, spent = _explore(limit, rng, max(most_evaluations - adapting, most_evaluations // 2))
    found = np.concatenate([_some(found, rng), known])
    if not len(found):
        return None, spent
    proposal, more = _adapt(limit, rng, found, most_evaluations - spent)
    return proposal, spent + more


def _explore(limit: Sampled, rng: np.random.Generator, most_evaluations: int) -> tuple[FloatArray, int]:
    """Points in the event from populations of every noise, and what they cost."""
    points, spent = [np.empty((0, limit.dimension))], 0
    for noise in _EXPLORING_NOISE:
        if spent + _POPULATION > most_evaluations:
            break
        run = climb(limit, rng, size=_POPULATION, noise=noise, most_evaluations=most_evaluations - spent)
        spent += run.evaluations
        points.append(run.points)
    return np.concatenate(points), spent


def _adapt(limit: Sampled, rng: np.random.Generator, found: FloatArray, most_evaluations: int) -> tuple[Mixture, int]:
    """The proposal for the last sample, from points in the event; and what it cost."""
    active, spent = limit.active, 0
    explored = fit(found[:, :active], rng, _COMPONENTS)
    proposal = _with_defence(found[:, :active], [(1.0, explored)])
    pool, log_weights = np.empty((0, limit.dimension)), np.empty(0)
    for size in _ROUND_SIZES:
        if spent + size + _REJUVENATED * (MOVES + 1) > most_evaluations:
            break
        points, log_weight = _sample(limit, rng, proposal, size)
        spent += size
        pool, log_weights = np.concatenate([pool, points]), np.concatenate([log_weights, log_weight])
        if not len(pool):
            continue
        chosen = rng.choice(len(pool), size=_REJUVENATED, p=tempered(log_weights))
        moved, moves = rejuvenate(limit, rng, pool[chosen])
        spent += moves
        fitted = fit(moved[:, :active], rng, _COMPONENTS)
        parts = [(_EXPLORED_SHARE, explored), (1.0 - _EXPLORED_SHARE, fitted)]
        proposal = _with_defence(moved[:, :active], parts)
    return proposal, spent


def _with_defence(inside: FloatArray, parts: list[tuple[float, Mixture]]) -> Mixture:
    """The parts and the defensive noise, that of the strength of the points in the event among it."""
    d = inside.shape[1]
    strength = max(1.0, float(np.sqrt((inside**2).mean())))
    defence = [*((share, normal(noise, d)) for share, noise in _DEFENSIVE), (_STRENGTH_SHARE, normal(strength, d))]
    left = 1.0 - sum(share for share, _ in defence)
    return join([*defence, *((left * share, part) for share, part in parts)])


def _some(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """At most so many points, drawn without regard to where they are."""
    return points if len(points) <= _FITTED else points[rng.choice(len(points), _FITTED, replace=False)]


def _sample(limit: Sampled, rng: np.random.Generator, proposal: Mixture, size: int) -> tuple[FloatArray, FloatArray]:
    """The draws of a proposal that are in the event, with the logarithms of their weights."""
    points = rng.standard_normal((size, limit.dimension))
    points[:, : limit.active] = proposal.draw(rng, size)
    points = points[limit(points) > 0]
    inner = points[:, : limit.active]
    return points, log_normal(inner) - proposal.log_density(inner) if len(points) else np.empty(0)


def log_normal(points: FloatArray) -> FloatArray:
    return -0.5 * ((points**2).sum(axis=1) + points.shape[1] * np.log(2.0 * np.pi))


def tempered(log_weight: FloatArray) -> FloatArray:
    """Probabilities in proportion to weights, those far above the mean cut (Ionides 2008, truncated weights)."""
    weight = np.exp(log_weight - log_weight.max())
    weight = np.minimum(weight, weight.mean() * np.sqrt(len(weight)))
    return weight / weight.sum()
