"""Kalman filters of position, clocks and errors: their model, their gains, and what a ramp does to them.

Errors of one geometry share their gains, so that a filter is linear with gains known beforehand: covariances are
computed once, outside of the compiled passes, and the response to a ramp is the noise's plus the ramp's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import POSITION_UNKNOWNS, UP
from pl_mc.input_errors import require_choice, require_within
from pl_mc.kernels.linear_model import product
from pl_mc.time_ramps.sequential import Sample
from pl_mc.time_ramps.signals import NoiseInTime, Rows

RANDOM_WALK, CONSTANT_VELOCITY = "random_walk", "constant_velocity"

# What the filter knows before its first measurement, as standard deviations: next to nothing.
START_POSITION_M, START_CLOCK_M, START_VELOCITY_M_PER_S = 100.0, 1000.0, 5.0

# What a motion may add at a step, in its own units: beyond, covariances of double precision tell nothing.
_LEAST_MOTION, _MOST_MOTION = 1e-9, 1e4


class Motion(Protocol):
    """How a receiver moves: the fields of this name of `KalmanInnovation` and `FilterBank`."""

    @property
    def motion(self) -> str: ...

    @property
    def position_m(self) -> float: ...

    @property
    def velocity_m_per_s(self) -> float: ...

    @property
    def clock_m(self) -> float: ...


def require_motion(given: Motion, *, owner: str) -> None:
    """Raise `InputError` for a motion that is none."""
    require_choice(given.motion, (RANDOM_WALK, CONSTANT_VELOCITY), field=f"{owner}: motion")
    for name in ("position_m", "velocity_m_per_s", "clock_m"):
        require_within(getattr(given, name), field=f"{owner}: {name}", low=_LEAST_MOTION, high=_MOST_MOTION)


@dataclass(frozen=True)
class FilterModel:
    """What a filter believes; states are ``base`` of motion, then those of the satellites' errors in units of sigma.

    Attributes:
        measurement: (T, m, s), H, zero rows out of view [m per unit].
        variance_m2: (T, m), of the white part of each pseudorange, 1 out of view [m^2].
        transition: (s, s), F.
        process, start: (s, s), covariances of what is added at each step and of the first state.
        process_root: (base, base), G with G G' the process noise of the motion.
        start_root: (base,), standard deviations of the motion's first state.
    """

    measurement: FloatArray
    variance_m2: FloatArray
    transition: FloatArray
    process: FloatArray
    start: FloatArray
    process_root: FloatArray
    start_root: FloatArray

    @property
    def base(self) -> int:
        return len(self.start_root)


def filter_model(
    moves: Motion, rows: Rows, noise: NoiseInTime, *, coloured: bool = True, taus_s: tuple[float, float] | None = None
) -> FilterModel:
    """The model of a filter for errors of `NoiseInTime`.

    Args:
        moves: the motion.
        rows: the series.
        noise: the errors.
        coloured: whether every satellite has a state for the slow part of its error, and one for the smoothed code
            noise; where not all of the error is taken as white.
        taus_s: shortest and longest correlation time that the slow part may have, see `bounding_process`; that of
            ``noise`` unless given.
    """
    epochs, satellites, unknowns = rows.design.shape
    transition, process_root, start_root = motion_model(moves, unknowns, rows.interval_s)
    base = len(start_root)
    measurement = np.zeros((epochs, satellites, base))
    measurement[:, :, :unknowns] = rows.design
    variance_m2 = rows.sigma_m**2
    process, start = process_root @ process_root.T, np.diag(start_root**2)
    if coloured:
        white, *parts = noise.parts(rows.interval_s)
        if taus_s is not None:
            tau_s, factor = bounding_process(*taus_s)
            parts[0] = (NoiseInTime(tau_s).correlation(rows.interval_s), parts[0][1] * factor)
        own = np.eye(satellites)
        for correlation, share in parts:
            states = np.einsum("ei,ij->eij", np.sqrt(share) * rows.sigma_m * rows.in_view, own)
            measurement = np.concatenate([measurement, states], axis=2)
            transition = beside(transition, correlation * own)
            process, start = beside(process, (1.0 - correlation**2) * own), beside(start, own)
        variance_m2 = white * variance_m2
    variance_m2 = np.where(rows.in_view, variance_m2, 1.0)
    return FilterModel(measurement, variance_m2, transition, process, start, process_root, start_root)


def bounding_process(low_s: float, high_s: float) -> tuple[float, float]:
    """Correlation time [s], and factor on the variance, of a Gauss-Markov process that bounds those between two.

    The spectrum 2 s^2 tau / (1 + w^2 tau^2) is largest at w = 0 for the longest tau and, as w grows, for the
    shortest. That of sqrt(low high), with the variance times sqrt(high / low), meets the first at zero and the second
    at infinity, and lies above all of them in between (cross-multiplied, the difference is linear in w^2). So the
    covariance matrix of its samples, at whatever times, exceeds theirs by a positive semidefinite one: the variance
    of every linear estimate that is computed with it bounds the true one. Frequency-domain overbounds and their use
    in Kalman filters are of Langel, Garcia Crespillo & Joerger (PLANS 2020; NAVIGATION 68(2), 2021); their papers
    were not at hand, and their model with a larger first variance is another one.
    """
    return math.sqrt(low_s * high_s), math.sqrt(high_s / low_s)


def motion_model(moves: Motion, unknowns: int, interval_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Transition (b, b), root of the process noise (b, b), first standard deviations (b,).

    States are position, clocks and, with ``constant_velocity``, velocity.
    """
    clocks = unknowns - POSITION_UNKNOWNS
    root_s = np.sqrt(interval_s)
    start = np.array([START_POSITION_M] * POSITION_UNKNOWNS + [START_CLOCK_M] * clocks)
    walk = np.array([moves.position_m] * POSITION_UNKNOWNS + [moves.clock_m] * clocks) * root_s
    if moves.motion == RANDOM_WALK:
        return np.eye(unknowns), np.diag(walk), start
    # White acceleration of the density q (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2).
    size = unknowns + POSITION_UNKNOWNS
    transition, process = np.eye(size), np.zeros((size, size))
    process[POSITION_UNKNOWNS:unknowns, POSITION_UNKNOWNS:unknowns] = np.diag(walk[POSITION_UNKNOWNS:])
    change = moves.velocity_m_per_s * root_s
    for axis in range(POSITION_UNKNOWNS):
        place = unknowns + axis
        transition[axis, place] = interval_s
        # Variances q dt^3 / 3 and q dt, covariance q dt^2 / 2.
        process[axis, axis] = change * interval_s / np.sqrt(3.0)
        process[place, axis] = change * np.sqrt(3.0) / 2.0
        process[place, place] = change / 2.0
    return transition, process, np.concatenate([start, [START_VELOCITY_M_PER_S] * POSITION_UNKNOWNS])


@dataclass(frozen=True)
class Gains:
    """Of filters side by side, each with satellites of its own.

    Attributes:
        gain: (T, filters, s, m), K.
        weight: (T, filters, m, m), S^-1; of satellites that a filter does not use that of a unit variance.
        up_variance_m2: (T, filters), of the vertical error, after each epoch [m^2].
    """

    gain: FloatArray
    weight: FloatArray
    up_variance_m2: FloatArray


def gains(model: FilterModel, uses: FloatArray) -> Gains:
    """The covariance recursion in Joseph's form, of all filters at once.

    ``uses``: (filters, m), 1 for satellites that a filter uses, else 0.
    """
    (epochs, satellites, states), filters = model.measurement.shape, len(uses)
    gain, weight = np.empty((epochs, filters, states, satellites)), np.empty((epochs, filters, satellites, satellites))
    up = np.empty((epochs, filters))
    covariance, one = np.broadcast_to(model.start, (filters, states, states)), np.eye(states)
    for k in range(epochs):
        if k > 0:
            covariance = model.transition @ covariance @ model.transition.T + model.process
        h = uses[:, :, None] * model.measurement[k]
        # Of a satellite that is not used a unit variance stands for nothing; its row is zero.
        variance = np.where(uses > 0, model.variance_m2[k], 1.0)
        spread = covariance @ np.swapaxes(h, 1, 2)
        inverse = np.linalg.inv(h @ spread + variance[:, :, None] * np.eye(satellites))
        weight[k] = 0.5 * (inverse + np.swapaxes(inverse, 1, 2))
        gain[k] = spread @ weight[k]
        left = one - gain[k] @ h
        covariance = left @ covariance @ np.swapaxes(left, 1, 2)
        covariance = covariance + (gain[k] * variance[:, None]) @ np.swapaxes(gain[k], 1, 2)
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        up[k] = covariance[:, UP, UP]
    return Gains(gain, weight, up)


def ramp_response(model: FilterModel, gain: FloatArray, ramp_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Innovations (T, filters, m) and vertical error (T, filters) in a unit ramp without any noise."""
    epochs, filters = gain.shape[:2]
    innovations, up_m = np.empty((epochs, filters, ramp_m.shape[1])), np.empty((epochs, filters))
    state = np.zeros((filters, len(model.transition)))
    for k in range(epochs):
        state = state @ model.transition.T
        innovations[k] = ramp_m[k] - state @ model.measurement[k].T
        state = state + np.einsum("fsm,fm->fs", gain[k], innovations[k])
        up_m[k] = state[:, UP]
    return innovations, up_m


def beside(*blocks: FloatArray) -> FloatArray:
    """The block diagonal matrix."""
    size = sum(len(block) for block in blocks)
    made, place = np.zeros((size, size)), 0
    for block in blocks:
        made[place : place + len(block), place : place + len(block)] = block
        place += len(block)
    return made


def next_motion(transition: Array, process_root: Array, start_root: Array, before: Array, sample: Sample) -> Array:
    """(base, lanes), the true state of the receiver, which moves as filters believe."""
    base = len(start_root)
    numbers = sample.motion[:base]
    moved = product(transition[:base, :base], before) + product(process_root, numbers)
    return jnp.where(sample.time == 0, start_root[:, None] * numbers, moved)
