"""Almanacs of GPS: the real satellites of a day instead of nominal slots, from a YUMA or a SEM file.

Elements and their units are those of IS-GPS-200, section 20.3.3.5.2; the two text forms are those in which the US
Coast Guard Navigation Center publishes them. Both count weeks modulo 1024: of the weeks that a number can mean, the
nearest to the time of the simulation is taken.
"""

from __future__ import annotations

import itertools
import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pl_mc.constants import EARTH_ROTATION_RAD_S
from pl_mc.geometry.constellations import Slot
from pl_mc.input_errors import InputError, shown, system_reason

_WEEK_S = 604_800.0
_WEEKS_PER_CYCLE = 1024

# The longest an almanac can sensibly be, so that another file is told from one before it is read.
_LARGEST_BYTES = 1_000_000

# A SEM file holds the inclination less 0.30 semicircles, as the satellites send it.
_SEM_INCLINATION = 0.30

# Elements with the words before their units in a YUMA record, and the widest values that the navigation message has
# room for, less what is no orbit.
_ELEMENTS: dict[str, tuple[str, float, float]] = {
    "prn": ("id", 1, 63),
    "health": ("health", 0, 511),
    "eccentricity": ("eccentricity", 0.0, 0.5),
    "toa_s": ("time of applicability", 0.0, _WEEK_S),
    "inclination_rad": ("orbital inclination", 0.0, np.pi),
    "raan_rate_rad_s": ("rate of right ascen", -1e-6, 1e-6),
    "root_axis": ("sqrt", 4500.0, 7000.0),
    "raan_rad": ("right ascen at week", -2 * np.pi, 2 * np.pi),
    "perigee_rad": ("argument of perigee", -2 * np.pi, 2 * np.pi),
    "mean_anomaly_rad": ("mean anom", -2 * np.pi, 2 * np.pi),
    "week": ("week", 0, 8191),
}
_WHOLE = ("prn", "health", "week")
_WITHOUT_POINT = (*_WHOLE, "toa_s")
_YUMA_HEADING = re.compile(r"\*+ *week +(\d{1,4}) +almanac for PRN-(\d{1,2})\b", re.IGNORECASE | re.ASCII)
_DECIMAL = re.compile(r"\s*[-+]?\d+\.\d", re.ASCII)

# Places in a SEM record: PRN, SVN, accuracy; e, i, rate of the node; root of a, node, perigee; M, clock offset and
# drift; health, configuration. Angles are in semicircles.
_SEM = {
    "prn": 0, "eccentricity": 3, "inclination_rad": 4, "raan_rate_rad_s": 5, "root_axis": 6, "raan_rad": 7,
    "perigee_rad": 8, "mean_anomaly_rad": 9, "health": 12,
}  # fmt: skip
_SEM_ANGLES = (4, 5, 7, 8, 9)
_SEM_NUMBERS = 14
_SEM_ROWS = [0, 1, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5, 6, 7]

# The satellites that are in use have almanacs of one upload, or of the two before and after it.
_LONGEST_SPREAD_S = 2 * _WEEK_S


def almanac_slots(path: str | Path, near_gps_s: float) -> tuple[Slot, ...]:
    """The healthy satellites of an almanac.

    Args:
        path: a YUMA or SEM file; which of them it is follows from its text.
        near_gps_s: a time within ten years of the almanac, GPS seconds [s].

    Raises:
        InputError: a file that is missing, cut short, damaged or no almanac, or without a healthy satellite; the
            sentence names file and line.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"almanac: the path of a YUMA or SEM file is needed, not {shown(path)}.")
    path = Path(path)
    lines = _lines(path)
    records = list(_yuma(path, lines) if any(line.startswith("****") for line in lines) else _sem(path, lines))
    slots = []
    seen: set[int] = set()
    for line, record in records:
        for field, (_, low, high) in _ELEMENTS.items():
            value = record[field]
            if not low <= value <= high or (field in _WHOLE and value != int(value)):
                raise InputError(f"{path}: line {line}: {field} is {value:g}, which is no value of an almanac.")
        prn = int(record["prn"])
        if prn in seen:
            raise InputError(f"{path}: line {line}: PRN {prn} appears twice.")
        seen.add(prn)
        if record["health"] == 0:
            slots.append(_slot(record, near_gps_s))
    if not slots:
        raise InputError(f"{path}: it holds no healthy satellite.")
    moments = [slot.reference_gps_s for slot in slots]
    if max(moments) - min(moments) > _LONGEST_SPREAD_S:
        raise InputError(
            f"{path}: the times of its healthy satellites are {(max(moments) - min(moments)) / 86_400:.0f} days "
            "apart; a week or a time of applicability is damaged."
        )
    return tuple(sorted(slots, key=lambda slot: slot.name))


def _slot(record: Mapping[str, float], near_gps_s: float) -> Slot:
    week, cycle_s = int(record["week"]), _WEEKS_PER_CYCLE * _WEEK_S
    moment = (week % _WEEKS_PER_CYCLE) * _WEEK_S + record["toa_s"]
    moment += cycle_s * round((near_gps_s - moment) / cycle_s)
    return Slot(
        name=f"G{int(record['prn']):02d}",
        system="G",
        orbit="GPS",
        semi_major_axis_m=record["root_axis"] ** 2,
        inclination_rad=record["inclination_rad"],
        raan_rad=record["raan_rad"],
        argument_of_latitude_rad=record["perigee_rad"] + record["mean_anomaly_rad"],
        reference_gps_s=moment,
        # The node is given for the start of the week and the Earth turns on from there, at a rate of its own name.
        reference_sidereal_rad=EARTH_ROTATION_RAD_S * record["toa_s"],
        eccentricity=record["eccentricity"],
        perigee_rad=record["perigee_rad"],
        raan_rate_rad_s=record["raan_rate_rad_s"],
    )


def _lines(path: Path) -> list[str]:
    try:
        status = path.stat()
        readable = stat.S_ISREG(status.st_mode) and status.st_size <= _LARGEST_BYTES
        content = path.read_bytes() if readable else b""
    except OSError as error:
        raise InputError(f"{path}: the almanac cannot be read ({system_reason(error)}).") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: this cannot be the name of an almanac.") from None
    if not readable:
        raise InputError(f"{path}: it is no regular file of up to {_LARGEST_BYTES} bytes, as an almanac is.")
    if b"\0" in content:
        raise InputError(f"{path}: it holds binary data and is no YUMA or SEM almanac.")
    return content.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _yuma(path: Path, lines: Sequence[str]) -> Iterator[tuple[int, dict[str, float]]]:
    """Line of the heading and elements of each satellite."""
    headings = [k for k, line in enumerate(lines) if line.startswith("****")]
    for begin, end in itertools.pairwise([-1, *headings, len(lines)]):
        record: dict[str, float] = {}
        for number, line in enumerate(lines[begin + 1 : end], start=begin + 2):
            at = f"{path}: line {number}:"
            words, colon, value = line.partition(":")
            words = words.strip().lower()
            if not line.strip():
                continue
            if begin < 0 or not colon:
                raise InputError(f"{at} a heading of asterisks or a field with a colon is needed.")
            if words.count("(") != words.count(")"):
                raise InputError(f"{at} the unit in {line.strip()!r} is not whole; the file is damaged.")
            name = next((name for name, (start, *_) in _ELEMENTS.items() if words.startswith(start)), None)
            if name is None:
                continue
            if name in record:
                raise InputError(f"{at} {name} appears twice in the record of a satellite.")
            record[name] = _number(path, number, value)
            # What is left of a number that has lost its beginning is mostly a number too.
            if name not in _WITHOUT_POINT and not _DECIMAL.match(value):
                raise InputError(
                    f"{at} a number with digits on both sides of its point is needed, not {value.strip()!r}."
                )
        if begin < 0:
            continue
        if missing := [name for name in _ELEMENTS if name not in record]:
            raise InputError(f"{path}: line {begin + 1}: the record of a satellite lacks {', '.join(missing)}.")
        heading = _YUMA_HEADING.search(lines[begin])
        if heading and (int(heading[1]), int(heading[2])) != (record["week"], record["prn"]):
            raise InputError(
                f"{path}: line {begin + 1}: the heading says week {int(heading[1])} and PRN {int(heading[2])}, the "
                f"record week {record['week']:g} and PRN {record['prn']:g}."
            )
        yield begin + 1, record


def _sem(path: Path, lines: Sequence[str]) -> Iterator[tuple[int, dict[str, float]]]:
    """Line of the PRN and elements of each satellite."""
    numbered = [(k, line.split()) for k, line in enumerate(lines, start=1) if line.strip()]
    head = re.fullmatch(r"\s*(\d{1,2})\s+\S.*", lines[0] if lines else "")
    if head is None or len(numbered) < 2 or len(numbered[1][1]) != 2:
        raise InputError(f"{path}: it is no YUMA or SEM almanac; both are text, with a heading in every file.")
    at, (week, toa) = numbered[1]
    shared = {"week": _number(path, at, week), "toa_s": _number(path, at, toa)}
    fields = [(k, word) for k, words in numbered[2:] for word in words]
    count = int(head.group(1))
    if len(fields) != count * _SEM_NUMBERS:
        raise InputError(
            f"{path}: its first line promises {count} satellites of {_SEM_NUMBERS} numbers, but it holds "
            f"{len(fields)} numbers; is it cut short?"
        )
    scaled = [(k, word) for k, word in fields if "e" in word.lower()]
    headless = [(k, word) for k, word in scaled if word.lstrip("+-").startswith(".")]
    if 0 < len(headless) < len(scaled):
        at, word = headless[0]
        raise InputError(
            f"{path}: line {at}: a number with digits before its point, as others here, is needed, not {word}."
        )
    after_blank = {k: not lines[k - 2].strip() for k, _ in fields[::_SEM_NUMBERS]}
    apart = any(list(after_blank.values())[1:])
    for first in range(0, len(fields), _SEM_NUMBERS):
        line = fields[first][0]
        rows = [k - line for k, _ in fields[first : first + _SEM_NUMBERS]]
        if rows != _SEM_ROWS:
            raise InputError(
                f"{path}: line {line}: the record of a satellite is eight lines of 1, 1, 1, 3, 3, 3, 1 and 1 "
                "numbers, none of them empty."
            )
        # A blank line that has gone mostly took digits of the number before it along.
        if apart and not after_blank[line]:
            raise InputError(
                f"{path}: line {line}: a blank line is needed above the record of a satellite, as above others here."
            )
        value = [_number(path, k, word) for k, word in fields[first : first + _SEM_NUMBERS]]
        value[4] += _SEM_INCLINATION
        yield line, shared | {name: value[k] * (np.pi if k in _SEM_ANGLES else 1.0) for name, k in _SEM.items()}


def _number(path: Path, line: int, text: str) -> float:
    try:
        # Python reads digits of other alphabets and underscores too, which no almanac has.
        number = float(text) if text.isascii() and "_" not in text else np.nan
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{path}: line {line}: a number is needed, not {text.strip()!r}.")
    return number
