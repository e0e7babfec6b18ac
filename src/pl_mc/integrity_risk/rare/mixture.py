"""Mixtures of normal and Student densities, from which importance sampling draws.

Student components have tails that outlast those of the noise, so that no draw from near a component can carry an
unbounded weight. They are fitted by expectation-maximisation (Peel & McLachlan 2000, Statistics and Computing
10:339-348, with fixed degrees of freedom).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pl_mc.arrays import FloatArray

# Degrees of freedom of the fitted components: tails that forgive a misfit, at a small price where there is none.
STUDENT_DOF = 8.0
_ROUNDS = 6
# Points that are whitened at once: they stay in the cache. And multiplications of one product, above which OpenBLAS
# shares it among threads: each of these products is done before the threads have met, and rows have threads anyway.
_BLOCK = 256
_ONE_THREAD = 2**18


@dataclass(frozen=True)
class Mixture:
    """Weighted components in d dimensions.

    Attributes:
        share: (k,), sum 1.
        mean: (k, d).
        root: (k, d, d), lower triangular factors of the scale matrices.
        dof: (k,), degrees of freedom; infinite for normal components.
    """

    share: FloatArray
    mean: FloatArray
    root: FloatArray
    dof: FloatArray

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """(size, d), points, component by component."""
        counts = rng.multinomial(size, self.share)
        parts = []
        for count, mean, root, dof in zip(counts, self.mean, self.root, self.dof, strict=True):
            part = rng.standard_normal((count, mean.size)) @ root.T
            if np.isfinite(dof):
                part *= np.sqrt(dof / rng.chisquare(dof, (count, 1)))
            parts.append(mean + part)
        return np.concatenate(parts)

    def log_density(self, points: FloatArray) -> FloatArray:
        """(N,), logarithm of the density."""
        return special.logsumexp(self._log_parts(points)[0], axis=0)

    def _log_parts(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, N), logarithms of share times density, and squared distances in the scale of each component."""
        k, d = self.mean.shape
        inverse = np.linalg.inv(self.root)
        # (k d, N): one product whitens the points for every component, and sums over d go along whole rows.
        whiten = inverse.reshape(k * d, d)
        offset = np.einsum("kij,kj->ki", inverse, self.mean).reshape(-1, 1)
        distances = np.empty((k, len(points)))
        size = int(np.clip(_ONE_THREAD // (k * d * d), 8, _BLOCK))
        for start in range(0, len(points), size):
            block = slice(start, start + size)
            white = whiten @ points[block].T
            white -= offset
            white *= white
            distances[:, block] = white.reshape(k, d, -1).sum(axis=1)
        student = np.isfinite(self.dof)[:, None]
        dof = np.where(student, self.dof[:, None], 1.0)
        tail = np.where(student, (dof + d) / 2.0 * np.log1p(distances / dof), distances / 2.0)
        unit = special.gammaln((dof + d) / 2.0) - special.gammaln(dof / 2.0) - d / 2.0 * np.log(np.pi * dof)
        unit = np.where(student, unit, -d / 2.0 * np.log(2.0 * np.pi))
        volume = np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum(axis=1)[:, None]
        return np.log(self.share)[:, None] + unit - tail - volume, distances


def normal(noise: float, d: int) -> Mixture:
    """One normal density about the origin with standard deviation ``noise`` in each coordinate."""
    return Mixture(np.ones(1), np.zeros((1, d)), noise * np.eye(d)[None], np.full(1, np.inf))


def join(parts: list[tuple[float, Mixture]]) -> Mixture:
    """Mixtures with their shares of the whole, which sum to 1."""
    return Mixture(
        np.concatenate([share * part.share for share, part in parts]),
        np.concatenate([part.mean for _, part in parts]),
        np.concatenate([part.root for _, part in parts]),
        np.concatenate([part.dof for _, part in parts]),
    )


def fit(points: FloatArray, rng: np.random.Generator, components: int) -> Mixture:
    """Student components fitted to points (N, d).

    Each scale matrix is drawn toward the unit matrix, the nominal noise, as if by d + 2 further points, so that a
    few points far from the others make a component as sound as many. No component has less than a tenth of an equal
    share: a region that few points have found is kept in sight.
    """
    n, d = points.shape
    components = max(1, min(components, n // 4))
    mean = _spread_centres(points, rng, components)
    nearest = np.argmin(((points[:, None, :] - mean[None]) ** 2).sum(axis=2), axis=1)
    belonging = (nearest[None] == np.arange(components)[:, None]).astype(float)
    heavy = np.ones_like(belonging)
    for _ in range(_ROUNDS):
        mixture = _components(points, belonging, heavy)
        parts, distances = mixture._log_parts(points)
        belonging = np.exp(parts - special.logsumexp(parts, axis=0))
        heavy = (STUDENT_DOF + d) / (STUDENT_DOF + distances)
    return _components(points, belonging, heavy)


def _components(points: FloatArray, belonging: FloatArray, heavy: FloatArray) -> Mixture:
    """The maximisation step, for points that belong (k, N) and count for their distance ``heavy`` (k, N)."""
    d = points.shape[1]
    count = belonging.sum(axis=1)
    weight = belonging * heavy
    total = np.maximum(weight.sum(axis=1), 1e-12)
    mean = (weight @ points) / total[:, None]
    root = np.empty((len(count), d, d))
    prior = d + 2.0
    for k in range(len(count)):
        centred = points - mean[k]
        scatter = (weight[k, :, None] * centred).T @ centred
        root[k] = np.linalg.cholesky((scatter + prior * np.eye(d)) / (count[k] + prior))
    share = np.maximum(count / count.sum(), 0.1 / len(count))
    return Mixture(share / share.sum(), mean, root, np.full(len(count), STUDENT_DOF))


def _spread_centres(points: FloatArray, rng: np.random.Generator, count: int) -> FloatArray:
    """Centres far from each other: each is drawn in proportion to the squared distance from those before it.

    Arthur & Vassilvitskii 2007, k-means++.
    """
    centres = [points[rng.integers(len(points))]]
    square = ((points - centres[0]) ** 2).sum(axis=1)
    for _ in range(count - 1):
        total = square.sum()
        index = rng.choice(len(points), p=square / total) if total > 0 else rng.integers(len(points))
        centres.append(points[index])
        square = np.minimum(square, ((points - centres[-1]) ** 2).sum(axis=1))
    return np.stack(centres)
