"""Types of NumPy arrays, by the names that annotations use, and the arithmetic that they are computed in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Decorator of public functions: NumPy as it is delivered, whatever `numpy.seterr` has been set to. Numbers that fall
# below the smallest are zero, which is what sums of small probabilities rely on.
ordinary_arithmetic = np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
