"""Detection by each test at both kinds of threshold: one satellite at every epoch, all satellites at one epoch."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.detectors import Detector
from pl_mc.engine.detect import detect
from pl_mc.engine.detect_runs import LEVELS, calibrate, checked_options, defined_at, power_counts, verdicts_on
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.statistics.intervals import binomial_p_value, clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.guo.paper import chi2_detection, paper_rate, per_square_metre

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
        epochs: one row per bias, test and epoch at which the test is defined: ``epoch, bias_m, test, reading,
            satellite`` (the biased one), ``statistic, threshold, detected, threshold_equal, detected_equal,
            suspect, error_m``.
        detection: the paper's table 1 with intervals: one row per test, level and bias, over these epochs.
        drawn: likewise, mean detection rates over the epochs in many draws of noise. ``predicted, predicted_low,
            predicted_high``: detections among the epochs of a single draw, mean and 95 % range (normal
            approximation of a sum of independent epochs). ``exact_rate``: for V'PV at its nominal threshold the
            mean of the noncentral chi-square tails, ``exact_p_value``: the binomial test of the count against it.
        notes: sentences about epochs that give no row.
    """

    epochs: pd.DataFrame
    detection: pd.DataFrame
    drawn: pd.DataFrame
    notes: tuple[str, ...]


def day_of_detections(
    series: GuoSeries, tests: tuple[Detector, ...], *, p_fa: float, draws: int, calibration_draws: int,
    **options: Any,
) -> Day:  # fmt: skip
    """Thresholds first, then the series' own errors with each bias, then many draws of noise with each.

    For drawn noise the thresholds of equal false-alarm rate are those of `calibrate`, epoch by epoch. For a
    receiver's errors they are the nominal ones times one factor for each test, the quantile of statistic over
    threshold in the fault-free epochs of every other hour, used in the hours between. Options are seed, precision
    and progress.
    """
    g, bias_m, every = series.geometry, series.bias_rows_m, np.arange(len(series.geometry))
    checked = checked_options(tests, p_fa, **options)
    defined, notes = defined_at(g, tests)
    calibration = calibrate(g, checked, draws=calibration_draws, defined=defined)
    verdicts = [verdicts_on(g, series.errors_m + bias_m[:, b], checked) for b in range(len(series.biases_m))]

    # By bias, test and epoch, and for detections by level; where a test is not defined thresholds are missing.
    def heard(name: str) -> NDArray[Any]:
        return np.array([[getattr(verdict, name) for verdict in of_bias] for of_bias in verdicts])

    statistic, faulted = heard("statistic"), g.satellite[every, series.faulted_row]
    suspect = g.satellite[every, heard("satellite")]
    thresholds = calibration.thresholds.swapaxes(0, 1)
    if series.real:
        nominal = thresholds[..., 0]
        factors = crossed_factors(statistic[0].T / nominal.T, g.time_gps_s, p_fa)
        thresholds = np.stack([nominal, nominal * factors.T], axis=-1)
    detected = statistic[..., None] > thresholds
    names = np.array(g.names, dtype=object)
    columns = {
        "statistic": statistic, "threshold": heard("threshold"), "detected": detected[..., 0],
        "threshold_equal": np.broadcast_to(thresholds[..., 1], statistic.shape), "detected_equal": detected[..., 1],
        "suspect": names[suspect], "error_m": heard("error_m"),
    }  # fmt: skip
    epochs = []
    for (b, bias), (k, test) in product(enumerate(series.biases_m), enumerate(tests)):
        rows = pd.DataFrame({"epoch": g.epoch, "bias_m": bias, "test": test.test, "reading": test.label})
        own = {"satellite": names[faulted]} | {name: values[b, k] for name, values in columns.items()}
        epochs.append(rows.assign(**own)[defined[:, k]])

    total, biased = defined.sum(axis=0)[:, None, None], np.array(series.biases_m) != 0
    alarms = detected[0].sum(axis=1) if series.real else calibration.false_alarms.sum(axis=0)
    trials = total[..., 0] * (1 if series.real else calibration.draws)
    p_low, p_high = clopper_pearson(alarms, trials)
    printed = np.full((len(tests), len(LEVELS), len(series.biases_m)), np.nan)
    printed[:, 0] = [[paper_rate(test.test, bias) for bias in series.biases_m] for test in tests]
    right = (detected & (suspect == faulted)[..., None]).sum(axis=2)
    detection = _by_test(
        tests, series.biases_m, **_rates("epochs", np.moveaxis(detected.sum(axis=2), 0, -1), total),
        paper_rate=printed, threshold=np.nanmedian(thresholds, axis=1)[..., None], p_fa_nominal=p_fa,
        p_fa_measured=(alarms / trials)[..., None], p_fa_low=p_low[..., None], p_fa_high=p_high[..., None],
        p_fa_trials=trials[..., None],
        identified_rate=np.where(biased, np.moveaxis(right, 0, -1) / total, np.nan),
    )  # fmt: skip
    counts = power_counts(
        g, bias_m, np.ones(bias_m.shape[:2], dtype=bool), calibration.thresholds, checked, draws=draws
    )
    drawn = _drawn_table(series, tests, counts, defined, draws=draws, p_fa=p_fa)
    return Day(pd.concat(epochs, ignore_index=True), detection, drawn, notes)


def power_table(
    g: Geometry, faults: Faults, tests: tuple[Detector, ...], *, p_fa: float, **options: Any
) -> pd.DataFrame:
    """The table of `pl_mc.detect` for ramps on all satellites of one epoch, with ``satellite``.

    ``exact_rate`` is that of the chi-square test at its nominal threshold, ``exact_p_value`` that of the count.
    Options are those of `pl_mc.detect`.
    """
    power = detect(g, faults, tests=tests, p_fa=p_fa, **options)
    # Zero metres on one satellite is zero metres on any: the fault-free draws, once for each satellite.
    sizes = len(faults) // len(g.names)
    satellite = dict(zip(faults.labels, np.repeat(g.names, sizes), strict=True))
    power.insert(2, "satellite", np.where(power.bias_m == 0, "", power.fault.map(satellite)))
    power = power.drop_duplicates(["test", "reading", "level", "fault"]).reset_index(drop=True)
    known = power[(power.test == "chi2") & (power.reading == "apriori") & (power.level == "nominal")]
    row = np.array([g.names.index(name) if name else 0 for name in known.satellite], dtype=int)
    quantities = ls_quantities(g)
    noncentrality = known.bias_m.to_numpy() ** 2 * quantities.redundancy[row] / g.sigma_m[row] ** 2
    rate = chi2_detection(float(quantities.dof), p_fa, noncentrality)
    exact = {"exact_rate": rate, "exact_p_value": binomial_p_value(known.detections, known.draws, rate)}
    return power.join(pd.DataFrame(exact, index=known.index))


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


def _drawn_table(
    series: GuoSeries, tests: tuple[Detector, ...], counts: NDArray[np.int64], defined: NDArray[np.bool_], *,
    draws: int, p_fa: float,
) -> pd.DataFrame:  # fmt: skip
    """The table of `Day.drawn`; ``counts`` is (e, biases, tests, levels, 2)."""
    g, biases_m = series.geometry, np.array(series.biases_m)
    counts = np.moveaxis(counts, 1, 3)
    seen, right = np.moveaxis(counts.sum(axis=0), -1, 0)
    rate = counts[..., 0] / draws
    predicted, epochs = rate.sum(axis=0), defined.sum(axis=0)[:, None, None]
    # An unbiased estimate of the variance of one draw at each epoch.
    spread = 1.96 * np.sqrt((rate * (1 - rate)).sum(axis=0) * draws / max(draws - 1, 1))
    table = _by_test(
        tests, series.biases_m, **_rates("draws", seen, epochs * draws),
        identified_rate=np.where(biases_m != 0, right / (epochs * draws), np.nan), epochs=epochs,
        predicted=predicted, predicted_low=np.maximum(predicted - spread, 0.0),
        predicted_high=np.minimum(predicted + spread, epochs),
    )  # fmt: skip
    per_metre = per_square_metre(g, (np.arange(len(g)), series.faulted_row))
    degrees = ls_quantities(g).dof.astype(float)
    for test, at in zip(tests, defined.T, strict=True):
        if test.name == "chi2":
            known = (table.test == test.test) & (table.reading == test.label) & (table.level == LEVELS[0])
            exact = np.array([chi2_detection(degrees[at], p_fa, bias**2 * per_metre[at]).mean() for bias in biases_m])
            p_value = binomial_p_value(table.detections[known], table.draws[known], exact)
            table.loc[known, ["exact_rate", "exact_p_value"]] = np.stack([exact, p_value], axis=-1)
    return table


def _by_test(tests: tuple[Detector, ...], biases_m: tuple[float, ...], **columns: Any) -> pd.DataFrame:
    """One row per test, level and bias, from columns that broadcast to an array of tests, levels and biases."""
    keys: dict[str, Any] = {
        "test": [[[test.test]] for test in tests], "reading": [[[test.label]] for test in tests],
        "level": [[level] for level in LEVELS], "bias_m": biases_m,
    }  # fmt: skip
    shape = (len(tests), len(LEVELS), len(biases_m))
    return pd.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in (keys | columns).items()})


def _rates(of: str, seen: NDArray[np.int64], total: NDArray[np.int64]) -> dict[str, Any]:
    low, high = clopper_pearson(seen, total)
    return {of: total, "detections": seen, "detection_rate": seen / total, "low": low, "high": high}
