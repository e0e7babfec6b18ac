"""Observation files as records: pseudoranges by epoch and satellite, events, and what was left out in words."""

from __future__ import annotations

import bisect
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import BDT_BEHIND_GPS_S
from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError
from pl_mc.receiver.observation_blocks import COLUMNS, Block, readable
from pl_mc.receiver.rinex_text import RinexText, label_of, listed
from pl_mc.receiver.signals import SYSTEMS, Observable, Signal
from pl_mc.runtime import sidereon_adapter as library

# How far systems of time are behind that of GPS [s]; Galileo and QZSS run with it by design (RINEX 3.05, 4.2).
_BEHIND_GPS_S = {"GPST": 0.0, "GST": 0.0, "QZSST": 0.0, "BDT": BDT_BEHIND_GPS_S}

# No header means a coordinate beyond this; the square of a larger one may be no number.
_FARTHEST_M = 1e9

# Pseudoranges are written to a millimetre; of the same epoch they are the same.
_SAME_M = 1.5e-3

_NAME = re.compile(r"[A-Z ][ \d]\d", re.ASCII)
_VALUE = re.compile(r" *-?\d*\.\d{3}", re.ASCII)

# Names of RINEX 2 as the library gives them.
_CODES_2 = {"C1": "C1C", "P1": "C1W", "P2": "C2W", "C2": "C2X", "C5": "C5X"}

# Header lines that say where the antenna is, or whose it is.
_PLACE = (
    "APPROX POSITION XYZ", "MARKER NAME", "MARKER NUMBER", "ANT # / TYPE", "ANTENNA: DELTA H/E/N",
    "ANTENNA: DELTA X/Y/Z",
)  # fmt: skip


@dataclass(frozen=True)
class Event:
    """Something that happened to the antenna or the site between two epochs.

    Attributes:
        line: of the file.
        time_gps_s: of the event or of the epoch before it; NaN where there is none [s since 1980-01-06].
        what: in words.
    """

    line: int
    time_gps_s: float
    what: str


@dataclass(frozen=True)
class Observations:
    """Pseudoranges of a receiver; e epochs, m satellites, GPS first.

    Attributes:
        path: the file.
        time_gps_s: (e,), epochs by the receiver's clock [s since 1980-01-06, GPS time].
        names: m satellites by RINEX name.
        observables: what is made of the pseudoranges of each system letter.
        pseudorange_m: (e, m), that [m]; NaN where missing.
        one_carrier: (e, m), where one of the two pseudoranges that are needed is missing.
        header_position_m: (3,), approximate position of the header [m]; NaN where absent.
        epochs_in_file: number of epochs of the file, with those that hold no pseudorange of the systems.
        events: those that move or change the antenna or the site.
        found: what each system letter that is asked for is observed by, its codes.
        systems: letters of all systems of the header.
        notes: sentences about what was left out or read in another way than usual.
    """

    path: Path
    time_gps_s: NDArray[np.float64]
    names: tuple[str, ...]
    observables: Mapping[str, Observable]
    pseudorange_m: NDArray[np.float64]
    one_carrier: NDArray[np.bool_]
    header_position_m: NDArray[np.float64]
    epochs_in_file: int
    events: tuple[Event, ...]
    found: Mapping[str, tuple[str, ...]]
    systems: tuple[str, ...]
    notes: tuple[str, ...]


def read_observations(
    file: RinexText, candidates: Mapping[str, Sequence[Observable]], *, snr_dbhz: float | None = None
) -> Observations:
    """Read an observation file of any version; what cannot be read in it is left out and told.

    Args:
        file: the file.
        candidates: of each system letter, what can be made of its pseudoranges; the first that the file has counts.
        snr_dbhz: least strength of a signal whose pseudorange is read (S1C beside C1C) [dB-Hz]; any unless given.

    Raises:
        InputError: a header that cannot be read, times of a system that is not read, no epoch at all, or strengths that
            are asked for and not there.
    """
    # Of RINEX 2, whose names of other systems' signals nobody settled, GPS is read.
    able = {letter: every for letter, every in candidates.items() if file.generation > 2 or letter == "G"}
    every_code = {
        letter: tuple(dict.fromkeys(code for one in every for signal in one.signals for code in _codes(file, signal)))
        for letter, every in able.items()
    }
    read, blocks, left_out = readable(file, every_code)
    said = [f"Left out of {file.path.name}, as it cannot be read: {listed(left_out)}."] if left_out else []
    behind_s = _behind_gps_s(file, read, said)
    found, chosen = _chosen(file, read, able, said)
    # The codes of first signals, and those of second ones.
    parts = [
        {letter: codes[k] for letter, (_, codes) in chosen.items() if len(codes) > k}
        for k in range(max((len(codes) for _, codes in chosen.values()), default=0))
    ]
    policies = [library.policy({letter: (code,) for letter, code in part.items()}) for part in parts]
    wrong: list[str] = []
    weak: Counter[str] = Counter()
    epochs: list[_Epoch] = []
    columns: dict[str, list[str]] = {}
    for index, (epoch, block) in enumerate(zip(read.epochs, blocks, strict=True)):
        if index == 0 or any(label_of(line) in COLUMNS for line in block.records):
            columns = {letter: library.codes(read.header_at(index), letter) for letter in chosen}
            for letter, code in [pair for part in parts for pair in part.items() if pair[1] not in columns[pair[0]]]:
                where = f"From line {block.number} of {file.path.name} on"
                said.append(f"{where} it has no {code} of {SYSTEM_NAMES[letter]}.")
        if epoch.flag < 2:
            ranges_m: list[dict[str, float]] = []
            for part, policy in zip(parts, policies, strict=True):
                values = read.pseudoranges(index, policy)
                ranges_m.append(dict(zip(values.satellites, values.ranges_m.tolist(), strict=True)))
                _drop_wrong(block, columns, part, ranges_m[-1], wrong)
                if snr_dbhz is not None:
                    _drop_weak(file, block, columns, part, ranges_m[-1], snr_dbhz, weak)
            epochs.append((_gps_s(epoch.epoch) + behind_s, block, _combined(ranges_m, chosen)))
    if wrong:
        said.append(f"Left out of {file.path.name}, as no satellite or no pseudorange is like that: {listed(wrong)}.")
    said += [f"{number:,} pseudoranges {what} were left out." for what, number in weak.items()]
    epochs = _in_order(file, epochs, said)
    names = sorted({name for _, _, values in epochs for name in values}, key=lambda name: (name[0] != "G", name))
    column = {name: k for k, name in enumerate(names)}
    kept = [(time_s, values) for time_s, _, values in epochs if values]
    combined_m = np.full((len(kept), len(names)), np.nan)
    there = np.zeros(combined_m.shape, dtype=bool)
    for row, (_, values) in enumerate(kept):
        for name, value in values.items():
            combined_m[row, column[name]], there[row, column[name]] = value, True
    return Observations(
        path=file.path,
        time_gps_s=np.array([time_s for time_s, _ in kept], dtype=np.float64),
        names=tuple(names),
        observables={letter: observable for letter, (observable, _) in chosen.items()},
        pseudorange_m=combined_m,
        one_carrier=there & np.isnan(combined_m),
        header_position_m=_position_m(read.header.approx_position_m),
        epochs_in_file=len(epochs),
        events=_events(file, read, blocks, behind_s),
        found=found,
        systems=tuple(dict.fromkeys(line[0] for line in file.labelled(COLUMNS[:1]) if line[0] != " ")) or tuple(found),
        notes=tuple(said),
    )


# Time [s], block, and what is made of the pseudoranges by satellite [m], NaN where one of two is missing.
_Epoch = tuple[float, Block, dict[str, float]]

# What is made of the pseudoranges of each system, and the code of each of its signals.
_Chosen = dict[str, tuple[Observable, tuple[str, ...]]]


def _codes(file: RinexText, signal: Signal) -> tuple[str, ...]:
    """Codes of a signal in the order of preference, by the names that the library gives them."""
    if file.generation == 2:
        return tuple(_CODES_2[code] for code in signal.codes_2)
    return signal.codes + (signal.codes_302 if float(file.version) < 3.03 else ())


def _chosen(
    file: RinexText, read: Any, candidates: Mapping[str, Sequence[Observable]], said: list[str]
) -> tuple[dict[str, tuple[str, ...]], _Chosen]:
    """The codes of each system of the header, and what is read of each: the first that has values, code by code."""
    found: dict[str, tuple[str, ...]] = {}
    chosen: _Chosen = {}
    for letter, every in candidates.items():
        listed_codes = _ever_listed(read, letter)
        if not listed_codes:
            continue
        names = tuple(read.header.rinex2_types) if file.generation == 2 else listed_codes
        found[letter] = names
        for observable in every:
            codes = [_first_with_values(file, read, signal, listed_codes) for signal in observable.signals]
            if not all(codes):
                continue
            chosen[letter] = observable, tuple(codes)
            for code, signal in zip(codes, observable.signals, strict=True):
                usual = _codes(file, signal)[0]
                if code[-1] != usual[-1]:
                    name = names[listed_codes.index(code)] if file.generation == 2 else code
                    said.append(f"{SYSTEM_NAMES[letter]} is read from {name}; {file.path.name} has no {usual} of it.")
            break
    return found, chosen


def _first_with_values(file: RinexText, read: Any, signal: Signal, listed_codes: Sequence[str]) -> str:
    """The first code of a signal that the file has a value of; empty where it has none."""
    for code in _codes(file, signal):
        policy = library.policy({signal.system: (code,)})
        if code in listed_codes and any(len(read.pseudoranges(k, policy)) for k in range(read.epoch_count)):
            return code
    return ""


def _combined(ranges_m: Sequence[Mapping[str, float]], chosen: _Chosen) -> dict[str, float]:
    """What is made of the pseudoranges of an epoch's satellites [m]; NaN where one of two is missing."""
    coefficients = {letter: observable.coefficients for letter, (observable, _) in chosen.items()}
    made = {}
    for name in dict.fromkeys(name for part in ranges_m for name in part):
        parts = zip(coefficients[name[0]], ranges_m, strict=False)
        made[name] = sum(coefficient * part.get(name, np.nan) for coefficient, part in parts)
    return made


def _ever_listed(read: Any, letter: str) -> tuple[str, ...]:
    """Codes of a system in the header, and those that an event brings."""
    timeline = read.header_timeline()
    return tuple(dict.fromkeys(code for _, header in timeline.segments() for code in library.codes(header, letter)))


def _drop_wrong(
    block: Block,
    columns: Mapping[str, Sequence[str]],
    chosen: Mapping[str, str],
    values: dict[str, float],
    said: list[str],
) -> None:
    """Take away satellites that do not exist, and values that have lost digits or whose lines have changed places."""
    for one in block.satellites:
        name = one.name.strip()
        letter = name[:1] if name[:1].isalpha() else "G"
        number = name.removeprefix(letter).strip()
        if letter not in chosen or chosen[letter] not in columns[letter]:
            continue
        field = block.field(one, columns[letter].index(chosen[letter]))
        misshapen = (field.strip() and not _VALUE.fullmatch(field)) or block.is_overfull(one, len(columns[letter]))
        named = _NAME.fullmatch(one.name) and 1 <= int(number) <= SYSTEMS[letter].highest_number
        if misshapen or not named:
            values.pop(f"{letter}{number:0>2}", None)
            said.append(f"line {one.number} ({one.name}, {block.when}: {field.strip()!r})")


def _drop_weak(
    file: RinexText,
    block: Block,
    columns: Mapping[str, Sequence[str]],
    chosen: Mapping[str, str],
    values: dict[str, float],
    least_dbhz: float,
    said: Counter[str],
) -> None:
    """Take away pseudoranges of signals that are weaker than asked for, or of no known strength."""
    for one in block.satellites:
        name = one.name.strip()
        letter = name[:1] if name[:1].isalpha() else "G"
        name = f"{letter}{name.removeprefix(letter).strip():0>2}"
        if name not in values or letter not in chosen:
            continue
        # Of RINEX 2 a strength is that of a carrier, whatever the code.
        band = [code for code in columns[letter] if code.startswith(f"S{chosen[letter][1]}")]
        exact = f"S{chosen[letter][1:]}"
        wanted = exact if exact in band else band[0] if band and file.generation == 2 else None
        if wanted is None:
            raise InputError(
                f"{file.path}: it has no strength {exact} of the pseudorange {chosen[letter]} of "
                f"{SYSTEM_NAMES[letter]}, which snr_dbhz (--snr) needs."
            )
        text = block.field(one, columns[letter].index(wanted))[:14].strip()
        try:
            strength = float(text) if text else None
        except ValueError:
            strength = None
        if strength is None or not strength >= least_dbhz:
            del values[name]
            what = "of an unknown strength" if strength is None else f"of less than {least_dbhz:g} dB-Hz"
            said[what] += 1


def _in_order(file: RinexText, epochs: list[_Epoch], said: list[str]) -> list[_Epoch]:
    """Epochs whose times increase: one of each time, and as many as can be in order.

    Epochs of one time that agree are one; some programs write the systems one after the other.
    """
    first: dict[float, _Epoch] = {}
    alike, unlike, kept = [], [], []
    for epoch in epochs:
        earlier = first.setdefault(epoch[0], epoch)
        if earlier is epoch:
            kept.append(epoch)
            continue
        one, other = earlier[2], epoch[2]
        common = one.keys() & other.keys()
        if any(abs(one[name] - other[name]) > _SAME_M for name in common):
            unlike.append(epoch)
            continue
        if common:
            alike.append(epoch)
        one.update({name: value for name, value in other.items() if not np.isnan(value) or name not in one})
    places = _longest_increasing([time_s for time_s, _, _ in kept])
    inside = set(places)
    for sort, what in (
        (alike, "repeated, with the same pseudoranges"),
        (unlike, "repeated, with other pseudoranges than the first time, which is used"),
        ([epoch for k, epoch in enumerate(kept) if k not in inside], "out of the order of time"),
    ):
        if sort:
            where = listed([f"line {block.number} ({block.when})" for _, block, _ in sort])
            number = f"{len(sort)} epoch{'s' if len(sort) > 1 else ''}"
            said.append(f"{number} of {file.path.name} left out as {what}: {where}.")
    return [kept[k] for k in places]


def _longest_increasing(times_s: Sequence[float]) -> list[int]:
    """Places of a longest increasing part, by the piles of patience sorting."""
    tops: list[float] = []
    at: list[int] = []
    before = [-1] * len(times_s)
    for k, time_s in enumerate(times_s):
        pile = bisect.bisect_left(tops, time_s)
        tops[pile : pile + 1], at[pile : pile + 1] = [time_s], [k]
        before[k] = at[pile - 1] if pile else -1
    places, k = [], at[-1] if at else -1
    while k >= 0:
        places.append(k)
        k = before[k]
    return places[::-1]


def _events(file: RinexText, read: Any, blocks: Sequence[Block], behind_s: float) -> tuple[Event, ...]:
    """Events that move the antenna, or whose header lines say another place than those before."""
    place = {label: _words(line) for line in file.header for label in (label_of(line),) if label in _PLACE}
    found = []
    time_s = np.nan
    for epoch, block in zip(read.epochs, blocks, strict=True):
        time_s = time_s if epoch.epoch is None else _gps_s(epoch.epoch) + behind_s
        if not 2 <= epoch.flag <= 5:
            continue
        kinds = {2: "the antenna begins to move", 3: "a new site"}
        said = [kinds[epoch.flag]] if epoch.flag in kinds else []
        for line in block.records:
            label = label_of(line)
            if label in _PLACE and place.get(label, "") != _words(line):
                said.append(f"{label} becomes {_words(line) or 'blank'}")
                place[label] = _words(line)
        if said:
            found.append(Event(block.number, time_s, ", ".join(said)))
    return tuple(found)


def _words(line: str) -> str:
    return " ".join(line[:60].split())


def _behind_gps_s(file: RinexText, read: Any, said: list[str]) -> float:
    """How far the times of the file are behind those of GPS [s]."""
    first, given = read.header.time_of_first_obs, file.labelled(["TIME OF FIRST OBS"])
    if first is not None and given and not given[0][48:51].strip():
        # Files of one system are in its own time unless they say so (RINEX 2.11, 3.04; times of GLONASS are UTC).
        scale = {"R": "UTC", "C": "BDT", "M": ""}.get(file.header[0][40:41], "GPST")
    else:
        scale = "" if first is None else str(first[1]).removeprefix("TimeScale.")
    if not scale:
        said.append(f"{file.path.name} does not say of which system its times are (TIME OF FIRST OBS); GPS is assumed.")
        return 0.0
    if scale not in _BEHIND_GPS_S:
        raise InputError(
            f"{file.path}: its times are {scale} (TIME OF FIRST OBS), and GPS, Galileo, QZSS or BeiDou time is needed; "
            "convert it."
        )
    return _BEHIND_GPS_S[scale]


def _gps_s(time: Any) -> float:
    whole = datetime(time.year, time.month, time.day, time.hour, time.minute) - GPS_EPOCH
    return whole.total_seconds() + time.second


def _position_m(found: Any) -> NDArray[np.float64]:
    if found is None or not found.any() or (np.abs(found) > _FARTHEST_M).any():
        return np.full(3, np.nan)
    return np.asarray(found, dtype=np.float64)
