"""Biases that are drawn with the noise: numbers of their own, lane by lane, from the same counter-based generator."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.special import ndtr
from numpy.typing import NDArray

from pl_mc.geometry.record import Geometry
from pl_mc.injection import DrawnRows, drawn_m
from pl_mc.kernels.noise import epoch_key, unit_noise
from pl_mc.runtime.precision import on_device, precision_scope

# Their keys lie beyond those of all blocks and of all further numbers of the noise.
_SIZES, _SIGNS = np.uint32(2**32 - 1), np.uint32(2**32 - 2)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DrawnBiases:
    """The arrays of `pl_mc.injection.DrawnRows`, (e, f, n), for a compiled function."""

    start_m: Array
    spread_m: Array
    uniform: Array
    either: Array
    of: Array

    @classmethod
    def of_rows(cls, rows: DrawnRows, dtype: np.dtype) -> DrawnBiases:
        """In the precision of a call, whose scope this is called in."""
        in_metres = (on_device(part, dtype) for part in (rows.start_m, rows.spread_m))
        return cls(*in_metres, *map(on_device, (rows.uniform, rows.either, rows.of)))

    @property
    def rows(self) -> Array:
        """Which rows have a drawn bias."""
        return (self.start_m != 0) | (self.spread_m != 0)

    def lanes(self, numbers: Array) -> Array:
        """(n, lanes), the drawn biases of one fault (n,) [m], from the numbers (2, n, lanes) of its epoch."""
        column = jax.tree.map(lambda part: part[:, None], self)
        return drawn_m(column, numbers[:, self.of], ndtr)


def bias_numbers(seed: Array, epoch: Array, block: Array, rows: int, dtype: jax.typing.DTypeLike) -> Array:
    """(2, rows, LANES), standard normal numbers of one block for sizes and for signs, the same for every fault.

    They share nothing with the noise, whose draws stay as they are, and depend on what the noise depends on alone.
    """
    key = epoch_key(seed, epoch)
    return jnp.stack([unit_noise(jax.random.fold_in(key, part), block, rows, dtype) for part in (_SIZES, _SIGNS)])


def numbers_of_draw(g: Geometry, *, seed: int, draw: int = 0) -> NDArray[np.float64]:
    """(e, 2, n), the numbers of one of the first draws of each epoch of a series, as a sweep with the seed has them."""
    with precision_scope("float64"):
        epochs = np.asarray(g.epoch, np.uint32)
        return np.asarray(_numbers(np.uint32(seed), epochs, np.int32(draw), rows=g.sigma_m.shape[1]))


@functools.partial(jax.jit, static_argnames=("rows",))
def _numbers(seed: Array, epochs: Array, draw: Array, *, rows: int) -> Array:
    return jax.lax.map(lambda one: bias_numbers(seed, one, jnp.int32(0), rows, jnp.float64)[..., draw], epochs)
