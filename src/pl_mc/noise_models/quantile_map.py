"""Symmetric distributions from one standard normal number: x(z), the quantile of the probability that z has.

One number a satellite instead of several keeps the space of rare events small, and x(z) is smooth and rising, so
that more extreme numbers are more extreme errors. It is tabulated once on the host and interpolated by cubics that
keep it rising (Fritsch & Carlson 1980, SIAM Journal on Numerical Analysis 17:238-246). Probabilities come out to
1e-7 of themselves, but for mixtures with a tail a hundred times as wide as the core, to 1e-3.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.arrays import FloatArray

# P(z > 37) is 6e-300: what lies beyond has no weight in any estimate.
_LAST = 37
_PER_UNIT = 512
# Errors end here [sigma]: what is larger decides nothing that this does not, and squares of it keep their digits.
LARGEST = 1e6
_HALVINGS = 64


@dataclass(frozen=True, eq=False)
class QuantileTable:
    """x at z = 0, 1/512, 2/512, ... 37, and its slope dx/dz there."""

    values: FloatArray
    slopes: FloatArray


def quantile_table(
    log_upper: Callable[[FloatArray], FloatArray],
    log_density: Callable[[FloatArray], FloatArray],
    *,
    low: float,
    high: float,
) -> QuantileTable:
    """The table of a symmetric distribution.

    Args:
        log_upper: log P(X > x) for x >= 0.
        log_density: log of the density.
        low, high: x / z lies between them for every z > 0 at which x is below `LARGEST`.
    """
    z = np.arange(1, _LAST * _PER_UNIT + 1) / _PER_UNIT
    wanted = special.log_ndtr(-z)
    first, last = np.log(low * z), np.log(np.minimum(high * z, 2.0 * LARGEST))
    for _ in range(_HALVINGS):
        middle = 0.5 * (first + last)
        beyond = log_upper(np.exp(middle)) < wanted
        first, last = np.where(beyond, first, middle), np.where(beyond, middle, last)
    x = np.concatenate([[0.0], np.minimum(np.exp(0.5 * (first + last)), LARGEST)])
    z = np.concatenate([[0.0], z])
    log_normal = -0.5 * (z**2 + np.log(2.0 * np.pi))
    slope = np.where(x < LARGEST, np.exp(np.minimum(log_normal - log_density(x), 700.0)), 0.0)
    secant = np.diff(x) * _PER_UNIT
    # No slope above three times that of the chord on either side: then no cubic turns back.
    nearby = np.minimum(np.append(secant, secant[-1]), np.insert(secant, 0, secant[0]))
    return QuantileTable(x, np.minimum(slope, 3.0 * nearby))


def through_table(table: QuantileTable, unit: Array) -> Array:
    """x of standard normal numbers of any shape, odd in them; beyond the table its last value."""
    return jnp.sign(unit) * _interpolate(table, jnp.abs(unit))


def log_normal_upper(z: Array) -> Array:
    """log P(Z > z) of a standard normal Z for z >= 0, to 1e-12; a fraction of the time of the closed form."""
    return _interpolate(_log_normal_table(), z)


@functools.cache
def _log_normal_table() -> QuantileTable:
    z = np.arange(_LAST * _PER_UNIT + 1) / _PER_UNIT
    value = special.log_ndtr(-z)
    return QuantileTable(value, -np.exp(-0.5 * (z**2 + np.log(2.0 * np.pi)) - value))


def _interpolate(table: QuantileTable, z: Array) -> Array:
    """Values of a table at z >= 0."""
    values, slopes = (jnp.asarray(part, z.dtype) for part in (table.values, table.slopes / _PER_UNIT))
    place = jnp.minimum(z, float(_LAST)) * float(_PER_UNIT)
    node = jnp.minimum(place.astype(jnp.int32), _LAST * _PER_UNIT - 1)
    part = place - node.astype(z.dtype)
    left, right = values[node], values[node + 1]
    rest = 1.0 - part
    cubic = slopes[node] * rest - slopes[node + 1] * part + (right - left) * (2.0 * part - 1.0)
    return left * rest + right * part + part * rest * cubic
