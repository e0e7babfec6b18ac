"""The covariance of an M-estimate from its influence function, between two factors of the slope of psi.

With psi(u) = u w(u) of the standardised residuals u, the estimate solves sum_i a_i psi_i = 0, a_i the whitened rows of
the design and psi_i = w_i v_i / sigma_i. To first order an error of the observations moves it by its influence
function, W^-1 a_i psi_i with W = sum_i psi'(u_i) a_i a_i'. Huber (1981, Robust Statistics, section 7.6; the third of
his estimates, eq 6.7) has the covariance

    C = 1 / kappa * sum_i psi_i^2 / (n - t) * W^-1 N W^-1,   kappa = 1 + t / n * var(psi') / mean(psi')^2,

mean and variance over the n satellites, kappa his correction of order t / n; weights that are fixed have psi' = w, and
none of this. Where no residual is beyond the bend of the weight function it is the covariance of least squares.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.kernels.linear_model import COORDINATES, LinearModel, add_empty, per_lane, product
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.kernels.small_matrix import cholesky, solve

# Points of the rule for the mean square of psi under a normal law, and how far they reach: to 1e-7 for the kinks of
# the weight functions here.
_POINTS, _REACH = 4096, 10.0


def sandwich(
    model: LinearModel, residuals: Array, size: Array, weight: Callable[[Array], Array], dof: Array
) -> tuple[Array, Array, Array]:
    """Unit-weight error and cofactors of an M-estimate.

    Their product is C of the module. The unit-weight error is that of sigma: the root of sum psi_i^2 / (n - t) over
    what it is expected to be with the sigma of the model and a scale of one, E psi(z)^2, z standard normal.

    Args:
        model: the geometry.
        residuals: (n, ...), whitened residuals of the estimate.
        size: (n, ...), |u|, the same over their standard deviations and scale.
        weight: w(|u|), one at zero.
        dof: (...), the divisor n - t, positive.

    Returns:
        (...), (3, ...) [m^2], and (...) whether W is positive definite: only then is the estimate a minimum of its sum.
    """
    factor, slope = jax.jvp(weight, (size,), (jnp.ones_like(size),))
    slope = factor + size * slope
    psi = factor * residuals
    expected = _expected_square(weight, residuals.dtype)
    unit_error = safe_sqrt(product(model.mask_row, psi * psi)[0] / (dof * expected))
    n = jnp.sum(model.in_view)
    mean = product(model.mask_row, slope)[0] / n
    variance = product(model.mask_row, jnp.square(slope - mean))[0] / n
    # 1 / kappa as mean^2 over (mean^2 + t / n var), which no mean of zero divides by.
    square = jnp.square(mean)
    spread = square + model.unknowns / n * variance
    correction = square / jnp.where(spread > 0, spread, 1.0)
    found = cholesky(add_empty(product(model.products[:-1], slope), model.empty), model.pivot_floor)
    cofactors = []
    for k in range(COORDINATES):
        unit = jnp.zeros((model.design.shape[1],), residuals.dtype).at[k].set(1.0)
        column = jnp.stack(solve(found, list(jnp.broadcast_to(per_lane(unit, psi), (unit.size, *mean.shape)))))
        fitted = product(model.design, column)
        cofactors.append(product(model.mask_row, fitted * fitted)[0])
    return unit_error, jnp.stack(cofactors) * correction * expected, found.regular


def _expected_square(weight: Callable[[Array], Array], dtype: jnp.dtype) -> Array:
    """E psi(z)^2 of a standard normal z."""
    step = _REACH / _POINTS
    points = step * (np.arange(_POINTS) + 0.5)
    density = 2.0 * step * points**2 * np.exp(-0.5 * points**2) / np.sqrt(2.0 * np.pi)
    return jnp.sum(jnp.square(weight(jnp.asarray(points, dtype))) * jnp.asarray(density, dtype))
