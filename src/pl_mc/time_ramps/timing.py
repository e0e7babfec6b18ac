"""Time to alert: from the beginning of a ramp, and of the hazard, to the alarm, at one false-alarm rate for all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import jax
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from pl_mc.alert import EITHER, LPV_200, VERTICAL, AlertLimits, as_axis
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.calls import Chunk, Cut, run_calls
from pl_mc.engine.checks import LARGEST_SEED, require_geometry_and_alert
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_fraction, require_numbers, require_whole, require_within
from pl_mc.kernels.parameters import as_trees
from pl_mc.methods import METHODS, Method
from pl_mc.methods.capabilities import refusal
from pl_mc.methods.registry import fit_for
from pl_mc.named import as_records, build_named, registry
from pl_mc.runtime.precision import on_device, precision_scope
from pl_mc.runtime.progress import progress_bar
from pl_mc.statistics.intervals import clopper_pearson, rate_columns
from pl_mc.time_ramps.filter_bank import FilterBank
from pl_mc.time_ramps.kalman_innovation import KalmanInnovation
from pl_mc.time_ramps.passes import Test, Watched, has_ratio, pass_plan, watch_block
from pl_mc.time_ramps.sequential import SequentialTest
from pl_mc.time_ramps.sequential_parity import SequentialParity
from pl_mc.time_ramps.signals import NoiseInTime, Rows, rows_by_satellite, unit_ramp_m, whole_samples

CONFIDENCE = 0.95
# No error grows faster; its square has to be a number.
_MOST_RATE = 1e6
LIMITS_S = (6, 10, 30)
QUANTILES = (50, 95)
SEQUENTIAL = registry("sequential test", {
    "sequential_parity": SequentialParity, "kalman": KalmanInnovation, "filter_bank": FilterBank,
})  # fmt: skip
DEFAULT_METHODS = ("ls", "igg3", "slope", "parity", "w_test", "araim", "sequential_parity", "kalman")

# Passes of the calibration, of its check, and with ramps are independent of each other.
_CALIBRATION, _CHECK, _RAMPS = 0, 1, 2
_MOST_DRAWS = 2**20
# With fewer passes beyond the threshold it would hang on one or two of them.
_FEWEST_BEYOND = 10


@ordinary_arithmetic
def time_to_alert(
    g_series: Geometry,
    satellite: str,
    rates_m_per_s: ArrayLike,
    methods: Sequence[str | Test] = DEFAULT_METHODS,
    *,
    tau_s: float = 100.0,
    draws: int = 1000,
    seed: int = 0,
    share: float = 0.5,
    smoothing_s: float = 0.0,
    onset_s: float = 300.0,
    p_fa: float = 0.01,
    calibration_draws: int = 4000,
    alert: str | AlertLimits = LPV_200,
    axis: Literal["vertical", "horizontal"] | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """How long an error that grows on one satellite stays unseen, method by method, at equal false-alarm rates.

    The ramp begins at ``onset_s`` and grows to the end of the series. Errors of satellites are Gaussian with code
    noise, white or smoothed by the carrier, and a Gauss-Markov part (`NoiseInTime`); every method and every rate sees
    the same ones. A pass is what lies between the onset and the end: thresholds are set, on fault-free passes of their
    own, so that a share ``p_fa`` of passes has at least one alarm, and the share is counted again on others.

    An alarm is the first sample from the onset on at which the method's statistic is beyond its threshold; the
    hazard begins with the first at which the error is beyond the limit, even if noise takes it back again. The
    time to alert is the difference; it is negative where the alarm comes first. Errors are those of the position
    that a method guards: IGG-III's own and other M-estimates' own, that of all satellites of a bank
    of filters, a Kalman filter's own if asked for, else that of least squares. What each statistic is:
    `pl_mc.time_ramps.passes`, `SequentialParity`, `KalmanInnovation`, `FilterBank`.

    Args:
        g_series: epochs at equal intervals; the requirements of 6, 10 and 30 s ask for 1 s.
        satellite: in view from the onset on.
        rates_m_per_s: (f,), rates of the ramp [m/s]; 0 is the fault-free pass.
        methods: names or records of methods with a test statistic, or with a level that scales with K and knows the
            errors (`pl_mc.methods.capabilities`), and of sequential tests (``sequential_parity``, ``kalman``,
            ``filter_bank``).
        tau_s, share, smoothing_s: see `NoiseInTime`.
        draws: passes for each rate.
        seed: chooses the noise, 0 to 2^32 - 1.
        onset_s: time before the ramp, in which windows and filters fill [s].
        p_fa: false-alarm probability of a pass.
        calibration_draws: fault-free passes for the thresholds, and as many to count false alarms.
        alert: alert limits.
        axis: whose error, level and limit these are: ``vertical``, or ``horizontal`` for the length of the horizontal
            error, HPL and HAL; the vertical one unless given, the horizontal one where there is no other limit.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        One row per rate and method:

        - ``tau_s, share, rate_m_per_s, method`` (and ``axis`` where one was given or the horizontal limit decides),
          ``threshold`` (of the ratio to the method's nominal one), and
          ``false_alarms`` in ``false_alarm_passes``, ``false_alarm_rate, _low, _high``; the threshold is infinite
          where a method has no solution, or a test beside its level rejects, in more than a share ``p_fa`` of
          fault-free passes, so that none can keep the rate: it alarms there, and must not be compared;
        - ``passes, monitored_s``; ``detected`` passes with an alarm, ``detected_rate, _low, _high``;
        - ``hazards``, passes with an error beyond the limit;
        - quantiles ``X_50_s`` and ``X_95_s`` with bounds ``X_50_low_s``, ... of X = ``alert_after_onset`` over all
          passes and X = ``alert_after_hazard`` over those with a hazard; infinite where that share of passes had no
          alarm before the end, NaN where there was no hazard;
        - the same of ``error_at_alert`` [m], the size of the error at the alarm, over detected passes;
        - for each limit L of 6, 10 and 30 s: ``within_L`` of ``decided_L`` passes with a hazard had the alarm at
          most L after it began, ``within_L_rate, _low, _high``; ``undecided_L`` passes ended before L had
          gone by and are left out, with an alarm or without (to keep those with one would favour short times);
          ``late_L`` of ``passes - undecided_L``, the missed in the sense of the time to alert, ``late_L_rate, _low,
          _high``.

        Bounds are 95 %: Clopper-Pearson for rates, order statistics for quantiles.

    Raises:
        InputError: what cannot be used.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=20, interval_s=30.0)
        >>> options = {"draws": 50, "calibration_draws": 1000, "progress": False}
        >>> table = pl_mc.time_to_alert(g, "G08", 0.2, methods="ls", **options)
        >>> table[["method", "rate_m_per_s", "passes", "detected"]]
          method  rate_m_per_s  passes  detected
        0     ls           0.2      50        50
    """
    alert = require_geometry_and_alert(g_series, alert, any_axis=True)
    judged = as_axis(axis, alert)
    if judged == EITHER:
        raise InputError("axis: a time to alert is that of one error; choose vertical or horizontal.")
    rows = rows_by_satellite(g_series)
    noise = NoiseInTime(tau_s=tau_s, share=share, smoothing_s=smoothing_s)
    tests = fit_for(as_tests(methods), g_series)
    rates = ramp_rates(rates_m_per_s)
    draws = require_whole(draws, field="draws", low=1, high=_MOST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    calibration_draws = require_calibration(calibration_draws, p_fa)
    onset = require_onset(onset_s, rows.interval_s, len(g_series))
    spare = (g_series.satellite_count - g_series.unknown_count)[onset:]
    if (spare < 1).any():
        raise InputError(
            f"geometry: {int((spare < 1).sum())} epochs of the pass have no satellite more than unknowns, so that "
            "nothing can be tested there."
        )
    ramp_m = unit_ramp_m(rows, satellite, onset)
    with precision_scope("float64"):
        plan = pass_plan(tests, rows, noise, ramp_m, onset, alert.limit_m[judged])
    if judged != VERTICAL and any(each.own_position for each in plan.sequential):
        raise InputError(
            "axis: the position of a Kalman filter's own is vertical alone (nearest: one that guards least squares)."
        )
    free, last = (Cut(epoch_count=1, draws=n, epochs_per_call=1, blocks_per_call=1) for n in (calibration_draws, draws))
    with progress_bar(total=2 * free.blocks + last.blocks, what="Passes", show=progress) as advance:

        def watch(purpose: int, cut: Cut, sizes: FloatArray, thresholds: FloatArray) -> Any:
            """All passes of one purpose, a `Watched` of NumPy arrays."""

            def of_block(_: Chunk, block: np.int32, *others: np.int32) -> Watched:
                return watch_block(
                    plan, np.uint32(seed), np.uint32(purpose), np.uint32(block), on_device(sizes),
                    on_device(thresholds), as_trees(tests), onset=onset, axis=judged,
                )  # fmt: skip

            parts = []
            for _, watched in run_calls(cut, of_block, precision="float64"):
                parts.append(watched)
                advance()
            # Without the lanes beyond the last draw.
            return jax.tree.map(lambda *arrays: np.concatenate(arrays, axis=-1)[..., : cut.draws], *parts)

        never = np.full(len(tests), np.inf)
        thresholds = calibrated(watch(_CALIBRATION, free, np.zeros(1), never).largest[:, 0], p_fa)
        checked = watch(_CHECK, free, np.zeros(1), thresholds).alarm[:, 0] >= 0
        seen = watch(_RAMPS, last, rates, thresholds)
    table = _table(rows, onset, noise, tests, rates, thresholds, checked, seen)
    if axis is not None or judged != VERTICAL:
        table.insert(table.columns.get_loc("method") + 1, "axis", judged)
    return table


def sequential(name: str, **options: Any) -> SequentialTest:
    """A sequential test by name with its options; an `InputError` names what is unknown and the nearest choice."""
    return build_named(name, SEQUENTIAL, options, what="sequential test")


def as_tests(methods: Sequence[str | Test]) -> tuple[Test, ...]:
    """Names and records, made records; an `InputError` for those that have no statistic to calibrate."""
    made = as_records(methods, METHODS | SEQUENTIAL, Test, what="method")
    for test in made:
        if isinstance(test, Method) and not has_ratio(test):
            raise refusal(test, "statistic", "scales_with_k", able=has_ratio, field="methods", also=SEQUENTIAL)
    return made


def calibrated(largest: FloatArray, p_fa: float) -> FloatArray:
    """(methods,), the smallest values that no more than a share ``p_fa`` of passes (methods, passes) is beyond."""
    passes = largest.shape[1]
    return np.sort(largest, axis=1)[:, passes - math.floor(p_fa * passes) - 1]


def require_calibration(draws: int, p_fa: float) -> int:
    """``draws`` fault-free passes, checked to be enough for a threshold of the false-alarm probability ``p_fa``."""
    least = math.ceil(
        _FEWEST_BEYOND / require_within(require_fraction(p_fa, field="p_fa"), field="p_fa", low=1e-9, high=1.0)
    )
    return require_whole(draws, field="calibration_draws", low=least, high=_MOST_DRAWS)


def require_onset(onset_s: float, interval_s: float, epochs: int) -> int:
    """The sample at which a ramp begins, checked to lie within the pass."""
    onset = whole_samples(onset_s, interval_s, field="onset_s")
    if not 1 <= onset < epochs - 1:
        raise InputError(
            f"onset_s: it lies between the first and the last epoch, after {interval_s:g} s to "
            f"{(epochs - 2) * interval_s:g} s, not {onset_s:g} s."
        )
    return onset


def ramp_rates(rates_m_per_s: ArrayLike) -> FloatArray:
    """(f,), different rates."""
    rates = np.atleast_1d(require_numbers(rates_m_per_s, field="rates_m_per_s"))
    if (
        rates.ndim != 1
        or rates.size == 0
        or not (np.abs(rates) <= _MOST_RATE).all()
        or np.unique(rates).size < rates.size
    ):
        raise InputError(f"rates_m_per_s: one row of different rates of up to {_MOST_RATE:g} m/s is needed.")
    return rates


def _table(
    rows: Rows, onset: int, noise: NoiseInTime, tests: tuple[Test, ...], rates: FloatArray,
    thresholds: FloatArray, checked: NDArray[np.bool_], seen: Any,
) -> pd.DataFrame:  # fmt: skip
    samples = len(rows.design) - onset
    made = []
    for f, rate in enumerate(rates):
        for k, test in enumerate(tests):
            false, passes = int(checked[k].sum()), checked.shape[1]
            about = {
                "tau_s": noise.tau_s, "share": noise.share, "rate_m_per_s": float(rate), "method": test.name,
                "threshold": float(thresholds[k]), "false_alarms": false, "false_alarm_passes": passes,
            }  # fmt: skip
            alarm, hazard, error_m = (part[k, f] for part in (seen.alarm, seen.hazard, seen.error_m))
            timing = timing_columns(alarm, hazard, error_m, samples, rows.interval_s)
            made.append(about | _rate("false_alarm", false, passes) | timing)
    return pd.DataFrame(made)


def timing_columns(
    alarm: NDArray[np.int32], hazard: NDArray[np.int32], error_m: FloatArray, samples: int, interval_s: float
) -> dict[str, float]:
    """Statistics of the passes with one ramp under one method; see `time_to_alert`.

    ``alarm``, ``hazard`` and ``error_m``: (passes,), as in `Watched`; ``samples`` in a pass, the onset's included.
    """
    passes = len(alarm)
    detected, hazardous = alarm >= 0, hazard >= 0
    alarm_s = np.where(detected, alarm * interval_s, np.inf)
    # From the difference in samples: that of two times would be a rounding off the limits.
    after_hazard_s = np.where(detected, (alarm - hazard) * interval_s, np.inf)[hazardous]
    left_s = (samples - 1 - hazard[hazardous]) * interval_s
    at_alarm = error_m[detected & np.isfinite(error_m)]
    columns: dict[str, float] = {
        "passes": passes,
        "monitored_s": (samples - 1) * interval_s,
        "detected": int(detected.sum()),
        **_rate("detected", int(detected.sum()), passes),
        "hazards": int(hazardous.sum()),
    }
    for name, values, unit in (
        ("alert_after_onset", alarm_s, "s"),
        ("alert_after_hazard", after_hazard_s, "s"),
        ("error_at_alert", at_alarm, "m"),
    ):
        for percent in QUANTILES:
            value, low, high = quantile_bounds(values, percent / 100.0)
            start = f"{name}_{percent}"
            columns |= {f"{start}_{unit}": value, f"{start}_low_{unit}": low, f"{start}_high_{unit}": high}
    for limit in LIMITS_S:
        # Which passes count is known whatever the alarm did: counting alarms of passes that ended before the limit
        # without counting the alarms that these did not live to see would favour the alarm.
        enough = left_s >= limit
        within = int((enough & (after_hazard_s <= limit)).sum())
        missed, undecided = int(enough.sum()) - within, int((~enough).sum())
        columns |= {
            f"within_{limit}": within,
            f"decided_{limit}": within + missed,
            f"undecided_{limit}": undecided,
            **_rate(f"within_{limit}", within, within + missed),
            f"late_{limit}": missed,
            **_rate(f"late_{limit}", missed, passes - undecided),
        }
    return columns


def quantile_bounds(values: ArrayLike, share: float) -> tuple[float, float, float]:
    """The smallest value that at least a share of values does not exceed, with 95 % bounds by order statistics.

    The number of values below the true quantile is binomial, so that the order statistics at its 2.5 % and 97.5 %
    points enclose the quantile, whatever the distribution (David & Nagaraja 2003, Order Statistics, section 7.1).
    Where there are too few values for a bound it is infinite.
    """
    from scipy import stats

    ordered = np.sort(np.asarray(values, dtype=float))
    if not ordered.size:
        return math.nan, math.nan, math.nan
    number = ordered.size
    # P(X_(r) <= q) >= 0.975 and P(X_(s) > q) >= 0.975, with X_(r) counted from 1.
    below = int(stats.binom.ppf((1.0 - CONFIDENCE) / 2.0, number, share))
    above = int(stats.binom.ppf((1.0 + CONFIDENCE) / 2.0, number, share)) + 1
    value = ordered[max(math.ceil(share * number), 1) - 1]
    low = ordered[below - 1] if below >= 1 else -math.inf
    return float(value), float(low), float(ordered[above - 1] if above <= number else math.inf)


def _rate(name: str, count: int, total: int) -> dict[str, float]:
    bounds = (float(bound) for bound in clopper_pearson(count, total, CONFIDENCE))
    return rate_columns(name, count / total if total else math.nan, *bounds)
