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

Errors of one geometry share their gains, so that the filter is linear with gains known beforehand: covariances are
computed once, outside of the compiled passes, and the response to a ramp is the noise's plus the ramp's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import POSITION_UNKNOWNS, UP
from pl_mc.input_errors import InputError, require_choice, require_fraction, require_positive
from pl_mc.kernels.linear_model import product
from pl_mc.methods.raim_levels import P_FA
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

RANDOM_WALK, CONSTANT_VELOCITY = "random_walk", "constant_velocity"
LS_POSITION, FILTER_POSITION = "ls", "filter"

# What the filter knows before its first measurement, as standard deviations: next to nothing.
START_POSITION_M, START_CLOCK_M, START_VELOCITY_M_PER_S = 100.0, 1000.0, 5.0


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
        require_choice(self.motion, (RANDOM_WALK, CONSTANT_VELOCITY), field="kalman: motion")
        require_choice(self.guards, (LS_POSITION, FILTER_POSITION), field="kalman: guards")
        for name in ("position_m", "velocity_m_per_s", "clock_m"):
            require_positive(getattr(self, name), field=f"kalman: {name}")
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
        epochs, satellites, unknowns = rows.design.shape
        transition, process_root, start_root = motion_model(self, unknowns, rows.interval_s)
        base = len(start_root)
        measurement = np.zeros((epochs, satellites, base))
        measurement[:, :, :unknowns] = rows.design
        variance_m2 = rows.sigma_m**2
        process, start = process_root @ process_root.T, np.diag(start_root**2)
        if self.coloured:
            correlation, share = noise.correlation(rows.interval_s), noise.share
            slow = np.einsum("ei,ij->eij", np.sqrt(share) * rows.sigma_m * rows.in_view, np.eye(satellites))
            measurement = np.concatenate([measurement, slow], axis=2)
            variance_m2 = (1.0 - share) * variance_m2
            own = np.eye(satellites)
            transition = _beside(transition, correlation * own)
            process, start = _beside(process, (1.0 - correlation**2) * own), _beside(start, own)
        gain, weight = _gains(measurement, np.where(rows.in_view, variance_m2, 1.0), transition, process, start)
        weight = weight * rows.in_view[:, :, None] * rows.in_view[:, None, :]
        innovations, up_m = _ramp_response(measurement, gain, transition, ramp_m)
        pulled = np.einsum("eij,ej->ei", weight, innovations)

        samples = window_samples("kalman", self.windows_s, rows.interval_s, onset)
        made = []
        for w in samples:
            summed = window_sums(weight, w, onset)
            seen = np.einsum("eii->ei", summed) > 1e-12
            basis = np.einsum("ei,ij->eij", seen.astype(float), np.eye(satellites))
            made.append(whitened(summed, basis, window_sums(pulled, w, onset), self.p_fa))
        return FilterPlan(
            measurement=jnp.asarray(measurement), gain=jnp.asarray(gain), weight=jnp.asarray(weight),
            transition=jnp.asarray(transition), process_root=jnp.asarray(process_root),
            start_root=jnp.asarray(start_root), up_m=jnp.asarray(up_m), tests=window_tests(made, samples),
            base=base, own_position=self.guards == FILTER_POSITION,
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
        numbers = sample.motion[: self.base]
        moved = product(self.transition[: self.base, : self.base], true) + product(self.process_root, numbers)
        true = jnp.where(sample.time == 0, self.start_root[:, None] * numbers, moved)
        # Pseudoranges less those of the nominal state.
        observed_m = sample.noise_m + product(measurement[:, : self.base], true)
        predicted = product(self.transition, believed)
        innovation = (observed_m - product(measurement, predicted)) * sample.in_view[:, None]
        believed = predicted + product(gain, innovation)
        total = total + product(weight, innovation)
        return (true, believed, total), total, believed[UP] - true[UP]


def motion_model(test: KalmanInnovation, unknowns: int, interval_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Transition (b, b), root of the process noise (b, b), first standard deviations (b,).

    States are position, clocks and, with ``constant_velocity``, velocity.
    """
    clocks = unknowns - POSITION_UNKNOWNS
    root_s = np.sqrt(interval_s)
    start = np.array([START_POSITION_M] * POSITION_UNKNOWNS + [START_CLOCK_M] * clocks)
    walk = np.array([test.position_m] * POSITION_UNKNOWNS + [test.clock_m] * clocks) * root_s
    if test.motion == RANDOM_WALK:
        return np.eye(unknowns), np.diag(walk), start
    # White acceleration of the density q (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2).
    size = unknowns + POSITION_UNKNOWNS
    transition, process = np.eye(size), np.zeros((size, size))
    process[POSITION_UNKNOWNS:unknowns, POSITION_UNKNOWNS:unknowns] = np.diag(walk[POSITION_UNKNOWNS:])
    change = test.velocity_m_per_s * root_s
    for axis in range(POSITION_UNKNOWNS):
        place = unknowns + axis
        transition[axis, place] = interval_s
        # Variances q dt^3 / 3 and q dt, covariance q dt^2 / 2.
        process[axis, axis] = change * interval_s / np.sqrt(3.0)
        process[place, axis] = change * np.sqrt(3.0) / 2.0
        process[place, place] = change / 2.0
    return transition, process, np.concatenate([start, [START_VELOCITY_M_PER_S] * POSITION_UNKNOWNS])


def _gains(
    measurement: FloatArray, variance_m2: FloatArray, transition: FloatArray, process: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """K (T, s, m) and S^-1 (T, m, m), by the covariance recursion in Joseph's form."""
    epochs, satellites, states = measurement.shape
    gain, weight = np.empty((epochs, states, satellites)), np.empty((epochs, satellites, satellites))
    covariance, one = start, np.eye(states)
    for k in range(epochs):
        if k > 0:
            covariance = transition @ covariance @ transition.T + process
        h = measurement[k]
        spread = covariance @ h.T
        inverse = np.linalg.inv(h @ spread + np.diag(variance_m2[k]))
        weight[k] = 0.5 * (inverse + inverse.T)
        gain[k] = spread @ weight[k]
        left = one - gain[k] @ h
        covariance = left @ covariance @ left.T + (gain[k] * variance_m2[k]) @ gain[k].T
        covariance = 0.5 * (covariance + covariance.T)
    return gain, weight


def _ramp_response(
    measurement: FloatArray, gain: FloatArray, transition: FloatArray, ramp_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Innovations (T, m) and vertical error (T,) of the filter in a unit ramp without any noise."""
    innovations, up_m = np.empty(ramp_m.shape), np.empty(len(ramp_m))
    state = np.zeros(len(transition))
    for k in range(len(ramp_m)):
        state = transition @ state
        innovations[k] = ramp_m[k] - measurement[k] @ state
        state = state + gain[k] @ innovations[k]
        up_m[k] = state[UP]
    return innovations, up_m


def _beside(first: FloatArray, second: FloatArray) -> FloatArray:
    """The block diagonal matrix of two."""
    a, b = len(first), len(second)
    made = np.zeros((a + b, a + b))
    made[:a, :a], made[a:, a:] = first, second
    return made
