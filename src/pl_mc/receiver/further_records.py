"""Records of navigation files that the library reads one by one, GLONASS, or not at all, B-CNAV of BeiDou."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from typing import NamedTuple

import numpy as np

from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.receiver.ephemerides import NUMBER_WIDTH, Ephemeris, misshapen
from pl_mc.receiver.rinex_text import RinexText
from pl_mc.receiver.signals import (
    ADDED_DELAYS,
    ADDED_FLAGS,
    ADDED_HEALTH,
    ADDED_TO_D1,
    D1_D2,
    FDMA,
    FLAGS_ABOVE,
    SYSTEMS,
)
from pl_mc.runtime import sidereon_adapter as library

# GLONASS: circles at 25,508 km; 3.6 km/s in space, with a clock of 22 bits of 2^-30 s (GLONASS ICD 5.1, table 4.5).
_GLONASS_RADIUS_M, _FASTEST_M_S, _LARGEST_TAU_S = (2.5e7, 2.6e7), 4500.0, 2e-3

# Channels that satellites have had since 2005, and those of today, -7 to 6 (GLONASS ICD 5.1, 3.3.1.1).
_CHANNELS = range(-7, 14)

_ANNOUNCED = re.compile(rf"> EPH (C\d\d) ({'|'.join(ADDED_TO_D1)})\b", re.ASCII)
_PLACES = (*ADDED_DELAYS.values(), ADDED_HEALTH, ADDED_FLAGS)


def glonass_records(file: RinexText, body: Sequence[str], left_out: list[str]) -> list[Ephemeris]:
    """The sound records of GLONASS, which the library reads one by one."""
    sound = []
    starts = [k for k, line in enumerate(body) if re.match(r"R[ \d]\d ", line, re.ASCII)]
    for start in starts:
        stop = next((k for k in range(start + 1, len(body)) if not body[k].startswith("    ")), len(body))
        announced = [body[start - 1]] if start and body[start - 1].startswith(">") else []
        where = f"the record of {body[start][:3]} at line {file.number(start)}"
        try:
            orbit = library.GlonassOrbit("\n".join((*file.header, *announced, *body[start:stop], "")))
        except (library.Unreadable, ValueError) as error:
            left_out.append(f"{where} ({error})")
            continue
        record = orbit.record
        radius_m, speed_m_s = (float(np.linalg.norm(part)) for part in (record.position_m, record.velocity_m_s))
        low, high = _GLONASS_RADIUS_M
        if not (low < radius_m < high and speed_m_s < _FASTEST_M_S and abs(record.clock_bias_s) < _LARGEST_TAU_S):
            left_out.append(f"{where} (no satellite is there, is so fast or has such a clock)")
            continue
        if record.freq_channel not in _CHANNELS:
            left_out.append(f"{where} (there is no channel {record.freq_channel})")
            continue
        sound.append(
            Ephemeris(
                name=record.satellite,
                message=FDMA,
                toe_gps_s=orbit.toe_gps_s,
                sent_gps_s=-math.inf,
                health=0 if record.is_healthy else 1,
                predicted=True,
                group_delays_s={},
                week_gps_s=orbit.toe_gps_s,
                record=orbit,
            )
        )
    return sound


class Added(NamedTuple):
    """Of a message beside D1: its satellite, name and time of clock, with what it has."""

    name: str
    message: str
    time_gps_s: float
    health: int
    group_delays_s: Mapping[str, float]


def added_records(file: RinexText, left_out: list[str]) -> list[Added]:
    """What records of RINEX 4 say of BeiDou's further signals; their orbits and clocks are not read."""
    found = []
    for k, line in enumerate(file.body):
        match = _ANNOUNCED.match(line)
        rows = file.body[k + 1 : k + 2 + ADDED_HEALTH[0]]
        if not match or len(rows) <= ADDED_HEALTH[0]:
            continue
        fields = {place: rows[place[0]][4:].ljust(76)[NUMBER_WIDTH * place[1] :][:NUMBER_WIDTH] for place in _PLACES}
        bad = misshapen(list(fields.values())) or ("" if fields[ADDED_HEALTH].strip() else "no health")
        try:
            date = datetime.strptime(rows[0][4:23], "%Y %m %d %H %M %S")
        except ValueError:
            bad = bad or rows[0][4:23]
        given = {delay: fields[at] for delay, at in ADDED_DELAYS.items() if fields[at].strip()}
        delays_s = {} if bad else {delay: _number(text) for delay, text in given.items()}
        if bad or not all(abs(delay_s) <= SYSTEMS["C"].largest_group_delay_s for delay_s in delays_s.values()):
            left_out.append(f"the record of {match[1]} at line {file.number(k + 1)} ({bad or 'its group delays'})")
            continue
        time_s = (date - GPS_EPOCH).total_seconds() + SYSTEMS["C"].behind_gps_s
        # Where no flags are written none is raised.
        health, flags = (int(_number(fields[at] if fields[at].strip() else "0")) for at in (ADDED_HEALTH, ADDED_FLAGS))
        health |= max(flags, 0) << FLAGS_ABOVE
        found.append(Added(match[1], ADDED_TO_D1[match[2]], time_s, health, delays_s))
    return found


def _number(text: str) -> float:
    return float(text.upper().replace("D", "E"))


def with_added(records: Iterable[Ephemeris], added: Iterable[Added]) -> Iterator[Ephemeris]:
    """The records of D1 once more, with the delays and the health of the further message that is nearest in time."""
    by_message: dict[tuple[str, str], list[Added]] = {}
    for one in added:
        by_message.setdefault((one.name, one.message), []).append(one)
    for record in records:
        for message in ADDED_TO_D1.values() if record.message == D1_D2 else ():
            every = by_message.get((record.name, message), ())
            near = min(every, key=lambda one: abs(one.time_gps_s - record.toe_gps_s), default=None)
            if near is not None and abs(near.time_gps_s - record.toe_gps_s) <= SYSTEMS["C"].ephemeris_window_s:
                delays_s = {**record.group_delays_s, **near.group_delays_s}
                yield replace(record, message=message, health=near.health, group_delays_s=delays_s)
