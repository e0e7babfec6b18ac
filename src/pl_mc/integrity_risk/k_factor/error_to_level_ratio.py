"""The ratio of an error to the protection level of a multiplier of one: one number that serves every multiplier.

With VPL = K u an event happens where its ratio is above K: |e| / u for an error beyond the level, min(|e|, VAL) / u
for a misleading one (no alarm besides, K u <= VAL); horizontally with HPL, HAL and the length of the error. So the
ratio is a limit state for every K at once, compiled once; the levels that subset simulation climbs through are
multipliers themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.injection import at_epoch
from pl_mc.integrity_risk.rare.limit_state import EpochState
from pl_mc.integrity_risk.rare.subset import Coordinates
from pl_mc.kernels.events import sizes_and_levels
from pl_mc.methods.base import Method, Outcome
from pl_mc.methods.capabilities import with_k

EXCEEDED, MISLEADING = "exceeded", "misleading"
EVENTS = (EXCEEDED, MISLEADING)

# Logarithms of ratios are cut here: no solution on one side, a level of zero on the other.
_FAR = 700.0


class Ratio(Coordinates, Protocol):
    """A ratio that knows its coordinates."""

    def ratio(self, points: FloatArray) -> FloatArray: ...


@dataclass(frozen=True)
class RatioState(EpochState):
    """The ratio of an event, ``exceeded`` or ``misleading``; the multiplier is one, the noise Gaussian."""

    def ratio(self, points: FloatArray) -> FloatArray:
        """(N,), the ratio of points (N, dimension), standard normal; zero where no multiplier has the event."""
        return self.computed(points, ratio_of, np.bool_(self.event == MISLEADING))

    def at(self, k: float) -> RatioLimit:
        """The limit state of the event at one multiplier."""
        return RatioLimit(self, k)


@dataclass(frozen=True)
class RatioLimit:
    """log(ratio / k): positive exactly where the event happens with multiplier ``k``."""

    state: Ratio
    k: float

    @property
    def active(self) -> int:
        return self.state.active

    @property
    def dimension(self) -> int:
        return self.state.dimension

    def __call__(self, points: FloatArray) -> FloatArray:
        """(N,), of points (N, dimension)."""
        ratio = self.state.ratio(points)
        with np.errstate(divide="ignore"):
            return np.clip(np.log(ratio / self.k), -_FAR, _FAR)


def ratio_state(
    g: Geometry, fault: Faults, method: Method, event: str, alert: AlertLimits, axis: str = VERTICAL
) -> RatioState:
    """The ratio under one fault at an epoch, or a series of one, with redundancy; the multiplier does not count."""
    # A change of the multiplier would be another record, and a compilation of its own.
    return RatioState.of(g.as_series(), 0, at_epoch(g, fault, 0)[0], with_k(method, 1.0, axis), event, alert, axis=axis)


def ratio_of(outcome: Outcome, limit_m: Array | float, misleading: Array | bool, axis: str = VERTICAL) -> Array:
    """(...), the ratio of outcomes whose level has a multiplier of one, vertically or horizontally.

    Zero without a solution, and for a misleading event where the method's own test rejects; infinite where the
    level is zero, which every error exceeds.
    """
    ((error, level_m),) = sizes_and_levels(outcome, axis)
    worth = jnp.where(misleading, jnp.minimum(error, jnp.reshape(jnp.asarray(limit_m), ())), error)
    counts = outcome.available & ~(outcome.rejects & misleading)
    level = jnp.where(counts, level_m, 1.0)
    ratio = jnp.where(level > 0, worth / jnp.where(level > 0, level, 1.0), jnp.inf)
    return jnp.where(counts, ratio, 0.0)
