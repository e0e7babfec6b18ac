"""Precise orbits: satellite positions of SP3-c and SP3-d files, interpolated to the epochs of a simulation.

The text is checked in `pl_mc.geometry.sp3_text`; RTKLIB then reads what was checked and interpolates, in a process
of its own with a time limit (`pl_mc.geometry.sp3_worker`).

Positions are those of the centres of mass in the Earth-fixed axes of the file at the time asked for. As with
nominal orbits, antenna offsets (under 3 m), travel time and the rotation of the Earth during it are left out; the
last two turn a line of sight by the satellite's speed over that of light, 1.4e-5 rad.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.constants import EARTH_GM_M3_S2, EARTH_ROTATION_RAD_S
from pl_mc.geometry import sp3_worker as worker
from pl_mc.geometry.sp3_text import NUMBERS, Sp3Table, iso_date, read_sp3_text
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.runtime.rtklib_child import run_rtklib_child

# Synchronous orbits have a radius of 42,164 km, medium ones of BeiDou 27,906 km; geostationary ones are inclined by
# under 10 degrees, the inclined ones by 55 (BDS-SIS-ICD-2.1, section 3.1).
_SYNCHRONOUS_RADIUS_M = 3.5e7
_GEO_INCLINATION_RAD = np.radians(20.0)

# What pulls besides a point mass. Oblateness: 1.5 J2 GM R^2 / r^4, 5.3e-5 m/s^2 at 26,560 km, times at most 1.4 at
# the latitudes that are reached; 9e-5 at the perigee of the two Galileos in eccentric orbits. Moon and Sun: 1e-5.
_OTHER_PULLS_M_S2 = 1e-4
_TRUNCATION_M = 10.0

# Time that the child may take: some seconds for the start, and many times the usual speed for the rest.
_START_LIMIT_S, _LIMIT_S_PER_POSITION, _LIMIT_S_PER_MEGABYTE = 30.0, 5e-4, 5.0


@dataclass(frozen=True)
class PreciseOrbits:
    """Positions of m satellites at e epochs.

    Attributes:
        names: m satellites, constellation by constellation as they were asked for.
        orbits: m classes of orbit, as error models know them: GPS, GAL, BDS-MEO, BDS-IGSO, BDS-GEO.
        position_m: (e, m, 3), Earth-fixed [m]; NaN where the file leaves one of the eleven positions around the
            epoch out.
    """

    names: tuple[str, ...]
    orbits: tuple[str, ...]
    position_m: NDArray[np.float64]


def sp3_orbits(
    path: str | Path, time_gps_s: ArrayLike, *, constellations: Sequence[str], without: Sequence[str] = ()
) -> PreciseOrbits:
    """The satellites of an SP3 file at given times.

    Args:
        path: an SP3-c or SP3-d file, plain or gzipped, with at least eleven epochs, at most 900 s apart.
        time_gps_s: (e,), times from the first to the last epoch of the file, GPS seconds [s].
        constellations: names of `NUMBERS`.
        without: satellites of the file to leave out.

    A position that is missing (0, 0, 0 or 999999.999999) or marked as one during a manoeuvre is not used, nor is
    any interpolated from it: the satellite has no position at those epochs. One that has none at all is left out.

    Raises:
        InputError: a file that is missing, cut short, damaged, of another kind or version, or of other times; a
            constellation or satellite that is not in it. The sentence names the file and, where it is damaged, the
            line.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"sp3: the path of an SP3 file is needed, not {shown(path)}.")
    path = Path(path)
    table = read_sp3_text(path, {NUMBERS[name][0] for name in constellations})
    times = np.asarray(time_gps_s, dtype=float)
    _require_inside(table, times)
    names = _chosen(table, constellations, without)
    columns = [table.names.index(name) for name in names]
    orbits = _classes_of_orbit(table, columns)
    kept = [(name, orbit, k) for name, orbit, k in zip(names, orbits, columns, strict=True) if orbit]
    if not kept:
        raise InputError(f"{path}: it holds no position of {', '.join(constellations)}.")
    names, orbits, columns = (list(part) for part in zip(*kept, strict=True))
    return PreciseOrbits(names=tuple(names), orbits=tuple(orbits), position_m=_interpolated_m(table, columns, times))


def _require_inside(table: Sp3Table, time_gps_s: NDArray[np.float64]) -> None:
    """Raise `InputError` where a time lies before the first or after the last epoch of the file."""
    first, last = float(time_gps_s.min()), float(time_gps_s.max())
    # The digits of a float64 at 1.4e9 s are 2e-7 s.
    if first >= table.first_gps_s - 1e-6 and last <= table.last_gps_s + 1e-6:
        return
    said = [iso_date(time_s) for time_s in (table.first_gps_s, table.last_gps_s, first, last)]
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


def _classes_of_orbit(table: Sp3Table, columns: Sequence[int]) -> list[str]:
    """Class of orbit of each satellite; empty where it has no two positions in a row.

    Raises:
        InputError: a position that does not lie on one orbit with those before and after it.
    """
    turned = EARTH_ROTATION_RAD_S * table.interval_s * np.arange(len(table.epochs))[:, None]
    x, y, z = np.moveaxis(table.position_m[:, columns], -1, 0)
    still = np.stack([x * np.cos(turned) - y * np.sin(turned), x * np.sin(turned) + y * np.cos(turned), z], axis=-1)
    _require_orbits(table, columns, still)
    normal = np.cross(still[:-1], still[1:])
    orbits = []
    for k, column in enumerate(columns):
        name = table.names[column]
        has = np.isfinite(normal[:, k, 0])
        if not has.any():
            orbits.append("")
        elif name[0] != "C":
            orbits.append({"G": "GPS", "E": "GAL"}[name[0]])
        elif np.nanmedian(np.linalg.norm(still[:, k], axis=-1)) < _SYNCHRONOUS_RADIUS_M:
            orbits.append("BDS-MEO")
        else:
            cosine = normal[has, k, 2] / np.linalg.norm(normal[has, k], axis=-1)
            inclination = np.arccos(np.clip(np.median(cosine), -1.0, 1.0))
            orbits.append("BDS-GEO" if inclination < _GEO_INCLINATION_RAD else "BDS-IGSO")
    return orbits


def _require_orbits(table: Sp3Table, columns: Sequence[int], still: NDArray[np.float64]) -> None:
    """Raise `InputError` unless the second differences of positions are what the Earth's pull makes of them.

    Numerov's rule: r(-h) - 2 r(0) + r(h) = h^2 (a(-h) + 10 a(0) + a(h)) / 12 up to h^6 / 240 times the sixth
    derivative: 1 m in a circle at 26,560 km with h = 900 s, under 10 m at the eccentricity 0.16 of two Galileos.
    What pulls besides the point mass is bounded.
    """
    pull = -EARTH_GM_M3_S2 * still / np.linalg.norm(still, axis=-1, keepdims=True) ** 3
    step2 = table.interval_s**2
    off = still[:-2] - 2 * still[1:-1] + still[2:] - step2 / 12 * (pull[:-2] + 10 * pull[1:-1] + pull[2:])
    off_m = np.nan_to_num(np.linalg.norm(off, axis=-1))
    if off_m.size and off_m.max() > _OTHER_PULLS_M_S2 * step2 + _TRUNCATION_M:
        epoch, k = divmod(int(off_m.argmax()), len(columns))
        name, line = table.names[columns[k]], table.line[epoch + 1, columns[k]]
        raise InputError(
            f"{table.path}, line {line}: this position of {name} and those before and after it lie "
            f"{off_m.max() / 2:.0f} m off an orbit; the file is damaged, or the satellite was moved "
            "(without switches it off)."
        )


def _interpolated_m(table: Sp3Table, columns: Sequence[int], time_gps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions by `sp3_worker.interpolated_m` (e, m, 3), computed in a process of its own."""
    names = [table.names[k] for k in columns]
    texts = {
        letter: _plain(table, [k for k in columns if table.names[k][0] == letter])
        for letter in {name[0] for name in names}
    }
    limit_s = (
        _START_LIMIT_S
        + _LIMIT_S_PER_POSITION * len(names) * len(time_gps_s)
        + _LIMIT_S_PER_MEGABYTE * sum(map(len, texts.values())) / 1e6
    )
    with tempfile.TemporaryDirectory(prefix="pl_mc_") as folder:
        for letter, text in texts.items():
            Path(folder, f"{letter}.sp3").write_text(text, encoding="latin-1", newline="\n")
        # Within the digits of the time, no epoch lies outside the file.
        np.save(Path(folder, worker.TIMES), time_gps_s.clip(table.first_gps_s, table.last_gps_s))
        run_rtklib_child(
            worker.__file__,
            [folder, ",".join(names)],
            limit_s=limit_s,
            exit_no_library=worker.EXIT_NO_LIBRARY,
            owner="sp3",
            given_up=lambda limit: f"{table.path}: interpolating it was given up after {limit}.",
            failed=lambda reason: f"{table.path}: RTKLIB cannot evaluate it ({reason}); is it damaged?",
        )
        return np.load(Path(folder, worker.RESULT))


def _plain(table: Sp3Table, columns: Sequence[int]) -> str:
    """An SP3-c file of some satellites, positions alone, with the 22 lines of header that RTKLIB counts on."""
    names = [table.names[k] for k in columns]
    rows = [names[17 * k : 17 * (k + 1)] for k in range(5)]
    lines = [
        f"#cP{table.date} {len(table.epochs):7d} ORBIT IGS20 FIT  ANY",
        f"## {int(table.first_gps_s // 604_800):4d} {table.first_gps_s % 604_800:15.8f} {table.interval_s:14.8f}",
        *(
            f"+  {len(names) if k == 0 else '':>3}   " + "".join(row) + "  0" * (17 - len(row))
            for k, row in enumerate(rows)
        ),
        *["++       " + "  0" * 17] * 5,
        "%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        *["%f  0.0000000  0.000000000  0.00000000000  0.000000000000000"] * 2,
        *["%i    0    0    0    0      0      0      0      0         0"] * 2,
        *["/*"] * 4,
    ]
    none = f"{0:14.6f}" * 3
    for epoch, row in zip(table.epochs, table.coordinates, strict=True):
        lines.append(epoch)
        lines += [f"P{table.names[k]}{row[k] or none}{999_999.999999:14.6f}" for k in columns]
    return "\n".join([*lines, "EOF", ""])
