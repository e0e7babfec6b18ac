"""A bank of Kalman filters, one without each satellite: their separations as a test, and the level that they prove.

Filter 0 uses all satellites, filter k all but satellite k, from the first epoch on, so that whenever a fault of k began
filter k is free of it. All are optimal for one model, so that what filter 0 knows more is uncorrelated with its error
and sigma_ss^2 = sigma_k^2 - sigma_0^2. Test and level are those of solution separation (ADD v3.0) with these sigmas:
|e_0| <= |e_k| + |x_k - x_0|, whatever the filters are.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.araim.budget import LPV_200, V3, Budget, as_budget, require_standard
from pl_mc.araim.risk_equations import Priors, figures, solve_levels
from pl_mc.araim.solving import Subsets, Whole
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import UP
from pl_mc.input_errors import InputError, require_fraction, require_list, require_within, shown
from pl_mc.kernels.linear_model import product
from pl_mc.time_ramps.filters import (
    RANDOM_WALK,
    FilterModel,
    Gains,
    filter_model,
    gains,
    next_motion,
    ramp_response,
    require_motion,
)
from pl_mc.time_ramps.sequential import Sample
from pl_mc.time_ramps.signals import LANES, NoiseInTime, Rows
from pl_mc.time_ramps.windows import WindowTests

# A separation below this share of the filter's sigma is rounding: its satellite has told nothing yet.
_LEAST_SEPARATION = 1e-6


@dataclass(frozen=True)
class FilterBank:
    """Vertical solution separation over a bank of Kalman filters, one without each satellite; guards filter 0.

    The receiver moves as the filters believe, as that of `KalmanInnovation` does. Filters have a state for every
    satellite's slow error, and one for its smoothed code noise. Faults are of single satellites; two at once count as
    not monitored, and faults of constellations not at all.

    Attributes:
        motion, position_m, velocity_m_per_s, clock_m: as of `KalmanInnovation`.
        taus_s: shortest and longest correlation time that the slow part may have [s]; filters then take the process
            that bounds all between them (`pl_mc.time_ramps.filters.bounding_process`), and the true one where none
            are given.
        p_sat: prior probability of the fault of each satellite.
        budget: integrity and false-alarm risk, a record of `pl_mc.araim`, its name or a table; without exposure.
    """

    motion: str = RANDOM_WALK
    position_m: float = 0.3
    velocity_m_per_s: float = 0.1
    clock_m: float = 3.0
    taus_s: tuple[float, float] | None = None
    p_sat: float = 1e-5
    budget: Budget = LPV_200

    def __post_init__(self) -> None:
        require_motion(self, owner="filter_bank")
        require_fraction(self.p_sat, field="filter_bank: p_sat")
        object.__setattr__(self, "budget", as_budget(self.budget, field="filter_bank: budget"))
        require_standard(V3, self.budget, of="filter_bank: ")
        if self.taus_s is not None:
            taus = require_list(self.taus_s, field="filter_bank: taus_s", of="two times in seconds")
            times = tuple(require_within(tau, field="filter_bank: taus_s", low=1e-3, high=1e9) for tau in taus)
            if len(times) != 2 or times[0] > times[1]:
                raise InputError(
                    f"filter_bank: taus_s: the shortest and the longest time are needed, such as (100, 1000), not "
                    f"{shown(self.taus_s)}."
                )
            object.__setattr__(self, "taus_s", times)

    @property
    def name(self) -> str:
        default = FilterBank()
        parts = []
        for option in self.__dataclass_fields__:
            value = getattr(self, option)
            if value != getattr(default, option):
                text = f"{value[0]:g}-{value[1]:g}" if isinstance(value, tuple) else value
                parts.append(f"{option}={text}")
        return f"filter_bank({','.join(parts)})" if parts else "filter_bank"

    def filters(self, rows: Rows, noise: NoiseInTime) -> tuple[FilterModel, Gains]:
        """What they believe, and their gains: of all satellites, and without each of them."""
        model, satellites = filter_model(self, rows, noise, taus_s=self.taus_s), len(rows.names)
        return model, gains(model, np.concatenate([np.ones((1, satellites)), 1.0 - np.eye(satellites)]))

    def plan(self, rows: Rows, noise: NoiseInTime, ramp_m: FloatArray, onset: int) -> FilterBankPlan:
        model, made = self.filters(rows, noise)
        up_m = ramp_response(model, made.gain, ramp_m)[1]
        solved = separation_levels(self, rows, np.sqrt(made.up_variance_m2))
        # One row of a whitener for each satellite: its separation over its threshold.
        there = np.isfinite(solved.threshold_m) & (solved.threshold_m > 0)
        scale = np.where(there, 1.0 / np.where(there, solved.threshold_m, 1.0), 0.0)[onset:]
        return FilterBankPlan(
            measurement=jnp.asarray(model.measurement), gain=jnp.asarray(made.gain),
            transition=jnp.asarray(model.transition), process_root=jnp.asarray(model.process_root),
            start_root=jnp.asarray(model.start_root), up_m=jnp.asarray(up_m[:, 0]),
            tests=WindowTests(
                jnp.asarray((scale[:, :, None] * np.eye(scale.shape[1]))[:, :, None]),
                jnp.asarray((scale * (up_m[:, 1:] - up_m[:, :1])[onset:])[:, :, None]),
                (0,) * scale.shape[1],
            ),
            base=model.base,
        )  # fmt: skip


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FilterBankPlan:
    """Everything of a bank that scenarios share; states and filters as of `FilterModel` and `Gains`.

    Attributes:
        measurement: (T, m, s), H [m per unit].
        gain: (T, m + 1, s, m), K of every filter, zero for what it does not use.
        transition, process_root, start_root: of the model.
        up_m: (T,), vertical error of filter 0 in a unit ramp [m].
        tests: of the separations at the monitored epochs.
        base: number of states of the motion.
    """

    measurement: Array
    gain: Array
    transition: Array
    process_root: Array
    start_root: Array
    up_m: Array
    tests: WindowTests
    base: int = field(metadata={"static": True})
    own_position: bool = field(default=True, metadata={"static": True})

    @property
    def motions(self) -> int:
        return self.base

    def epochs(self) -> tuple[Array, Array]:
        return self.measurement, self.gain

    def begin(self) -> tuple[Array, Array]:
        """The true motion, and the states of all filters."""
        filters, states = self.gain.shape[1:3]
        return jnp.zeros((self.base, LANES)), jnp.zeros((filters, states, LANES))

    def advance(
        self, epoch: tuple[Array, Array], state: tuple[Array, Array], sample: Sample
    ) -> tuple[tuple[Array, Array], Array, Array]:
        (measurement, gain), (true, believed) = epoch, state
        true = next_motion(self.transition, self.process_root, self.start_root, true, sample)
        observed_m = sample.noise_m + product(measurement[:, : self.base], true)
        predicted = product(self.transition, believed)
        innovation = observed_m - product(measurement, predicted)
        believed = predicted + product(gain, innovation)
        up = believed[:, UP]
        return (true, believed), up[1:] - up[:1], up[0] - true[UP]


@dataclass(frozen=True)
class SeparationLevels:
    """Vertical tests and levels of every epoch.

    Attributes:
        sigma_m: (T, m + 1), believed standard deviations of the vertical errors: all satellites, without each [m].
        threshold_m: (T, m), largest separation that passes; infinite where a satellite is not monitored [m].
        level_m: (T,), vertical protection level; infinite where there is none [m].
    """

    sigma_m: FloatArray
    threshold_m: FloatArray
    level_m: FloatArray


def separation_levels(
    bank: FilterBank, rows: Rows, sigma_m: FloatArray, solved: NDArray[np.bool_] | None = None,
    used: NDArray[np.bool_] | None = None,
) -> SeparationLevels:  # fmt: skip
    """The equations of ARAIM (ADD v3.0) with sigmas of estimates that are optimal, each for its satellites.

    Args:
        bank: budget and priors.
        rows: the series.
        sigma_m: (T, m + 1), vertical standard deviations of all satellites and without each [m].
        solved: (T, m + 1), where there is such an estimate; everywhere unless given.
        used: (T, m), satellites whose fault would harm the estimate of an epoch: all that were in view up to it,
            for a filter remembers, unless others are given.
    """
    used = np.logical_or.accumulate(rows.in_view) if used is None else used
    solved = np.ones(sigma_m.shape, bool) if solved is None else solved
    sigma = np.where(solved, sigma_m, 1.0)
    variance = np.maximum(sigma[:, 1:] ** 2 - sigma[:, :1] ** 2, 0.0)
    separation = np.where(variance > (_LEAST_SEPARATION * sigma[:, :1]) ** 2, np.sqrt(variance), 0.0)
    number = used.sum(axis=1)
    none = (1.0 - bank.p_sat) ** number
    one = none * bank.p_sat / (1.0 - bank.p_sat)

    def axes(values: FloatArray) -> Array:
        """The same on all three axes, of which the last is used."""
        return jnp.asarray(np.broadcast_to(values.T, (UP + 1, *values.T.shape)))

    nothing, empty = jnp.zeros((UP + 1, used.shape[1], len(used))), jnp.zeros((UP + 1, 1, used.shape[1], len(used)))
    whole = Whole(axes(sigma[:, 0]), nothing[:, 0], axes(sigma[:, 0]), jnp.asarray(solved[:, 0]), empty[:, :, 0])
    modes = Subsets(empty, axes(sigma[:, 1:]), nothing, axes(separation), jnp.asarray(solved[:, 1:].T))
    priors = Priors(
        jnp.asarray(np.where(used, one[:, None], 0.0).T), jnp.asarray(np.maximum(1.0 - none - number * one, 0.0))
    )
    levels = jax.device_get(jax.jit(solve_levels)(whole, modes, priors, figures(bank.budget, used.shape[1])))
    threshold, level = levels.threshold_m[UP].T, levels.level_m[UP]
    return SeparationLevels(np.where(solved, sigma_m, np.inf), threshold, level)
