"""Noise: one epoch's blocks of normal numbers."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pl_mc.kernels.noise import LANES, epoch_key, unit_noise
from pl_mc.statistics.intervals import binomial_p_value

BLOCKS, ROWS = 8, 24


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_noise(benchmark, precision):
    with jax.enable_x64(precision == "float64"):

        @jax.jit
        def draw(seed):
            key = epoch_key(seed, np.uint32(0))
            return jax.lax.map(lambda b: unit_noise(key, b, ROWS, jnp.dtype(precision)), jnp.arange(BLOCKS))

        noise = np.asarray(benchmark(lambda: jax.block_until_ready(draw(np.uint32(1)))))
    benchmark.extra_info["numbers"] = noise.size
    assert noise.shape == (BLOCKS, ROWS, LANES)
    assert noise.dtype == precision
    # Half are negative and 31.7 % beyond one sigma.
    assert binomial_p_value(int((noise < 0).sum()), noise.size, 0.5) > 1e-6
    assert binomial_p_value(int((np.abs(noise) > 1).sum()), noise.size, 0.31731050786291415) > 1e-6
