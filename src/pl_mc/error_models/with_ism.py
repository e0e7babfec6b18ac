"""An error model with the orbit and clock errors that an integrity support message promises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.error_models.base import ErrorModel, FromVariance, Scale, Sky, sigma_of_signal_m
from pl_mc.input_errors import InputError
from pl_mc.ism import Ism
from pl_mc.ism.codes import number_of

# Letters of the classes of orbit.
_LETTERS = {"GPS": "G", "BDS-MEO": "C", "BDS-IGSO": "C", "BDS-GEO": "C", "GAL": "E", "GLO": "R"}


@dataclass(frozen=True)
class WithIsm(FromVariance):
    """sigma_URA^2 of an ISM beside the variance of another model: C_int of the ADD, the variance of integrity.

    Attributes:
        model: what gives the errors of receiver and atmosphere.
        ism: for its ``sigma_ura_m``.
    """

    model: ErrorModel
    ism: Ism

    @property
    def name(self) -> str:
        """The name of the other model with that of the ISM."""
        return f"{self.model.name}(ism={self.ism})"

    def variance_m2(self, sky: Sky) -> NDArray[np.float64]:
        """The variance of the other model and sigma_URA^2 [m^2]."""
        return np.asarray(self.model.sigma_m(sky)) ** 2 + self._ura_m(sky) ** 2

    def scaled_variance_m2(self, sky: Sky, noise: Scale, ionosphere: Scale) -> NDArray[np.float64]:
        """The same with noise and ionosphere of the other model scaled; orbit and clock are those of any carrier."""
        ones = np.ones(sky.shape)
        user_m = sigma_of_signal_m(self.model, sky, noise=noise * ones, ionosphere=ionosphere * ones)
        return user_m**2 + self._ura_m(sky) ** 2

    def _ura_m(self, sky: Sky) -> NDArray[np.float64]:
        classes = np.asarray(sky.orbit).ravel().tolist()
        single = self.ism.single_satellites("sigma_ura_m")
        if sky.satellite is None and single:
            raise InputError(f"sky: {self.ism.source} tells {single[0]} from others, and the sky names no satellites.")
        names = classes if sky.satellite is None else np.asarray(sky.satellite).ravel().tolist()
        # A class of orbit may serve several systems, which names tell apart.
        letters = [name[0] if number_of(name) else _LETTERS[orbit] for name, orbit in zip(names, classes, strict=True)]
        return self.ism.values("sigma_ura_m", names, letters).reshape(sky.shape)

    def describe(self) -> dict[str, Any]:
        """What the other model says of itself, and the ISM."""
        return {**self.model.describe(), "ism": self.ism.as_dict()}
