"""The true position of the receiver: one point, or a track with times."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.geometry.frames import from_geodetic
from pl_mc.input_errors import InputError, require_path, shown
from pl_mc.receiver.fixes import (
    Fixes,
    finite_number,
    numbers_of,
    require_geodetic,
    require_gps_time,
    require_near_surface,
    text_lines,
    week_seconds,
)
from pl_mc.receiver.nmea import is_nmea, nmea_lines, read_nmea
from pl_mc.receiver.rtklib_pos import is_pos, read_pos
from pl_mc.receiver.tables import read_claims_table
from pl_mc.receiver.ubx import is_ubx, read_ubx
from pl_mc.runtime.unpacking import read_unzipped

# Track samples further apart than this are a gap, across which nothing is interpolated.
LONGEST_STEP_S = 2.0

# A track may have gaps, but a year without a sample is a time that is damaged.
_LONGEST_GAP_S = 366 * 86_400.0

# No receiver in the air is faster; positions may scatter by more than their speed within a short step.
FASTEST_M_S, _SMALLEST_JUMP_M = 2_000.0, 1_000.0

# Times of a 1 Hz track and of receiver epochs agree to rounding error.
_SAME_TIME_S = 1e-6

# Names of files end so, packed or not; what is in them shows in their first lines.
_FILE = re.compile(r"\.(csv|pos|nmea|nma|ubx|log|txt)(\.(gz|bz2|xz|zip|z))?$", re.I)

_XYZ_COLUMNS = ("time_gps_s", "x_m", "y_m", "z_m")


@dataclass(frozen=True)
class Truth:
    """Where the receiver truly was.

    Attributes:
        time_gps_s: (k,), times of a track, increasing [s since 1980-01-06, GPS time]; empty for a fixed point.
        position_m: (k, 3), Earth-fixed positions of the track, (1, 3) for a fixed point [m].
        source: what it was read from, for messages.
        notes: sentences about what the file holds and what of it was left out.
    """

    time_gps_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    source: str
    notes: tuple[str, ...] = ()

    @property
    def is_track(self) -> bool:
        """Whether the position has times."""
        return self.time_gps_s.size > 0

    def at(self, time_gps_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Positions (e, 3) [m] at times (e,) [s], and whether each is known (e,); NaN where it is not.

        A track is interpolated linearly between samples at most 2 s apart, and never continued past its ends.
        """
        times = np.atleast_1d(np.asarray(time_gps_s, float))
        if not self.is_track:
            return np.broadcast_to(self.position_m, (times.size, 3)).copy(), np.ones(times.size, dtype=bool)
        samples = self.time_gps_s
        after = np.searchsorted(samples, times - _SAME_TIME_S).clip(0, samples.size - 1)
        before = (after - 1).clip(0)
        on_sample = np.abs(samples[after] - times) <= _SAME_TIME_S
        step_s = samples[after] - samples[before]
        between = (samples[before] <= times) & (times <= samples[after]) & (step_s > 0)
        known = on_sample | (between & (step_s <= LONGEST_STEP_S + _SAME_TIME_S))
        part = np.where(on_sample, 1.0, (times - samples[before]) / np.where(step_s > 0, step_s, 1.0))
        positions = self.position_m[before] + part[:, None] * (self.position_m[after] - self.position_m[before])
        return np.where(known[:, None], positions, np.nan), known


def is_file(text: str) -> bool:
    """Whether a truth is the name of a file, and not a position."""
    return _FILE.search(text.strip()) is not None


def read_truth(text: str) -> Truth:
    """The true position from ``X,Y,Z`` or from a file with a track.

    Args:
        text: three Earth-fixed coordinates in metres, separated by commas; or the path of a file, plain or packed
            (``.gz``): a ``.csv`` with the columns GPS week, seconds of week, latitude [deg], longitude [deg],
            ellipsoidal height [m], or with a heading ``time_gps_s,x_m,y_m,z_m``, where lines that start with ``#`` are
            comments; a solution of RTKLIB, ``.pos``; a log of NMEA sentences, ``.nmea`` or ``.txt``, with GGA and RMC;
            one of UBX messages, ``.ubx``, with NAV-PVT.

    Raises:
        InputError: neither of both, a file that cannot be read (with its line), or a position away from the
            Earth's surface.
    """
    if not isinstance(text, str):
        raise InputError(f"truth: X,Y,Z or the path of a track is needed, as text, not {shown(text)}.")
    if is_file(text):
        return _read_track(Path(text.strip()))
    parts = text.split(",")
    numbers = [finite_number(part) for part in parts]
    if len(parts) != 3 or any(number is None for number in numbers):
        raise InputError(
            f"truth: {shown(text)} is neither X,Y,Z (three Earth-fixed metres) nor the path of a track (.csv, .pos of "
            "RTKLIB, .nmea, .ubx)."
        )
    position = np.array(numbers, dtype=float)
    require_near_surface(position, "truth")
    return Truth(time_gps_s=np.empty(0), position_m=position[None], source=text)


def read_claims(path: Path) -> Fixes:
    """What a receiver or a program says of its own positions: a ``.pos``, an NMEA or UBX log, or a table.

    Raises:
        InputError: a file that cannot be read, or that claims nothing.
    """
    path = require_path(path, field="claims")
    fixes, lines = _fixes(path, "a .pos of RTKLIB, an NMEA or UBX log or a CSV file is needed")
    fixes = fixes or read_claims_table(path, lines)
    if fixes.covariance_m2 is None and not fixes.level_m:
        claims = "GST sentences" if is_nmea(lines) else "standard deviations above zero"
        raise InputError(f"{path}: it says nothing of the errors of its positions; {claims} are needed.")
    return fixes


def _fixes(path: Path, what: str) -> tuple[Fixes | None, list[str]]:
    """The positions of a file in the form of a program or of receivers, None where it is a table; and its lines."""
    content = read_unzipped(path)
    try:
        lines = text_lines(path, content, what)
    except InputError:
        messages = is_ubx(content)
        fixes = read_ubx(path, content) if messages else None
        lines = [] if fixes else nmea_lines(content)
        if messages and not (fixes or lines):
            raise InputError(f"{path}: none of its UBX messages has a position; those of NAV-PVT are needed.") from None
        if not (fixes or lines):
            raise
        return fixes or read_nmea(path, lines), lines
    return read_pos(path, lines) if is_pos(lines) else read_nmea(path, lines) if is_nmea(lines) else None, lines


def _read_track(path: Path) -> Truth:
    fixes, lines = _fixes(path, "a track is a CSV file, a .pos of RTKLIB or an NMEA or UBX log")
    if fixes is not None:
        _require_possible_steps(fixes)
        return Truth(fixes.time_gps_s, fixes.position_m, fixes.source, fixes.notes)
    _require_whole_end(path, lines)
    rows: list[list[float]] = []
    times: list[float] = []
    columns: tuple[str, ...] | None = None
    for count, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = [field.strip() for field in line.split(",")]
        if columns is None:
            columns, is_heading = _columns(path, count, fields)
            if is_heading:
                continue
        if len(fields) != len(columns):
            raise InputError(f"{path}, line {count}: {len(columns)} columns are needed, not {len(fields)}.")
        where = f"{path}, line {count}"
        time_s, values = _sample(where, fields, columns)
        if times and time_s <= times[-1]:
            raise InputError(f"{where}: its time does not follow that of the line before.")
        if times and time_s - times[-1] > _LONGEST_GAP_S:
            days = (time_s - times[-1]) / 86_400
            raise InputError(f"{where}: its time is {days:.0f} days after that of the line before; one is damaged.")
        if times:
            _require_possible_step(where, time_s - times[-1], _positions([rows[-1], values], columns))
        times.append(time_s)
        rows.append(values)
    if columns is None or not times:
        raise InputError(f"{path}: the track has no samples.")
    return Truth(time_gps_s=np.array(times), position_m=_positions(rows, columns), source=str(path))


def _positions(rows: Sequence[Sequence[float]], columns: tuple[str, ...]) -> NDArray[np.float64]:
    """(k, 3), Earth-fixed positions of the coordinates of lines [m]."""
    values = np.array(rows)
    if columns == _XYZ_COLUMNS:
        return values
    return from_geodetic(np.radians(values[:, 0]), np.radians(values[:, 1]), values[:, 2])


def _require_whole_end(path: Path, lines: Sequence[str]) -> None:
    """Raise `InputError` where the last line has no end and its last number fewer decimals than the one before."""
    if len(lines) < 2 or not lines[-1].strip():
        return
    decimals = [len(line.rpartition(".")[2]) if "." in line.rpartition(",")[2] else 0 for line in lines[-2:]]
    if decimals[1] < decimals[0] and not lines[-2].startswith("#"):
        raise InputError(f"{path}: the file is cut short in its last line, {len(lines)}.")


def _columns(path: Path, count: int, fields: Sequence[str]) -> tuple[tuple[str, ...], bool]:
    """The columns of a track and whether its first line is a heading."""
    heading = all(finite_number(field) is None for field in fields)
    if heading and tuple(fields) == _XYZ_COLUMNS:
        return _XYZ_COLUMNS, True
    if len(fields) == 5:
        return ("week", "seconds of week", "latitude", "longitude", "height"), heading
    raise InputError(
        f"{path}, line {count}: a track has the five columns GPS week, seconds of week, latitude, longitude and "
        f"height, or the heading {','.join(_XYZ_COLUMNS)}."
    )


def _sample(where: str, fields: Sequence[str], columns: tuple[str, ...]) -> tuple[float, list[float]]:
    """Time [s] and the three coordinates of a line."""
    numbers = numbers_of(where, columns, fields)
    if columns == _XYZ_COLUMNS:
        require_gps_time(where, numbers[0])
        require_near_surface(np.array(numbers[1:]), where)
        return numbers[0], numbers[1:]
    week, seconds, *geodetic = numbers
    time_s = week_seconds(where, week, seconds)
    require_geodetic(where, *geodetic)
    return time_s, geodetic


def _require_possible_steps(fixes: Fixes) -> None:
    """Raise `InputError` where one of the steps of a track is impossible, see `_require_possible_step`."""
    step_s, step_m = np.diff(fixes.time_gps_s), np.linalg.norm(np.diff(fixes.position_m, axis=0), axis=1)
    for k in np.flatnonzero(step_m > FASTEST_M_S * step_s + _SMALLEST_JUMP_M):
        where = f"{fixes.source}, {fixes.time_gps_s[k + 1] % 86_400:g} s of the day"
        _require_possible_step(where, step_s[k], fixes.position_m[k : k + 2])


def _require_possible_step(where: str, step_s: float, ends_m: NDArray[np.float64]) -> None:
    """Raise `InputError` where a track goes from one position to the next faster than anything that flies."""
    distance_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    if distance_m > FASTEST_M_S * step_s + _SMALLEST_JUMP_M:
        raise InputError(
            f"{where}: the track jumps by {distance_m / 1e3:.6g} km within {step_s:g} s; one of the two positions "
            "is damaged."
        )
