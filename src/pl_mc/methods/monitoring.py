"""What methods have that monitor fault modes: their priors, nominal biases and budget, or an ISM that says them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.araim.budget import LPV_200, Budget, as_budget
from pl_mc.araim.compiled_modes import Priors, codes_of_rows
from pl_mc.araim.modes import CONTAINED, UNMONITORED
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_number, require_positive
from pl_mc.ism import FIELDS, as_ism
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.methods.base import Named, Outcome

# Options that a field of an ISM stands for, of a class that has them.
_SAID_BY = {"p_sat": "p_sat", "p_const": "p_const", "b_nom_m": "b_nom_m", "accuracy_ratio": "sigma_ure_m"}
# A sigma that is the URA and nothing else may have lost a digit.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Monitoring(Named, ABC):
    """Fault modes are single satellites and constellations, which share a clock column, and pairs of them.

    Attributes:
        p_sat, p_const: prior of a fault of each satellite and of each constellation.
        b_nom_m: largest nominal bias of each satellite, in the levels alone; the sweep draws none [m].
        budget: the operation's risks: a `pl_mc.araim.Budget`, a table of its fields, or the name of one that pl_mc has
            (``LPV-200``, ``LPV-200 v4.2``, ``RNP v4.2``).
        unmonitored: ``contained`` or ``plain``, as for `pl_mc.araim.protection_levels`.
        ism: an integrity support message, `pl_mc.araim.Ism`, a table of its fields or the path of a CSV file, which
            says of each satellite or constellation what the options above say of all, as far as it has it. Where it
            has a sigma_URE the model's sigma has to hold sigma_URA, as that of `pl_mc.error_model` with the same
            ``ism`` does.
    """

    key = ""

    p_sat: float = 1e-5
    p_const: float = 1e-4
    b_nom_m: float = 0.75
    budget: Budget = LPV_200
    unmonitored: str = CONTAINED
    ism: Any = None

    def __post_init__(self) -> None:
        require_positive(self.p_sat, field=f"{self.key}: p_sat")
        for field in ("p_sat", "p_const"):
            if not 0.0 <= require_number(getattr(self, field), field=f"{self.key}: {field}") < 1.0:
                raise InputError(
                    f"{self.key}: {field}: a prior probability lies between 0 and 1, not {getattr(self, field)!r}."
                )
        if require_number(self.b_nom_m, field=f"{self.key}: b_nom_m") < 0:
            raise InputError(f"{self.key}: b_nom_m: a nominal bias is not negative, as {self.b_nom_m!r} is.")
        object.__setattr__(self, "budget", as_budget(self.budget, field=f"{self.key}: budget"))
        require_choice(self.unmonitored, UNMONITORED, field=f"{self.key}: unmonitored")
        if self.ism is not None:
            object.__setattr__(self, "ism", as_ism(self.ism, field=f"{self.key}: ism"))
            own = type(self).__dataclass_fields__
            for option, field in _SAID_BY.items():
                if option in own and self.ism.has(field) and getattr(self, option) != own[option].default:
                    raise InputError(
                        f"{self.key}: {option}: the ism has {field}, which says it; leave one of the two out."
                    )

    def require_geometry(self, g: Geometry) -> None:
        """Raise `InputError` where the ISM lacks a satellite of a geometry, or a sigma there is below its sigma_URA."""
        if self.ism is None:
            return
        for field in FIELDS:
            if self.ism.has(field):
                self.ism.values(field, g.names, g.systems)
        if self.ism.has("sigma_ure_m"):
            ura_m = self.ism.values("sigma_ura_m", g.names, g.systems)[g.satellite]
            for place in np.argwhere(g.in_view & (g.sigma_m < ura_m * (1.0 - _ROUNDING)))[:1]:
                k = tuple(place)
                raise InputError(
                    f"{self.ism.source}: sigma_ura_m: {ura_m[k]:g} m of {g.names[g.satellite[k]]} is more than its "
                    f"sigma in the geometry, {g.sigma_m[k]:.4g} m, which has to hold it (nearest: an error model with "
                    "the same ism)."
                )

    @abstractmethod
    def solve(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Outcome:
        """As of `pl_mc.methods.Method`."""

    @property
    def _priors(self) -> Priors:
        return Priors(self.p_sat, self.p_const, self.budget.p_threshold, self.unmonitored, self.ism)

    def _said(self, field: str, model: LinearModel) -> Array:
        """(n,), what the ISM says of the satellite of each row."""
        return jnp.asarray(self.ism.table(field), model.design.dtype)[codes_of_rows(model)]
