"""Student's t: heavy tails with one parameter, as overbounding studies fit to pseudorange residuals."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jax import Array
from numpy.typing import NDArray
from scipy import special

from pl_mc.input_errors import InputError, require_choice, require_positive
from pl_mc.kernels import LinearModel
from pl_mc.noise_models.base import OneNumber, make_floats
from pl_mc.noise_models.quantile_map import LARGEST, QuantileTable, quantile_table, through_table

SIGMA, CORE = "sigma", "core"


@dataclass(frozen=True)
class StudentT(OneNumber):
    """Student's t, independent between satellites.

    Attributes:
        nu: degrees of freedom; above 2 where the standard deviation is to be sigma, else at least 1.
        match: what sigma stands for: ``sigma``, the standard deviation of the errors; or ``core``, half the width
            of the central 68.27 %, as if it had been read off the errors that are usual.
    """

    base_name = "student_t"

    nu: float = 4.0
    match: str = SIGMA

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

    @property
    def unit(self) -> float:
        """What a standard t variable is multiplied by to give errors, in sigma."""
        if self.match == SIGMA:
            return float(np.sqrt((self.nu - 2.0) / self.nu))
        return float(1.0 / -special.stdtrit(self.nu, special.ndtr(-1.0)))

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return through_table(_table(self), units[0])


@functools.lru_cache(maxsize=64)
def _table(noise: StudentT) -> QuantileTable:
    nu, unit = noise.nu, noise.unit
    constant = special.gammaln((nu + 1.0) / 2.0) - special.gammaln(nu / 2.0) - 0.5 * np.log(nu * np.pi)

    def log_upper(x: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(divide="ignore"):
            return np.log(special.stdtr(nu, -x / unit))

    def log_density(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return constant - (nu + 1.0) / 2.0 * np.log1p((x / unit) ** 2 / nu) - np.log(unit)

    # Quantiles of t are beyond the normal ones on either side, by as much as anything.
    return quantile_table(log_upper, log_density, low=unit, high=LARGEST * 1e6)
