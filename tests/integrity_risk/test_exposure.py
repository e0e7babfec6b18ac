"""Exposures: independent samples, an error that stays, and what lies between."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.rare.exposure import exposure
from pl_mc.statistics.intervals import binomial_p_value
from reference.problems import random_geometry

G = random_geometry(np.random.default_rng(64), counts=(4, 3), noise=4.0)
FAULTS = pl_mc.no_fault(G) + pl_mc.biases(G, {"G02": 10.0})
DRAWS, SAMPLES = 5000, 20
TAUS = (0.0, 1.0, 8.0, np.inf)


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return exposure(
        G, FAULTS, tau_s=TAUS, draws=DRAWS, seed=3, duration_s=10.0, interval_s=0.5, methods=("ls",), progress=False
    )


def test_independent_samples_and_one_that_stays_are_binomial(table: pd.DataFrame) -> None:
    exact = pl_mc.exact.ls_rates(G, FAULTS).set_index("fault")
    for row in table[table.event.isin(["alarm", "misleading", "hazard"])].itertuples():
        rate = exact.loc[row.fault, f"{row.event}_rate"]
        assert row.samples == SAMPLES
        # Whatever the correlation, every sample has the exact rate; 4.9 errors are 1e-6.
        if row.samples_with > 100:
            assert abs(row.sample_rate - rate) < 4.9 * row.sample_error
        if row.tau_s == 0.0:
            expected = -np.expm1(SAMPLES * np.log1p(-rate))
            assert binomial_p_value(row.exposures_with, DRAWS, expected) > 1e-6
            assert binomial_p_value(row.samples_with, DRAWS * SAMPLES, rate) > 1e-6
        if np.isinf(row.tau_s):
            assert row.samples_with == SAMPLES * row.exposures_with
            assert binomial_p_value(row.exposures_with, DRAWS, rate) > 1e-6
            assert row.exposures_with == 0 or row.effective_samples == pytest.approx(1.0)


def test_the_effective_number_falls_from_all_samples_to_one(table: pd.DataFrame) -> None:
    rows = table[(table.event == "misleading") & (table.fault != "none")].set_index("tau_s")
    assert (rows.exposures_with >= 20).all()
    assert rows.effective_low[0.0] < SAMPLES < rows.effective_high[0.0]
    assert rows.effective_low[0.0] > rows.effective_high[1.0] > rows.effective_low[1.0] > rows.effective_high[8.0]
    assert rows.effective_low[8.0] > 1.0


def test_bounds_are_given_from_ten_exposures_on(table: pd.DataFrame) -> None:
    few = (table.exposures_with < 10) | (table.exposures_with == DRAWS)
    assert table.effective_low[few].isna().all()
    assert table.effective_low[~few].notna().all()
    assert (table.any_high[table.exposures_with == 0] > 0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"interval_s": 0.7}, "whole intervals make a duration, but 10.0 s is 14.2857 times 0.7 s"),
        ({"tau_s": -1.0}, "tau_s: a correlation time of at least 0 s"),
        ({"tau_s": "long"}, "tau_s: it cannot be read as an array of numbers"),
        ({"noise": pl_mc.noise_models.GaussMarkov(3.0)}, "no rate per epoch changes"),
        ({"draws": 0}, "draws: a whole number of at least 1|draws: a whole number from 1"),
    ],
)
def test_what_cannot_be_used_says_why(options: dict, message: str) -> None:
    given = {"tau_s": 1.0, "draws": 10, "seed": 1, "duration_s": 10.0, "methods": ("ls",), "progress": False}
    with pytest.raises(InputError, match=message):
        exposure(G, FAULTS, **(given | options))
