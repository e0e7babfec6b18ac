"""The model ``dual_frequency``: code free of ionosphere, GPS L1-L5 and Galileo E1-E5a, as airborne receivers have it.

``sigma^2 = sigma_user^2 + sigma_tropo^2``, ARAIM Algorithm Description Document v3.0 (Working Group C, 2017), section
on the user error models; what the integrity support message adds, sigma_URA, comes with an ISM.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.constants import FREQUENCY_L1_HZ, FREQUENCY_L5_HZ
from pl_mc.error_models.airborne import multipath_sigma_m
from pl_mc.error_models.atmosphere import ZENITH_TROPOSPHERE_M, troposphere_sigma_m
from pl_mc.error_models.base import FromVariance, Scale, Sky, require_options
from pl_mc.input_errors import InputError, nearest, shown

# Errors of two frequencies in the combination without ionosphere: sqrt((f1^4 + f5^4) / (f1^2 - f5^2)^2) = 2.588.
_L1_L5 = np.hypot(FREQUENCY_L1_HZ**2, FREQUENCY_L5_HZ**2) / (FREQUENCY_L1_HZ**2 - FREQUENCY_L5_HZ**2)

# sigma_user of Galileo, E1-E5a, at 5, 10, ... 90 degrees of elevation [m].
_GALILEO_M = (
    0.4529, 0.3553, 0.3063, 0.2638, 0.2593, 0.2555, 0.2504, 0.2438, 0.2396, 0.2359, 0.2339, 0.2302, 0.2295, 0.2278,
    0.2297, 0.2310, 0.2274, 0.2277,
)  # fmt: skip
_GALILEO_DEG = np.arange(5.0, 90.1, 5.0)

_ORBITS = ("GPS", "GAL")


@dataclass(frozen=True)
class DualFrequency(FromVariance):
    """Receiver noise, multipath and troposphere of two-frequency code; of GPS and Galileo alone, from 5 deg on.

    Attributes:
        name: ``dual_frequency``.
    """

    name: str = "dual_frequency"

    def user_sigma_m(self, sky: Sky) -> NDArray[np.float64]:
        """sigma_user of a checked sky [m]: receiver noise and multipath in the combination without ionosphere.

        Raises:
            InputError: a satellite of another system, or of Galileo below the first elevation of its table.
        """
        orbit, degrees = np.asarray(sky.orbit), np.degrees(np.asarray(sky.elevation_rad))
        for word in np.unique(orbit[~np.isin(orbit, _ORBITS)]).tolist():
            raise InputError(
                f"error model 'dual_frequency': it has no figures for {shown(word)} ({nearest(word, _ORBITS)}); choose "
                "constellations among these."
            )
        low = degrees[(orbit == "GAL") & (degrees < _GALILEO_DEG[0] - 1e-9)]
        if low.size:
            raise InputError(
                f"error model 'dual_frequency': a Galileo satellite is at {low.min():.4g} deg, and its table begins at "
                f"{_GALILEO_DEG[0]:g} deg; mask_deg: nearest: {_GALILEO_DEG[0]:g}."
            )
        multipath_m = multipath_sigma_m(sky.elevation_rad)
        noise_m = 0.15 + 0.43 * np.exp(-degrees / 6.9)
        galileo_m = np.interp(degrees, _GALILEO_DEG, _GALILEO_M)
        return np.where(orbit == "GAL", galileo_m, _L1_L5 * np.hypot(multipath_m, noise_m))

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """sigma_user^2 + sigma_tropo^2 [m^2]."""
        return self.scaled_variance_m2(sky, _L1_L5, 0.0)

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """The same for a combination that amplifies the noise of one carrier otherwise; it knows no ionosphere."""
        return (noise / _L1_L5 * self.user_sigma_m(sky)) ** 2 + troposphere_sigma_m(sky.elevation_rad) ** 2

    def describe(self) -> dict[str, Any]:
        """Name and figures."""
        user = "ADD v3.0: GPS L1-L5 by formula, Galileo E1-E5a by table"
        return {"name": self.name, "user": user, "zenith_troposphere_m": ZENITH_TROPOSPHERE_M}


def dual_frequency(**options: Any) -> DualFrequency:
    """Code of two frequencies, GPS L1-L5 and Galileo E1-E5a; its own option is ``ism``, as for every model."""
    require_options("dual_frequency", options, ())
    return DualFrequency()
