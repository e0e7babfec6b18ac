"""The model ``constant``: one variance for each class of orbit, the same at every elevation.

The a-priori variances of Guo et al. (2022), section 2.3 there: 2.5 for GPS and 4.5 for BeiDou, after their figure 1
(2.41 and 4.44 m^2). The text prints the two in metres; the figure makes them m^2.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.error_models.base import Sky, require_options
from pl_mc.input_errors import InputError


@dataclass(frozen=True)
class Constant:
    """A variance by class of orbit.

    GPS and the BeiDou satellites in medium and inclined orbits are the figures of the paper. It leaves
    geostationary
    satellites out for their larger orbit error: ours is theirs times (1.0 / 0.6)^2, the ratio of equation 3 of Zhao
    et al. (2021). Galileo is treated as GPS and GLONASS as BeiDou, as in that equation's models.

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
            object.__setattr__(self, option, _variance(option, getattr(self, option)))

    def sigma_m(self, sky: Sky) -> NDArray[np.float64]:
        """Standard deviation of each pseudorange error, in the shape of ``sky`` [m].

        Raises:
            InputError: what `Sky.checked` refuses; an elevation of 0 or less among it.
        """
        sky = sky.checked()
        variance = np.zeros(sky.shape)
        for option in _OPTIONS:
            orbit = option.removesuffix("_m2").replace("_", "-").upper()
            variance = np.where(np.asarray(sky.orbit) == orbit, getattr(self, option), variance)
        return np.sqrt(variance)

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


def _variance(option: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{option}: {value!r} is not a number of square metres; it is over zero.") from None
    if not np.isfinite(number) or number <= 0:
        raise InputError(f"{option}: {number:g} m^2 cannot be used; it is a finite number of m^2, over zero.")
    return number
