"""Noise: reproducible draws, the same for every method and every fault.

A draw is found by seed, epoch number, block and lane, whatever was computed before it: the counter-based generator
(threefry, in the form whose numbers do not depend on the array's size) makes any part of a sweep on its own.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

# Keys of the second and further numbers of a satellite are found beyond all numbers that blocks can have.
_FURTHER = 2**31

# Draws per block. Part of the definition of the noise: another width gives other draws.
LANES = 256


def epoch_key(seed: Array, epoch: Array) -> Array:
    """The key of one epoch's noise."""
    # As `jax.random.key` makes it of a seed of 32 bits, but for the offset that a user may have set for all seeds.
    words = jnp.stack([jnp.zeros((), jnp.uint32), jnp.asarray(seed, jnp.uint32)])
    return jax.random.fold_in(jax.random.wrap_key_data(words, impl="threefry2x32"), epoch)


def live_lanes(block: Array, full_blocks: Array, remainder: Array) -> Array:
    """(LANES,), which draws of a block count: all below ``full_blocks``, the first ``remainder`` of that one.

    Blocks and lanes are compared apart, since a draw number would not fit an int32.
    """
    return (block < full_blocks) | ((block == full_blocks) & (jnp.arange(LANES, dtype=jnp.int32) < remainder))


def unit_noise(key: Array, block: Array, rows: int, dtype: jax.typing.DTypeLike) -> Array:
    """(rows, LANES), independent standard normal errors of one block, in units of each satellite's sigma.

    The numbers of a row do not depend on how many rows there are, so padding changes nothing. Single precision uses
    other random bits than double, and its inverse error function ends at 5.42 standard deviations.
    """
    return jax.random.normal(jax.random.fold_in(key, block), (rows, LANES), dtype)


def unit_inputs(key: Array, block: Array, inputs: int, rows: int, dtype: jax.typing.DTypeLike) -> tuple[Array, ...]:
    """``inputs`` arrays (rows, LANES) of independent standard normal numbers; the first is `unit_noise`.

    The others come from keys of their own, so that the first does not depend on how many there are.
    """
    keys = [key, *(jax.random.fold_in(key, np.uint32(_FURTHER + k)) for k in range(inputs - 1))]
    return tuple(unit_noise(one, block, rows, dtype) for one in keys)
