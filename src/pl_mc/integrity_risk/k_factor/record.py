"""What a calibrated multiplier is, and the alarms that come with it; exact where the method has a law."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize

from pl_mc.alert import AlertLimits
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import EXCEEDED
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, k_of, with_k
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.student import student_factor

FloatArray = NDArray[np.float64]

EXACT, COUNTING, RARE = "exact", "counting", "rare events"

# Multipliers beyond these are no protection levels; K is searched for between them.
LARGEST_FACTOR, SMALLEST_FACTOR = 1e9, 1e-6


@dataclass(frozen=True)
class Found:
    """A multiplier, bounds of it that each have the confidence, and the event's probability at the upper one.

    ``check_probability, check_low, check_high`` are another estimator's, at the multiplier itself, with an interval
    of 95 %; missing where none ran.
    """

    k: float
    low: float
    high: float
    probability: float
    probability_low: float
    probability_high: float
    found: str
    draws: int
    warning: str = ""
    check_probability: float = math.nan
    check_low: float = math.nan
    check_high: float = math.nan


def always_alarms() -> Found:
    """At an epoch without a solution there is no event, whatever the multiplier."""
    return Found(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, EXACT, 0)


def exact_rates(g: Geometry, faults: Faults, method: Method, alert: AlertLimits, k: float) -> pd.DataFrame:
    """The rates of `ls_rates` for a method with an exact law and another multiplier ``k``."""
    law = exact_law(with_k(method, k))
    assert law is not None
    return law.rates(g, faults, alert)


def exact_k_factor(
    g: Geometry, fault: Faults, method: Method, event: str, alert: AlertLimits, target: float
) -> tuple[Found, dict[str, float]]:
    """Of a method with an exact law; ``g`` is a series over which the mean risk counts."""
    quantities, kept = ls_quantities(g), fault.applies(g)[:, 0]
    dof = quantities.dof[kept & quantities.available]

    def mean_rate(k: float, what: str) -> float:
        return float(exact_rates(g, fault, method, alert, k)[f"{what}_rate"].mean())

    def risk(k: float) -> float:
        return mean_rate(k, event)

    if dof.size == 0 or risk(SMALLEST_FACTOR) <= target:
        k = 0.0
    elif event == EXCEEDED and not fault.bias_m.any() and kept.sum() == dof.size == 1:
        law = exact_law(method)
        assert law is not None
        # Student's quantile is the multiplier of m VDOP, of which the field may be a multiple.
        k = float(student_factor(dof, target)[0]) / (law.k_vertical / k_of(method))
    else:
        k = _root_of(risk, target)
    at_k = risk(k) if k > 0 else risk(SMALLEST_FACTOR)
    found = Found(k, k, k, at_k, at_k, at_k, EXACT, 0)
    before, after = (mean_rate(max(value, SMALLEST_FACTOR), "alarm") for value in (k_of(method), k))
    return found, alarm_columns((before, before, before), (after, after, after))


def _root_of(risk: Callable[[float], float], target: float) -> float:
    """The multiplier at which a risk that falls with it is the target."""
    last = 1.0
    while risk(last) > target:
        last *= 4.0
        if last > LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    first = last / 4.0
    while risk(first) <= target and first > SMALLEST_FACTOR:
        first /= 4.0

    def excess(log_k: float) -> float:
        # Logarithms, in which tails are close to straight; what underflows is below any target.
        return math.log(max(risk(math.exp(log_k)), 1e-320)) - math.log(target)

    return math.exp(optimize.brentq(excess, math.log(first), math.log(last), xtol=1e-12, rtol=1e-12))


def alarm_rate(unit_m: FloatArray, k: float, alert: AlertLimits, confidence: float) -> tuple[float, float, float]:
    """Share of the draws that alarm with this multiplier, with its bounds."""
    # Where there is no solution, or the method's test rejects, there is an alarm even for a multiplier of zero.
    alarms = int((np.isinf(unit_m) | (unit_m > alert.vertical_m / max(k, SMALLEST_FACTOR))).sum())
    low, high = clopper_pearson(alarms, unit_m.size, confidence)
    return alarms / unit_m.size, float(low), float(high)


def alarm_columns(before: tuple[float, ...], after: tuple[float, ...]) -> dict[str, float]:
    """Alarm rates with their bounds at the record's multiplier and at the calibrated one."""
    return {
        f"alarm_rate_{when}{bound}": value
        for when, values in (("before", before), ("after", after))
        for bound, value in zip(("", "_low", "_high"), values, strict=True)
    }
