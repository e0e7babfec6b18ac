"""Gaussian mixture: now and then a satellite's error comes from a wider distribution."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jax import Array
from numpy.typing import NDArray
from scipy import special

from pl_mc.input_errors import InputError, require_choice, require_fraction, require_number
from pl_mc.kernels import LinearModel
from pl_mc.noise_models.base import OneNumber, make_floats
from pl_mc.noise_models.quantile_map import QuantileTable, quantile_table, through_table

INFLATED, KEPT = "inflated", "kept"


@dataclass(frozen=True)
class GaussianMixture(OneNumber):
    """A core, and with probability ``chance`` a sigma that is ``scale`` times that of the core.

    Independent between satellites (the contaminated normal of Tukey 1960).

    Attributes:
        chance: probability of the wide part, above 0 and below 1.
        scale: its sigma over that of the core, above 1 and at most 100.
        variance: ``inflated``, the core has the satellite's sigma, so that the standard deviation of all errors is
            more; or ``kept``, the standard deviation is sigma, the core narrower.
    """

    base_name = "gaussian_mixture"

    chance: float = 0.01
    scale: float = 3.0
    variance: str = INFLATED

    def __post_init__(self) -> None:
        require_fraction(self.chance, field="gaussian_mixture: chance")
        if not 1.0 < require_number(self.scale, field="gaussian_mixture: scale") <= 100.0:
            raise InputError(
                f"gaussian_mixture: scale: a number above 1 and at most 100 is needed, not {self.scale!r}."
            )
        require_choice(self.variance, (INFLATED, KEPT), field="gaussian_mixture: variance")
        make_floats(self, "chance", "scale")

    @property
    def core(self) -> float:
        """Standard deviation of the core [sigma]."""
        total = 1.0 - self.chance + self.chance * self.scale**2
        return 1.0 if self.variance == INFLATED else float(total**-0.5)

    def shape(self, model: LinearModel, units: Sequence[Array]) -> Array:
        return through_table(_table(self), units[0])


@functools.lru_cache(maxsize=64)
def _table(noise: GaussianMixture) -> QuantileTable:
    widths = np.array([noise.core, noise.core * noise.scale])[:, None]
    shares = np.log([1.0 - noise.chance, noise.chance])[:, None]

    def log_upper(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return special.logsumexp(shares + special.log_ndtr(-x / widths), axis=0)

    def log_density(x: NDArray[np.float64]) -> NDArray[np.float64]:
        parts = -0.5 * (x / widths) ** 2 - np.log(widths) - 0.5 * np.log(2.0 * np.pi)
        return special.logsumexp(shares + parts, axis=0)

    return quantile_table(log_upper, log_density, low=noise.core, high=noise.core * noise.scale)
