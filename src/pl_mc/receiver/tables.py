"""CSV files of positions with what a receiver claims of them: standard deviations, accuracies, protection levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.frames import from_geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.receiver.fixes import (
    Fixes,
    in_time_order,
    numbers_of,
    require_geodetic,
    require_gps_time,
    require_near_surface,
    unusable_claim,
    utc_seconds,
    week_seconds,
)

# Columns that say when, where, and what is claimed; of each line the first one that a file has.
TIMES = (("time_gps_s",), ("week", "tow_s"), ("week", "itow_ms"), ("time_gps",), ("time_utc",))
PLACES = (("x_m", "y_m", "z_m"), ("latitude_deg", "longitude_deg", "height_m"), ("east_m", "north_m", "up_m"))
SIGMAS = (("sde_m", "sdn_m", "sdu_m"), ("hacc_m", "vacc_m"))
LEVELS = ("hpl_m", "vpl_m")
_KNOWN = sorted({name for names in (*TIMES, *PLACES, *SIGMAS, LEVELS) for name in names} | {"satellites"})

HACC_AS = (
    "vacc_m as the standard deviation up, hacc_m as that of the horizontal position, hacc_m / √2 in each direction"
)


def read_claims_table(path: Path, lines: Sequence[str]) -> Fixes:
    """The positions or errors of a table by the names of its columns, with what they claim.

    Raises:
        InputError: no column of time, of place or of a claim; a cell that is no number where one is needed.
    """
    rows = [(k, line) for k, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise InputError(f"{path}: the table is empty.")
    names = [name.strip().lower() for name in rows[0][1].split(",")]
    if len(set(names)) < len(names):
        raise InputError(f"{path}, line {rows[0][0]}: two columns have one name.")
    when, where, sigma = (_first(path, names, choices) for choices in (TIMES, PLACES, (*SIGMAS, ())))
    levels = [name for name in LEVELS if name in names]
    if not (sigma or levels):
        said = ", ".join(" and ".join(choice) for choice in (*SIGMAS, LEVELS))
        raise InputError(f"{path}: no column says what is claimed; {said} do ({nearest(names[-1], _KNOWN)}).")
    times, positions, claims = [], [], []
    satellites: list[int] = []
    for count, line in rows[1:]:
        at, cells = f"{path}, line {count}", [cell.strip() for cell in line.split(",")]
        if len(cells) != len(names):
            raise InputError(f"{at}: {len(names)} columns are needed, not {len(cells)}.")
        row = dict(zip(names, cells, strict=True))
        times.append(_time(at, when, row))
        positions.append(_position(at, where, row))
        claims.append([_claim(at, name, row[name]) for name in (*sigma, *levels)])
        if "satellites" in row:
            satellites += map(int, numbers_of(at, ["satellites"], [row["satellites"]]))
    if not times:
        raise InputError(f"{path}: the table has no rows.")
    order, notes = in_time_order(np.array(times))
    position, claim = np.array(positions)[order], np.array(claims)[order]
    errors = where == PLACES[2]
    return Fixes(
        source=str(path), time_gps_s=np.array(times)[order],
        position_m=np.full_like(position, np.nan) if errors else position, error_m=position if errors else None,
        covariance_m2=covariance_of(claim[:, : len(sigma)]) if sigma else None,
        level_m={name[:3]: claim[:, len(sigma) + k] for k, name in enumerate(levels)} or None,
        satellites=np.array(satellites)[order] if satellites else None,
        of_sigma="" if not sigma else HACC_AS if sigma == SIGMAS[1] else "its standard deviations",
        notes=(f"{path.name}: {len(times):,} rows.", *(f"{path.name}: {note}" for note in notes)),
    )  # fmt: skip


def _first(path: Path, names: Sequence[str], choices: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    found = next((choice for choice in choices if set(choice) <= set(names)), None)
    if found is None:
        said = "; ".join(", ".join(choice) for choice in choices)
        raise InputError(f"{path}: columns {said} are needed, and it has {shown(', '.join(names))}.")
    return found


def _time(where: str, columns: tuple[str, ...], row: Mapping[str, str]) -> float:
    if columns[0] in ("time_gps", "time_utc"):
        text = row[columns[0]]
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise InputError(f"{where}: the {columns[0]} {text!r} is no date such as 2020-06-25T00:00:30.") from None
        if columns[0] == "time_gps":
            return gps_seconds(moment, field=f"{where}: time_gps")
        return utc_seconds(moment if moment.tzinfo is None else moment.astimezone(UTC).replace(tzinfo=None))
    numbers = numbers_of(where, columns, [row[name] for name in columns])
    if len(numbers) == 1:
        require_gps_time(where, numbers[0])
        return numbers[0]
    return week_seconds(where, numbers[0], numbers[1] * (1e-3 if columns[1] == "itow_ms" else 1.0))


def _position(where: str, columns: tuple[str, ...], row: Mapping[str, str]) -> NDArray[np.float64]:
    numbers = numbers_of(where, columns, [row[name] for name in columns])
    if columns == PLACES[0]:
        require_near_surface(np.array(numbers), where)
    if columns == PLACES[1]:
        require_geodetic(where, *numbers)
        return from_geodetic(np.radians(numbers[0]), np.radians(numbers[1]), np.array(numbers[2]))
    return np.array(numbers)


def _claim(where: str, name: str, text: str) -> float:
    """A claimed length [m]; NaN where the cell is empty or what it says is nothing."""
    if not text or text.lower() in ("nan", "inf"):
        return np.nan
    (value,) = numbers_of(where, [name], [text])
    return value if not unusable_claim(np.array(value)) else np.nan


def covariance_of(sigma_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3, 3) [m^2] of standard deviations east, north, up, or of a horizontal one and that up."""
    if sigma_m.shape[1] == 2:
        east = sigma_m[:, 0] / np.sqrt(2.0)
        sigma_m = np.column_stack([east, east, sigma_m[:, 1]])
    whole = np.where(np.isfinite(sigma_m).all(axis=1, keepdims=True), sigma_m, np.nan)
    covariance = np.zeros((len(whole), 3, 3))
    covariance[:, [0, 1, 2], [0, 1, 2]] = whole**2
    return np.where(np.isnan(whole[:, :1, None]), np.nan, covariance)
