"""The model ``by_elevation``: one standard deviation for each range of elevations, such as one fitted to data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.error_models.base import FromVariance, Scale, Sky, require_figure, require_options
from pl_mc.input_errors import InputError, require_list, require_within


@dataclass(frozen=True)
class ByElevation(FromVariance):
    """A figure for each range; satellites below the first edge have the first, above the last edge the last.

    Attributes:
        elevation_deg: edges of the ranges, increasing, one more than there are figures [deg].
        figures_m: standard deviation within each [m]. It is that of the pseudoranges that it was found from, whatever
            carriers they are of: nothing of it is scaled where two are combined.
        name: ``by_elevation``.
    """

    elevation_deg: tuple[float, ...]
    figures_m: tuple[float, ...]
    name: str = "by_elevation"

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """The figure of each satellite's elevation, squared [m^2]."""
        place = np.searchsorted(self.elevation_deg, np.degrees(np.asarray(sky.elevation_rad)), side="right") - 1
        return np.square(self.figures_m)[place.clip(0, len(self.figures_m) - 1)]

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """The same."""
        return self.variance_m2(sky)

    def describe(self) -> dict[str, Any]:
        """Name, edges and figures."""
        return {"name": self.name, "elevation_deg": list(self.elevation_deg), "sigma_m": list(self.figures_m)}


def by_elevation(**options: Any) -> ByElevation:
    """One standard deviation for each range of elevations, see `ByElevation`.

    Args:
        options: ``elevation_deg``, the edges [deg], and ``sigma_m``, one fewer [m].

    Raises:
        InputError: an unknown or a missing option, edges that do not increase from 0 to 90, another number of figures.
    """
    require_options("by_elevation", options, ("elevation_deg", "sigma_m"))
    if len(options) < 2:
        raise InputError("error model 'by_elevation': elevation_deg and sigma_m are needed.")
    given = require_list(options["elevation_deg"], field="elevation_deg", of="degrees")
    edges = tuple(require_within(one, field="elevation_deg", low=0.0, high=90.0) for one in given)
    figures = tuple(
        require_figure("sigma_m", one) for one in require_list(options["sigma_m"], field="sigma_m", of="metres")
    )
    if (np.diff(edges) <= 0).any() or len(edges) < 2:
        raise InputError(f"elevation_deg: edges that increase are needed, two at least, not {list(edges)}.")
    if len(figures) != len(edges) - 1:
        raise InputError(
            f"sigma_m: {len(edges) - 1} figures are needed between {len(edges)} edges, not {len(figures)}."
        )
    return ByElevation(edges, figures)
