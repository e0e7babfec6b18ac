"""Precision and settings of a computation, chosen for its duration without touching the caller's configuration."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import jax
import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from pl_mc.input_errors import require_choice
from pl_mc.runtime.forks import require_own_threads

PRECISIONS = ("float64", "float32")


@contextlib.contextmanager
def precision_scope(precision: str) -> Iterator[None]:
    """A context (of this thread alone) in which JAX computes with ``precision``, and as it is delivered.

    What a user has set otherwise, by a call or the environment, would change the noise
    (``jax_threefry_partitionable``), numbers (promotion, precision of products) or refuse what is sound (ranks,
    transfers, NaN on the way).
    """
    require_choice(precision, PRECISIONS, field="precision")
    require_own_threads()
    with contextlib.ExitStack() as stack:
        for setting in (
            jax.enable_x64(precision == "float64"),
            jax.threefry_partitionable(True),
            jax.default_prng_impl("threefry2x32"),
            jax.numpy_dtype_promotion("standard"),
            jax.numpy_rank_promotion("allow"),
            jax.default_matmul_precision(None),
            jax.debug_nans(False),
            jax.debug_infs(False),
            jax.disable_jit(False),
            jax.check_tracer_leaks(False),
            jax.transfer_guard("allow"),
        ):
            stack.enter_context(setting)
        yield


def dtype_of(precision: str) -> np.dtype:
    """NumPy's type of that precision."""
    return np.dtype(require_choice(precision, PRECISIONS, field="precision"))


def on_device(values: ArrayLike, dtype: DTypeLike | None = None) -> jax.Array:
    """Numbers of NumPy as an array of JAX, in the scope of their precision.

    ``jnp.asarray`` compiles a program of its own for almost every new shape, which takes longer than many a call.
    """
    return jax.device_put(np.asarray(values, dtype))
