"""Positions that a receiver or another program wrote, with what it says of their errors; the checks that all share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.runtime.sidereon_adapter import gps_minus_utc_s

# A receiver is on the ground, at sea or in the air: from below the radius at the poles to well above the equator.
LOWEST_RADIUS_M, HIGHEST_RADIUS_M = 6_300_000.0, 6_500_000.0

SECONDS_PER_WEEK = 604_800.0
LAST_WEEK = 9999.0

# Claimed standard deviations beyond this are a receiver's way to say that it knows nothing.
_LARGEST_CLAIM_M = 1e6


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """Positions at k times.

    Attributes:
        source: the file.
        time_gps_s: (k,), increasing [s since 1980-01-06, GPS time].
        position_m: (k, 3), Earth-fixed [m]; NaN where the file gives errors instead.
        error_m: (k, 3), errors east, north, up as the file gives them [m]; None where it gives positions.
        covariance_m2: (k, 3, 3), what is claimed of the errors east, north, up [m^2]; None where nothing is, NaN where
            it is not at one time.
        level_m: claimed protection levels by ``hpl`` and ``vpl``, each (k,) [m]; NaN where there is none.
        satellites: (k,), how many were used; None where it is not told.
        of_sigma: what the covariance was made of, within a sentence; empty without one.
        notes: sentences about what was left out or taken for granted.
    """

    source: str
    time_gps_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    error_m: NDArray[np.float64] | None = None
    covariance_m2: NDArray[np.float64] | None = None
    level_m: dict[str, NDArray[np.float64]] | None = None
    satellites: NDArray[np.int64] | None = None
    of_sigma: str = ""
    notes: tuple[str, ...] = ()


def in_time_order(time_gps_s: NDArray[np.float64]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Places of times in increasing order, each time once, the first one of it; and a note where others were there."""
    times, places = np.unique(time_gps_s, return_index=True)
    twice = time_gps_s.size - times.size
    return places, (f"{twice:,} positions have the time of another one before them, and were left out.",) * bool(twice)


def unusable_claim(sigma_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(...,), which claimed standard deviations say nothing: missing, none above zero, or beyond all use."""
    return ~(np.isfinite(sigma_m) & (sigma_m > 0) & (sigma_m < _LARGEST_CLAIM_M))


def text_lines(path: Path, content: bytes, what: str) -> list[str]:
    """The lines of a text file, whatever ends them; ``what`` is what it should be, for the sentence of an error."""
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    except UnicodeDecodeError:
        raise InputError(f"{path}: it is not a text file; {what}.") from None


def finite_number(text: str) -> float | None:
    """``text`` as a finite number, None if it is none; digits of other alphabets and underscores are none."""
    try:
        value = float(text) if text.isascii() and "_" not in text else np.nan
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def numbers_of(where: str, names: Sequence[str], fields: Sequence[str]) -> list[float]:
    """Fields of a line as numbers; an `InputError` names the one that is none."""
    numbers = []
    for name, field in zip(names, fields, strict=True):
        number = finite_number(field)
        if number is None:
            raise InputError(f"{where}: the {name} {field!r} is not a finite number.")
        numbers.append(number)
    return numbers


def week_seconds(where: str, week: float, seconds: float) -> float:
    """GPS time of a week and seconds of it [s]; an `InputError` where they are none."""
    _require_range(where, "GPS week", week, 0.0, LAST_WEEK)
    _require_range(where, "seconds of week", seconds, 0.0, SECONDS_PER_WEEK)
    if week != int(week):
        raise InputError(f"{where}: the GPS week {week:g} is not a whole number.")
    return week * SECONDS_PER_WEEK + seconds


def require_geodetic(where: str, latitude_deg: float, longitude_deg: float, height_m: float) -> None:
    """Raise `InputError` for a latitude, longitude [deg] or height [m] that no receiver has."""
    _require_range(where, "latitude", latitude_deg, -90.0, 90.0)
    _require_range(where, "longitude", longitude_deg, -180.0, 360.0)
    _require_range(where, "height", height_m, -1000.0, 50_000.0)


def _require_range(where: str, name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise InputError(f"{where}: the {name} {value:g} is outside {low:g} to {high:g}.")


def require_gps_time(where: str, time_gps_s: float) -> None:
    """Raise `InputError` for seconds that are no GPS time."""
    if not 0.0 <= time_gps_s < LAST_WEEK * SECONDS_PER_WEEK:
        raise InputError(f"{where}: the time_gps_s {time_gps_s:g} is outside GPS weeks 0 to {LAST_WEEK:g}.")


def utc_seconds(date: datetime) -> float:
    """GPS time of a moment in UTC [s since 1980-01-06]."""
    seconds = gps_seconds(date, field="time")
    # Julian date of the GPS epoch, 2444244.5.
    return seconds + gps_minus_utc_s(2_444_244.5 + seconds / 86_400.0)


def require_near_surface(position_m: NDArray[np.float64], where: str) -> None:
    """Raise `InputError`, with the likely cause, unless the position is on the ground or in the air."""
    # Clipped, so that the square of an enormous figure is a number.
    radius_m = float(np.linalg.norm(np.clip(position_m, -1e100, 1e100)))
    if LOWEST_RADIUS_M <= radius_m <= HIGHEST_RADIUS_M:
        return
    if LOWEST_RADIUS_M <= 1e3 * radius_m <= HIGHEST_RADIUS_M:
        cause = "the figures look like kilometres"
    elif np.abs(position_m[0]) <= 90 and np.abs(position_m[1]) <= 360:
        cause = "the figures look like latitude, longitude and height"
    else:
        cause = "are these Earth-fixed X, Y, Z in metres?"
    raise InputError(
        f"{where}: the position is {radius_m / 1e3:.6g} km from the Earth's centre, and a receiver is "
        f"{LOWEST_RADIUS_M / 1e3:.0f} to {HIGHEST_RADIUS_M / 1e3:.0f} km from it; {cause}."
    )
