"""Settings of the whole suite: 64-bit JAX, the folder of real data, reproducible property tests."""

from __future__ import annotations

import os
from pathlib import Path

import jax
import pytest
from hypothesis import HealthCheck, settings

# The library never touches the caller's configuration; the tests are a caller that wants double precision. Those of
# kernels and methods are strict about the promotion of types as well.
jax.config.update("jax_enable_x64", True)

# A first example compiles, the others do not: neither a deadline nor a health check of the time means anything.
settings.register_profile(
    "default", deadline=None, database=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("ci", settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")

DATA_VARIABLE = "PL_MC_DATA"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of receiver files and truth tables that the environment names; the test is skipped without one."""
    named = os.environ.get(DATA_VARIABLE)
    if not named:
        pytest.skip(f"{DATA_VARIABLE} names no folder of receiver files")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"{DATA_VARIABLE} names {named}, which is no folder")
    return folder
