"""The estimators as functions of plain arrays, for one scenario; they compose with jit, vmap and grad."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from pl_mc.input_errors import InputError
from pl_mc.kernels.estimate import Estimate, LeastSquaresSolution, start_from
from pl_mc.kernels.irls_options import IrlsOptions
from pl_mc.kernels.linear_model import LinearModel, linear_model, per_lane
from pl_mc.kernels.reweighting import irls
from pl_mc.kernels.roots import safe_sqrt


def ls(design: ArrayLike, sigma_m: ArrayLike, observed_m: ArrayLike, in_view: ArrayLike | None = None) -> Estimate:
    """Weighted least squares (Zhao et al. 2021, eqs 4, 5 and 16).

    Args:
        design: (n, t), east, north, up and clock columns [m/m].
        sigma_m: (n,), standard deviations [m].
        observed_m: (n,) or (n, lanes), observed minus computed pseudoranges [m].
        in_view: (n,), which rows count; all unless given.
    """
    return _ls(*_prepare(design, sigma_m, observed_m, in_view))


def igg3(
    design: ArrayLike,
    sigma_m: ArrayLike,
    observed_m: ArrayLike,
    in_view: ArrayLike | None = None,
    *,
    options: IrlsOptions = IrlsOptions(),  # noqa: B008 (a frozen record)
) -> Estimate:
    """IGG-III robust estimate (Zhao et al. 2021, eqs 6 and 7), or another reweighted one through ``options``.

    Args:
        design, sigma_m, observed_m, in_view: as for `ls`.
        options: weight function, iteration count and the choices that the paper leaves open.
    """
    return _reweighted(*_prepare(design, sigma_m, observed_m, in_view), options=options)


def least_squares(model: LinearModel, start: LeastSquaresSolution) -> Estimate:
    """The least-squares estimate, from the solution that every method starts with."""
    shape = start.square_sum.shape
    available = jnp.broadcast_to(model.available, shape)
    unit_error = safe_sqrt(start.square_sum / jnp.maximum(model.dof, 1))
    sigma = 1.0 / jnp.where(model.weight_root > 0, model.weight_root, 1.0)
    cofactor = jnp.broadcast_to(per_lane(model.cofactor[:3], start.state), (3, *shape))
    return Estimate(
        state=jnp.where(available, start.state, jnp.inf),
        residuals_m=-start.residuals * per_lane(sigma * model.in_view, start.residuals),
        weights=jnp.ones_like(start.residuals),
        unit_error=jnp.where(available, unit_error, jnp.inf),
        cofactor_m2=jnp.where(available, cofactor, jnp.inf),
        kept=jnp.broadcast_to(jnp.sum(model.in_view), shape),
        change_m=jnp.zeros(shape, start.square_sum.dtype),
        available=available,
        tied=jnp.zeros(shape, bool),
    )


@jax.jit
def _ls(rows: Array, sigma: Array, observed: Array, seen: Array) -> Estimate:
    model = linear_model(rows, sigma, seen)
    return least_squares(model, start_from(model, _in_view(observed, seen)))


@jax.jit
def _reweighted(rows: Array, sigma: Array, observed: Array, seen: Array, *, options: IrlsOptions) -> Estimate:
    model = linear_model(rows, sigma, seen)
    return irls(model, start_from(model, _in_view(observed, seen)), options)


def _in_view(observed: Array, seen: Array) -> Array:
    """Padding may hold anything, NaN included; it must not reach a sum."""
    return jnp.where(per_lane(seen, observed), observed, 0.0)


def _prepare(
    design: ArrayLike, sigma_m: ArrayLike, observed_m: ArrayLike, in_view: ArrayLike | None
) -> tuple[Any, Any, Any, Any]:
    """Arrays of one floating type and of shapes that fit; those of NumPy stay such, for which nothing is compiled."""
    given = [_as_array(one) for one in (design, sigma_m, observed_m)]
    dtype = jnp.result_type(*given, float)
    rows, sigma, observed = (one.astype(dtype) for one in given)
    seen = np.ones(rows.shape[:1], bool) if in_view is None else _as_array(in_view).astype(bool)
    n = rows.shape[:1]
    if rows.ndim != 2 or sigma.shape != n or seen.shape != n or observed.shape[:1] != n or observed.ndim > 2:
        raise InputError(
            "kernel: design (n, t), sigma_m (n,), observed_m (n,) or (n, lanes) and in_view (n,) are needed, not "
            f"{rows.shape}, {sigma.shape}, {observed.shape} and {seen.shape}."
        )
    return rows, sigma, observed, seen


def _as_array(given: ArrayLike) -> Any:
    return given if isinstance(given, Array) else np.asarray(given)
