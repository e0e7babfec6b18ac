"""The one file that speaks to the orbit library (RTKLIB, through pyrtklib): RINEX text in, plain arrays out.

It is run as a program of its own, ``python rtklib_worker.py OBS NAV RESULT G7200 C7200`` (systems, with how far an
epoch may lie from an ephemeris' reference time toe [s]), and imports nothing of this package: RTKLIB is C code that
parses whatever a file holds, and a fault in it must end a child process and not the analysis.
`pl_mc.receiver.rinex` checks the files, starts it and reads its result.

To exchange the library, rewrite this file and keep the arrays that `evaluate` returns.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

SPEED_OF_LIGHT_M_S = 299_792_458.0  # the same figure as pl_mc.constants, which a lone program does not import

# What became of each pseudorange.
ABSENT, USABLE, NO_EPHEMERIS, UNHEALTHY = 0, 1, 2, 3

# The GPS epoch, 1980-01-06, in the seconds since 1970 without leap seconds that RTKLIB counts in.
_GPS_EPOCH_S = 315_964_800

EXIT_NO_LIBRARY = 3


def main(arguments: list[str]) -> int:
    """Read OBS and NAV, write RESULT (.npz); returns the exit code."""
    observation_path, navigation_path, result_path, *systems = arguments
    try:
        import pyrtklib
    except ImportError as error:
        sys.stderr.write(str(error))
        return EXIT_NO_LIBRARY
    arrays: dict[str, Any] = evaluate(
        pyrtklib, observation_path, navigation_path, {system[0]: float(system[1:]) for system in systems}
    )
    np.savez(result_path, **arrays)
    return 0


def evaluate(
    rtklib: Any, observation_path: str, navigation_path: str, systems: Mapping[str, float]
) -> dict[str, NDArray]:
    """Pseudoranges of a file and the state of each satellite when its signal left it.

    Args:
        rtklib: the library.
        observation_path, navigation_path: plain RINEX 3 files, no satellite twice in an epoch.
        systems: RINEX letters of the systems to keep, and how far an epoch may lie from toe [s].

    Returns:
        time_gps_s (e,): epochs [s since 1980-01-06, GPS time]; names (m,);
        pseudorange_m (e, m): NaN where missing; position_m (e, m, 3): Earth-fixed at transmission time, axes as
        oriented at that time; clock_m (e, m): satellite clock with relativity and the first group delay, times the
        speed of light; group_delays_m (e, m, 2): both group delays, likewise; state (e, m): ABSENT, USABLE,
        NO_EPHEMERIS, UNHEALTHY; toe_gps_s (e, m): reference time of the ephemeris used; alpha, beta (4,):
        Klobuchar coefficients; ephemeris_names, ephemeris_toe_gps_s,
        semi_major_axis_m, inclination_rad (k,): the ephemerides of the file.
    """
    observations, navigation, station = rtklib.obs_t(), rtklib.nav_t(), rtklib.sta_t()
    rtklib.readrnx(observation_path, 1, "-GL1C -CL2I", observations, navigation, station)
    rtklib.readrnx(navigation_path, 1, "", rtklib.obs_t(), navigation, station)
    rows, times_s, satellites, pseudorange_m = _observations(rtklib, observations, systems)
    by_satellite, listed = _ephemerides(rtklib, navigation, systems)

    epoch_s, epoch_of = np.unique(times_s, return_inverse=True)
    numbers, column_of = np.unique(satellites, return_inverse=True)
    # RTKLIB numbers satellites system by system, so that this order is G01, G02, ..., C01, C02, ...
    names = [_name(rtklib, int(number)) for number in numbers]
    shape = (epoch_s.size, numbers.size)

    result: dict[str, NDArray] = {
        "time_gps_s": epoch_s,
        "names": np.array(names, dtype="U3"),
        "pseudorange_m": np.full(shape, np.nan),
        "position_m": np.full((*shape, 3), np.nan),
        "clock_m": np.full(shape, np.nan),
        "group_delays_m": np.full((*shape, 2), np.nan),
        "state": np.full(shape, ABSENT, dtype=np.int8),
        "toe_gps_s": np.full(shape, np.nan),
        "alpha": np.array([navigation.ion_gps[k] for k in range(4)]),
        "beta": np.array([navigation.ion_gps[k] for k in range(4, 8)]),
        **listed,
    }
    result["pseudorange_m"][epoch_of, column_of] = pseudorange_m
    for column, (number, name) in enumerate(zip(numbers, names, strict=True)):
        mine = np.flatnonzero(column_of == column)
        state = np.full(mine.size, NO_EPHEMERIS, dtype=np.int8)
        records = by_satellite.get(int(number), [])
        if records:
            toe_s = np.array([_gps_seconds(record.toe) for record in records])
            nearest = _nearest(toe_s, times_s[mine])
            inside = np.abs(toe_s[nearest] - times_s[mine]) <= systems[name[0]]
            healthy = np.array([record.svh == 0 for record in records])[nearest]
            state[inside] = np.where(healthy[inside], USABLE, UNHEALTHY)
            for k in np.flatnonzero(inside & healthy):
                row, where = mine[k], (epoch_of[mine[k]], column)
                received = observations.data[int(rows[row])].time
                position, clock_m = _state(rtklib, records[nearest[k]], received, float(pseudorange_m[row]))
                result["position_m"][where], result["clock_m"][where] = position, clock_m
                result["group_delays_m"][where] = [SPEED_OF_LIGHT_M_S * records[nearest[k]].tgd[i] for i in range(2)]
                result["toe_gps_s"][where] = toe_s[nearest[k]]
        result["state"][epoch_of[mine], column] = state
    return result


def _observations(
    rtklib: Any, observations: Any, systems: Mapping[str, float]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Index, time [s], satellite number and pseudorange [m] of each observation of the one code we use."""
    codes = {"G": rtklib.CODE_L1C, "C": rtklib.CODE_L2I}
    code_of: dict[int, int | None] = {}
    kept = []
    for index in range(observations.n):
        item = observations.data[index]
        number = item.sat
        if number not in code_of:
            letter = _name(rtklib, number)[:1]
            code_of[number] = codes[letter] if letter in systems else None
        if item.code[0] == code_of[number] and item.P[0] != 0.0:
            kept.append((index, _gps_seconds(item.time), number, item.P[0]))
    index_of, times, numbers, ranges = zip(*kept, strict=True) if kept else ((), (), (), ())
    return (
        np.array(index_of, dtype=np.int64),
        np.array(times, dtype=np.float64),
        np.array(numbers, dtype=np.int64),
        np.array(ranges, dtype=np.float64),
    )


def _ephemerides(
    rtklib: Any, navigation: Any, systems: Mapping[str, float]
) -> tuple[dict[int, list[Any]], dict[str, NDArray]]:
    """Ephemerides of each satellite number by toe, and the list of all; of equal toe, the one sent last."""
    by_satellite: dict[int, dict[float, Any]] = {}
    for index in range(navigation.n):
        record = navigation.eph[index]
        if _name(rtklib, record.sat)[:1] not in systems:
            continue
        same = by_satellite.setdefault(record.sat, {})
        toe = _gps_seconds(record.toe)
        if toe not in same or _gps_seconds(record.ttr) >= _gps_seconds(same[toe].ttr):
            same[toe] = record
    ordered = {number: [same[toe] for toe in sorted(same)] for number, same in by_satellite.items()}
    every = [record for number in sorted(ordered) for record in ordered[number]]
    listed: dict[str, NDArray] = {
        "ephemeris_names": np.array([_name(rtklib, record.sat) for record in every], dtype="U3"),
        "ephemeris_toe_gps_s": np.array([_gps_seconds(record.toe) for record in every], dtype=np.float64),
        "semi_major_axis_m": np.array([record.A for record in every], dtype=np.float64),
        "inclination_rad": np.array([record.i0 for record in every], dtype=np.float64),
    }
    return ordered, listed


def _nearest(sorted_s: NDArray[np.float64], times_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the nearest of ``sorted_s`` to each time; of two equally near, the later one."""
    after = np.searchsorted(sorted_s, times_s).clip(0, sorted_s.size - 1)
    before = (after - 1).clip(0)
    return np.where(times_s - sorted_s[before] < sorted_s[after] - times_s, before, after)


def _state(rtklib: Any, record: Any, received: Any, pseudorange_m: float) -> tuple[list[float], float]:
    """Position [m] and clock [m] of a satellite when the signal left it that was received with that pseudorange.

    Receiver time minus pseudorange over c is what the satellite's clock showed, whatever the receiver clock was.
    """
    shown = rtklib.timeadd(received, -pseudorange_m / SPEED_OF_LIGHT_M_S)
    sent = rtklib.timeadd(shown, -rtklib.eph2clk(shown, record))
    position, clock_s, variance = rtklib.Arr1Ddouble(3), rtklib.Arr1Ddouble(1), rtklib.Arr1Ddouble(1)
    rtklib.eph2pos(sent, record, position, clock_s, variance)
    # The first group delay is TGD for GPS (IS-GPS-200, 20.3.3.3.3.2) and TGD1 for BeiDou (BDS-SIS-ICD-2.1,
    # 5.2.4.10): the broadcast clock less it is the clock of a single-frequency user of L1 C/A or B1I.
    clock_m = SPEED_OF_LIGHT_M_S * (clock_s[0] - record.tgd[0])
    return [position[0], position[1], position[2]], clock_m


def _gps_seconds(time: Any) -> float:
    return (time.time - _GPS_EPOCH_S) + time.sec


def _name(rtklib: Any, number: int) -> str:
    text = rtklib.Arr1Dchar(8)
    rtklib.satno2id(number, text)
    return str(text.ptr)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
