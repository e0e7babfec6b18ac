"""Banks of filters: exact truths, a plain reference, the proof of the level, and counts against exact probabilities."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest
from scipy import stats

import pl_mc
from pl_mc.input_errors import InputError
from pl_mc.statistics.intervals import binomial_p_value
from pl_mc.time_ramps import FilterBank, NoiseInTime, SequentialParity, sequential, sequential_levels, time_to_alert
from pl_mc.time_ramps.filter_bank import separation_levels
from pl_mc.time_ramps.filters import CONSTANT_VELOCITY, Gains, bounding_process, filter_model, gains, motion_model
from pl_mc.time_ramps.passes import fault_free_signals, pass_plan
from pl_mc.time_ramps.protection import _filtered, beyond_unseen, true_covariance
from pl_mc.time_ramps.signals import LANES, Rows, pass_key, rows_by_satellite, step_numbers, unit_ramp_m
from pl_mc.time_ramps.windows import WindowTests, largest_ratio

EPOCHS, ONSET, INTERVAL_S, SATELLITE, BLOCKS = 40, 20, 20.0, "G11", 12
NOISE = NoiseInTime(200.0, 0.6, smoothing_s=100.0)
BANKS = (FilterBank(), FilterBank(motion=CONSTANT_VELOCITY, taus_s=(100.0, 900.0)))
LEVEL = 1e-5
COMMON: dict[str, Any] = {"tau_s": 200.0, "share": 0.6, "smoothing_s": 100.0, "onset_s": 400.0, "alert": "APV-I"}


@pytest.fixture(scope="module")
def g() -> pl_mc.Geometry:
    return pl_mc.simulate(start="2017-11-21T09:40:00", epochs=EPOCHS, interval_s=INTERVAL_S, constellations=("GPS",))


@pytest.fixture(scope="module")
def rows(g: pl_mc.Geometry) -> Rows:
    """One satellite rises inside the series, one sets."""
    made = rows_by_satellite(g)
    in_view = made.in_view.copy()
    in_view[:10, made.names.index("G05")] = False
    in_view[33:, made.names.index("G20")] = False
    return dataclasses.replace(
        made, in_view=in_view, design=np.where(in_view[:, :, None], made.design, 0.0),
        sigma_m=np.where(in_view, made.sigma_m, 1.0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def table(g: pl_mc.Geometry) -> pd.DataFrame:
    return sequential_levels(g, SATELLITE, [0.0, 0.02, 0.2, 5.0], BANKS, **COMMON)


def test_a_hatch_filter_leaves_what_is_said_of_it() -> None:
    # Code and carrier with a common motion: the filter itself, sample by sample, on many receivers.
    samples, receivers, n = 900, 4000, 100
    rng = np.random.default_rng(1)
    code = rng.standard_normal((samples, receivers))
    range_m = np.cumsum(rng.standard_normal((samples, receivers)), axis=0)
    smoothed = code[0] + range_m[0]
    errors = [code[0]]
    for k in range(1, samples):
        carrier_step = range_m[k] - range_m[k - 1]
        smoothed = (code[k] + range_m[k]) / n + (1.0 - 1.0 / n) * (smoothed + carrier_step)
        errors.append(smoothed - range_m[k])
    noise = NoiseInTime(0.0, 0.0, smoothing_s=float(n))
    # Exactly: weights (1 - 1/N)^i / N of independent numbers.
    weights = (1.0 - 1.0 / n) ** np.arange(20_000) / n
    np.testing.assert_allclose((weights**2).sum(), 1.0 / (2 * n - 1), rtol=1e-12)
    for lag in (1, 50):
        exact = (weights[lag:] * weights[:-lag]).sum() / (weights**2).sum()
        np.testing.assert_allclose(noise.autocorrelation(lag, 1.0), exact, rtol=1e-12)
    # 4.5 standard errors of a variance from 4000 numbers.
    assert np.var(errors[-1]) * (2 * n - 1) == pytest.approx(1.0, abs=4.5 * np.sqrt(2.0 / receivers))
    assert np.corrcoef(errors[-1], errors[-51])[0, 1] == pytest.approx(noise.autocorrelation(50, 1.0), abs=0.06)
    # Without smoothing code noise is white, as it was.
    assert NoiseInTime(100.0, 0.5).autocorrelation([0, 1], 100.0) == pytest.approx([1.0, 0.5 * np.exp(-1.0)])


def test_a_receiver_that_stands_still_under_white_errors_has_weighted_least_squares(rows: Rows) -> None:
    still = FilterBank(position_m=1e-9, clock_m=1e-9)
    model = filter_model(still, rows, NoiseInTime(0.0, 0.0), coloured=False)
    uses = np.concatenate([np.ones((1, len(rows.names))), 1.0 - np.eye(len(rows.names))])
    found = np.sqrt(gains(model, uses).up_variance_m2)
    for epoch in (3, EPOCHS - 1):
        for f, use in enumerate(uses):
            # All epochs stacked, and what the filter knows beforehand.
            information = np.diag(1.0 / model.start_root**2)
            for k in range(epoch + 1):
                keep = rows.in_view[k] & (use > 0)
                a = rows.design[k, keep] / rows.sigma_m[k, keep, None]
                information = information + a.T @ a
            np.testing.assert_allclose(found[epoch, f], np.sqrt(np.linalg.inv(information)[2, 2]), rtol=1e-6)


@pytest.mark.parametrize("bank", [BANKS[0], dataclasses.replace(BANKS[1], taus_s=None)])
def test_a_separation_has_the_difference_of_the_variances(rows: Rows, bank: FilterBank) -> None:
    model, made = bank.filters(rows, NOISE)
    place = rows.names.index(SATELLITE)
    both = Gains(made.gain[:, [0, 1 + place]], made.weight, made.up_variance_m2)
    found = true_covariance(model, both, model)
    sigma2 = made.up_variance_m2[:, [0, 1 + place]]
    np.testing.assert_allclose(found[:, 0, 0], sigma2[:, 0], rtol=1e-6)
    np.testing.assert_allclose(found[:, 1, 1], sigma2[:, 1] - sigma2[:, 0], atol=1e-6 * sigma2.max())
    # What the estimate of all satellites knows more is uncorrelated with its error.
    np.testing.assert_allclose(found[:, 0, 1], 0.0, atol=1e-6 * sigma2.max())


def test_the_bounding_process_exceeds_all_in_its_interval() -> None:
    low, high = 50.0, 2000.0
    tau, factor = bounding_process(low, high)
    assert (tau, factor) == pytest.approx((np.sqrt(low * high), np.sqrt(high / low)))
    assert bounding_process(70.0, 70.0) == (70.0, 1.0)
    # Samples at unequal times.
    times = np.cumsum(np.random.default_rng(3).exponential(30.0, 150))
    lags = np.abs(np.subtract.outer(times, times))
    for true in (low, 120.0, tau, 900.0, high):
        excess = factor * np.exp(-lags / tau) - np.exp(-lags / true)
        assert np.linalg.eigvalsh(excess).min() > -1e-9
    # Neither end of the interval bounds the other.
    assert np.linalg.eigvalsh(np.exp(-lags / high) - np.exp(-lags / low)).min() < -0.1
    assert np.linalg.eigvalsh(np.exp(-lags / low) - np.exp(-lags / high)).min() < -0.1


def test_a_level_of_uncertain_times_holds_where_one_of_a_wrong_time_does_not(g: pl_mc.Geometry) -> None:
    banks = (FilterBank(taus_s=(20.0, 2000.0)), FilterBank(taus_s=(20.0, 20.0)), FilterBank(taus_s=(2000.0, 2000.0)))
    bounded, short, long = banks
    most = {bank.name: [] for bank in banks}
    for tau_s in (20.0, 60.0, 200.0, 600.0, 2000.0):
        found = sequential_levels(g, SATELLITE, [0.0], banks, **COMMON | {"tau_s": tau_s}).set_index("method")
        for name, ratios in most.items():
            ratios.append(found.sigma_ratio[name])
    assert max(most[bounded.name]) <= 1.0
    # Where the assumed time is the true one all is as claimed; the short one is believed to average what stays.
    assert most[short.name][0] == pytest.approx(1.0, abs=1e-6)
    assert most[long.name][-1] == pytest.approx(1.0, abs=1e-6)
    assert most[short.name][-1] > 1.1


def numpy_bank(bank: FilterBank, rows: Rows, noise_m: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Separations (T, m) and the vertical error (T,) of one lane, each filter alone, satellites left out of it."""
    count, slow, share = len(rows.names), NOISE.correlation(INTERVAL_S), NOISE.share
    if bank.taus_s is not None:
        low, high = bank.taus_s
        slow, share = np.exp(-INTERVAL_S / np.sqrt(low * high)), share * np.sqrt(high / low)
    code = 1.0 - INTERVAL_S / 100.0
    transition, root, start = motion_model(bank, rows.design.shape[2], INTERVAL_S)
    base = len(start)
    f = np.diag(np.concatenate([np.zeros(base), np.full(count, slow), np.full(count, code)]))
    q = np.diag(np.concatenate([np.zeros(base), np.full(count, 1 - slow**2), np.full(count, 1 - code**2)]))
    f[:base, :base], q[:base, :base] = transition, root @ root.T
    ups, true = np.zeros((EPOCHS, count + 1)), np.zeros(base)
    states = [(np.zeros(len(f)), np.diag(np.concatenate([start**2, np.ones(2 * count)]))) for _ in range(count + 1)]
    for k in range(EPOCHS):
        true = start * numbers[k, :base] if k == 0 else transition @ true + root @ numbers[k, :base]
        for j in range(count + 1):
            x, p = states[j]
            if k:
                x, p = f @ x, f @ p @ f.T + q
            for i in np.flatnonzero(rows.in_view[k]):
                if i == j - 1:
                    continue
                # One satellite after the other, in Joseph's form.
                h = np.zeros(len(f))
                h[: rows.design.shape[2]] = rows.design[k, i]
                h[base + i] = np.sqrt(share) * rows.sigma_m[k, i]
                h[base + count + i] = np.sqrt(1.0 - NOISE.share) * rows.sigma_m[k, i]
                gain = p @ h / (h @ p @ h)
                x = x + gain * (noise_m[k, i] + h[:base] @ true - h @ x)
                left = np.eye(len(f)) - np.outer(gain, h)
                p = left @ p @ left.T
            states[j] = x, p
            ups[k, j] = x[2] - true[2]
    return ups[:, 1:] - ups[:, :1], ups[:, 0]


@pytest.mark.parametrize("which", [0, 1])
def test_the_bank_is_that_of_a_plain_reference(rows: Rows, which: int) -> None:
    bank, lane = BANKS[which], 17
    plan = pass_plan((bank,), rows, NOISE, unit_ramp_m(rows, SATELLITE, ONSET), ONSET, 20.0)
    key = pass_key(np.uint32(7), np.uint32(0), np.uint32(0))
    signals = jax.tree.map(np.asarray, jax.jit(fault_free_signals)(plan, key))
    times = np.arange(EPOCHS, dtype=np.int32)
    numbers = jax.jit(jax.vmap(lambda t: step_numbers(key, t, len(rows.names), plan.sequential[0].motions)[2]))(times)
    noise_m = np.asarray(signals.noise)[:, :, lane] * rows.sigma_m
    separation, up = numpy_bank(bank, rows, noise_m, np.asarray(numbers)[:, :, lane])
    np.testing.assert_allclose(signals.sums[0][:, :, lane], separation, atol=1e-5)
    np.testing.assert_allclose(signals.up_m[0][:, lane], up, atol=1e-5)
    # The ramp is linear: a bank that is given it differs by its response.
    ramp = 0.05 * unit_ramp_m(rows, SATELLITE, ONSET)
    ramped, up_ramped = numpy_bank(bank, rows, noise_m + ramp, np.asarray(numbers)[:, :, lane])
    np.testing.assert_allclose(up_ramped - up, 0.05 * np.asarray(plan.sequential[0].up_m), atol=1e-5)
    tests = plan.sequential[0].tests
    one = WindowTests(np.asarray(tests.whitener)[-1], np.asarray(tests.response)[-1], tests.samples)
    total = [signals.sums[0][-1]] * len(tests.samples)
    ratio = np.asarray(jax.jit(largest_ratio)(one, total, np.array([0.05])))[0, lane]
    threshold = separation_levels(bank, rows, np.sqrt(bank.filters(rows, NOISE)[1].up_variance_m2)).threshold_m[-1]
    assert ratio == pytest.approx(np.max(ramped[-1] ** 2 / threshold**2), rel=1e-5)


@pytest.mark.parametrize("assumed", [None, (20.0, 20.0)])
def test_what_is_counted_has_its_exact_probability(rows: Rows, assumed: tuple[float, float] | None) -> None:
    # Also where the filters believe a wrong correlation time.
    bank, place = FilterBank(taus_s=assumed), rows.names.index(SATELLITE)
    ramp_m = unit_ramp_m(rows, SATELLITE, ONSET)
    plan = pass_plan((bank,), rows, NOISE, ramp_m, ONSET, 20.0)
    make = jax.jit(lambda block: fault_free_signals(plan, pass_key(np.uint32(5), np.uint32(0), block)))
    parts = [jax.tree.map(np.asarray, make(np.uint32(block))) for block in range(BLOCKS)]
    found = _filtered(bank, rows, NOISE, ramp_m, place, ONSET)
    for epoch in (25, EPOCHS - 1):
        at = epoch - ONSET
        separation = np.concatenate([np.asarray(one.sums[0][epoch, place]) for one in parts])
        error = np.concatenate([np.asarray(one.up_m[0][epoch]) for one in parts])
        covariance = found.covariance_m2[at]
        for values, variance in ((error, covariance[0, 0]), (separation, covariance[1, 1])):
            assert stats.kstest(values / np.sqrt(variance), "norm").pvalue > LEVEL
        # A ramp that takes the separation to its threshold, a level that the error often passes.
        threshold = np.full(1, 2.0 * np.sqrt(covariance[1, 1]))
        rate = threshold[0] / abs(found.up_m[at, 1])
        means = rate * found.up_m[at : at + 1]
        level = np.full(1, abs(means[0, 0]))
        expected = float(beyond_unseen(level, threshold, means, covariance[None])[0])
        counted = (np.abs(error + means[0, 0]) > level) & (np.abs(separation + means[0, 1]) <= threshold)
        assert 0.05 < expected < 0.6
        assert binomial_p_value(int(counted.sum()), BLOCKS * LANES, expected) > LEVEL


def test_beyond_unseen_is_the_law_of_two_normal_numbers() -> None:
    covariance = np.array([[[4.0, 1.5], [1.5, 2.0]]])
    mean = np.array([[3.0, -1.0]])
    law = stats.multivariate_normal(mean[0], covariance[0], abseps=1e-12, releps=1e-12, maxpts=10**6)
    passes = law.cdf([np.inf, 2.0]) - law.cdf([np.inf, -2.0])
    inside = law.cdf([4.0, 2.0]) - law.cdf([4.0, -2.0]) - law.cdf([-4.0, 2.0]) + law.cdf([-4.0, -2.0])
    found = beyond_unseen(np.array([4.0]), np.array([2.0]), mean, covariance)
    np.testing.assert_allclose(found, passes - inside, rtol=1e-7)
    # Independent numbers: the product, also far out, where ten times the threshold is the mean of the separation.
    apart = np.array([[[4.0, 0.0], [0.0, 2.0]]])
    for shift in (1.0, 20.0):
        found = beyond_unseen(np.array([9.0]), np.array([2.0]), np.array([[3.0, shift]]), apart)
        seen = stats.norm.cdf(2.0, shift, np.sqrt(2.0)) - stats.norm.cdf(-2.0, shift, np.sqrt(2.0))
        np.testing.assert_allclose(found, (stats.norm.sf(3.0) + stats.norm.cdf(-6.0)) * seen, rtol=1e-9)


def test_snapshots_have_the_levels_of_araim(g: pl_mc.Geometry, table: pd.DataFrame) -> None:
    levels = pl_mc.araim.protection_levels(
        g.design, g.sigma_m**2, g.sigma_m**2, systems=["G"] * g.design.shape[1], b_nom=0.0, p_sat=1e-5,
        p_const={"G": 0.0}, budget=pl_mc.araim.LPV_200, in_view=g.in_view, unmonitored="plain",
    )  # fmt: skip
    expected = np.asarray(levels.vpl_m)[ONSET:]
    own = table[table.method == "snapshot"].iloc[0]
    assert own.vpl_mean_m == pytest.approx(expected.mean(), abs=1e-6)
    assert own.vpl_max_m == pytest.approx(expected.max(), abs=1e-6)


def test_what_misleads_is_within_what_the_level_allows(table: pd.DataFrame) -> None:
    assert set(table.method) == {"snapshot", *(bank.name for bank in BANKS)}
    assert (table.sigma_ratio <= 1.0 + 1e-6).all()
    assert (table.misleading <= table.misleading_bound * (1.0 + 1e-9)).all()
    assert (table[table.rate_m_per_s > 0].misleading > 1e-9).any()
    times = table.pivot(index="rate_m_per_s", columns="method", values="alarm_50_s").iloc[1:]
    assert (times.diff().iloc[1:] <= 0).all().all()
    # A filter that remembers has the smaller level, and hears a slow ramp sooner.
    first, bank = (table[table.method == name].set_index("rate_m_per_s") for name in ("snapshot", "filter_bank"))
    assert (bank.vpl_mean_m < first.vpl_mean_m).all()
    assert bank.alarm_50_s[0.2] <= first.alarm_50_s[0.2]
    assert (table[table.rate_m_per_s == 0].alarm_50_s == np.inf).all()


def test_order_and_scale_change_nothing(g: pl_mc.Geometry, table: pd.DataFrame) -> None:
    turned = np.argsort(np.where(g.in_view, -g.satellite, 1), axis=1, kind="stable")
    moved = {name: np.take_along_axis(getattr(g, name), turned, axis=1) for name in ("sigma_m", "in_view", "satellite")}
    other = dataclasses.replace(g, design=np.take_along_axis(g.design, turned[:, :, None], axis=1), **moved)
    again = sequential_levels(other, SATELLITE, [0.0, 0.02, 0.2, 5.0], BANKS, **COMMON)
    pd.testing.assert_frame_equal(again, table, rtol=1e-6)
    # Twice the errors, the motion, the ramp and the limits: twice the levels. But for what filters know beforehand,
    # 100 m, against which the sigma of a few metres of the weakest of them counts with its square, below 1e-3.
    double = dataclasses.replace(g, sigma_m=np.where(g.in_view, 2.0 * g.sigma_m, 1.0))
    bank = FilterBank(position_m=0.6, clock_m=6.0)
    limits = pl_mc.AlertLimits("twice", vertical_m=2 * pl_mc.APV_I.vertical_m)
    scaled = sequential_levels(double, SATELLITE, [0.4], (bank,), **COMMON | {"alert": limits})
    plain = table[(table.rate_m_per_s == 0.2) & table.method.isin(["snapshot", "filter_bank"])]
    for column in ("vpl_mean_m", "vpl_max_m", "sigma_mean_m", "error_at_alarm_50_m"):
        np.testing.assert_allclose(scaled[column], 2.0 * plain[column], rtol=1e-3)
    for column in ("misleading", "missed"):
        np.testing.assert_allclose(scaled[column], plain[column], rtol=0.02)
    for column in ("alarm_50_s", "alarm_95_s", "available"):
        np.testing.assert_array_equal(scaled[column], plain[column])


def test_a_bank_takes_part_in_the_time_to_alert(g: pl_mc.Geometry) -> None:
    found = time_to_alert(
        g, SATELLITE, [0.0, 1000.0], ("ls", SequentialParity((0.0, 100.0)), BANKS[0]), tau_s=200.0, share=0.6,
        smoothing_s=100.0, draws=300, seed=3, onset_s=400.0, p_fa=0.05, calibration_draws=1000,
        alert=pl_mc.APV_I, progress=False,
    )  # fmt: skip
    assert list(found.method[:3]) == ["ls", "sequential_parity[0+100 s]", "filter_bank"]
    assert (found[found.rate_m_per_s > 0].alert_after_onset_95_s == INTERVAL_S).all()
    assert (found.false_alarms > 10).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"taus_s": (900.0, 100.0)}, "taus_s: the shortest and the longest"),
        ({"taus_s": (100.0,)}, "taus_s: the shortest and the longest"),
        ({"taus_s": 100.0}, "taus_s"),
        ({"taus_s": (0.0, 100.0)}, "taus_s"),
        ({"taus_s": (1e-300, 1e300)}, "taus_s: a number from 0.001 to 1e"),
        ({"position_m": 1e10}, "position_m: a number from 1e-09 to 10000 is needed"),
        ({"velocity_m_per_s": 1e300, "motion": CONSTANT_VELOCITY}, "velocity_m_per_s: a number from"),
        ({"p_sat": 0.0}, "p_sat"),
        ({"motion": "walk"}, "motion"),
        ({"budget": "LPV-200 v4.2"}, "nearest: standard='v4.2'"),
    ],
)
def test_a_bank_that_cannot_be_used_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match="filter_bank") as caught:
        sequential("filter_bank", **options)
    assert words in str(caught.value)


def test_levels_that_cannot_be_had_are_refused(g: pl_mc.Geometry) -> None:
    for changed, words in (
        ({"smoothing_s": 30.0}, "smoothing_s: a whole number of intervals"),
        ({"onset_s": 0.0}, "onset_s"),
        ({"banks": ()}, "banks"),
        ({"satellite": "G99"}, "satellite"),
        ({"rates_m_per_s": [np.nan]}, "rates_m_per_s"),
    ):
        given = {"satellite": SATELLITE, "rates_m_per_s": [0.1], "banks": BANKS} | COMMON | changed
        with pytest.raises(InputError, match="^" + words.split(":")[0]) as caught:
            sequential_levels(g, **given)
        assert words in str(caught.value)


def test_a_satellite_that_nothing_checks_has_no_level_under_its_ramp() -> None:
    four = pl_mc.simulate(
        start="2017-11-21T09:40:00",
        epochs=EPOCHS,
        interval_s=INTERVAL_S,
        constellations=("GPS",),
        without=("G05", "G10"),
    )
    assert (four.satellite_count == 4).all()
    with pytest.raises(InputError, match=r"^satellite: without G11 some epochs of the pass have no position"):
        sequential_levels(four, SATELLITE, [0.1], BANKS, **COMMON)
