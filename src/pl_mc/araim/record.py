"""What `pl_mc.araim.protection_levels` answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray


@dataclass(frozen=True)
class PositionLevels:
    """Levels of the positions that an exclusion may leave, the one of all in view first; infinite where there is none.

    Attributes:
        excluded: (..., positions, n), the rows that each leaves out.
        there: (..., positions), whether there is such a position; rows out of view have none without them.
        vpl_m, hpl_m, emt_m, sigma_v_acc_m: (..., positions), as of `AraimLevels` [m].
    """

    excluded: NDArray[np.bool_]
    there: NDArray[np.bool_]
    vpl_m: FloatArray
    hpl_m: FloatArray
    emt_m: FloatArray
    sigma_v_acc_m: FloatArray


@dataclass(frozen=True)
class AraimLevels:
    """Protection levels; ``...`` is nothing for one geometry, one axis for a batch. Never NaN.

    Where there are no levels (too few satellites, or faults without a test more probable than the integrity risk)
    they are infinite and ``available`` is False.

    Attributes:
        vpl_m, hpl_m: (...), vertical and horizontal protection levels [m]; HPL^2 = HPL_east^2 + HPL_north^2.
        hpl_east_m, hpl_north_m: (...), the latter two [m].
        emt_m: (...), effective monitor threshold: the largest vertical threshold of the modes with a prior of at
            least P_EMT [m]; zero where none is so probable.
        sigma_v_acc_m: (...), standard deviation of the vertical error under the accuracy model [m].
        p_not_monitored: (...), prior of the faults that no test looks for, those that leave no position included.
        available: (...), whether there are levels.
        excluded: (..., modes, n), satellites that each fault mode spoils; modes beyond a geometry's own are empty.
        probability: (..., modes), their priors; zero beyond a geometry's own.
        threshold_m: (..., modes, 3), thresholds of the separations east, north, up [m]; infinite for a mode that
            leaves no position.
        satellites: (..., n), what each row is called.
        exposure: (..., modes), priors over the exposure; in v3.0, which knows one, those at an instant.
        hpl_norm_m, hpl_plane_m, hpl_plane_coded_m: (...), v4.2 alone, of all in view: horizontal levels of one
            equation, by the lengths of thresholds and sigmas, by planes with the sign that geometry demands, and
            with the sign of the authors' code, which is smaller [m].
        positions: with exclusion, the levels of each position; of all of them the levels above are the largest, and
            what else is above belongs to all in view.
    """

    vpl_m: FloatArray
    hpl_m: FloatArray
    hpl_east_m: FloatArray
    hpl_north_m: FloatArray
    emt_m: FloatArray
    sigma_v_acc_m: FloatArray
    p_not_monitored: FloatArray
    available: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    probability: FloatArray
    threshold_m: FloatArray
    satellites: NDArray[np.str_]
    exposure: FloatArray
    hpl_norm_m: FloatArray | None = None
    hpl_plane_m: FloatArray | None = None
    hpl_plane_coded_m: FloatArray | None = None
    positions: PositionLevels | None = None

    def modes(self) -> pd.DataFrame:
        """The fault modes, a row each: ``geometry``, ``satellites`` that it spoils, priors, thresholds [m]."""
        own = self.probability > 0
        geometry, mode = np.nonzero(np.atleast_2d(own))
        n = self.excluded.shape[-1]
        excluded = self.excluded.reshape(-1, *self.excluded.shape[-2:])[geometry, mode]
        names = self.satellites.reshape(-1, n)
        threshold = self.threshold_m[own]
        return pd.DataFrame(
            {
                "geometry": geometry,
                "satellites": [" ".join(names[k][out]) for k, out in zip(geometry, excluded, strict=True)],
                "p_instant": self.probability[own],
                "p_exposure": self.exposure[own],
                "threshold_east_m": threshold[:, 0],
                "threshold_north_m": threshold[:, 1],
                "threshold_up_m": threshold[:, 2],
            }
        )
