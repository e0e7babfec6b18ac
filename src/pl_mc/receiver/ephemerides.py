"""An ephemeris as a checked record, and the form of the numbers in navigation files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# Fortran's D19.12 with an exponent of two digits, right-aligned, so that a shifted line does not pass for numbers.
_NUMBER = re.compile(r" *[-+]?\d*\.\d+[EeDd][-+]\d\d", re.ASCII)
NUMBER_WIDTH = 19


@dataclass(frozen=True)
class Ephemeris:
    """A record of the broadcast orbit and clock of a satellite.

    Attributes:
        name: of the satellite.
        message: that it was sent in, such as LNAV.
        toe_gps_s: reference time [s since 1980-01-06, GPS time].
        sent_gps_s: time of transmission, or minus infinity where the record says none.
        health: bits by which the satellite forbids the use of its signals.
        predicted: whether its accuracy is predicted at all.
        group_delays_s: those that it has, by the names in `pl_mc.receiver.signals` [s].
        week_gps_s: begin of the week of ``toe_gps_s`` in which the record counts seconds.
        record: what the library evaluates.
    """

    name: str
    message: str
    toe_gps_s: float
    sent_gps_s: float
    health: int
    predicted: bool
    group_delays_s: Mapping[str, float]
    week_gps_s: float
    record: Any

    @property
    def forbids(self) -> bool:
        """Whether the satellite says that something of it may not be used, or not how well."""
        return self.health != 0 or not self.predicted


def fields_of(text: str, count: int, width: int = NUMBER_WIDTH) -> list[str]:
    """The columns of each number of a line, as far as it goes."""
    return [text[at : at + width] for at in range(0, min(len(text.rstrip()), count * width), width)]


def misshapen(fields: Sequence[str], width: int = NUMBER_WIDTH) -> str:
    """The first field that is neither blank nor a number that ends with its columns; empty where there is none."""
    return next((f.strip() for f in fields if f.strip() and not (len(f) == width and _NUMBER.fullmatch(f))), "")
