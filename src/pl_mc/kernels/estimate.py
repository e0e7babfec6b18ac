"""What every estimator returns, one solution of an iteration, and least squares, from which every estimator starts."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.linear_model import LinearModel, per_lane, product


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LeastSquaresSolution:
    """The least-squares solution of one scenario or of many (``...``, the lanes).

    Attributes:
        residuals: (n, ...), whitened observations minus whitened fit, (L - A x) / sigma; the paper's V is
            minus sigma times these (eq 5).
        state: (t, ...), least-squares state: east, north, up, clocks [m].
        square_sum: (...), V' P V.
    """

    residuals: Array
    state: Array
    square_sum: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Estimate:
    """One solution, or one per lane; never NaN.

    Where not ``available``, state, unit error, cofactors and change are infinite; residuals, weights and kept are
    those of the last solve, which is none.

    Attributes:
        state: (t, ...), east, north, up, clocks [m].
        residuals_m: (n, ...), V = A x - L [m]; zero on padding.
        weights: (n, ...), equivalent-weight factors w in [0, 1]; one on padding.
        unit_error: (...), a-posteriori standard error of unit weight (Zhao et al. 2021, eqs 16 and 17).
        cofactor_m2: (3, ...), diagonal of (A' P_bar A)^-1 for east, north, up [m^2].
        kept: (...), number of satellites with w > 0.
        change_m: (...), largest change of a position component in the last iteration [m]; zero for least squares.
        available: (...), whether the solution is determined.
        tied: (...), whether twins (`pl_mc.kernels.twins`) share a weight below one: a solution that would throw out one
            of them would not know which.
    """

    state: Array
    residuals_m: Array
    weights: Array
    unit_error: Array
    cofactor_m2: Array
    kept: Array
    change_m: Array
    available: Array
    tied: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Iterate:
    """One solution of the iteration, about the least-squares one.

    Attributes:
        residuals: (n, ...), its whitened residuals, signed as in `LeastSquaresSolution` [sigma].
        shift: t of (...), its state minus that of least squares [m].
        square_sum: (...), V'P_bar V.
        determined: (...), whether this solution and all before it are.
    """

    residuals: Array
    shift: tuple[Array, ...]
    square_sum: Array
    determined: Array


def start_from(model: LinearModel, observed_m: Array) -> LeastSquaresSolution:
    """The least-squares solution of observations (n, ...) [m]."""
    whitened = observed_m * per_lane(model.weight_root, observed_m)
    state = product(model.gain, whitened)
    residuals = whitened - product(model.design, state)
    square_sum = jnp.sum(residuals * residuals, axis=0)
    return LeastSquaresSolution(residuals=model.twins.alike(residuals), state=state, square_sum=square_sum)
