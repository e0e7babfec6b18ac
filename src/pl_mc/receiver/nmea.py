"""NMEA 0183 logs: positions of GGA, dates of RMC and ZDA, standard deviations of GST, in the fields of version 2.3 on.

Every sentence is held to its checksum. Times are UTC; a GGA has none but that of the day, and takes the date that comes
nearest to it in the log.
"""

from __future__ import annotations

import functools
import operator
import re
from bisect import bisect
from collections import Counter
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from pl_mc.geometry.frames import from_geodetic
from pl_mc.input_errors import InputError
from pl_mc.receiver.fixes import Fixes, finite_number, in_time_order, require_geodetic, unusable_claim, utc_seconds

_SENTENCE = re.compile(r"\$([A-Z]{2})([A-Z]{3}),([^$*\r\n]*)\*([0-9A-Fa-f]{2})")
_NAMES = ("GGA", "RMC", "ZDA", "GST")
_DAY_S = 86_400.0
# Two digits of a year count from here; the system that these receivers use began in 1980.
_CENTURY, _FIRST_YEAR = 100, 80
_LEAST_HEADS = 20


class _Damaged(ValueError):
    """A sentence that does not say what its kind says."""


def is_nmea(lines: Sequence[str]) -> bool:
    """Whether one of the first lines holds a sentence."""
    return any(_SENTENCE.search(line) for line in lines[:_LEAST_HEADS])


def nmea_lines(content: bytes) -> list[str]:
    """Of bytes that are no text, such as a log with noise or binary messages, the lines with sentences."""
    lines = content.decode("latin-1").replace("\r", "\n").split("\n")
    return [line for line in lines if _SENTENCE.search(line)]


def read_nmea(path: Path, lines: Sequence[str]) -> Fixes:
    """The positions of a log, above the ellipsoid, and what GST sentences of the same time claim of them.

    Sentences that are damaged, and positions without a fix, cost themselves and are counted in the notes.

    Raises:
        InputError: no GGA with a fix, none with its height above the ellipsoid, no date.
    """
    left: Counter[str] = Counter()
    # Places in the log and moments of what has a date; seconds of the day of what has none.
    dated: tuple[list[int], list[datetime]] = ([], [])
    found: list[tuple[int, float, list[float], int]] = []
    claimed: list[tuple[int, float, list[float]]] = []
    for place, line in enumerate(lines):
        if "$" not in line:
            continue
        sentence = _SENTENCE.search(line)
        if sentence is None:
            left["without the form of a sentence"] += any(name in line for name in _NAMES)
            continue
        kind = sentence[2]
        if kind not in _NAMES:
            continue
        body = sentence[0][1:-3]
        if functools.reduce(operator.xor, body.encode(), 0) != int(sentence[4], 16):
            left["with another checksum than their own"] += 1
            continue
        fields = sentence[3].split(",")
        try:
            if kind == "GGA":
                if _field(fields, 5) in ("", "0"):
                    left["of GGA without a fix"] += 1
                elif not (_field(fields, 8) and _field(fields, 10)):
                    left["of GGA without a height above the ellipsoid"] += 1
                else:
                    used = finite_number(_field(fields, 6))
                    position = _geodetic(f"{path}, line {place + 1}", fields)
                    found.append((place, _of_day(fields[0]), position, -1 if used is None else int(used)))
            elif kind == "GST":
                claimed.append((place, _of_day(fields[0]), [_number(_field(fields, k)) for k in (6, 5, 7)]))
            else:
                moment = _date(kind, fields)
                if moment is not None:
                    dated[0].append(place)
                    dated[1].append(moment)
        except _Damaged:
            left["with fields that are none of theirs"] += 1
    notes = tuple(f"{path.name}: {number:,} NMEA sentences {what} were left out." for what, number in left.items())
    if not found:
        raise InputError(f"{path}: no GGA sentence gives a position. {' '.join(notes)}".rstrip())
    if not dated[0]:
        raise InputError(f"{path}: it has no date; RMC or ZDA sentences are needed beside those of GGA.")
    times = np.array([_time(place, second, dated) for place, second, _, _ in found])
    places, order = in_time_order(times)
    by_time = {_time(place, second, dated): sigma for place, second, sigma in claimed}
    covariance = np.array([_covariance(by_time.get(time)) for time in times[places]])
    degrees = np.array([position for _, _, position, _ in found])[places]
    satellites = np.array([number for *_, number in found])[places]
    return Fixes(
        source=str(path), time_gps_s=times[places],
        position_m=from_geodetic(np.radians(degrees[:, 0]), np.radians(degrees[:, 1]), degrees[:, 2]),
        covariance_m2=covariance if np.isfinite(covariance).any() else None,
        satellites=None if -1 in satellites else satellites,
        of_sigma="the standard deviations of its GST sentences",
        notes=(f"{path.name}: {len(times):,} positions of GGA sentences.", *notes, *order),
    )  # fmt: skip


def _field(fields: Sequence[str], place: int) -> str:
    """A field of a sentence, empty where the sentence ends before it."""
    return fields[place].strip() if place < len(fields) else ""


def _number(text: str) -> float:
    """A field as a number, NaN where it is empty."""
    value = finite_number(text)
    if value is None and text:
        raise _Damaged
    return np.nan if value is None else value


def _of_day(text: str) -> float:
    """Seconds since midnight of ``hhmmss.ss``."""
    value = finite_number(text)
    if value is None or not re.match(r"\d{6}(\.|$)", text):
        raise _Damaged
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if hours > 23 or minutes > 59 or seconds >= 61.0:
        raise _Damaged
    return 3600.0 * hours + 60.0 * minutes + seconds


def _geodetic(where: str, fields: Sequence[str]) -> list[float]:
    """Latitude, longitude [deg] and height above the ellipsoid [m] of a GGA."""
    angles = []
    for text, side, sides, digits in ((fields[1], fields[2], "NS", 2), (fields[3], fields[4], "EW", 3)):
        if not re.match(rf"\d{{{digits + 2}}}(\.\d*)?$", text) or side not in tuple(sides):
            raise _Damaged
        degrees, minutes = int(text[:digits]), float(text[digits:])
        if minutes >= 60.0:
            raise _Damaged
        angles.append((degrees + minutes / 60.0) * (-1.0 if side == sides[1] else 1.0))
    height_m = _number(_field(fields, 8)) + _number(_field(fields, 10))
    try:
        require_geodetic(where, angles[0], angles[1], height_m)
    except InputError:
        raise _Damaged from None
    return [*angles, height_m]


def _date(kind: str, fields: Sequence[str]) -> datetime | None:
    """The moment of an RMC or ZDA in UTC; None where it is not valid or has none."""
    text = _field(fields, 8) if kind == "RMC" else "".join(_field(fields, k) for k in (1, 2, 3))
    if not text or not fields[0] or (kind == "RMC" and fields[1] != "A"):
        return None
    if not re.match(r"\d{6}$|\d{8}$", text):
        raise _Damaged
    year = int(text[4:])
    if len(text) == 6:
        year += 1900 if year % _CENTURY >= _FIRST_YEAR else 2000
    try:
        return datetime(year, int(text[2:4]), int(text[:2])) + timedelta(seconds=_of_day(fields[0]))
    except ValueError:
        raise _Damaged from None


def _time(place: int, second: float, dated: tuple[list[int], list[datetime]]) -> float:
    """GPS time of a second of the day, on the day that brings it nearest to the nearest moment of the log [s]."""
    after = bisect(dated[0], place)
    near = min(
        (k for k in (after - 1, after) if 0 <= k < len(dated[0])), key=lambda k: abs(dated[0][k] - place)
    )  # fmt: skip
    moment = dated[1][near]
    midnight = moment.replace(hour=0, minute=0, second=0, microsecond=0)
    days = round(((moment - midnight).total_seconds() - second) / _DAY_S)
    # To the microsecond, so that sentences of one time have one.
    return utc_seconds(midnight + timedelta(days=days, seconds=round(second, 6)))


def _covariance(sigma_m: Sequence[float] | None) -> np.ndarray:
    """(3, 3), of the errors east, north, up [m^2]; NaN where nothing usable is claimed."""
    if sigma_m is None or unusable_claim(np.array(sigma_m)).any():
        return np.full((3, 3), np.nan)
    return np.diag(np.square(sigma_m))
