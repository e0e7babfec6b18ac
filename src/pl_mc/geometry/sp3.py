"""Precise orbits: satellite positions of SP3 files, interpolated to the epochs of a simulation.

`pl_mc.geometry.sp3_reader` reads the file. Here its positions are held against the orbits that they lie on, and a
polynomial of degree ten is put through the eleven around each epoch, in axes that do not turn with the Earth.

Positions are those of the centres of mass in the Earth-fixed axes of the file at the time asked for. As with
nominal orbits, antenna offsets (under 3 m), travel time and the rotation of the Earth during it are left out; the
last two turn a line of sight by the satellite's speed over that of light, 1.4e-5 rad.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import EARTH_GM_M3_S2, EARTH_ROTATION_RAD_S, MOST_SATELLITES
from pl_mc.geometry.orbits import bds_orbit
from pl_mc.geometry.sp3_reader import NODES, Sp3Table, iso_date, read_sp3
from pl_mc.input_errors import InputError, nearest, shown

# System letter and numbers of each constellation. BeiDou-2 and BeiDou-3 share the letter; the numbers to C18 belong
# to the second generation, those from C19 on to the third.
NUMBERS = {
    "GPS": ("G", 1, MOST_SATELLITES["G"]),
    "GAL": ("E", 1, MOST_SATELLITES["E"]),
    "BDS-2": ("C", 1, 18),
    "BDS-3": ("C", 19, MOST_SATELLITES["C"]),
}

# Oblateness: J2 and the radius that belongs to it (WGS 84).
_J2, _RADIUS_M = 1.0826e-3, 6_378_137.0

# What pulls besides, in a synchronous orbit: the Moon by up to 2 GM r / d^3 = 7.3e-6 m/s^2, the Sun by 3.3e-6; what
# else the Earth's field has 6e-7, sunlight 1e-7.
_OTHER_PULLS_M_S2 = 1.5e-5

# Four times the rounding of a file, half a millimetre in each coordinate, and what its author's orbit is off.
_ROUNDING_M = 0.05

# A satellite with more positions that lie on no orbit than these is left out as a whole.
_MOST_OFF = 5


@dataclass(frozen=True)
class PreciseOrbits:
    """Positions of m satellites at e epochs.

    Attributes:
        names: m satellites, constellation by constellation as they were asked for.
        orbits: m classes of orbit, as error models know them: GPS, GAL, BDS-MEO, BDS-IGSO, BDS-GEO.
        position_m: (e, m, 3), Earth-fixed [m]; NaN where the file leaves one of the eleven positions around the
            epoch out.
        notes: sentences about what was left out.
    """

    names: tuple[str, ...]
    orbits: tuple[str, ...]
    position_m: NDArray[np.float64]
    notes: tuple[str, ...] = ()


def sp3_orbits(
    path: str | Path, time_gps_s: ArrayLike, *, constellations: Sequence[str], without: Sequence[str] = ()
) -> PreciseOrbits:
    """The satellites of an SP3 file at given times.

    Args:
        path: an SP3 file, versions a to d, plain or packed (.gz, .Z and others), with at least eleven epochs, at most
            900 s apart, in any of the time systems of the format.
        time_gps_s: (e,), times from the first to the last epoch of the file, GPS seconds [s].
        constellations: names of `NUMBERS`.
        without: satellites of the file to leave out.

    A position that is missing (left out, 0, 0, 0 or 999999.999999), marked as one during a manoeuvre, or on no orbit
    with those beside it is not used, nor is any interpolated from it: the satellite has no position at those epochs,
    which `PreciseOrbits.notes` says. One that has none at all is left out.

    Raises:
        InputError: a file that is missing, of another kind or of other times; a constellation or satellite that is
            not in it.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"sp3: the path of an SP3 file is needed, not {shown(path)}.")
    table = read_sp3(Path(path), {NUMBERS[name][0] for name in constellations})
    times = np.asarray(time_gps_s, dtype=float)
    _require_inside(table, times)
    columns = [table.names.index(name) for name in _chosen(table, constellations, without)]
    names = [table.names[k] for k in columns]
    still = _turned(table.position_m[:, columns], table.time_gps_s - table.first_gps_s)
    notes = [*table.notes, *_without_outliers(table, names, still)]
    position_m = _turned(_interpolated(table, still, times), table.first_gps_s - times)
    orbits = [_class_of_orbit(name, still[:, k]) for k, name in enumerate(names)]
    kept = [k for k, orbit in enumerate(orbits) if orbit]
    if not kept:
        why = f" ({notes[0].rstrip('.')})" if notes else ""
        raise InputError(f"{table.path}: it holds no position of {', '.join(constellations)} that can be used{why}.")
    notes += _gaps(table, names, still, position_m, kept)
    return PreciseOrbits(
        names=tuple(names[k] for k in kept),
        orbits=tuple(orbits[k] for k in kept),
        position_m=position_m[:, kept],
        notes=tuple(notes),
    )


def _require_inside(table: Sp3Table, time_gps_s: NDArray[np.float64]) -> None:
    """Raise `InputError` where a time lies before the first or after the last epoch of the file."""
    begin, end = float(table.time_gps_s[0]), float(table.time_gps_s[-1])
    first, last = float(time_gps_s.min()), float(time_gps_s.max())
    # The digits of a float64 at 1.4e9 s are 2e-7 s.
    if first >= begin - 1e-6 and last <= end + 1e-6:
        return
    said = [iso_date(time_s) for time_s in (begin, end, first, last)]
    raise InputError(
        f"{table.path}: it covers {said[0]} to {said[1]} (GPS time), but the epochs asked for are {said[2]} to "
        f"{said[3]}; choose start, epochs and interval within it."
    )


def _chosen(table: Sp3Table, constellations: Sequence[str], without: Sequence[str]) -> list[str]:
    """Satellites of the constellations, in order, less those switched off."""
    names = []
    for constellation in constellations:
        letter, low, high = NUMBERS[constellation]
        mine = sorted(n for n in table.names if n[0] == letter and low <= int(n[1:]) <= high)
        if not mine:
            raise InputError(
                f"{table.path}: it holds no satellite of {constellation}, {letter}{low:02d} to {letter}{high:02d}; "
                "leave that out of the constellations."
            )
        names += mine
    for name in without:
        if name not in names:
            raise InputError(
                f"without: {name!r} is not among the {' and '.join(constellations)} of {table.path} "
                f"({nearest(str(name), names)})."
            )
    left = [name for name in names if name not in without]
    if not left:
        raise InputError("without: every satellite is switched off; at least one has to stay.")
    return left


def _turned(position_m: NDArray[np.float64], after_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (e, m, 3) turned by what the Earth turns in the times (e,)."""
    angle = EARTH_ROTATION_RAD_S * after_s[:, None]
    x, y, z = np.moveaxis(position_m, -1, 0)
    return np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z], axis=-1)


def _class_of_orbit(name: str, still: NDArray[np.float64]) -> str:
    """Class of orbit of a satellite, from its positions (n, 3) in axes that stand still; empty where it has none."""
    normal = np.cross(still[:-1], still[1:])
    normal = normal[np.isfinite(normal[:, 0])]
    if not len(normal):
        return ""
    if name[0] != "C":
        return {"G": "GPS", "E": "GAL"}[name[0]]
    inclination = np.arccos(np.clip(np.median(normal[:, 2] / np.linalg.norm(normal, axis=-1)), -1.0, 1.0))
    return bds_orbit(float(np.nanmedian(np.linalg.norm(still, axis=-1))), float(inclination))


def _without_outliers(table: Sp3Table, names: Sequence[str], still: NDArray[np.float64]) -> list[str]:
    """Make positions (n, m, 3) that lie on no orbit with those beside them missing; a note for each satellite."""
    found: dict[int, list[tuple[int, float]]] = {}
    for _ in range(_MOST_OFF + 1):
        off, limit = _off_orbit_m(table, still)
        worst = off.argmax(axis=0)
        for k in np.flatnonzero((off > limit).any(axis=0)).tolist():
            found.setdefault(k, []).append((int(worst[k]) + 1, float(off[worst[k], k]) / 2))
            still[worst[k] + 1, k] = np.nan
    notes = []
    for k, outliers in found.items():
        if len(outliers) > _MOST_OFF:
            still[:, k] = np.nan
            continue
        told = ", ".join(f"{iso_date(table.time_gps_s[row])} ({off_m:.0f} m)" for row, off_m in sorted(outliers))
        notes.append(
            f"{table.path.name}: {names[k]} lies off the orbit of the positions before and after at {told}; the file "
            "is damaged or the satellite was moved, and it counts as missing there."
        )
    lost = [names[k] for k, outliers in found.items() if len(outliers) > _MOST_OFF]
    if lost:
        notes.append(f"{table.path.name}: the positions of {', '.join(lost)} lie on no orbit.")
    return notes


def _off_orbit_m(table: Sp3Table, still: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n - 2, m), by how much second differences of positions are other than what the Earth's pull makes of them,
    0 where one is missing; and by how much they may be (m,) [m].

    Numerov's rule: r(-h) - 2 r(0) + r(h) = h^2 (a(-h) + 10 a(0) + a(h)) / 12 - h^2 d4(a) / 240, with the fourth
    difference of the pull, which grows with interval and eccentricity: 1 m in a circle at 26,560 km with h = 900 s,
    10 m at the eccentricity 0.16 of two Galileos. A position that is 1 km off changes that term by 1 m. The Earth
    pulls as it does, or, in orbits that are computed as ellipses, as if it were round.
    """
    distance = np.linalg.norm(still, axis=-1, keepdims=True)
    flat, polar = 1.5 * _J2 * (_RADIUS_M / distance) ** 2, 5 * (still[..., 2:] / distance) ** 2
    pull = -EARTH_GM_M3_S2 * still / distance**3
    # Beside a gap of the file nothing can be said.
    pull[np.flatnonzero(np.diff(table.place) > 1)] *= np.nan
    step2 = table.interval_s**2
    second = still[:-2] - 2 * still[1:-1] + still[2:]
    pulls = (pull, pull * (1 + flat * (np.array([1.0, 1.0, 3.0]) - polar)))
    off_m = [np.linalg.norm(second - step2 / 12 * (a[:-2] + 10 * a[1:-1] + a[2:]), axis=-1) for a in pulls]
    fourth = np.nan_to_num(np.linalg.norm(np.diff(pull, 4, axis=0), axis=-1)).max(axis=0)
    limit_m = _OTHER_PULLS_M_S2 * step2 + step2 / 240 * 1.5 * fourth + _ROUNDING_M
    return np.nan_to_num(np.minimum(*off_m)), limit_m


def _interpolated(table: Sp3Table, still: NDArray[np.float64], time_gps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (e, m, 3) at the times; NaN where one of the eleven positions around a time is missing.

    The polynomial of degree ten through the eleven positions nearest to a time, by the second barycentric formula
    (Berrut and Trefethen 2004, SIAM Review 46, equation 4.2). It is one of `_anomaly`, in which ellipses are as
    smooth as circles: in time it would be off by 1.2 m in the first quarter of an hour at an eccentricity of 0.16.
    """
    place = table.place
    where = np.clip((time_gps_s - table.first_gps_s) / table.interval_s, place[0], place[-1])
    start = np.clip(np.floor(where + 0.5).astype(np.int64) - NODES // 2, place[0], place[-1] - NODES + 1)
    row = np.searchsorted(place, start).clip(0, len(place) - NODES)
    whole = (place[row] == start) & (place[row + NODES - 1] == start + NODES - 1)
    result = np.full((len(where), still.shape[1], 3), np.nan)
    for k in range(still.shape[1]):
        anomaly = np.lib.stride_tricks.sliding_window_view(_anomaly(table, still[:, k], place), NODES)
        apart = anomaly[:, :, None] - anomaly[:, None] + np.eye(NODES)
        away = _anomaly(table, still[:, k], where)[:, None] - anomaly[row]
        share = (1 / apart.prod(axis=-1))[row] / np.where(away == 0, 1.0, away)
        # At a position itself the polynomial is that position.
        share = np.where((away == 0).any(axis=1)[:, None], away == 0, share)
        share /= share.sum(axis=1, keepdims=True)
        result[:, k] = sum(share[:, j, None] * still[row + j, k] for j in range(NODES))
    return np.where(whole[:, None, None], result, np.nan)


def _anomaly(table: Sp3Table, still: NDArray[np.float64], place: NDArray[Any]) -> NDArray[np.float64]:
    """The eccentric anomaly of a satellite [rad] at places (k,) of the table's grid, as of an ellipse.

    Its elements are those of the position (n, 3) in the middle, with the velocity that its neighbours give: the mean
    of both sides, less the third derivative's share. They need not be exact, for they only say where to be dense.
    """
    has = np.flatnonzero(np.isfinite(still[:-2] + still[1:-1] + still[2:]).all(axis=1) & (np.diff(table.place, 2) == 0))
    if not len(has):
        return np.asarray(place, dtype=float)
    at = int(has[len(has) // 2])
    before, here, after = still[at : at + 3]
    pull_m_s2 = [-EARTH_GM_M3_S2 * r / np.linalg.norm(r) ** 3 for r in (before, after)]
    h = table.interval_s
    speed = (after - before) / (2 * h) - h / 12 * (pull_m_s2[1] - pull_m_s2[0])
    radius = np.linalg.norm(here)
    axis = 1 / (2 / radius - speed @ speed / EARTH_GM_M3_S2)
    if axis <= 0:
        return np.asarray(place, dtype=float)
    across, along = 1 - radius / axis, here @ speed / np.sqrt(EARTH_GM_M3_S2 * axis)
    eccentricity, first = np.hypot(across, along), np.arctan2(along, across)
    motion = np.sqrt(EARTH_GM_M3_S2 / axis**3) * h
    mean = first - eccentricity * np.sin(first) + motion * (place - table.place[at + 1])
    anomaly = mean.astype(float)
    for _ in range(20):
        anomaly = mean + eccentricity * np.sin(anomaly)
    return anomaly


def _gaps(
    table: Sp3Table,
    names: Sequence[str],
    still: NDArray[np.float64],
    position_m: NDArray[np.float64],
    kept: Sequence[int],
) -> list[str]:
    """Sentences about satellites of the file that have no position at some or all epochs asked for."""
    none = [name for k, name in enumerate(names) if k not in kept]
    notes = [f"{table.path.name}: no position of {', '.join(none)}, left out."] if none else []
    hidden = np.isnan(position_m[..., 0]).sum(axis=0)
    for k in kept:
        lacking = np.flatnonzero(np.isnan(still[:, k, 0]))
        gap = int(table.place[-1]) + 1 - len(table.place) + len(lacking)
        if hidden[k]:
            first = f", the first at {iso_date(table.time_gps_s[lacking[0]])}" if len(lacking) else ""
            notes.append(
                f"{table.path.name}: {names[k]} lacks {gap} of {int(table.place[-1]) + 1} positions{first}; it is out "
                f"of view at {hidden[k]} of {len(position_m)} epochs."
            )
    return notes
