"""Alert limits: the error that an operation tolerates without an alert."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.input_errors import InputError


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
            if not 0.0 < value < float("inf"):
                raise InputError(f"alert.{field}: an alert limit is positive and finite, not {value!r}.")


# ICAO Annex 10, vol. I, table 3.7.2.4-1; read in Li et al. 2020, Satellite Navigation 1:12, table 1.
APV_I = AlertLimits("APV-I", vertical_m=50.0, horizontal_m=40.0)
LPV_200 = AlertLimits("LPV-200", vertical_m=35.0, horizontal_m=40.0)
APV_II = AlertLimits("APV-II", vertical_m=20.0, horizontal_m=40.0)

BY_NAME = {limits.name: limits for limits in (APV_I, LPV_200, APV_II)}
