"""Time to alert: what is found at once, what is shared, how it is counted, and the experiment made of it."""

from __future__ import annotations

import math
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.studies.time_ramps.run import comparable
from pl_mc.time_ramps import FilterBank, KalmanInnovation, SequentialParity, time_to_alert
from pl_mc.time_ramps.passes import Watched, watch_sample
from pl_mc.time_ramps.signals import pass_key, step_numbers
from pl_mc.time_ramps.timing import calibrated, quantile_bounds, timing_columns

SKY = {"start": "2017-11-21T09:40:00", "epochs": 40, "interval_s": 10.0, "constellations": ["GPS"]}
TESTS = ("ls", "slope", "parity", SequentialParity((0.0, 50.0)), KalmanInnovation((0.0, 50.0), guards="filter"))
RATES = (0.0, 0.1, 1000.0)
OPTIONS = {"draws": 300, "seed": 3, "onset_s": 100.0, "p_fa": 0.05, "calibration_draws": 1000, "progress": False}


@pytest.fixture(scope="module")
def g() -> pl_mc.Geometry:
    return pl_mc.simulate(**SKY)


@pytest.fixture(scope="module")
def table(g: pl_mc.Geometry) -> pd.DataFrame:
    return time_to_alert(g, "G11", RATES, TESTS, tau_s=60.0, alert=pl_mc.APV_II, **OPTIONS)


def test_a_large_step_is_found_at_once(table: pd.DataFrame) -> None:
    # At the first sample after the onset the error is 10 km.
    rows = table[table.rate_m_per_s == 1000.0]
    assert len(rows) == len(TESTS)
    assert (rows.detected == 300).all()
    assert (rows.alert_after_onset_95_s == 10.0).all()
    assert (rows.hazards == 300).all()
    assert (rows.alert_after_hazard_50_s == 0.0).all()
    assert (rows.within_6 == 300).all()
    assert (rows.late_6 == 0).all()
    assert (rows.late_6_high > 0).all()


def test_no_ramp_alarms_as_often_as_a_pass_may(table: pd.DataFrame) -> None:
    for row in table.itertuples():
        # Both the threshold and the check are counted: a difference of two binomial numbers, 4.5 sigma.
        assert abs(row.false_alarms - 50) < 4.5 * math.sqrt(2 * 1000 * 0.05 * 0.95)
        assert row.false_alarm_low < row.false_alarm_rate < row.false_alarm_high
    none = table[table.rate_m_per_s == 0.0]
    # The threshold's own share scatters by that of 1000 passes.
    spread = math.sqrt(300 * 0.05 * 0.95 * (1 + 300 / 1000))
    assert (abs(none.detected - 15) < 4.5 * spread).all()


def test_slope_and_parity_are_one_test(table: pd.DataFrame) -> None:
    first, second = (table[table.method == name].drop(columns="method") for name in ("slope", "parity"))
    for column in first:
        np.testing.assert_allclose(first[column], second[column], rtol=1e-9)


def test_every_method_sees_the_same_errors(table: pd.DataFrame) -> None:
    # Hazards are those of one position for all that guard the same.
    guarded = table[table.method.isin(["ls", "slope", "parity", "sequential_parity[0+50 s]"])]
    assert (guarded.groupby("rate_m_per_s").hazards.nunique() == 1).all()
    # What filters need for the motion leaves the errors as they are without any filter.
    key = pass_key(np.uint32(3), np.uint32(0), np.uint32(1))
    make = jax.jit(step_numbers, static_argnums=(2, 3))
    without, with_motion = (make(key, np.int32(5), 6, motions) for motions in (0, 7))
    for first, second in zip(without[:2], with_motion[:2], strict=True):
        np.testing.assert_array_equal(first, second)


def test_no_solution_is_an_alarm_and_takes_the_method_out_of_the_comparison() -> None:
    never = np.full((1, 1, 2), -1, np.int32)
    before = Watched(np.zeros((1, 1, 2)), never, never, np.zeros((1, 1, 2)))
    ratios, errors_m = np.array([[[np.inf, 0.5]]]), np.array([[[np.inf, 40.0]]])
    after = jax.jit(watch_sample)(before, np.int32(4), ratios, errors_m, np.array([np.inf]), 35.0)
    assert np.asarray(after.alarm).tolist() == [[[4, -1]]]
    assert np.asarray(after.hazard).tolist() == [[[-1, 4]]]
    rows = pd.DataFrame({"method": ["a", "b", "a", "b"], "threshold": [1.0, 2.0, np.inf, 3.0]})
    assert comparable(rows).method.tolist() == ["b", "b"]


def test_passes_are_counted_as_said() -> None:
    alarm = np.array([-1, 4, 9, 9, -1, 12, -1])
    hazard = np.array([-1, 6, 8, 2, 1, -1, 18])
    error = np.array([0.0, 5.0, 21.0, 30.0, 0.0, 3.0, 0.0])
    row = timing_columns(alarm, hazard, error, samples=20, interval_s=1.0)
    assert (row["passes"], row["detected"], row["hazards"], row["monitored_s"]) == (7, 4, 5, 19.0)
    # After the hazard: -2 (13 s left), 1 (11 s left), 7 (17 s left), never (18 s left), never (1 s left).
    assert (row["within_6"], row["late_6"], row["undecided_6"]) == (2, 2, 1)
    assert (row["within_10"], row["late_10"], row["undecided_10"]) == (3, 1, 1)
    # The whole pass is too short for it.
    assert (row["within_30"], row["late_30"], row["undecided_30"]) == (0, 0, 5)
    assert row["late_6_rate"] == pytest.approx(2 / 6)
    assert row["within_6_rate"] == pytest.approx(2 / 4)
    assert row["alert_after_hazard_50_s"] == 7.0
    assert row["alert_after_hazard_95_s"] == math.inf
    assert row["alert_after_onset_50_s"] == 12.0
    assert row["error_at_alert_50_m"] == 5.0


def test_the_end_of_the_pass_favours_no_alarm() -> None:
    """Hazards up to the end, delays exponential with a mean of 10 s: within L come 1 - exp(-L / 10)."""
    rng = np.random.default_rng(9)
    passes, samples, interval_s = 40_000, 601, 0.1
    hazard = rng.integers(samples // 2, samples, passes)
    alarm = hazard + np.ceil(rng.exponential(10.0, passes) / interval_s).astype(int)
    alarm = np.where(alarm < samples, alarm, -1)
    row = timing_columns(alarm, hazard, np.zeros(passes), samples, interval_s)
    for limit, left in ((6, 240), (10, 200), (30, 0)):
        decided = row[f"decided_{limit}"]
        # Of 301 samples 240, 200 and none leave more than the limit, and one leaves just that.
        assert decided == (hazard <= samples - 1 - limit / interval_s).sum()
        assert decided > 0.9 * passes * left / 301
        assert decided + row[f"undecided_{limit}"] == row["hazards"] == passes
        within = 1.0 - math.exp(-limit / 10.0)
        assert abs(row[f"within_{limit}_rate"] - within) < 4.5 * math.sqrt(within * (1.0 - within) / decided)


def test_quantiles_have_the_bounds_of_order_statistics() -> None:
    # Ten values: the second and the ninth enclose the median with P(2 <= Binomial(10, 1/2) <= 8) = 97.9 %.
    assert quantile_bounds(np.arange(1.0, 11.0), 0.5) == (5.0, 2.0, 9.0)
    assert quantile_bounds(np.arange(1.0, 11.0), 0.95)[2] == math.inf
    assert all(math.isnan(one) for one in quantile_bounds([], 0.5))


@pytest.mark.parametrize("p_fa", [0.01, 0.05, 0.5])
def test_thresholds_leave_the_share_beyond_them(p_fa: float) -> None:
    largest = np.random.default_rng(4).gamma(2.0, size=(3, 777))
    beyond = (largest > calibrated(largest, p_fa)[:, None]).sum(axis=1)
    assert (beyond == math.floor(p_fa * 777)).all()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"satellite": "G1"}, "satellite: 'G1' is unknown"),
        ({"methods": ("igg",)}, "method: 'igg' is unknown"),
        ({"methods": ("nioraim",)}, "methods: nioraim has no statistic"),
        ({"methods": (pl_mc.methods.Sbas(),)}, "methods: sbas has no statistic"),
        ({"methods": (SequentialParity((500.0,)),)}, "is not full when the ramp begins at 100 s; nearest: 100 s"),
        ({"methods": (SequentialParity((15.0,)),)}, "a whole number of intervals of 10 s"),
        ({"rates_m_per_s": [1.0, 1.0]}, "one row of different rates of up to 1e.06 m/s"),
        ({"tau_s": -1.0}, "tau_s: a correlation time of at least 0 s"),
        ({"share": 1.0}, "share: a share of the variance from 0 to 0.999"),
        ({"onset_s": 390.0}, "onset_s: it lies between"),
        ({"p_fa": 0.0}, "p_fa: it lies between 0 and 1"),
        ({"calibration_draws": 10}, "calibration_draws: a whole number from 200"),
    ],
)
def test_what_cannot_be_used_says_why(g: pl_mc.Geometry, changed: dict, message: str) -> None:
    given = {"satellite": "G11", "rates_m_per_s": [1.0], "methods": ("ls",), **OPTIONS} | changed
    with pytest.raises(InputError, match=message):
        time_to_alert(g, **given)


def test_a_single_epoch_or_a_setting_satellite_is_no_pass(g: pl_mc.Geometry) -> None:
    with pytest.raises(InputError, match="needs a series of epochs"):
        time_to_alert(g[0], "G11", [1.0])
    long = pl_mc.simulate(**(SKY | {"epochs": 60, "interval_s": 900.0, "constellations": ["GPS", "BDS-2"]}))
    with pytest.raises(InputError, match=r"G11 is out of view at .* epochs of the ramp"):
        time_to_alert(long, "G11", [1.0], ("ls",), onset_s=900.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SequentialParity(()),
        lambda: SequentialParity((10.0, 10.0)),
        lambda: SequentialParity(p_fa=1.0),
        lambda: KalmanInnovation(motion="walk"),
        lambda: KalmanInnovation(clock_m=0.0),
        lambda: KalmanInnovation(coloured=1),
    ],
)
def test_options_are_checked(make) -> None:
    with pytest.raises(InputError, match=r"sequential_parity|kalman"):
        make()


def test_the_experiment_writes_what_the_function_returns(table: pd.DataFrame, tmp_path: Path) -> None:
    content = {
        "kind": "time-ramps", "title": "small", "seed": 3, "alert": "APV-II", "geometry": SKY, "satellite": "G11",
        "rates_m_per_s": list(RATES), "taus_s": [60.0], "draws": 300, "calibration_draws": 1000, "p_fa": 0.05,
        "onset_s": 100.0, "methods": [{"name": "ls"}, {"name": "slope"}, {"name": "parity"}],
        "sequential": [
            {"name": "sequential_parity", "windows_s": [0.0, 50.0]},
            {"name": "kalman", "windows_s": [0.0, 50.0], "guards": "filter"},
        ],
    }  # fmt: skip
    result = run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    found = pd.read_csv(tmp_path / "out" / "time_to_alert.csv")
    pd.testing.assert_frame_equal(found, table, check_dtype=False, rtol=1e-9)
    for name in ("time_to_alert.png", "late_alerts.png"):
        assert (tmp_path / "out" / name).stat().st_size > 20_000
    assert len(result.answer) == 3
    assert "slope, parity" in result.summary


def test_an_experiment_with_a_bank_has_its_levels(tmp_path: Path) -> None:
    content = {
        "kind": "time-ramps", "title": "bank", "seed": 3, "alert": "LPV-200", "geometry": SKY, "satellite": "G11",
        "rates_m_per_s": [0.0, 1.0], "taus_s": [60.0, 600.0], "smoothing_s": 100.0, "draws": 50,
        "calibration_draws": 1000, "p_fa": 0.05, "onset_s": 100.0, "methods": [{"name": "ls"}],
        "sequential": ["filter_bank", {"name": "filter_bank", "taus_s": [60.0, 60.0]}],
    }  # fmt: skip
    result = run_experiment("bank", build_experiment(content, source="test"), tmp_path / "out")
    found = pd.read_csv(tmp_path / "out" / "levels.csv")
    g = pl_mc.simulate(**SKY)
    banks = (FilterBank(), FilterBank(taus_s=(60.0, 60.0)))
    own = pl_mc.sequential_levels(g, "G11", [0.0, 1.0], banks, tau_s=600.0, onset_s=100.0)
    later = found[found.tau_s == 600.0].reset_index(drop=True)
    pd.testing.assert_frame_equal(later, own, check_dtype=False, rtol=1e-9)
    assert (tmp_path / "out" / "levels.png").stat().st_size > 20_000
    assert len(result.answer) == 3
    # The bank that believes in 60 s is wrong about 600 s, and named.
    assert "those of filter_bank(taus_s=60-60) rest on standard deviations that are exceeded" in result.answer[-1]
    assert "## Levels, exactly" in result.summary
    assert "code noise smoothed over 100 s" in result.summary
