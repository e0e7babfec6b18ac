"""Levels judged given the residuals: against exact laws, plain counts, and what a budget has to add up to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.alert import LPV_200
from pl_mc.faults import Faults
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import LevelRisk
from pl_mc.integrity_risk.given_residuals.draws import EpochParts, draw, length_beyond_level
from pl_mc.integrity_risk.k_factor.calibrated import exact_rates
from pl_mc.methods import Igg3, Ls, method
from pl_mc.methods.capabilities import with_k
from pl_mc.methods.registry import METHODS
from pl_mc.statistics.length import length_beyond
from reference.problems import random_series

pytestmark = pytest.mark.counting

G = random_series(np.random.default_rng(5), np.ones((1, 14), bool), "GGGGGGGEEEEEEE", noise=1.0)[0]
FEW = 2048


def test_tails_of_one_and_two_components() -> None:
    rng = np.random.default_rng(0)
    limit, mean = rng.uniform(0.2, 7.0, 400), rng.normal(0.0, 2.0, (400, 2))
    expected = stats.norm.sf(limit, mean[:, 0], 1.5) + stats.norm.cdf(-limit, mean[:, 0], 1.5)
    found = length_beyond_level(mean[:, :1], limit, np.array([[2.25]]))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    for ratio in (0.05, 0.4, 1.0):
        exact = length_beyond(limit, ratio, mean[:, 0], mean[:, 1])[1]
        turned = length_beyond_level(2.0 * mean @ turn.T, 2.0 * limit, 4.0 * turn @ np.diag([1.0, ratio**2]) @ turn.T)
        np.testing.assert_allclose(turned[exact > 1e-11], exact[exact > 1e-11], rtol=1e-6)
        assert (turned[exact < 1e-13] <= 1e-12).all()


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_least_squares_has_its_exact_rates(axis) -> None:
    """Under no fault, a small and a large one, at several multipliers: within five standard errors."""
    parts = EpochParts.of(G, axis)
    bias_m = np.zeros((3, parts.in_view.size))
    bias_m[1, 2], bias_m[2, 7] = 4.0, -15.0
    noise = np.random.default_rng(2).standard_normal((4 * FEW, parts.in_view.size))
    drawn = draw(parts, Ls(), bias_m, noise)
    faults = Faults.from_array(G, bias_m[:, : len(G.names)])
    compared = 0
    for k in (0.5, 2.0, 4.0):
        chance = drawn.beyond(k / getattr(Ls(), f"k_{axis}"))
        expected = exact_rates(G, faults, Ls(), LPV_200, k, axis, "exceeded")
        error = chance.std(axis=1, ddof=1) / np.sqrt(chance.shape[1])
        # Where few draws carry the mean its error is not known.
        known = chance.sum(axis=1) ** 2 > 50 * (chance**2).sum(axis=1)
        assert (np.abs(chance.mean(axis=1) - expected) < 5 * error)[known].all()
        compared += int(known.sum())
    assert compared >= 5


def test_rare_events_of_least_squares() -> None:
    """The weighted draws of the fault-free case, down to 1e-9: Student's law, within five standard errors."""
    risk = LevelRisk(G, with_k(Ls(), 1.0), RiskBudget(), "vertical", draws=FEW, seed=1)
    for target in (1e-3, 1e-6, 1e-8):
        k = stats.t.isf(target / 2, risk.parts.dof)
        chance = risk.free.beyond(k)[0]
        error = chance.std(ddof=1) / np.sqrt(chance.size)
        assert abs(chance.mean() - target) < 5 * error
        assert error < 0.2 * target


@pytest.mark.quick
@pytest.mark.parametrize("name", sorted(METHODS))
def test_every_method_follows_a_shift_of_its_observations(name) -> None:
    """What all of this rests on: a shift along the model moves position and nothing else."""
    one = method(name, **({"p_const": 0.0} if name in ("araim", "separated") else {}))
    if "iterations" in getattr(one, "__dataclass_fields__", {}):
        one = method(name, iterations=4)
    parts = EpochParts.of(G, "vertical")
    noise = np.random.default_rng(7).standard_normal((512, parts.in_view.size)) * 2.0
    shift = np.array([3.0, -5.0, 7.0, 11.0, -2.0])  # East, north, up and two clocks [m].
    moved = noise + np.where(parts.in_view, parts.design @ shift / parts.sigma_m, 0.0)
    before, after = (draw(parts, one, np.zeros((1, parts.in_view.size)), each) for each in (noise, moved))
    np.testing.assert_array_equal(before.silent, after.silent)
    kept = before.silent & (np.abs(before.level_m - after.level_m) < 1e-6 * before.level_m)
    # A satellite on the edge of a decision may fall to either side by rounding.
    assert kept.sum() >= before.silent.sum() - 1
    np.testing.assert_allclose(before.mean_m[kept], after.mean_m[kept], atol=1e-5)


def test_a_robust_estimate_agrees_with_counts() -> None:
    """IGG-III under a fault: conditional probabilities against events counted in draws of their own."""
    one = Igg3(iterations=6, level_scale="floored")
    parts = EpochParts.of(G, "vertical")
    bias_m = np.zeros((1, parts.in_view.size))
    bias_m[0, 3] = 6.0
    noise = np.random.default_rng(11).standard_normal((8 * FEW, parts.in_view.size))
    chance = draw(parts, one, bias_m, noise).beyond(0.5)[0]
    table = pl_mc.sample(
        G, Faults.from_array(G, bias_m[:, : len(G.names)]), draws=100_000, seed=3, methods=(one,),
        alert=pl_mc.AlertLimits("none", vertical_m=1e6),
    )  # fmt: skip
    events = int((table["up_m"].abs() > 0.5 * table["vpl_m"]).sum())
    expected, error = 1e5 * chance.mean(), 1e5 * chance.std() / np.sqrt(chance.size)
    assert events > 100
    assert abs(events - expected) < 4 * np.hypot(error, np.sqrt(expected))


def test_calibrated_least_squares_adds_up() -> None:
    table = pl_mc.calibrate(G, method="ls", budget=RiskBudget(), draws=FEW, max_evaluations=400_000)
    row = table.iloc[0]
    pairs = 91 * 1e-10
    np.testing.assert_allclose(row["contribution_pairs"], pairs, rtol=1e-3)
    np.testing.assert_allclose(row["contribution_lost"], 364 * 1e-15, rtol=1e-2)
    np.testing.assert_allclose(row["allowed"], 9.8e-8 * (1 - pairs / 1e-7), rtol=1e-4)
    np.testing.assert_allclose(row["contribution_fault_free"] + row["contribution_single"], row["allowed"], rtol=2e-3)
    # A posterior level shrinks where residuals do, which no fault makes likelier: without one it is Student's.
    exact = stats.t.isf(0.5 * row["contribution_fault_free"], 9)
    assert row["k_low"] * 0.97 < exact < row["k_high"] * 1.03
    assert row["check_fault_free_low"] < row["contribution_fault_free"] * 1.3
    assert row["check_worst_low"] <= row["worst_probability"] <= row["check_worst_high"]
    assert row["warning"] == ""


def test_single_faults_are_the_worst_of_their_sizes() -> None:
    """Least squares, whose worst size is known exactly: no size that was tried is worse, and it is met to a tenth."""
    risk = LevelRisk(G, with_k(Ls(), 1.0), RiskBudget(), "vertical", draws=8 * FEW, seed=4)
    k = 6.0
    found = risk.at(k)
    sizes = np.geomspace(0.1, 60.0, 120)
    worst = 0.0
    for row in range(len(G.names)):
        bias_m = np.zeros((sizes.size, len(G.names)))
        bias_m[:, row] = sizes
        rates = exact_rates(G, Faults.from_array(G, bias_m), Ls(), LPV_200, k, "vertical", "exceeded")
        worst += 1e-5 * float(rates.max())
    np.testing.assert_allclose(found.single, worst, rtol=0.1)


def test_a_level_that_no_fault_moves_has_no_multiplier() -> None:
    """Least squares with a-priori levels and no test; with the chi-square test there is one."""
    table = pl_mc.calibrate(G, method=Ls(level_scale="apriori"), budget=RiskBudget(), draws=FEW)
    assert np.isinf(table["k_vertical"][0])
    assert "without bounds" in table["warning"][0]
    tested = pl_mc.calibrate(
        G, method=method("parity", form="sigma"), budget=RiskBudget(), draws=FEW, max_evaluations=400_000
    )
    assert np.isfinite(tested["k_low"][0])


def test_few_degrees_of_freedom_need_a_large_multiplier_and_have_one() -> None:
    """Student's quantile with two of them is in the thousands."""
    few = random_series(np.random.default_rng(5), np.ones((1, 7), bool), "GGGGEEE", noise=1.0)[0]
    row = pl_mc.calibrate(few, method="ls", budget=RiskBudget(), draws=8 * FEW, max_evaluations=400_000).iloc[0]
    exact = stats.t.isf(0.5 * row["contribution_fault_free"], 2)
    assert exact > 1000
    assert row["k_low"] * 0.9 < exact < row["k_high"] * 1.1 or row["warning"]


def test_a_satellite_alone_with_its_clock_harms_nothing() -> None:
    """Its fault is its clock's; one that moves the position and is checked by none is never found."""
    alone = random_series(np.random.default_rng(5), np.ones((1, 9), bool), "GGGGGGGGE", noise=1.0)[0]
    row = pl_mc.level_risk(alone, method="huber", draws=1024).iloc[0]
    assert row["contribution_single"] < 1e-6
    assert row["worst_fault"][:3] != "E01"


def test_budgets() -> None:
    shares = RiskBudget(p_sat={"G": 1e-5, "E": 3e-5}, p_const={"G": 1e-8, "E": 0.0}).shared(G)
    np.testing.assert_allclose(shares.single[[0, 13]], [1e-5, 3e-5], rtol=1e-3)
    np.testing.assert_allclose(shares.pairs, (21 * 1 + 21 * 9 + 49 * 3) * 1e-10, rtol=1e-3)
    np.testing.assert_allclose(shares.other, 1e-8, rtol=1e-2)
    assert RiskBudget().on("horizontal") == 2e-9
    assert RiskBudget(target=9.9e-8).on("horizontal") == 9.9e-8
    table = pl_mc.level_risk(G, method="ls", budget={"b_nom_m": 0.5}, draws=1024)
    plain = pl_mc.level_risk(G, method="ls", draws=1024)
    assert table["contribution_fault_free"][0] > 1.05 * plain["contribution_fault_free"][0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"budget": RiskBudget(), "target": 1e-7}, "target: a budget says the target"),
        ({"budget": RiskBudget(), "event": "misleading"}, "event: a budget says"),
        ({"budget": RiskBudget(), "pooled": True}, "pooled: a budget says"),
        ({"budget": {"targt": 1e-7}}, "budget: 'targt' is unknown"),
        ({"budget": 3}, "budget: pl_mc.RiskBudget(target=9.8e-8)"),
        ({"budget": {"b_nom_m": -1}}, "budget: b_nom_m: from 0 to 100 m"),
        ({"budget": {"target": 1e-3}}, "budget: target: the risk of one axis, 0.001, is no more than that of both"),
        ({"budget": {"p_sat": 2.0}}, "p_sat: a prior probability lies between 0 and 1"),
        ({"budget": {"p_const": 1e-4}}, "nothing is left"),
        ({"budget": RiskBudget(), "axis": "either"}, "axis: a budget belongs to one level"),
        ({"budget": RiskBudget(), "draws": 10}, "draws"),
        ({"budget": RiskBudget(), "method": "araim"}, "araim has no scales_with_k"),
    ],
)
def test_refusals(options, words) -> None:
    with pytest.raises(pl_mc.InputError) as caught:
        pl_mc.calibrate(G, **({"method": "ls"} | options))
    assert words in str(caught.value)


def test_the_same_seed_gives_the_same_numbers() -> None:
    first, again, other = (pl_mc.level_risk(G, method="ls", draws=1024, seed=seed) for seed in (9, 9, 10))
    assert first.equals(again)
    assert not first.equals(other)


def test_priors_of_zero_leave_the_fault_free_case() -> None:
    row = pl_mc.level_risk(G, method="ls", budget={"p_sat": 0.0}, draws=1024).iloc[0]
    assert row["contribution_single"] == row["contribution_pairs"] == row["contribution_lost"] == 0.0
    assert row["risk"] == row["contribution_fault_free"] > 0.0
