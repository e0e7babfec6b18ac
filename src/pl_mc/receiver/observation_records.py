"""Epochs of RINEX observation files, checked line by line and written anew for the orbit library.

RINEX 3 and 4 put one satellite on a line; RINEX 2 lists the satellites with the epoch and folds their values over
lines of five. Of both, the one pseudorange of each satellite that the analysis uses is kept, as the digits stand
in the file: the library gets a RINEX 3 file with one value on a line, whatever the user's file looks like.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from pl_mc.input_errors import InputError
from pl_mc.receiver.rinex_text import RinexText, observed_codes
from pl_mc.receiver.signals import SYSTEMS, signal_of

# What the library is told that a value is, whatever it was called in the file.
_LIBRARY_CODES: Mapping[str, str] = {"G": "C1C", "C": "C2I"}

_EPOCH_3 = re.compile(
    r"> (\d{4}) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d)((?:  \d| \d\d|\d{3})\.\d{7})  \d[ \d]{3}", re.ASCII
)
_EPOCH_2 = re.compile(
    r" ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d) ([ \d]\d)((?:  \d| \d\d)\.\d{7})  \d[ \d]{3}", re.ASCII
)
_FIRST_TIME = re.compile(r" *\d{4}(?: +\d{1,2}){4} +\d{1,2}\.\d* *", re.ASCII)
_VALUE = re.compile(r" *-?\d*\.\d{3}", re.ASCII)
_VALUES = re.compile(r"[ \d.-]*", re.ASCII)
_NAME_3 = re.compile(r"[A-Z][ \d]\d", re.ASCII)
_NAME_2 = re.compile(r"[ A-Z][ \d]\d", re.ASCII)

_VALUE_WIDTH, _VALUE_AND_FLAGS_WIDTH = 14, 16
_VALUES_ON_A_LINE_2, _NAMES_ON_A_LINE_2, _FIRST_NAME_2 = 5, 12, 32

# Systems of time that run with that of GPS (RINEX 3.05, section 4.2; Galileo and QZSS by design), and the one that
# a file of a single system means when it names none.
_GPS_TIMES = ("GPS", "GAL", "QZS", "GST")
_SYSTEMS_OF_FILES = ("", " ", *"GRECJISTM")
_TIME_OF_SYSTEM = {"R": "GLO", "C": "BDT"}

# What an epoch flag of 2 or more announces is no observation; a header line among it may change the columns.
_CHANGED_COLUMNS = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV", "SYS / SCALE FACTOR")


@dataclass(frozen=True)
class _Epoch:
    """One epoch: where it begins, its time, and the pseudorange of each satellite as 14 columns of text."""

    where: str
    time: tuple[int, int, int, int, int, float]
    values: tuple[tuple[str, str], ...]


def checked_observations(file: RinexText, systems: Sequence[str]) -> tuple[str, int]:
    """RINEX 3 text of the pseudoranges of an observation file, and the number of its epochs.

    GPS comes out as C1C and BeiDou as C2I; epochs and digits are those of the file.

    Raises:
        InputError: times of a system other than GPS; an epoch with other than its number of lines, an epoch line
            or a pseudorange that cannot be read, times that do not increase, a satellite that does not exist; with
            the number of the line.
    """
    _require_gps_time(file)
    _require_whole_end(file)
    epochs = list(_epochs_2(file) if file.generation == 2 else _epochs_3(file, systems))
    if not epochs:
        raise InputError(f"{file.path}: the file has a header and no epochs.")
    previous = datetime.min
    for epoch in epochs:
        time = _checked_time(epoch)
        if time <= previous:
            raise InputError(f"{epoch.where}: its epoch does not come after the one before.")
        previous = time
        names = [name for name, _ in epoch.values]
        if len(set(names)) < len(names):
            repeated = next(name for name in names if names.count(name) > 1)
            raise InputError(f"{epoch.where}: {repeated} appears twice in one epoch.")
    return _library_text(epochs, systems), len(epochs)


def _epochs_3(file: RinexText, systems: Sequence[str]) -> Iterator[_Epoch]:
    codes = observed_codes(file)
    first_column = {
        letter: 3 + _VALUE_AND_FLAGS_WIDTH * codes[letter].index(code)
        for letter in systems
        for code in signal_of(letter).codes
        if code == next(first for first in signal_of(letter).codes if first in codes[letter])
    }
    _refuse_scale_factors(file, systems)
    due, opened = 0, 0
    epoch: _Epoch | None = None
    values: list[tuple[str, str]] = []
    for index, line in enumerate(file.body):
        where = file.where(index)
        if line.startswith(">"):
            if due:
                raise InputError(
                    f"{where}: the epoch of line {opened} lacks {due} of its satellites; the file is damaged."
                )
            if epoch is not None:
                yield _Epoch(epoch.where, epoch.time, tuple(values))
            opened, epoch, values = len(file.header) + index + 1, None, []
            flag, due = _flag_and_count(line[31:35], where)
            if flag > 1:
                continue
            match = _EPOCH_3.match(line)
            if match is None:
                raise InputError(f"{where}: the time of the epoch cannot be read.")
            year, month, day, hour, minute, second = match.groups()
            epoch = _Epoch(where, (int(year), int(month), int(day), int(hour), int(minute), float(second)), ())
        elif due:
            due -= 1
            if epoch is None:
                _refuse_changed_columns(line, where)
                continue
            name = _checked_name(line[:3], _NAME_3, where)
            if name[0] not in codes:
                raise InputError(f"{where}: {name} is of a system of which the header lists no observations.")
            _require_values(line, 3, 3 + _VALUE_AND_FLAGS_WIDTH * len(codes[name[0]]), where)
            if name[0] in first_column:
                begin = first_column[name[0]]
                values.append((name, _checked_value(line[begin : begin + _VALUE_WIDTH], name, where)))
        elif line.strip():
            raise InputError(f"{where}: a line that belongs to no epoch; the file is damaged.")
    if due:
        raise InputError(f"{file.path}: the file is cut short; its last epoch (line {opened}) is not complete.")
    if epoch is not None:
        yield _Epoch(epoch.where, epoch.time, tuple(values))


def _epochs_2(file: RinexText) -> Iterator[_Epoch]:
    types = _types_2(file)
    code = next((code for code in signal_of("G").codes_2 if code in types), None)
    if code is None:
        raise InputError(f"{file.path}: it has no C1 or P1 pseudoranges; it has {', '.join(types)}.")
    row, column = divmod(types.index(code), _VALUES_ON_A_LINE_2)
    rows = math.ceil(len(types) / _VALUES_ON_A_LINE_2)
    # A name without a letter is of the system of the file, GPS where the header is silent.
    own_letter = file.header[0][40:41].strip() or "G"
    body = file.body
    at = 0
    while at < len(body):
        if not body[at].strip():
            # Satellites without any value are blank lines too, but those are passed with their epoch.
            at += 1
            continue
        opened, where = at, file.where(at)
        flag, count = _flag_and_count(body[at][28:32], where)
        if 2 <= flag <= 5:
            # A line of values has digits where an event has its flag, but none of its other columns.
            if body[at][:28].strip() and not _EPOCH_2.match(body[at]):
                raise InputError(f"{where}: the time of the event cannot be read.")
            for k in range(at + 1, min(at + 1 + count, len(body))):
                _refuse_changed_columns(body[k], file.where(k))
            at += 1 + count
            _require_lines(file, at, opened)
            continue
        match = _EPOCH_2.match(body[at])
        if match is None:
            raise InputError(f"{where}: the time of the epoch cannot be read.")
        names: list[str] = []
        while len(names) < count:
            _require_lines(file, at + 1, opened)
            listed = body[at][_FIRST_NAME_2:]
            if len(names) and body[at][:_FIRST_NAME_2].strip():
                raise InputError(f"{file.where(at)}: the list of satellites does not go on where it should.")
            for k in range(min(_NAMES_ON_A_LINE_2, count - len(names))):
                name = _checked_name(listed[3 * k : 3 * k + 3], _NAME_2, file.where(at), own_letter)
                names.append(name)
            at += 1
        if not names:
            at += 1
        values = []
        for name in names:
            _require_lines(file, at + rows, opened)
            for k in range(rows):
                fields = min(_VALUES_ON_A_LINE_2, len(types) - k * _VALUES_ON_A_LINE_2)
                _require_values(body[at + k], 0, _VALUE_AND_FLAGS_WIDTH * fields, file.where(at + k))
            if name[0] == "G":
                begin = _VALUE_AND_FLAGS_WIDTH * column
                field = body[at + row][begin : begin + _VALUE_WIDTH]
                values.append((name, _checked_value(field, name, file.where(at + row))))
            at += rows
        if flag > 1:
            continue
        year, month, day, hour, minute, second = match.groups()
        century = 1900 if int(year) >= 80 else 2000
        time = (century + int(year), int(month), int(day), int(hour), int(minute), float(second))
        yield _Epoch(where, time, tuple(values))


def _types_2(file: RinexText) -> tuple[str, ...]:
    lines = file.labelled("# / TYPES OF OBSERV")
    types = [line[k : k + 6].strip() for line in lines for k in range(6, 60, 6)]
    listed = tuple(one for one in types if one)
    promised = lines[0][:6].strip() if lines else ""
    if not listed:
        raise InputError(f"{file.path}: its header lists no # / TYPES OF OBSERV.")
    if promised != str(len(listed)):
        raise InputError(
            f"{file.path}: its header promises {promised or 'no number of'} observation types and lists "
            f"{len(listed)}; it is damaged."
        )
    return listed


def _library_text(epochs: Sequence[_Epoch], systems: Sequence[str]) -> str:
    """A RINEX 3 observation file with one pseudorange a satellite."""
    lines = [
        f"{'3.05':>9}{'':11}{'OBSERVATION DATA':20}{'M':20}RINEX VERSION / TYPE",
        *(f"{f'{letter}    1 {_LIBRARY_CODES[letter]}':60}SYS / # / OBS TYPES" for letter in systems),
    ]
    year, *between, second = epochs[0].time
    clock = "".join(f"{part:6d}" for part in (year, *between)) + f"{second:13.7f}     GPS"
    lines += [f"{clock:60}TIME OF FIRST OBS", f"{'':60}END OF HEADER"]
    for epoch in epochs:
        year, month, day, hour, minute, second = epoch.time
        kept = [f"{name}{value}" for name, value in epoch.values if name[0] in systems]
        lines.append(f"> {year:4d} {month:02d} {day:02d} {hour:02d} {minute:02d}{second:11.7f}  0{len(kept):3d}")
        lines += kept
    return "\n".join((*lines, ""))


def _checked_time(epoch: _Epoch) -> datetime:
    year, month, day, hour, minute, second = epoch.time
    try:
        # A leap second has no place in GPS time, and a second of 60 in none of these files.
        if second >= 60:
            raise ValueError
        return datetime(year, month, day, hour, minute) + timedelta(seconds=second)
    except ValueError:
        raise InputError(
            f"{epoch.where}: {year}-{month:02d}-{day:02d} {hour:02d}:{minute:02d}:{second:g} is no date and time."
        ) from None


def _checked_name(text: str, form: re.Pattern[str], where: str, own_letter: str = "") -> str:
    """A satellite's name as ``G05``; names of systems that are read exist."""
    if not form.fullmatch(text):
        raise InputError(f"{where}: {text!r} is no satellite's name.")
    letter = own_letter if text[0] == " " else text[0]
    number = int(text[1:])
    if not 1 <= number <= (SYSTEMS[letter].highest_number if letter in SYSTEMS else 99):
        raise InputError(f"{where}: {text!r} is no satellite that exists.")
    return f"{letter}{number:02d}"


def _checked_value(field: str, name: str, where: str) -> str:
    """A pseudorange of 14 columns, three decimals at their end; blank where it is missing."""
    if not field.strip():
        return " " * _VALUE_WIDTH
    if len(field) != _VALUE_WIDTH or not _VALUE.fullmatch(field):
        raise InputError(f"{where}: the pseudorange of {name}, {field!r}, is not a number with three decimals.")
    return field


def _flag_and_count(text: str, where: str) -> tuple[int, int]:
    """Epoch flag and number of lines, in RINEX 2 of satellites, that follow."""
    flag, count = text[:1], text[1:4].strip() or "0"
    leading = len(count) > 1 and count.startswith("0")
    if leading or not (flag.isdigit() and count.isdigit() and flag.isascii() and count.isascii()):
        raise InputError(f"{where}: the epoch line has no flag and number of satellites where they belong.")
    if int(flag) > 6:
        raise InputError(f"{where}: the epoch line has the flag {flag}, and flags are 0 to 6.")
    return int(flag), int(count)


def _require_whole_end(file: RinexText) -> None:
    """Raise `InputError` unless the last line ends in a newline or where a value does.

    Values have 14 columns and 2 of flags each; in RINEX 3 and 4 the three of a name stand before them.
    """
    length = len(file.body[-1]) if file.body else 0
    if file.ends_with_newline or not length:
        return
    after = 0 if file.generation == 2 else 3
    whole = length >= after and (length - after) % _VALUE_AND_FLAGS_WIDTH in (0, _VALUE_WIDTH, _VALUE_WIDTH + 1)
    # Words are of a line of an event, which ends with a label that nobody can tell to be whole.
    if not whole or not _VALUES.fullmatch(file.body[-1][after:]):
        raise InputError(f"{file.path}: the file is cut short; its last line is not complete.")


def _require_lines(file: RinexText, count: int, opened: int) -> None:
    if count > len(file.body):
        number = len(file.header) + opened + 1
        raise InputError(f"{file.path}: the file is cut short; its last epoch (line {number}) is not complete.")


def _require_values(line: str, begin: int, width: int, where: str) -> None:
    """Raise `InputError` unless a line holds values and flags, and no more than the header announces."""
    if not _VALUES.fullmatch(line, begin):
        raise InputError(f"{where}: the line holds something other than values and flags; the file is damaged.")
    if line[width:].strip():
        raise InputError(f"{where}: the line holds more values than the header lists; the file is damaged.")


def _require_gps_time(file: RinexText) -> None:
    system = file.header[0][40:41]
    if system not in _SYSTEMS_OF_FILES:
        raise InputError(f"{file.path}: its first line names the satellite system {system!r}, which does not exist.")
    own = _TIME_OF_SYSTEM.get(system, "GPS")
    lines = file.labelled("TIME OF FIRST OBS")
    if not lines:
        raise InputError(f"{file.path}: its header has no TIME OF FIRST OBS, which every RINEX file has.")
    for line in lines:
        if not _FIRST_TIME.fullmatch(line[:48]):
            raise InputError(f"{file.path}: the time in its header (TIME OF FIRST OBS) cannot be read; it is damaged.")
        given = line[48:51].strip() or own
        if given not in _GPS_TIMES:
            raise InputError(f"{file.path}: its times are {given} (TIME OF FIRST OBS), and GPS time is needed.")


def _refuse_changed_columns(line: str, where: str) -> None:
    label = line[60:].strip()
    if label in _CHANGED_COLUMNS:
        raise InputError(f"{where}: {label} changes in the middle of the file, which is not read; split it there.")


def _refuse_scale_factors(file: RinexText, systems: Sequence[str]) -> None:
    for line in file.labelled("SYS / SCALE FACTOR"):
        if line[:1] in systems and line[2:6].strip() not in ("", "1"):
            raise InputError(f"{file.path}: its values are scaled (SYS / SCALE FACTOR), which is not read.")
