"""The probability of a rare event against the size of a fault on one satellite, a whole curve from one sample.

A fault only shifts the errors, so that the event is one region E of whitened observations u for all faults, and its
probability under a fault with trace mu is the mass of N(mu, I) in E. Points of E whose density q is known then give
it for every size b at once,

    P(b) = mean over the draws of 1_E(u) phi(u - b mu) / q(u),

wherever enough of them carry the sum. Small populations of subset simulation at sizes of a grid on every satellite
find the region. Their points are shared: a part of E that one fault has led to counts under the others too. From
them proposals are fitted, which are importance sampling's, and refitted to what they drew. All of this serves a
search; nothing is promised for the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.rare.importance import tempered
from pl_mc.integrity_risk.rare.limit_state import LimitState
from pl_mc.integrity_risk.rare.mixture import Mixture, fit, join, normal
from pl_mc.integrity_risk.rare.subset import climb, rejuvenate
from pl_mc.methods import Method

# Sizes from which the event is explored; a fault and its negative are equally bad.
SIZES_M = np.array(
    [1.0, 2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 125.0, 150.0]
)
# A population for each: points, moves at each level, noise in which it starts, evaluations at which it gives up.
_POINTS, _MOVES, _NOISE, _MOST = 1024, 5, 2.0, 200_000
# Points that each population gives to all, and points that are taken from either source for each size.
_SHARED, _TAKEN = 96, 256
# Samples of a coarse curve: draws, and the effective number of them below which a size is among those they are for.
_ROUNDS = ((2**17, np.inf), (2**18, 400.0), (2**17, 30.0), (2**17, 30.0))
# Of a finer one about one size: sizes from which it is drawn, points of each, draws of both samples.
_FINE, _FINE_POINTS, _FINE_DRAWS = 5, 1024, (2**17, 2**18)
# Components fitted to the points of one size, for both.
_COMPONENTS, _FINE_COMPONENTS = 4, 8
_BATCH = 2**15
# Shares and strengths of noise about the faults themselves.
_DEFENSIVE = ((0.1, 1.0), (0.1, 2.0))
# A sample says nothing of a size with fewer effective draws in the event.
LEAST_ESS = 30.0
# A size that no sample can tell is out of question where both rough estimates put it this far below the largest.
_FAR_BELOW = 0.01


@dataclass(frozen=True)
class Region:
    """The event at one epoch as a region of whitened observations, in coordinates that serve every fault.

    Attributes:
        limit: the limit state, of no fault.
        traces: (n, active), what a bias of 1 m on each satellite moves [1/m].
    """

    limit: LimitState
    traces: FloatArray

    @classmethod
    def of(cls, g: Geometry, method: Method, event: str, alert: AlertLimits, axis: str = VERTICAL) -> Region:
        """Of an epoch with redundancy."""
        limit = LimitState.of(g.as_series(), 0, np.zeros(len(g.names)), method, event, alert, axis=axis)
        return cls(limit, limit.coordinates.matrix[:, : limit.active] / limit.sigma_m[:, None])

    def shifted(self, trace: FloatArray) -> Shifted:
        """The limit state of the noise under a fault, by its trace (active,)."""
        centre = np.zeros(self.limit.dimension)
        centre[: self.limit.active] = trace
        return Shifted(self.limit, centre)

    def whole(self, inner: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Points (N, dimension), the coordinates that do not matter drawn from the noise."""
        points = rng.standard_normal((len(inner), self.limit.dimension))
        points[:, : self.limit.active] = inner
        return points


@dataclass(frozen=True)
class Shifted:
    """A limit state about another centre."""

    limit: LimitState
    centre: FloatArray

    @property
    def active(self) -> int:
        return self.limit.active

    @property
    def dimension(self) -> int:
        return self.limit.dimension

    def __call__(self, points: FloatArray) -> FloatArray:
        """(N,), of noise (N, dimension)."""
        return self.limit(points + self.centre)


@dataclass(frozen=True)
class Explored:
    """One population under one fault.

    Attributes:
        points: (N, active), in the event; none where it was not reached.
        log_probability: of the event, then -inf.
        evaluations: limit states computed.
    """

    points: FloatArray
    log_probability: float
    evaluations: int


def explore(region: Region, trace: FloatArray, rng: np.random.Generator) -> Explored:
    """One population under the fault with this trace (active,)."""
    active = region.limit.active
    run = climb(region.shifted(trace), rng, size=_POINTS, noise=_NOISE, moves=_MOVES, most_evaluations=_MOST)
    # In any order: neighbours may be copies of each other.
    points = rng.permutation(run.points[:, :active] + trace)
    return Explored(points, run.log_probability if run.reached else -np.inf, run.evaluations)


@dataclass(frozen=True)
class Shared:
    """Points of all populations, weighted as one sample of the event (balance heuristic: Veach & Guibas 1995).

    Attributes:
        points: (N, active).
        log_density: (N,), logarithm of the density of all populations together, but for a constant.
    """

    points: FloatArray
    log_density: FloatArray

    @classmethod
    def of(cls, found: Sequence[Explored], traces: FloatArray) -> Shared:
        """Of populations under faults with these traces (populations, active)."""
        reached = [k for k, one in enumerate(found) if len(one.points)]
        points = np.concatenate([found[k].points[:_SHARED] for k in reached] or [np.empty((0, traces.shape[1]))])
        log_density = np.full(len(points), -np.inf)
        for k in reached:
            density = _log_normal(points, traces[k][None])[:, 0] - found[k].log_probability
            log_density = np.logaddexp(log_density, density)
        return cls(points, log_density)

    def under(self, trace: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Some of the points, about as they are distributed under the fault with this trace."""
        if not len(self.points):
            return self.points
        log_weight = _log_normal(self.points, trace[None])[:, 0] - self.log_density
        return self.points[rng.choice(len(self.points), _TAKEN, p=tempered(log_weight))]


@dataclass(frozen=True)
class _Sample:
    """Draws of one proposal: (N, active) those in the event, (N,) logarithm of its density there, number of all."""

    points: FloatArray
    log_density: FloatArray
    draws: int

    def log_weights(self, trace: FloatArray, sizes_m: FloatArray) -> FloatArray:
        """(sizes, N), logarithms of the weights for each size."""
        return _log_normal(self.points, sizes_m[:, None] * trace).T - self.log_density

    def at(self, trace: FloatArray, sizes_m: FloatArray) -> FloatArray:
        """(3, sizes), probability, standard error and effective number of draws in the event."""
        if not len(self.points):
            return np.zeros((3, sizes_m.size))
        logs = self.log_weights(trace, sizes_m)
        scale = logs.max(axis=1)
        weight = np.exp(logs - scale[:, None])
        first, second = weight.sum(axis=1), (weight**2).sum(axis=1)
        value = np.exp(scale) * first / self.draws
        error = value * np.sqrt(np.maximum(second / first**2 - 1.0 / self.draws, 0.0))
        return np.stack([value, error, first**2 / second])


@dataclass
class BiasCurve:
    """The probability against the size on one satellite, from samples of which each size takes the best for it.

    Attributes:
        trace: (active,), of 1 m.
        samples: so far.
        evaluations: limit states computed.
    """

    trace: FloatArray
    samples: list[_Sample]
    evaluations: int = 0

    def add(self, region: Region, proposal: Mixture, rng: np.random.Generator, draws: int) -> None:
        """Another sample."""
        points, densities = [], []
        for _ in range(draws // _BATCH):
            inner = proposal.draw(rng, _BATCH)
            inner = inner[region.limit(region.whole(inner, rng)) > 0]
            points.append(inner)
            densities.append(proposal.log_density(inner) if len(inner) else np.empty(0))
        self.samples.append(_Sample(np.concatenate(points), np.concatenate(densities), draws))
        self.evaluations += draws

    def at(self, sizes_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of sizes (b,) probability, standard error and effective number of draws in the event, (b,) each."""
        each = np.stack([one.at(self.trace, sizes_m) for one in self.samples])
        best = each[:, 2].argmax(axis=0)
        value, error, ess = np.take_along_axis(each, best[None, None], axis=0)[0]
        return value, error, ess

    def known(self, sizes_m: FloatArray) -> FloatArray:
        """(b,), probability of sizes with draws enough; missing for the others."""
        value, _, ess = self.at(sizes_m)
        return np.where(ess >= LEAST_ESS, value, np.nan)

    def open_sizes(self, found: Sequence[Explored], least: float = LEAST_ESS) -> FloatArray:
        """Those of `SIZES_M` with fewer effective draws at which the event may be likelier than at the others.

        ``found`` are their populations. All of them are open before the first sample.
        """
        if not self.samples:
            return SIZES_M
        value, _, ess = self.at(SIZES_M)
        best = np.where(ess >= LEAST_ESS, value, 0.0).max()
        rough = np.maximum(value, np.exp([one.log_probability for one in found]))
        return SIZES_M[(ess < least) & (rough > _FAR_BELOW * best)]

    def under(self, size_m: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Draws in the event (count, active), about as they are distributed under a fault of this size."""
        size = np.array([size_m])
        best = max(self.samples, key=lambda one: one.at(self.trace, size)[2, 0], default=None)
        if best is None or not len(best.points):
            return np.empty((0, self.trace.size))
        return best.points[rng.choice(len(best.points), count, p=tempered(best.log_weights(self.trace, size)[0]))]


def coarse_curve(
    region: Region, found: Sequence[Explored], shared: Shared, trace: FloatArray, rng: np.random.Generator
) -> BiasCurve:
    """The curve of one satellite over all sizes, from its populations, one for each of `SIZES_M`, and all points.

    The first sample starts from the populations, the others from those before as well, for the sizes that these
    could not tell. ``trace`` (active,) is that of 1 m.
    """
    curve = BiasCurve(trace, [])
    for draws, least in _ROUNDS:
        sizes = curve.open_sizes(found, least)
        if not sizes.size:
            break
        parts = []
        for one, size in zip(found, SIZES_M, strict=True):
            if size in sizes:
                start = np.concatenate([shared.under(size * trace, rng), curve.under(size, _TAKEN, rng)])
                moved = _within(region, start, size * trace, rng, curve)
                points = np.concatenate([one.points[:_TAKEN], moved])
                parts += [fit(points, rng, _COMPONENTS)] if len(points) else []
        curve.add(region, _proposal(parts, sizes[:, None] * trace), rng, draws)
    return curve


def finer_curve(region: Region, coarse: BiasCurve, low_m: float, high_m: float, rng: np.random.Generator) -> BiasCurve:
    """The curve between two sizes, from points of the coarse one and, once more, from its own."""
    sizes = np.linspace(low_m, high_m, _FINE)
    curve = BiasCurve(coarse.trace, [])
    for draws in _FINE_DRAWS:
        source = curve if curve.samples else coarse
        parts = []
        for size in sizes:
            start = source.under(float(size), _FINE_POINTS, rng)
            moved = _within(region, start, size * coarse.trace, rng, curve)
            parts += [fit(moved, rng, _FINE_COMPONENTS)] if len(moved) else []
        curve.add(region, _proposal(parts, sizes[:, None] * coarse.trace), rng, draws)
    return curve


def _within(
    region: Region, inner: FloatArray, trace: FloatArray, rng: np.random.Generator, curve: BiasCurve
) -> FloatArray:
    """Points of the event (N, active), moved within it as the noise under the fault is distributed there."""
    if not len(inner):
        return inner
    shifted = region.shifted(trace)
    moved, spent = rejuvenate(shifted, rng, region.whole(inner, rng) - shifted.centre)
    curve.evaluations += spent
    return moved[:, : region.limit.active] + trace


def _proposal(parts: Sequence[Mixture], traces: FloatArray) -> Mixture:
    """The fitted parts in equal shares, and noise about the faults themselves."""
    count, dimension = traces.shape
    defence = []
    for share, noise in _DEFENSIVE:
        one = normal(noise, dimension)
        equal = np.full(count, 1.0 / count)
        about = Mixture(equal, traces, np.repeat(one.root, count, axis=0), np.repeat(one.dof, count))
        defence.append((share, about))
    left = 1.0 - sum(share for share, _ in defence)
    if not parts:
        return join([(share / (1.0 - left), about) for share, about in defence])
    return join([*defence, *((left / len(parts), part) for part in parts)])


def _log_normal(points: FloatArray, centres: FloatArray) -> FloatArray:
    """(N, c), logarithms of the standard normal density of points (N, d) about centres (c, d)."""
    square = (points**2).sum(axis=1)[:, None] - 2.0 * points @ centres.T + (centres**2).sum(axis=1)
    return -0.5 * (square + points.shape[1] * np.log(2.0 * np.pi))
