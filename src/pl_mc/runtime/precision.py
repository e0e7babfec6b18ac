"""Precision of a computation, chosen for its duration without touching the caller's JAX configuration."""

from __future__ import annotations

from contextlib import AbstractContextManager

import jax
import numpy as np

from pl_mc.input_errors import require_choice

PRECISIONS = ("float64", "float32")


def precision_scope(precision: str) -> AbstractContextManager:
    """A context (of this thread alone) in which JAX computes with ``precision``."""
    require_choice(precision, PRECISIONS, field="precision")
    return jax.enable_x64(precision == "float64")


def dtype_of(precision: str) -> np.dtype:
    """NumPy's type of that precision."""
    return np.dtype(require_choice(precision, PRECISIONS, field="precision"))
