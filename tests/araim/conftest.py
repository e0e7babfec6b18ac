"""Strict promotion of types for the tests of this folder: no array changes its type by meeting another one."""

from __future__ import annotations

import jax
import pytest


@pytest.fixture(autouse=True)
def strict_types():
    with jax.numpy_dtype_promotion("strict"):
        yield
