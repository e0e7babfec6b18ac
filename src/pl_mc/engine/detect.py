"""Detection: how often each test finds a fault, at its nominal threshold and at equal measured false-alarm rates.

Three stretches of noise that never meet: the one that `pl_mc.sweep` uses for power, one that finds thresholds, one
that measures false alarms with them. A threshold that was found on the draws it is judged by would flatter itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import LPV_200
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.detectors.base import Detector
from pl_mc.engine.checks import notes_on_faults, require_errors, require_geometry_and_alert, require_inputs
from pl_mc.engine.detect_core import MethodTest
from pl_mc.engine.detect_runs import (
    LEVELS,
    MOST_DRAWS,
    NOMINAL,
    calibrate,
    checked_options,
    defined_at,
    power_counts,
    verdicts_on,
)
from pl_mc.engine.plan import fault_slots
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.injection import row_biases
from pl_mc.input_errors import require_whole
from pl_mc.methods import Method
from pl_mc.statistics.intervals import clopper_pearson


@ordinary_arithmetic
def detect(
    g: Geometry,
    faults: Faults,
    *,
    tests: Sequence[str | Detector | Method] = ("chi2", "mean_check"),
    draws: int,
    seed: int,
    p_fa: float = 0.01,
    calibration_draws: int = 100_000,
    precision: str = "float64",
    workers: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """How often each test detects each fault, and whether it names the faulted satellite.

    The noise of each satellite has the sigma of the geometry, which also makes the weights. All tests and faults
    see the same noise, that of `pl_mc.sweep` with the same seed.

    Args:
        g: one epoch or a series.
        faults: bias vectors, from `ramp`, `biases` or `no_fault`; sizes that are drawn are those of `pl_mc.sweep`.
        tests: names (``chi2``, ``mean_check``) or records of `pl_mc.detectors`, and of methods with a statistic
            (`pl_mc.methods.capabilities.Statistic`), such as ``slope``: its ratio to their own threshold is tested.
        draws: noise draws for each fault at each epoch.
        seed: chooses the noise, 0 to 2^32 - 1. The same seed gives the same counts.
        p_fa: nominal false-alarm probability, which the second level also calibrates to.
        calibration_draws: fault-free draws at each epoch that find the thresholds of equal false-alarm rate, and as
            many more, independent of them and of the faulted draws, that measure each test's false-alarm rate.
        precision, workers, progress: as for `pl_mc.sweep`.

    Returns:
        One row per epoch, test, level and fault: ``epoch`` (for a series alone), ``test, reading, level, fault,
        bias_m, draws, detections, detection_rate, low, high`` (95 % Clopper-Pearson), ``identified_rate``
        (detected, and the suspect is a faulted satellite; missing without a fault), ``threshold, p_fa_nominal,
        p_fa_measured, p_fa_low, p_fa_high``. ``level`` is ``nominal`` (the test's own threshold, whose real
        false-alarm rate may be another; ``p_fa_nominal`` is missing for a method) or ``equal_p_fa``: the order
        statistic of the fault-free statistics whose expected false-alarm rate is k / (calibration_draws + 1) with
        the largest k that keeps it at or below
        ``p_fa``. Detection rates of different tests may be compared at the second level alone. ``reading`` is the
        test's reading with further options that are not the default. A statistic that is always zero never detects
        at either level.

        An epoch at which a test is not defined gives no row; ``table.attrs["notes"]`` says where and why.

    Raises:
        InputError: bad options, faults of another geometry, or a single epoch at which one of the tests is not
            defined; the others can then be asked for without it.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> fault = pl_mc.biases(g, "G08:+20m")
        >>> options = {"draws": 200, "calibration_draws": 200, "seed": 7, "progress": False}
        >>> table = pl_mc.detect(g, fault, tests="chi2", **options)
        >>> table[["test", "level", "draws", "detections"]]
           test       level  draws  detections
        0  chi2     nominal    200         200
        1  chi2  equal_p_fa    200         200
    """
    require_inputs(g, faults, LPV_200, drawn=True)
    options = checked_options(tests, p_fa, seed, precision, workers, progress)
    draws = require_whole(draws, field="draws", low=1, high=MOST_DRAWS)
    series = g.as_series()
    defined, notes = defined_at(g, options.tests)
    order, given = fault_slots(faults.applies(g))
    bias_m, drawn = row_biases(series, faults, np.arange(len(series))[:, None], order)
    bias_m = np.where(given[:, :, None], bias_m, 0.0)

    calibration = calibrate(series, options, draws=calibration_draws, defined=defined)
    counts = power_counts(series, bias_m, given, calibration.thresholds, options, draws=draws, drawn=drawn)
    rows = np.ones((*given.shape, len(options.tests), len(LEVELS)), bool)
    place, slot, test, level = np.nonzero(rows & given[:, :, None, None] & defined[:, None, :, None])
    fault = order[place, slot]
    columns: dict[str, object] = {"epoch": series.epoch[place]} if g.is_series else {}
    seen, right = counts[place, slot, test, level].T
    low, high = clopper_pearson(seen, draws)
    alarms = calibration.false_alarms[place, test, level]
    p_fa_low, p_fa_high = clopper_pearson(alarms, calibration.draws)
    own = np.array([isinstance(t, MethodTest) for t in options.tests])[test]
    biased = (faults.bias_m != 0).any(axis=1)[fault]
    columns |= {
        "test": np.array([t.test for t in options.tests], dtype=object)[test],
        "reading": np.array([t.label for t in options.tests], dtype=object)[test],
        "level": np.array(LEVELS, dtype=object)[level],
        "fault": np.array(faults.labels, dtype=object)[fault],
        "bias_m": faults.scalar_bias_m[fault],
        "draws": np.full(place.size, draws, dtype=np.int64),
        "detections": seen,
        "detection_rate": seen / draws,
        "low": low,
        "high": high,
        "identified_rate": np.where(biased, right / draws, np.nan),
        "threshold": calibration.thresholds[place, test, level],
        "p_fa_nominal": np.where(own & (level == LEVELS.index(NOMINAL)), np.nan, options.p_fa),
        "p_fa_measured": alarms / calibration.draws,
        "p_fa_low": p_fa_low,
        "p_fa_high": p_fa_high,
    }
    table = pd.DataFrame(columns).iloc[np.lexsort((fault, level, test, place))].reset_index(drop=True)
    table.attrs["notes"] = [*notes, *notes_on_faults(g, faults)]
    return table


@ordinary_arithmetic
def examine(
    g: Geometry,
    errors_m: NDArray[np.float64],
    *,
    tests: Sequence[str | Detector | Method] = ("chi2", "mean_check"),
    p_fa: float = 0.01,
    precision: str = "float64",
) -> pd.DataFrame:
    """What each test says of given pseudorange errors, epoch by epoch, such as those of a real receiver.

    Args:
        g: one epoch or a series.
        errors_m: (n,) or (epochs, n), observed minus true pseudoranges in the rows of ``g`` [m].
        tests, p_fa, precision: as for `detect`.

    Returns:
        One row per epoch and test that is defined there: ``epoch, test, reading, statistic, threshold, decision,
        suspect`` (name of the satellite), ``error_m`` (its estimated error). ``table.attrs["notes"]`` says where a
        test is not defined.

    Raises:
        InputError: as for `detect`, and errors of another shape or that are not finite.
    """
    options = checked_options(tests, p_fa, 0, precision, None, False)
    require_geometry_and_alert(g, LPV_200)
    series, errors = g.as_series(), require_errors(g, errors_m)
    defined, notes = defined_at(g, options.tests)
    names = np.array(g.names, dtype=object)
    parts = []
    for k, (test, found) in enumerate(zip(options.tests, verdicts_on(series, errors, options), strict=True)):
        kept = np.flatnonzero(defined[:, k])
        suspect = series.satellite[kept, found.satellite[kept]]
        columns = {
            "epoch": series.epoch[kept],
            "test": test.test,
            "reading": test.label,
            "statistic": found.statistic[kept],
            "threshold": found.threshold[kept],
            "decision": found.decision[kept],
            "suspect": names[suspect],
            "error_m": found.error_m[kept],
        }
        parts.append(pd.DataFrame(columns))
    table = pd.concat(parts).sort_values("epoch", kind="stable").reset_index(drop=True)
    table.attrs["notes"] = [*g.notes, *notes]
    return table
