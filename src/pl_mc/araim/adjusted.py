"""The adjusted estimator: accuracy is spent, up to its limit, to stand nearer to the weakest subset.

Source: Blanch et al., IEEE Transactions on Aerospace and Electronic Systems 51(3), 2015, as the code of ADD v4.2's
authors has it (`compute_adjusted_position_1D` of MAAST for ARAIM).
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jax import Array

from pl_mc.araim.solving import Subsets, Whole, separation_floor

# Modes less probable than this are no reason to move, and how far accuracy stays from its limit [m].
_LEAST_PRIOR, _MARGIN_M = 1e-11, 1e-5


def adjusted(
    whole: Whole, modes: Subsets, instant: Array, bias_ratio: Array, accuracy_ratio: Array, limit_m: Array
) -> tuple[Whole, Subsets]:
    """The solutions with the all-in-view one moved, in each axis for itself, towards that of the largest sigma.

    Args:
        whole, modes: the solutions of least squares, of ``m`` modes and ``g`` geometries.
        instant: (m, g), priors at an instant.
        bias_ratio, accuracy_ratio: (n, g), as of `pl_mc.araim.solving.fit_subsets`.
        limit_m: (3,), largest sigma under the accuracy model, zero where there is none [m].
    """
    able = modes.regular & (instant >= _LEAST_PRIOR)
    sigma = jnp.where(able[None], modes.sigma_m, 0.0)
    weakest = jnp.argmax(sigma, axis=1)
    step = jnp.take_along_axis(modes.difference, weakest[:, None, None], axis=2)[:, :, 0]
    # No step where the solution with all satellites is the weakest itself.
    step = jnp.where((jnp.max(sigma, axis=1) > whole.sigma_m)[:, None], step, 0.0)
    a = jnp.sum(step**2 * accuracy_ratio[None], axis=1)
    b = jnp.sum(step * whole.gain * accuracy_ratio[None], axis=1)
    c = jnp.sum(whole.gain**2 * accuracy_ratio[None], axis=1) - (limit_m[:, None] - _MARGIN_M) ** 2
    moves = (c < 0) & (a > 0)
    root = jnp.sqrt(jnp.maximum(jnp.where(moves, b**2 - a * c, 0.0), 0.0))
    share = jnp.where(moves, jnp.minimum((root - b) / jnp.where(moves, a, 1.0), 1.0), 0.0)
    step = share[:, None] * step
    gain, difference = whole.gain + step, modes.difference - step[:, :, None]
    separation = jnp.sqrt(jnp.sum(difference**2 * accuracy_ratio[None, :, None], axis=1))
    differs = separation > separation_floor(sigma.dtype) * modes.sigma_m
    return (
        dataclasses.replace(
            whole,
            gain=gain,
            sigma_m=jnp.sqrt(jnp.sum(gain**2, axis=1)),
            bias_m=jnp.sum(jnp.abs(gain) * bias_ratio[None], axis=1),
            sigma_accuracy_m=jnp.sqrt(jnp.sum(gain**2 * accuracy_ratio[None], axis=1)),
        ),
        dataclasses.replace(
            modes,
            difference=jnp.where(differs[:, None], difference, 0.0),
            sigma_separation_m=jnp.where(differs, separation, 0.0),
        ),
    )
