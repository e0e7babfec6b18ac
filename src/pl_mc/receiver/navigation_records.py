"""Broadcast ephemerides as checked records, and the coefficients of the ionosphere, of one or several files.

Every record is held to what its message can say (IS-GPS-200, tables 20-I and 20-III; BDS-SIS-ICD-2.1, tables 5-8 to
5-10; Galileo OS SIS ICD 2.1, 5.1); one that says anything else costs itself and a note. Whether a satellite may be used
its records say too.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.input_errors import InputError
from pl_mc.receiver.ephemerides import NUMBER_WIDTH, Ephemeris, fields_of, misshapen
from pl_mc.receiver.further_records import Added, added_records, glonass_records, with_added
from pl_mc.receiver.rinex_text import RinexText, label_of, listed, read_rinex_text
from pl_mc.receiver.signals import ADDED_TO_D1, FNAV, GROUP_DELAYS, INAV, LNAV, OWN_GROUP_DELAYS, SYSTEMS, Observable
from pl_mc.runtime import sidereon_adapter as library

# What the elements of an orbit can be: the widest reach of their bits, angles up to a turn.
_TURN = 6.2832
_ELEMENTS: Mapping[str, tuple[float, float]] = {
    "crs": (-2048.0, 2048.0),  # [m]
    "crc": (-2048.0, 2048.0),  # [m]
    "cuc": (-6.2e-5, 6.2e-5),  # [rad], as the next three
    "cus": (-6.2e-5, 6.2e-5),
    "cic": (-6.2e-5, 6.2e-5),
    "cis": (-6.2e-5, 6.2e-5),
    "delta_n": (-1.2e-8, 1.2e-8),  # [rad/s]
    "m0": (-_TURN, _TURN),
    "e": (0.0, 0.5),
    # A navigation satellite is between 1.9e7 m (medium orbit) and 4.5e7 m (synchronous) from the Earth's centre.
    "sqrt_a": (4359.0, 6708.0),  # [sqrt(m)]
    "toe_sow": (0.0, 604_800.0),
    "omega0": (-_TURN, _TURN),
    "i0": (-_TURN / 2, _TURN / 2),
    "omega": (-_TURN, _TURN),
    "omega_dot": (-3e-6, 3e-6),  # [rad/s]
    "idot": (-3e-9, 3e-9),  # [rad/s]
}
_CLOCK: Mapping[str, tuple[float, float]] = {"af0": (-1e-3, 1e-3), "af1": (-4e-9, 4e-9), "af2": (-4e-15, 4e-15)}
_CLOCK_GALILEO: Mapping[str, tuple[float, float]] = {
    "af0": (-0.063, 0.063), "af1": (-1.5e-8, 1.5e-8), "af2": (-6e-17, 6e-17),
}  # fmt: skip

_NEITHER = "its data sources name neither I/NAV nor F/NAV"

# Eight bits each of alpha and beta of the ionosphere (IS-GPS-200, table 20-X); BeiDou's reach as far.
_LARGEST_KLOBUCHAR = 128 * np.array([2.0**-30, 2.0**-27, 2.0**-24, 2.0**-24, 2.0**11, 2.0**14, 2.0**16, 2.0**16])

# Lines after the first of a record, of which the last has nothing that is needed.
_ROWS = 7

_WEEK_S, _WEEKS_PER_CYCLE = 604_800.0, 1024

# Header lines with coefficients of the ionosphere: of RINEX 2, and of RINEX 3 by their first four letters.
_IONOSPHERE_2: Mapping[str, tuple[str, str]] = {"G": ("ION ALPHA", "ION BETA")}
_IONOSPHERE_3: Mapping[str, tuple[str, str]] = {"G": ("GPSA", "GPSB"), "C": ("BDSA", "BDSB")}
_ION = re.compile(r"> ION (?:G.. +(?:LNAV|CNVX)|C.. +D1D2)", re.ASCII)
_ION_WIDTH = 12


@dataclass(frozen=True)
class Navigation:
    """What navigation files say.

    Attributes:
        ephemerides: of each satellite by reference time; of equal ones of a message the one that was sent last.
        klobuchar: (8,) coefficients alpha and beta of the ionosphere by system letter, G and C.
        systems: letters of those that they have sound or damaged records of, asked for or not.
        notes: sentences about what was left out.
    """

    ephemerides: Mapping[str, tuple[Ephemeris, ...]]
    klobuchar: Mapping[str, NDArray[np.float64]]
    systems: frozenset[str]
    notes: tuple[str, ...]

    def message_for(self, observable: Observable) -> str:
        """The message whose clock is used for what is made of pseudoranges; empty where none has what it takes."""
        system = observable.signals[0].system
        every = [one for name, own in self.ephemerides.items() if name[0] == system for one in own]
        for message in observable.messages:
            needed = observable.group_delays(message)
            if any(one.message == message and needed.keys() <= one.group_delays_s.keys() for one in every):
                return message
        return ""

    def of(self, name: str, message: str) -> list[Ephemeris]:
        """The ephemerides of a satellite in one message, by reference time."""
        return [one for one in self.ephemerides.get(name, ()) if one.message == message]


def read_navigation(
    paths: Sequence[str | Path], systems: Sequence[str], told: Mapping[str, Collection[str]] | None = None
) -> Navigation:
    """Read navigation files of any version, and put together what they say of the systems.

    Coefficients of the ionosphere are those of the first file that has any but zeros.

    Args:
        paths: the files.
        systems: RINEX letters.
        told: messages of each system of which a damaged record is worth a note; all unless given.

    Raises:
        InputError: a file that is no navigation file.
    """
    records: list[Ephemeris] = []
    klobuchar: dict[str, NDArray[np.float64]] = {}
    notes: list[str] = []
    letters: set[str] = set()
    added: list[Added] = []
    for path in paths:
        file = read_rinex_text(path, "navigation")
        found, left_out, without = _ephemerides(file, systems, told, letters)
        records += found
        if "C" in systems:
            wanted = told is None or not set(ADDED_TO_D1.values()).isdisjoint(told["C"])
            added += added_records(file, left_out if wanted else [])
        for letter, one in _klobuchar(file, left_out).items():
            if letter not in klobuchar or (one.any() and not klobuchar[letter].any()):
                klobuchar[letter] = one
        if left_out:
            notes.append(f"Left out of {file.path.name}: {listed(left_out)}.")
        if without:
            notes.append(f"Read from {file.path.name} without one of their fields: {listed(without)}.")
    return Navigation(_merged([*records, *with_added(records, added)]), klobuchar, frozenset(letters), tuple(notes))


def _ephemerides(
    file: RinexText, systems: Sequence[str], told: Mapping[str, Collection[str]] | None, letters: set[str]
) -> tuple[list[Ephemeris], list[str], list[str]]:
    """The sound records of a file, what is to be said of the others, and of those that lack what is not needed."""
    if file.generation == 2 and file.header[0][20] != "N":
        return [], ["all of it, which is of other systems"], []
    left_out = file.without_label()
    body = _without_misshapen(file, systems, left_out)
    try:
        read = library.navigation("\n".join((*file.header, *body, "")))
    except library.Unreadable as error:
        raise InputError(f"{file.path}: it cannot be read ({error}).") from None
    letters.update(one.satellite[0] for one in (*read.records, *read.other) if one.satellite)
    first_line = file.before - len(file.header)
    without: list[str] = []
    for told_of, several in ((left_out, read.skipped), (without, read.departures)):
        told_of += [
            f"the record of {one.satellite or 'no satellite'} at line {first_line + one.line} ({one.message})"
            for one in several
            if one.satellite[:1] in systems or one.satellite[:1] not in "CEGIJRS"
        ]
    sound = []
    for record in read.records:
        letter = record.satellite[0]
        message = _message(record) if letter in systems else ""
        if not message:
            if letter == "E" and letter in systems:
                left_out.append(f"the record of {record.satellite} of {_where(file, record)} ({_NEITHER})")
            continue
        fault = _fault(record)
        if fault and told is not None and message not in told[letter]:
            continue
        if fault:
            left_out.append(f"the record of {record.satellite} of {_where(file, record)} ({fault})")
        else:
            sound.append(_ephemeris(record))
    if "R" in systems:
        sound += glonass_records(file, body, left_out)
    return sound, left_out, without


def _without_misshapen(file: RinexText, systems: Sequence[str], left_out: list[str]) -> list[str]:
    """The body with blank lines for records of the systems in which a number has not the form of one.

    The library reads what is left of a number that has lost digits.
    """
    body = list(file.body)
    begin, first = (3, 22) if file.generation == 2 else (4, 23)
    head = re.compile(r"[ \d]\d " if file.generation == 2 else r"[A-Z>]", re.ASCII)
    starts = [k for k, line in enumerate(body) if head.match(line)] + [len(body)]
    for start, stop in itertools.pairwise(starts):
        name = body[start][:3].replace(" ", "0") if file.generation > 2 else f"G{body[start][:2].strip():0>2}"
        if name[0] not in systems:
            continue
        for k in range(start, min(start + _ROWS + 1, stop)):
            text = body[k][first if k == start else begin :]
            bad = misshapen(fields_of(text, 4 if k < start + _ROWS else 0)) or text[4 * NUMBER_WIDTH :].strip()
            bad = bad or (body[k][:begin].strip() if k > start else "")
            if bad:
                left_out.append(f"the record of {name} at line {file.number(start)} ({bad!r} at line "
                                f"{file.number(k)} is not a number of {NUMBER_WIDTH} columns)")  # fmt: skip
                # RINEX 4 has a line that announces the record.
                before = start - 1 if start and body[start - 1].startswith(">") else start
                body[before:stop] = [""] * (stop - before)
                break
    return body


def _message(record: Any) -> str:
    """The message of a record as it is called here; empty where it is not read.

    Of Galileo that counts which the clock is of: its data sources have a bit for F/NAV, 8, and one for I/NAV, 9.
    """
    if record.satellite[0] == "E" and record.galileo_data_sources:
        clocks = record.galileo_data_sources >> 8 & 0b11
        if clocks in (0b01, 0b10):
            return FNAV if clocks == 0b01 else INAV
    return SYSTEMS[record.satellite[0]].messages.get(record.message.label, "")


def _where(file: RinexText, record: Any) -> str:
    """Date of a record as it stands in its file, and its line where the form of the version tells."""
    date = GPS_EPOCH + timedelta(seconds=_clock_s(record) - SYSTEMS[record.satellite[0]].behind_gps_s)
    begin = f"{record.satellite}{date:%Y%m%d%H%M%S}"
    lines = (k for k, line in enumerate(file.body) if line[:23].replace(" ", "") == begin)
    line = next(lines, None)
    return f"{date:%Y-%m-%d %H:%M:%S}" + ("" if line is None else f" at line {file.number(line)}")


def _fault(record: Any) -> str:
    """Why a record cannot be what its satellite sent, in words; empty where nothing speaks against it."""
    system, name = SYSTEMS[record.satellite[0]], record.satellite
    if not 1 <= int(name[1:]) <= system.highest_number:
        return "there is no such satellite"
    message = _message(record)
    clock = _CLOCK_GALILEO if name[0] == "E" else _CLOCK
    for part, ranges in ((record.elements, _ELEMENTS), (record.clock, clock)):
        for field, (low, high) in ranges.items():
            value = getattr(part, field)
            if not low <= value <= high:
                return f"its {field} is {value:g}, and no message can say other than {low:g} to {high:g}"
    delays_s = _group_delays_s(record)
    for delay in (*OWN_GROUP_DELAYS[message], *delays_s):
        delay_s = delays_s.get(delay)
        if delay_s is None or not abs(delay_s) <= system.largest_group_delay_s:
            return f"its {delay} is {'missing' if delay_s is None else f'{delay_s:g} s'}"
    if message == LNAV and record.iodc is None:
        return "a number is missing beside its group delay"
    if not (math.isfinite(record.sv_health) and record.sv_health >= 0 and record.sv_health == int(record.sv_health)):
        return f"its health is {record.sv_health:g}"
    apart_s = record.toe_tow_s - record.toc_tow_s
    apart_s -= _WEEK_S * round(apart_s / _WEEK_S)
    if abs(apart_s) > system.time_step_s:
        return f"its time of ephemeris is {abs(apart_s):g} s off its time of clock, and both are of one message"
    # Some writers give the last ten bits of a week, or weeks of GPS where those of BeiDou belong.
    week = record.toc_week + round((record.toc_tow_s + apart_s - record.toe_tow_s) / _WEEK_S)
    if all((record.week - one) % _WEEKS_PER_CYCLE for one in (week, week + system.first_gps_week)):
        return f"its week is {record.week}, not {week}"
    return ""


def _ephemeris(record: Any) -> Ephemeris:
    system = SYSTEMS[record.satellite[0]]
    apart_s = record.toe_tow_s - record.toc_tow_s
    toe_s = _clock_s(record) + apart_s - _WEEK_S * round(apart_s / _WEEK_S)
    sent_s = record.transmission_time_sow
    if sent_s is None or not abs(sent_s) <= _WEEK_S:
        sent_s = -math.inf
    else:
        sent_s = toe_s + (sent_s - record.toe_tow_s + _WEEK_S / 2) % _WEEK_S - _WEEK_S / 2
    # A blank field promises nothing; of CNAV the library gives no accuracy where the index promises none.
    accuracy_m = -1.0 if record.sv_accuracy_m is None else record.sv_accuracy_m
    return Ephemeris(
        name=record.satellite,
        message=_message(record),
        toe_gps_s=toe_s,
        sent_gps_s=sent_s,
        health=int(record.sv_health),
        predicted=0 <= accuracy_m <= system.largest_accuracy_m,
        group_delays_s=_group_delays_s(record),
        week_gps_s=toe_s - record.toe_tow_s,
        record=record,
    )


def _clock_s(record: Any) -> float:
    """Time of clock, which is the date of a record [s since 1980-01-06, GPS time]."""
    system = SYSTEMS[record.satellite[0]]
    return float((record.toc_week + system.first_gps_week) * _WEEK_S + record.toc_tow_s + system.behind_gps_s)


def _group_delays_s(record: Any) -> dict[str, float]:
    """The group delays that a record has, by their names."""
    given = {name: getattr(record.group_delays, of_library) for name, of_library in GROUP_DELAYS.items()}
    return {name: delay_s for name, delay_s in given.items() if delay_s is not None}


def _merged(records: Iterable[Ephemeris]) -> dict[str, tuple[Ephemeris, ...]]:
    """Records of each satellite by toe; of equal toe the one sent last, and of these one that forbids the use."""
    by_satellite: dict[str, dict[tuple[float, str], Ephemeris]] = {}
    for one in records:
        same, key = by_satellite.setdefault(one.name, {}), (one.toe_gps_s, one.message)
        other = same.get(key)
        if other is None or (one.sent_gps_s, one.forbids) >= (other.sent_gps_s, other.forbids):
            same[key] = one
    return {name: tuple(same[key] for key in sorted(same)) for name, same in sorted(by_satellite.items())}


def _klobuchar(file: RinexText, left_out: list[str]) -> dict[str, NDArray[np.float64]]:
    """Coefficients of the ionosphere of a file, by system letter; those that cannot be are left out."""
    found: dict[str, NDArray[np.float64]] = {}
    for letter, fields in _ionosphere_fields(file):
        bad = misshapen(fields, len(fields[0])) if len(fields) == 8 and all(map(str.strip, fields)) else "not eight"
        values = np.zeros(8) if bad else np.array([float(one.upper().replace("D", "E")) for one in fields])
        if bad or not (np.abs(values) <= _LARGEST_KLOBUCHAR).all():
            left_out.append(f"coefficients of the ionosphere of {letter} ({bad or 'no message can say so'})")
        else:
            found.setdefault(letter, values)
    return found


def _ionosphere_fields(file: RinexText) -> Iterator[tuple[str, list[str]]]:
    """The eight numbers of each system in the header, or in records of RINEX 4 in the order of their dates."""
    if file.generation == 4:
        starts = [k for k, line in enumerate(file.body) if _ION.match(line) and len(file.body) > k + 3]
        for k in sorted(starts, key=lambda k: file.body[k + 1][4:23]):
            first, second, third = file.body[k + 1 : k + 4]
            yield file.body[k][6], [*fields_of(first[23:], 3), *fields_of(second[4:], 4), *fields_of(third[4:], 1)]
        return
    labels, begin = (_IONOSPHERE_2, 2) if file.generation == 2 else (_IONOSPHERE_3, 5)
    for letter, pair in labels.items():
        lines = [next((line for line in file.header if label in (line[:4], label_of(line))), "") for label in pair]
        if any(lines):
            yield letter, [field for line in lines for field in fields_of(line[begin:60], 4, _ION_WIDTH)]
