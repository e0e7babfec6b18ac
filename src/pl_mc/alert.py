"""Alert limits: the error that an operation tolerates without an alert."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.input_errors import InputError, require_choice, require_positive, shown

# Limits beyond these are slips of the unit, and cannot be computed with.
_LEAST_M, _MOST_M = 1e-6, 1e9
# No vertical limit: one that no level reaches.
_NONE_M = 1e300


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
        if not isinstance(self.name, str):
            raise InputError(f"alert.name: a word is needed, not {shown(self.name)}.")
        for field in ("vertical_m", "horizontal_m"):
            value = getattr(self, field)
            rule = f"an alert limit is positive and finite, {_LEAST_M:g} to {_MOST_M:g} m"
            try:
                limit_m = require_positive(value, field=field)
            except InputError:
                raise InputError(f"alert.{field}: {rule}, not {shown(value)}.") from None
            if not (_LEAST_M <= limit_m <= _MOST_M or limit_m == _NONE_M):
                raise InputError(f"alert.{field}: {rule}, not {limit_m:g}.")
            # Numbers of any type are doubles from here on; a record is frozen.
            object.__setattr__(self, field, limit_m)

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
NPA = AlertLimits("NPA", vertical_m=_NONE_M, horizontal_m=556.0)
TERMINAL = AlertLimits("terminal", vertical_m=_NONE_M, horizontal_m=1_850.0)
EN_ROUTE = AlertLimits("en-route", vertical_m=_NONE_M, horizontal_m=3_700.0)
OCEANIC = AlertLimits("oceanic", vertical_m=_NONE_M, horizontal_m=7_400.0)

# Operations that a sweep can decide on by its vertical limit.
BY_NAME = {limits.name: limits for limits in (APV_I, LPV_200, APV_II, CAT_I, CAT_II, CAT_IIIB)}

# All operations, those with a horizontal limit alone included.
OPERATIONS = BY_NAME | {limits.name: limits for limits in (NPA, TERMINAL, EN_ROUTE, OCEANIC)}


def as_alert(alert: str | AlertLimits) -> AlertLimits:
    """Alert limits of which the vertical one decides, by name (``LPV-200``) or as a record.

    Raises:
        InputError: another name or type; no vertical limit; a horizontal limit that no operation here has: errors
            and levels are judged by the vertical limit alone, and one that was chosen would be ignored.
    """
    if isinstance(alert, str):
        return BY_NAME[require_choice(alert, BY_NAME, field="alert")]
    if not isinstance(alert, AlertLimits):
        kind = alert.__name__ if isinstance(alert, type) else type(alert).__name__
        raise InputError(f"alert: alert limits such as pl_mc.LPV_200 are needed, not {kind}.")
    if not alert.has_vertical:
        raise InputError(f"alert: {alert.name} has no vertical limit, which decides here (of {', '.join(BY_NAME)}).")
    known = sorted({one.horizontal_m for one in OPERATIONS.values()})
    if alert.horizontal_m not in known:
        raise InputError(
            f"alert.horizontal_m: {alert.horizontal_m:g} m would decide nothing: horizontal errors and levels are not "
            f"judged yet, so that only the limits of operations are taken ({', '.join(f'{one:g}' for one in known)})."
        )
    return alert


def horizontal_note(alert: AlertLimits) -> str:
    """That the horizontal limit decides nothing, a sentence for tables and summaries."""
    return (
        f"The horizontal alert limit of {alert.name}, {alert.horizontal_m:g} m, is not judged: "
        f"the vertical one, {alert.vertical_m:g} m, decides alone."
    )
