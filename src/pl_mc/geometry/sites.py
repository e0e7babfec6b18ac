"""Sites: named stations and the reading of positions that a user gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pl_mc.geometry.frames import from_geodetic, geodetic
from pl_mc.input_errors import InputError, nearest, require_numbers, shown

DEFAULT_SITE = "CUT0"

# Land reaches down to -430 m; satellites are seen as from the ground, with the whole atmosphere above, up to here.
LOWEST_HEIGHT_M = -1_000.0
HIGHEST_HEIGHT_M = 100_000.0

# Beyond this nobody stands, and the square of a coordinate may be no number.
_FARTHEST_M = 1e9


@dataclass(frozen=True)
class Site:
    """A station with its position.

    Attributes:
        name: four-character station name.
        position_m: Earth-fixed x, y, z [m].
        source: where the position was read.
    """

    name: str
    position_m: tuple[float, float, float]
    source: str


_SITES = (
    Site(
        "CUT0",
        (-2364337.441, 4870285.621, -3360809.672),
        "Curtin University, Perth: approximate position in the headers of its receiver files",
    ),
    Site(
        "JFNG",
        (-2279829.088, 5004706.484, 3219777.402),
        "IGS station at Jiufeng, Wuhan: Earth-fixed position of the station",
    ),
    Site(
        "ESBC",
        (3582104.8991, 532590.1966, 5232755.2961),
        "Esbjerg, Denmark: this project's own static solution from its receiver files",
    ),
)

SITES: Mapping[str, Site] = MappingProxyType({site.name: site for site in _SITES})


# Latitude and longitude [deg] and height [m]; every Earth-fixed position on the ground has a larger coordinate.
_GEODETIC = (90.0, 360.0, 1e6)
# Coordinates this small are angles that are too large, or kilometres.
_KILOMETRES = 1e4


def site_position_m(site: str | ArrayLike) -> NDArray[np.float64]:
    """Earth-fixed position of a site (3,) [m].

    Args:
        site: the name of one of `SITES`; three numbers or text of them, "X,Y,Z": Earth-fixed coordinates [m], or
            geodetic latitude and longitude [deg] and height above the ellipsoid [m], which no Earth-fixed position
            on the ground can be taken for.

    Raises:
        InputError: an unknown name, with the nearest ones; text or numbers that are no position; a position that
            is not near the ground.
    """
    forms = "X,Y,Z in metres, or latitude, longitude and height"
    if isinstance(site, str):
        if site in SITES:
            return np.array(SITES[site].position_m)
        if "," not in site:
            raise InputError(f"site: {shown(site)} is unknown ({nearest(site, SITES)}; or {forms}).")
        try:
            site = [float(part) for part in site.split(",")]
        except ValueError:
            raise InputError(f"site: {shown(site)} cannot be read; a position is {forms}.") from None
    given = require_numbers(site, field="site")
    if given.shape == (3,) and (np.abs(given) <= _GEODETIC).all():
        given = from_geodetic(np.radians(given[0]), np.radians(given[1]), given[2])
    elif given.shape == (3,) and (np.abs(given) < _KILOMETRES).all():
        raise InputError(
            f"site: {shown(given.tolist())} is inside the Earth as X,Y,Z in metres, and no latitude (up to 90 deg), "
            "longitude (up to 360 deg) and height in metres."
        )
    elif given.ndim == 1 and given.size != 3:
        raise InputError(
            f"site: 3 coordinates in metres, or latitude, longitude and height, are needed, not {given.size}."
        )
    return checked_positions_m(given, field="site", shape=(3,))


def checked_positions_m(positions_m: ArrayLike, *, field: str, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Earth-fixed positions as an array, after a check that someone could stand there [m].

    Args:
        positions_m: (3,) or (epochs, 3) [m].
        field: name of the option, for the sentence of an error.
        shape: the shape that is needed; None for an axis of any length over zero.

    Raises:
        InputError: no numbers, another shape, numbers that are not finite, or a height outside
            -1000 m to 100 km above the ellipsoid.
    """
    positions = require_numbers(positions_m, field=field)
    fits = len(positions.shape) == len(shape) and all(
        got > 0 and wanted in (None, got) for got, wanted in zip(positions.shape, shape, strict=True)
    )
    if not fits:
        wanted = " by ".join("epochs" if n is None else str(n) for n in shape)
        raise InputError(f"{field}: {wanted} coordinates in metres are needed, not shape {positions.shape}.")
    if not np.isfinite(positions).all():
        raise InputError(f"{field}: every coordinate is a finite number of metres.")
    if (np.abs(positions) > _FARTHEST_M).any():
        raise InputError(f"{field}: a coordinate beyond {_FARTHEST_M:g} m is no place near the Earth.")
    # The centre of the Earth has no height; anything this deep is refused before it is asked for one.
    radius = np.linalg.norm(positions, axis=-1)
    if (radius < 6.0e6).any():
        raise InputError(
            f"{field}: a position {radius.min() / 1e3:.0f} km from the centre is inside the Earth; Earth-fixed "
            "coordinates in metres are needed, about 6 370 000 m from it."
        )
    height = geodetic(positions)[2]
    if height.min() < LOWEST_HEIGHT_M:
        raise InputError(f"{field}: a height of {height.min():.0f} m is below the limit, {LOWEST_HEIGHT_M:.0f} m.")
    if height.max() > HIGHEST_HEIGHT_M:
        raise InputError(f"{field}: a height of {height.max():.0f} m is above the limit, {HIGHEST_HEIGHT_M:.0f} m.")
    return positions
