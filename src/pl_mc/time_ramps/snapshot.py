"""One number for every method of a single epoch: how near it is to its alarm.

To compare methods at one false-alarm rate each needs a statistic whose threshold can be moved. Here it is a ratio
that is 1 at the method's nominal alarm:

- methods that alarm by their protection level alone (`ls`, `igg3` and the other M-estimates): VPL / VAL, so that
  another threshold is another multiplier;
- ``slope``, ``parity``: V'PV over its chi-square threshold, the same number for both;
- ``w_test``: the largest |w| over its quantile;
- ``araim``: the largest ratio of a separation and its limit.

Tests decide alone: levels that depend on the geometry alone, and the exclusion of satellites, are left out.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import Array

from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.leave_one_out import all_in_view, standardised
from pl_mc.kernels.linear_model import product
from pl_mc.methods import L1, MM, Araim, GatedIgg3, Ls, MEstimator, Method, Parity, Slope, WTest

LEVEL_METHODS = (Ls, MEstimator, MM, L1)
SNAPSHOT_METHODS = (*LEVEL_METHODS, Slope, Parity, WTest, Araim)


def has_ratio(cls: type) -> bool:
    """Whether a method of that class has a statistic here; one with a test beside its level has two."""
    return issubclass(cls, SNAPSHOT_METHODS) and not issubclass(cls, GatedIgg3)


def alarm_ratio(
    method: Method, model: LinearModel, prepared: Any, start: LeastSquaresSolution, vertical_m: Array
) -> tuple[Array, Array]:
    """The statistic over its nominal threshold and the up error [m], each (lanes,).

    Where there is no solution the ratio is infinite and so is the error.
    """
    up_m, available = start.state[2], jnp.broadcast_to(model.available, start.square_sum.shape)
    if isinstance(method, Slope):
        ratio = start.square_sum / prepared[0]
    elif isinstance(method, Parity):
        ratio = start.square_sum / prepared.threshold
    elif isinstance(method, WTest):
        ratio = jnp.max(standardised(all_in_view(model, prepared, start)), axis=0) / method.quantile
    elif isinstance(method, Araim):
        limit = prepared.limit_m.reshape(-1)
        # Modes that are not monitored have an infinite limit.
        inverse = jnp.where(jnp.isfinite(limit) & (limit > 0), 1.0 / jnp.where(limit > 0, limit, 1.0), 0.0)
        gain = prepared.gain.reshape(limit.shape[0], -1) * inverse[:, None]
        ratio = jnp.max(jnp.abs(product(gain, start.residuals)), axis=0)
        available = available & prepared.available
    else:
        outcome = method.solve(model, prepared, start)
        ratio, up_m, available = outcome.vpl_m / vertical_m, outcome.error_m[2], outcome.available
    return jnp.where(available, ratio, jnp.inf), jnp.where(available, up_m, jnp.inf)
