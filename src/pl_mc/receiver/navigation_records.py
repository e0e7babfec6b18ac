"""Broadcast ephemerides as checked records, and the coefficients of the ionosphere, of one or several files.

Every record is held to what its message can say (IS-GPS-200, tables 20-I and 20-III; BDS-SIS-ICD-2.1, tables 5-8 to
5-10); one that says anything else costs itself and a note. Whether a satellite may be used its records say too.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.input_errors import InputError
from pl_mc.receiver import library
from pl_mc.receiver.rinex_text import RinexText, listed, read_rinex_text
from pl_mc.receiver.signals import SYSTEMS

# What the elements of an orbit can be: the reach of their bits, the wider one of GPS and BeiDou, angles up to a turn.
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
_LARGEST_GROUP_DELAY_S = 6e-8

# Eight bits each of alpha and beta of the ionosphere (IS-GPS-200, table 20-X); BeiDou's reach as far.
_LARGEST_KLOBUCHAR = 128 * np.array([2.0**-30, 2.0**-27, 2.0**-24, 2.0**-24, 2.0**11, 2.0**14, 2.0**16, 2.0**16])

# Fortran's D19.12 with an exponent of two digits, right-aligned, so that a shifted line does not pass for numbers; of
# the lines of a record the last has nothing that is needed.
_NUMBER = re.compile(r" *[-+]?\d*\.\d+[EeDd][-+]\d\d", re.ASCII)
_WIDTH, _ROWS = 19, 7

_WEEK_S, _WEEKS_PER_CYCLE = 604_800.0, 1024

# Header lines with coefficients of the ionosphere: of RINEX 2, and of RINEX 3 by their first four letters.
_IONOSPHERE_2 = ("ION ALPHA", "ION BETA")
_IONOSPHERE_3: Mapping[str, tuple[str, str]] = {"G": ("GPSA", "GPSB"), "C": ("BDSA", "BDSB")}
_ION_DATE = slice(4, 23)


@dataclass(frozen=True)
class Ephemeris:
    """A record of the broadcast orbit and clock of a satellite.

    Attributes:
        name: of the satellite.
        toe_gps_s: reference time [s since 1980-01-06, GPS time].
        sent_gps_s: time of transmission, or minus infinity where the record says none.
        healthy: whether the satellite says that it may be used.
        predicted: whether its accuracy is predicted at all.
        group_delays_s: TGD and 0 of GPS, TGD1 and TGD2 of BeiDou [s].
        week_gps_s: begin of the week of ``toe_gps_s`` in which the record counts seconds.
        record: what the library evaluates.
    """

    name: str
    toe_gps_s: float
    sent_gps_s: float
    healthy: bool
    predicted: bool
    group_delays_s: tuple[float, float]
    week_gps_s: float
    record: Any

    @property
    def usable(self) -> bool:
        """Whether the satellite says that it may be used, and how well."""
        return self.healthy and self.predicted


@dataclass(frozen=True)
class Navigation:
    """What navigation files say.

    Attributes:
        ephemerides: of each satellite by reference time; of equal ones the one that was sent last.
        klobuchar: (8,) coefficients alpha and beta of the ionosphere by system letter, G and C.
        notes: sentences about what was left out.
    """

    ephemerides: Mapping[str, tuple[Ephemeris, ...]]
    klobuchar: Mapping[str, NDArray[np.float64]]
    notes: tuple[str, ...]


def read_navigation(paths: Sequence[str | Path], systems: Sequence[str]) -> Navigation:
    """Read navigation files of any version, and put together what they say of the systems.

    Coefficients of the ionosphere are those of the first file that has any but zeros.

    Raises:
        InputError: a file that is no navigation file.
    """
    records: list[Ephemeris] = []
    klobuchar: dict[str, NDArray[np.float64]] = {}
    notes: list[str] = []
    for path in paths:
        file = read_rinex_text(path, "navigation")
        found, left_out = _ephemerides(file, systems)
        records += found
        for letter, one in _klobuchar(file, left_out).items():
            if letter not in klobuchar or (one.any() and not klobuchar[letter].any()):
                klobuchar[letter] = one
        if left_out:
            notes.append(f"Left out of {file.path.name}: {listed(left_out)}.")
    return Navigation(_merged(records), klobuchar, tuple(notes))


def _ephemerides(file: RinexText, systems: Sequence[str]) -> tuple[list[Ephemeris], list[str]]:
    """The sound records of a file, and what is to be said of the others."""
    left_out: list[str] = []
    body = _without_misshapen(file, systems, left_out)
    try:
        read = library.navigation("\n".join((*file.header, *body, "")))
    except library.Unreadable as error:
        raise InputError(f"{file.path}: it cannot be read ({error}).") from None
    first_line = file.before - len(file.header)
    left_out += [
        f"the record of {one.satellite or 'no satellite'} at line {first_line + one.line} ({one.message})"
        for one in (*read.skipped, *read.departures)
        if one.satellite[:1] in systems or one.satellite[:1] not in "CEGIJRS"
    ]
    sound = []
    for record in read.records:
        letter = record.satellite[0]
        if letter not in systems or record.message.label not in SYSTEMS[letter].messages:
            continue
        fault = _fault(record)
        if fault:
            left_out.append(f"the record of {record.satellite} of {_where(file, record)} ({fault})")
        else:
            sound.append(_ephemeris(record))
    return sound, left_out


def _without_misshapen(file: RinexText, systems: Sequence[str], left_out: list[str]) -> list[str]:
    """The body with blank lines for records of the systems in which a number has not the form of one.

    The library reads what is left of a number that has lost digits.
    """
    body = list(file.body)
    begin, first = (3, 22) if file.generation == 2 else (4, 23)
    starts = [k for k, line in enumerate(body) if line[: begin - 1].strip()] + [len(body)]
    for start, stop in itertools.pairwise(starts):
        name = body[start][:3].replace(" ", "0") if file.generation > 2 else f"G{body[start][:2].strip():0>2}"
        if name[0] not in systems:
            continue
        for k in range(start, min(start + _ROWS, stop)):
            fields = body[k][first if k == start else begin :].rstrip()
            parts = [fields[at : at + _WIDTH] for at in range(0, min(len(fields), 4 * _WIDTH), _WIDTH)]
            bad = next((part for part in parts if part.strip() and not _NUMBER.fullmatch(part)), None)
            if bad is not None:
                left_out.append(f"the record of {name} at line {file.number(start)} ({bad.strip()!r} at line "
                                f"{file.number(k)} is not a number of {_WIDTH} columns)")  # fmt: skip
                # RINEX 4 has a line that announces the record.
                before = start - 1 if start and body[start - 1].startswith(">") else start
                body[before:stop] = [""] * (stop - before)
                break
    return body


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
    for part, ranges in ((record.elements, _ELEMENTS), (record.clock, _CLOCK)):
        for field, (low, high) in ranges.items():
            value = getattr(part, field)
            if not low <= value <= high:
                return f"its {field} is {value:g}, and no message can say other than {low:g} to {high:g}"
    delays_s = _group_delays_s(record)
    if None in delays_s or not max(map(abs, delays_s)) <= _LARGEST_GROUP_DELAY_S:  # type: ignore[arg-type]
        return f"its group delays are {delays_s[0]} and {delays_s[1]} s"
    if name[0] == "G" and record.iodc is None:
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
    accuracy_m = record.sv_accuracy_m
    first, second = _group_delays_s(record)
    assert first is not None
    assert second is not None
    return Ephemeris(
        name=record.satellite,
        toe_gps_s=toe_s,
        sent_gps_s=sent_s,
        healthy=record.sv_health == 0,
        predicted=accuracy_m is None or 0 <= accuracy_m <= system.largest_accuracy_m,
        group_delays_s=(first, second),
        week_gps_s=toe_s - record.toe_tow_s,
        record=record,
    )


def _clock_s(record: Any) -> float:
    """Time of clock, which is the date of a record [s since 1980-01-06, GPS time]."""
    system = SYSTEMS[record.satellite[0]]
    return float((record.toc_week + system.first_gps_week) * _WEEK_S + record.toc_tow_s + system.behind_gps_s)


def _group_delays_s(record: Any) -> tuple[float | None, float | None]:
    delays = record.group_delays
    if record.satellite[0] == "G":
        return delays.gps_tgd_s, 0.0
    return delays.beidou_tgd1_s, delays.beidou_tgd2_s


def _merged(records: Iterable[Ephemeris]) -> dict[str, tuple[Ephemeris, ...]]:
    """Records of each satellite by toe; of equal toe the one sent last, and of these one that forbids the use."""
    by_satellite: dict[str, dict[float, Ephemeris]] = {}
    for one in records:
        same = by_satellite.setdefault(one.name, {})
        other = same.get(one.toe_gps_s)
        if other is None or (one.sent_gps_s, not one.usable) >= (other.sent_gps_s, not other.usable):
            same[one.toe_gps_s] = one
    return {name: tuple(same[toe] for toe in sorted(same)) for name, same in sorted(by_satellite.items())}


def _klobuchar(file: RinexText, left_out: list[str]) -> dict[str, NDArray[np.float64]]:
    """Coefficients of the ionosphere of a file, by system letter; those that cannot be are left out."""
    found: dict[str, NDArray[np.float64]] = {}
    for letter, lines in _ionosphere_texts(file):
        try:
            values = library.klobuchar("\n".join((file.header[0], *lines, "")))[letter]
            if not (np.abs(values) <= _LARGEST_KLOBUCHAR).all():
                raise library.Unreadable("no message can say so")
            found.setdefault(letter, values)
        except (library.Unreadable, KeyError) as error:
            reason = error if isinstance(error, library.Unreadable) else "they are not complete"
            left_out.append(f"the coefficients of the ionosphere of {letter} ({reason})")
    return found


def _ionosphere_texts(file: RinexText) -> list[tuple[str, list[str]]]:
    """The lines that the coefficients of a system stand in, header and records; of RINEX 4 those sent first first."""
    end = file.header[-1]
    if file.generation == 2:
        lines = file.labelled(_IONOSPHERE_2)
        return [("G", [*lines, end])] if lines else []
    if file.generation == 3:
        given = file.labelled(("IONOSPHERIC CORR",))
        pairs = {letter: [line for line in given if line[:4] in pair] for letter, pair in _IONOSPHERE_3.items()}
        return [(letter, [*lines, end]) for letter, lines in pairs.items() if lines]
    starts = [k for k, line in enumerate(file.body) if line.startswith(">")]
    records = [file.body[start:stop] for start, stop in zip(starts, [*starts, len(file.body)][1:], strict=True)]
    kept = [(line[0][6:7], [end, *line]) for line in records if _is_ionosphere(line[0]) and len(line) > 1]
    return sorted(kept, key=lambda one: one[1][2][_ION_DATE])


def _is_ionosphere(line: str) -> bool:
    """Whether a line begins a record of the ionosphere of GPS or BeiDou in RINEX 4."""
    words = line.split()
    return len(words) >= 4 and words[1] == "ION" and (words[2][0], words[3]) in (("G", "LNAV"), ("C", "D1D2"))
