"""Exact alarm, hazard and missed-detection rates of least squares: what a Monte Carlo run must reproduce.

With Gaussian errors of covariance P^-1 and a fault b the position error is independent of the residuals, the
vertical error is Normal(s.b, VDOP^2), the horizontal one a Gaussian vector and V'PV is noncentral chi-square, so every
rate is a tail or an integral over one variable, or over two for the length of the horizontal error.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from pl_mc.alert import HORIZONTAL, LPV_200, VERTICAL, AlertLimits, as_axis, as_limits, judged_by
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.faults import Faults, require_faults
from pl_mc.geometry.record import Geometry, require_geometry
from pl_mc.input_errors import InputError, require_choice, require_within
from pl_mc.statistics.drawn_sizes import mean_over_sizes
from pl_mc.statistics.either import JointErrors, either_beyond, joint_either_exceedance
from pl_mc.statistics.least_squares import FaultEffects, LsQuantities, fault_effects, ls_quantities
from pl_mc.statistics.length import LEAST_RATIO, joint_length_exceedance, length_beyond
from pl_mc.statistics.noncentral import joint_exceedance, split_at_threshold
from pl_mc.statistics.student import chi2_threshold

PL_ALARM, CHI2_ALARM = "pl", "chi2"
Axis = Literal["vertical", "horizontal", "either"]
RATE_COLUMNS = ("alarm_rate", "hazard_rate", "missed_rate", "misleading_rate", "exceeded_rate", "false_alarm_rate")


def ls_rates(
    g: Geometry,
    faults: Faults,
    *,
    alert: str | AlertLimits = LPV_200,
    axis: Axis | None = None,
    k_vertical: float = K_VERTICAL,
    k_horizontal: float = K_HORIZONTAL,
    alarm: Literal["pl", "chi2"] = "pl",
    p_fa: float = 1e-3,
) -> pd.DataFrame:
    """Exact rates of least squares under each fault.

    VPL = k_vertical sqrt(V'PV / (n - t)) VDOP, HPL likewise (Zhao et al. 2021, eqs 14-16). The noise has the
    sigma that the weights are made from: for noise three times as large give a geometry with three times the sigma.

    An epoch without redundancy (no more satellites than unknowns, or columns that depend on each other) is
    unavailable: it counts as an alarm (alarm_rate 1) and in nothing else.

    Args:
        g: the geometry, one epoch or a series.
        faults: the faults, made for ``g``; a fault counts where all of its satellites are in view. Of one drawn size
            the rates are the mean over its distribution; several that are drawn independently are refused.
        alert: alert limits.
        axis: which of them is used: ``vertical``, ``horizontal`` for the length of the horizontal error, or ``either``
            of both; the vertical one unless given, the horizontal one where the alert has no other.
        k_vertical, k_horizontal: factor of the protection level of that axis.
        alarm: ``pl``, alarm when the level passes the limit; ``chi2``, alarm when V'PV exceeds its fault-free
            quantile.
        p_fa: fault-free alarm probability of ``chi2``; not used by ``pl``.

    Returns:
        One row per epoch and applicable fault, epoch by epoch: ``epoch`` (the geometry's number), ``fault``
        (label), ``bias_m`` (`Faults.scalar_bias_m`) and the probabilities
        ``alarm_rate``: alarm, or unavailable;
        ``hazard_rate``: error > limit;
        ``missed_rate``: hazard and no alarm;
        ``misleading_rate``: error > level and no alarm;
        ``exceeded_rate``: error > level, alarm or not;
        ``false_alarm_rate``: available, alarm, and no hazard.
        Relative accuracy 1e-8 or better down to 1e-290 (noncentrality up to 1e8), horizontally 1e-6, for either
        1e-6 down to 1e-30.

    Raises:
        InputError: faults of another geometry, an unknown alarm, a factor or probability outside its range.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.exact.ls_rates(g, pl_mc.biases(g, "G08:+20m"))
        >>> table[["fault", "alarm_rate"]].round(3)
              fault  alarm_rate
        0  G08:+20m       0.996
    """
    return _ls_rates(
        g, faults, alert=alert, axis=axis, k_vertical=k_vertical, k_horizontal=k_horizontal, alarm=alarm, p_fa=p_fa
    )


@ordinary_arithmetic
def _ls_rates(
    g: Geometry,
    faults: Faults,
    *,
    alert: str | AlertLimits,
    axis: Axis | None = None,
    k_vertical: float = K_VERTICAL,
    k_horizontal: float = K_HORIZONTAL,
    alarm: Literal["pl", "chi2"] = "pl",
    p_fa: float = 1e-3,
    exceeded: bool = True,
) -> pd.DataFrame:
    """`ls_rates`, with or without the column ``exceeded_rate``, which is half of the work of the joint integrals."""
    require_choice(alarm, (PL_ALARM, CHI2_ALARM), field="alarm")
    require_geometry(g)
    require_faults(faults).require_geometry(g)
    alert = as_limits(alert)
    decides = as_axis(axis, alert)
    if faults.drawn.any():
        options: Any = {"alert": alert, "axis": decides, "k_vertical": k_vertical, "k_horizontal": k_horizontal}
        return mean_over_sizes(g, faults, partial(ls_rates, g, **options, alarm=alarm, p_fa=p_fa), RATE_COLUMNS)
    factors = {VERTICAL: (k_vertical, K_VERTICAL), HORIZONTAL: (k_horizontal, K_HORIZONTAL)}
    for other, (given, usual) in factors.items():
        factor = require_within(given, field=f"k_{other}", low=1e-9, high=1e100)
        if other not in judged_by(decides) and factor != usual:
            raise InputError(f"k_{other}: it does nothing on the {decides} axis; leave it out, or give k_{decides}.")
    quantities = ls_quantities(g)
    effects = fault_effects(g, faults, quantities)

    available = np.atleast_1d(quantities.available)[effects.epoch_index]
    epoch = effects.epoch_index[available]
    dof = np.atleast_1d(quantities.dof)[epoch].astype(float)
    dops_m = {VERTICAL: np.atleast_1d(quantities.vdop_m)[epoch], HORIZONTAL: np.atleast_1d(quantities.hdop_m)[epoch]}
    vdop_m, hdop_m = dops_m.values()
    if alarm == CHI2_ALARM:
        threshold = chi2_threshold(dof, p_fa)
    else:
        # V'PV at which the first of the levels reaches its limit.
        threshold = np.min(
            [dof * (alert.limit_m[one] / (factors[one][0] * dops_m[one])) ** 2 for one in judged_by(decides)], axis=0
        )
    rates = np.zeros((len(RATE_COLUMNS), available.size))
    rates[0] = 1.0
    shared = {"threshold": threshold, "dof": dof, "noncentrality": effects.noncentrality[available]}
    upward = k_vertical / np.sqrt(dof)
    if decides == VERTICAL:
        rates[:, available] = error_and_alarm_rates(
            **shared, slope=upward, shift=effects.vertical_m[available] / vdop_m, limit=alert.val_m / vdop_m,
            above=exceeded,
        )  # fmt: skip
    else:
        largest_m, ratio, major, minor = horizontal_errors(quantities, effects, available)
        sideways, limit = k_horizontal * hdop_m / (largest_m * np.sqrt(dof)), alert.hal_m / largest_m
        if decides == HORIZONTAL:
            rates[:, available] = length_and_alarm_rates(
                **shared, slope=sideways, limit=limit, ratio=ratio, major=major, minor=minor, above=exceeded
            )
        else:
            errors = joint_errors(g, quantities, effects, available)
            joint = joint_either_exceedance(**shared, upward=upward, sideways=sideways, errors=errors)
            rates[:, available] = _together(shared, joint, either_beyond(alert.val_m / vdop_m, limit, errors))
    table = _table(g, faults, effects, rates)
    return table if exceeded else table.drop(columns="exceeded_rate")


def joint_errors(g: Geometry, quantities: LsQuantities, effects: FaultEffects, rows: NDArray[np.bool_]) -> JointErrors:
    """The joint law of the vertical and the horizontal errors of pairs."""
    epoch = effects.epoch_index[rows]
    largest_m, ratio, major, minor = horizontal_errors(quantities, effects, rows)
    vdop_m = np.atleast_1d(quantities.vdop_m)[epoch]
    sigma_m = g.as_series().sigma_m
    gain = quantities.gain.reshape(sigma_m.shape) * sigma_m
    sideways = quantities.horizontal_gain.reshape(len(sigma_m), 2, -1) * sigma_m[:, None]
    cross_m2 = np.einsum("pn,pcn->pc", gain[epoch], sideways[epoch])
    axes = np.linalg.eigh(quantities.horizontal_cofactor.reshape(-1, 2, 2)[epoch])[1]
    with_minor, with_major = np.einsum("pca,pc->ap", axes, cross_m2) / (largest_m * vdop_m)
    ratio = np.clip(ratio, LEAST_RATIO, 1.0)
    vertical = effects.vertical_m[rows] / vdop_m
    return JointErrors(vertical, ratio, major, minor, with_major, with_minor / ratio)


def horizontal_errors(
    quantities: LsQuantities, effects: FaultEffects, rows: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Larger standard deviation of the horizontal error [m], and in units of it the smaller one and mean errors.

    The means (pairs,) are those along the two principal axes, the larger one first.
    """
    cofactor = quantities.horizontal_cofactor.reshape(-1, 2, 2)[effects.epoch_index[rows]]
    variance, axes = np.linalg.eigh(cofactor)
    minor, major = np.einsum("pca,pc->ap", axes, effects.horizontal_m[rows])
    largest_m = np.sqrt(variance[:, 1])
    return largest_m, np.sqrt(np.maximum(variance[:, 0], 0.0)) / largest_m, major / largest_m, minor / largest_m


@dataclass(frozen=True)
class Law(ABC):
    """The law of a method whose position is weighted least squares and which has no test but its level.

    There is an alarm where the level of the axis that decides is beyond its limit or there is no solution.

    Attributes:
        k_vertical, k_horizontal: multipliers of the levels.
    """

    k_vertical: float = K_VERTICAL
    k_horizontal: float = K_HORIZONTAL

    @abstractmethod
    def rates(self, g: Geometry, faults: Faults, alert: AlertLimits, axis: Axis = "vertical") -> pd.DataFrame:
        """The exact rates under each fault, as of `ls_rates`."""


@dataclass(frozen=True)
class LeastSquaresLaw(Law):
    """VPL = k_vertical sqrt(V'PV / (n - t)) VDOP, HPL likewise (Zhao et al. 2021, eqs 4, 12, 14, 16)."""

    def rates(
        self, g: Geometry, faults: Faults, alert: AlertLimits, axis: Axis = "vertical", *, exceeded: bool = True
    ) -> pd.DataFrame:
        """As of `Law`; ``exceeded_rate``, which is half of the work, can be left out."""
        given = {f"k_{one}": getattr(self, f"k_{one}") for one in judged_by(axis)}
        return _ls_rates(g, faults, alert=alert, axis=axis, **given, exceeded=exceeded)


@dataclass(frozen=True)
class AprioriLaw(Law):
    """VPL = k_vertical VDOP, HPL = k_horizontal HDOP: multiples of the a-priori standard deviations.

    No error changes them, so that there is an alarm always or never, and every other rate is a tail of the error alone.
    """

    @ordinary_arithmetic
    def rates(self, g: Geometry, faults: Faults, alert: AlertLimits, axis: Axis = "vertical") -> pd.DataFrame:
        judged = judged_by(as_axis(axis, alert))
        quantities = ls_quantities(g)
        effects = fault_effects(g, faults, quantities)
        available = np.atleast_1d(quantities.available)[effects.epoch_index]
        epoch = effects.epoch_index[available]
        dops_m = {VERTICAL: quantities.vdop_m, HORIZONTAL: quantities.hdop_m}
        level_m = {one: getattr(self, f"k_{one}") * np.atleast_1d(dops_m[one])[epoch] for one in judged}
        vdop_m = np.atleast_1d(quantities.vdop_m)[epoch]

        def tails(size_m: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
            """P(errors <= sizes) and P(one of them > its size)."""
            if judged == (VERTICAL,):
                return _normal_tails(size_m[VERTICAL] / vdop_m, effects.vertical_m[available] / vdop_m)
            largest_m, *shape = horizontal_errors(quantities, effects, available)
            if judged == (HORIZONTAL,):
                return length_beyond(size_m[HORIZONTAL] / largest_m, *shape)
            errors = joint_errors(g, quantities, effects, available)
            return either_beyond(size_m[VERTICAL] / vdop_m, size_m[HORIZONTAL] / largest_m, errors)

        limits_m = {one: np.full(epoch.shape, alert.limit_m[one]) for one in judged}
        (harmless, hazard), (_, exceeded) = tails(limits_m), tails(level_m)
        alarm = np.any([level_m[one] > limits_m[one] for one in judged], axis=0)
        rates = np.zeros((len(RATE_COLUMNS), available.size))
        rates[0] = 1.0
        rates[:, available] = alarm, hazard, ~alarm * hazard, ~alarm * exceeded, exceeded, alarm * harmless
        return _table(g, faults, effects, rates)


def _normal_tails(limit: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(|Z + shift| <= limit) and P(... > limit)."""
    mean = np.abs(shift)
    # Both terms in the lower tail, where the normal distribution function keeps its relative accuracy.
    within = special.ndtr(limit - mean) - special.ndtr(-limit - mean)
    return within, special.ndtr(mean - limit) + special.ndtr(-mean - limit)


def _table(g: Geometry, faults: Faults, effects: FaultEffects, rates: FloatArray) -> pd.DataFrame:
    """The table of `ls_rates`, of rates (6, pairs)."""
    return pd.DataFrame(
        {
            "epoch": g.as_series().epoch[effects.epoch_index],
            "fault": np.array(faults.labels, dtype=object)[effects.fault_index],
            "bias_m": faults.scalar_bias_m[effects.fault_index],
            **dict(zip(RATE_COLUMNS, rates, strict=True)),
        }
    )


def error_and_alarm_rates(
    *, threshold: FloatArray, dof: FloatArray, noncentrality: FloatArray, slope: FloatArray, shift: FloatArray,
    limit: FloatArray, above: bool = True,
) -> FloatArray:  # fmt: skip
    """The rates of `RATE_COLUMNS`, (6, pairs), with everything vertical in units of the error's standard deviation.

    Args:
        threshold: (pairs,), V'PV above which there is an alarm.
        dof: (pairs,), degrees of freedom of V'PV.
        noncentrality: (pairs,), noncentrality of V'PV.
        slope: (pairs,), protection level per sqrt(V'PV).
        shift: (pairs,), mean error.
        limit: (pairs,), alert limit.
        above: whether errors beyond the level count where there is an alarm as well; without, at half the cost,
            "exceeded" is what "misleading" is.
    """
    shared = {"threshold": threshold, "dof": dof, "noncentrality": noncentrality}
    joint = joint_exceedance(threshold, dof, noncentrality, slope, shift, above=above)
    return _together(shared, joint, _normal_tails(limit, shift))


def length_and_alarm_rates(
    *, threshold: FloatArray, dof: FloatArray, noncentrality: FloatArray, slope: FloatArray, limit: FloatArray,
    ratio: FloatArray, major: FloatArray, minor: FloatArray, above: bool = True,
) -> FloatArray:  # fmt: skip
    """The rates of `RATE_COLUMNS`, (6, pairs), of the horizontal error, in units of its larger standard deviation.

    Args:
        threshold, dof, noncentrality, slope, limit, above: as of `error_and_alarm_rates`.
        ratio: (pairs,), the smaller standard deviation of the error over the larger one.
        major, minor: (pairs,), mean error along the two principal axes.
    """
    ratio = np.clip(ratio, LEAST_RATIO, 1.0)
    shared = {"threshold": threshold, "dof": dof, "noncentrality": noncentrality}
    joint = joint_length_exceedance(threshold, dof, noncentrality, slope, ratio, major, minor, above=above)
    return _together(shared, joint, length_beyond(limit, ratio, major, minor))


def _together(
    shared: dict[str, FloatArray], joint: tuple[FloatArray, FloatArray], tails: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """The rates, (6, pairs), of V'PV (``shared``) and an error that is independent of it.

    ``joint`` is P(error beyond its level) without and with an alarm, ``tails`` P(error within and beyond its limit).
    """
    quiet, alarmed = split_at_threshold(**shared)
    harmless, hazard = tails
    misleading = np.minimum(joint[0], quiet)
    exceeded = np.minimum(misleading + joint[1], 1.0)
    return np.stack([alarmed, hazard, hazard * quiet, misleading, exceeded, alarmed * harmless])
