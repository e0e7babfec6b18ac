"""Satellites that no residual tells apart, and the rule that they have one weight.

Twins are satellites whose least-squares residuals are correlated by 1 or -1: those of a system of two with a clock of
its own, all satellites where one degree of freedom is left. With weights w the residuals V of a weighted solution obey
A'P diag(w) V = 0, from which w_i |V_i| over the fault-free standard deviation of V_i is the same for both, whatever the
errors are. Their standardised residuals are therefore equal at every iterate as long as their weights are, and they
start with equal ones. But where weights fall faster than residuals grow that balance is unstable, and rounding, which
is to say the order of the rows, would decide which of them is thrown out. So it is kept by construction: residuals of
twins are made equal in that sense, from which equal weights follow. Where residuals are not standardised by those
standard deviations this holds for twins for which they are equal, and the others part in every draw alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.roots import safe_sqrt


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Twins:
    """The twins of a geometry; ``same`` stands for those with equal redundancy numbers alone.

    Attributes:
        there: whether there are any.
        rows, rows_same: (n,), whether a satellite is one.
        mean: (n, n), what replaces each whitened residual of least squares by the mean of what it and its twins make
            of it; rows of the unit matrix for all others.
        design, design_same: (n, t), whitened design rows that take residuals of twins to those of the next iterate.
    """

    there: Array
    rows: Array
    rows_same: Array
    mean: Array
    design: Array
    design_same: Array

    def alike(self, residuals: Array) -> Array:
        """(n, ...), residuals of least squares with those of twins made equal but for their standard deviations."""
        mean = self.mean
        return jax.lax.cond(
            self.there, lambda: jnp.matmul(mean, residuals, precision=jax.lax.Precision.HIGHEST), lambda: residuals
        )

    def tied(self, weights: Array, *, same: bool) -> Array:
        """(...), whether twins share a weight below one."""
        rows = (self.rows_same if same else self.rows).reshape((-1,) + (1,) * (weights.ndim - 1))
        return jax.lax.cond(
            self.there, lambda: jnp.any((weights < 1) & rows, axis=0), lambda: jnp.zeros(weights.shape[1:], bool)
        )


def twins_of(design: Array, gain: Array, redundancy: Array, inverse_sigma: Array, rounding: float) -> Twins:
    """The twins.

    Args:
        design: (n, t), whitened; gain: (t, n), N^-1 A' P^(1/2).
        redundancy: (n,); inverse_sigma: (n,), 1 / sqrt(redundancy), zero for a satellite that is not checked.
        rounding: what correlations may lack of 1 where all redundancy numbers are 1; small ones magnify it.
    """
    fit = jnp.matmul(design, gain, precision=jax.lax.Precision.HIGHEST)
    correlation = -fit * inverse_sigma[:, None] * inverse_sigma[None]
    largest = jnp.maximum(inverse_sigma[:, None], inverse_sigma[None])
    one = jnp.eye(fit.shape[0], dtype=fit.dtype)
    pairs = (correlation * correlation >= 1.0 - jnp.minimum(rounding * largest * largest, 0.01)) & (one == 0)
    same = pairs & (jnp.abs(redundancy[:, None] - redundancy[None]) <= rounding)
    ratio = jnp.sign(correlation) * safe_sqrt(redundancy)[:, None] * inverse_sigma[None]

    def mean(chosen: Array) -> Array:
        rows = one + jnp.where(chosen, ratio, 0.0)
        return rows / (1.0 + jnp.sum(chosen, axis=1, dtype=fit.dtype))[:, None]

    def alike(chosen: Array) -> Array:
        return jnp.matmul(mean(chosen), design, precision=jax.lax.Precision.HIGHEST)

    there = jnp.any(pairs)
    return Twins(
        there=there,
        rows=jnp.any(pairs, axis=1),
        rows_same=jnp.any(same, axis=1),
        mean=mean(pairs),
        design=jnp.where(there, alike(pairs), design),
        design_same=jnp.where(there, alike(same), design),
    )
