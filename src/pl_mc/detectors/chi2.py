"""The chi-square test of the weighted sum of squared residuals (Guo et al. 2022, eqs 14-15).

F = V'PV with P = diag(1 / sigma^2) is chi-square with n - t degrees of freedom while there is no fault, and
noncentral with noncentrality b'P(I - A N^-1 A'P)b under a bias b, so its detection rate is known without any
simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.detectors.base import SYSTEM_LETTERS, Verdict, View, by_count, nothing_redundant, suspected
from pl_mc.input_errors import InputError, require_choice, shown
from pl_mc.kernels import LeastSquaresSolution, LinearModel

APRIORI, DIVIDED = "apriori", "divided"
READINGS = (APRIORI, DIVIDED)

# Guo et al. (2022), section 2.3: a-priori variances of GPS and BeiDou [m^2].
SYSTEMS = ("G", "C")
VARIANCES_M2 = (2.5, 4.5)


@dataclass(frozen=True)
class Chi2:
    """The chi-square test.

    The suspect is the satellite with the largest standardised residual |v_i| / (sigma_i sqrt(r_i)) (Baarda's
    w-test) and its error is estimated as s_i = -v_i / r_i.

    Attributes:
        reading: ``apriori``: F = V'PV against the chi-square quantile. ``divided``: the legend of equation 15 names
            the variance of the GPS and BeiDou observations; here every p_i v_i^2 is divided by the variance of its
            system once more, and the quantile stays. That is also what happens (but for the weights of the fit)
            where 2.5 and 4.5, printed in metres, serve as standard deviations, and P as their inverse squares.
        systems: the two systems whose variances are given.
        variances_m2: those variances [m^2]; satellites of other systems are divided by nothing.
    """

    reading: str = APRIORI
    systems: tuple[str, str] = SYSTEMS
    variances_m2: tuple[float, float] = VARIANCES_M2

    def __post_init__(self) -> None:
        require_choice(self.reading, READINGS, field="chi2.reading")
        require_systems("chi2", self.systems)
        require_variances("chi2", self.variances_m2)

    @property
    def test(self) -> str:
        return "chi2"

    @property
    def label(self) -> str:
        other = self.reading == DIVIDED and (self.systems, self.variances_m2) != (SYSTEMS, VARIANCES_M2)
        return f"{self.reading}, {variances_text(self.systems, self.variances_m2)}" if other else self.reading

    @property
    def name(self) -> str:
        return "chi2" if self.label == APRIORI else f"chi2({self.label})"

    def reason_against(self, view: View) -> str | None:
        return nothing_redundant(view)

    def prepare(self, model: LinearModel, system: Array, p_fa: float) -> tuple[Array, Array]:
        """The threshold, and the factor (n,) of each squared whitened residual."""
        dof = np.arange(model.design.shape[0] + 1)
        table = np.where(dof > 0, special.chdtri(np.maximum(dof, 1), p_fa), np.inf)
        threshold = by_count(table, model.design.dtype, jnp.maximum(model.dof, 0))
        factor = jnp.ones_like(model.weight_root)
        for letter, variance in zip(self.systems, self.variances_m2, strict=True):
            factor = jnp.where(system == SYSTEM_LETTERS.index(letter), 1.0 / variance, factor)
        return threshold, factor

    def examine(self, model: LinearModel, prepared: tuple[Array, Array], start: LeastSquaresSolution) -> Verdict:
        threshold, factor = prepared
        statistic = start.square_sum
        if self.reading == DIVIDED:
            # As a matrix product: a plain sum over a short leading axis is slow.
            statistic = jnp.tensordot(factor, start.residuals * start.residuals, axes=1)
        return Verdict(statistic, threshold, statistic > threshold, *suspected(model, start))


def require_systems(owner: str, systems: Any) -> None:
    """Raise `InputError` unless these are two different systems."""
    if not isinstance(systems, tuple) or len(systems) != 2 or systems[0] == systems[1]:
        given = shown(systems)
        raise InputError(f"{owner}.systems: two different systems are needed, such as ('G', 'C'), not {given}.")
    for letter in systems:
        require_choice(letter, SYSTEM_LETTERS, field=f"{owner}.systems")


def variances_text(systems: tuple[str, str], variances_m2: tuple[float, float]) -> str:
    """``G 2.5 m2, C 4.5 m2``."""
    return ", ".join(f"{letter} {value:g} m2" for letter, value in zip(systems, variances_m2, strict=True))


def require_variances(owner: str, variances_m2: Any) -> None:
    """Raise `InputError` unless these are two variances."""
    good = isinstance(variances_m2, tuple) and len(variances_m2) == 2
    if not good or not all(np.isfinite(value) and value > 0 for value in variances_m2):
        raise InputError(f"{owner}.variances_m2: two variances over zero are needed [m^2], not {variances_m2!r}.")
