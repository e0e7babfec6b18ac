"""RTKLIB (through pyrtklib) as a second reader of receiver files: the states of satellites when signals left them."""

from __future__ import annotations

import gzip
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import hatanaka
import numpy as np

C = 299_792_458.0
WINDOW_S = 7200.0

# The GPS epoch, 1980-01-06, in the seconds since 1970 without leap seconds that RTKLIB counts in.
GPS_EPOCH_S = 315_964_800

State = tuple[tuple[float, float, float], float]


class Signal(NamedTuple):
    """Of a system: RTKLIB's name of a code and its place, the bit of the message, and what is taken of two delays."""

    code: str
    place: int = 0
    bit: int = -1
    delays: tuple[float, float] = (1.0, 0.0)


FIRST = {"G": Signal("L1C"), "C": Signal("L2I"), "E": Signal("L1C", bit=9, delays=(0.0, 1.0))}
QZSS = {"J": Signal("L1C")}
# Galileo's E5a by F/NAV: its delay is that of E1 times the ratio of squared carriers.
E5A = {"E": Signal("L5Q", 2, 8, ((154 / 115) ** 2, 0.0))}
E5B = {"E": Signal("L7Q", 1, 9, (0.0, (154 / 118) ** 2))}


def rtklib_states(
    observations: Path, navigation: Path, folder: Path, *, every: int = 1, signals: Mapping[str, Signal] = FIRST
) -> dict[tuple, State]:
    """Position and clock [m] of each satellite by GPS time and name; of each ``every``-th epoch.

    Healthy ephemerides alone, the one with the nearest toe; of Galileo the last one before.
    """
    import pyrtklib as rtklib

    paths = folder / "plain.obs", folder / "plain.nav"
    content = observations.read_bytes()
    content = gzip.decompress(content) if observations.suffix == ".gz" else content
    paths[0].write_bytes(hatanaka.crx2rnx(content) if b"CRINEX" in content[:80] else content)
    paths[1].write_text(_of_version_3(gzip.decompress(navigation.read_bytes()).decode()))
    read, sent, station = rtklib.obs_t(), rtklib.nav_t(), rtklib.sta_t()
    wanted = " ".join(f"-{letter}{signal.code}" for letter, signal in signals.items())
    rtklib.readrnx(str(paths[0]), 1, wanted, read, sent, station)
    rtklib.readrnx(str(paths[1]), 1, "", rtklib.obs_t(), sent, station)
    by_satellite: dict[int, dict[float, Any]] = {}
    for index in range(sent.n):
        record = sent.eph[index]
        signal = signals.get(_name(rtklib, record.sat)[:1])
        if signal is None or (signal.bit >= 0 and not record.code & 1 << signal.bit):
            continue
        same = by_satellite.setdefault(record.sat, {})
        toe_s = _gps_s(record.toe)
        if toe_s not in same or _gps_s(record.ttr) >= _gps_s(same[toe_s].ttr):
            same[toe_s] = record
    names: dict[int, str] = {}
    found: dict[tuple, State] = {}
    times: dict[float, int] = {}
    for index in range(read.n):
        item = read.data[index]
        time_s = _gps_s(item.time)
        if times.setdefault(time_s, len(times)) % every:
            continue
        name = names.setdefault(item.sat, _name(rtklib, item.sat))
        records, signal = by_satellite.get(item.sat), signals.get(name[:1])
        if signal is None or not records:
            continue
        range_m = item.P[signal.place]
        if item.code[signal.place] != getattr(rtklib, f"CODE_{signal.code}") or range_m == 0.0:
            continue
        past = [toe for toe in records if toe < time_s] if name[0] == "E" else []
        # Of two equally near the later one.
        toe_s = max(past) if past else min(records, key=lambda toe: (abs(toe - time_s), -toe))
        window_s = WINDOW_S * (2 if name[0] == "E" else 1)
        if abs(toe_s - time_s) <= window_s and records[toe_s].svh == 0:
            found[time_s, name] = _state(rtklib, records[toe_s], item.time, range_m, signal)
    return found


def _state(rtklib: Any, record: Any, received: Any, pseudorange_m: float, signal: Signal) -> State:
    shown = rtklib.timeadd(received, -pseudorange_m / C)
    sent = rtklib.timeadd(shown, -rtklib.eph2clk(shown, record))
    position, clock_s, variance = rtklib.Arr1Ddouble(3), rtklib.Arr1Ddouble(1), rtklib.Arr1Ddouble(1)
    rtklib.eph2pos(sent, record, position, clock_s, variance)
    return (position[0], position[1], position[2]), C * (
        clock_s[0] - signal.delays[0] * record.tgd[0] - signal.delays[1] * record.tgd[1]
    )


def _of_version_3(text: str) -> str:
    """RTKLIB does not know RINEX 4: its records of LNAV, D1, D2, I/NAV and F/NAV as RINEX 3."""
    if not text.lstrip().startswith("4"):
        return text
    records = re.findall(r"^> EPH (?:G\d\d LNAV|C\d\d D[12]|E\d\d [IF]NAV) *\n((?:[^>].*\n)*)", text, flags=re.M)
    head = f"{'3.05':>9}{'':11}{'NAVIGATION DATA':20}{'M':20}RINEX VERSION / TYPE\n{'':60}END OF HEADER\n"
    return head + "".join(records)


def _gps_s(time: Any) -> float:
    return (time.time - GPS_EPOCH_S) + time.sec


def _name(rtklib: Any, number: int) -> str:
    text = rtklib.Arr1Dchar(8)
    rtklib.satno2id(number, text)
    return str(text.ptr)


def differences(states: dict[tuple, State], data: Any, every: int = 1) -> tuple[int, float, float]:
    """How many states both have, and the largest differences of position and clock [m]; none may be missing."""
    position, clock, count = 0.0, 0.0, 0
    for row in range(0, len(data.time_gps_s), every):
        for column in np.flatnonzero(np.isfinite(data.satellite_clock_m[row])):
            theirs = states.pop((float(data.time_gps_s[row]), data.names[column]))
            position = max(position, float(np.abs(data.satellite_position_m[row, column] - theirs[0]).max()))
            clock = max(clock, abs(float(data.satellite_clock_m[row, column]) - theirs[1]))
            count += 1
    assert not states
    return count, position, clock
