"""The public `risk`: against exact rates and counts, and what it says where it has no number."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import pl_mc
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.rare.importance import ImportanceRun
from pl_mc.integrity_risk.rare.risk import FEWEST_EVALUATIONS, estimate_risk, judge, risk
from pl_mc.integrity_risk.rare.subset import SubsetRun
from pl_mc.methods import Igg3
from pl_mc.statistics import clopper_pearson
from reference.problems import appendix_d, random_geometry, random_series

# Draws are many here, and compilations few.
pytestmark = pytest.mark.counting

COLUMNS = [
    "fault", "bias_m", "method", "event", "probability", "standard_error", "low", "high", "ess", "evaluations",
    "estimator", "subset_probability", "subset_standard_error", "subset_evaluations", "warning",
    "unconverged_rate", "unconverged_low", "unconverged_high",
]  # fmt: skip
# 4.9 standard errors: 1e-6, two-sided.
DEVIATION = 4.9


@pytest.fixture(scope="module")
def few() -> pl_mc.Geometry:
    """Six satellites of two systems, one redundant: cheap, and every event can be rare."""
    return random_geometry(np.random.default_rng(40), counts=(4, 2), noise=2.0)


@pytest.mark.parametrize(
    ("noise", "satellite", "bias_m", "event", "decade"),
    [(2.0, "G03", 10.0, "missed", -12), (2.0, "E10", 20.0, "misleading", -6), (1.0, "G03", 0.0, "alarm", -13)],
)
def test_least_squares_has_its_exact_risk(noise: float, satellite: str, bias_m: float, event: str, decade: int) -> None:
    g = appendix_d(noise=noise)
    faults = pl_mc.biases(g, {satellite: bias_m})
    row = risk(g, faults, seed=1, event=event, method="ls", max_evaluations=4_000_000, progress=False).iloc[0]
    exact = pl_mc.exact.ls_rates(g, faults)[f"{event}_rate"][0]
    # The case is as rare as it was chosen to be.
    assert 10.0**decade < exact < 10.0 ** (decade + 1)
    assert row["warning"] == ""
    assert row["estimator"] == "importance"
    assert row["low"] < row["probability"] < row["high"]
    assert row["standard_error"] <= 0.1 * row["probability"]
    assert abs(row["probability"] - exact) < DEVIATION * row["standard_error"]
    assert row["evaluations"] + row["subset_evaluations"] <= 4_000_000
    # The second estimator's error comes from at least six populations.
    deviation = abs(row["subset_probability"] - exact) / row["subset_standard_error"]
    assert deviation < stats.t.isf(0.5e-4, 5)


@pytest.mark.parametrize(
    ("scale", "event", "bias_m", "seed", "counts"),
    [("posterior_floored", "misleading", 7.5, 40, (4, 2)), ("apriori", "missed", 7.0, 43, (4, 3))],
)
def test_the_robust_estimate_has_the_risk_that_is_counted(
    scale: str, event: str, bias_m: float, seed: int, counts: tuple[int, ...]
) -> None:
    g, method = random_geometry(np.random.default_rng(seed), counts=counts), Igg3(scale=scale, iterations=10)
    faults = pl_mc.biases(g, {g.names[1]: bias_m})
    row = risk(g, faults, seed=2, event=event, method=method, max_evaluations=3_000_000, progress=False).iloc[0]
    draws = 600_000
    found = pl_mc.sweep(g, faults, draws=draws, seed=3, methods=(method,), progress=False)
    count = found[event][0]
    assert row["estimator"] == "importance"
    assert row["unconverged_low"] <= found["unconverged_high"][0]
    assert row["unconverged_high"] >= found["unconverged_low"][0]
    assert count > 8
    least, most = clopper_pearson(count, draws, 1.0 - 1e-6)
    assert row["low"] < most
    assert row["high"] > least
    if scale == "posterior_floored":
        assert row["warning"] == ""
        error = np.hypot(row["standard_error"], np.sqrt(count) / draws)
        assert abs(row["probability"] - count / draws) < DEVIATION * error


@pytest.mark.parametrize(("bias_m", "most"), [(12.0, 1_000_000), (14.0, 500_000)])
def test_a_small_budget_is_spent_on_searching(bias_m: float, most: int) -> None:
    """Between 5e-9 and 3e-7, where plain draws tell nothing."""
    g = pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", constellations=("GPS", "BDS-2"), epochs=546)[545]
    faults = pl_mc.biases(g, {"G09": bias_m})
    row = risk(g, faults, seed=7, event="misleading", method="ls", max_evaluations=most, progress=False).iloc[0]
    exact = pl_mc.exact.ls_rates(g, faults)["misleading_rate"][0]
    assert row["estimator"] == "importance"
    assert abs(row["probability"] - exact) < DEVIATION * row["standard_error"]
    assert row["evaluations"] + row["subset_evaluations"] <= most


@pytest.mark.parametrize(
    ("satellite", "bias_m", "said"),
    [("G06", 6.0, "nothing reached the event; 301308"), ("C05", 18.0, "nothing reached"), ("G06", 4.0, " 1 of 301308")],
)
def test_a_budget_that_did_not_do_says_which_one_will(satellite: str, bias_m: float, said: str) -> None:
    """Between 3e-11 and 2e-7; the budget that the sentence names gives the exact risk without a warning."""
    g = pl_mc.simulate(site="CUT0", start="2017-11-21T00:00:00", constellations=("GPS", "BDS-2"), epochs=546)[545]
    faults, options = pl_mc.biases(g, {satellite: bias_m}), {"seed": 7, "event": "misleading", "method": "ls"}
    row = risk(g, faults, max_evaluations=500_000, progress=False, **options).iloc[0]
    exact = pl_mc.exact.ls_rates(g, faults)["misleading_rate"][0]
    assert said in row["warning"]
    assert row["low"] <= exact <= row["high"]
    (named,) = re.findall(r"max_evaluations of ([\d,]+), say", row["warning"])
    assert named == "4,000,000"
    row = risk(g, faults, max_evaluations=int(named.replace(",", "")), progress=False, **options).iloc[0]
    assert row["warning"] == ""
    assert abs(row["probability"] - exact) < DEVIATION * row["standard_error"]


def test_estimates_that_a_test_tells_apart_make_one_interval() -> None:
    found = ImportanceRun(1e-7, 1e-9, 1e4, 1e4, 1e-3, 100_000)
    near, apart, far = (SubsetRun(p, 1e-9, 40, 100_000) for p in (1.01e-7, 1.035e-7, 1.2e-7))
    rows = [judge(found, check, evaluations=1, target_cov=0.1) for check in (near, apart, far)]
    assert [row.warning == "" for row in rows] == [True, True, False]
    assert [bool(np.isnan(row.probability)) for row in rows] == [False, False, True]
    assert rows[0].high < 1.03e-7 < 1.035e-7 < rows[1].high
    assert rows[1].low < 1e-7


def test_what_is_common_is_counted(few: pl_mc.Geometry) -> None:
    faults = pl_mc.ramp(few, satellite=few.names[0], start_m=40.0, stop_m=4000.0, step_m=3960.0)
    table = risk(few, faults, seed=4, event="alarm", method="ls", progress=False)
    exact = pl_mc.exact.ls_rates(few, faults)["alarm_rate"]
    assert list(table.columns) == COLUMNS
    assert list(table["estimator"]) == ["counting"] * 2
    assert list(table["warning"]) == [""] * 2
    assert (abs(table["probability"] - exact) <= DEVIATION * table["standard_error"] + 1e-12).all()
    assert table["probability"][1] == table["high"][1] == 1.0
    assert 0.99 < table["low"][1] < 1.0
    assert table["subset_probability"].isna().all()


def test_what_nothing_reaches_is_bounded(few: pl_mc.Geometry) -> None:
    """A vertical alert limit that the error cannot pass without an alarm within 1e-30."""
    far = pl_mc.AlertLimits("far", vertical_m=1e5, horizontal_m=40.0)
    row = risk(
        few,
        pl_mc.no_fault(few),
        seed=5,
        event="missed",
        method="ls",
        alert=far,
        max_evaluations=FEWEST_EVALUATIONS,
        progress=False,
    ).iloc[0]
    assert np.isnan(row["probability"])
    assert row["low"] == 0.0
    # Clopper-Pearson, 95 %, two-sided: ln 40 over the plain draws, a good part of the evaluations.
    assert np.log(40.0) / FEWEST_EVALUATIONS < row["high"] < np.log(40.0) / (0.2 * FEWEST_EVALUATIONS)
    assert "nothing reached the event" in row["warning"]
    assert row["evaluations"] <= FEWEST_EVALUATIONS


def test_a_series_has_an_epoch_column_and_an_epoch_without_solution_is_certain() -> None:
    in_view = np.ones((3, 7), dtype=bool)
    in_view[1, :2] = in_view[2, 0] = False
    series = random_series(np.random.default_rng(6), in_view, "GGGGGCC", noise=8.0)
    faults = pl_mc.biases(series, {"G01": 50.0}) + pl_mc.biases(series, {"G03": 50.0})
    table = risk(series, faults, seed=7, event="alarm", method="ls", progress=False)
    assert list(table.columns) == ["epoch", *COLUMNS]
    assert list(zip(table["epoch"], table["fault"], strict=True)) == [
        (0, "G01:+50m"), (0, "G03:+50m"), (1, "G03:+50m"), (2, "G03:+50m"),
    ]  # fmt: skip
    assert "G01" in table.attrs["notes"][0]
    lone = table.loc[2]
    assert (lone["estimator"], lone["probability"], lone["evaluations"]) == ("certain", 1.0, 0)
    missed = risk(series[1:2], faults, seed=7, event="missed", method="ls", progress=False)
    assert list(missed["probability"]) == [0.0]
    # Where no fault applies there is a table without rows.
    assert risk(series[1:2], pl_mc.biases(series, {"G01": 50.0}), seed=7, progress=False).empty


def test_a_row_depends_on_no_other_row(few: pl_mc.Geometry) -> None:
    one = pl_mc.biases(few, {few.names[1]: 16.0})
    options = {"seed": 8, "event": "misleading", "method": "ls", "max_evaluations": 600_000, "progress": False}
    alone = risk(few, one, **options, workers=1).iloc[0]
    among = risk(few, pl_mc.no_fault(few) + one, **options, workers=2).iloc[1]
    assert alone["estimator"] == "importance"
    pd.testing.assert_series_equal(alone, among, check_names=False, check_exact=True)
    assert risk(few, one, **(options | {"seed": 9}))["probability"][0] != alone["probability"]


def importance(probability: float = 1e-8, cov: float = 0.05, ess: float = 400.0, top: float = 0.01) -> ImportanceRun:
    return ImportanceRun(probability, cov * probability, ess - 1.0, ess, top, 10**6)


def test_two_estimates_that_agree_give_a_number() -> None:
    row = judge(importance(), SubsetRun(1.2e-8, 2e-9, 6, 10**6), evaluations=10**6, target_cov=0.1)
    assert (row.probability, row.warning) == (1e-8, "")
    quantile = stats.t.isf(0.025, 399)
    assert row.low == pytest.approx(1e-8 * np.exp(-0.05 * quantile))
    assert row.high == pytest.approx(1e-8 * np.exp(0.05 * quantile))


@pytest.mark.parametrize(
    ("found", "check", "words"),
    [
        (importance(), SubsetRun(1e-10, 1e-11, 6, 10**6), "subset simulation 1e-10"),
        (importance(), SubsetRun(0.0, 0.0, 6, 10**6), "subset simulation 0"),
        (importance(ess=20.0, cov=0.2), SubsetRun(1.2e-8, 2e-9, 6, 10**6), "few draws carry"),
        (importance(top=0.4), SubsetRun(1.2e-8, 2e-9, 6, 10**6), "heaviest 40 %"),
    ],
)
def test_a_doubtful_estimate_is_an_interval_and_a_warning(found, check, words) -> None:
    row = judge(found, check, evaluations=10**6, target_cov=0.1)
    assert np.isnan(row.probability)
    assert words in row.warning
    assert row.low <= min(1e-8, check.probability or 1e-8)
    assert row.high >= max(1e-8, check.probability)


@pytest.mark.parametrize(
    ("found", "check", "words"),
    [
        (importance(cov=0.2, ess=50.0), SubsetRun(1.2e-8, 2e-9, 6, 10**6), "coefficient of variation 0.2"),
        (importance(), SubsetRun(1.2e-8, 8e-9, 6, 10**6), "scatters too much"),
    ],
)
def test_an_imprecise_estimate_keeps_its_number_and_says_so(found, check, words) -> None:
    row = judge(found, check, evaluations=10**6, target_cov=0.1)
    assert row.probability == 1e-8
    assert words in row.warning


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"event": "mised"}, "missed"),
        ({"method": "igg4"}, "igg3"),
        ({"target_cov": 0.0}, "target_cov"),
        ({"target_cov": np.nan}, "target_cov"),
        ({"max_evaluations": 1000}, "500000"),
        ({"seed": LARGEST_SEED + 1}, "seed"),
        ({"workers": 0}, "workers"),
        ({"alert": 35.0}, "alert"),
    ],
)
def test_what_cannot_be_used_is_said_in_a_sentence(few: pl_mc.Geometry, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        risk(few, pl_mc.no_fault(few), **({"seed": 1} | options))
    assert str(caught.value).count("\n") == 0


def test_the_estimator_serves_any_limit_state() -> None:
    """A limit state with coordinates of its own: the shell that a chi-square test alarms in."""

    class Shell:
        active, dimension = 4, 5

        def __call__(self, points: np.ndarray) -> np.ndarray:
            return (points[:, :4] ** 2).sum(axis=1) - 45.0

    row = estimate_risk(Shell(), (1, 2), target_cov=0.1, most_evaluations=2_000_000)
    assert abs(row.probability - stats.chi2.sf(45.0, 4)) < DEVIATION * row.standard_error
