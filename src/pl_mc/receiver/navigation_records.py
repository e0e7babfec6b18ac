"""Broadcast ephemerides of RINEX navigation files, checked number by number and written anew for the orbit library.

A record is eight lines of four numbers in every version. RINEX 2 files hold GPS alone, name it by its number, and
have years of two digits; RINEX 4 puts a line before each record that names its message, and holds the ionosphere
coefficients in records of their own. Of RINEX 4 the messages LNAV (GPS) and D1 and D2 (BeiDou) are read, the same
that older versions have.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError
from pl_mc.receiver.rinex_text import RinexText, require_gps_alone
from pl_mc.receiver.signals import SYSTEMS

_EPOCH_3 = re.compile(r"([A-Z])([ \d]\d) (\d{4}) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d)", re.ASCII)
_EPOCH_2 = re.compile(r"([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d)\.0", re.ASCII)
_HEAD_4 = re.compile(r"> (EPH|STO|EOP|ION) ([A-Z](?:\d\d|  )) +(\S+) *(\S*) *", re.ASCII)

# Fortran's D19.12 with an exponent of two digits, right-aligned, so that a shifted line does not pass for numbers.
_NUMBER = re.compile(r" *[-+]?\d*\.\d+[EeDd][-+]\d\d", re.ASCII)

_LINES, _WIDTH = 8, 19
_FIRST_3, _FIRST_2 = 23, 22

# Columns of a line, and lines after their heads of records that are not read (RINEX 4.02, appendix A).
_WIDEST = 80
_LINES_4: Mapping[str, int] = {"STO": 2, "EOP": 3}
_INDENT_3, _INDENT_2 = 4, 3

# Rows and columns of the numbers that every record has: all but issue of ephemeris, codes and time of transmission.
_NEEDED: Mapping[int, Sequence[int]] = {
    0: (0, 1, 2),
    1: (1, 2, 3),
    **dict.fromkeys((2, 3, 4), (0, 1, 2, 3)),
    5: (0, 2),
    6: (0, 1, 2, 3),
}

# What a number can be, by row and column: the reach of its bits in the message, the wider one of GPS and BeiDou
# (IS-GPS-200, tables 20-I and 20-III; BDS-SIS-ICD-2.1, tables 5-8 to 5-10), angles up to a turn.
_TURN = 6.2832
_RANGES: Mapping[tuple[int, int], tuple[float, float]] = {
    (0, 0): (-1e-3, 1e-3),  # clock offset [s]
    (0, 1): (-4e-9, 4e-9),  # its drift
    (0, 2): (-4e-15, 4e-15),  # and the drift of that [1/s]
    (1, 1): (-2048.0, 2048.0),  # Crs [m]
    (1, 2): (-1.2e-8, 1.2e-8),  # correction of the mean motion [rad/s]
    (1, 3): (-_TURN, _TURN),  # mean anomaly [rad]
    (2, 0): (-6.2e-5, 6.2e-5),  # Cuc [rad]
    (2, 1): (0.0, 0.5),  # eccentricity
    (2, 2): (-6.2e-5, 6.2e-5),  # Cus [rad]
    (2, 3): (0.0, 8192.0),  # root of the semi-major axis [sqrt(m)]
    (3, 0): (0.0, 604_800.0),  # time of ephemeris [s]
    (3, 1): (-6.2e-5, 6.2e-5),  # Cic [rad]
    (3, 2): (-_TURN, _TURN),  # longitude of the node [rad]
    (3, 3): (-6.2e-5, 6.2e-5),  # Cis [rad]
    (4, 0): (-_TURN / 2, _TURN / 2),  # inclination [rad]
    (4, 1): (-2048.0, 2048.0),  # Crc [m]
    (4, 2): (-_TURN, _TURN),  # argument of perigee [rad]
    (4, 3): (-3e-6, 3e-6),  # rate of the node [rad/s]
    (5, 0): (-3e-9, 3e-9),  # rate of the inclination [rad/s]
    (6, 2): (-6e-8, 6e-8),  # group delay [s]
}

# Health is a whole number: six bits of GPS, one of BeiDou.
_HEALTH = (6, 1)

# Row and column of the numbers that are compared with the date: time of ephemeris [s of week] and week.
_TOE, _WEEK = (3, 0), (5, 2)
_WEEK_S, _WEEKS_PER_CYCLE = 604_800.0, 1024
_BDT_WEEK_OFFSET = 1356

# Time of clock and time of ephemeris of one message are the same to some minutes.
_LARGEST_STEP_S = 7200.0


@dataclass(frozen=True)
class _Record:
    """A record of an ephemeris: where it stands, its satellite, its lines in the form of RINEX 3."""

    where: str
    name: str
    lines: tuple[str, ...]


def checked_navigation(file: RinexText, systems: Sequence[str]) -> str:
    """RINEX 3 text of the ephemerides of a navigation file that are of the systems, and of the ionosphere of GPS.

    Raises:
        InputError: a record with other than eight lines, a field that is not a number, a date that is none or far
            from the reference time in the record (with the line), or no record of a system.
    """
    if file.generation == 2:
        require_gps_alone(file, systems)
    records, found = {2: _records_2, 3: _records_3, 4: _records_4}[file.generation](file, systems)
    for letter in systems:
        if letter not in found:
            names = ", ".join(SYSTEM_NAMES.get(key, key) for key in found) or "none"
            raise InputError(f"{file.path}: it has no ephemeris of {SYSTEM_NAMES[letter]}; its systems: {names}.")
    return "\n".join(
        (
            f"{'3.05':>9}{'':11}{'NAVIGATION DATA':20}{'M':20}RINEX VERSION / TYPE",
            *_ionosphere(file),
            f"{'':60}END OF HEADER",
            *(line for record in records for line in record.lines),
            "",
        )
    )


def _records_3(file: RinexText, systems: Sequence[str]) -> tuple[list[_Record], list[str]]:
    body = _without_blank_end(file.body)
    starts = [k for k, line in enumerate(body) if line[:1].strip()]
    if any(line.strip() for line in body[: starts[0] if starts else len(body)]):
        raise InputError(f"{file.where(0)}: a line that belongs to no record.")
    records: list[_Record] = []
    found: dict[str, None] = {}
    for start, stop in zip(starts, [*starts, len(body)][1:], strict=True):
        where = file.where(start)
        match = _EPOCH_3.match(body[start])
        if match is None:
            raise InputError(f"{where}: this is no start of a navigation record.")
        found[match[1]] = None
        if match[1] in systems:
            records.append(_record(file, start, stop, match[1], last=stop == len(body)))
    return records, list(found)


def _records_4(file: RinexText, systems: Sequence[str]) -> tuple[list[_Record], list[str]]:
    records: list[_Record] = []
    found: dict[str, None] = {}
    for start, stop, head in _parts_4(file):
        if head[1] != "EPH":
            continue
        letter, message = head[2][0], head[3]
        read = letter not in SYSTEMS or message in SYSTEMS[letter].messages
        found[letter if read else f"{letter} {message}"] = None
        if letter not in systems or not read:
            continue
        if file.body[start + 1 : start + 2] and file.body[start + 1][:3] != head[2]:
            raise InputError(f"{file.where(start + 1)}: the record of {head[2]} begins with another name.")
        records.append(_record(file, start + 1, stop, letter, last=stop == len(_without_blank_end(file.body))))
    return records, list(found)


def _parts_4(file: RinexText) -> Iterator[tuple[int, int, re.Match[str]]]:
    """Begin, end and matched head line of each record of a RINEX 4 file."""
    body = _without_blank_end(file.body)
    starts = [k for k, line in enumerate(body) if line.startswith(">")]
    if any(line.strip() for line in body[: starts[0] if starts else len(body)]):
        raise InputError(f"{file.where(0)}: a line that belongs to no record.")
    for start, stop in zip(starts, [*starts, len(body)][1:], strict=True):
        head = _HEAD_4.fullmatch(body[start])
        if head is None:
            raise InputError(f"{file.where(start)}: this is no start of a navigation record.")
        # What is not read is looked at all the same: it may have swallowed the head of what would be.
        wide = next((k for k in range(start, stop) if len(body[k].rstrip()) > _WIDEST), None)
        if wide is not None:
            raise InputError(f"{file.where(wide)}: a line has at most {_WIDEST} columns, not {len(body[wide])}.")
        lines = _LINES_4.get(head[1], stop - start - 1)
        if stop - start - 1 != lines:
            raise InputError(
                f"{file.where(start)}: a record {head[1]} has {lines} lines, not {stop - start - 1}; the file is "
                "damaged."
            )
        yield start, stop, head


def _records_2(file: RinexText, systems: Sequence[str]) -> tuple[list[_Record], list[str]]:
    body = _without_blank_end(file.body)
    records: list[_Record] = []
    for start in range(0, len(body), _LINES):
        stop, where = min(start + _LINES, len(body)), file.where(start)
        match = _EPOCH_2.match(body[start])
        if match is None:
            raise InputError(f"{where}: this is no start of a navigation record.")
        number, year, month, day, hour, minute, second = (int(part) for part in match.groups())
        century = 1900 if year >= 80 else 2000
        date = f"{century + year:4d} {month:02d} {day:02d} {hour:02d} {minute:02d} {second:02d}"
        first = f"G{number:02d} {date}{body[start][_FIRST_2:]}"
        rest = [" " * _INDENT_3 + line[_INDENT_2:] for line in body[start + 1 : stop]]
        _require_indented(file, start, stop, _INDENT_2)
        records.append(_checked(file, start, (first, *rest), "G", last=stop == len(body)))
    return records, ["G"] if records else []


def _record(file: RinexText, start: int, stop: int, letter: str, *, last: bool) -> _Record:
    lines = file.body[start:stop]
    if lines:
        _require_indented(file, start, stop, _INDENT_3)
    return _checked(file, start, lines, letter, last=last)


def _checked(file: RinexText, start: int, lines: Sequence[str], letter: str, *, last: bool) -> _Record:
    """A record of eight lines of numbers, of a satellite and at a date that exist."""
    where = file.where(start)
    match = _EPOCH_3.match(lines[0]) if lines else None
    if match is None or match[1] != letter:
        raise InputError(f"{where}: this is no start of a navigation record.")
    name = f"{letter}{int(match[2]):02d}"
    if not 1 <= int(match[2]) <= SYSTEMS[letter].highest_number:
        raise InputError(f"{where}: {match[1] + match[2]!r} is no satellite that exists.")
    if len(lines) != _LINES:
        ending = "; the file is cut short." if last and len(lines) < _LINES else "."
        raise InputError(f"{where}: the record of {name} has {len(lines)} lines, and {_LINES} are needed{ending}")
    numbers = [
        _numbers(line[_FIRST_3 if k == 0 else _INDENT_3 :], file.where(start + k)) for k, line in enumerate(lines)
    ]
    for row, columns in _NEEDED.items():
        for column in columns:
            if len(numbers[row]) <= column or numbers[row][column] is None:
                raise InputError(f"{file.where(start + row)}: number {column + 1} of the line is missing.")
    for (row, column), (low, high) in _RANGES.items():
        number = numbers[row][column]
        assert number is not None
        if not low <= number <= high:
            raise InputError(
                f"{file.where(start + row)}: number {column + 1} of the line is {number:g}, and no message of "
                f"{SYSTEM_NAMES[letter]} can say more than {low:g} to {high:g} there."
            )
    health = numbers[_HEALTH[0]][_HEALTH[1]]
    if health not in range(SYSTEMS[letter].largest_health + 1):
        raise InputError(
            f"{file.where(start + _HEALTH[0])}: the health of {name} is {health:g}, and a whole number from 0 to "
            f"{SYSTEMS[letter].largest_health} is needed."
        )
    try:
        date = datetime(*(int(part) for part in match.groups()[2:]))  # type: ignore[arg-type]
    except ValueError:
        raise InputError(f"{where}: the record of {name} has no date and time that exists.") from None
    _require_same_time(date, numbers, letter, where, name)
    return _Record(where, name, (f"{name}{lines[0][3:]}", *lines[1:]))


def _require_same_time(
    date: datetime, numbers: Sequence[Sequence[float | None]], letter: str, where: str, name: str
) -> None:
    """Raise `InputError` where the date of a record and its time of ephemeris and week are not of one message."""
    clock_s = (date - GPS_EPOCH).total_seconds()
    toe_s = numbers[_TOE[0]][_TOE[1]]
    assert toe_s is not None
    week = round((clock_s - toe_s) / _WEEK_S)
    apart_s = abs(clock_s - week * _WEEK_S - toe_s)
    if apart_s > _LARGEST_STEP_S:
        raise InputError(
            f"{where}: the record of {name} is of {date}, but its time of ephemeris is {toe_s:g} s of the week, "
            f"{apart_s / 3600:.1f} h apart; one of them is damaged."
        )
    row = numbers[_WEEK[0]]
    given = row[_WEEK[1]] if len(row) > _WEEK[1] else None
    # Weeks of BeiDou are counted from 2006; some writers of either give weeks of GPS, all or the last ten bits.
    weeks = (week, week - _BDT_WEEK_OFFSET) if letter == "C" else (week,)
    if given and all((given - one) % _WEEKS_PER_CYCLE for one in weeks):
        raise InputError(
            f"{where}: the record of {name} is of {date}, but its week is {given:g}, not {weeks[-1]}; one of them "
            "is damaged."
        )


def _ionosphere(file: RinexText) -> list[str]:
    """The header lines GPSA and GPSB with the coefficients of the ionosphere, where the file has them."""
    if file.generation == 2:
        given = [file.labelled(label)[:1] for label in ("ION ALPHA", "ION BETA")]
        fields = [line[0][2:50] if line else "" for line in given]
    elif file.generation == 3:
        lines = file.labelled("IONOSPHERIC CORR")
        fields = [next((line[5:53] for line in lines if line[:4] == label), "") for label in ("GPSA", "GPSB")]
    else:
        return _ionosphere_4(file)
    if not all(fields):
        return []
    for text in fields:
        for k in range(0, 48, 12):
            if not re.fullmatch(r" *[-+]?\d*\.\d+[EeDd][-+]\d\d", text[k : k + 12], re.ASCII):
                raise InputError(f"{file.path}: the ionosphere coefficient {text[k : k + 12]!r} is not a number.")
    return [f"{f'{label} {text}':60}IONOSPHERIC CORR" for label, text in zip(("GPSA", "GPSB"), fields, strict=True)]


def _ionosphere_4(file: RinexText) -> list[str]:
    """Of the records ION of GPS the one sent first; RINEX 4 has no coefficients in its header."""
    best: tuple[str, list[float | None]] | None = None
    for start, stop, head in _parts_4(file):
        if head[1] != "ION" or head[2][0] != "G" or head[3] != "LNAV":
            continue
        lines = file.body[start + 1 : stop]
        if len(lines) != 3:
            raise InputError(f"{file.where(start)}: the record of the ionosphere has {len(lines)} lines, not 3.")
        time = lines[0][:_FIRST_3]
        numbers = [
            number
            for k, line in enumerate(lines)
            for number in _numbers(line[_FIRST_3 if k == 0 else _INDENT_3 :], file.where(start + 1 + k))
        ]
        if len(numbers) < 8 or any(number is None for number in numbers[:8]):
            raise InputError(f"{file.where(start)}: the record of the ionosphere lacks some of its 8 numbers.")
        if best is None or time < best[0]:
            best = time, numbers[:8]
    if best is None:
        return []
    values = best[1]
    return [
        f"{label} {''.join(f'{value:12.4E}' for value in part)}".ljust(60) + "IONOSPHERIC CORR"
        for label, part in (("GPSA", values[:4]), ("GPSB", values[4:]))
    ]


def _numbers(fields: str, where: str) -> list[float | None]:
    """Numbers of 19 columns each, None where blank."""
    numbers: list[float | None] = []
    for start in range(0, len(fields.rstrip()), _WIDTH):
        field = fields[start : start + _WIDTH]
        if not field.strip():
            numbers.append(None)
        elif len(field) == _WIDTH and _NUMBER.fullmatch(field):
            numbers.append(float(field.replace("D", "E").replace("d", "e")))
        else:
            raise InputError(f"{where}: {field.strip()!r} is not a number of {_WIDTH} columns.")
    return numbers


def _require_indented(file: RinexText, start: int, stop: int, columns: int) -> None:
    for k in range(start + 1, stop):
        if file.body[k][:columns].strip():
            raise InputError(f"{file.where(k)}: the line does not belong to the record before it.")


def _without_blank_end(body: Sequence[str]) -> Sequence[str]:
    end = len(body)
    while end and not body[end - 1].strip():
        end -= 1
    return body[:end]
