"""Signals in time: pseudorange errors of every satellite from sample to sample, and a ramp on one of them.

Rows are satellites, not places in an epoch: a satellite keeps its row, and with it its correlated error, whoever
else rises or sets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_number
from pl_mc.ism import codes_of
from pl_mc.kernels.noise import LANES, epoch_key
from pl_mc.noise_models.gauss_markov import GaussMarkov

# Keys of passes lie beyond those of single epochs and of exposures.
_PASSES = 2**31 + 2**29


@dataclass(frozen=True)
class NoiseInTime:
    """Every satellite's error in units of its sigma: a white part and a first-order Gauss-Markov part.

    n_k = sqrt(1 - s) w_k + sqrt(s) u_k, with w white and u stationary, both of unit variance; satellites are
    independent of each other. At a single moment the error has the satellite's sigma, whatever the two are.

    Attributes:
        tau_s: correlation time of u [s]; 0 makes it white as well.
        share: s, share of u in the variance, from 0 to 0.999: some white part is left, so that samples tell more
            than one of them does.
    """

    tau_s: float
    share: float = 0.5

    def __post_init__(self) -> None:
        _ = GaussMarkov(self.tau_s)
        if not 0.0 <= require_number(self.share, field="share") <= 0.999:
            raise InputError(f"share: a share of the variance from 0 to 0.999 is needed, not {self.share!r}.")

    def correlation(self, interval_s: float) -> float:
        """Of u, from one sample to the next."""
        return GaussMarkov(self.tau_s).correlation(interval_s)

    def autocorrelation(self, lags: ArrayLike, interval_s: float) -> FloatArray:
        """(...), of the whole error at lags in samples: 1 at zero, else s phi^|lag|."""
        number = np.abs(np.asarray(lags))
        return np.where(number == 0, 1.0, self.share * self.correlation(interval_s) ** number)


@dataclass(frozen=True)
class Rows:
    """A series of epochs with one row for every satellite.

    Attributes:
        names: m satellites.
        design: (T, m, t), zero where a satellite is out of view [m/m].
        sigma_m: (T, m), 1 where it is out of view [m].
        in_view: (T, m).
        interval_s: time between epochs [s].
        codes: (m,), codes of the satellites, for methods that tell them apart.
    """

    names: tuple[str, ...]
    design: FloatArray
    sigma_m: FloatArray
    in_view: NDArray[np.bool_]
    interval_s: float
    codes: NDArray[np.int32] | None = None


def rows_by_satellite(g: Geometry) -> Rows:
    """The rows of a series, satellite by satellite.

    Raises:
        InputError: a single epoch, or epochs without date or of unequal distance.
    """
    if not isinstance(g, Geometry) or not g.is_series or len(g) < 2:
        raise InputError("geometry: a ramp in time needs a series of epochs, such as pl_mc.simulate(interval_s=1.0).")
    steps = np.diff(g.time_gps_s)
    if not (np.isfinite(steps).all() and steps[0] > 0 and np.allclose(steps, steps[0], rtol=0.0, atol=1e-6)):
        raise InputError("geometry: the epochs of a ramp in time have dates with equal distances.")
    epochs, satellites = len(g), len(g.names)
    at, row = np.nonzero(g.in_view)
    satellite = g.satellite[at, row]
    design = np.zeros((epochs, satellites, g.design.shape[-1]))
    sigma_m, in_view = np.ones((epochs, satellites)), np.zeros((epochs, satellites), dtype=bool)
    design[at, satellite] = g.design[at, row]
    sigma_m[at, satellite] = g.sigma_m[at, row]
    in_view[at, satellite] = True
    return Rows(g.names, design, sigma_m, in_view, float(steps[0]), codes_of(g.names, g.systems))


def unit_ramp_m(rows: Rows, satellite: str, onset: int) -> FloatArray:
    """(T, m), the error of a ramp of 1 m/s that begins at the sample ``onset``, where it is zero [m].

    Raises:
        InputError: a satellite that is unknown, or out of view at some sample from the onset on.
    """
    place = rows.names.index(require_choice(satellite, rows.names, field="satellite"))
    seen = rows.in_view[onset:, place]
    if not seen.all():
        raise InputError(
            f"satellite: {satellite} is out of view at {int((~seen).sum())} of the {seen.size} epochs of the ramp; "
            f"nearest: {', '.join(np.array(rows.names)[rows.in_view[onset:].all(axis=0)][:3]) or 'none'}."
        )
    ramp = np.zeros(rows.sigma_m.shape)
    ramp[onset:, place] = rows.interval_s * np.arange(len(seen))
    return ramp


def pass_key(seed: Array, purpose: Array, block: Array) -> Array:
    """The key of one block of passes; passes of another purpose have other noise."""
    key = jax.random.fold_in(epoch_key(seed, jnp.asarray(_PASSES, jnp.uint32)), purpose)
    return jax.random.fold_in(key, block)


def step_numbers(key: Array, time: Array, rows: int, motions: int) -> tuple[Array, Array, Array]:
    """Independent standard normal numbers of one sample: white and slow (rows, LANES), motion (motions, LANES)."""
    numbers = jax.random.normal(jax.random.fold_in(key, time), (2 * rows + motions, LANES), jnp.float64)
    return numbers[:rows], numbers[rows : 2 * rows], numbers[2 * rows :]


def whole_samples(seconds: float, interval_s: float, *, field: str) -> int:
    """How many samples a time is; an `InputError` where it is no whole number of them."""
    ratio = require_number(seconds, field=field) / interval_s
    samples = round(ratio)
    if seconds < 0 or not math.isclose(ratio, samples, abs_tol=1e-6):
        raise InputError(
            f"{field}: a whole number of intervals of {interval_s:g} s is needed, not {seconds:g} s; nearest: "
            f"{max(samples, 1) * interval_s:g} s."
        )
    return samples
