"""Errors of every noise model in NumPy: densities, and exact tails of weighted sums by characteristic functions.

A weighted sum of independent errors has the product of their characteristic functions, and the probability that it
is beyond a limit follows by one integral (Gil-Pelaez 1951, Biometrika 38:481-482).
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from pl_mc.noise_models import Gaussian, GaussianMixture, Multipath, NoiseModel, NominalBias, StudentT

FloatArray = NDArray[np.float64]


def characteristic(noise: NoiseModel, t: FloatArray, *, sigma_m: float, chance: float | None = None) -> FloatArray:
    """E exp(i t X) of one satellite's error X in units of its sigma; ``chance`` of a delay, if another one."""
    normal = np.exp(-0.5 * t**2)
    if isinstance(noise, Gaussian):
        return normal.astype(complex)
    if isinstance(noise, StudentT):
        # Kotz & Nadarajah 2004, Multivariate t distributions, section 1.9.
        u = np.sqrt(noise.nu) * np.abs(t * noise.unit)
        half = noise.nu / 2.0
        safe = np.where(u > 1e-12, u, 1.0)
        log_value = np.log(special.kve(half, safe)) - safe + half * np.log(safe)
        log_value -= special.gammaln(half) + (half - 1.0) * np.log(2.0)
        return np.where(u > 1e-12, np.exp(log_value), 1.0).astype(complex)
    if isinstance(noise, GaussianMixture):
        core, wide = noise.core, noise.core * noise.scale
        parts = (1 - noise.chance) * np.exp(-0.5 * (core * t) ** 2) + noise.chance * np.exp(-0.5 * (wide * t) ** 2)
        return parts.astype(complex)
    if isinstance(noise, Multipath):
        p = noise.chance if chance is None else chance
        a = noise.size / (sigma_m if noise.unit == "m" else 1.0)
        if noise.law == "exponential":
            delay = 1.0 / (1.0 - 1j * a * t)
        else:
            safe = np.where(t == 0, 1.0, t)
            delay = np.where(t == 0, 1.0, np.expm1(1j * a * safe) / (1j * a * safe))
        return normal * (1 - p + p * delay)
    assert isinstance(noise, NominalBias)
    assert noise.sign == "random"
    return (normal * np.cos(noise.bias_m / sigma_m * t)).astype(complex)


def tail_of_sum(noise: NoiseModel, weights: FloatArray, sigma_m: FloatArray, limit: float, shift: float = 0.0) -> float:
    """P(|sum w_i X_i + shift| > limit), X_i in units of sigma; absolute accuracy about 1e-12."""

    def beyond(level: float, sign: float) -> float:
        """P(sign * sum > level)."""
        # As far as the product of the functions counts.
        last = 40.0 / np.sqrt((weights**2).sum())
        t, rule = special.roots_legendre(64)
        edges = np.linspace(0.0, last, 400)
        width = np.diff(edges)[:, None] / 2.0
        nodes = (edges[:-1, None] + width * (t + 1.0)).ravel()
        mass = (width * rule).ravel()
        product = np.ones(nodes.size, dtype=complex)
        for weight, sigma in zip(weights, sigma_m, strict=True):
            product = product * characteristic(noise, sign * weight * nodes, sigma_m=float(sigma))
        return float(0.5 + (mass * (np.exp(-1j * nodes * level) * product).imag / nodes).sum() / np.pi)

    return beyond(limit - shift, 1.0) + beyond(limit + shift, -1.0)


def mixture_tail(noise: GaussianMixture, weights: FloatArray, limit: float, shift: float = 0.0) -> float:
    """The same for a Gaussian mixture, by the sum over which satellites have the wide error; exact to rounding."""
    square = (noise.core * weights) ** 2
    total = 0.0
    for wide in itertools.product((False, True), repeat=weights.size):
        which = np.array(wide)
        chance = noise.chance ** which.sum() * (1 - noise.chance) ** (~which).sum()
        spread = np.sqrt(square[~which].sum() + noise.scale**2 * square[which].sum())
        total += chance * (stats.norm.sf((limit - shift) / spread) + stats.norm.sf((limit + shift) / spread))
    return float(total)
