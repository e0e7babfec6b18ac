"""The innovation test of a Kalman filter, at single epochs and averaged: integrity by extrapolation.

A filter that was right until the ramp began predicts the next pseudoranges; a slow ramp pulls the filter after it,
so that no single innovation gives it away, but their average does. To test averages of residuals over several
intervals is the idea of AIME (Diesel & Luu 1995, GPS/IRS AIME: calculation of thresholds and protection radius
using chi-square methods, ION GPS-95; that paper was not at hand, a patent text of Diesel's about AIME was). Here it
is the weighted mean of the innovations, the best estimate of a constant in them, over its covariance:

    b = sum of S_k^-1 nu_k,   V^-1 = sum of S_k^-1,   s = b' V b,

which is chi-square with as many degrees of freedom as satellites where the filter's model is true. That form, the
windows and the filter without inertial sensors (AIME has them) are this file's own, so that numbers found here are
not those of AIME.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import UP
from pl_mc.input_errors import InputError, require_choice, require_fraction
from pl_mc.kernels.linear_model import product
from pl_mc.methods.raim_levels import P_FA
from pl_mc.runtime.precision import on_device
from pl_mc.time_ramps.filters import RANDOM_WALK, filter_model, gains, next_motion, ramp_response, require_motion
from pl_mc.time_ramps.sequential import Sample
from pl_mc.time_ramps.signals import LANES, NoiseInTime, Rows
from pl_mc.time_ramps.windows import (
    WindowTests,
    name_with_windows,
    whitened,
    window_samples,
    window_seconds,
    window_sums,
    window_tests,
)

LS_POSITION, FILTER_POSITION = "ls", "filter"


@dataclass(frozen=True)
class KalmanInnovation:
    """Innovations of a position and clock filter; a bank of averages takes the largest ratio to its threshold.

    The receiver moves as the filter believes: the same model drives both, from random numbers of its own.

    Attributes:
        windows_s: lengths over which innovations are averaged, 0 for the last one alone [s].
        motion: ``random_walk`` (position and one clock for every system) or ``constant_velocity`` (velocity too).
        position_m: standard deviation of the position's random walk after 1 s, each axis [m]; ``random_walk``.
        velocity_m_per_s: standard deviation of the velocity's change in 1 s, each axis [m/s];
            ``constant_velocity``.
        clock_m: standard deviation of each clock's random walk after 1 s [m].
        coloured: whether the filter has a state for the correlated part of every satellite's error; where not it
            takes all of it as white, and its innovations are not.
        guards: whose vertical error counts: ``ls``, the least-squares position as for the other tests, or
            ``filter``, the filter's own.
        p_fa: false-alarm probability behind the nominal thresholds; it decides, slightly, how windows share the
            false alarms.
    """

    windows_s: tuple[float, ...] = (0.0, 30.0, 100.0, 300.0)
    motion: str = RANDOM_WALK
    position_m: float = 0.3
    velocity_m_per_s: float = 0.1
    clock_m: float = 3.0
    coloured: bool = True
    guards: str = LS_POSITION
    p_fa: float = P_FA

    def __post_init__(self) -> None:
        object.__setattr__(self, "windows_s", window_seconds("kalman", self.windows_s))
        require_motion(self, owner="kalman")
        require_choice(self.guards, (LS_POSITION, FILTER_POSITION), field="kalman: guards")
        if not isinstance(self.coloured, bool):
            raise InputError(f"kalman: coloured: true or false is needed, not {self.coloured!r}.")
        require_fraction(self.p_fa, field="kalman: p_fa")

    @property
    def name(self) -> str:
        default = KalmanInnovation()
        parts = [
            f"{option}={getattr(self, option)}"
            for option in self.__dataclass_fields__
            if option != "windows_s" and getattr(self, option) != getattr(default, option)
        ]
        return name_with_windows(f"kalman({','.join(parts)})" if parts else "kalman", self.windows_s)

    def plan(self, rows: Rows, noise: NoiseInTime, ramp_m: FloatArray, onset: int) -> FilterPlan:
        satellites = len(rows.names)
        model = filter_model(self, rows, noise, coloured=self.coloured)
        made_gains = gains(model, np.ones((1, satellites)))
        gain = made_gains.gain[:, 0]
        weight = made_gains.weight[:, 0] * rows.in_view[:, :, None] * rows.in_view[:, None, :]
        innovations, up_m = ramp_response(model, made_gains.gain, ramp_m)
        pulled = np.einsum("eij,ej->ei", weight, innovations[:, 0])

        samples = window_samples("kalman", self.windows_s, rows.interval_s, onset)
        made = []
        for w in samples:
            summed = window_sums(weight, w, onset)
            seen = np.einsum("eii->ei", summed) > 1e-12
            basis = np.einsum("ei,ij->eij", seen.astype(float), np.eye(satellites))
            made.append(whitened(summed, basis, window_sums(pulled, w, onset), self.p_fa))
        return FilterPlan(
            measurement=on_device(model.measurement), gain=on_device(gain), weight=on_device(weight),
            transition=on_device(model.transition), process_root=on_device(model.process_root),
            start_root=on_device(model.start_root), up_m=on_device(up_m[:, 0]),
            tests=window_tests(made, samples), base=model.base, own_position=self.guards == FILTER_POSITION,
        )  # fmt: skip


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FilterPlan:
    """Everything of a filter that scenarios share; states are ``base`` of motion, then m of coloured errors.

    Attributes:
        measurement: (T, m, s), H, zero rows out of view [m per unit].
        gain: (T, s, m), K.
        weight: (T, m, m), S^-1, zero out of view [1/m^2].
        transition: (s, s), F.
        process_root: (base, base), G with G G' the process noise of the motion.
        start_root: (base,), standard deviations of the motion's first state.
        up_m: (T,), the filter's vertical error in a unit ramp [m].
        tests: at the monitored epochs.
        base: number of states of the motion.
        own_position: whether the filter's own position is guarded.
    """

    measurement: Array
    gain: Array
    weight: Array
    transition: Array
    process_root: Array
    start_root: Array
    up_m: Array
    tests: WindowTests
    base: int = field(metadata={"static": True})
    own_position: bool = field(metadata={"static": True})

    @property
    def motions(self) -> int:
        return self.base

    def epochs(self) -> tuple[Array, Array, Array]:
        return self.measurement, self.gain, self.weight

    def begin(self) -> tuple[Array, Array, Array]:
        """The true motion, the filter's state, and the sum of S^-1 nu [1/m]."""
        satellites, states = self.measurement.shape[1:]
        return jnp.zeros((self.base, LANES)), jnp.zeros((states, LANES)), jnp.zeros((satellites, LANES))

    def advance(
        self, epoch: tuple[Array, Array, Array], state: tuple[Array, Array, Array], sample: Sample
    ) -> tuple[tuple[Array, Array, Array], Array, Array]:
        (measurement, gain, weight), (true, believed, total) = epoch, state
        true = next_motion(self.transition, self.process_root, self.start_root, true, sample)
        # Pseudoranges less those of the nominal state.
        observed_m = sample.noise_m + product(measurement[:, : self.base], true)
        predicted = product(self.transition, believed)
        innovation = (observed_m - product(measurement, predicted)) * sample.in_view[:, None]
        believed = predicted + product(gain, innovation)
        total = total + product(weight, innovation)
        return (true, believed, total), total, believed[UP] - true[UP]
