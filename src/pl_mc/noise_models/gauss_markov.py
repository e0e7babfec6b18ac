"""First-order Gauss-Markov errors: Gaussian at every moment, correlated from one moment to the next.

A stationary process with autocorrelation exp(-|dt| / tau) (Brown & Hwang 2012, Introduction to Random Signals and
Applied Kalman Filtering, section 4.5). At a single moment its errors are those of `Gaussian`, and no rate per
sample changes; what changes is how many samples in a row an event takes, see `pl_mc.exposure`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.input_errors import InputError, known_options, require_positive, shown


@known_options("noise gauss_markov")
@dataclass(frozen=True)
class GaussMarkov:
    """The process.

    Attributes:
        tau_s: correlation time [s]; 0 for independent samples, infinite for one error that stays.
    """

    tau_s: float

    def __post_init__(self) -> None:
        sound = isinstance(self.tau_s, int | float | np.number) and not isinstance(self.tau_s, bool)
        # Of a whole number beyond all doubles nothing is left to compute with; single precision ends before 1e300.
        limit = 1e300 if isinstance(self.tau_s, int | float) else 1e30
        if not sound or not (0.0 <= self.tau_s <= limit or self.tau_s == math.inf):
            raise InputError(f"tau_s: a correlation time of at least 0 s is needed, not {shown(self.tau_s)}.")

    def correlation(self, interval_s: float) -> float:
        """Between samples ``interval_s`` apart."""
        require_positive(interval_s, field="interval_s")
        if self.tau_s == 0.0:
            return 0.0
        return 1.0 if math.isinf(self.tau_s) else math.exp(-interval_s / self.tau_s)


def step(before: Array, fresh: Array, correlation: Array) -> Array:
    """The next sample of a process with unit variance, from the last and a fresh standard normal number.

    Started with a standard normal number it is stationary.
    """
    return correlation * before + jnp.sqrt(jnp.maximum(1.0 - correlation * correlation, 0.0)) * fresh
