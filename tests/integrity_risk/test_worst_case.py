"""The worst fault: outside numbers, brute force, invariances, simulation, and the search by estimates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from pl_mc.alert import AlertLimits
from pl_mc.engine import sweep
from pl_mc.faults import Faults, biases, no_fault, ramps
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.worst.ls_exact import event_probability, ls_epoch, peaks, upper_bound, worst_direction
from pl_mc.integrity_risk.worst.worst_case import exact_worst, worst_case
from pl_mc.methods import Igg3, Ls
from pl_mc.statistics import binomial_p_value, ls_rates
from reference.problems import appendix_d, random_counts, random_geometry, random_series

# Draws are many here, and compilations few.
pytestmark = pytest.mark.counting

LIMITS = AlertLimits("test", vertical_m=35.0, horizontal_m=40.0)


def _limits(vertical_m: float) -> AlertLimits:
    return AlertLimits("test", vertical_m=vertical_m, horizontal_m=40.0)


# ARAIM ADD v3.0 Appendix D geometry, W = 1/C_int, noise three times as large, chi-square alarm at 1e-3, VAL 35 m;
# exact computation made elsewhere.
def test_published_worst_biases() -> None:
    table = worst_case(appendix_d(noise=3.0), alarm="chi2", p_fa=1e-3, alert=LIMITS).set_index("satellites")
    assert table.index[0] == "G03"
    assert table.loc["G03", "bias_m"] == pytest.approx(26.9616, abs=1e-4)
    assert table.loc["G03", "probability"] == pytest.approx(1.193302e-2, rel=2e-7)
    assert table.loc["G03", "alarm_rate"] == pytest.approx(0.897381, abs=2e-6)
    assert table.loc["E10", "bias_m"] == pytest.approx(30.5908, abs=1e-4)
    assert table.loc["E10", "probability"] == pytest.approx(3.146292e-5, rel=2e-7)
    # The step from 25 to 30 m leaves the peak out.
    assert table.loc["G03", "grid_bias_m"] == 25.0
    assert table.loc["G03", "grid_probability"] == pytest.approx(1.0556e-2, rel=1e-4)


@pytest.mark.parametrize("event", ["missed", "misleading"])
@pytest.mark.parametrize("alarm", ["pl", "chi2"])
def test_a_dense_grid_finds_nothing_worse(event: str, alarm: str) -> None:
    g = appendix_d(noise=3.0)
    table = worst_case(g, event=event, alarm=alarm).set_index("satellites")  # type: ignore[arg-type]
    dense = ls_rates(g, ramps(g, satellites=g.names, start_m=0.0, stop_m=60.0, step_m=0.5), alarm=alarm)  # type: ignore[arg-type]
    rate = dense[f"{event}_rate"].to_numpy().reshape(len(g.names), -1)
    top = table.loc[list(g.names), "probability"].to_numpy()
    assert (rate.max(axis=1) <= top * (1 + 1e-9)).all()
    # Half a step from the top a probability has lost at most what its curvature there allows, 1 % here.
    np.testing.assert_allclose(rate.max(axis=1), top, rtol=1e-2)
    # The usual grid is every tenth size, without zero.
    np.testing.assert_allclose(rate[:, 10::10].max(axis=1), table.loc[list(g.names), "grid_probability"], rtol=1e-9)
    # What the table says of its own fault is what the exact rates say of it.
    for name, row in table.iterrows():
        got = ls_rates(g, biases(g, {str(name): row["bias_m"]}), alarm=alarm).iloc[0]  # type: ignore[arg-type]
        assert got[f"{event}_rate"] == pytest.approx(row["probability"], rel=1e-8)
        assert got["alarm_rate"] == pytest.approx(row["alarm_rate"], rel=1e-7, abs=1e-14)


def test_several_peaks_are_told_apart() -> None:
    """With little redundancy the error passes VAL far before an alarm, or long after the fault-free peak."""
    g = appendix_d(noise=1.0)
    epoch = dataclasses.replace(
        ls_epoch(g, Ls(), alarm="pl", p_fa=1e-3, alert=LIMITS), threshold=30.0**2, limit=4.0, level_slope=3.0
    )
    roots = np.linspace(0.0, 70.0, 4201)
    for slope in (0.01, 0.3, 1.0, 3.0, 40.0, 3000.0):
        direction = np.zeros((10, 1))
        direction[2] = 1.0
        for event in ("missed", "misleading"):
            step = 1 if event == "missed" else 40
            dense = event_probability(epoch, event, slope * roots[::step], roots[::step]).max()
            _, found = peaks(epoch, event, [slope])
            assert found[0] >= dense * (1 - 1e-9)
            assert found[0] <= dense * 1.02


@pytest.mark.parametrize("event", ["missed", "misleading"])
def test_pairs_against_a_search_in_both_biases(event: str) -> None:
    g = appendix_d(noise=3.0)
    table = worst_case(g, event=event, satellites=[("G03", "E08"), ("G02", "E10")])  # type: ignore[arg-type]
    for row in table.itertuples():
        names = row.satellites.split(",")

        def rate(pair: np.ndarray, names: list[str] = names) -> np.ndarray:
            bias = np.zeros((len(pair), len(g.names)))
            bias[:, [g.names.index(name) for name in names]] = pair
            return ls_rates(g, Faults.from_array(g, bias))[f"{event}_rate"].to_numpy()

        grid = np.array([(a, b) for a in np.arange(0.0, 51.0, 3.0) for b in np.arange(-51.0, 51.0, 3.0)])
        values = rate(grid)
        climbed = optimize.minimize(
            lambda x: -np.log(max(rate(x[None])[0], 1e-300)), grid[values.argmax()], method="Nelder-Mead"
        )
        assert values.max() <= row.probability * (1 + 1e-9)
        assert np.exp(-climbed.fun) == pytest.approx(row.probability, rel=1e-5)
        np.testing.assert_allclose(climbed.x * np.sign(climbed.x[0]), [row.bias_1_m, row.bias_2_m], atol=0.02)
        assert row.bias_1_m > 0


def test_the_grid_of_pairs_is_searched_whole() -> None:
    g = appendix_d(noise=3.0)
    row = worst_case(g, satellites=[("G03", "E10")], alarm="chi2").iloc[0]
    sizes = np.arange(5.0, 101.0, 5.0)
    bias = np.zeros((800, 10))
    bias[:, [2, 9]] = [(a, sign * b) for a in sizes for b in sizes for sign in (1, -1)]
    rate = ls_rates(g, Faults.from_array(g, bias), alarm="chi2")["missed_rate"]
    assert row["grid_probability"] == pytest.approx(rate.max(), rel=1e-9)
    assert [row["grid_bias_1_m"], row["grid_bias_2_m"]] == bias[rate.argmax(), [2, 9]].tolist()


_SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=15)
@given(seed=_SEEDS, noise=st.floats(1.0, 8.0), event=st.sampled_from(["missed", "misleading"]))
def test_no_fault_of_the_kind_is_worse(seed: int, noise: float, event: str) -> None:
    rng = np.random.default_rng(seed)
    g = random_geometry(rng, counts=random_counts(rng, most=12), noise=noise)
    epoch = ls_epoch(g, Ls(), alarm="pl", p_fa=1e-3, alert=LIMITS)
    kind = tuple(rng.permutation(len(g.names))[: rng.integers(1, 4)].tolist())
    worst = exact_worst(epoch, event, [kind])
    bias = np.zeros((60, len(g.names)))
    bias[:, list(kind)] = rng.normal(size=(60, len(kind))) * 10 ** rng.uniform(-1, 2, (60, 1))
    shift, root = epoch.effects(bias)
    values = event_probability(epoch, event, shift, root)
    assert values.max() <= worst.probability[0] * (1 + 1e-8)
    assert (values <= upper_bound(epoch, event, shift, root) * (1 + 1e-8) + 1e-300).all()
    if np.isfinite(worst.bias_m).all():
        shift, root = epoch.effects(worst.bias_m)
        assert event_probability(epoch, event, shift, root)[0] == pytest.approx(worst.probability[0], rel=1e-7)
        np.testing.assert_allclose(shift, worst.shift, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(root, worst.root, rtol=1e-6, atol=1e-9)


@settings(max_examples=4)
@given(order=st.permutations(range(10)), exponent=st.floats(-3, 3), event=st.sampled_from(["missed", "misleading"]))
def test_order_and_unit_do_not_matter(order: list[int], exponent: float, event: str) -> None:
    one, scale = appendix_d(noise=3.0), 10.0**exponent
    at = np.array(order)
    other = Geometry.from_arrays(
        one.design[at], one.sigma_m[at] * scale, [one.systems[k] for k in at], [one.names[k] for k in at]
    )
    first = worst_case(one, event=event).set_index("satellites")  # type: ignore[arg-type]
    second = worst_case(other, event=event, alert=_limits(35.0 * scale)).set_index("satellites")  # type: ignore[arg-type]
    second = second.loc[first.index]
    np.testing.assert_allclose(first["probability"], second["probability"], rtol=1e-8)
    # At a flat top the size is less certain than the probability: its relative error is the root of that of these.
    np.testing.assert_allclose(first["bias_m"] * scale, second["bias_m"], rtol=1e-4, atol=1e-3 * scale)


def test_sign_does_not_matter() -> None:
    g = appendix_d(noise=3.0)
    row = worst_case(g, satellites=[("G03", "E10")]).iloc[0]
    pair = {"G03": row["bias_1_m"], "E10": row["bias_2_m"]}
    turned = {name: -value for name, value in pair.items()}
    rates = ls_rates(g, biases(g, pair) + biases(g, turned))["missed_rate"]
    assert rates[0] == pytest.approx(rates[1], rel=1e-12)
    assert rates[0] == pytest.approx(row["probability"], rel=1e-8)


def test_faults_that_no_residual_shows() -> None:
    """A satellite alone in its system moves its clock; six satellites with five unknowns leave two unseen."""
    rng = np.random.default_rng(5)
    alone = random_geometry(rng, counts=(8, 1), noise=4.0)
    table = worst_case(alone).set_index("satellites")
    clean = ls_rates(alone, no_fault(alone)).iloc[0]
    assert table.loc["C09", "probability"] == pytest.approx(clean["missed_rate"], rel=1e-9)
    assert table.loc["C09", "bias_m"] == 0.0
    few = random_geometry(rng, counts=(4, 2), noise=4.0)
    pairs = worst_case(few, satellites=2)
    clean = ls_rates(few, no_fault(few)).iloc[0]
    # One degree of freedom: some fault of every pair is invisible, and moves the height but for the pair that has a
    # clock of its own, for which it is a clock error.
    hidden = pairs[pairs["satellites"] != "C05,C06"]
    np.testing.assert_allclose(hidden["probability"], 1 - clean["alarm_rate"], rtol=1e-9)
    assert np.isinf(hidden[["bias_1_m", "bias_2_m"]]).all(axis=None)
    assert "inf" in hidden["fault"].iloc[0]
    own = pairs[pairs["satellites"] == "C05,C06"].iloc[0]
    assert np.isfinite([own["bias_1_m"], own["bias_2_m"]]).all()


def test_direction_of_largest_slope_is_that_of_one_satellite() -> None:
    g = appendix_d()
    epoch = ls_epoch(g, Ls(), alarm="pl", p_fa=1e-3, alert=LIMITS)
    for k in range(10):
        found = worst_direction(epoch, np.eye(10)[:, [k]])
        shift, root = epoch.effects(np.eye(10)[k])
        assert found.slope == pytest.approx(abs(shift) / root, rel=1e-12)
        assert epoch.effects(found.bias_m)[1] == pytest.approx(1.0, rel=1e-12)


def test_series_and_epochs_without_redundancy() -> None:
    in_view = np.ones((4, 9), dtype=bool)
    in_view[1, 0] = False
    in_view[2, 5:] = False
    in_view[3, 2:] = False
    g = random_series(np.random.default_rng(11), in_view, "GGGGGCCCC", noise=6.0)
    table = worst_case(g)
    assert table["epoch"].value_counts(sort=False).to_dict() == {0: 9, 1: 8, 2: 5, 3: 2}
    for epoch, part in table.groupby("epoch"):
        assert part["probability"].is_monotonic_decreasing
        if epoch < 3:
            alone = worst_case(g[int(epoch)])
            np.testing.assert_allclose(part["probability"], alone["probability"], rtol=1e-12)
    # Two satellites: always an alarm.
    last = table[table["epoch"] == 3]
    assert (last["probability"] == 0).all()
    assert (last["alarm_rate"] == 1).all()
    assert last["bias_m"].isna().all()
    chosen = worst_case(g, satellites=["G01"])
    assert chosen["epoch"].tolist() == [0, 2, 3]


@pytest.mark.parametrize(
    ("event", "satellites"), [("misleading", 1), ("missed", [("G03", "E10")]), ("misleading", [("G03", "E06")])]
)
def test_probability_against_simulation(event: str, satellites: object) -> None:
    g, draws = appendix_d(noise=3.0), 50_000
    row = worst_case(g, event=event, satellites=satellites).iloc[0]  # type: ignore[arg-type]
    sizes = row[["bias_m"]] if satellites == 1 else row[["bias_1_m", "bias_2_m"]]
    fault = biases(g, dict(zip(row["satellites"].split(","), sizes, strict=True)))
    counted = sweep(g, fault, draws=draws, seed=20240501, methods=("ls",), progress=False).iloc[0]
    # Three tests, 1e-6 for all of them together.
    assert binomial_p_value(counted[event], draws, row["probability"]) > 1e-6 / 3


def _stand_in(g: Geometry, event: str, scatter: float):
    """An estimator whose truth is known: exact rates with a lognormal error that depends on the fault and seed."""

    def estimate(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
        truth = ls_rates(g, faults)[f"{event}_rate"].to_numpy()
        error = np.random.default_rng([seed, len(faults)]).standard_normal(truth.size)
        value = truth * np.exp(scatter * target_cov * error)
        spread = target_cov * value
        return pd.DataFrame(
            {
                "probability": value,
                "standard_error": spread,
                "low": value - 2 * spread,
                "high": value + 2 * spread,
                "warning": "",
            }
        )

    return estimate


@pytest.mark.parametrize("event", ["missed", "misleading"])
def test_the_search_by_estimates_comes_to_the_exact_worst(event: str) -> None:
    g = appendix_d(noise=3.0)
    exact = worst_case(g, event=event).set_index("satellites")  # type: ignore[arg-type]
    found = worst_case(g, event=event, estimator=_stand_in(g, event, 0.0)).set_index("satellites")  # type: ignore[arg-type]
    assert found["refined"].sum() == 3
    assert found.index[0] == exact.index[0] == "G03"
    top = found[found["refined"]]
    # The last step of the climb is 6 % of the size, and at the top the probability is flat.
    np.testing.assert_allclose(top["probability"], exact.loc[top.index, "probability"], rtol=0.02)
    assert (found["probability"] <= exact.loc[found.index, "probability"] * (1 + 1e-9)).all()
    assert (found["grid_probability"] <= exact.loc[found.index, "grid_probability"] * (1 + 1e-9)).all()
    pair = [("G03", "E10")]
    best = worst_case(g, event=event, satellites=pair).iloc[0]  # type: ignore[arg-type]
    got = worst_case(g, event=event, satellites=pair, estimator=_stand_in(g, event, 0.0)).iloc[0]  # type: ignore[arg-type]
    assert 0.95 * best["probability"] < got["probability"] <= best["probability"] * (1 + 1e-9)


@pytest.mark.parametrize(("event", "noise"), [("misleading", 3.0), ("missed", 1.0)])
def test_the_search_with_the_rare_event_estimator(event: str, noise: float) -> None:
    """A method that never reweights is least squares, of which the answer is known: 1.1e-2, and 7.3e-18 at 23 m."""
    g, method = appendix_d(noise=noise), Igg3(k0=1e3, k1=2e3, iterations=1)
    table = worst_case(
        g,
        method=method,
        event=event,  # type: ignore[arg-type]
        satellites=["G03"],
        target_cov=0.05,
        max_evaluations=2_000_000,
        seed=3,
    )
    row = table.iloc[0]
    truth = ls_rates(g, biases(g, {"G03": row["bias_m"]}))[f"{event}_rate"][0]
    # One in a million.
    assert abs(row["probability"] - truth) < 4.9 * row["standard_error"]
    assert row["standard_error"] < 0.06 * row["probability"]
    assert row["low"] < row["probability"] < row["high"]
    assert "the search cannot tell" not in row["warning"]
    best = worst_case(g, event=event, satellites=["G03"]).iloc[0]  # type: ignore[arg-type]
    # The finer curve compares estimates of some percent, between sizes where the top is flat.
    assert truth > 0.9 * best["probability"]
    # The search's own value for the usual grid, a rough one.
    assert row["grid_probability"] == pytest.approx(best["grid_probability"], rel=0.5)
    assert min(table.attrs["evaluations"].values()) > 0


@pytest.mark.parametrize("event", ["misleading", "missed"])
def test_screened_pairs_of_what_is_least_squares(event: str) -> None:
    """All pairs by the search, against the exact worst of each."""
    g, method = appendix_d(noise=3.0), Igg3(k0=1e3, k1=2e3, iterations=1)
    exact = worst_case(g, event=event, satellites=2).set_index("satellites")  # type: ignore[arg-type]
    sizes, exact = exact[["bias_1_m", "bias_2_m"]].to_numpy(), exact["probability"]
    table = worst_case(
        g,
        method=method,
        event=event,
        satellites=2,
        target_cov=0.1,
        max_evaluations=1_000_000,
        seed=5,  # type: ignore[arg-type]
    )
    assert len(table) == len(exact) == 45
    assert table["stage"].value_counts().to_dict() == {"screened": 33, "shortlisted": 9, "refined": 3}
    top = table[table["refined"]]
    assert top.index.tolist() == [0, 1, 2]
    # The worst three of all, and each near its own worst: the climb compares populations of a few hundred points.
    assert set(top["satellites"]) == set(exact.index[:3])
    for row in top.itertuples():
        fault = biases(g, dict(zip(row.satellites.split(","), (row.bias_1_m, row.bias_2_m), strict=True)))
        truth = ls_rates(g, fault)[f"{event}_rate"][0]
        assert abs(row.probability - truth) < 4.9 * row.standard_error
        assert row.low < row.probability < row.high
        assert truth > 0.8 * exact[row.satellites]
    # The others have a count and no estimate; the exact worst is at least what they were screened at.
    rest = table[~table["refined"]].set_index("satellites")
    assert rest["probability"].isna().all()
    assert (rest["low"] <= exact[rest.index]).all()
    spent = table.attrs["evaluations"]
    # 42 faults of each pair and five along the direction that is worst for least squares, if any is.
    assert spent["screened"] == 1024 * (45 * 42 + 5 * int(sizes.any(axis=1).sum()))
    assert spent["shortlisted"] > 0
    assert spent["refined"] >= 3 * 2**15


def test_the_last_estimate_is_not_the_luckiest() -> None:
    """Over many seeds the reported value is right on average for the reported fault, chosen or not."""
    g = appendix_d(noise=3.0)
    errors = []
    for seed in range(12):
        row = worst_case(g, satellites=["G03"], estimator=_stand_in(g, "missed", 1.0), seed=seed, target_cov=0.2).iloc[
            0
        ]
        truth = ls_rates(g, biases(g, {"G03": row["bias_m"]}))["missed_rate"][0]
        errors.append(np.log(row["probability"] / truth) / 0.2)
    # Twelve standard normal errors: their mean is Normal(0, 1/12), here within 4.9 of its deviations (1e-6).
    assert abs(np.mean(errors)) < 4.9 / np.sqrt(12)


def test_estimates_that_fail() -> None:
    g = appendix_d(noise=3.0)
    whole = _stand_in(g, "missed", 0.0)

    def partly(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
        table = whole(faults, target_cov, seed)
        bad = faults.bias_m[:, 2] > 20.0
        return table.assign(probability=table["probability"].mask(bad), warning=np.where(bad, "weights degenerate", ""))

    row = worst_case(g, satellites=["G03"], estimator=partly).iloc[0]
    assert 0 < row["bias_m"] <= 20.0
    # 30, 40, 50, 60, 80, 100 and 150 m.
    assert row["warning"] == "7 of 12 faults of the scan have no estimate"

    def never(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
        return whole(faults, target_cov, seed).assign(probability=np.nan)

    row = worst_case(g, satellites=["G03"], estimator=never).iloc[0]
    assert np.isnan(row["probability"])
    assert "no estimate" in row["warning"]
    with pytest.raises(InputError, match="estimator: one row for each of 12 faults"):
        worst_case(g, satellites=["G03"], estimator=lambda f, c, s: whole(f, c, s).iloc[:1])


@pytest.mark.parametrize("event", ["missed", "misleading"])
@pytest.mark.parametrize("val_m", [1e-6, 35.0, 1e9])
@pytest.mark.parametrize("sigma_m", [1e-9, 1.0, 1e9])
def test_extremes_are_a_number_or_a_sentence(event: str, val_m: float, sigma_m: float) -> None:
    g = appendix_d()
    g = Geometry.from_arrays(g.design, np.full(len(g.names), sigma_m), g.systems, g.names)

    def worst() -> pd.DataFrame:
        return worst_case(g, satellites=["G03", ("G03", "E06")], event=event, alert=AlertLimits("any", val_m))

    # Where squares of a bias over sigma are beyond what the laws are computed for.
    if sigma_m < 1.0 or (val_m / sigma_m > 1e8 and event == "missed"):
        with pytest.raises(InputError, match=r": a number .* is needed, not [\d.e+]+\.$"):
            worst()
    else:
        assert worst()["probability"].between(0.0, 1.0).all()


def test_bad_input() -> None:
    g = appendix_d()
    cases: list[tuple[dict, str]] = [
        ({"satellites": 3}, "satellites: a whole number from 1 to 2"),
        ({"satellites": "G03"}, "satellites: 1, 2 or a list of names"),
        ({"satellites": ["G3"]}, "satellite: 'G3' is not in view"),
        ({"satellites": [("G03", "G03")]}, "satellites: different names"),
        ({"satellites": []}, "satellites: at least one"),
        ({"event": "exceeded"}, "event: 'exceeded' is unknown"),
        ({"alarm": "chi"}, "alarm: 'chi' is unknown"),
        ({"alarm": "chi2", "p_fa": 0.0}, "p_fa"),
        ({"method": "lms"}, "method: 'lms' is unknown"),
        ({"method": Igg3(), "alarm": "chi2"}, "alarm: 'chi2' is for exact laws.*igg3 has no exact_law"),
        ({"target_cov": 0.0}, "target_cov: a number from 0.001 to 1 is needed, not 0"),
        ({"refine": 0}, "refine: a whole number of at least 1"),
        ({"seed": -1}, "seed"),
        ({"alert": 35.0}, "alert: alert limits such as"),
        (
            {"satellites": [("G03", "E06", "E07")], "estimator": _stand_in(g, "missed", 0.0)},
            "satellites: the search by estimates takes 1 or 2",
        ),
    ]
    for options, message in cases:
        with pytest.raises(InputError, match=message):
            worst_case(g, **options)
