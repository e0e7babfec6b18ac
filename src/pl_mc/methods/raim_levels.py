"""What the methods of classical RAIM share: thresholds, protected biases, and protection levels made of slopes.

The slope of satellite i is the position error that a fault of it causes per unit of the square root of the
noncentrality that it gives to V'PV (Parkinson & Axelrad 1988; Brown & Chin, RTCA Paper 491-94/SC159-584, 1994).
With weights, and in units of sigma, it is |G_q,i| / sqrt(r_i) (Walter & Enge 1995), see
`pl_mc.kernels.leave_one_out`. A level is the largest slope times a protected size of the fault, in one of these
forms (T: the chi-square threshold):

- ``noncentral``: sqrt(lambda) with P(noncentral chi-square <= T) = p_md, the parity bias of Brown & Chin: a single
  fault whose mean error is beyond the level goes undetected with probability p_md at the most.
- ``arp``: sqrt(T), the approximate radial error protected: the error where noise is neglected and the statistic
  just meets its threshold.
- ``line``: sqrt(T) + Q^-1(p_md): noise along the fault's own direction in parity space alone. Never smaller than
  ``noncentral``, since |p| is at least its own projection on that line.
- ``noncentral_noise``, ``arp_noise``: the same plus k sigma of the position, k with P(noise beyond k sigma) = p_md;
  the latter is the form of Walter & Enge (1995) but for a k that has both signs and, horizontally, both axes. With
  ``noncentral_noise`` the joint probability of "error beyond the level and not detected" is at most p_md for every
  size of a single fault: where the mean is below the slope's part noise alone would have to be beyond k sigma, and
  where it is above the test finds it.

All but the last two neglect the noise of the position: they bound its mean.
"""

from __future__ import annotations

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.detectors.base import by_count
from pl_mc.input_errors import InputError, require_number
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import major_axis
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.methods.base import Named, Outcome
from pl_mc.statistics.noncentral import split_at_threshold
from pl_mc.statistics.student import chi2_threshold

# An alarm rate of 0.002 an hour and errors that last two minutes (the RAIM criteria of RTCA SC-159: one alarm in
# 15,000 samples, and 0.999 of the faults that matter detected).
P_FA = 1.0 / 15000.0
P_MD = 1e-3

NONCENTRAL, ARP, LINE = "noncentral", "arp", "line"
NONCENTRAL_NOISE, ARP_NOISE = "noncentral_noise", "arp_noise"
FORMS = (NONCENTRAL, ARP, LINE, NONCENTRAL_NOISE, ARP_NOISE)
_WITH_NOISE = (NONCENTRAL_NOISE, ARP_NOISE)

# The other kind of level: a multiple of a standard deviation.
SIGMA = "sigma"


def require_risks(owner: str, **probabilities: float) -> None:
    """Raise `InputError` unless each is between 0 and 1, and p_fa and p_md together below 1.

    A test that misses a fault of size zero with probability 1 - p_fa can keep no larger p_md.
    """
    for field, value in probabilities.items():
        if not 0.0 < require_number(value, field=f"{owner}: {field}") < 1.0:
            raise InputError(f"{owner}: {field}: a number between 0 and 1 is needed, not {value!r}.")
    if {"p_fa", "p_md"} <= probabilities.keys() and probabilities["p_fa"] + probabilities["p_md"] >= 1.0:
        raise InputError(
            f"{owner}: p_md: it lies below 1 - p_fa ({1.0 - probabilities['p_fa']:g}), with which a fault of size "
            f"zero is missed, not {probabilities['p_md']!r}."
        )


@functools.lru_cache(maxsize=64)
def thresholds(most: int, p_fa: float) -> FloatArray:
    """(most + 1,), threshold of V'PV by degrees of freedom; infinite for none."""
    return np.concatenate([[np.inf], chi2_threshold(np.arange(1, most + 1), p_fa)])


@functools.lru_cache(maxsize=64)
def protected_sizes(most: int, p_fa: float, p_md: float, form: str) -> FloatArray:
    """(most + 1,), by degrees of freedom: the size of a fault, sqrt(noncentrality), that multiplies a slope.

    Zero for no degree of freedom, where there is no level.
    """
    dof = np.arange(1, most + 1)
    limit = np.sqrt(chi2_threshold(dof, p_fa))
    # A missed detection needs the projection on the fault's line below the limit.
    line = np.maximum(limit - special.ndtri(p_md), 0.0)
    if form in (ARP, ARP_NOISE):
        sizes = limit
    elif form == LINE:
        sizes = line
    else:
        sizes = np.array([_noncentral_size(k + 1, float(value), p_md) for k, value in enumerate(limit)])
    return np.concatenate([[0.0], sizes])


def _noncentral_size(dof: int, limit: float, p_md: float) -> float:
    """sqrt(lambda) with P(Y <= limit^2) = p_md for Y noncentral chi-square."""
    from scipy import optimize

    def excess(size: float) -> float:
        missed, _ = split_at_threshold(limit**2, float(dof), size**2)
        return float(np.log(missed) - np.log(p_md))

    return float(optimize.brentq(excess, 0.0, limit + abs(special.ndtri(p_md)) + 1.0, xtol=1e-12, rtol=1e-13))


def at_dof(table: FloatArray, dof: Array) -> Array:
    """The entry of a table by degrees of freedom, which may differ from lane to lane."""
    return by_count(table, dof.dtype, jnp.clip(dof, 0, len(table) - 1))


def noise_factors(p_md: float) -> tuple[float, float]:
    """k for the horizontal (along the longest axis, both axes counted) and the vertical noise of the position."""
    return float(np.sqrt(-2.0 * np.log(p_md))), float(-special.ndtri(p_md / 2.0))


def slope_levels(
    slopes_m: Array, covariance_m2: Array, dof: Array, *, most: int, p_fa: float, p_md: float, form: str
) -> ProtectionLevels:
    """Levels of one of `FORMS`.

    Args:
        slopes_m: (2, ...), largest horizontal and vertical slope [m].
        covariance_m2: (4, ...), EE, NN, UU, EN of the position [m^2].
        dof: (...), degrees of freedom.
        most: number of rows, which the degrees of freedom cannot exceed.
        p_fa, p_md, form: what the multiplier is made of.
    """
    size = at_dof(protected_sizes(most, p_fa, p_md, form), dof)
    k_horizontal, k_vertical = noise_factors(p_md) if form in _WITH_NOISE else (0.0, 0.0)
    finite = jnp.isfinite(slopes_m)
    bias = jnp.where(finite, jnp.where(finite, slopes_m, 0.0) * size[None], jnp.inf)
    noise = sigma_levels(covariance_m2, k_horizontal=k_horizontal, k_vertical=k_vertical)
    return ProtectionLevels(hpl_m=bias[0] + noise.hpl_m, vpl_m=bias[1] + noise.vpl_m)


def sigma_levels(covariance_m2: Array, *, k_horizontal: float, k_vertical: float) -> ProtectionLevels:
    """HPL = k_H d_major, VPL = k_V d_U (RTCA DO-229, appendix J); covariance (4, ...): EE, NN, UU, EN [m^2]."""
    return ProtectionLevels(
        hpl_m=k_horizontal * major_axis(covariance_m2), vpl_m=k_vertical * safe_sqrt(covariance_m2[2])
    )


def decided(available: Array, error_m: Array, levels: ProtectionLevels, rejects: Array) -> Outcome:
    """The outcome: where a level is infinite nothing is protected, and there is no solution.

    Args:
        available: (...) or (), whether the model has a solution.
        error_m: (3, ...), of the position [m].
        levels: (...) or ().
        rejects: (...), what the test says.
    """
    shape = rejects.shape
    sound = jnp.broadcast_to(available & jnp.isfinite(levels.hpl_m) & jnp.isfinite(levels.vpl_m), shape)
    return Outcome(
        error_m=jnp.where(sound[None], error_m, jnp.inf),
        hpl_m=jnp.where(sound, levels.hpl_m, jnp.inf),
        vpl_m=jnp.where(sound, levels.vpl_m, jnp.inf),
        available=sound,
        rejects=sound & rejects,
    )


class ChiSquareTested(Named):
    """Least squares whose V'PV is tested against its chi-square threshold, with levels of the geometry alone."""

    p_fa: float

    levels_from_geometry = True

    def _levels(self, model: LinearModel) -> ProtectionLevels:
        raise NotImplementedError

    def prepare(self, model: LinearModel) -> tuple[Array, ProtectionLevels]:
        """Threshold and levels."""
        levels = self._levels(model)
        return at_dof(thresholds(model.design.shape[0], self.p_fa), model.dof), levels

    def statistic(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Array:
        return start.square_sum / prepared[0]

    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        threshold, levels = prepared
        return decided(model.available, start.state[:COORDINATES], levels, start.square_sum > threshold)
