"""Solution files of RTKLIB (``.pos``): positions with their standard deviations, in any of its forms but baselines.

Columns are found by their heading, as RTKLIB's manual 2.4.2, appendix B.2, describes them: times as dates or as weeks,
in GPST, UTC or JST; positions in degrees, in degrees, minutes and seconds, or Earth-fixed; any separator.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.frames import enu_rotation, from_geodetic, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError, shown
from pl_mc.receiver.fixes import (
    Fixes,
    in_time_order,
    numbers_of,
    require_geodetic,
    require_near_surface,
    unusable_claim,
    utc_seconds,
    week_seconds,
)

_DEGREES, _PARTS, _FIXED = "latitude(deg)", "latitude(d'\")", "x-ecef(m)"
_BASELINE = "e-baseline(m)"
_TIMES = ("GPST", "UTC", "JST")
_JST_AHEAD = timedelta(hours=9)

# Standard deviations by their headings, and the roots of their covariances, which carry the sign; of the directions
# that come first in the rows of the covariance.
_SIGMAS = {
    _DEGREES: (("sde(m)", "sdn(m)", "sdu(m)"), {"sdne(m)": (0, 1), "sdeu(m)": (0, 2), "sdun(m)": (1, 2)}),
    _FIXED: (("sdx(m)", "sdy(m)", "sdz(m)"), {"sdxy(m)": (0, 1), "sdzx(m)": (0, 2), "sdyz(m)": (1, 2)}),
}
_QUALITY = {1: "fixed", 2: "float", 3: "SBAS", 4: "DGPS", 5: "single", 6: "PPP", 7: "dead reckoning"}


@dataclass(frozen=True)
class _Columns:
    """The heading: the scale of its times, the form of its positions, and the place of each further column."""

    scale: str
    form: str
    rest: Mapping[str, int]

    @property
    def position_fields(self) -> int:
        return 7 if self.form == _PARTS else 3

    @property
    def count(self) -> int:
        """Fields of a line, of which the time has two."""
        return 2 + self.position_fields + len(self.rest)


def is_pos(lines: Sequence[str]) -> bool:
    """Whether lines are such a file: it begins with a heading."""
    return any(line.strip() for line in lines) and next(line for line in lines if line.strip()).startswith("%")


def read_pos(path: Path, lines: Sequence[str]) -> Fixes:
    """The positions of a solution file.

    Raises:
        InputError: no heading that names the columns, heights above the geoid, baselines, a line that does not fit.
    """
    columns: _Columns | None = None
    times, positions, covariances, satellites = [], [], [], []
    quality: Counter[int] = Counter()
    for count, line in enumerate(lines, start=1):
        where = f"{path}, line {count}"
        if line.startswith("%"):
            columns = _heading(where, line) or columns
            continue
        if not line.strip():
            continue
        if columns is None:
            raise InputError(f"{where}: no heading names the columns; RTKLIB writes one with out-outhead=on.")
        fields = re.split(r"[\s,;]+", line.strip())
        if len(fields) != columns.count:
            raise InputError(f"{where}: {columns.count} columns are needed, as its heading says, not {len(fields)}.")
        times.append(_time(where, columns.scale, fields[:2]))
        position = _position(where, columns.form, fields[2 : 2 + columns.position_fields])
        positions.append(position)
        rest = fields[2 + columns.position_fields :]
        covariances.append(_covariance(where, columns, rest, position))
        satellites.append(int(numbers_of(where, ["ns"], [rest[columns.rest["ns"]]])[0]) if "ns" in columns.rest else -1)
        if "Q" in columns.rest:
            quality[int(numbers_of(where, ["Q"], [rest[columns.rest["Q"]]])[0])] += 1
    if not times:
        raise InputError(f"{path}: the solution has no positions.")
    places, notes = in_time_order(np.array(times))
    kinds = ", ".join(
        f"{number:,} {_QUALITY.get(kind, f'of quality {kind}')}" for kind, number in quality.most_common()
    )
    told = (f"{path.name}: {len(times):,} positions{f' ({kinds})' if kinds else ''} of RTKLIB's form.",)
    covariance = np.array(covariances)[places]
    return Fixes(
        source=str(path), time_gps_s=np.array(times)[places], position_m=np.array(positions)[places],
        covariance_m2=covariance if np.isfinite(covariance).any() else None,
        satellites=None if -1 in satellites else np.array(satellites)[places],
        of_sigma="its standard deviations with their covariances", notes=(*told, *(f"{path.name}: {n}" for n in notes)),
    )  # fmt: skip


def _heading(where: str, line: str) -> _Columns | None:
    """The columns that a line of the head names; None where it names none."""
    if "geodetic" in line and "lat/lon/height" in line:
        raise InputError(f"{where}: its heights are above the geoid; ellipsoidal ones are needed (out-height).")
    names = re.split(r"[\s,;]+", line.removeprefix("%").strip())
    if names[0] not in _TIMES:
        return None
    form = names[1] if len(names) > 1 else ""
    if form == _BASELINE:
        raise InputError(f"{where}: it holds baselines to a station; positions are needed (out-solformat llh or xyz).")
    if form not in (_DEGREES, _PARTS, _FIXED) or len(names) < 4:
        raise InputError(f"{where}: {shown(form)} is no position; {_DEGREES} or {_FIXED} is needed.")
    return _Columns(names[0], form, {name: k for k, name in enumerate(names[4:])})


def _time(where: str, scale: str, fields: Sequence[str]) -> float:
    if "/" not in fields[0]:
        if scale != "GPST":
            raise InputError(f"{where}: weeks count in GPST, and its heading says {scale}.")
        return week_seconds(where, *numbers_of(where, ("GPS week", "seconds of week"), fields))
    # A second that rounding made 60 belongs to the next minute.
    day, _, seconds = f"{fields[0].replace('/', '-')}T{fields[1]}".rpartition(":")
    try:
        moment = datetime.fromisoformat(f"{day}:00") + timedelta(seconds=numbers_of(where, ["seconds"], [seconds])[0])
    except (ValueError, OverflowError):
        raise InputError(f"{where}: {shown(' '.join(fields))} is no time, such as 2020/06/25 00:00:30.000.") from None
    if scale == "GPST":
        return gps_seconds(moment, field=where)
    return utc_seconds(moment - (_JST_AHEAD if scale == "JST" else timedelta()))


def _position(where: str, form: str, fields: Sequence[str]) -> NDArray[np.float64]:
    if form == _FIXED:
        position = np.array(numbers_of(where, ("x", "y", "z"), fields[:3]))
        require_near_surface(position, where)
        return position
    if form == _PARTS:
        angles = []
        for name, parts in (("latitude", fields[:3]), ("longitude", fields[3:6])):
            degrees, minutes, seconds = numbers_of(where, [name] * 3, parts)
            size = abs(degrees) + minutes / 60.0 + seconds / 3600.0
            angles.append(-size if parts[0].startswith("-") else size)
    else:
        angles = numbers_of(where, ("latitude", "longitude"), fields[:2])
    (height_m,) = numbers_of(where, ["height"], [fields[-1]])
    require_geodetic(where, angles[0], angles[1], height_m)
    return from_geodetic(np.radians(angles[0]), np.radians(angles[1]), np.array(height_m))


def _covariance(
    where: str, columns: _Columns, rest: Sequence[str], position_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3, 3), of the errors east, north, up [m^2]; NaN where nothing usable is claimed."""
    names, cross = _SIGMAS[_FIXED if columns.form == _FIXED else _DEGREES]
    if not set(names) <= set(columns.rest):
        return np.full((3, 3), np.nan)

    def value(name: str) -> float:
        return numbers_of(where, [name], [rest[columns.rest[name]]])[0]

    sigma_m = np.array([value(name) for name in names])
    if unusable_claim(sigma_m).any():
        return np.full((3, 3), np.nan)
    covariance = np.diag(sigma_m**2)
    for name, (row, column) in cross.items():
        if name in columns.rest:
            root = value(name)
            covariance[row, column] = covariance[column, row] = np.sign(root) * root**2
    if columns.form == _FIXED:
        latitude, longitude, _ = geodetic(position_m)
        rotation = enu_rotation(latitude, longitude)
        covariance = rotation @ covariance @ rotation.T
    return covariance
