"""From an SP3 file on disk to a table of positions: whatever the text promises is checked, line by line.

RTKLIB skips in silence what it cannot make sense of; a damaged file must not become fewer positions or others.
"""

from __future__ import annotations

import re
from collections.abc import Sequence, Set
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.input_errors import InputError

# System letter and numbers of each constellation. BeiDou-2 and BeiDou-3 share the letter; the numbers to C18 belong
# to the second generation, those from C19 on to the third. The highest ones are the last that RTKLIB knows.
NUMBERS = {"GPS": ("G", 1, 32), "GAL": ("E", 1, 36), "BDS-2": ("C", 1, 18), "BDS-3": ("C", 19, 63)}

# Eleven positions belong to a polynomial of degree ten, which holds millimetres up to a quarter of an hour.
_FEWEST_EPOCHS = 11
_LONGEST_INTERVAL_S = 900.0

# A navigation satellite is between 1.9e7 m (medium orbit) and 4.5e7 m (synchronous) from the Earth's centre.
_ORBIT_RADIUS_M = (1.9e7, 4.5e7)

_LARGEST_BYTES = 200_000_000
_COORDINATE = re.compile(r" *-?\d+\.\d{6}", re.ASCII)
_SATELLITE = re.compile(r"[A-Z]\d\d", re.ASCII)
_DATE = re.compile(r"(\d{4}) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d\.\d{8})", re.ASCII)
_SECOND_LINE = re.compile(r"## +(\d{1,4}) +(\d+\.\d{8}) +(\d+\.\d{8})( .*)?", re.ASCII)
_HEADER = ("+ ", "++", "%c", "%f", "%i", "/*")

# The largest coordinate of an SP3 file stands for none.
_NO_COORDINATE_KM = 999_999.0

# Galileo time is held within 50 ns of GPS time, in which a satellite moves by 0.2 mm.
_TIME_SYSTEMS = ("GPS", "GAL")


@dataclass(frozen=True)
class Sp3Table:
    """What the text of a file says of n epochs and the m satellites of some systems.

    Attributes:
        path: the file, for messages.
        date: the first epoch as it is written.
        first_gps_s, interval_s: first epoch, GPS seconds, and time between epochs [s].
        names: m satellites as the header lists them.
        epochs: n lines that begin an epoch.
        coordinates: (n, m), the three coordinates as they are written [km]; empty where the position is missing.
        position_m: (n, m, 3), Earth-fixed [m]; NaN where missing.
        line: (n, m), line numbers.
    """

    path: Path
    date: str
    first_gps_s: float
    interval_s: float
    names: tuple[str, ...]
    epochs: tuple[str, ...]
    coordinates: tuple[tuple[str, ...], ...]
    position_m: NDArray[np.float64]
    line: NDArray[np.int64]

    @property
    def last_gps_s(self) -> float:
        """The last epoch [s]."""
        return self.first_gps_s + self.interval_s * (len(self.epochs) - 1)


def read_sp3_text(path: Path, letters: Set[str]) -> Sp3Table:
    """Read and check an SP3-c or SP3-d file, plain or gzipped.

    Args:
        path: the file.
        letters: system letters to keep.

    Raises:
        InputError: a file that is missing, cut short, damaged, or of another kind or version; the sentence names
            the first line that is not as it has to be.
    """
    return _checked(path, _lines(path), letters)


def _lines(path: Path) -> list[str]:
    # The package of receiver files imports this one.
    from pl_mc.runtime.unpacking import read_unzipped

    content = read_unzipped(path)
    if content.startswith(b"\x1f\x9d"):
        raise InputError(f"{path}: .Z files are not read; SP3 comes plain or as .gz.")
    if b"\0" in content:
        raise InputError(f"{path}: it holds binary data and is not an SP3 file.")
    if len(content) > _LARGEST_BYTES:
        raise InputError(f"{path}: it is longer than {_LARGEST_BYTES / 1e6:g} MB, which no SP3 file is.")
    text = content.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").rstrip("\n")
    if not text.strip():
        raise InputError(f"{path}: the file is empty.")
    return text.split("\n")


def _checked(path: Path, lines: list[str], letters: Set[str]) -> Sp3Table:
    """The positions of the systems wanted; an `InputError` names the first line that is not as it has to be."""
    head = lines[0]
    if not re.match(r"#[a-z][PV]", head):
        raise InputError(f"{path}: it is not an SP3 file; its first line does not begin with #c or #d.")
    if head[1] not in "cd":
        raise InputError(f"{path}: this is SP3-{head[1]}, and SP3-c or SP3-d is needed.")
    first_gps_s, promised = _date(path, 1, head[3:31]), head[32:39].strip()
    if not (promised.isascii() and promised.isdigit()):
        raise InputError(f"{path}, line 1: it names no number of epochs.")
    second = _SECOND_LINE.fullmatch(lines[1].rstrip()) if len(lines) > 1 else None
    if second is None:
        raise InputError(f"{path}, line 2: week, seconds of the week and interval are needed there, after ##.")
    week_s, interval_s = 604_800.0 * int(second[1]) + float(second[2]), float(second[3])
    if abs(week_s - first_gps_s) > 1e-6:
        raise InputError(f"{path}, line 2: its GPS week and second are not the date of line 1; it is damaged.")
    if not 0 < interval_s <= _LONGEST_INTERVAL_S:
        raise InputError(
            f"{path}, line 2: its epochs are {interval_s:g} s apart; at most {_LONGEST_INTERVAL_S:g} s can be used."
        )
    begin = next((k for k, line in enumerate(lines) if line.startswith("* ")), len(lines))
    listed = _listed(path, lines[:begin])
    wanted = [
        name
        for name in listed
        if any(name[0] == letter and low <= int(name[1:]) <= high for letter, low, high in NUMBERS.values())
        and name[0] in letters
    ]

    at = begin
    epochs: list[str] = []
    coordinates: list[tuple[str, ...]] = []
    numbers: list[list[int]] = []
    while at < len(lines) and lines[at].startswith("* "):
        expected_s = first_gps_s + interval_s * len(epochs)
        if abs(_date(path, at + 1, lines[at][3:31]) - expected_s) > 1e-3 or lines[at][:3] != "*  ":
            raise InputError(
                f"{path}, line {at + 1}: the epoch {iso_date(expected_s)} is needed here, one every {interval_s:g} "
                "s; the file is damaged."
            )
        epochs.append(lines[at])
        at += 1
        found: dict[str, tuple[str, int]] = {}
        while at < len(lines) and lines[at][:1] in ("P", "V", "E") and lines[at].rstrip() != "EOF":
            line, name = lines[at], lines[at][1:4]
            if line[0] == "P":
                if name not in listed or name in found:
                    what = "appears twice in its epoch" if name in found else "is not a satellite of the header"
                    raise InputError(f"{path}, line {at + 1}: {name!r} {what}; the file is damaged.")
                found[name] = (_coordinates(path, at, line) if name[0] in letters else "", at + 1)
            elif line[0] == "V" and (name not in found or head[2] != "V"):
                raise InputError(f"{path}, line {at + 1}: a velocity has no place here; the file is damaged.")
            elif line[0] == "E" and not line.startswith(("EP", "EV")):
                raise InputError(f"{path}, line {at + 1}: this is no line of an SP3 file; it is damaged.")
            at += 1
        lacking = [name for name in listed if name not in found]
        if lacking:
            cut = "; is it cut short?" if at >= len(lines) else "; the file is damaged."
            raise InputError(f"{path}, line {at}: the epoch ends here without {lacking[0]} of the header{cut}")
        coordinates.append(tuple(found[name][0] for name in wanted))
        numbers.append([found[name][1] for name in wanted])
    if at >= len(lines):
        raise InputError(f"{path}, line {len(lines)}: the file ends without EOF; is it cut short?")
    if lines[at].rstrip() != "EOF" or any(line.strip() for line in lines[at + 1 :]):
        raise InputError(f"{path}, line {at + 1}: an epoch or EOF at the end of the file is needed here.")
    if len(epochs) != int(promised):
        raise InputError(f"{path}, line 1: it promises {int(promised)} epochs, but the file holds {len(epochs)}.")
    if len(epochs) < _FEWEST_EPOCHS:
        raise InputError(f"{path}: it holds {len(epochs)} epochs; interpolation needs at least {_FEWEST_EPOCHS}.")
    position_m = np.array(
        [
            [[1e3 * float(text[k : k + 14]) for k in (0, 14, 28)] if text else [np.nan] * 3 for text in row]
            for row in coordinates
        ]
    ).reshape(len(epochs), len(wanted), 3)
    return Sp3Table(
        path=path,
        date=head[3:31],
        first_gps_s=first_gps_s,
        interval_s=interval_s,
        names=tuple(wanted),
        epochs=tuple(epochs),
        coordinates=tuple(coordinates),
        position_m=position_m,
        line=np.array(numbers, dtype=np.int64).reshape(len(epochs), len(wanted)),
    )


def _date(path: Path, number: int, text: str) -> float:
    """GPS seconds of a date in the columns that SP3 has for it [s]."""
    match = _DATE.fullmatch(text)
    try:
        year, month, day, hour, minute = (int(part) for part in match.groups()[:5]) if match else (0,) * 5
        start = datetime(year, month, day, hour, minute)
    except ValueError:
        match = None
    if match is None or not float(match[6]) < 60.0 or start < GPS_EPOCH:
        raise InputError(f"{path}, line {number}: {text.strip()!r} is not a date of an SP3 file.")
    return (start - GPS_EPOCH).total_seconds() + float(match[6])


def iso_date(time_gps_s: float) -> str:
    """A GPS time as it is written in messages."""
    try:
        return (GPS_EPOCH + timedelta(seconds=time_gps_s)).isoformat()
    except OverflowError:
        return "after the year 9999"


def _listed(path: Path, header: Sequence[str]) -> tuple[str, ...]:
    """Satellites of the header, which is of known lines and in a time that is GPS time."""
    for number, line in enumerate(header[2:], start=3):
        if not line.startswith(_HEADER):
            raise InputError(f"{path}, line {number}: this is no line of the header of an SP3 file; it is damaged.")
    lists = [(k, line) for k, line in enumerate(header, start=1) if line.startswith("+ ")]
    kinds = [line[9:12] for line in header if line.startswith("%c")]
    if not lists or not kinds:
        lacks = "list of satellites (+)" if not lists else "time system (%c)"
        raise InputError(f"{path}: its header has no {lacks}; the file is cut short or damaged.")
    if kinds[0] not in _TIME_SYSTEMS:
        raise InputError(
            f"{path}: its times are in the system {kinds[0]!r}; {' and '.join(_TIME_SYSTEMS)} can be used."
        )
    promised = lists[0][1][3:6].strip()
    names: list[str] = []
    for number, line in lists:
        cells = [line[k : k + 3] for k in range(9, 60, 3)]
        for cell in cells:
            if not cell.strip("0 "):
                continue
            if not _SATELLITE.fullmatch(cell) or cell in names:
                what = "appears twice" if cell in names else "is no satellite"
                raise InputError(f"{path}, line {number}: {cell!r} {what}; the file is damaged.")
            names.append(cell)
    if promised != str(len(names)):
        raise InputError(
            f"{path}, line {lists[0][0]}: it promises {promised or 'no number of'} satellites, but {len(names)} "
            "are listed; the file is damaged."
        )
    return tuple(names)


def _coordinates(path: Path, index: int, line: str) -> str:
    """The three coordinates of a position as they are written; empty where it is missing or not to be used."""
    cells = [line[k : k + 14] for k in (4, 18, 32)]
    for cell in cells:
        if len(cell) < 14 or not _COORDINATE.fullmatch(cell):
            raise InputError(
                f"{path}, line {index + 1}: {cell!r} is no coordinate of an SP3 file, 14 columns with six decimals."
            )
    values_km = [float(cell) for cell in cells]
    manoeuvre = line[78:79] == "M"
    if manoeuvre or not any(values_km) or min(map(abs, values_km)) >= _NO_COORDINATE_KM:
        return ""
    radius_m = 1e3 * float(np.sqrt(sum(value * value for value in values_km)))
    if not _ORBIT_RADIUS_M[0] < radius_m < _ORBIT_RADIUS_M[1]:
        raise InputError(
            f"{path}, line {index + 1}: {line[1:4]} is {radius_m / 1e3:.0f} km from the Earth's centre, where no "
            "navigation satellite is; the file is damaged."
        )
    return "".join(cells)
