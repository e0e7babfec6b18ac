"""Levels that rest on what was known before: with as many satellites as unknowns they stand, without any test."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.araim import protection_levels
from pl_mc.methods import Sbas, method
from pl_mc.methods.araim import Araim
from reference.problems import random_geometry

# Four satellites of one system, and five of two.
SKIES = [random_geometry(np.random.default_rng(3), counts=counts) for counts in ((4,), (3, 2))]
WIDE = pl_mc.AlertLimits("wide", vertical_m=1e4)
# Priors so small that no fault has to be monitored.
RARE = Araim(p_sat=1e-10, p_const=0.0)


def unmixed(g: pl_mc.Geometry) -> np.ndarray:
    """(t, t), covariance of the one solution that there is, from the inverse of the design itself [m^2]."""
    gain = np.linalg.inv(g.design)
    return gain @ np.diag(g.sigma_m**2) @ gain.T


@pytest.mark.parametrize("g", SKIES, ids=["four", "five"])
def test_levels_of_the_standard_stand(g):
    """VPL = 5.33 d_U, HPL = 6 d_major; errors of the solution are those of the inverse, and nothing is rejected."""
    errors = g.sigma_m * np.linspace(-1.0, 1.5, g.sigma_m.size)
    row = pl_mc.solve(g, errors, methods=(Sbas(),), alert=WIDE).iloc[0]
    covariance = unmixed(g)
    major = np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    assert row.available
    assert not row.alarm
    assert row.vpl_m == pytest.approx(5.33 * np.sqrt(covariance[2, 2]), rel=1e-9)
    assert row.hpl_m == pytest.approx(6.0 * major, rel=1e-9)
    expected = np.linalg.solve(g.design, errors)[:3]
    np.testing.assert_allclose(row[["east_m", "north_m", "up_m"]].astype(float), expected, rtol=1e-8)


@pytest.mark.parametrize("g", SKIES, ids=["four", "five"])
def test_araim_without_a_fault_to_monitor(g):
    """Its fault-free part: 2 Q((VPL - b) / sigma) = P_HMI,V less what is not monitored; with usual priors none."""
    table = pl_mc.solve(g, 0.0 * g.sigma_m, methods=(RARE, Araim()), alert=WIDE).set_index("method")
    covariance, gain = unmixed(g), np.linalg.inv(g.design)
    moving = g.sigma_m.size - sum(g.systems.count(letter) == 1 for letter in set(g.systems))
    share = 9.8e-8 * (1.0 - moving * 1e-10 / 1e-7)
    level = np.abs(gain[2]).sum() * 0.75 + np.sqrt(covariance[2, 2]) * stats.norm.isf(share / 2.0)
    row = table.loc[RARE.name]
    assert row.available
    assert row.vpl_m == pytest.approx(level, rel=1e-6)
    found = protection_levels(
        g.design, g.sigma_m**2, g.sigma_m**2, g.systems, 0.75, 1e-10, dict.fromkeys(g.systems, 0.0)
    )
    assert row.vpl_m == pytest.approx(found.vpl_m, rel=1e-8)
    batched = RARE.batched_levels(g.design[None], g.sigma_m[None], g.in_view[None], np.array([g.systems]))
    assert batched[1][0] == pytest.approx(found.vpl_m, rel=1e-12)
    assert not table.loc["araim"].available


def test_tests_of_residuals_have_no_solution_still():
    """What needs residuals is unavailable there, and a sweep says which levels stand without a test."""
    g = SKIES[0]
    methods = ("ls", "slope", "w_test", "igg3", "sbas", RARE)
    table = pl_mc.sweep(g, pl_mc.no_fault(g), draws=100, seed=1, methods=methods, alert=WIDE).set_index("method")
    assert table.unavailable.tolist() == [100, 100, 100, 100, 0, 0]
    swept = pl_mc.sweep(g, pl_mc.no_fault(g), draws=1, seed=1, methods=methods, alert=WIDE)
    (note,) = swept.attrs["notes"]
    assert note == (
        "The epoch has as many satellites as unknowns: levels of sbas, araim(p_sat=0.0000000001,p_const=0) stand "
        "there, without any test."
    )
    assert pl_mc.sweep(g, pl_mc.no_fault(g), draws=1, seed=1, methods="ls", alert=WIDE).attrs["notes"] == []


def test_a_series_counts_such_epochs():
    """Satellites that set: seven, four and three of them; no test at the second, no position at the third."""
    g = random_geometry(np.random.default_rng(5), counts=(7,))
    seen = np.arange(7) < np.array([[7], [4], [3]])
    series = pl_mc.Geometry.from_rows(
        design=np.stack([g.design] * 3), sigma_m=np.stack([g.sigma_m] * 3), in_view=seen, names=g.names,
        systems=g.systems, clocks=("G",),
    )  # fmt: skip
    table = pl_mc.sweep(
        series, pl_mc.no_fault(series), draws=10, seed=1, methods=("ls", "sbas"), alert=WIDE, by_epoch=True
    )
    assert table.unavailable[table.method == "sbas"].tolist() == [0, 0, 10]
    assert table.unavailable[table.method == "ls"].tolist() == [0, 10, 10]
    assert table.attrs["notes"] == [
        "1 of 3 epochs have as many satellites as unknowns: levels of sbas stand there, without any test."
    ]


def test_risk_without_redundancy():
    """The error passes K d_U with 2 Q(K), whatever the satellites: here 4.55e-2 at K = 2 and 6.3e-5 at K = 4."""
    g = SKIES[0]
    for k in (2.0, 4.0):
        rare = pl_mc.risk(
            g, pl_mc.no_fault(g), event="exceeded", method=method("sbas", k_vertical=k), alert=WIDE, seed=2,
            max_evaluations=500_000,
        )  # fmt: skip
        assert rare.low.iloc[0] <= 2.0 * stats.norm.sf(k) <= rare.high.iloc[0]


def test_no_fault_is_the_worst_there():
    """A search would end nowhere; given sizes have their probabilities, which are those of the shifted error."""
    g = SKIES[0]
    with pytest.raises(pl_mc.InputError, match="a fault of any size goes unseen, and sbas has levels there"):
        pl_mc.worst_case(g, method="sbas", event="misleading", alert=WIDE)
    with pytest.raises(pl_mc.InputError, match=r"geometry: .* \(nearest: an epoch with a satellite more"):
        pl_mc.risk_budget(g, method="sbas", event="misleading", alert=WIDE)
    assert (pl_mc.worst_case(g, method="ls", event="misleading", alert=WIDE).probability == 0).all()
    gain, sigma = np.linalg.inv(g.design)[2], np.sqrt(unmixed(g)[2, 2])
    size = 4.0 * sigma / abs(gain[0])
    fault = pl_mc.biases(g, {g.names[0]: size})
    found = pl_mc.risk(g, fault, event="misleading", method="sbas", alert=WIDE, seed=3, max_evaluations=500_000)
    # The error has a mean of four sigma, and the level is 5.33 of them.
    expected = stats.norm.sf(5.33 - 4.0) + stats.norm.sf(5.33 + 4.0)
    assert found.low.iloc[0] <= expected <= found.high.iloc[0]
