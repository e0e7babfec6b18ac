"""RINEX observation and navigation files as plain arrays: pseudoranges, satellite positions, satellite clocks.

RINEX 2.11, 3 and 4 are checked in Python and brought to one form (`pl_mc.receiver.observation_records`,
`pl_mc.receiver.navigation_records`), which RTKLIB evaluates in a process of its own with a time limit
(`pl_mc.receiver.rtklib_worker`), so that no file can crash or stall the analysis.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.input_errors import InputError
from pl_mc.receiver import rtklib_worker as worker
from pl_mc.receiver.navigation_records import checked_navigation
from pl_mc.receiver.observation_records import checked_observations
from pl_mc.receiver.rinex_text import header_position_m, read_rinex_text, require_systems
from pl_mc.receiver.signals import SIGNALS, signal_of
from pl_mc.receiver.signals import SYSTEMS as KNOWN_SYSTEMS
from pl_mc.runtime.rtklib_child import run_rtklib_child

SYSTEMS = tuple(dict.fromkeys(signal.system for signal in SIGNALS))

# A navigation satellite is between 1.9e7 m (medium orbit) and 4.5e7 m (synchronous) from the Earth's centre;
# an ephemeris that says otherwise is damaged.
_ORBIT_RADIUS_M = (1.9e7, 4.5e7)

# BeiDou: synchronous orbits have a semi-major axis of 42,164 km, medium ones 27,906 km; geostationary ones are
# inclined by under 10 degrees, the inclined ones by 55 (BDS-SIS-ICD-2.1, section 3.1).
_SYNCHRONOUS_AXIS_M = 3.5e7
_GEO_INCLINATION_RAD = np.radians(20.0)

# Where each version has the ionosphere coefficients.
_IONOSPHERE = {
    2: "ION ALPHA and ION BETA in its header",
    3: "IONOSPHERIC CORR, GPSA and GPSB, in its header",
    4: "a record > ION G.. LNAV",
}

# Time that reading may take: some seconds for the start, and many times the usual speed for the rest.
_START_LIMIT_S, _LIMIT_S_PER_MEGABYTE = 30.0, 5.0


@dataclass(frozen=True)
class ReceiverData:
    """What a receiver measured, and where the satellites were; e epochs, m satellites.

    Attributes:
        time_gps_s: (e,), epochs by the receiver's clock [s since 1980-01-06, GPS time].
        names: m satellites by RINEX name, GPS first.
        systems: m RINEX letters.
        orbits: m classes of orbit: GPS, BDS-MEO, BDS-IGSO, BDS-GEO; empty where the file has no ephemeris.
        pseudorange_m: (e, m), of the signals of `pl_mc.receiver.signals` [m]; NaN where missing.
        satellite_position_m: (e, m, 3), Earth-fixed at transmission time [m]; NaN without usable ephemeris.
        satellite_clock_m: (e, m), satellite clock with relativity and the group delay of the signal, as a length:
            add it to a pseudorange to remove it [m]; NaN without usable ephemeris.
        unhealthy: (e, m), observed while the ephemeris in force says unhealthy.
        no_ephemeris: (e, m), observed without an ephemeris within the window, or with a damaged one.
        klobuchar_alpha, klobuchar_beta: (4,), coefficients of the GPS ionosphere model.
        header_position_m: (3,), approximate position of the header [m], never the truth; NaN where absent.
        epochs_in_file: number of epochs of the file; more than e where some hold no pseudorange of the systems.
    """

    time_gps_s: NDArray[np.float64]
    names: tuple[str, ...]
    systems: tuple[str, ...]
    orbits: tuple[str, ...]
    pseudorange_m: NDArray[np.float64]
    satellite_position_m: NDArray[np.float64]
    satellite_clock_m: NDArray[np.float64]
    unhealthy: NDArray[np.bool_]
    no_ephemeris: NDArray[np.bool_]
    klobuchar_alpha: NDArray[np.float64]
    klobuchar_beta: NDArray[np.float64]
    header_position_m: NDArray[np.float64]
    epochs_in_file: int


def read_rinex(
    observation_path: str | Path, navigation_path: str | Path, *, systems: Sequence[str] = SYSTEMS
) -> ReceiverData:
    """Read a pair of RINEX files; plain, ``.gz``, and the observations also Hatanaka-compressed.

    Versions 2.10 and 2.11 (GPS alone), 3 and 4 are read; the two files may be of different ones.

    Of the ephemerides of a satellite the one with the nearest reference time toe counts, within 2 h (GPS and
    BeiDou alike). GPS time is BeiDou time plus 14 s.

    Args:
        observation_path, navigation_path: the files.
        systems: RINEX letters; G (GPS, code C1C; in RINEX 2 C1, or P1 where a file has no C1) and C (BeiDou, code
            C2I or C1I) are read.

    Raises:
        InputError: a file that is missing, cut short, damaged, of another kind or version, or of another day; a
            system that is not read or not there. One sentence, which names the file.
    """
    letters = _checked_systems(systems)
    observations = read_rinex_text(observation_path, "observation")
    navigation = read_rinex_text(navigation_path, "navigation")
    require_systems(observations, letters)
    observation_text, epochs = checked_observations(observations, letters)
    arrays = _evaluate(
        observations.path, observation_text, navigation.path, checked_navigation(navigation, letters), letters
    )
    pair = f"{observations.path} and {navigation.path}"
    names = tuple(arrays["names"].tolist())
    for letter in letters:
        if not any(name.startswith(letter) for name in names):
            raise InputError(f"{observations.path}: it holds no pseudorange of {SYSTEM_NAMES[letter]}.")
    _require_same_days(pair, arrays)
    if not (arrays["alpha"].any() and arrays["beta"].any()):
        raise InputError(
            f"{navigation.path}: it lacks the GPS ionosphere coefficients ({_IONOSPHERE[navigation.generation]})."
        )
    radius_m = np.linalg.norm(arrays["position_m"], axis=-1)
    placed = (radius_m > _ORBIT_RADIUS_M[0]) & (radius_m < _ORBIT_RADIUS_M[1]) & np.isfinite(arrays["clock_m"])
    observed = arrays["state"] != worker.ABSENT
    unhealthy = arrays["state"] == worker.UNHEALTHY
    return ReceiverData(
        time_gps_s=arrays["time_gps_s"],
        names=names,
        systems=tuple(name[0] for name in names),
        orbits=tuple(_orbit(name, arrays) for name in names),
        pseudorange_m=arrays["pseudorange_m"],
        satellite_position_m=np.where(placed[..., None], arrays["position_m"], np.nan),
        satellite_clock_m=np.where(placed, _clock_of_signals(names, arrays), np.nan),
        unhealthy=unhealthy,
        no_ephemeris=observed & ~unhealthy & ~placed,
        klobuchar_alpha=arrays["alpha"],
        klobuchar_beta=arrays["beta"],
        header_position_m=header_position_m(observations),
        epochs_in_file=epochs,
    )


def gps_date(time_gps_s: float) -> str:
    """Calendar day of a GPS time, ``2020-06-25``."""
    return f"{datetime(1980, 1, 6, tzinfo=UTC) + timedelta(seconds=float(time_gps_s)):%Y-%m-%d}"


def _checked_systems(systems: Sequence[str]) -> tuple[str, ...]:
    letters = tuple(systems)
    for letter in letters:
        if letter not in SYSTEMS:
            raise InputError(f"systems: {letter!r} is not read from receiver files; G (GPS) and C (BeiDou) are.")
    if not letters or len(set(letters)) != len(letters):
        raise InputError(
            f"systems: each of G and C once, or one of them, is needed, not {', '.join(letters) or 'none'}."
        )
    return letters


def _evaluate(
    observation_path: Path, observations: str, navigation_path: Path, navigation: str, systems: Sequence[str]
) -> dict[str, NDArray]:
    """The arrays of `rtklib_worker.evaluate`, computed in a process of its own."""
    pair = f"{observation_path} and {navigation_path}"
    limit_s = _START_LIMIT_S + _LIMIT_S_PER_MEGABYTE * (len(observations) + len(navigation)) / 1e6
    with tempfile.TemporaryDirectory(prefix="pl_mc_") as folder:
        paths = [Path(folder, name) for name in ("observations.rnx", "navigation.rnx", "result.npz")]
        for path, text in zip(paths, (observations, navigation), strict=False):
            path.write_text(text, encoding="latin-1", newline="\n")
        run_rtklib_child(
            worker.__file__,
            [*map(str, paths), *(f"{letter}{KNOWN_SYSTEMS[letter].ephemeris_window_s:g}" for letter in systems)],
            limit_s=limit_s,
            exit_no_library=worker.EXIT_NO_LIBRARY,
            owner="receiver files",
            given_up=lambda limit: f"{pair}: reading them was given up after {limit}; is one damaged?",
            failed=lambda reason: f"{pair}: RTKLIB cannot evaluate them ({reason}); is one damaged?",
        )
        with np.load(paths[2]) as result:
            return dict(result)


def _require_same_days(pair: str, arrays: dict[str, NDArray]) -> None:
    """Raise `InputError` if no pseudorange has an ephemeris within the window."""
    toe = arrays["ephemeris_toe_gps_s"]
    if np.isin(arrays["state"], (worker.USABLE, worker.UNHEALTHY)).any():
        return
    if toe.size == 0:
        raise InputError(f"{pair}: the navigation file holds no ephemeris that can be used.")
    observed = _span(arrays["time_gps_s"])
    raise InputError(f"{pair}: the observations are of {observed}, but the ephemerides are of {_span(toe)}.")


def _span(times_gps_s: NDArray[np.float64]) -> str:
    first, last = gps_date(times_gps_s.min()), gps_date(times_gps_s.max())
    return first if first == last else f"{first} to {last}"


def _clock_of_signals(names: Sequence[str], arrays: dict[str, NDArray]) -> NDArray[np.float64]:
    """(e, m) clocks as users of the signals have them; the library takes the first group delay from all."""
    clock_m = arrays["clock_m"]
    for column, name in enumerate(names):
        first, second = signal_of(name[0]).group_delays
        if (first, second) != (1.0, 0.0):
            delays_m = arrays["group_delays_m"][:, column]
            clock_m[:, column] += (1.0 - first) * delays_m[:, 0] - second * delays_m[:, 1]
    return clock_m


def _orbit(name: str, arrays: dict[str, NDArray]) -> str:
    """Class of orbit of a satellite, from its broadcast semi-major axis and inclination."""
    mine = np.flatnonzero(arrays["ephemeris_names"] == name)
    if mine.size == 0:
        return ""
    if name.startswith("G"):
        return "GPS"
    if np.median(arrays["semi_major_axis_m"][mine]) < _SYNCHRONOUS_AXIS_M:
        return "BDS-MEO"
    return "BDS-GEO" if np.median(arrays["inclination_rad"][mine]) < _GEO_INCLINATION_RAD else "BDS-IGSO"
