"""Signals in time: pseudorange errors of every satellite from sample to sample, and a ramp on one of them.

Rows are satellites, not places in an epoch: a satellite keeps its row, and with it its correlated error, whoever
else rises or sets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_number, require_within
from pl_mc.ism import codes_of
from pl_mc.kernels.noise import LANES, epoch_key
from pl_mc.noise_models.gauss_markov import GaussMarkov

# Keys of passes lie beyond those of single epochs and of exposures.
_PASSES = 2**31 + 2**29


@dataclass(frozen=True)
class NoiseInTime:
    """Every satellite's error in units of its sigma: code noise and a first-order Gauss-Markov part.

    n_k = sqrt(1 - s) w_k + sqrt(s) u_k, with u stationary and w white, both of unit variance; satellites are
    independent of each other. At a single moment the error has the satellite's sigma, whatever the two are.

    With carrier smoothing w is what a Hatch filter leaves of white code noise. Over N samples, once it has run, its
    error is e_k = (1 - 1/N) e_(k-1) + v_k / N: correlated by 1 - 1/N from sample to sample, of 1 / (2 N - 1) of the
    variance of v. Sigma is that of the smoothed pseudorange, so that the code before has sqrt(2 N - 1) times as
    much noise. What code and carrier share, such as u and a satellite's clock that runs away, passes unchanged.

    Attributes:
        tau_s: correlation time of u [s]; 0 makes it white as well.
        share: s, share of u in the variance, from 0 to 0.999: some white part is left, so that samples tell more
            than one of them does.
        smoothing_s: time constant of the Hatch filter [s]; 0 for code that is not smoothed.
    """

    tau_s: float
    share: float = 0.5
    smoothing_s: float = 0.0

    def __post_init__(self) -> None:
        _ = GaussMarkov(self.tau_s)
        if not 0.0 <= require_number(self.share, field="share") <= 0.999:
            raise InputError(f"share: a share of the variance from 0 to 0.999 is needed, not {self.share!r}.")
        require_within(self.smoothing_s, field="smoothing_s", low=0.0, high=3600.0)

    def correlation(self, interval_s: float) -> float:
        """Of u, from one sample to the next."""
        return GaussMarkov(self.tau_s).correlation(interval_s)

    def code_correlation(self, interval_s: float) -> float:
        """Of w, from one sample to the next."""
        return 1.0 - 1.0 / max(1, whole_samples(self.smoothing_s, interval_s, field="smoothing_s"))

    def parts(self, interval_s: float) -> tuple[Any, ...]:
        """The share that is white, then (correlation, share) of the slow part, and of code noise if it is smoothed."""
        slow, code = (self.correlation(interval_s), self.share), self.code_correlation(interval_s)
        return (0.0, slow, (code, 1.0 - self.share)) if code > 0 else (1.0 - self.share, slow)

    def autocorrelation(self, lags: ArrayLike, interval_s: float) -> FloatArray:
        """(...), of the whole error at lags in samples: 1 at zero, else s phi^|lag| and that of smoothed code."""
        number = np.abs(np.asarray(lags))
        white, *parts = self.parts(interval_s)
        return np.where(number == 0, white, 0.0) + sum(share * correlation**number for correlation, share in parts)


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
