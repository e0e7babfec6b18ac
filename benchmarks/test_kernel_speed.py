"""The estimators by themselves, on 256 scenarios that are there already."""

from __future__ import annotations

import functools

import jax
import numpy as np
import pytest

from pl_mc import kernels
from pl_mc.benchmark.batched_numpy import both_methods
from pl_mc.benchmark.problem import ROBUST

ESTIMATORS = {"ls": kernels.ls, ROBUST.name: functools.partial(kernels.igg3, options=ROBUST.options)}


@pytest.mark.parametrize(("name", "precision"), [("ls", "float64"), (ROBUST.name, "float64"), (ROBUST.name, "float32")])
def test_estimator(benchmark, g, errors_m, name, precision):
    expected = both_methods(g, errors_m)[name]
    with jax.enable_x64(precision == "float64"):
        arrays = [jax.device_put(a.astype(precision)) for a in (g.design, g.sigma_m, errors_m.T)]
        estimator = ESTIMATORS[name]

        @jax.jit
        def solve(design, sigma_m, observed_m):
            estimate = estimator(design, sigma_m, observed_m)
            return estimate, kernels.protection_levels(estimate).vpl_m

        estimate, vpl_m = benchmark(lambda: jax.block_until_ready(solve(*arrays)))
    benchmark.extra_info["scenarios"] = len(errors_m)
    assert np.asarray(estimate.available).all()
    # Sums of 24 terms whose weights stay in [0, 1], in twelve solutions: a few hundred roundings of what is at most
    # as large as the biggest observation, 100 m.
    bound = 300 * np.finfo(precision).eps * np.abs(errors_m).max()
    np.testing.assert_allclose(vpl_m, expected.vpl_m, rtol=0, atol=bound)
    np.testing.assert_allclose(estimate.state[2], expected.vertical_error_m, rtol=0, atol=bound)
