"""The problem of `pl-mc bench`, small enough that one round takes milliseconds.

``python -m pytest benchmarks --benchmark-enable -n 0`` measures; the tests run the same for correctness alone.
"""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.benchmark.problem import reference_errors_m, reference_faults, reference_geometry


@pytest.fixture(scope="session")
def g():
    return reference_geometry()


@pytest.fixture(scope="session")
def faults(g):
    return reference_faults(g)


@pytest.fixture(scope="session")
def errors_m(g) -> np.ndarray:
    """(256, n) pseudorange errors, noise and the biases in turn [m]."""
    return reference_errors_m(g, 256, seed=3)
