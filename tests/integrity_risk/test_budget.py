"""The risk budget: priors by enumeration, clocks, distributions of sizes, a simulation of everything at once."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from pl_mc.alert import LPV_200
from pl_mc.faults import Faults, biases, no_fault, ramps
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.budget.budget import risk_budget
from pl_mc.integrity_risk.modes.fault_modes import Mode, Sizes, fault_modes, not_monitored
from pl_mc.integrity_risk.worst.worst_case import worst_case
from pl_mc.methods import Igg3
from pl_mc.statistics import binomial_p_value, ls_rates
from reference.problems import appendix_d, random_series

ANALYSED = ["fault_free", "satellite", "pair", "constellation", "constellation_and_satellite", "constellations"]


def _one_clock(g: Geometry) -> Geometry:
    design = np.hstack([g.design[:, :3], np.ones((len(g.names), 1))])
    return Geometry.from_arrays(design, g.sigma_m, g.systems, g.names)


# ARAIM ADD v3.0, Appendix D: 12 single modes with P_sat 1e-5 and P_const 1e-4 leave 3.4496e-8 unmonitored, as an
# implementation made elsewhere has it.
def test_published_unmonitored_probability() -> None:
    g = appendix_d()
    modes = fault_modes(g, [1e-5] * 10, {"G": 1e-4, "E": 1e-4})
    only_single = [
        Mode(mode.kind, mode.label, mode.prior, mode.directions, analysed="," not in mode.label) for mode in modes
    ]
    assert not_monitored(only_single, [1e-5] * 10 + [1e-4] * 2) == pytest.approx(3.4496e-8, rel=2e-5)


@settings(max_examples=20)
@given(
    satellites=st.lists(st.floats(0.0, 0.5), min_size=10, max_size=10),
    constellations=st.lists(st.floats(0.0, 0.5), min_size=2, max_size=2),
)
def test_priors_by_enumeration(satellites: list[float], constellations: list[float]) -> None:
    """All 4096 sets of failed sources."""
    g = appendix_d()
    chance = np.array(satellites + constellations)
    names = [*g.names, "GPS", "Galileo"]
    sets = (np.arange(4096)[:, None] >> np.arange(12)) & 1
    exact = np.where(sets, chance, 1 - chance).prod(axis=1)
    modes = fault_modes(g, satellites, {"G": constellations[0], "E": constellations[1]})
    for mode in modes:
        failed = {name for name in mode.label.split(",") if name}
        row = sum(1 << names.index(name) for name in failed)
        assert mode.prior == pytest.approx(exact[row], rel=1e-12)
    rest = exact[sets.sum(axis=1) > 2].sum()
    assert not_monitored(modes, chance.tolist()) == pytest.approx(rest, rel=1e-12, abs=1e-300)


def test_table_adds_up() -> None:
    g = appendix_d(noise=3.0)
    table = risk_budget(g, samples_per_approach=10, target=1e-3)
    assert table["mode"].unique().tolist() == [*ANALYSED, "not_monitored", "total"]
    counts = table["mode"].value_counts()
    assert [counts[mode] for mode in ANALYSED] == [1, 10, 45, 2, 20, 1]
    parts, total = table.iloc[:-1], table.iloc[-1]
    assert parts["prior"].sum() == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(parts["risk_per_sample"], parts["prior"] * parts["probability"])
    np.testing.assert_allclose(table["risk_per_approach"], 10 * table["risk_per_sample"])
    assert total["risk_per_approach"] == pytest.approx(parts["risk_per_approach"].sum())
    assert total["of_target"] == pytest.approx(total["risk_per_approach"] / 1e-3)
    assert table.attrs == {"verdict": "met", "target": 1e-3, "total": total["risk_per_approach"]}
    # The rows are those of the worst case, and of the exact rates without a fault.
    worst = worst_case(g).set_index("satellites")["probability"]
    single = parts[parts["mode"] == "satellite"].set_index("failed")["probability"]
    np.testing.assert_allclose(single, worst[single.index], rtol=1e-12)
    pairs = parts[parts["mode"] == "pair"].set_index("failed")["probability"]
    worst = worst_case(g, satellites=2).set_index("satellites")["probability"]
    np.testing.assert_allclose(pairs, worst[pairs.index], rtol=1e-12)
    clean = ls_rates(g, no_fault(g))["missed_rate"][0]
    assert parts["probability"].iloc[0] == pytest.approx(clean, rel=1e-12)


def test_verdicts() -> None:
    g = appendix_d()
    # Two failed constellations leave nothing: 1e-8 in 25 samples is more than 2e-7.
    assert risk_budget(g).attrs["verdict"] == "not met"
    # Without constellation faults what is left are pairs and triples.
    assert risk_budget(g, p_const=0.0).attrs["verdict"] == "met"
    # Pairs that nobody looked at may or may not be dangerous.
    unseen = risk_budget(g, p_const=0.0, pairs=0, target=1e-8)
    assert unseen.attrs["verdict"] == "not shown"
    assert unseen.iloc[-1]["risk_low"] < 1e-8 < unseen.iloc[-1]["risk_high"]


def test_fewer_pairs_cost_their_prior() -> None:
    g = appendix_d(noise=3.0)
    whole, some = risk_budget(g), risk_budget(g, pairs=5)
    kept = some[some["mode"] == "pair"].set_index("failed")["probability"]
    every = whole[whole["mode"] == "pair"].set_index("failed")["probability"]
    # Equal priors: the largest slopes, and the probability of the worst fault grows with the slope.
    assert set(kept.index) == set(every.nlargest(5).index)
    rest = some[some["mode"] == "not_monitored"]["prior"].iloc[0]
    before = whole[whole["mode"] == "not_monitored"]["prior"].iloc[0]
    gone = whole[(whole["mode"] == "pair") & ~whole["failed"].isin(kept.index)]["prior"].sum()
    assert rest == pytest.approx(before + gone, rel=1e-12)


@pytest.mark.parametrize("event", ["missed", "misleading"])
def test_a_common_bias_is_a_clock_error_where_the_system_has_a_clock(event: str) -> None:
    g = appendix_d(noise=3.0)
    table = risk_budget(g, constellation="common", pairs=0, event=event)  # type: ignore[arg-type]
    clean = table["probability"].iloc[0]
    modes = table[table["mode"].isin(["constellation", "constellations"])]
    np.testing.assert_allclose(modes["probability"], clean, rtol=1e-9)
    # Together with a satellite it adds nothing to that satellite's own fault.
    single = table[table["mode"] == "satellite"].set_index("failed")["probability"]
    mixed = table[table["mode"] == "constellation_and_satellite"]
    np.testing.assert_allclose(
        mixed["probability"], single[[label.split(",")[1] for label in mixed["failed"]]], rtol=1e-7
    )
    # With one clock for both systems it is no clock error, and both together are one again.
    shared = _one_clock(g)
    table = risk_budget(shared, constellation="common", pairs=0, event=event)  # type: ignore[arg-type]
    by_name = table[table["mode"] == "constellation"].set_index("failed")
    clean = table["probability"].iloc[0]
    assert (by_name["probability"] > 1.5 * clean).all()
    both = table[table["mode"] == "constellations"].iloc[0]
    assert both["probability"] == pytest.approx(by_name["probability"].max(), rel=1e-7)
    # The size at which a common bias of all Galileo satellites is worst, by brute force.
    bias = np.outer(np.arange(0.0, 60.0, 0.5), np.array(shared.systems) == "E")
    dense = ls_rates(shared, Faults.from_array(shared, bias))[f"{event}_rate"].max()
    assert by_name.loc["Galileo", "probability"] == pytest.approx(dense, rel=1e-2)


def test_independent_biases_hold_every_fault_of_the_constellation() -> None:
    g = _one_clock(appendix_d(noise=3.0))
    wide = risk_budget(g, constellation="independent").set_index("failed")["probability"]
    narrow = risk_budget(g, constellation="common").set_index("failed")["probability"]
    for name in ("GPS", "Galileo"):
        letter = name[:1] if name == "GPS" else "E"
        inside = [n for n in g.names if n.startswith(letter)]
        assert wide[name] >= max(narrow[name], *(wide[n] for n in inside)) * (1 - 1e-9)
        assert wide[name] >= max(wide[",".join(pair)] for pair in combinations(inside, 2)) * (1 - 1e-9)


@pytest.mark.parametrize("event", ["missed", "misleading"])
def test_a_distribution_of_sizes_is_an_integral(event: str) -> None:
    g = appendix_d(noise=3.0)

    def rate(size: float) -> float:
        return float(ls_rates(g, biases(g, {"G03": size}))[f"{event}_rate"][0])

    table = risk_budget(g, bias=("uniform", 5, 100), event=event, pairs=0, p_const=0.0)  # type: ignore[arg-type]
    integral, _ = integrate.quad(rate, 5, 60, epsrel=1e-8)
    rest = rate(60.0) * 40
    assert rest < 1e-8 * integral
    row = table[table["failed"] == "G03"].iloc[0]
    assert row["probability"] == pytest.approx(integral / 95, rel=1e-7)
    assert row["found"] == "exact"
    # A frozen distribution, and a discrete one.
    table = risk_budget(g, bias=stats.norm(20, 4), event=event, pairs=0, p_const=0.0)  # type: ignore[arg-type]
    integral, _ = integrate.quad(lambda x: rate(x) * stats.norm.pdf(x, 20, 4), -5, 50, epsrel=1e-8)
    assert table[table["failed"] == "G03"]["probability"].iloc[0] == pytest.approx(integral, rel=1e-6)
    table = risk_budget(g, bias=[10.0, 20.0, 30.0], weights=[1, 2, 1], event=event, pairs=0, p_const=0.0)  # type: ignore[arg-type]
    some = ls_rates(g, ramps(g, satellites=["E10"], start_m=10, stop_m=30, step_m=10))[f"{event}_rate"]
    assert table[table["failed"] == "E10"]["probability"].iloc[0] == pytest.approx(some @ [0.25, 0.5, 0.25])


def test_drawn_sizes_of_a_pair_agree_with_the_sum_over_all() -> None:
    g = appendix_d(noise=3.0)
    sizes = np.array([8.0, 16.0, 24.0])
    table = risk_budget(g, bias=sizes, p_const=0.0, pairs=5, draws=2000, seed=4)
    pairs = table[table["mode"] == "pair"].set_index("failed")
    scores = []
    for label in pairs.index:
        at = [g.names.index(name) for name in label.split(",")]
        bias = np.zeros((18, 10))
        bias[:, at] = [(a, sign * b) for a in sizes for b in sizes for sign in (1, -1)]
        truth = ls_rates(g, Faults.from_array(g, bias))["missed_rate"].mean()
        scores.append((pairs.loc[label, "probability"] - truth) / pairs.loc[label, "standard_error"])
    # 2000 draws of 18 values: close to normal; five of them within 5 standard errors (3e-6 in all).
    assert np.abs(scores).max() < 5.0
    assert (pairs["low"] <= pairs["probability"]).all()
    assert (pairs["high"] >= pairs["probability"]).all()
    positive = Sizes.of(sizes, None, "positive").draw((500, 2), np.random.default_rng(1))
    assert (positive > 0).all()


def test_rare_sizes_are_named() -> None:
    table = risk_budget(appendix_d(noise=2.0), bias=("uniform", 5, 100), p_const=0.0, draws=50)
    assert table["warning"].str.contains("of 50 drawn sizes decide the mean").any()


def test_everything_at_once_against_simulation() -> None:
    """Failures, sizes and noise drawn together, position and level from normal equations; frequent faults."""
    g, draws = appendix_d(noise=4.0), 300_000
    table = risk_budget(g, p_sat=0.05, p_const=0.0, bias=("uniform", 5, 40), draws=400, seed=1)
    rng = np.random.default_rng(77)
    failed = rng.random((draws, 10)) < 0.05
    size = rng.uniform(5, 40, (draws, 10)) * rng.choice([-1, 1], (draws, 10))
    error = rng.standard_normal((draws, 10)) * g.sigma_m + failed * size
    weight = 1.0 / g.sigma_m**2
    inverse = np.linalg.inv(g.design.T @ (weight[:, None] * g.design))
    position = error * weight @ g.design @ inverse
    squares = (((position @ g.design.T - error) ** 2) * weight).sum(axis=1)
    level = 5.33 * np.sqrt(squares / 5) * np.sqrt(inverse[2, 2])
    missed = (np.abs(position[:, 2]) > LPV_200.vertical_m) & (level <= LPV_200.vertical_m)
    number = failed.sum(axis=1)
    for kind, many in (("fault_free", 0), ("satellite", 1), ("pair", 2)):
        rows = table[table["mode"] == kind]
        count = int((missed & (number == many)).sum())
        risk, error_of = rows["risk_per_sample"].sum(), float(rows["prior"] @ rows["standard_error"])
        # Three tests at 1e-6 in all; where sizes were drawn the rate itself may be off by five standard errors.
        chance = binomial_p_value(count, draws, [max(risk - 5 * error_of, 0.0), risk, risk + 5 * error_of])
        between = risk - 5 * error_of <= count / draws <= risk + 5 * error_of
        assert between or chance.max() > 1e-6 / 3
    rest = table[table["mode"] == "not_monitored"]["prior"].iloc[0]
    assert binomial_p_value(int((number > 2).sum()), draws, rest) > 1e-6


def test_priors_by_name_and_system() -> None:
    g = appendix_d()
    table = risk_budget(g, p_sat={"G": 1e-5, "E": 3e-5, "G03": 1e-3}, p_const={"G": 0.0, "E": 2e-4}, pairs=0)
    prior = table.set_index("failed")["prior"]
    assert prior["G03"] / prior["G01"] == pytest.approx(1e-3 / (1 - 1e-3) / 1e-5 * (1 - 1e-5))
    assert prior["E07"] / prior["G01"] == pytest.approx(3.0, rel=1e-4)
    assert "GPS" not in prior.index
    assert "Galileo" in prior.index


def test_an_epoch_without_redundancy_has_no_undetected_error() -> None:
    in_view = np.ones((1, 5), dtype=bool)
    g = random_series(np.random.default_rng(3), in_view, "GGGCC")[0]
    table = risk_budget(g, p_const=0.0)
    assert (table["probability"].iloc[:-2] == 0).all()
    assert table["prior"].iloc[:-1].sum() == pytest.approx(1.0)


def _stand_in(g: Geometry):
    def estimate(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
        truth = ls_rates(g, faults)["missed_rate"].to_numpy()
        return pd.DataFrame(
            {
                "probability": truth,
                "standard_error": target_cov * truth,
                "low": 0.8 * truth,
                "high": 1.2 * truth,
                "warning": "",
            }
        )

    return estimate


def test_estimated_budget_agrees_with_the_exact_one() -> None:
    g = appendix_d(noise=3.0)
    exact = risk_budget(g, pairs=3).set_index("failed")
    found = risk_budget(g, pairs=3, method=Igg3(), estimator=_stand_in(g)).set_index("failed")
    rows = exact["mode"].isin(["fault_free", "satellite", "pair"])
    np.testing.assert_allclose(found.loc[rows, "probability"], exact.loc[rows, "probability"], rtol=0.05)
    np.testing.assert_allclose(found.loc[rows, "high"], 1.2 * found.loc[rows, "probability"], rtol=1e-9)
    wide = found["mode"].isin(["constellation", "constellation_and_satellite", "constellations"])
    assert (found.loc[wide, "found"] == "bounded by the prior").all()
    assert found["risk_high"].iloc[-1] >= exact["risk_per_approach"].iloc[-1]
    common = risk_budget(g, pairs=0, constellation="common", estimator=_stand_in(g)).set_index("failed")
    assert common.loc["GPS", "probability"] == common["probability"].iloc[0]
    assert common.loc["GPS,E10", "probability"] == common.loc["E10", "probability"]
    drawn = risk_budget(g, pairs=0, p_const=0.0, bias=("uniform", 5, 100), estimator=_stand_in(g)).set_index("failed")
    full = risk_budget(g, pairs=0, p_const=0.0, bias=("uniform", 5, 100)).set_index("failed")
    # Sixteen sizes instead of four hundred.
    assert drawn.loc["G03", "probability"] == pytest.approx(full.loc["G03", "probability"], rel=0.2)

    def never(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
        return _stand_in(g)(faults, target_cov, seed).assign(probability=np.nan, high=np.nan)

    blind = risk_budget(g, pairs=0, p_const=0.0, estimator=never)
    assert blind["probability"].iloc[0] == 1.0
    assert (blind["probability"].iloc[1:-1] == 1.0).all()
    assert blind["warning"].str.contains("no estimate").sum() == 11


def test_bad_input() -> None:
    g = appendix_d()
    series = random_series(np.random.default_rng(1), np.ones((2, 8), dtype=bool), "GGGGCCCC")
    cases: list[tuple[dict, str]] = [
        ({"g": series}, "geometry: a risk budget is made for one epoch"),
        ({"event": "exceeded"}, "event: 'exceeded' is unknown"),
        ({"p_sat": 1.0}, "p_sat: a prior probability lies between"),
        ({"p_sat": {"G": 1e-5}}, "p_sat: E06 is missing"),
        ({"p_sat": {"G3": 1e-5}}, "p_sat: 'G3' is unknown"),
        ({"ism": {"b_nom_m": 0.5}}, "ism: p_sat: it is needed here, and the ISM has none"),
        ({"ism": {"p_sat": {"G": 1e-5}}}, "ism: p_sat: there is no value for E.. or for its constellation E"),
        ({"ism": {"p_sat": 1e-5}, "p_sat": 1e-4}, "p_sat: the ism has it too; leave one of the two out"),
        ({"ism": {"p_const": 1e-5}, "p_const": 0.0}, "p_const: the ism has it too"),
        ({"p_const": {"X": 1e-5}}, "p_const: 'X' is unknown"),
        ({"p_const": -1e-5}, "p_const: a prior probability"),
        ({"bias": "worse"}, "bias: 'worse' is unknown"),
        ({"bias": ("uniform", 100, 5)}, "bias: 'uniform' takes two sizes in order"),
        ({"bias": ("unifrm", 5, 100)}, "bias: 'unifrm' is unknown"),
        ({"bias": ("norm", 1, 2, 3, 4, 5)}, "bias: norm cannot be made"),
        ({"bias": ("norm", 0, -1)}, "bias: .* are no parameters of norm"),
        ({"bias": [[1.0]]}, "bias: an array of sizes is one row"),
        ({"bias": {"a": 1}}, "bias: 'worst', a distribution"),
        ({"bias": [1.0, 2.0], "weights": [1.0]}, "weights: 2 numbers are needed"),
        ({"weights": [1.0]}, "weights: they belong to an array of sizes"),
        ({"bias": ("uniform", 5, 100), "weights": [1.0]}, "weights: they belong to an array of sizes"),
        ({"bias": [1.0], "signs": "both"}, "signs: 'both' is unknown"),
        ({"constellation": "each"}, "constellation: 'each' is unknown"),
        ({"pairs": "none"}, "pairs: 'none' is unknown"),
        ({"pairs": -1}, "pairs: a whole number"),
        ({"samples_per_approach": 0}, "samples_per_approach: a whole number"),
        ({"target": 0.0}, "target: a positive number"),
        ({"method": Igg3(), "alarm": "chi2"}, "alarm: 'chi2' is for exact laws.*igg3 has no exact_law"),
    ]
    for options, message in cases:
        with pytest.raises(InputError, match=message):
            risk_budget(options.pop("g", g), **options)


def test_priors_of_an_ism():
    """The same budget as with the priors themselves; what the ISM leaves out is the argument's."""
    g = appendix_d()
    priors = {"p_sat": {"G": 1e-5, "E": 3e-5, "G03": 1e-3}, "p_const": {"G": 0.0, "E": 2e-4}}
    expected = risk_budget(g, **priors, pairs=0)
    for ism, rest in ((priors, {}), ({"p_sat": priors["p_sat"]}, {"p_const": priors["p_const"]})):
        found = risk_budget(g, ism=ism, **rest, pairs=0)
        np.testing.assert_array_equal(found.prior, expected.prior)
        assert found.attrs == expected.attrs
