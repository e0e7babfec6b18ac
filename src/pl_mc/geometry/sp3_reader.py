"""From an SP3 file on disk to a table of positions.

The library reads a file whole or not at all, in silence takes one of two records of a satellite at an epoch, and
numbers beside their columns. So lines that are no record of SP3 are left out first, each with a note; what it then
reads is dates, positions, flags and the time system.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.geometry.orbits import ORBIT_RADIUS_M
from pl_mc.input_errors import InputError
from pl_mc.runtime import sidereon_adapter as library
from pl_mc.runtime.unpacking import read_unzipped

# Eleven positions belong to a polynomial of degree ten, which holds millimetres up to a quarter of an hour.
NODES = 11
_LONGEST_INTERVAL_S = 900.0

# The largest coordinate of an SP3 file stands for none.
_NO_COORDINATE_M = 9.99999e8

_LARGEST_BYTES = 200_000_000
_EPOCH = re.compile(r"\*  (\d{4})" + r" ([ \d]\d)" * 5 + r"\.\d{8}", re.ASCII)
_COORDINATE = re.compile(r"(?=.{14}$) *-?\d+\.\d{6}", re.ASCII)
_SECOND_LINE = re.compile(r"##(?: +\d+\.?\d*){5} *", re.ASCII)
_NO_SECOND_LINE = "##    0      0.00000000     0.00000000     0 0.0000000000000"
_NAME = re.compile(r"[ A-Z][ \d]\d", re.ASCII)
_TIME_SYSTEMS = ("GPS", "GAL", "QZS", "IRN", "BDT", "TAI", "UTC", "GLO")

# The first is 1980-01-06, the second noon of 2000-01-01; their difference, and the Julian date of the second.
_J2000_GPS_S, _J2000_JULIAN_DATE, _DAY_S = 630_763_200.0, 2_451_545.0, 86_400.0

_MOST_NAMED = 3


@dataclass(frozen=True)
class Sp3Table:
    """What a file says of n epochs and m satellites.

    Attributes:
        path: the file, for messages.
        first_gps_s, interval_s: first epoch, GPS seconds, and time between epochs [s].
        place: (n,), number of each epoch, counted in intervals from the first; ascending, with gaps where the file
            has some.
        names: m satellites.
        position_m: (n, m, 3), Earth-fixed [m]; NaN where missing.
        notes: sentences about what was left out.
    """

    path: Path
    first_gps_s: float
    interval_s: float
    place: NDArray[np.int64]
    names: tuple[str, ...]
    position_m: NDArray[np.float64]
    notes: tuple[str, ...]

    @property
    def time_gps_s(self) -> NDArray[np.float64]:
        """(n,), the epochs [s]."""
        return self.first_gps_s + self.interval_s * self.place.astype(np.float64)


@dataclass
class _Sieved:
    """Lines that can be read, and what is said of the others.

    Attributes:
        lines: what the library gets.
        unread: "line 25" with what stands there, for lines that are no record.
        twice: satellites with two records at an epoch that differ.
        notes: further sentences.
    """

    lines: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    twice: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_sp3(path: Path, letters: Set[str]) -> Sp3Table:
    """The positions of the systems with these letters in an SP3 file, versions a to d, plain or packed.

    Raises:
        InputError: a file that is missing, of another kind, without a header that can be read, or too short.
    """
    sieved = _sieved(path, _text(path), letters)
    try:
        product = library.orbits("\n".join(sieved.lines))
    except library.Unreadable as error:
        raise InputError(f"{path}: it cannot be read as an SP3 file ({error}).") from None
    header, seconds = product.header, np.asarray(product.epochs_j2000_seconds, dtype=float)
    if len(seconds) < NODES:
        raise InputError(f"{path}: it holds {len(seconds)} epochs; interpolation needs at least {NODES}.")
    behind_s = library.seconds_behind_gps(product, list(_J2000_JULIAN_DATE + seconds / _DAY_S))
    times = seconds + _J2000_GPS_S + np.array(behind_s)
    interval_s, kept, place = _grid(path, times)
    names = tuple(name for name in product.satellites if name[0] in letters)
    position_m = np.full((len(kept), len(names), 3), np.nan)
    moved: list[str] = []
    for row, index in enumerate(kept):
        for column, name in enumerate(names):
            try:
                state = product.state(name, int(index))
            except KeyError:
                continue
            position = np.asarray(state.position_m, dtype=float)
            if np.abs(position).max() >= _NO_COORDINATE_M:
                continue
            if state.maneuver or not ORBIT_RADIUS_M[0] < np.linalg.norm(position) < ORBIT_RADIUS_M[1]:
                where = "" if state.maneuver else f", {np.linalg.norm(position) / 1e3:.0f} km from the Earth's centre"
                moved += [f"{name} at {iso_date(times[index])}{where}"] if where else []
                continue
            position_m[row, column] = position
    notes = [
        *_told(path, "is no record of SP3 and was left out", "are no records of SP3 and were left out", sieved.unread),
        *_told(path, "has two records that differ; it counts as missing", "have two records each that differ; they "
               "count as missing", sieved.twice),
        *_told(path, "where no navigation satellite is, was left out", "where no navigation satellites are, were left "
               "out", moved),
        *_told(path, "is out of step with the others and was left out", "are out of step with the others and were left "
               "out", [f"the epoch {iso_date(times[k])}" for k in sorted(set(range(len(times))) - set(kept))]),
        *sieved.notes,
    ]  # fmt: skip
    declared, start = product.declared_epoch_count, product.declared_start_j2000_s
    if declared != len(times):
        notes.append(f"{path.name}: it promises {declared} epochs and holds {len(times)}; is it cut short?")
    if start is None or abs(start - seconds[0]) > 1e-3 or abs(header.epoch_interval_s - interval_s) > 1e-6:
        notes.append(
            f"{path.name}: its head does not fit its epochs, which begin at {iso_date(times[kept[0]])} (GPS time) and "
            f"come every {interval_s:g} s; these were taken."
        )
    return Sp3Table(path, float(times[kept[0]]), interval_s, place, names, position_m, tuple(notes))


def iso_date(time_gps_s: float) -> str:
    """A GPS time as it is written in messages."""
    try:
        return (GPS_EPOCH + timedelta(seconds=round(float(time_gps_s), 6))).isoformat()
    except OverflowError:
        return "after the year 9999"


def _text(path: Path) -> str:
    content = read_unzipped(path)
    if b"\0" in content:
        raise InputError(f"{path}: it holds binary data and is not an SP3 file.")
    if len(content) > _LARGEST_BYTES:
        raise InputError(f"{path}: it is longer than {_LARGEST_BYTES / 1e6:g} MB, which no SP3 file is.")
    text = content.removeprefix(b"\xef\xbb\xbf").decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise InputError(f"{path}: the file is empty.")
    return text


def _sieved(path: Path, text: str, letters: Set[str]) -> _Sieved:
    """The lines of the head that say something, and records of positions that are whole and of systems wanted."""
    lines = text.split("\n")
    number = next(k for k, line in enumerate(lines) if line.strip())
    if not re.match(r"#[a-d][PV]", lines[number]):
        raise InputError(f"{path}: it is not an SP3 file; its first line does not begin with #a, #b, #c or #d.")
    begin = next((k for k, line in enumerate(lines) if line.startswith("* ")), len(lines))
    end = next((k for k in range(begin, len(lines)) if lines[k].rstrip() == "EOF"), len(lines))
    sieved = _Sieved()
    names = _head(path, lines[number:begin], sieved)
    if end == len(lines):
        # The last line of a file that is cut short may be half of one.
        end -= 1
        sieved.notes.append(f"{path.name}: it ends without EOF; is it cut short?")
    epoch: dict[str, str] = {}
    for number, line in enumerate(lines[begin:end], start=begin + 1):
        name = _name(line[1:4]) if line[:1] == "P" else ""
        if line.startswith("*"):
            date = line[:31]
            if date != epoch.get(""):
                _flush(sieved, epoch)
                epoch = {"": date} if _is_epoch(date) else {}
            if not epoch:
                sieved.unread.append(f"line {number} ({line.strip()[:40]!r})")
        elif name and name[0] in letters and epoch:
            whole = all(_COORDINATE.fullmatch(line[k : k + 14]) for k in (4, 18, 32))
            if not whole or name not in names:
                sieved.unread.append(f"line {number} ({line.strip()[:40]!r})")
            elif epoch.setdefault(name, record := _record(name, line)) != record:
                sieved.twice.append(f"{name} at the epoch {epoch[''][3:22]}")
                epoch[name] = ""
        elif line.strip() and line[:1] not in ("P", "V", "E", "/"):
            sieved.unread.append(f"line {number} ({line.strip()[:40]!r})")
    _flush(sieved, epoch)
    sieved.lines.append("EOF")
    return sieved


def _is_epoch(text: str) -> bool:
    found = _EPOCH.fullmatch(text)
    try:
        return found is not None and datetime(*map(int, found.groups())) >= GPS_EPOCH  # type: ignore[arg-type]
    except ValueError:
        return False


def _record(name: str, line: str) -> str:
    """The position of a satellite and, in column 79, whether it is moved; clock, accuracy and the rest say nothing."""
    return f"P{name}{line[4:46]}{999_999.999999:14.6f}{'M' if line[78:79] == 'M' else '':>19}"


def _flush(sieved: _Sieved, epoch: dict[str, str]) -> None:
    sieved.lines += [line for line in epoch.values() if line]


def _head(path: Path, head: Sequence[str], sieved: _Sieved) -> set[str]:
    """Keep the first two lines, the list of satellites and the time system; returns the names of the list."""
    first, second = head[0], next((line for line in head if _SECOND_LINE.fullmatch(line)), _NO_SECOND_LINE)
    count = first[32:39] if first[32:39].strip().isdecimal() else "0"
    lists = [line for line in head if line.startswith("+ ")]
    systems = [line[9:12] for line in head if line.startswith("%")]
    system = next((one for one in systems if one in _TIME_SYSTEMS), systems[0] if systems else "")
    if system not in _TIME_SYSTEMS:
        # Versions a and b count in GPS time without a word.
        if first[1] not in "ab" or system not in ("ccc", ""):
            said = f"are in the system {system!r}" if system else "have no system (%c)"
            raise InputError(f"{path}: its times {said}; {', '.join(_TIME_SYSTEMS)} can be used.")
        system = "GPS"
    cells = [_name(line[k : k + 3]) for line in lists for k in range(9, 60, 3)]
    names = list(dict.fromkeys(name for name in cells if name))
    if not names:
        raise InputError(f"{path}: its head has no list of satellites (+); the file is cut short or damaged.")
    rows = [names[k : k + 17] for k in range(0, len(names), 17)]
    sieved.lines += [
        f"{first[:31]} {count:>7} ORBIT IGS20 FIT  ANY",
        second,
        *(f"+  {len(names):3d}   {''.join(row)}{'  0' * (17 - len(row))}" for row in rows),
        f"%c M  cc {system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
    ]
    return set(names)


def _name(cell: str) -> str:
    """A satellite as it is written, "G01", "G 1" or, in version a, "  1"; empty where it is none."""
    if not _NAME.fullmatch(cell) or int(cell[1:]) == 0:
        return ""
    return f"{cell[0].strip() or 'G'}{int(cell[1:]):02d}"


def _grid(path: Path, times: NDArray[np.float64]) -> tuple[float, list[int], NDArray[np.int64]]:
    """Interval between epochs [s], those of them that are in step and in order, and their places on the grid."""
    steps = np.diff(times)
    interval_s = round(float(np.median(steps)), 3)
    if not 0 < interval_s <= _LONGEST_INTERVAL_S:
        raise InputError(f"{path}: its epochs are {interval_s:g} s apart; up to {_LONGEST_INTERVAL_S:g} s can be used.")
    phases, counts = np.unique(np.round(times % interval_s, 3) % interval_s, return_counts=True)
    turns = (times - phases[counts.argmax()]) / interval_s
    place = np.rint(turns).astype(np.int64)
    in_step = np.flatnonzero(np.abs(turns - place) * interval_s < 2e-3)
    # The longest ascending sequence: a date that is wrong does not take those after it along.
    tails: list[int] = []
    last: list[int] = []
    before: dict[int, int] = {}
    for index in in_step.tolist():
        at = bisect_left(tails, int(place[index]))
        tails[at : at + 1] = [int(place[index])]
        last[at : at + 1] = [index]
        before[index] = last[at - 1] if at else -1
    kept: list[int] = []
    index = last[-1] if last else -1
    while index >= 0:
        kept.append(index)
        index = before[index]
    kept.reverse()
    if len(kept) < NODES:
        raise InputError(f"{path}: {len(kept)} of its epochs are in step; interpolation needs at least {NODES}.")
    return interval_s, kept, place[kept] - place[kept[0]]


def _told(path: Path, one: str, several: str, found: Sequence[str]) -> list[str]:
    """A note about what was found, the first of it by name; nothing where nothing was."""
    if not found:
        return []
    named = ", ".join(found[:_MOST_NAMED])
    more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
    return [f"{path.name}: {named}{more} {one if len(found) == 1 else several}."]
