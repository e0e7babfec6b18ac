"""UBX logs of u-blox receivers: positions, accuracies and protection levels (u-blox interface descriptions, UBX-NAV).

NAV-PVT, NAV-HPPOSLLH and NAV-POSLLH have positions above the ellipsoid with hAcc and vAcc, NAV-PL protection levels
of the same time of the week; the week is that of NAV-TIMEGPS or of the dates of NAV-PVT.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from pl_mc.geometry.frames import from_geodetic
from pl_mc.input_errors import InputError
from pl_mc.receiver.fixes import SECONDS_PER_WEEK, Fixes, require_geodetic, unusable_claim, utc_seconds
from pl_mc.receiver.tables import HACC_AS, covariance_of
from pl_mc.runtime import pyubx2_adapter as library

# Messages with a position; of several of one time the first.
_POSITIONS = ("NAV-PVT", "NAV-HPPOSLLH", "NAV-POSLLH")
_KINDS = (*_POSITIONS, "NAV-PL", "NAV-TIMEGPS")

# Of NAV-PVT: a fix in three dimensions, of satellites alone or with dead reckoning.
_FIXES_3D = (3, 4)

# Of NAV-PL: along north, east, down; along and across the track, vertical; along the axes of an ellipse, vertical.
_AXES, _TRACK, _ELLIPSE = 1, 2, 3


def is_ubx(content: bytes) -> bool:
    """Whether bytes that are no text are those of a log with messages."""
    return library.BEGIN in content


def read_ubx(path: Path, content: bytes) -> Fixes | None:
    """The positions of a log and what the receiver claims of them; None where it has no message with a position.

    The horizontal level is the longer axis of an ellipse, or of levels along two axes the root of the sum of their
    squares.

    Raises:
        InputError: no position with a fix, no week, or the library of the messages is not installed.
    """
    found, damaged = library.messages(content, _KINDS, str(path))
    if not any(one.identity in _POSITIONS for one in found):
        return None
    left = Counter({"that are damaged or cut short": damaged})
    time_of = _clock(path, found)
    best: dict[int, tuple[int, Any]] = {}
    levels: dict[int, tuple[float, float]] = {}
    risks: set[str] = set()
    for place, one in enumerate(found):
        if one.identity in _POSITIONS:
            rank, time_ms = _POSITIONS.index(one.identity), time_of(place, one)
            if time_ms not in best or rank < best[time_ms][0]:
                best[time_ms] = rank, one
        elif one.identity == "NAV-PL":
            valid_m = _level_m(one)
            left["of NAV-PL without a valid level"] += valid_m is None
            if valid_m is not None:
                levels[time_of(place, one)] = valid_m
                risks.add(f"{one.tmirCoeff * 10.0**one.tmirExp:g} %")
    kept = {}
    for time_ms, (_, one) in sorted(best.items()):
        fault = _fault(one)
        left[fault] += bool(fault)
        if not fault:
            kept[time_ms] = one
    told = ((number, what) for what, number in left.items() if number)
    notes = tuple(f"{path.name}: {number:,} UBX messages {what} were left out." for number, what in told)
    if not kept:
        raise InputError(f"{path}: no UBX message gives a position with a fix. {' '.join(notes)}")
    latitude, longitude = np.radians(np.array([(one.lat, one.lon) for one in kept.values()])).T
    accuracy_m = np.array([(one.hAcc, one.vAcc) for one in kept.values()]) / 1e3
    level_m = np.array([levels.get(time_ms, (np.nan, np.nan)) for time_ms in kept], dtype=np.float64)
    used = [one.numSV for one in kept.values() if one.identity == "NAV-PVT"]
    counts = Counter(one.identity for one in kept.values())
    read = [f"{number:,} positions of {name}" for name, number in counts.items()]
    with_level = int(np.isfinite(level_m).any(axis=1).sum())
    if levels:
        of = f", which are to be misleading in {' and '.join(sorted(risks))} of epochs at most, on each axis"
        read.append(f"{with_level:,} protection levels of NAV-PL{of}")
    return Fixes(
        source=str(path), time_gps_s=np.array(list(kept)) / 1e3,
        position_m=from_geodetic(latitude, longitude, np.array([one.height for one in kept.values()]) / 1e3),
        covariance_m2=covariance_of(np.where(unusable_claim(accuracy_m), np.nan, accuracy_m)),
        level_m={"hpl": level_m[:, 0], "vpl": level_m[:, 1]} if with_level else None,
        satellites=np.array(used) if len(used) == len(kept) else None,
        of_sigma=HACC_AS, notes=(f"{path.name}: {', '.join(read)}.", *notes),
    )  # fmt: skip


def _clock(path: Path, found: Sequence[Any]) -> Callable[[int, Any], int]:
    """The GPS time [ms] of a message by its place among others and its time of the week."""
    places: list[int] = []
    weeks_s: list[float] = []
    for place, one in enumerate(found):
        time_s = _dated_s(one)
        if time_s is not None:
            places.append(place)
            weeks_s.append(time_s)
    if not places:
        raise InputError(
            f"{path}: its times have no week; NAV-TIMEGPS with a valid week or NAV-PVT with a valid date are needed."
        )

    def time_of(place: int, one: Any) -> int:
        after = bisect(places, place)
        near = min((k for k in (after - 1, after) if 0 <= k < len(places)), key=lambda k: abs(places[k] - place))
        weeks = round((weeks_s[near] - one.iTOW / 1e3) / SECONDS_PER_WEEK)
        return int(weeks * 1000 * SECONDS_PER_WEEK + one.iTOW)

    return time_of


def _dated_s(one: Any) -> float | None:
    """GPS time by which the week of a message is known [s]; None where it says none."""
    if one.identity == "NAV-TIMEGPS":
        return one.week * SECONDS_PER_WEEK + one.iTOW / 1e3 if one.weekValid and one.towValid else None
    if one.identity != "NAV-PVT" or not (one.validDate and one.validTime):
        return None
    try:
        return utc_seconds(datetime(one.year, one.month, one.day, one.hour, one.min) + timedelta(seconds=one.second))
    except (ValueError, InputError):
        return None


def _fault(one: Any) -> str:
    """Why a message gives no position, in words; empty where it does."""
    if one.identity == "NAV-PVT" and not (one.gnssFixOk and one.fixType in _FIXES_3D and not one.invalidLlh):
        return "of NAV-PVT without a fix in three dimensions"
    if one.identity == "NAV-HPPOSLLH" and one.invalidLlh:
        return "of NAV-HPPOSLLH that are not valid"
    # Before its first fix a receiver gives positions of which it says that it knows nothing.
    if unusable_claim(np.array([one.hAcc, one.vAcc]) / 1e3).all():
        return f"of {one.identity} without an accuracy"
    try:
        require_geodetic("", one.lat, one.lon, one.height / 1e3)
    except InputError:
        return f"of {one.identity} away from the Earth's surface"
    return ""


def _level_m(one: Any) -> tuple[float, float] | None:
    """The horizontal and vertical level of NAV-PL [m]; None where it has none that is valid."""
    length_m = np.array([one.plPos1, one.plPos2, one.plPos3]) / 1e3
    if not one.plPosValid or one.plPosFrame not in (_AXES, _TRACK, _ELLIPSE) or unusable_claim(length_m).any():
        return None
    first, second, up = length_m.tolist()
    return max(first, second) if one.plPosFrame == _ELLIPSE else math.hypot(first, second), up
