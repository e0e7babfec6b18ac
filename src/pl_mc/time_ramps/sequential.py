"""What a sequential test is: sums over windows of vectors that are linear in the errors of a pass.

To add one, write a file beside this one and list its class in `pl_mc.time_ramps.timing.SEQUENTIAL`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.time_ramps.signals import NoiseInTime, Rows
from pl_mc.time_ramps.windows import WindowTests


@dataclass(frozen=True)
class Sample:
    """One epoch of all lanes, without a fault.

    Attributes:
        time: (), its number.
        noise: (m, lanes), errors in units of sigma, zero out of view.
        fitted: (m, lanes), what least squares fits of them.
        noise_m: (m, lanes), the errors [m].
        motion: (k, lanes), standard normal numbers that move the receiver; every test sees the same.
        in_view: (m,).
    """

    time: Array
    noise: Array
    fitted: Array
    noise_m: Array
    motion: Array
    in_view: Array


class SequentialPlan(Protocol):
    """What the geometry and the correlation of the errors decide of a test; a pytree."""

    @property
    def tests(self) -> WindowTests:
        """Of the sums, at the monitored epochs."""

    @property
    def up_m(self) -> Array:
        """(T,), vertical error of the test's own position in a unit ramp [m]."""

    @property
    def own_position(self) -> bool:
        """Whether that position is guarded, and not the one of least squares."""

    @property
    def motions(self) -> int:
        """How many numbers of the receiver's motion it uses."""

    def epochs(self) -> Any:
        """What `advance` is given of each epoch, (T, ...)."""

    def begin(self) -> Any:
        """The state of all lanes before the first epoch."""

    def advance(self, epoch: Any, state: Any, sample: Sample) -> tuple[Any, Array, Array]:
        """Next state, sum (m, lanes) of the vectors from the first epoch on, own vertical error (lanes,) [m]."""


@runtime_checkable
class SequentialTest(Protocol):
    """A test with its options; a frozen, hashable record."""

    @property
    def name(self) -> str:
        """The name in tables."""

    def plan(self, rows: Rows, noise: NoiseInTime, ramp_m: NDArray[np.float64], onset: int) -> SequentialPlan:
        """The plan of a series, in double precision.

        Args:
            rows: the series.
            noise: what correlates the errors.
            ramp_m: (T, m), the unit ramp [m].
            onset: first monitored sample.
        """
