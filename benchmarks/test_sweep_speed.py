"""The whole public sweep, both precisions, beside batched NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import pl_mc
from pl_mc.benchmark.batched_numpy import sweep_numpy
from pl_mc.benchmark.problem import METHODS
from pl_mc.kernels.events import EVENTS
from pl_mc.statistics.intervals import binomial_p_value

DRAWS = 512


def require_plausible(alarms: np.ndarray, hazards: np.ndarray, exact) -> None:
    """Counts of least squares by fault, each tested against its rate in closed form."""
    for seen, event in ((alarms, "alarm"), (hazards, "hazard")):
        # Forty comparisons on noise that is the same every time: 1e-6 each.
        assert (binomial_p_value(seen, DRAWS, exact[f"{event}_rate"].to_numpy()) > 1e-6).all()


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_sweep(benchmark, g, faults, precision):
    options = {"draws": DRAWS, "seed": 1, "methods": METHODS, "precision": precision, "workers": 1, "progress": False}
    table = benchmark(pl_mc.sweep, g, faults, **options)
    benchmark.extra_info["scenarios"] = DRAWS * len(faults)
    ls = table[table.method == "ls"]
    assert len(table) == 2 * len(faults)
    require_plausible(ls.alarms.to_numpy(), ls.hazards.to_numpy(), pl_mc.exact.ls_rates(g, faults))


def test_batched_numpy(benchmark, g, faults):
    limit_m = pl_mc.LPV_200.vertical_m
    counts = benchmark(sweep_numpy, g, faults.bias_m, draws=DRAWS, seed=1, vertical_m=limit_m)
    benchmark.extra_info["scenarios"] = DRAWS * len(faults)
    assert counts.shape == (len(faults), 2, len(EVENTS))
    require_plausible(counts[:, 0, 0], counts[:, 0, 1], pl_mc.exact.ls_rates(g, faults))
