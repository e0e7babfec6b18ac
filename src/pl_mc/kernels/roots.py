"""Square roots that can be differentiated."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def safe_sqrt(value: Array) -> Array:
    """Square root of what is at least zero but for rounding, with a finite gradient at zero."""
    positive = value > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, value, 1.0)), 0.0)
