"""The calibrated multiplier: Student's quantile, roots of exact rates, order statistics, rare events."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import pl_mc
from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor import from_curve
from pl_mc.integrity_risk.k_factor.calibrate import calibrate
from pl_mc.integrity_risk.k_factor.calibrated import fewest_draws, order_bounds
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import RatioState, ratio_state
from pl_mc.integrity_risk.k_factor.from_curve import ExceedanceCurve, exceedance_curve, holding_both
from pl_mc.integrity_risk.k_factor.worst_fault import neediest_fault
from pl_mc.integrity_risk.rare.importance import ImportanceRun
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods import Igg3, Ls
from pl_mc.statistics import binomial_p_value, ls_rates
from reference.problems import appendix_d, random_series

# Draws are many here, and compilations few.
pytestmark = pytest.mark.counting

# With these limits no residual is ever reweighted, so that the robust method is least squares, in all but the way
# in which it is calibrated.
NEVER_REWEIGHTS = Igg3(k0=1e3, k1=2e3, iterations=1)


def _day(rng: np.random.Generator, noise: float = 4.0) -> Geometry:
    in_view = np.ones((3, 9), dtype=bool)
    in_view[1, 8] = False
    in_view[2, 5:] = False
    return random_series(rng, in_view, "GGGGGCCCC", noise=noise)


def test_fault_free_least_squares_is_student() -> None:
    day = _day(np.random.default_rng(1))
    table = calibrate(day, target=1e-7)
    # Nine, eight, and five satellites (GPS alone): 4, 3 and 1 degrees of freedom.
    np.testing.assert_allclose(table["k_vertical"], stats.t.isf(5e-8, [4, 3, 1]), rtol=1e-12)
    assert table["epoch"].tolist() == [0, 1, 2]
    np.testing.assert_array_equal(table["k_high"], table["k_low"])
    np.testing.assert_allclose(table["probability"], 1e-7, rtol=1e-8)
    np.testing.assert_allclose(table["inflation"], table["k_vertical"] / 5.33)
    assert (table["found"] == "exact").all()
    # A normal quantile is the limit of many degrees of freedom.
    assert calibrate(appendix_d(), target=1e-7)["k_vertical"][0] == pytest.approx(45.207, abs=5e-4)


@pytest.mark.parametrize("event", ["exceeded", "misleading"])
def test_exact_roots_and_their_alarms(event: str) -> None:
    g = appendix_d(noise=3.0)
    faults = no_fault(g) + biases(g, {"G03": 15.0}) + biases(g, {"G03": 30.0, "E08": -10.0})
    table = calibrate(g, faults=faults, event=event, target=1e-5)  # type: ignore[arg-type]
    for k, row in table.iterrows():
        one = Faults(faults.bias_m[[k]], faults.names, (faults.labels[int(str(k))],))
        got = ls_rates(g, one, k_vertical=row["k_vertical"]).iloc[0]
        assert got[f"{event}_rate"] == pytest.approx(1e-5, rel=1e-8)
        assert row["alarm_rate_after"] == pytest.approx(got["alarm_rate"], rel=1e-12)
        assert row["alarm_rate_before"] == pytest.approx(ls_rates(g, one)["alarm_rate"][0], rel=1e-12)
    assert table["decides"].tolist() == (table["k_high"] == table["k_high"].max()).tolist()


def test_pooled_least_squares() -> None:
    day = _day(np.random.default_rng(2))[0:2]
    row = calibrate(day, target=1e-6, pooled=True).iloc[0]
    assert np.isnan(row["epoch"])
    rates = ls_rates(day, no_fault(day), k_vertical=row["k_vertical"])["exceeded_rate"]
    assert rates.mean() == pytest.approx(1e-6, rel=1e-8)
    each = calibrate(day, target=1e-6)["k_vertical"]
    assert each.min() < row["k_vertical"] < each.max()


@pytest.mark.quick
def test_a_target_that_every_k_factor_keeps() -> None:
    # Unavailable: an alarm always.
    g = random_series(np.random.default_rng(3), np.ones((1, 5), dtype=bool), "GGGCC")
    row = calibrate(g, target=1e-3).iloc[0]
    assert row["k_high"] == 0.0
    assert row["alarm_rate_before"] == row["alarm_rate_after"] == 1.0
    row = calibrate(g, method=NEVER_REWEIGHTS, target=1e-3, draws=4000).iloc[0]
    assert row["k_high"] == 0.0
    assert row["alarm_rate_after"] == 1.0


@settings(max_examples=60)
@given(draws=st.integers(1, 10**7), log_target=st.floats(-7, -0.1), confidence=st.sampled_from([0.5, 0.8, 0.95, 0.999]))
def test_ranks_by_the_binomial(draws: int, log_target: float, confidence: float) -> None:
    target = 10.0**log_target
    high, low = order_bounds(draws, target, confidence)
    number = stats.binom(draws, target)
    # The r-th largest keeps the target where at least r exceedance probabilities are below it.
    if high > 0:
        assert number.sf(high - 1) >= confidence
    assert number.sf(high) < confidence
    if low <= draws:
        assert number.cdf(low - 1) >= confidence
    assert low >= high
    assert (high > 0) == (draws >= fewest_draws(target, confidence)) or abs(
        draws - math.log1p(-confidence) / math.log1p(-target)
    ) < 1e-6 * draws


def test_coverage_of_the_order_statistics() -> None:
    """Student ratios, whose quantile is known: how often the bounds hold, over four thousand samples."""
    rng, draws, target, confidence = np.random.default_rng(9), 3000, 5e-3, 0.9
    truth = stats.t.isf(target / 2, 5)
    high, low = order_bounds(draws, target, confidence)
    ratio = np.abs(rng.standard_t(5, (4000, draws)))
    descending = -np.sort(-ratio, axis=1)
    above = int((descending[:, high - 1] >= truth).sum())
    below = int((descending[:, low - 1] <= truth).sum())
    # The exact coverage of each, from the binomial, and the least that was promised.
    for count, chance in (
        (above, stats.binom.sf(high - 1, draws, target)),
        (below, stats.binom.cdf(low - 1, draws, target)),
    ):
        assert chance >= confidence
        assert binomial_p_value(count, 4000, chance) > 1e-6 / 2


@pytest.mark.quick
@pytest.mark.parametrize("event", ["exceeded", "misleading"])
def test_counted_k_factor_of_what_is_least_squares(event: str) -> None:
    g = appendix_d(noise=3.0)
    faults = no_fault(g) + biases(g, {"G03": 20.0})
    exact = calibrate(g, faults=faults, event=event, target=3e-3)  # type: ignore[arg-type]
    counted = calibrate(
        g,
        method=NEVER_REWEIGHTS,
        faults=faults,
        event=event,  # type: ignore[arg-type]
        target=3e-3,
        draws=40_000,
        seed=12,
        confidence=1 - 1e-6,
    )
    assert (counted["found"] == "counting").all()
    assert (counted["draws"] == 40_000).all()
    # Each bound fails once in a million.
    assert (counted["k_low"] <= exact["k_vertical"]).all()
    assert (counted["k_high"] >= exact["k_vertical"]).all()
    assert (counted["k_low"] < counted["k_vertical"]).all()
    assert (counted["k_vertical"] < counted["k_high"]).all()
    for k in (0, 1):
        one = Faults(faults.bias_m[[k]], faults.names, faults.labels[k : k + 1])
        truth = ls_rates(g, one, k_vertical=counted["k_high"][k])
        assert counted["probability_low"][k] <= truth[f"{event}_rate"][0] <= counted["probability_high"][k]
        assert truth[f"{event}_rate"][0] <= 3e-3
        alarms = round(counted["alarm_rate_after"][k] * 40_000)
        assert binomial_p_value(alarms, 40_000, truth["alarm_rate"][0]) > 1e-6
        before = round(counted["alarm_rate_before"][k] * 40_000)
        assert binomial_p_value(before, 40_000, ls_rates(g, one)["alarm_rate"][0]) > 1e-6


@pytest.mark.quick
def test_pooled_counting() -> None:
    day = _day(np.random.default_rng(2))[0:2]
    exact = calibrate(day, target=5e-3, pooled=True)["k_vertical"][0]
    counted = calibrate(day, method=NEVER_REWEIGHTS, target=5e-3, pooled=True, draws=20_000, confidence=1 - 1e-6).iloc[
        0
    ]
    assert counted["k_low"] <= exact <= counted["k_high"]
    assert counted["draws"] == 40_000


def test_least_squares_kept_honest_by_scale() -> None:
    """The multiplier is a pure number: metres and limit scaled together leave it, and with it the alarms, alone."""
    one = calibrate(appendix_d(noise=3.0), event="misleading", target=1e-4).iloc[0]
    limits = AlertLimits("test", vertical_m=70.0, horizontal_m=40.0)
    other = calibrate(appendix_d(noise=6.0), event="misleading", target=1e-4, alert=limits).iloc[0]
    assert other["k_vertical"] == pytest.approx(one["k_vertical"], rel=1e-9)
    assert other["alarm_rate_after"] == pytest.approx(one["alarm_rate_after"], rel=1e-9)


def _exact_estimator(g: Geometry, event: str, scatter: float):
    """Of a method with its multiplier: the rates of least squares, with a lognormal error that changes with it."""

    def of(method):
        def estimate(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
            truth = ls_rates(g, faults, k_vertical=method.k_vertical)[f"{event}_rate"].to_numpy()
            error = np.random.default_rng([seed, int(method.k_vertical * 1e6)]).standard_normal(truth.size)
            value = truth * np.exp(scatter * target_cov * error)
            return pd.DataFrame(
                {
                    "probability": value,
                    "standard_error": target_cov * value,
                    "low": value * (1 - 2 * target_cov),
                    "high": value * (1 + 2 * target_cov),
                    "warning": "",
                }
            )

        return estimate

    return of


@pytest.mark.quick
@pytest.mark.parametrize(("event", "scatter"), [("exceeded", 0.0), ("misleading", 0.0), ("misleading", 0.5)])
def test_k_factor_by_rare_events(event: str, scatter: float) -> None:
    g = appendix_d(noise=1.5)
    fault = biases(g, {"G03": 5.0})
    exact = calibrate(g, faults=fault, event=event, target=1e-7)["k_vertical"][0]  # type: ignore[arg-type]
    row = calibrate(
        g,
        method=NEVER_REWEIGHTS,
        faults=fault,
        event=event,  # type: ignore[arg-type]
        target=1e-7,
        draws=20_000,
        target_cov=0.05,
        estimator=_exact_estimator(g, event, scatter),
    ).iloc[0]
    assert row["found"] == "rare events"
    assert row["k_low"] < row["k_vertical"] < row["k_high"]
    truth = {
        name: ls_rates(g, fault, k_vertical=row[name])[f"{event}_rate"][0] for name in ("k_low", "k_vertical", "k_high")
    }
    # The estimate comes within 2 % of the target, the bounds a twelfth beyond it (1.645 standard errors of 5 %),
    # all of them give or take five standard errors of the scatter.
    noise = np.exp(5 * scatter * 0.05)
    assert 1e-7 / 1.03 / noise < truth["k_vertical"] < 1.03e-7 * noise
    if scatter == 0:
        assert 0.8e-7 < truth["k_high"] < 1e-7 < truth["k_low"] < 1.25e-7
        assert row["k_low"] < exact < row["k_high"]
    assert row["probability_high"] <= 1e-7
    assert row["warning"] == ""


@pytest.mark.quick
def test_bounds_that_no_estimate_reaches_are_told() -> None:
    """Estimates that are worse each time bear out no multiplier."""
    g = appendix_d(noise=1.5)
    exact = _exact_estimator(g, "exceeded", 0.0)
    asked: list[float] = []

    def worse(method):
        def estimate(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
            asked.append(method.k_vertical)
            table = exact(method)(faults, target_cov, seed)
            return table.assign(standard_error=table["probability"] * 3.0 ** len(asked))

        return estimate

    row = calibrate(
        g, method=NEVER_REWEIGHTS, event="exceeded", target=1e-7, draws=20_000, target_cov=0.05, estimator=worse
    ).iloc[0]
    assert (row["k_low"], row["k_high"]) == (0.0, np.inf)
    assert "no upper bound was reached; no lower bound was reached" in row["warning"]
    assert len(set(asked)) == len(asked)


def _state(fault: Faults | None = None, method=NEVER_REWEIGHTS) -> RatioState:
    g = appendix_d(noise=1.5)
    return ratio_state(g, no_fault(g) if fault is None else fault, method, "misleading", LPV_200)


@pytest.mark.quick
def test_the_ratio_decides_the_event_at_every_k_factor() -> None:
    """Against the methods themselves: error and level of each draw, and an alarm where the level passes VAL."""
    g = appendix_d(noise=6.0)
    fault = biases(g, {"G03": 30.0})
    method = Igg3()
    state = ratio_state(g, fault, method, "misleading", LPV_200)
    points = np.random.default_rng(4).standard_normal((1024, state.dimension))
    noise_m = (points @ state.coordinates.matrix.T) * np.asarray(g.sigma_m) + fault.bias_m
    ratio = state.ratio(points)
    model = jax.jit(linear_model)(np.asarray(g.design), np.asarray(g.sigma_m))
    outcome = jax.jit(lambda errors: method.solve(model, (), start_from(model, errors)))(noise_m.T)
    error_m, level_m = np.abs(np.asarray(outcome.error_m[2])), np.asarray(outcome.vpl_m)
    available = np.asarray(outcome.available)
    hits = 0
    for k in (0.5, 2.0, 5.33):
        vpl_m = level_m * k / method.k_vertical
        event = available & (error_m > vpl_m) & (vpl_m <= LPV_200.vertical_m)
        np.testing.assert_array_equal(ratio > k, event)
        np.testing.assert_array_equal(state.at(k)(points) > 0, event)
        hits += int(event.sum())
    assert hits > 50
    exceeded = dataclasses.replace(state, event="exceeded").ratio(points)
    np.testing.assert_array_equal(exceeded > 2.0, available & (error_m > 2.0 * level_m / method.k_vertical))


@pytest.fixture(scope="module")
def curve() -> ExceedanceCurve:
    """Of what is least squares, fault-free, down to 1e-7."""
    options = {"target": 1e-7, "target_cov": 0.1, "most_evaluations": 10**7, "size": 2048, "fewest": 10}
    return exceedance_curve(_state(), np.random.default_rng(8), **options)  # type: ignore[arg-type]


def test_the_curve_is_exact_for_least_squares(curve: ExceedanceCurve) -> None:
    g = appendix_d(noise=1.5)
    for target in (1e-2, 1e-4, 1e-6, 1e-7):
        exact = calibrate(g, event="misleading", target=target)["k_vertical"][0]
        k, low, high = curve.k_factor(target, 1 - 1e-5)
        assert low < exact < high
        assert low < k < high
        value, error = curve.at(exact)
        # Student's t of so few populations, both sides one in a hundred thousand.
        reach = stats.t.isf(1e-5, curve.populations - 1) * error / value
        assert abs(np.log(value / target)) < reach
        assert error < 0.4 * value
    assert (np.diff(curve.probability) <= 0).all()


def test_the_ends_of_a_curve() -> None:
    k = np.array([1.0, 2.0, 4.0])
    short = ExceedanceCurve(k, np.array([1e-2, 1e-3, 1e-4]), np.array([1e-3, 1e-4, 5e-5]), 6, 100)
    middle, low, high = short.k_factor(1e-3, 0.95)
    assert middle == pytest.approx(2.0)
    assert low < middle < high
    # Beyond the last point nothing is known.
    assert np.isnan(short.k_factor(1e-5, 0.95)[0])
    assert short.k_factor(1e-5, 0.95)[2] == np.inf
    # The target lies within the curve but not within its upper bound.
    assert short.k_factor(1.1e-4, 0.95)[2] == np.inf
    assert short.at(2.0) == pytest.approx((1e-3, 1e-4))


@pytest.mark.quick
def test_k_factor_from_a_curve_and_its_check() -> None:
    """What is least squares under another name, to the exact multiplier, and borne out by importance sampling."""
    g = appendix_d(noise=1.5)
    fault = biases(g, {"G03": 5.0})
    exact = calibrate(g, faults=fault, event="misleading", target=1e-6)["k_vertical"][0]
    options = {"draws": 20_000, "target_cov": 0.2, "max_evaluations": 1_500_000, "confidence": 1 - 1e-4}
    table = calibrate(
        g,
        method=NEVER_REWEIGHTS,
        faults=fault,
        event="misleading",
        target=1e-6,
        seed=3,
        **options,  # type: ignore[arg-type]
    )
    row = table.iloc[0]
    assert row["found"] == "rare events"
    assert row["k_low"] < exact < row["k_high"]
    assert row["k_low"] < row["k_vertical"] < row["k_high"]
    assert row["probability_low"] < row["probability"] < row["probability_high"] <= 1e-6 * (1 + 1e-2)
    truth = ls_rates(g, fault, k_vertical=row["k_vertical"])["misleading_rate"][0]
    # The check has an interval of 95 %: five times its half-width is beyond one in a million.
    reach = np.log(row["check_high"] / row["check_probability"])
    assert abs(np.log(row["check_probability"] / truth)) < 2.5 * reach
    assert row["warning"] == ""
    (drawn,) = table.attrs["curves"]
    assert np.interp(row["k_vertical"], drawn["k_vertical"], np.log(drawn["probability"])) == pytest.approx(
        np.log(1e-6), abs=1e-2
    )


def test_one_interval_holds_what_both_estimators_ask_for() -> None:
    """A curve like K^-7 that is 1e-7 at 24.02, and importance sampling that finds 7.6e-8 there, each to 2 %."""
    k = np.geomspace(20.0, 30.0, 200)
    probability = 1e-7 * (k / 24.02) ** -7.0
    curve = ExceedanceCurve(k, probability, 0.02 * probability, populations=10, evaluations=1)
    run = ImportanceRun(7.6e-8, 1.5e-9, 1e3, 1e3, 1e-3, 1)
    own = curve.k_factor(1e-7, 0.95)
    low, high = holding_both(curve, run, own[1:], target=1e-7, confidence=0.95)
    asked = 24.02 * 0.76 ** (1 / 7)
    assert asked < own[1]
    assert low < asked < own[0] < high == own[2]
    # The lower bound is that of importance sampling: 1.65 standard errors of 2 % below.
    assert low == pytest.approx(24.02 * (0.76 * np.exp(-1.646 * 1.5 / 76)) ** (1 / 7), rel=1e-4)


def test_two_estimates_that_disagree_give_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def half(limit, rng, **options) -> ImportanceRun:
        return ImportanceRun(2e-5, 2e-7, 500.0, 1e4, 1e-3, 1000)

    def none(limit, rng, **options) -> ImportanceRun:
        return ImportanceRun(np.nan, np.nan, np.nan, 0.0, np.nan, 1000)

    given_options = {"target": 1e-4, "confidence": 0.95, "key": (1, 0), "name": "test", "target_cov": 0.2}
    for stand_in, words in ((half, "importance sampling found 2e-05"), (none, "never met the event")):
        monkeypatch.setattr(from_curve, "importance_sampling", stand_in)
        found = from_curve.from_curve(_state(), most_evaluations=800_000, **given_options).found  # type: ignore[arg-type]
        assert np.isnan(found.k)
        assert (found.low, found.high) == (0.0, np.inf)
        assert words in found.warning


def test_the_fault_that_needs_most() -> None:
    """Least squares exactly; what is least squares by the search, whose choice must need nearly as much."""
    g = appendix_d(noise=1.5)
    faults = pl_mc.ramps(g, satellites=["G01", "G03", "E10"], start_m=4.0, stop_m=12.0, step_m=4.0)
    options = {"event": "misleading", "alert": LPV_200, "target": 1e-6, "seed": 2}
    each = calibrate(g, faults=faults, event="misleading", target=1e-6)["k_vertical"].to_numpy()
    assert neediest_fault(g, faults, method=Ls(), **options) == each.argmax()  # type: ignore[arg-type]
    chosen = neediest_fault(g, faults, method=NEVER_REWEIGHTS, **options)  # type: ignore[arg-type]
    assert each[chosen] > 0.95 * each.max()


@pytest.mark.quick
def test_bad_input() -> None:
    g = appendix_d()

    @dataclasses.dataclass(frozen=True)
    class Without:
        name: str = "without"

        def prepare(self, model):
            return ()

        def solve(self, model, prepared, start):
            return Ls().solve(model, prepared, start)

    cases: list[tuple[dict, str]] = [
        ({"target": 0.0}, "target: a number from 1e-15 to 0.999"),
        ({"target": 1.0}, "target: a number from 1e-15 to 0.999"),
        ({"confidence": 1.5}, "confidence: it lies between 0 and 1"),
        ({"event": "missed"}, "event: 'missed' is unknown"),
        ({"method": "ig3"}, "method: 'ig3' is unknown"),
        ({"method": Without()}, "method: without has no scales_with_k"),
        ({"draws": 0}, "draws: a whole number"),
        ({"seed": -1}, "seed"),
        ({"faults": [1.0]}, "faults: use ramp"),
        ({"alert": 3}, "alert: alert limits such as"),
        ({"g": 3}, "geometry: a pl_mc Geometry is needed"),
    ]
    for options, message in cases:
        with pytest.raises(InputError, match=message):
            calibrate(options.pop("g", g), **options)
    day = _day(np.random.default_rng(2))[0:2]
    with pytest.raises(InputError, match="draws: a pooled multiplier is counted, which at 1e-07"):
        calibrate(day, method=NEVER_REWEIGHTS, pooled=True, draws=500)
    unseen = np.zeros((1, 9))
    unseen[0, [7, 8]] = 5.0
    third = _day(np.random.default_rng(2))[2:3]
    with pytest.raises(InputError, match="faults: none of them has all of its satellites in view"):
        calibrate(third, faults=Faults.from_array(third, unseen))


@pytest.mark.parametrize("method", ["parity", "max_dop", "leave_one_out"])
def test_levels_that_are_no_multiple_cannot_be_calibrated(method):
    with pytest.raises(pl_mc.InputError, match="with other options max_dop, parity, leave_one_out"):
        pl_mc.calibrate(appendix_d(), method=method, target=1e-2)
