"""Limit states of standard normal points whose probabilities are known, for the tests of rare-event estimators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Known:
    """A limit state in ``dimension`` coordinates, the last of which does not matter."""

    limit: Callable[[FloatArray], FloatArray]
    probability: float
    dimension: int

    @property
    def active(self) -> int:
        return self.dimension - 1

    def __call__(self, points: FloatArray) -> FloatArray:
        return self.limit(points)


HALF_SPACE = Known(lambda z: z[:, 0] - 5.0, float(stats.norm.sf(5.0)), 6)
# Four separate regions, of which two are rarer than the others.
CORNERS = Known(
    lambda z: np.maximum(np.abs(z[:, 0]) - 4.5, np.abs(z[:, 1]) - 4.7),
    float(1.0 - (1.0 - 2 * stats.norm.sf(4.5)) * (1.0 - 2 * stats.norm.sf(4.7))),
    8,
)
SHELL = Known(lambda z: (z[:, :4] ** 2).sum(axis=1) - 45.0, float(stats.chi2.sf(45.0, 4)), 5)
# A plateau: nothing but the event itself shows the way beyond 3.
PLATEAU = Known(lambda z: np.where(z[:, 0] > 3.5, 1.0, -1e9), float(stats.norm.sf(3.5)), 3)
FAR_HALF_SPACE = Known(lambda z: z[:, 2] - 10.0, float(stats.norm.sf(10.0)), 6)
NEVER = Known(lambda z: np.tanh(z[:, 0]) - 1.5, 0.0, 3)
