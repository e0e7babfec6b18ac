"""The sweep counts what it says: exact rates of least squares, and, draw by draw, the formulas of the paper.

Statistical tests use fixed seeds and exact binomial tails; the chance that correct code fails any of them was 1e-6
when the seed was chosen.
"""

from __future__ import annotations

import jax
import numpy as np
import pytest

import pl_mc
from pl_mc import AlertLimits
from pl_mc.engine import EVENTS
from pl_mc.kernels.noise import LANES, epoch_key, unit_noise
from pl_mc.methods import Igg3, Ls
from pl_mc.statistics import binomial_p_value
from reference import igg3_numpy as reference
from reference.problems import appendix_d, random_geometry, random_series

FAMILY_WISE_LEVEL = 1e-6
RATES = {
    "alarms": "alarm_rate",
    "hazards": "hazard_rate",
    "missed": "missed_rate",
    "exceeded": "exceeded_rate",
    "misleading": "misleading_rate",
    "false_alarms": "false_alarm_rate",
}


def cases():
    """Skies from one redundant satellite up, and a series, each noisy enough for every event to happen."""
    rng = np.random.default_rng(40)
    in_view = np.ones((3, 9), dtype=bool)
    in_view[1, 2] = in_view[2, 7:] = False
    return {
        "Appendix D": appendix_d(noise=5.0),
        "one system": random_geometry(rng, counts=(6,), noise=4.0),
        "one to spare": random_geometry(rng, counts=(4, 2), noise=3.0),
        "lone satellite": random_geometry(rng, counts=(8, 1), noise=6.0),
        "three systems": random_geometry(rng, counts=(6, 5, 4), noise=8.0),
        "series": random_series(rng, in_view, "GGGGGGCCC", noise=4.0),
    }


CASES = cases()


@pytest.mark.parametrize("name", CASES)
def test_least_squares_has_its_exact_rates(name):
    """Fault-free and under faults of both signs on two satellites and on both at once, every event."""
    g = CASES[name]
    first, last = g.names[0], g.names[-1]
    faults = (
        pl_mc.no_fault(g)
        + pl_mc.ramp(g, satellite=first, start_m=30.0, stop_m=90.0, step_m=30.0)
        + pl_mc.biases(g, {last: -60.0})
        + pl_mc.biases(g, {first: 40.0, last: 40.0})
    )
    table = pl_mc.sweep(g, faults, draws=20_001, seed=41, methods=("ls",), by_epoch=True, progress=False)
    exact = pl_mc.exact.ls_rates(g, faults)
    np.testing.assert_array_equal(table["epoch"], exact["epoch"])
    np.testing.assert_array_equal(table["fault"], exact["fault"])
    tests = len(table) * len(RATES) * len(CASES)
    for count, rate in RATES.items():
        p_values = binomial_p_value(table[count], table["draws"], exact[rate])
        assert p_values.min() > FAMILY_WISE_LEVEL / tests, (count, table.loc[p_values.argmin()])
    # The test has power: exceedance without a fault is no rare event with few satellites to spare.
    assert table["exceeded"].sum() > 0


def draws_of(g, seed: int, draws: int) -> np.ndarray:
    """(n, draws), the errors that the sweep draws for an epoch [m], in the rows in view."""
    blocks = -(-draws // LANES)
    key = epoch_key(np.uint32(seed), np.uint32(g.epoch))
    noise = np.hstack([unit_noise(key, block, g.sigma_m.size, np.float64) for block in range(blocks)])
    return g.sigma_m[:, None] * noise[:, :draws]


def counted(outcomes, limit: float) -> dict[str, int]:
    """Events of reference solutions, by their definitions."""
    total = dict.fromkeys((event.count for event in EVENTS), 0)
    for found in outcomes:
        if not found.available:
            total["alarms"] += 1
            total["unavailable"] += 1
            continue
        error, alarm = abs(found.x[2]), found.vpl_m > limit
        total["alarms"] += alarm
        total["hazards"] += error > limit
        total["missed"] += error > limit and not alarm
        total["exceeded"] += error > found.vpl_m
        total["misleading"] += error > found.vpl_m and not alarm
        total["false_alarms"] += alarm and not error > limit
        total["unconverged"] += found.change_m > 0.01
        total["tied"] += found.tied
    return total


def test_every_draw_is_counted_as_the_formulas_say():
    """The draws are rebuilt and put through the slow reference; every count agrees exactly."""
    in_view = np.ones((3, 9), dtype=bool)
    in_view[1, 3] = False
    in_view[2, 4:8] = False
    g = random_series(np.random.default_rng(42), in_view, "GGGGGGGCC", noise=3.0)
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G01": 50.0}) + pl_mc.biases(g, {"G02": 40.0, "G04": -40.0})
    alert, draws, seed = AlertLimits("test", vertical_m=15.0, horizontal_m=40.0), LANES + 14, 43
    methods = {
        Ls(): reference.least_squares,
        Igg3(iterations=3): lambda *a: reference.igg3(*a, iterations=3),
        Igg3(iterations=3, scale="mad"): lambda *a: reference.igg3(*a, iterations=3, scale="mad"),
    }
    table = pl_mc.sweep(
        g, faults, draws=draws, seed=seed, methods=tuple(methods), alert=alert, by_epoch=True, progress=False
    )
    assert len(table) == len(methods) * (3 + 3 + 2)
    for method, solver in methods.items():
        for epoch in range(3):
            one = g[epoch]
            noise = draws_of(one, seed, draws)
            for k, label in enumerate(faults.labels):
                row = table.query("epoch == @epoch and fault == @label and method == @method.name")
                if not faults.applies(g)[epoch, k]:
                    assert row.empty
                    continue
                bias = faults.bias_m[k][[g.names.index(name) for name in one.names]]
                found = counted(
                    (solver(one.design, one.sigma_m, errors) for errors in (noise + bias[:, None]).T), alert.vertical_m
                )
                assert row[list(found)].iloc[0].to_dict() == found, (method.name, epoch, label)
    # Five satellites for five unknowns at the last epoch.
    assert (table[table["epoch"] == 2]["unavailable"] == draws).all()
    assert table[table["epoch"] != 2]["hazards"].sum() > 0


def test_single_draws_are_those_that_are_counted():
    g = CASES["series"]
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G03": 60.0})
    draws, seed = LANES + 3, 44
    methods = ("ls", Igg3(iterations=2))
    single = pl_mc.sample(g, faults, draws=draws, seed=seed, methods=methods)
    table = pl_mc.sweep(g, faults, draws=draws, seed=seed, methods=methods, by_epoch=True, progress=False)
    assert list(single.columns) == [
        "epoch", "fault", "bias_m", "method", "draw",
        "east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available", "alarm", "unconverged", "tied",
    ]  # fmt: skip
    up, alarm, level = single["up_m"].abs(), single["alarm"], single["vpl_m"]
    single = single.assign(
        alarms=alarm,
        hazards=up > 35,
        missed=(up > 35) & ~alarm,
        exceeded=up > level,
        misleading=(up > level) & ~alarm,
        false_alarms=single["available"] & alarm & ~(up > 35),
        unavailable=~single["available"],
    )
    keys, counts = ["epoch", "method", "fault"], [event.count for event in EVENTS]
    summed = single.groupby(keys)[counts].sum().astype(np.int64)
    np.testing.assert_array_equal(summed, table.set_index(keys)[counts].sort_index())
    assert (single.groupby(keys)["draw"].agg(list).map(lambda drawn: sorted(drawn) == list(range(draws)))).all()

    # Least squares is linear, so the noise can be read off: the same under both faults.
    ls = single[(single["method"] == "ls") & (single["epoch"] == 0)]
    free, faulted = (ls[ls["fault"] == label].sort_values("draw") for label in faults.labels)
    shift = faulted["up_m"].to_numpy() - free["up_m"].to_numpy()
    np.testing.assert_allclose(shift, shift[0], rtol=1e-9)
    one = g[0]
    expected = [reference.least_squares(one.design, one.sigma_m, errors).x[:3] for errors in draws_of(one, seed, 20).T]
    np.testing.assert_allclose(free[["east_m", "north_m", "up_m"]][:20], expected, rtol=0, atol=1e-9)


def test_the_errors_of_a_receiver_are_solved_epoch_by_epoch():
    g = CASES["series"]
    rng = np.random.default_rng(45)
    errors = np.where(g.in_view, g.sigma_m * rng.standard_normal(g.sigma_m.shape), np.nan)
    errors[:, 1] += 50.0
    table = pl_mc.solve(g, errors)
    assert list(table.columns) == [
        "epoch", "time_gps_s", "method", "satellites",
        "east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available", "alarm", "unconverged", "tied",
    ]  # fmt: skip
    assert list(table["method"]) == ["ls", "igg3"] * 3
    for epoch in range(3):
        for name, solver in (("ls", reference.least_squares), ("igg3", reference.igg3)):
            row = table[(table["epoch"] == epoch) & (table["method"] == name)].iloc[0]
            expected = solver(g.design[epoch], g.sigma_m[epoch], errors[epoch], g.in_view[epoch])
            assert row["satellites"] == g.satellite_count[epoch]
            np.testing.assert_allclose(row[["east_m", "north_m", "up_m"]].astype(float), expected.x[:3], atol=1e-8)
            np.testing.assert_allclose([row["vpl_m"], row["hpl_m"]], [expected.vpl_m, expected.hpl_m], rtol=1e-9)
            assert row["alarm"] == (expected.vpl_m > 35)
    alone = pl_mc.solve(g[1], errors[1][g.in_view[1]])
    np.testing.assert_allclose(alone["vpl_m"], table[table["epoch"] == 1]["vpl_m"], rtol=1e-9)


def test_noise_is_standard_normal_and_found_by_its_place():
    key = epoch_key(np.uint32(1), np.uint32(2))
    wide, narrow = (np.asarray(unit_noise(key, 5, rows, np.float64)) for rows in (40, 7))
    np.testing.assert_array_equal(wide[:7], narrow)
    others = [
        unit_noise(epoch_key(np.uint32(1), np.uint32(3)), 5, 7, np.float64),
        unit_noise(epoch_key(np.uint32(2), np.uint32(2)), 5, 7, np.float64),
        unit_noise(key, 6, 7, np.float64),
    ]
    for other in others:
        assert np.all(np.asarray(other) != narrow)
    values = np.concatenate([np.asarray(unit_noise(key, block, 40, np.float64)).ravel() for block in range(10)])
    # Mean and variance within five standard errors.
    assert abs(values.mean()) < 5 / np.sqrt(values.size)
    assert abs(values.var() - 1) < 5 * np.sqrt(2 / values.size)
    assert jax.random.key_impl(key) == "threefry2x32"
