"""Subset simulation: a rare event as a chain of events that are not rare, each sampled from within the one before.

Au & Beck 2001, Probabilistic Engineering Mechanics 16:263-277, with the preconditioned Crank-Nicolson move of
Cotter et al. 2013, Statistical Science 28:424-446, which keeps the normal distribution in any number of dimensions.
A population may also start in stronger noise and, once the event is reached, be cooled to the nominal one: then it
meets regions that lie off the way that the limit state points out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray

Limit = Callable[[FloatArray], FloatArray]

# Noise in which populations start, in turn.
START_NOISE = (1.0, 1.5, 2.0)

# Au & Beck's choice; anything between 0.1 and 0.3 does.
LEVEL_FRACTION = 0.1
# Events below 1e-30 are given up.
MOST_LEVELS = 30
# Moves at each level, and the share of them that should be accepted: a move's length times its chance is largest
# for a share between 0.2 and 0.5.
MOVES = 8
ACCEPTANCE = 0.35
# Cooling keeps this share of the population effective at each step.
_COOLING_SHARE = 0.5


class Coordinates(Protocol):
    """What knows its coordinates: how many matter, and how many there are."""

    @property
    def active(self) -> int: ...

    @property
    def dimension(self) -> int: ...


class Sampled(Coordinates, Protocol):
    """A limit state that knows its coordinates, as `pl_mc.integrity_risk.rare.limit_state.LimitState` does."""

    def __call__(self, points: FloatArray) -> FloatArray: ...


@dataclass(frozen=True)
class SubsetRun:
    """What several populations, each with random numbers of its own, found.

    Attributes:
        probability: mean of their estimates, of which those that never reached the event are zero.
        standard_error: from the scatter between them.
        populations: how many.
        evaluations: limit states computed.
    """

    probability: float
    standard_error: float
    populations: int
    evaluations: int


def subset_simulation(
    limit: Sampled, rng: np.random.Generator, *, target_cov: float, most_evaluations: int, size: int = 4096,
    fewest: int = 6, most: int = 30,
) -> SubsetRun:  # fmt: skip
    """Estimate P(limit state > 0) as the mean of independent populations, with the error that their scatter shows.

    Each population's estimate is nearly unbiased, but where an event has several regions it is skewed: most
    populations find too little, a few far too much. The scatter between populations tells.

    Populations of ``size`` points, whose start noises take turns, are added until standard error / mean is at most
    ``target_cov``, or another might need more than ``most_evaluations`` in all; ``fewest`` at the least, unless
    that forbids, and ``most`` at the most.
    """
    estimates: list[float] = []
    spent = largest = 0
    while True:
        noise = START_NOISE[len(estimates) % len(START_NOISE)]
        run = climb(limit, rng, size=size, noise=noise, most_evaluations=most_evaluations - spent)
        estimates.append(float(np.exp(run.log_probability)) if run.reached else 0.0)
        spent += run.evaluations
        largest = max(largest, run.evaluations)
        mean = float(np.mean(estimates))
        error = float(np.std(estimates, ddof=1) / np.sqrt(len(estimates))) if len(estimates) > 1 else np.nan
        # Stops after whole turns of the start noises alone, so that each has an equal say.
        turn = len(estimates) % len(START_NOISE) == 0
        if turn and len(estimates) >= fewest and (mean == 0.0 or error <= target_cov * mean):
            break
        if len(estimates) >= most or spent + largest > most_evaluations:
            break
    return SubsetRun(mean, error, len(estimates), spent)


@dataclass(frozen=True)
class Population:
    """Where a population ended.

    Attributes:
        points: (N, n), points in the event, about as the nominal noise is distributed there; none where the event
            was not reached.
        log_probability: logarithm of the estimated probability; where the event was not reached, that of the last
            level that was.
        reached: whether points of the event were found.
        evaluations: number of limit states computed.
    """

    points: FloatArray
    log_probability: float
    reached: bool
    evaluations: int


def climb(
    limit: Sampled, rng: np.random.Generator, *, size: int, noise: float = 1.0, moves: int = MOVES,
    most_evaluations: float = np.inf,
) -> Population:  # fmt: skip
    """One population of ``size`` points from the noise into the event, with ``moves`` of each at every level.

    Active coordinates start with ``noise`` times their nominal standard deviation, 1 for subset simulation as such.
    A population that would need more limit states than ``most_evaluations`` gives up.
    """
    sigma = np.ones(limit.dimension)
    sigma[: limit.active] = noise
    points = rng.standard_normal((size, limit.dimension)) * sigma
    values = limit(points)
    spent = size
    log_probability = 0.0
    step = 0.5
    level = -np.inf
    for _ in range(MOST_LEVELS):
        level = min(0.0, float(np.quantile(values, 1.0 - LEVEL_FRACTION, method="lower")))
        inside = values > level
        if not inside.any() or spent + moves * size > most_evaluations:
            return Population(points[:0], log_probability, False, spent)
        log_probability += float(np.log(inside.mean()))
        chosen = systematic(rng, inside.astype(float), size)
        points, values = points[chosen], values[chosen]
        points, values, step = move(limit, rng, points, values, level, sigma, step, moves)
        spent += moves * size
        if level >= 0.0:
            break
    else:
        return Population(points[:0], log_probability, False, spent)
    while sigma[0] > 1.0:
        if spent + moves * size > most_evaluations:
            return Population(points[:0], log_probability, False, spent)
        cooler, log_ratio, weights = _cool(points, sigma, limit.active)
        log_probability += log_ratio
        sigma = cooler
        chosen = systematic(rng, weights, size)
        points, values = points[chosen], values[chosen]
        points, values, step = move(limit, rng, points, values, 0.0, sigma, step, moves)
        spent += moves * size
    return Population(points, log_probability, True, spent)


def rejuvenate(
    limit: Limit, rng: np.random.Generator, points: FloatArray, moves: int = MOVES
) -> tuple[FloatArray, int]:
    """Points of the event, moved within it as the nominal noise is distributed there; and what that cost."""
    moved, _, _ = move(limit, rng, points, limit(points), 0.0, np.ones(points.shape[1]), 0.3, moves)
    return moved, len(points) * (moves + 1)


def move(
    limit: Limit, rng: np.random.Generator, points: FloatArray, values: FloatArray, level: float,
    sigma: FloatArray, step: float, moves: int,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """Moves of every point that keep the noise's distribution above ``level``; and the step that suits them."""
    points, values = points.copy(), values.copy()
    for _ in range(moves):
        # Steps of several lengths: what is too long for a narrow region is not for a wide one.
        length = np.minimum(step * np.exp(0.5 * rng.standard_normal((len(points), 1))), 1.0)
        fresh = rng.standard_normal(points.shape) * sigma
        proposed = np.sqrt(1.0 - length**2) * points + length * fresh
        found = limit(proposed)
        accepted = found > level
        points[accepted], values[accepted] = proposed[accepted], found[accepted]
        step = float(np.clip(step * np.exp(accepted.mean() - ACCEPTANCE), 1e-3, 1.0))
    return points, values, step


def _cool(points: FloatArray, sigma: FloatArray, active: int) -> tuple[FloatArray, float, FloatArray]:
    """The next cooler noise, the logarithm of the ratio of probabilities, and the points' weights."""
    squares = (points[:, :active] ** 2).sum(axis=1)
    now = sigma[0]

    def weights(noise: float) -> tuple[FloatArray, float]:
        log_weight = active * np.log(now / noise) - 0.5 * squares * (noise**-2 - now**-2)
        peak = log_weight.max()
        weight = np.exp(log_weight - peak)
        return weight, float(peak + np.log(weight.mean()))

    low, high = 1.0, now
    if _effective(weights(low)[0]) < _COOLING_SHARE:
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _effective(weights(middle)[0]) < _COOLING_SHARE else (low, middle)
        low = high
    weight, log_ratio = weights(low)
    cooler = sigma.copy()
    cooler[:active] = low
    return cooler, log_ratio, weight


def _effective(weight: FloatArray) -> float:
    """Effective share of a weighted population."""
    return float(weight.mean() ** 2 / (weight**2).mean())


def systematic(rng: np.random.Generator, weight: FloatArray, size: int) -> NDArray[np.int64]:
    """Indices drawn in proportion to weights, each as often as its share rounded up or down."""
    heap = np.cumsum(weight)
    places = (rng.random() + np.arange(size)) / size * heap[-1]
    return np.minimum(np.searchsorted(heap, places, side="right"), len(weight) - 1)
