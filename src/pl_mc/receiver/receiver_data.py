"""What was read of a receiver, and how files of several days become one record."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.input_errors import InputError
from pl_mc.receiver.observation_records import Event
from pl_mc.receiver.signals import Observable


@dataclass(frozen=True)
class ReceiverData:
    """What a receiver measured, and where the satellites were; e epochs, m satellites.

    Attributes:
        time_gps_s: (e,), epochs by the receiver's clock [s since 1980-01-06, GPS time].
        names: m satellites by RINEX name, GPS first.
        systems: m RINEX letters.
        orbits: m classes of orbit: GPS (QZSS too), GAL, GLO, BDS-MEO, BDS-IGSO, BDS-GEO; or empty.
        observables: of each system letter, which signal its pseudoranges are of, or which two are combined.
        pseudorange_m: (e, m), of that signal, or of both without ionosphere [m]; NaN where missing.
        satellite_position_m: (e, m, 3), Earth-fixed at transmission time [m]; NaN without usable ephemeris.
        satellite_clock_m: (e, m), satellite clock with relativity and the group delay of the signals, as a length:
            add it to a pseudorange to remove it [m]; NaN without usable ephemeris.
        one_carrier: (e, m), observed on one of two carriers alone.
        unhealthy: (e, m), observed while a message in force says that one of the signals is unhealthy.
        unpredicted: (e, m), observed while the ephemeris in force predicts no accuracy (URA index 15, SISA NAPA).
        no_ephemeris: (e, m), observed without an ephemeris within the window, or with a damaged one.
        klobuchar_alpha, klobuchar_beta: (4,), coefficients of the ionosphere model; zeros where there is none.
        ionosphere: whose model that is, G (GPS) or C (BeiDou); empty where the delay is to be left in.
        header_position_m: (3,), approximate position of the header [m], never the truth; NaN where absent.
        epochs_in_file: number of epochs of the file; more than e where some hold no pseudorange of the systems.
        events: of the file, as far as they move or change the antenna or the site.
        notes: sentences about what was left out of the files, or read in another way than usual.
    """

    time_gps_s: NDArray[np.float64]
    names: tuple[str, ...]
    systems: tuple[str, ...]
    orbits: tuple[str, ...]
    observables: Mapping[str, Observable]
    pseudorange_m: NDArray[np.float64]
    satellite_position_m: NDArray[np.float64]
    satellite_clock_m: NDArray[np.float64]
    one_carrier: NDArray[np.bool_]
    unhealthy: NDArray[np.bool_]
    unpredicted: NDArray[np.bool_]
    no_ephemeris: NDArray[np.bool_]
    klobuchar_alpha: NDArray[np.float64]
    klobuchar_beta: NDArray[np.float64]
    ionosphere: str
    header_position_m: NDArray[np.float64]
    epochs_in_file: int
    events: tuple[Event, ...]
    notes: tuple[str, ...]


# Fields with a row for each epoch and a column for each satellite, and what stands where a satellite is in no file.
_BY_SATELLITE = {
    "pseudorange_m": np.nan, "satellite_position_m": np.nan, "satellite_clock_m": np.nan, "one_carrier": False,
    "unhealthy": False, "unpredicted": False, "no_ephemeris": False,
}  # fmt: skip


def joined(parts: Sequence[ReceiverData], files: Sequence[str | Path]) -> ReceiverData:
    """Records of several files one after the other in time.

    Raises:
        InputError: two that have the same time, or other systems or signals than the first.
    """
    first = parts[0]
    if len(parts) == 1:
        return first
    order = sorted(range(len(parts)), key=lambda k: float(parts[k].time_gps_s[0]))
    for k in range(1, len(parts)):
        said, other = _signals(first), _signals(parts[k])
        if said != other:
            raise InputError(
                f"{files[k]}: it is read of {other}, and {files[0]} of {said}; choose systems and signals that all "
                "files have (--systems, --signals)."
            )
    for before, after in itertools.pairwise(order):
        if parts[after].time_gps_s[0] <= parts[before].time_gps_s[-1]:
            raise InputError(f"{files[after]}: it begins before {files[before]} ends; each time is to be in one file.")
    letters = list(dict.fromkeys(first.systems))
    orbit_of = {name: orbit for part in parts for name, orbit in zip(part.names, part.orbits, strict=True)}
    names = tuple(sorted(orbit_of, key=lambda name: (letters.index(name[0]), name)))
    column = {name: k for k, name in enumerate(names)}
    by_satellite: dict[str, Any] = {}
    for field, nothing in _BY_SATELLITE.items():
        rows = []
        for k in order:
            values = getattr(parts[k], field)
            whole = np.full((values.shape[0], len(names), *values.shape[2:]), nothing, dtype=values.dtype)
            whole[:, [column[name] for name in parts[k].names]] = values
            rows.append(whole)
        by_satellite[field] = np.concatenate(rows)
    notes = [note for k in order for note in parts[k].notes]
    return replace(
        parts[order[0]],
        time_gps_s=np.concatenate([parts[k].time_gps_s for k in order]),
        names=names, systems=tuple(name[0] for name in names), orbits=tuple(orbit_of[name] for name in names),
        epochs_in_file=sum(part.epochs_in_file for part in parts),
        events=tuple(event for k in order for event in parts[k].events),
        notes=tuple(dict.fromkeys(notes)), **by_satellite,
    )  # fmt: skip


def _signals(data: ReceiverData) -> str:
    return ", ".join(f"{letter} {one.name}" for letter, one in sorted(data.observables.items()))
