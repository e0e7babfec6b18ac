"""One number for every method of a single epoch: how near it is to its alarm.

To compare methods at one false-alarm rate each needs a statistic whose threshold can be moved. Here it is a ratio
that is 1 at the method's nominal alarm: its test statistic over the threshold (`pl_mc.methods.capabilities`), of
which exclusions and levels that depend on the geometry alone are no part; else, where the level is a multiple of K,
VPL / VAL, so that another threshold is another multiplier.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import Array

from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.methods import Method
from pl_mc.methods.capabilities import levels_from_geometry, scales_with_k, statistic


def has_ratio(method: object) -> bool:
    """Whether a method has a ratio that errors move."""
    return statistic(method) is not None or (scales_with_k(method) is not None and not levels_from_geometry(method))


def alarm_ratio(
    method: Method, model: LinearModel, prepared: Any, start: LeastSquaresSolution, vertical_m: Array
) -> tuple[Array, Array]:
    """The statistic over its nominal threshold and the up error [m], each (lanes,).

    A test guards the position of least squares, a level the method's own. Where there is no solution the ratio is
    infinite and so is the error; where a test beside a level rejects the ratio alone, an alarm for any multiplier.
    """
    test = statistic(method)
    if test is not None:
        ratio, up_m = test(model, prepared, start), start.state[2]
        available = model.available & jnp.isfinite(ratio)
    else:
        outcome = method.solve(model, prepared, start)
        ratio, up_m, available = outcome.vpl_m / vertical_m, outcome.error_m[2], outcome.available
        ratio = jnp.where(outcome.rejects, jnp.inf, ratio)
    return jnp.where(available, ratio, jnp.inf), jnp.where(available, up_m, jnp.inf)
