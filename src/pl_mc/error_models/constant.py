"""The model ``constant``: one variance for each class of orbit, the same at every elevation.

The a-priori variances of Guo et al. (2022), section 2.3 there: 2.5 for GPS and 4.5 for BeiDou, after their figure 1
(2.41 and 4.44 m^2). The text prints the two in metres; the figure makes them m^2.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.error_models.base import FromVariance, Sky, by_orbit, require_figure, require_options


@dataclass(frozen=True)
class Constant(FromVariance):
    """A variance by class of orbit.

    GPS and the BeiDou satellites in medium and inclined orbits are the figures of the paper. It leaves
    geostationary satellites out for their larger orbit error: ours is theirs times (1.0 / 0.6)^2, the ratio of
    equation 3 of Zhao et al. (2021). Galileo is treated as GPS and GLONASS as BeiDou, as in that equation's models.

    Attributes:
        gps_m2, bds_meo_m2, bds_igso_m2, bds_geo_m2, gal_m2, glo_m2: variance of the pseudorange error [m^2].
        name: ``constant``.
    """

    gps_m2: float = 2.5
    bds_meo_m2: float = 4.5
    bds_igso_m2: float = 4.5
    bds_geo_m2: float = 12.5
    gal_m2: float = 2.5
    glo_m2: float = 4.5
    name: str = "constant"

    def __post_init__(self) -> None:
        for option in _OPTIONS:
            object.__setattr__(self, option, require_figure(option, getattr(self, option), squared=True))

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """The figure of each satellite's class of orbit [m^2]."""
        return by_orbit(self, _OPTIONS, sky)

    def describe(self) -> dict[str, Any]:
        """Name and the six variances."""
        figures = asdict(self)
        return {"name": figures.pop("name"), **figures}


_OPTIONS = tuple(field.name for field in fields(Constant) if field.name != "name")


def constant(**options: Any) -> Constant:
    """One variance for each class of orbit; those not given are the paper's and ours, see `Constant`.

    Args:
        options: any of ``gps_m2``, ``bds_meo_m2``, ``bds_igso_m2``, ``bds_geo_m2``, ``gal_m2``, ``glo_m2`` (over
            zero) [m^2].

    Raises:
        InputError: an unknown option, with the nearest names, or a figure that cannot be a variance.
    """
    require_options("constant", options, _OPTIONS)
    return Constant(**options)
