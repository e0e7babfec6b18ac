"""Protection levels of snapshots and of filters under ramps: what they claim, and, exactly, what they give.

Everything is linear and Gaussian: at each epoch the vertical error and the separation from the filter without the
faulted satellite are two normal numbers, of means that the ramp and of a covariance that the true errors decide,
whatever the filters believe of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.alert import LPV_200, VERTICAL, AlertLimits
from pl_mc.araim.solving import fit_subsets
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import require_geometry_and_alert
from pl_mc.geometry.record import UP, Geometry
from pl_mc.input_errors import InputError
from pl_mc.named import as_records
from pl_mc.runtime.precision import precision_scope
from pl_mc.time_ramps.filter_bank import FilterBank, SeparationLevels, separation_levels
from pl_mc.time_ramps.filters import FilterModel, Gains, beside, filter_model, ramp_response
from pl_mc.time_ramps.signals import NoiseInTime, Rows, rows_by_satellite, unit_ramp_m
from pl_mc.time_ramps.timing import ramp_rates, require_onset

SNAPSHOT = "snapshot"

# Nodes of the Gauss-Legendre rule over the separations that pass.
_NODES = 200


@dataclass(frozen=True)
class UnderRamp:
    """One method with a ramp on one satellite, at the monitored epochs.

    Attributes:
        levels: of every satellite.
        place: the faulted satellite.
        up_m: (E, 2), vertical error of all satellites, and their separation from the estimate without the faulted
            one, in a unit ramp [m].
        covariance_m2: (E, 2, 2), of these two under the true errors [m^2].
    """

    levels: SeparationLevels
    place: int
    up_m: FloatArray
    covariance_m2: FloatArray


@ordinary_arithmetic
def sequential_levels(
    g_series: Geometry,
    satellite: str,
    rates_m_per_s: ArrayLike,
    banks: Sequence[FilterBank] = (FilterBank(),),
    *,
    tau_s: float = 100.0,
    share: float = 0.5,
    smoothing_s: float = 100.0,
    onset_s: float = 300.0,
    alert: str | AlertLimits = LPV_200,
) -> pd.DataFrame:
    """Vertical levels by solution separation of snapshots and of banks of Kalman filters, and their risk under ramps.

    The snapshot is the weighted least squares of every epoch, tested and bounded by the same equations with the
    budget and the priors of the bank that follows it. The ramp is one of the satellite's clock, which carrier
    smoothing passes, begins at ``onset_s`` and grows to the end of the series; errors are those of `NoiseInTime`.
    Nothing is drawn: probabilities are of single epochs and exact, by quadrature of a normal law of two numbers. The
    alarm is that of the faulted satellite's own test, so that what misleads is an upper bound on what misleads with
    all tests.

    Args:
        g_series: epochs at equal intervals.
        satellite: in view from the onset on.
        rates_m_per_s: (f,), rates of the ramp [m/s]; 0 is the fault-free pass.
        banks: records `FilterBank`.
        tau_s, share, smoothing_s: the true errors, see `NoiseInTime`.
        onset_s: time before the ramp, in which filters settle [s].
        alert: alert limits, of which the vertical one counts.

    Returns:
        One row for each bank and the snapshot of each different budget, and each rate, over the monitored epochs:

        - ``method, tau_s, share, smoothing_s, rate_m_per_s``; ``epochs``, of which ``available`` have a level within
          the alert limit;
        - ``sigma_mean_m``, the believed standard deviation of the vertical error, ``sigma_ratio``, the largest ratio of
          a true one to it, of all satellites and without the faulted one: above 1 the level proves nothing;
          ``vpl_mean_m, vpl_max_m``, infinite where an epoch has no level;
        - ``alarm_50_s, alarm_95_s``, the time after the onset from which on the test alarms with that probability at
          a single epoch, infinite where it does not before the end, and ``error_at_alarm_50_m``, the mean error then;
        - ``misleading``, the largest probability of an epoch that the error is beyond the level and the test passes,
          at ``misleading_after_s``; ``misleading_bound``, the largest that the level equation allows for
          (the term of this satellite, without its prior); ``missed``, the same of errors beyond the alert limit where
          the level is within it.

    Raises:
        InputError: what cannot be used.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=20, interval_s=30.0)
        >>> table = pl_mc.sequential_levels(g, "G08", 0.05, smoothing_s=90.0)
        >>> table[["method", "rate_m_per_s", "vpl_mean_m"]].round(1)
                method  rate_m_per_s  vpl_mean_m
        0     snapshot           0.0        25.1
        1  filter_bank           0.0        19.7
    """
    alert = require_geometry_and_alert(g_series, alert)
    rows = rows_by_satellite(g_series)
    noise = NoiseInTime(tau_s=tau_s, share=share, smoothing_s=smoothing_s)
    # Whole samples are asked for where the errors are made; here once, before the work.
    noise.code_correlation(rows.interval_s)
    records = as_records(banks, {"filter_bank": FilterBank}, FilterBank, what="bank")
    rates = ramp_rates(rates_m_per_s)
    onset = require_onset(onset_s, rows.interval_s, len(g_series))
    ramp_m = unit_ramp_m(rows, satellite, onset)
    place = rows.names.index(satellite)
    made: dict[str, UnderRamp] = {}
    with precision_scope("float64"):
        for bank in records:
            budget = FilterBank(p_sat=bank.p_sat, budget=bank.budget)
            name = budget.name.replace("filter_bank", SNAPSHOT)
            if name not in made:
                made[name] = _snapshot(budget, rows, ramp_m, place, onset)
            made[bank.name] = _filtered(bank, rows, noise, ramp_m, place, onset)
    if not np.isfinite(next(iter(made.values())).covariance_m2).all():
        raise InputError(
            f"satellite: without {satellite} some epochs of the pass have no position, so that nothing bounds its ramp."
        )
    table = [
        {"method": name, "tau_s": noise.tau_s, "share": noise.share, "smoothing_s": noise.smoothing_s}
        | _at_rate(found, float(rate), rows.interval_s, alert.limit_m[VERTICAL])
        for rate in rates
        for name, found in made.items()
    ]
    return pd.DataFrame(table)


def _snapshot(budget: FilterBank, rows: Rows, ramp_m: FloatArray, place: int, onset: int) -> UnderRamp:
    """Least squares of every epoch; errors of one moment have their sigma, however correlated in time."""
    seen, satellites = rows.in_view, len(rows.names)
    design = np.moveaxis(rows.design * (seen / rows.sigma_m)[:, :, None], 0, -1)
    excluded = np.broadcast_to(np.eye(satellites, dtype=bool)[:, :, None], (satellites, satellites, len(seen)))
    ones = np.ones((satellites, len(seen)))
    whole, modes = jax.device_get(jax.jit(fit_subsets)(design, seen.T, excluded, 0 * ones, ones))
    sigma = np.concatenate([whole.sigma_m[UP][None], modes.sigma_m[UP]]).T
    solved = np.concatenate([whole.regular[None], modes.regular]).T
    levels = separation_levels(budget, rows, sigma, solved, seen)
    # What whitened observations add to the error and to the separation, (T, 2, m).
    maps = np.moveaxis(np.stack([whole.gain[UP], modes.difference[UP, :, place]]), -1, 0)
    up_m = np.einsum("eqi,ei->eq", maps, ramp_m * seen / rows.sigma_m)
    known = np.where(solved[:, [0, 1 + place]].all(axis=1), 1.0, np.nan)
    covariance = maps @ np.swapaxes(maps, 1, 2) * known[:, None, None]
    return _monitored(levels, place, up_m, covariance, onset)


def _filtered(
    bank: FilterBank, rows: Rows, noise: NoiseInTime, ramp_m: FloatArray, place: int, onset: int
) -> UnderRamp:
    """The bank's filters 0 and without the faulted satellite, under errors as they are."""
    model, made = bank.filters(rows, noise)
    levels = separation_levels(bank, rows, np.sqrt(made.up_variance_m2))
    both = made.gain[:, [0, 1 + place]]
    up = ramp_response(model, both, ramp_m)[1]
    true = filter_model(bank, rows, noise)
    covariance = true_covariance(model, Gains(both, made.weight, made.up_variance_m2), true)
    return _monitored(levels, place, np.stack([up[:, 0], up[:, 1] - up[:, 0]], axis=1), covariance, onset)


def true_covariance(model: FilterModel, made: Gains, true: FilterModel) -> FloatArray:
    """(T, 2, 2), of the vertical error of the first of two filters and of their separation [m^2].

    The filters have the gains that ``model`` gave them; the errors are those of ``true``, which has the same states.
    True state and both estimates are one linear system, whose covariance is carried along.
    """
    states = len(true.transition)
    # Error of the first, and what the second has more than the first.
    ask = np.zeros((2, 3 * states))
    ask[0, [states + UP, UP]] = 1.0, -1.0
    ask[1, [2 * states + UP, states + UP]] = 1.0, -1.0
    step = beside(true.transition, model.transition, model.transition)
    fresh, one = beside(true.process, *np.zeros((2, states, states))), np.eye(states)
    covariance = beside(true.start, *np.zeros((2, states, states)))
    found = np.empty((len(true.measurement), 2, 2))
    for k, h in enumerate(true.measurement):
        if k > 0:
            covariance = step @ covariance @ step.T + fresh
        update = beside(one, *(one - gain @ model.measurement[k] for gain in made.gain[k]))
        stacked = made.gain[k].reshape(2 * states, -1)
        update[states:, :states] = stacked @ h
        covariance = update @ covariance @ update.T
        covariance[states:, states:] += (stacked * true.variance_m2[k]) @ stacked.T
        covariance = 0.5 * (covariance + covariance.T)
        found[k] = ask @ covariance @ ask.T
    return found


def _monitored(levels: SeparationLevels, place: int, up_m: FloatArray, covariance: FloatArray, onset: int) -> UnderRamp:
    later = slice(onset, None)
    own = SeparationLevels(levels.sigma_m[later], levels.threshold_m[later], levels.level_m[later])
    return UnderRamp(own, place, up_m[later], covariance[later])


def _at_rate(found: UnderRamp, rate: float, interval_s: float, limit_m: float) -> dict[str, float]:
    """The columns of one method under one ramp."""
    level, threshold = found.levels.level_m, found.levels.threshold_m[:, found.place]
    believed = found.levels.sigma_m[:, [0, 1 + found.place]]
    # Error of the estimate without the satellite: that of all, and the separation.
    true = np.stack([found.covariance_m2[:, 0, 0], found.covariance_m2.sum(axis=(1, 2))], axis=1)
    means = rate * found.up_m
    spread = np.sqrt(found.covariance_m2[:, 1, 1])
    alarms = _outside(threshold, means[:, 1], spread)
    misleading = beyond_unseen(level, threshold, means, found.covariance_m2)
    within = level <= limit_m
    missed = np.where(within, beyond_unseen(np.full_like(level, limit_m), threshold, means, found.covariance_m2), 0.0)
    at_alarm = {percent: _from_then_on(alarms >= percent / 100.0) for percent in (50, 95)}
    half = at_alarm[50]
    bound = np.where(level > threshold, special.ndtr((threshold - level) / believed[:, 1]), 1.0)
    worst = int(np.argmax(misleading))
    return {
        "rate_m_per_s": rate, "epochs": len(level), "available": int(within.sum()),
        "sigma_mean_m": float(believed[:, 0].mean()), "sigma_ratio": float(np.sqrt(true / believed**2).max()),
        "vpl_mean_m": float(level.mean()), "vpl_max_m": float(level.max()),
        **{f"alarm_{percent}_s": np.inf if k is None else k * interval_s for percent, k in at_alarm.items()},
        "error_at_alarm_50_m": np.nan if half is None else float(abs(means[half, 0])),
        "misleading": float(misleading[worst]), "misleading_after_s": worst * interval_s,
        "misleading_bound": float(np.where(np.isfinite(level), bound, 0.0).max()), "missed": float(missed.max()),
    }  # fmt: skip


def _outside(limit_m: FloatArray, mean_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """P(|x| > limit) of normal numbers."""
    scale = np.where(sigma_m > 0, sigma_m, 1e-12)
    upper, lower = special.ndtr((mean_m - limit_m) / scale), special.ndtr(-(limit_m + mean_m) / scale)
    return np.asarray(np.where(np.isfinite(limit_m), upper + lower, 0.0))


def _from_then_on(holds: np.ndarray) -> int | None:
    """The first place from which on it holds to the end."""
    fails = np.flatnonzero(~holds)
    first = int(fails[-1]) + 1 if fails.size else 0
    return first if first < len(holds) else None


def beyond_unseen(
    level_m: FloatArray, threshold_m: FloatArray, mean_m: FloatArray, covariance: FloatArray
) -> FloatArray:
    """(E,), P(|error| > level and |separation| <= threshold) of two normal numbers, by Gauss-Legendre.

    ``mean_m``: (E, 2) and ``covariance``: (E, 2, 2), of error and separation. Where there is no threshold the
    separation is not tested, and where there is no level nothing is beyond it.
    """
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    variance, cross = covariance[:, 1, 1], covariance[:, 0, 1]
    tested = np.isfinite(threshold_m) & (variance > 0)
    sigma = np.sqrt(np.where(tested, variance, 1.0))
    limit = np.where(tested, threshold_m, 0.0)
    # Only where the density is not negligible: within 12 sigma of the mean, or at the nearest edge.
    middle = np.clip(mean_m[:, 1], -limit, limit)
    low, high = np.maximum(middle - 12.0 * sigma, -limit), np.minimum(middle + 12.0 * sigma, limit)
    x = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * node
    slope = np.where(tested, cross / sigma**2, 0.0)
    left = np.sqrt(np.maximum(covariance[:, 0, 0] - slope * cross, 1e-24))
    density = np.exp(-0.5 * ((x - mean_m[:, 1:]) / sigma[:, None]) ** 2) / (np.sqrt(2.0 * np.pi) * sigma[:, None])
    error = mean_m[:, :1] + slope[:, None] * (x - mean_m[:, 1:])
    beyond = _outside(level_m[:, None], error, left[:, None])
    inside = 0.5 * (high - low) * ((beyond * density) @ weight)
    return np.where(tested, inside, _outside(level_m, mean_m[:, 0], np.sqrt(covariance[:, 0, 0])))
