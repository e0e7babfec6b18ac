"""Alert limits: the error that an operation tolerates without an alert."""

from __future__ import annotations

import numbers
from dataclasses import dataclass

from pl_mc.input_errors import InputError, shown


@dataclass(frozen=True)
class AlertLimits:
    """Alert limits of one operation.

    Attributes:
        name: the operation.
        vertical_m: vertical alert limit, VAL [m].
        horizontal_m: horizontal alert limit, HAL [m].
    """

    name: str
    vertical_m: float
    horizontal_m: float

    def __post_init__(self) -> None:
        for field in ("vertical_m", "horizontal_m"):
            value = getattr(self, field)
            number = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if not (number and 0.0 < value < float("inf")):
                raise InputError(f"alert.{field}: an alert limit is positive and finite, not {shown(value)}.")

    @property
    def has_vertical(self) -> bool:
        """Whether the operation has a vertical limit; one without it has a number that no level reaches."""
        return self.vertical_m < _NONE_M


# ICAO Annex 10, vol. I, table 3.7.2.4-1; read in Li et al. 2020, Satellite Navigation 1:12, table 1. Of the
# vertical limits of category I, 10 to 15 m (newer editions: up to 35 m), this is the smallest.
APV_I = AlertLimits("APV-I", vertical_m=50.0, horizontal_m=40.0)
LPV_200 = AlertLimits("LPV-200", vertical_m=35.0, horizontal_m=40.0)
APV_II = AlertLimits("APV-II", vertical_m=20.0, horizontal_m=40.0)
CAT_I = AlertLimits("CAT-I", vertical_m=10.0, horizontal_m=40.0)

# The same table; operations of precision approach down to the runway, and those without vertical guidance.
CAT_II = AlertLimits("CAT-II", vertical_m=5.3, horizontal_m=17.3)
CAT_IIIB = AlertLimits("CAT-IIIB", vertical_m=5.2, horizontal_m=15.5)
# No vertical limit: one that no level reaches.
_NONE_M = 1e300
NPA = AlertLimits("NPA", vertical_m=_NONE_M, horizontal_m=556.0)
TERMINAL = AlertLimits("terminal", vertical_m=_NONE_M, horizontal_m=1_850.0)
EN_ROUTE = AlertLimits("en-route", vertical_m=_NONE_M, horizontal_m=3_700.0)
OCEANIC = AlertLimits("oceanic", vertical_m=_NONE_M, horizontal_m=7_400.0)

# Operations that a sweep can decide on by its vertical limit.
BY_NAME = {limits.name: limits for limits in (APV_I, LPV_200, APV_II, CAT_I, CAT_II, CAT_IIIB)}

# All operations, those with a horizontal limit alone included.
OPERATIONS = BY_NAME | {limits.name: limits for limits in (NPA, TERMINAL, EN_ROUTE, OCEANIC)}
