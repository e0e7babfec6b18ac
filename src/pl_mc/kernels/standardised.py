"""Weights of residuals, which are standardised by the standard deviation and the scale that options name."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.estimate import Iterate
from pl_mc.kernels.irls_options import IrlsOptions
from pl_mc.kernels.linear_model import LinearModel, add_empty, per_lane, product, redundancy_floor
from pl_mc.kernels.parameters import is_off
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.kernels.small_matrix import cholesky, inverse_columns, lower_triangle

# The median absolute value of a standard normal variable is 1 / 1.4826.
MAD_TO_SIGMA = 1.482602218505602


def weights_of(
    model: LinearModel, iterate: Iterate, weights: Array, options: IrlsOptions, scale: Array | None = None
) -> Array:
    """Weight factors from the residuals of an iterate; ``weights`` are those that produced it."""
    return weight_of(options, standardised(model, iterate, weights, options, scale))


def weight_of(options: IrlsOptions, size: Array) -> Array:
    """Weight factors of the sizes of standardised residuals."""
    weights = options.weight(size)
    return weights if is_off(options.weight_floor) else jnp.maximum(weights, options.weight_floor)


def standardised(
    model: LinearModel, iterate: Iterate, weights: Array, options: IrlsOptions, scale: Array | None
) -> Array:
    """(n, ...), sizes of the residuals of an iterate over their standard deviation and scale."""
    size = jnp.abs(iterate.residuals) * _inverse_residual_sigma(model, weights, options)
    scale = _scale(model, iterate, size, options) if scale is None else scale
    # A perfect fit leaves no scale; it is undetermined or exact, and any finite number serves.
    return size * (1.0 / jnp.where(scale > 0, scale, 1.0))[None]


def _scale(model: LinearModel, iterate: Iterate, size: Array, options: IrlsOptions) -> Array:
    if options.scale == "apriori":
        return jnp.ones_like(iterate.square_sum)
    if options.scale.startswith("mad"):
        counted = (model.inverse_residual_sigma > 0) if options.cofactor != "none" else (model.in_view > 0)
        scale = MAD_TO_SIGMA * _median(size, counted)
    else:
        scale = safe_sqrt(iterate.square_sum / jnp.maximum(model.dof, 1))
    return jnp.maximum(scale, 1.0) if options.scale.endswith("floored") else scale


def _median(values: Array, counted: Array) -> Array:
    """Median over the first axis of the rows that count."""
    # Rows that do not count sort to the end.
    ordered = jnp.sort(jnp.where(per_lane(counted, values), values, jnp.inf), axis=0)
    count = jnp.sum(counted)
    low, high = jnp.maximum(count - 1, 0) // 2, jnp.maximum(count // 2, 0)
    return 0.5 * (jnp.take(ordered, low, axis=0) + jnp.take(ordered, high, axis=0))


def _inverse_residual_sigma(model: LinearModel, weights: Array, options: IrlsOptions) -> Array:
    """1 / standard deviation of each whitened residual; zero for a satellite that the others do not check."""
    if options.cofactor == "none":
        return per_lane(model.in_view, weights)
    fault_free = per_lane(model.inverse_residual_sigma, weights)
    if options.cofactor == "fault_free":
        return fault_free
    t = model.design.shape[1]
    factor = cholesky(add_empty(product(model.products[:-1], weights), model.empty), model.pivot_floor)
    columns = inverse_columns(factor)
    inverse = jnp.stack(
        [
            sum(columns[row][k - row] * columns[column][k - column] for k in range(row, t))
            * (1.0 if row == column else 2.0)
            for row, column in lower_triangle(t)
        ]
    )
    variance = 1.0 - product(model.products[:-1].T, inverse)
    usable = (variance > redundancy_floor(variance.dtype)) & (fault_free > 0)
    return jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, variance, 1.0)), fault_free)
