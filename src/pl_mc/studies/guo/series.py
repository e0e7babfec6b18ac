"""Detection over a series of epochs: one satellite biased at each, by each test, at both kinds of threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.detectors import Detector
from pl_mc.engine.detect_runs import (
    EQUAL_P_FA,
    LEVELS,
    NOMINAL,
    Calibration,
    calibrate,
    checked_options,
    defined_at,
    power_counts,
    verdicts_on,
)
from pl_mc.geometry import Geometry
from pl_mc.statistics.intervals import binomial_p_value, clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.noncentral import split_at_threshold
from pl_mc.statistics.student import chi2_threshold
from pl_mc.studies.guo.text import paper_rate

FloatArray = NDArray[np.float64]

# A receiver's errors stay alike for minutes: thresholds found in one hour are used in the next.
_FOLD_S = 3600.0


@dataclass(frozen=True)
class GuoSeries:
    """A series with one biased row at each epoch.

    Attributes:
        geometry: e epochs of n rows.
        errors_m: (e, n), errors without the bias: one draw of noise, or the receiver's own [m].
        faulted_row: (e,), row that is biased.
        biases_m: the biases, the first of them zero [m].
        real: whether the errors are a receiver's.
    """

    geometry: Geometry
    errors_m: FloatArray
    faulted_row: NDArray[np.int64]
    biases_m: tuple[float, ...]
    real: bool

    @property
    def bias_rows_m(self) -> FloatArray:
        """(e, biases, n), bias vectors [m]."""
        e, n = self.errors_m.shape
        rows = np.zeros((e, len(self.biases_m), n))
        rows[np.arange(e), :, self.faulted_row] = self.biases_m
        return rows


@dataclass(frozen=True)
class Day:
    """What the tests say of a series.

    Attributes:
        tests: the tests; p_fa: their nominal false-alarm probability.
        epochs: one row per bias, test and epoch at which the test is defined: ``epoch, bias_m, test, reading,
            satellite`` (the biased one), ``statistic, threshold, detected, threshold_equal, detected_equal,
            suspect, error_m``.
        defined: (e, tests); calibration: thresholds and false alarms in drawn noise.
        counts: (e, biases, tests, levels, 2), in ``draws`` draws of noise.
        draws: draws behind the counts.
        notes: sentences about epochs that give no row.
    """

    tests: tuple[Detector, ...]
    p_fa: float
    epochs: pd.DataFrame
    defined: NDArray[np.bool_]
    calibration: Calibration
    counts: NDArray[np.int64]
    draws: int
    notes: tuple[str, ...]


def day_of_detections(
    series: GuoSeries,
    tests: tuple[Detector, ...],
    *,
    p_fa: float,
    seed: int,
    draws: int,
    calibration_draws: int,
    precision: str = "float64",
    progress: bool | None = False,
) -> Day:
    """Thresholds first, then the series' own errors with each bias, then many draws of noise with each.

    For drawn noise the thresholds of equal false-alarm rate are those of `calibrate`, epoch by epoch. For a
    receiver's errors they are the nominal ones times one factor for each test, the quantile of statistic over
    threshold in the fault-free epochs of every other hour, used in the hours between.
    """
    g = series.geometry
    options = checked_options(tests, p_fa, seed, precision, None, progress)
    defined, notes = defined_at(g, tests)
    calibration = calibrate(g, options, draws=calibration_draws, defined=defined)
    bias_m = series.bias_rows_m
    verdicts = [verdicts_on(g, series.errors_m + bias_m[:, b], options) for b in range(len(series.biases_m))]
    equal = calibration.thresholds[:, :, 1]
    if series.real:
        ratios = np.stack([v.statistic for v in verdicts[0]], axis=1) / calibration.thresholds[:, :, 0]
        equal = calibration.thresholds[:, :, 0] * crossed_factors(ratios, g.time_gps_s, p_fa)
    names = np.array(g.names, dtype=object)
    parts = []
    for bias, found in zip(series.biases_m, verdicts, strict=True):
        for k, (test, verdict) in enumerate(zip(tests, found, strict=True)):
            at = np.flatnonzero(defined[:, k])
            columns = {
                "epoch": g.epoch[at],
                "bias_m": bias,
                "test": test.test,
                "reading": test.label,
                "satellite": names[g.satellite[at, series.faulted_row[at]]],
                "statistic": verdict.statistic[at],
                "threshold": verdict.threshold[at],
                "detected": verdict.statistic[at] > calibration.thresholds[at, k, 0],
                "threshold_equal": equal[at, k],
                "detected_equal": verdict.statistic[at] > equal[at, k],
                "suspect": names[g.satellite[at, verdict.satellite[at]]],
                "error_m": verdict.error_m[at],
            }
            parts.append(pd.DataFrame(columns))
    counts = power_counts(
        g, bias_m, np.ones(bias_m.shape[:2], dtype=bool), calibration.thresholds, options, draws=draws
    )
    return Day(tests, p_fa, pd.concat(parts, ignore_index=True), defined, calibration, counts, draws, notes)


def crossed_factors(ratios: FloatArray, time_gps_s: FloatArray, p_fa: float) -> FloatArray:
    """(e, tests), what to multiply thresholds with so that a share ``p_fa`` of fault-free epochs is above them.

    Found in the odd hours for the even ones and the other way round: no epoch decides its own threshold.

    Args:
        ratios: (e, tests), fault-free statistic over threshold; NaN where a test is not defined.
        time_gps_s: (e,), time [s].
        p_fa: the share.
    """
    odd = (np.floor(time_gps_s / _FOLD_S) % 2).astype(bool)
    factors = np.full(ratios.shape, np.inf)
    for fold in (odd, ~odd):
        for k in range(ratios.shape[1]):
            known = ratios[~fold, k]
            known = np.sort(known[~np.isnan(known)])
            rank = int(np.floor(p_fa * (known.size + 1) * (1 + 1e-12)))
            if rank:
                factors[fold, k] = known[known.size - rank]
    return factors


def detection_table(series: GuoSeries, day: Day) -> pd.DataFrame:
    """The paper's table 1 with intervals: one row per test, level and bias, over the epochs of the series."""
    rows = []
    for k, test in enumerate(day.tests):
        mine = day.epochs[(day.epochs.test == test.test) & (day.epochs.reading == test.label)]
        for level, (detected, threshold) in zip(
            LEVELS, (("detected", "threshold"), ("detected_equal", "threshold_equal")), strict=True
        ):
            if series.real:
                free = mine[mine.bias_m == 0]
                alarms, trials = int(free[detected].sum()), len(free)
            else:
                at = day.defined[:, k]
                alarms = int(day.calibration.false_alarms[at, k, LEVELS.index(level)].sum())
                trials = int(at.sum()) * day.calibration.draws
            p_low, p_high = (float(bound) for bound in clopper_pearson(alarms, trials))
            for bias, group in mine.groupby("bias_m", sort=False):
                seen = int(group[detected].sum())
                low, high = (float(bound) for bound in clopper_pearson(seen, len(group)))
                rows.append(
                    {
                        "test": test.test,
                        "reading": test.label,
                        "level": level,
                        "bias_m": bias,
                        "epochs": len(group),
                        "detections": seen,
                        "detection_rate": seen / len(group),
                        "low": low,
                        "high": high,
                        "paper_rate": paper_rate(test.test, float(bias)) if level == NOMINAL else np.nan,
                        "threshold": float(group[threshold].median()),
                        "p_fa_nominal": day.p_fa,
                        "p_fa_measured": alarms / trials,
                        "p_fa_low": p_low,
                        "p_fa_high": p_high,
                        "p_fa_trials": trials,
                        "identified_rate": float((group[detected] & (group.suspect == group.satellite)).mean())
                        if bias
                        else np.nan,
                    }
                )
    return pd.DataFrame(rows)


def draws_table(series: GuoSeries, day: Day) -> pd.DataFrame:
    """Mean detection rates over the epochs in many draws of noise, and how many epochs of one draw they predict.

    ``predicted, predicted_low, predicted_high``: detections among the epochs of a single draw, mean and 95 % range
    (normal approximation of a sum of independent epochs). ``exact_rate``: for V'PV at its nominal threshold the
    mean of the noncentral chi-square tails, and ``exact_p_value`` the binomial test of the count against it.
    """
    g, e = series.geometry, len(series.geometry)
    quantities = ls_quantities(g)
    at_row = (np.arange(e), series.faulted_row)
    per_metre = quantities.redundancy[at_row] / g.sigma_m[at_row] ** 2
    rows = []
    for k, test in enumerate(day.tests):
        at = day.defined[:, k]
        for level in LEVELS:
            for b, bias in enumerate(series.biases_m):
                count = day.counts[at, b, k, LEVELS.index(level)]
                seen, right = (int(value) for value in count.sum(axis=0))
                trials = int(at.sum()) * day.draws
                low, high = (float(bound) for bound in clopper_pearson(seen, trials))
                rate = count[:, 0] / day.draws
                # An unbiased estimate of the variance of one draw at each epoch.
                spread = 1.96 * np.sqrt((rate * (1 - rate)).sum() * day.draws / max(day.draws - 1, 1))
                row: dict[str, object] = {
                    "test": test.test,
                    "reading": test.label,
                    "level": level,
                    "bias_m": bias,
                    "draws": trials,
                    "detections": seen,
                    "detection_rate": seen / trials,
                    "low": low,
                    "high": high,
                    "identified_rate": right / trials if bias else np.nan,
                    "epochs": int(at.sum()),
                    "predicted": float(rate.sum()),
                    "predicted_low": max(float(rate.sum() - spread), 0.0),
                    "predicted_high": min(float(rate.sum() + spread), float(at.sum())),
                }
                if test.name == "chi2" and level == NOMINAL:
                    dof = quantities.dof[at].astype(float)
                    _, above = split_at_threshold(chi2_threshold(dof, day.p_fa), dof, bias**2 * per_metre[at])
                    row["exact_rate"] = float(above.mean())
                    row["exact_p_value"] = float(binomial_p_value(seen, trials, above.mean()))
                rows.append(row)
    return pd.DataFrame(rows)


__all__ = ["EQUAL_P_FA", "NOMINAL", "Day", "GuoSeries", "day_of_detections", "detection_table", "draws_table"]
