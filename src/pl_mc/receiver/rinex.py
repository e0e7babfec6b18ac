"""RINEX observation and navigation files as plain arrays: pseudoranges, satellite positions, satellite clocks."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import SPEED_OF_LIGHT_M_S
from pl_mc.geometry.gps_time import GPS_EPOCH
from pl_mc.geometry.orbits import ORBIT_RADIUS_M, bds_orbit
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError, require_choice, require_within
from pl_mc.receiver.choices import checked_signals, checked_systems, delays_needed
from pl_mc.receiver.ephemerides import Ephemeris
from pl_mc.receiver.navigation_records import Navigation, read_navigation
from pl_mc.receiver.observation_records import Observations, read_observations
from pl_mc.receiver.receiver_data import ReceiverData, joined
from pl_mc.receiver.rinex_text import read_rinex_text
from pl_mc.receiver.signals import SYSTEMS, USUAL_SYSTEMS, Observable, signals_of

# Where the ionosphere's delay is taken from: the coefficients of the navigation files, nowhere, or a second carrier.
# ``maps`` leaves it to the caller.
IONOSPHERES = ("broadcast", "none", "dual", "maps")

# Systems whose coefficients of the ionosphere are used, in the order of preference.
_IONOSPHERE_ORDER = ("G", "C")

# What became of each pseudorange.
_ABSENT, _USABLE, _NO_EPHEMERIS, _UNHEALTHY, _UNPREDICTED = range(5)


def read_rinex(
    observation_path: str | Path | Sequence[str | Path],
    navigation_path: str | Path | Sequence[str | Path],
    *,
    systems: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    ionosphere: str = "broadcast",
    snr_dbhz: float | None = None,
) -> ReceiverData:
    """Read one or several observation files and one or several navigation files.

    They may be plain, ``.gz``, ``.bz2``, ``.xz``, ``.zip`` or ``.Z``, and Hatanaka-compressed. Versions 2 (GPS
    alone), 3 and 4 are read; the files may be of different ones. A line or a record that cannot be read, or says
    what no satellite sends, costs itself and a note.

    Of the ephemerides of a satellite the one with the nearest reference time toe counts, within 2 h; of Galileo, whose
    toe is past when they are sent, the last one, within 4 h. They are of the message that belongs to the signal: of
    Galileo I/NAV to E1, E5b and both, F/NAV to E5a and to E1 with E5a. Group delays are those of the signal, or of the
    two; a signal whose delays the files do not have is not read. GPS time is BeiDou time plus 14 s.

    Args:
        observation_path: the observation file, or a sequence of them, such as those of several days.
        navigation_path: the navigation file, or a sequence of them, whose messages are put together.
        systems: RINEX letters; G (GPS), C (BeiDou), E (Galileo), R (GLONASS) and J (QZSS) are read. Those of the
            first three that the files have unless given.
        signals: a signal for some of the systems, such as L5 or E5a, or two, such as E1+E5b, by the rows of
            `pl_mc.receiver.signals`. L1 C/A, B1I and E1 unless given; of two the first pair that the files have of
            L1 P(Y) or C/A and L2 P(Y), L2C or L5, B1I and B3I or B2I, E1 and E5a or E5b.
        ionosphere: ``broadcast``: the coefficients of GPS, or where no file has them those of BeiDou; ``none``:
            no coefficients, the delay stays in; ``dual``: pseudoranges of two carriers are combined so that it
            cancels, (f1^2 P1 - f2^2 P2) / (f1^2 - f2^2); ``maps``: as none, for a caller who has maps.
        snr_dbhz: least strength of a signal whose pseudorange is read [dB-Hz]; any unless given.

    Raises:
        InputError: a file that is missing, of another kind or version, or of another day; a system that is not
            read or not there; no coefficients; observation files of the same time, or with other signals than the
            first. One sentence, which names the file and what can be done.
    """
    require_choice(ionosphere, IONOSPHERES, field="ionosphere")
    if snr_dbhz is not None:
        require_within(snr_dbhz, field="snr_dbhz", low=0.0, high=100.0)
    files = _checked_paths(observation_path, "observation")
    parts = [
        _read_one(path, navigation_path, systems, signals, ionosphere=ionosphere, snr_dbhz=snr_dbhz) for path in files
    ]
    return joined(parts, files)


def _read_one(
    observation_path: str | Path,
    navigation_path: str | Path | Sequence[str | Path],
    systems: Sequence[str] | None,
    signals: Sequence[str] | None,
    *,
    ionosphere: str,
    snr_dbhz: float | None,
) -> ReceiverData:
    letters = USUAL_SYSTEMS if systems is None else checked_systems(systems)
    asked = checked_signals(signals, letters, dual=ionosphere == "dual")
    paths = _checked_paths(navigation_path, "navigation")
    file = read_rinex_text(observation_path, "observation")
    told = {letter: {message for one in asked[letter] for message in one.messages[:1]} for letter in letters}
    navigation = read_navigation(paths, letters, told)
    able = {letter: [one for one in asked[letter] if navigation.message_for(one)] for letter in letters}
    for every in able.values():
        every.sort(key=lambda one: one.neglected_m(navigation.message_for(one)))
    candidates = {letter: able[letter] or asked[letter] for letter in letters}
    observations = read_observations(file, candidates, snr_dbhz=snr_dbhz)
    used, notes = _used_systems(observations, navigation, paths, asked, asked=systems is not None)
    columns = np.array([k for k, name in enumerate(observations.names) if name[0] in used])
    rows = np.isfinite(observations.pseudorange_m[:, columns]).any(axis=1)
    names = tuple(observations.names[k] for k in columns)
    pseudorange_m = observations.pseudorange_m[rows][:, columns]
    time_gps_s = observations.time_gps_s[rows]
    state, position_m, clock_m = _states(time_gps_s, names, pseudorange_m, navigation, observations.observables)
    _require_same_time(observations, navigation, paths, time_gps_s, state, used)
    radius_m = np.linalg.norm(position_m, axis=-1)
    placed = (radius_m > ORBIT_RADIUS_M[0]) & (radius_m < ORBIT_RADIUS_M[1]) & np.isfinite(clock_m)
    model, coefficients = _ionosphere(navigation, paths, ionosphere, used, notes)
    return ReceiverData(
        time_gps_s=time_gps_s,
        names=names,
        systems=tuple(name[0] for name in names),
        orbits=tuple(_orbit(navigation.ephemerides.get(name, ())) for name in names),
        observables={letter: observations.observables[letter] for letter in used},
        pseudorange_m=pseudorange_m,
        satellite_position_m=np.where(placed[..., None], position_m, np.nan),
        satellite_clock_m=np.where(placed, clock_m, np.nan),
        one_carrier=observations.one_carrier[rows][:, columns],
        unhealthy=state == _UNHEALTHY,
        unpredicted=state == _UNPREDICTED,
        no_ephemeris=(state == _NO_EPHEMERIS) | ((state == _USABLE) & ~placed),
        klobuchar_alpha=coefficients[:4],
        klobuchar_beta=coefficients[4:],
        ionosphere=model,
        header_position_m=observations.header_position_m,
        epochs_in_file=observations.epochs_in_file,
        events=observations.events,
        notes=(*observations.notes, *navigation.notes, *notes),
    )


def gps_date(time_gps_s: float) -> str:
    """Calendar day of a GPS time, ``2020-06-25``."""
    return f"{_date(time_gps_s):%Y-%m-%d}"


def gps_clock(time_gps_s: float) -> str:
    """Day and time of a GPS time, ``2020-06-25 12:00:30``."""
    return f"{_date(time_gps_s):%Y-%m-%d %H:%M:%S}"


def _date(time_gps_s: float) -> datetime:
    return GPS_EPOCH + timedelta(seconds=float(time_gps_s))


def _checked_paths(given: str | Path | Sequence[str | Path], kind: str) -> tuple[str | Path, ...]:
    paths = (given,) if isinstance(given, str | os.PathLike) or not isinstance(given, Sequence) else tuple(given)
    if not paths:
        raise InputError(f"{kind}: {'an' if kind[0] == 'o' else 'a'} {kind} file is needed, and none is given.")
    return paths


def _named(paths: Sequence[str | Path]) -> str:
    return " and ".join(map(str, paths))


def _used_systems(
    observations: Observations,
    navigation: Navigation,
    paths: Sequence[str | Path],
    candidates: Mapping[str, Sequence[Observable]],
    *,
    asked: bool,
) -> tuple[tuple[str, ...], list[str]]:
    """The systems that both files have, and notes about those that are not there; a refusal where one was asked for."""
    used: list[str] = []
    missing: list[tuple[Sequence[str | Path], str]] = []
    unobserved: list[str] = []
    observed = {name[0] for name in observations.names}
    sent = {name[0] for name in navigation.ephemerides}
    for letter, every in candidates.items():
        name, listed = SYSTEM_NAMES[letter], observations.found.get(letter, ())
        able = [one for one in every if navigation.message_for(one)]
        # What is observed and cannot be corrected.
        unable = [
            one for one in every if one not in able and all(set(signal.codes) & set(listed) for signal in one.signals)
        ]
        if not listed:
            unobserved.append(f"no {name} ({letter})")
        elif letter not in sent and (letter in observed or unable):
            found = ", ".join(_system_name(key) for key in sorted(navigation.systems - {letter})) or "none"
            missing.append((paths, f"it has no ephemeris of {name} that can be used; its systems: {found}"))
        elif unable and (letter not in observed or not able):
            names = " or ".join(one.name for one in unable)
            missing.append((paths, f"it has no group delay of {name} {names} ({delays_needed(unable)})"))
        elif letter not in observed:
            names = " or ".join(one.name for one in able or every)
            why = f"it holds no pseudorange of {name} {names}; it has {', '.join(listed)}"
            missing.append(([observations.path], why))
        else:
            used.append(letter)
    # What a receiver does not observe is worth a word where little is left.
    if unobserved and (asked or len(used) < 2):
        found = ", ".join(f"{key} ({_system_name(key)})" for key in observations.systems) or "none"
        missing.append(([observations.path], f"it has {' and '.join(unobserved)}; its systems are {found}"))
    if missing and (asked or not used):
        ways = f"; choose the systems {','.join(used)}" if used else ""
        told = (*observations.notes, *navigation.notes)
        because = f" {told[0]}" if told and not used else ""
        raise InputError(f"{_named(missing[0][0])}: {missing[0][1]}{ways}.{because}")
    alone = " and ".join(SYSTEM_NAMES[letter] for letter in used)
    verb = "alone is" if len(used) == 1 else "alone are"
    notes = [
        f"{alone} {verb} used: {_named(list(map(os.path.basename, files)))} {why.removeprefix('it ')}."
        for files, why in missing
    ]
    for letter in used:
        observable = observations.observables[letter]
        message = navigation.message_for(observable)
        left_m = observable.neglected_m(message)
        if left_m > 0 and (letter != "G" or len(observable.signals) > 1 or observable.signals[0] != signals_of("G")[0]):
            between = ", and none between the receiver's channels is known" if letter == "R" else ""
            said = f"{message} does not send all of its group delays{between}"
            notes.append(
                f"{SYSTEM_NAMES[letter]} {observable.name}: {said}; up to {left_m:.1f} m a satellite stays in."
            )
    return tuple(used), notes


def _system_name(letter: str) -> str:
    return SYSTEM_NAMES.get(letter) or {"S": "SBAS", "I": "NavIC"}.get(letter, "unknown")


def _states(
    time_gps_s: NDArray[np.float64],
    names: Sequence[str],
    pseudorange_m: NDArray[np.float64],
    navigation: Navigation,
    observables: Mapping[str, Observable],
) -> tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """What became of each pseudorange (e, m), and positions (e, m, 3) and clocks (e, m) when the signals left [m]."""
    state = np.full(pseudorange_m.shape, _ABSENT, dtype=np.int8)
    position_m = np.full((*pseudorange_m.shape, 3), np.nan)
    clock_m = np.full(pseudorange_m.shape, np.nan)
    chosen = {letter: (one, navigation.message_for(one)) for letter, one in observables.items()}
    for column, name in enumerate(names):
        rows = np.flatnonzero(np.isfinite(pseudorange_m[:, column]))
        state[rows, column] = _NO_EPHEMERIS
        observable, message = chosen[name[0]]
        delays = observable.group_delays(message)
        ephemerides = [one for one in navigation.of(name, message) if delays.keys() <= one.group_delays_s.keys()]
        unhealthy = _unhealthy(time_gps_s[rows], name, navigation, observable)
        for row, one, ill in zip(rows, _in_force(ephemerides, time_gps_s[rows]), unhealthy, strict=True):
            if one is None:
                continue
            if ill or not one.predicted:
                state[row, column] = _UNHEALTHY if ill else _UNPREDICTED
                continue
            state[row, column] = _USABLE
            flight_s = float(pseudorange_m[row, column]) / SPEED_OF_LIGHT_M_S
            delay_s = sum(part * one.group_delays_s[delay] for delay, part in delays.items())
            position_m[row, column], clock_m[row, column] = _state(one, float(time_gps_s[row]), flight_s, delay_s)
    return state, position_m, clock_m


def _in_force(ephemerides: Sequence[Ephemeris], times_s: NDArray[np.float64]) -> list[Ephemeris | None]:
    """At each time the ephemeris with the nearest reference time or the last one, where it is within the window."""
    if not ephemerides:
        return [None] * times_s.size
    system = SYSTEMS[ephemerides[0].name[0]]
    toe_s = np.array([one.toe_gps_s for one in ephemerides])
    # Before the first one of all that one counts.
    place = _nearest(toe_s, times_s) if system.sent_ahead else (np.searchsorted(toe_s, times_s) - 1).clip(0)
    inside = np.abs(toe_s[place] - times_s) <= system.ephemeris_window_s
    return [ephemerides[k] if near else None for k, near in zip(place.tolist(), inside.tolist(), strict=True)]


def _unhealthy(
    times_s: NDArray[np.float64], name: str, navigation: Navigation, observable: Observable
) -> NDArray[np.bool_]:
    """Whether any message in force forbids the use of one of the signals of a satellite."""
    ill = np.zeros(times_s.size, dtype=bool)
    for message, bits in observable.health.items():
        in_force = _in_force(navigation.of(name, message), times_s)
        ill |= np.array([one is not None and one.health & bits != 0 for one in in_force], dtype=bool)
    return ill


def _nearest(sorted_s: NDArray[np.float64], times_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the nearest of ``sorted_s`` to each time; of two equally near, the later one."""
    after = np.searchsorted(sorted_s, times_s).clip(0, sorted_s.size - 1)
    before = (after - 1).clip(0)
    return np.where(times_s - sorted_s[before] < sorted_s[after] - times_s, before, after)


def _state(
    one: Ephemeris, received_s: float, flight_s: float, delay_s: float
) -> tuple[tuple[float, float, float], float]:
    """Position [m] and clock [m] of a satellite when the signal left it that was received with that pseudorange.

    Receiver time minus pseudorange over c is what the satellite's clock showed, whatever the receiver clock was.
    """
    evaluate = one.record.evaluate
    shown_s = received_s - one.week_gps_s - flight_s
    found = evaluate(shown_s - evaluate(shown_s).clock_polynomial_s)
    clock_s = found.clock_polynomial_s + found.relativistic_clock_s - delay_s
    return (found.x_m, found.y_m, found.z_m), SPEED_OF_LIGHT_M_S * clock_s


def _require_same_time(
    observations: Observations,
    navigation: Navigation,
    paths: Sequence[str | Path],
    time_gps_s: NDArray[np.float64],
    state: NDArray[np.int8],
    used: Sequence[str],
) -> None:
    """Raise `InputError` if no pseudorange has an ephemeris within the window."""
    if (state > _NO_EPHEMERIS).any() or (state == _USABLE).any():
        return
    toe = np.array([one.toe_gps_s for every in navigation.ephemerides.values() for one in every if one.name[0] in used])
    same_day = gps_date(time_gps_s.min()) == gps_date(toe.min()) or gps_date(time_gps_s.max()) == gps_date(toe.max())
    form = gps_clock if same_day else gps_date
    raise InputError(
        f"{observations.path} and {_named(paths)}: the observations are of {_span(time_gps_s, form)}, but the "
        f"ephemerides are of {_span(toe, form)}; a navigation file of that time is needed."
    )


def _span(times_gps_s: NDArray[np.float64], form: Callable[[float], str]) -> str:
    first, last = form(times_gps_s.min()), form(times_gps_s.max())
    return first if first == last else f"{first} to {last}"


def _ionosphere(
    navigation: Navigation, paths: Sequence[str | Path], asked: str, used: Sequence[str], notes: list[str]
) -> tuple[str, NDArray[np.float64]]:
    """Whose model of the ionosphere is used, and its coefficients (8,); GPS first, and any other than zeros."""
    if asked != "broadcast":
        if asked == "none":
            notes.append("The ionosphere's delay is left in (ionosphere none).")
        return "", np.zeros(8)
    there = navigation.klobuchar
    model = next((letter for letter in _IONOSPHERE_ORDER if letter in there and there[letter].any()), None)
    if model is None and there:
        model = next(iter(there))
        notes.append(
            f"The ionosphere coefficients of {SYSTEM_NAMES[model]} are all zero: its model gives 5 ns overhead, day "
            "and night."
        )
    if model is None:
        raise InputError(
            f"{_named(paths)}: no ionosphere coefficients of GPS or BeiDou (GPSA and GPSB, BDSA and BDSB, ION ALPHA "
            "and ION BETA in the header, > ION records of RINEX 4); give a further navigation file that has them, or "
            "choose the ionosphere none (--ionosphere none), which leaves its delay in."
        )
    if model == "C" and used != ("C",):
        notes.append("The ionosphere is corrected with the coefficients of BeiDou; there are none of GPS.")
    return model, there[model]


def _orbit(ephemerides: Sequence[Ephemeris]) -> str:
    """Class of orbit of a satellite, from its broadcast semi-major axes and inclinations."""
    if not ephemerides:
        return ""
    if ephemerides[0].name[0] != "C":
        return {"E": "GAL", "R": "GLO"}.get(ephemerides[0].name[0], "GPS")
    elements = [one.record.elements for one in ephemerides]
    root_axis = float(np.median([one.sqrt_a for one in elements]))
    return bds_orbit(root_axis**2, float(np.median([one.i0 for one in elements])))
