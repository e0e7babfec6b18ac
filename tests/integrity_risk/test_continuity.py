"""Continuity of ARAIM: unions of tests against exact laws, alarms against counted ones, sums and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import pl_mc
from pl_mc.araim import LPV_200_V42, Ism
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.budget.continuity import LPV_200_CONTINUITY, failing
from pl_mc.methods import method
from pl_mc.statistics import clopper_pearson

ISM = Ism(
    sigma_ura_m=1.0, sigma_ure_m=1.0, b_nom_m=0.5, r_sat_per_h={"G": 1e-5, "E": 2e-5}, mfd_sat_h={"G": 1.0, "E": 1.5},
    r_const_per_h={"G": 1e-8, "E": 1e-4}, mfd_const_h={"G": 1.0, "E": 2.0},
)  # fmt: skip
G = pl_mc.simulate(
    site=(48.1, 11.6, 500.0), start="2017-11-15T00:00:00", constellations="ADD-24+24", epochs=1, mask_deg=5.0,
    error_model=pl_mc.error_model("dual_frequency", ism=ISM),
)[0]  # fmt: skip
# False alarms so frequent that they can be counted.
OFTEN = replace(LPV_200_V42, name="often", p_fa_vertical=0.5, p_fa_horizontal=0.5)
DRAWS = 4096


def araim(budget=LPV_200_V42, ism=ISM, **options):
    return method("araim", standard="v4.2", budget=budget, ism=ism, **options)


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    methods = (araim(OFTEN), araim(OFTEN, exclusion="satellites", p_fa_chi2=0.02))
    return pl_mc.continuity(G, methods, sizes_m=(4.0, 12.0), draws=DRAWS, rare_draws=8192, seed=3)


def test_a_union_of_tests_has_its_exact_probability() -> None:
    root = np.array([1.0, 0.5, 2.0, 1.0])
    # Two tests of independent noise and one that sees nothing; limits of four and four and a half sigma.
    tests = np.array([[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    limit = np.array([8.0, 4.5 * 1.5, 1.0])
    noise, share, total = failing(tests, limit, root, None, 20_000, 1)
    own = 2.0 * stats.norm.sf([4.0, 4.5])
    np.testing.assert_allclose(total, own.sum(), rtol=1e-12)
    assert (np.abs(tests @ noise) >= limit[:, None] * (1 - 1e-9))[:2].any(axis=0).all()
    # Both at once is all but impossible, so that the union is the sum; a part of it is what it is.
    assert total * share.mean() == pytest.approx(1.0 - np.prod(1.0 - own), rel=1e-4)
    deep = np.abs(tests[0] @ noise) > 2.0 * 4.8
    expected = 2.0 * stats.norm.sf(4.8)
    spread = expected * np.sqrt((1.0 / (expected / total) - 1.0) / 20_000)
    assert total * (share * deep).mean() == pytest.approx(expected, abs=4.5 * spread)
    # Correlated tests that often fail together, against the law of two normal numbers.
    slanted = np.array([[1.0, 0.0, 0.0, 0.0], [0.8, 1.2, 0.0, 0.0]])
    covariance = (slanted * root**2) @ slanted.T
    law = stats.multivariate_normal(np.zeros(2), covariance)
    bounds = 1.0 * np.sqrt(np.diag(covariance))
    inside = law.cdf(bounds) - law.cdf(bounds * [1, -1]) - law.cdf(bounds * [-1, 1]) + law.cdf(-bounds)
    _, share, total = failing(slanted, bounds, root, None, 40_000, 2)
    assert total * share.mean() == pytest.approx(1.0 - inside, abs=4.5 * total * share.std() / 200.0)


def test_residuals_that_are_too_long_are_part_of_it() -> None:
    columns = np.eye(5)[:, :3]
    square = stats.chi2.isf(1e-6, 3)
    noise, share, total = failing(np.zeros((1, 5)), np.array([np.inf]), np.ones(5), (columns, square), 5_000, 1)
    assert total == pytest.approx(1e-6)
    assert (share == 1.0).all()
    length = (noise[:3] ** 2).sum(axis=0)
    assert (length >= square * (1 - 1e-9)).all()
    # Beyond the limit they have the tail of their law, and other directions are left as they were.
    assert stats.kstest(stats.chi2.sf(length, 3) / 1e-6, "uniform").pvalue > 1e-4
    assert stats.kstest(noise[3], "norm").pvalue > 1e-4


def test_alarms_are_those_that_a_sweep_counts(table: pd.DataFrame) -> None:
    methods = (araim(OFTEN), araim(OFTEN, exclusion="satellites", p_fa_chi2=0.02))
    names = G.names[:2]
    faults = pl_mc.no_fault(G)
    for name in names:
        faults = faults + pl_mc.biases(G, {name: 4.0}) + pl_mc.biases(G, {name: 12.0})
    counted = pl_mc.sweep(G, faults, draws=20_000, seed=9, methods=methods)
    for one in methods:
        own, seen = (part[part.method == one.name].set_index("fault") for part in (table, counted))
        free, rate = own.loc["none"], seen.loc["none"].alarm_rate
        assert 1e-4 < rate < 0.1
        # Two estimates that do not know each other: 4.5 of both standard errors.
        error = np.hypot((free.alarm_high - free.alarm_low) / 3.92, np.sqrt(rate / 20_000))
        assert free.alarm == pytest.approx(rate, abs=4.5 * error)
        for name in names:
            worst = seen.loc[[f"{name}:+4m", f"{name}:+12m"]].alarm_rate.max()
            error = np.sqrt(worst * (1.0 - worst) * (1 / DRAWS + 1 / 20_000)) + 1.0 / DRAWS
            assert own.loc[name].alarm == pytest.approx(worst, abs=4.5 * error)


def test_exposures_priors_and_sums(table: pd.DataFrame) -> None:
    for _, own in table.groupby("method", sort=False):
        *single, total = own.to_dict("records")
        assert [row["fault"] for row in single] == ["none", *G.names, "GPS", "Galileo"]
        for row in single:
            for end in ("", "_low", "_high"):
                p = row[f"alarm{end}"]
                assert row[f"exposed{end}"] == pytest.approx(1.0 - (1.0 - p) ** 25, rel=1e-9)
                assert row[f"contribution{end}"] == pytest.approx(row["prior"] * row[f"exposed{end}"])
            assert row["alarm_low"] <= row["alarm"] <= row["alarm_high"]
        priors = {row["fault"]: row["prior"] for row in single}
        assert priors["none"] == 1.0
        assert priors["GPS"] == pytest.approx(1e-8 / 24)
        assert priors["Galileo"] == pytest.approx(1e-4 / 24)
        for name in G.names:
            assert priors[name] == pytest.approx((1e-5 if name.startswith("G") else 2e-5) / 24)
            row = next(row for row in single if row["fault"] == name)
            low, high = clopper_pearson(round(row["alarm"] * DRAWS), DRAWS)
            assert (row["alarm_low"], row["alarm_high"]) == pytest.approx((float(low), float(high)))
        assert single[0]["allocation"] == 1.0
        assert total["allocation"] == LPV_200_CONTINUITY
        assert total["contribution"] == pytest.approx(min(sum(row["contribution"] for row in single), 1.0))
    # Exclusion spares alarms, with a fault and without.
    detection, exclusion = (own.set_index("fault") for _, own in table.groupby("method", sort=False))
    assert (exclusion.alarm.drop("total") <= detection.alarm.drop("total") + 1e-12).all()
    assert exclusion.loc["none"].alarm < 0.1 * detection.loc["none"].alarm


def test_the_false_alarm_budget_is_kept_under_the_noise_that_it_means() -> None:
    (free,) = pl_mc.continuity(G, (araim(),), sizes_m=5.0, draws=16, rare_draws=4096).to_dict("records")[:1]
    allowed = LPV_200_V42.p_fa_vertical + LPV_200_V42.p_fa_horizontal
    assert free["allocation"] == pytest.approx(allowed)
    # Tests share out the budget as if they were apart; they overlap.
    assert 0.5 * allowed < free["contribution_low"] < free["contribution_high"] < allowed
    # Accuracy is what continuity is of: with a smaller URE all is as rare in its own units.
    finer = replace(ISM, sigma_ure_m=0.5)
    (other,) = pl_mc.continuity(G, (araim(ism=finer),), sizes_m=5.0, draws=16, rare_draws=4096).to_dict("records")[:1]
    assert 0.5 * allowed < other["contribution"] < allowed


def test_a_level_beyond_the_limit_alarms_always() -> None:
    tight = pl_mc.AlertLimits("tight", vertical_m=1.0)
    found = pl_mc.continuity(G, (araim(),), sizes_m=5.0, draws=16, rare_draws=4096, alert=tight)
    assert (found[found.fault != "total"][["alarm_low", "alarm"]].iloc[0] == 1.0).all()
    assert found[found.fault == "total"].contribution.iloc[0] == 1.0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"methods": ("ls",)}, "methods: ls: continuity is that of araim"),
        ({"methods": ("araim",)}, "methods: araim: continuity is that of araim"),
        ({"sizes_m": []}, "sizes_m"),
        ({"sizes_m": [np.inf]}, "sizes_m"),
        ({"sizes_m": [5.0, 5.0]}, "sizes_m: one row of different finite sizes"),
        ({"draws": 0}, "draws"),
        ({"rare_draws": 1.5}, "rare_draws"),
        ({"seed": -1}, "seed"),
        ({"required": 1.0}, "required"),
        ({"axis": "up"}, "axis"),
        ({"g": G.as_series()}, "geometry"),
    ],
)
def test_what_cannot_be_used_is_refused(changed, words) -> None:
    with pytest.raises(InputError) as caught:
        pl_mc.continuity(**({"g": G, "methods": (araim(),)} | changed))
    assert str(caught.value).startswith(words)
