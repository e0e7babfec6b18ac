"""The worst bias on one satellite for the horizontal error of least squares, held to searches over exact rates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import optimize

import pl_mc
from pl_mc.alert import HORIZONTAL, AlertLimits
from pl_mc.faults import Faults
from pl_mc.statistics import ls_rates
from pl_mc.statistics.exact import LeastSquaresLaw

NEAR = AlertLimits("near", horizontal_m=4.0)


@pytest.fixture(scope="module")
def sky() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=1)[0]


def rates_of(g: pl_mc.Geometry, name: str, sizes_m: np.ndarray, alert: AlertLimits, event: str) -> np.ndarray:
    bias = np.zeros((len(sizes_m), len(g.names)))
    bias[:, g.names.index(name)] = sizes_m
    rates = LeastSquaresLaw().rates(g, Faults.from_array(g, bias), alert, "horizontal", exceeded=False)
    return rates[f"{event}_rate"].to_numpy()


@pytest.mark.parametrize("event", ["missed", "misleading"])
@pytest.mark.parametrize("hal_m", [4.0, 10.0])
def test_no_size_is_worse_than_the_worst(sky: pl_mc.Geometry, event: str, hal_m: float) -> None:
    """A dense ramp, and a search from its top, on satellites whose errors move much, little and not at all."""
    alert = AlertLimits("near", horizontal_m=hal_m)
    table = pl_mc.worst_case(sky, satellites=["G19", "G12", "C08"], event=event, alert=alert).set_index("satellites")
    assert set(table.axis) == {HORIZONTAL}
    assert (table.low == table.high).all()
    assert table.probability.is_monotonic_decreasing
    for name, row in table.iterrows():
        # From 1e-4 m on: a size of zero is no fault.
        sizes = np.linspace(1e-4, 40.0, 61)
        values = rates_of(sky, str(name), sizes, alert, event)
        top = int(values.argmax())

        def negative(size_m: float, name: str = str(name)) -> float:
            return -float(np.log(max(rates_of(sky, name, np.array([size_m]), alert, event)[0], 1e-300)))

        bracket = (sizes[max(top - 1, 0)], sizes[min(top + 1, 60)])
        found = optimize.minimize_scalar(negative, bounds=bracket, method="bounded", options={"xatol": 1e-5})
        best = max(float(np.exp(-found.fun)), float(values.max()))
        assert row.probability == pytest.approx(best, rel=2e-5)
        assert row.probability >= best * (1.0 - 1e-6)
        at = rates_of(sky, str(name), np.array([max(row.bias_m, 1e-4)]), alert, event)[0]
        assert at == pytest.approx(row.probability, rel=1e-5)


def test_what_stands_beside_the_worst(sky: pl_mc.Geometry) -> None:
    row = pl_mc.worst_case(sky, satellites=["G19"], event="missed", alert=NEAR).iloc[0]
    fault = pl_mc.biases(sky, {"G19": row.bias_m})
    effects = pl_mc.statistics.fault_effects(sky, fault)
    assert row.horizontal_m == pytest.approx(np.hypot(*effects.horizontal_m[0]))
    assert row.noncentrality == pytest.approx(effects.noncentrality[0])
    exact = ls_rates(sky, fault, alert=NEAR, axis="horizontal").iloc[0]
    assert row.alarm_rate == pytest.approx(exact.alarm_rate)
    grid = rates_of(sky, "G19", np.arange(5.0, 101.0, 5.0), NEAR, "missed")
    assert row.grid_probability == pytest.approx(grid.max())
    assert row.grid_bias_m == 5.0 * (1 + grid.argmax())


def test_a_fault_that_no_residual_shows_and_an_epoch_without_redundancy() -> None:
    """Two satellites of a system of their own: half of a bias on one is a clock error, the rest in one residual."""
    g = pl_mc.simulate(epochs=1)[0]
    alone = [name for name in g.names if name[0] == "C"][:1]
    kept = g.sel(satellite=[name for name in g.names if name[0] == "G"] + alone)
    table = pl_mc.worst_case(kept, satellites=alone, event="missed", alert=NEAR)
    # The only satellite of its clock moves nothing but that clock.
    assert table.bias_m[0] == 0.0
    none = ls_rates(kept, pl_mc.no_fault(kept), alert=NEAR, axis="horizontal").missed_rate[0]
    assert table.probability[0] == pytest.approx(none, rel=1e-9)
    bare = g.sel(satellite=[name for name in g.names if name[0] == "G"][:4])
    table = pl_mc.worst_case(bare, event="missed", alert=NEAR)
    assert (table.probability == 0.0).all()
    assert (table.alarm_rate == 1.0).all()
    assert table.bias_m.isna().all()
    # Nearly so: one satellite more, whose weight is next to nothing, leaves faults of the others unseen.
    five = g.sel(satellite=[name for name in g.names if name[0] == "G"][:5])
    loose = dataclasses.replace(five, sigma_m=five.sigma_m * np.array([1.0, 1.0, 1.0, 1.0, 1e9]))
    hidden = pl_mc.worst_case(loose, satellites=[five.names[0]], event="missed", alert=NEAR).iloc[0]
    assert np.isinf(hidden.bias_m)
    assert hidden.noncentrality == 0.0
    quiet = 1.0 - ls_rates(loose, pl_mc.no_fault(loose), alert=NEAR, axis="horizontal").alarm_rate[0]
    assert hidden.probability == pytest.approx(quiet, rel=1e-9)
