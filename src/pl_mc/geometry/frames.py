"""Coordinates: Earth-fixed to local east, north, up, and geodetic angles (adapter of pymap3d)."""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.input_errors import InputError, require_numbers, require_one_shape, require_true

# A coordinate that is farther out than this is none of a satellite or receiver; a light year would overflow.
_FARTHEST_M = 1e12


@ordinary_arithmetic
def geodetic(position_m: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """WGS 84 latitude [rad], longitude [rad] and ellipsoidal height [m] of Earth-fixed positions (..., 3) [m]."""
    position = require_numbers(position_m, field="position_m")
    if position.ndim == 0 or position.shape[-1] != 3:
        raise InputError(f"position_m: three coordinates in metres are needed, not shape {position.shape}.")
    require_true(np.abs(position) <= _FARTHEST_M, field="position_m", rule=f"up to {_FARTHEST_M:g} m", of=position)
    x, y, z = np.moveaxis(position, -1, 0)
    # The library squeezes axes of length one away.
    latitude, longitude, height = (np.reshape(a, x.shape) for a in pymap3d.ecef2geodetic(x, y, z, deg=False))
    return latitude, longitude, height


def from_geodetic(latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike) -> NDArray:
    """Earth-fixed positions (..., 3) [m] of WGS 84 latitude [rad], longitude [rad], height [m]."""
    return np.stack(pymap3d.geodetic2ecef(latitude_rad, longitude_rad, height_m, deg=False), axis=-1)


@ordinary_arithmetic
def enu_rotation(latitude_rad: ArrayLike, longitude_rad: ArrayLike) -> NDArray:
    """(..., 3, 3), the rotation from Earth-fixed axes to local east, north, up (rows in that order)."""
    latitude, longitude = require_one_shape(latitude_rad=latitude_rad, longitude_rad=longitude_rad)
    for field, angle in (("latitude_rad", latitude), ("longitude_rad", longitude)):
        require_true(np.isfinite(angle), field=field, rule="an angle is finite", of=angle)
    sin_b, cos_b = np.sin(latitude), np.cos(latitude)
    sin_l, cos_l = np.sin(longitude), np.cos(longitude)
    east = np.stack([-sin_l, cos_l, np.zeros_like(sin_l)], axis=-1)
    north = np.stack([-sin_b * cos_l, -sin_b * sin_l, cos_b], axis=-1)
    up = np.stack([cos_b * cos_l, cos_b * sin_l, sin_b], axis=-1)
    return np.stack([east, north, up], axis=-2)
