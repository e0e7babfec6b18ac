"""The grid of users: cells of equal angles, a user at the middle of each, weighted with its area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of users."""
        return len(self.latitude_deg)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of latitudes and of longitudes."""
        rows = round(180 / self.step_deg)
        return rows, 2 * rows

    @property
    def weight(self) -> NDArray[np.float64]:
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
