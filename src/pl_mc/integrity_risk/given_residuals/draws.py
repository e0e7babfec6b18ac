"""Draws of what residuals decide, and the probability of an error beyond its level given them.

The least-squares error of Gaussian noise is independent of the residuals. An estimate that follows a shift of its
observations, as every method here does, is the least-squares one plus something that the residuals alone decide, and
so are its level and its test. Given the residuals the error is therefore normal, about the mean that fault and
estimate give it, with the covariance of least squares: the probability that it is beyond the level needs no draw.
What is left to be drawn, and averaged over, are residuals. That is conditional Monte Carlo (Hammersley & Handscomb
1964, Monte Carlo methods, section 6.3): for one set of draws the risk at every multiplier, and 1e-8 of it, is a smooth
function of the multiplier with a known error.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.alert import VERTICAL
from pl_mc.arrays import FloatArray
from pl_mc.constants import EAST, NORTH, UP
from pl_mc.geometry.record import Geometry
from pl_mc.ism import satellite_codes
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.events import levels_of, unconverged
from pl_mc.kernels.linear_model import REDUNDANCY_FLOOR, has_one_clock_per_row, product
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.methods import Method
from pl_mc.runtime.precision import precision_scope
from pl_mc.statistics.least_squares import ls_quantities

# Lanes of a tile and tiles of a call, and rows of a geometry are filled up to a multiple: one program for many. What is
# filled up is computed: a call is as small as it can be before what calling costs is more than that.
_TILE, _TILES_PER_CALL, _ROWS = 512, 8, 8
# Points of the rule along the narrower axis of a horizontal error, and how far in its standard deviations; a level so
# many of the wider one beyond the mean is exceeded with less than 1e-12, and with nothing here.
_NODES, _REACH, _FAR = 48, 9.0, 7.5


@dataclass(frozen=True)
class EpochParts:
    """One epoch with redundancy as draws need it; n rows, padding included.

    Attributes:
        design: (n, t) [m/m]; sigma_m: (n,) [m]; in_view: (n,); satellite: (n,), codes of the satellites.
        gain_m: (k, n), the error of each component of an axis per whitened observation [m].
        covariance_m2: (k, k), of these components under least squares.
        redundancy: (n,), redundancy numbers; zero on padding.
        dof: degrees of freedom of the residuals.
        basis: (n, u), orthonormal columns that span the whitened design.
        axis: ``vertical`` (k = 1) or ``horizontal`` (k = 2: east, north).
    """

    design: FloatArray
    sigma_m: FloatArray
    in_view: NDArray[np.bool_]
    satellite: NDArray[np.integer] | None
    gain_m: FloatArray
    covariance_m2: FloatArray
    redundancy: FloatArray
    dof: int
    basis: FloatArray
    axis: str

    @classmethod
    def of(cls, g: Geometry, axis: str) -> EpochParts | None:
        """Of a single epoch; None where there is no redundancy."""
        quantities = ls_quantities(g)
        if not bool(quantities.available):
            return None
        n = len(g.names)
        rows = -(-n // _ROWS) * _ROWS
        whitened = np.asarray(g.design) / np.asarray(g.sigma_m)[:, None]
        whitened = whitened[:, whitened.any(axis=0)]
        basis, triangle = np.linalg.qr(whitened)
        gain_m = np.linalg.solve(triangle, basis.T)[[UP] if axis == VERTICAL else [EAST, NORTH]]

        def filled(values: ArrayLike, other: float = 0.0) -> FloatArray:
            array = np.asarray(values)
            return np.pad(array, [(0, rows - n), *[(0, 0)] * (array.ndim - 1)], constant_values=other)

        series = g.as_series()
        codes = satellite_codes(series, series.satellite[0])
        return cls(
            design=filled(g.design),
            sigma_m=filled(g.sigma_m, 1.0),
            in_view=filled(np.ones(n, bool), False).astype(bool),
            satellite=None if codes is None else filled(codes).astype(np.asarray(codes).dtype),
            gain_m=filled(gain_m.T).T,
            covariance_m2=gain_m @ gain_m.T,
            redundancy=filled(1.0 - (basis**2).sum(axis=1)),
            dof=int(quantities.dof),
            basis=filled(basis),
            axis=axis,
        )

    @property
    def checked(self) -> NDArray[np.bool_]:
        """(n,), satellites whose residual is more than rounding."""
        return self.in_view & (self.redundancy > REDUNDANCY_FLOOR)

    def residual_square(self, noise: FloatArray) -> FloatArray:
        """(draws,), square sum of the whitened residuals of noise (draws, n)."""
        fitted = noise @ self.basis
        return np.maximum((noise**2).sum(axis=1) - (fitted**2).sum(axis=1), 0.0)


@dataclass(frozen=True)
class Lanes:
    """Draws of whitened errors, and of what they are given their residuals.

    Attributes:
        noise: (draws, n), whitened errors.
        shift_m: (draws, k), mean of the least-squares error of an axis given the residuals [m]; None for zero.
        covariance_m2: (k, k), (1, k, k) or (draws, k, k), its covariance about that.
        weight: (draws,), of each draw; None for one.
    """

    noise: FloatArray
    shift_m: FloatArray | None
    covariance_m2: FloatArray
    weight: FloatArray | None = None


@dataclass(frozen=True)
class Drawn:
    """What a method makes of residuals under several faults.

    Attributes:
        mean_m: (faults, draws, k), mean of the error given the residuals [m].
        covariance_m2: (k, k), (1, k, k) or (draws, k, k), its covariance about that.
        level_m: (faults, draws), protection level [m].
        silent: (faults, draws), whether there is a solution that the method's own test does not reject.
        unsettled: (faults, draws), whether the last iteration still moved the position by more than 1 cm.
        excluded: (faults, draws), the row that was left out, -1 for none.
        weight: (draws,), of each draw, mean 1 over many; 1 where residuals were drawn as they are distributed.
    """

    mean_m: FloatArray
    covariance_m2: FloatArray
    level_m: FloatArray
    silent: NDArray[np.bool_]
    unsettled: NDArray[np.bool_]
    excluded: NDArray[np.int16]
    weight: FloatArray

    def beyond(self, k: float) -> FloatArray:
        """(faults, draws), weighted P(error beyond k times the level and no rejection | residuals)."""
        chance = np.zeros(self.level_m.shape)
        alive, covariance = self.silent, self.covariance_m2
        if covariance.ndim == 3:
            covariance = covariance[np.nonzero(alive)[1]] if len(covariance) > 1 else covariance[0]
        chance[alive] = length_beyond_level(self.mean_m[alive], k * self.level_m[alive], covariance)
        return chance * self.weight

    def alarms(self, k: float, limit_m: float) -> NDArray[np.bool_]:
        """(faults, draws), whether k times the level is beyond the alert limit, or there is none."""
        return ~self.silent | (k * self.level_m > limit_m)


def draw(
    parts: EpochParts, method: Method, bias_m: FloatArray, drawn: Lanes | FloatArray, weight: FloatArray | None = None
) -> Drawn:
    """What a method makes of the residuals of draws under each of the faults (faults, n) [m].

    The draws may be whitened noise alone (draws, n), independent and of the sigma of the model.
    """
    given = drawn if isinstance(drawn, Lanes) else Lanes(drawn, None, parts.covariance_m2)
    noise = given.noise
    (draws, n), faults = noise.shape, len(bias_m)
    tiles = -(-draws // _TILE)
    lanes = np.pad(noise, ((0, tiles * _TILE - draws), (0, 0))).reshape(tiles, _TILE, n)
    arrays = (parts.design, parts.sigma_m, parts.in_view, parts.satellite)
    methods, components = as_trees((method,)), len(parts.covariance_m2)
    one_clock = has_one_clock_per_row(parts.design[parts.in_view])
    mean, level = np.empty((faults * tiles, components, _TILE)), np.empty((faults * tiles, _TILE))
    flags = np.empty((2, faults * tiles, _TILE), bool)
    excluded = np.empty((faults * tiles, _TILE), np.int16)
    with precision_scope("float64"):
        for start in range(0, faults * tiles, _TILES_PER_CALL):
            case = np.arange(start, min(start + _TILES_PER_CALL, faults * tiles))
            fault, tile = np.divmod(np.resize(case, _TILES_PER_CALL), tiles)
            found = _solved(*arrays, lanes[tile], bias_m[fault], methods, axis=parts.axis, one_clock_per_row=one_clock)
            for whole, values in zip((mean, level, *flags, excluded), found, strict=True):
                whole[case] = np.asarray(values)[: case.size]
    mean = np.moveaxis(mean.reshape(faults, tiles, components, _TILE), 2, 3)
    mean = mean.reshape(faults, tiles * _TILE, components)[:, :draws]
    if given.shift_m is not None:
        mean = mean + given.shift_m
    level, silent, unsettled, left_out = (
        value.reshape(faults, tiles * _TILE)[:, :draws] for value in (level, *flags, excluded)
    )
    weight = np.ones(draws) if weight is None else weight
    if given.weight is not None:
        weight = weight * given.weight
    return Drawn(mean, given.covariance_m2, level, silent, unsettled, left_out, weight)


@functools.partial(jax.jit, static_argnames=("axis", "one_clock_per_row"))
def _solved(
    design: Array, sigma_m: Array, in_view: Array, satellite: Array | None, noise: Array, bias_m: Array,
    methods: Trees, *, axis: str, one_clock_per_row: bool,
) -> tuple[Array, ...]:  # fmt: skip
    """Of tiles of noise (tiles, lanes, n), each under a bias (tiles, n): (tiles, k, lanes) and (tiles, lanes)."""
    (method,) = of_trees(methods)
    model = linear_model(design, sigma_m, in_view, one_clock_per_row=one_clock_per_row, satellite=satellite)
    prepared = method.prepare(model)
    components = jnp.asarray((UP,) if axis == VERTICAL else (EAST, NORTH))

    def one(case: tuple[Array, Array]) -> tuple[Array, ...]:
        whitened, bias = jnp.where(in_view[:, None], case[0].T, 0.0), case[1]
        outcome = method.solve(model, prepared, start_from(model, whitened * sigma_m[:, None] + bias[:, None]))
        silent = outcome.available & ~outcome.rejects
        own = product(model.gain[components], whitened)
        mean = jnp.where(outcome.available, outcome.error_m[components] - own, 0.0)
        (level,) = levels_of(outcome, axis)
        excluded = jnp.full(level.shape, -1, jnp.int32) if outcome.excluded is None else outcome.excluded
        return mean, jnp.where(outcome.available, level, jnp.inf), silent, unconverged(outcome), excluded

    return jax.lax.map(one, (noise, bias_m))


def length_beyond_level(mean_m: FloatArray, level_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    """P(|e| > level) of normal vectors e with means (m, k) and covariances (k, k) or (m, k, k), k being 1 or 2.

    Of two components along their principal axes the wider one is integrated in closed form, the narrower one by a rule
    of fixed points over the angle at which it meets the circle: relative error below 1e-6 down to 1e-15.
    """
    if covariance_m2.shape[-1] == 1:
        sigma = np.sqrt(covariance_m2[..., 0, 0])
        shift, limit = mean_m[:, 0] / sigma, level_m / sigma
        return special.ndtr(shift - limit) + special.ndtr(-shift - limit)
    values, vectors = np.linalg.eigh(covariance_m2)
    narrow, wide = (np.broadcast_to(np.sqrt(values[..., k]), level_m.shape) for k in (0, 1))
    near = level_m - np.hypot(*mean_m.T) < _FAR * wide
    found = np.zeros(level_m.shape)
    across, along = np.einsum("mi,mij->jm", mean_m, np.broadcast_to(vectors, (len(mean_m), 2, 2)))[:, near]
    limit = np.maximum(level_m[near], 1e-12)
    found[near] = _beyond_circle(across, along, limit, narrow[near], wide[near])
    return found


def _beyond_circle(
    across: FloatArray, along: FloatArray, limit: FloatArray, narrow: FloatArray, wide: FloatArray
) -> FloatArray:
    """P(|e| > limit) of vectors with means along the axes of the standard deviations ``narrow`` and ``wide``."""
    points, weights = special.roots_legendre(_NODES)
    low = np.arcsin(np.clip((across - _REACH * narrow) / limit, -1.0, 1.0))
    high = np.arcsin(np.clip((across + _REACH * narrow) / limit, -1.0, 1.0))
    # The narrower component alone is beyond the limit.
    found = special.ndtr((across - limit) / narrow) + special.ndtr((-across - limit) / narrow)
    half = 0.5 * (high - low)
    for point, weight in zip(points, weights, strict=True):
        angle = 0.5 * (high + low) + half * point
        reach = limit * np.cos(angle)
        density = np.exp(-0.5 * ((limit * np.sin(angle) - across) / narrow) ** 2) / (narrow * np.sqrt(2.0 * np.pi))
        tail = special.ndtr((along - reach) / wide) + special.ndtr((-along - reach) / wide)
        found = found + weight * half * reach * density * tail
    return np.minimum(found, 1.0)
