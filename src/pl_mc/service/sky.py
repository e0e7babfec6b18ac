"""Users all over the Earth and what they see: geometries of all epochs at once, those of `pl_mc.simulate`.

The grid has cells of equal angles, a user at the middle of each, weighted with its area. Satellite positions are
computed once for all users. Rows are packed to one width for the whole grid, so that one compiled function serves
every batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray
from pl_mc.error_models import ErrorModel, Sky
from pl_mc.geometry.constellations import Slot
from pl_mc.geometry.frames import enu_rotation, from_geodetic
from pl_mc.geometry.orbits import satellite_positions_m
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, SYSTEM_NAMES, UP
from pl_mc.input_errors import InputError, require_positive

# A grid finer than a degree would have more users than maps have points.
FINEST_DEG, COARSEST_DEG = 1.0, 90.0


@dataclass(frozen=True)
class WorldGrid:
    """Users at the middles of cells, from south to north and, within a latitude, from west to east.

    Attributes:
        step_deg: width and height of a cell [deg].
        latitude_deg, longitude_deg: (sites,), middles of the cells [deg].
    """

    step_deg: float
    latitude_deg: FloatArray
    longitude_deg: FloatArray

    def __len__(self) -> int:
        """Number of users."""
        return len(self.latitude_deg)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of latitudes and of longitudes."""
        rows = round(180 / self.step_deg)
        return rows, 2 * rows

    @property
    def weight(self) -> FloatArray:
        """(sites,), share of the Earth's area in each cell; they sum to one.

        A cell between two latitudes has an area in proportion to the difference of their sines, which for cells of
        one height is in proportion to the cosine of the latitude in the middle (on a sphere).
        """
        cosine = np.cos(np.radians(self.latitude_deg))
        return np.asarray(cosine / cosine.sum())

    def as_map(self, values: NDArray) -> NDArray:
        """(latitudes, longitudes), one value for each user (sites,), from south to north."""
        return np.reshape(np.asarray(values), self.shape)


def world_grid(step_deg: float = 5.0) -> WorldGrid:
    """The cells of ``step_deg`` all over the Earth.

    Raises:
        InputError: a step outside 1 to 90 deg, or one that does not divide 180 deg.
    """
    step = require_positive(step_deg, field="step_deg")
    # Of the smallest steps the quotient has no whole number.
    rows = round(180 / max(step, 1e-6))
    if not FINEST_DEG <= step <= COARSEST_DEG or abs(rows * step - 180.0) > 1e-9:
        valid = 180.0 / int(np.clip(rows, 180 / COARSEST_DEG, 180 / FINEST_DEG))
        raise InputError(
            f"step_deg: {step:g} deg cannot be used; a step from {FINEST_DEG:g} to {COARSEST_DEG:g} deg that "
            f"divides 180 deg is needed; nearest: {valid:g}."
        )
    middle = (np.arange(rows) + 0.5) * step - 90.0
    around = (np.arange(2 * rows) + 0.5) * step - 180.0
    latitude, longitude = np.meshgrid(middle, around, indexing="ij")
    return WorldGrid(step, latitude.ravel(), longitude.ravel())


@dataclass(frozen=True)
class Geometries:
    """Geometries of a batch, sites before epochs: geometry number ``site * epochs + epoch``.

    Rows beyond a geometry's satellites are padding: ``in_view`` is False, the design row zero, sigma 1.

    Attributes:
        design: (g, n, t) [m/m]; sigma_m: (g, n) [m]; in_view: (g, n).
        satellite: (g, n), index of each row's satellite; 0 on padding.
        systems: (g, n), RINEX letters; empty on padding.
        names: (g, n), names of the satellites; empty on padding, None where nobody asks.
    """

    design: FloatArray
    sigma_m: FloatArray
    in_view: NDArray[np.bool_]
    satellite: NDArray[np.int64]
    systems: NDArray[np.str_]
    names: NDArray[np.str_] | None = None


class WorldSky:
    """The satellites of a run, and how users on the ellipsoid see them."""

    def __init__(self, slots: Sequence[Slot], model: ErrorModel, mask_deg: float, time_gps_s: FloatArray) -> None:
        """Args: the m satellites; the error model; the elevation mask [deg]; (epochs,), GPS time [s]."""
        self.slots = tuple(slots)
        self.model = model
        self.mask_deg = mask_deg
        self.time_gps_s = time_gps_s
        self.clocks = tuple(letter for letter in SYSTEM_NAMES if letter in {slot.system for slot in slots})
        self._satellite_m = satellite_positions_m(self.slots, time_gps_s)
        self._letters = np.array([slot.system for slot in self.slots])
        self._orbits = np.array([slot.orbit for slot in self.slots])
        self._names = np.array([slot.name for slot in self.slots])

    @property
    def epochs(self) -> int:
        """Number of epochs."""
        return len(self.time_gps_s)

    def look(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Unit vectors to the satellites (sites, epochs, m, 3), east, north, up, and which are above the mask."""
        position = from_geodetic(latitude_rad, longitude_rad, np.zeros_like(latitude_rad))
        sight = self._satellite_m[None] - position[:, None, None]
        sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
        turn = enu_rotation(latitude_rad, longitude_rad).swapaxes(1, 2)
        enu = np.matmul(sight.reshape(len(sight), -1, 3), turn).reshape(sight.shape)
        # On the horizon itself sigma is infinite, so a mask of zero still needs a satellite above it.
        return enu, (enu[..., UP] >= np.sin(np.radians(self.mask_deg))) & (enu[..., UP] > 0)

    def counts(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> NDArray[np.uint8]:
        """(sites, epochs), satellites in view."""
        return np.asarray(self.look(latitude_rad, longitude_rad)[1].sum(axis=-1), dtype=np.uint8)

    def geometries(self, latitude_rad: FloatArray, longitude_rad: FloatArray, width: int) -> Geometries:
        """The geometries of some sites at all epochs, packed to ``width`` rows."""
        directions, above = self.look(latitude_rad, longitude_rad)
        enu, in_view = directions.reshape(-1, *directions.shape[2:]), above.reshape(-1, above.shape[2])
        # A stable sort puts the satellites in view first and keeps their order.
        order = np.argsort(~in_view, axis=1, kind="stable")[:, :width]
        seen = np.take_along_axis(in_view, order, axis=1)
        line = np.take_along_axis(enu, order[..., None], axis=1)
        systems = np.where(seen, self._letters[order], "")
        clock = systems[..., None] == np.array(self.clocks)
        design = np.concatenate([np.where(seen[..., None], -line, 0.0), clock.astype(float)], axis=-1)
        assert design.shape[-1] == POSITION_UNKNOWNS + len(self.clocks)
        site = np.nonzero(seen)[0] // self.epochs
        east, north, up = line[seen].T[[EAST, NORTH, UP]]
        sky = Sky(
            orbit=self._orbits[order[seen]],
            elevation_rad=np.arcsin(np.minimum(up, 1.0)),
            azimuth_rad=np.arctan2(east, north) % (2 * np.pi),
            latitude_rad=latitude_rad[site],
            longitude_rad=longitude_rad[site],
            satellite=self._names[order[seen]],
        )
        sigma = np.asarray(self.model.sigma_m(sky), dtype=float)
        if sigma.shape != up.shape:
            raise InputError(
                f"error model {self.model.name!r}: one sigma per satellite is needed, shape {up.shape}, not "
                f"{sigma.shape}."
            )
        if not (np.isfinite(sigma).all() and (sigma > 0).all()):
            raise InputError("sigma_m: a sigma is finite and positive for every satellite in view.")
        sigma_m = np.ones(seen.shape)
        sigma_m[seen] = sigma
        names = np.where(seen, self._names[order], "")
        return Geometries(design, sigma_m, seen, np.where(seen, order, 0), systems, names)
