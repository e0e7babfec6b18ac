"""Heavy tails: Student's t, and a core whose errors now and then come from a wider distribution."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jax import Array
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError, require_choice, require_fraction, require_number, require_positive
from pl_mc.kernels import LinearModel
from pl_mc.noise_models.base import OneNumber, make_floats
from pl_mc.noise_models.quantile_map import LARGEST, QuantileTable, quantile_table, through_table

SIGMA, CORE = "sigma", "core"
INFLATED, KEPT = "inflated", "kept"


def _check_share(noise: Any) -> None:
    """Make ``of_sigma`` of a frozen record a float, where it is given."""
    if noise.of_sigma is not None:
        require_positive(noise.of_sigma, field=f"{noise.base_name}: of_sigma")
        make_floats(noise, "of_sigma")


def _shared(noise: Any, errors: Array) -> Array:
    """Errors of a law, in units of the sigma that is believed."""
    return errors if noise.of_sigma is None else errors * noise.of_sigma


@dataclass(frozen=True)
class StudentT(OneNumber):
    """Student's t, independent between satellites, as overbounding studies fit to pseudorange residuals.

    Attributes:
        nu: degrees of freedom; above 2 where the standard deviation is to be sigma, else at least 1.
        match: what sigma stands for: ``sigma``, the standard deviation of the errors; or ``core``, half the width
            of the central 68.27 %, as if it had been read off the errors that are usual.
        of_sigma: by what all errors are multiplied, sigma in truth over the one that is believed; 1 unless given.

    Example:
        >>> import pl_mc
        >>> pl_mc.student_t(nu=5.0).name
        'student_t(nu=5,match=sigma)'
    """

    base_name = "student_t"

    nu: float = 4.0
    match: str = SIGMA
    of_sigma: float | None = None

    def __post_init__(self) -> None:
        require_positive(self.nu, field="student_t: nu")
        require_choice(self.match, (SIGMA, CORE), field="student_t: match")
        if self.match == SIGMA and not self.nu > 2.0:
            raise InputError(
                f"student_t: nu: above 2 is needed for a standard deviation to exist, not {self.nu!r}; with match "
                "'core' 1 and more will do."
            )
        if self.nu < 1.0:
            raise InputError(f"student_t: nu: at least 1 is needed, not {self.nu!r}.")
        make_floats(self, "nu")
        _check_share(self)

    @property
    def unit(self) -> float:
        """What a standard t variable is multiplied by to give errors, in sigma."""
        if self.match == SIGMA:
            return float(np.sqrt((self.nu - 2.0) / self.nu))
        return float(1.0 / -special.stdtrit(self.nu, special.ndtr(-1.0)))

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return _shared(self, through_table(_student_t_table(self), units[0]))


@functools.lru_cache(maxsize=64)
def _student_t_table(noise: StudentT) -> QuantileTable:
    nu, unit = noise.nu, noise.unit
    constant = special.gammaln((nu + 1.0) / 2.0) - special.gammaln(nu / 2.0) - 0.5 * np.log(nu * np.pi)

    def log_upper(x: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            return np.log(special.stdtr(nu, -x / unit))

    def log_density(x: FloatArray) -> FloatArray:
        return constant - (nu + 1.0) / 2.0 * np.log1p((x / unit) ** 2 / nu) - np.log(unit)

    # Quantiles of t are beyond the normal ones on either side, by as much as anything.
    return quantile_table(log_upper, log_density, low=unit, high=LARGEST * 1e6)


@dataclass(frozen=True)
class GaussianMixture(OneNumber):
    """A core, and with probability ``chance`` a sigma that is ``scale`` times that of the core.

    Independent between satellites (the contaminated normal of Tukey 1960).

    Attributes:
        chance: probability of the wide part, above 0 and below 1.
        scale: its sigma over that of the core, above 1 and at most 100.
        variance: ``inflated``, the core has the satellite's sigma, so that the standard deviation of all errors is
            more; or ``kept``, the standard deviation is sigma, the core narrower.
        of_sigma: by what all errors are multiplied, as for `StudentT`.

    Example:
        >>> import pl_mc
        >>> pl_mc.gaussian_mixture(chance=0.1, scale=3.0).name
        'gaussian_mixture(chance=0.1,scale=3,variance=inflated)'
    """

    base_name = "gaussian_mixture"

    chance: float = 0.01
    scale: float = 3.0
    variance: str = INFLATED
    of_sigma: float | None = None

    def __post_init__(self) -> None:
        require_fraction(self.chance, field="gaussian_mixture: chance")
        if not 1.0 < require_number(self.scale, field="gaussian_mixture: scale") <= 100.0:
            raise InputError(
                f"gaussian_mixture: scale: a number above 1 and at most 100 is needed, not {self.scale!r}."
            )
        require_choice(self.variance, (INFLATED, KEPT), field="gaussian_mixture: variance")
        make_floats(self, "chance", "scale")
        _check_share(self)

    @property
    def core(self) -> float:
        """Standard deviation of the core [sigma]."""
        total = 1.0 - self.chance + self.chance * self.scale**2
        return 1.0 if self.variance == INFLATED else float(total**-0.5)

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return _shared(self, through_table(_mixture_table(self), units[0]))


@functools.lru_cache(maxsize=64)
def _mixture_table(noise: GaussianMixture) -> QuantileTable:
    widths = np.array([noise.core, noise.core * noise.scale])[:, None]
    shares = np.log([1.0 - noise.chance, noise.chance])[:, None]

    def log_upper(x: FloatArray) -> FloatArray:
        return special.logsumexp(shares + special.log_ndtr(-x / widths), axis=0)

    def log_density(x: FloatArray) -> FloatArray:
        parts = -0.5 * (x / widths) ** 2 - np.log(widths) - 0.5 * np.log(2.0 * np.pi)
        return special.logsumexp(shares + parts, axis=0)

    return quantile_table(log_upper, log_density, low=noise.core, high=noise.core * noise.scale)
