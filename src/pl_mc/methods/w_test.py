"""Data snooping: Baarda's w-test of every satellite, excluding the worst and solving again."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array
from scipy import special

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import InputError, hold_whole, require_choice
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import (
    Projections,
    Remaining,
    adopt,
    all_in_view,
    leave_out,
    pick,
    projections,
    slopes,
    square_sum,
    standardised,
)
from pl_mc.kernels.parameters import static, traced
from pl_mc.kernels.roots import safe_sqrt
from pl_mc.methods.base import Named, Outcome, require_multipliers
from pl_mc.methods.exclusion import LEAST_FREEDOM
from pl_mc.methods.raim_levels import P_FA, SIGMA, at_dof, decided, require_risks, sigma_levels, thresholds
from pl_mc.statistics.reliability import noncentral_shift

RELIABILITY = "reliability"
APRIORI, POSTERIOR = "apriori", "posterior"
LOCAL, GLOBAL, BOTH = "local", "global", "both"
# Each exclusion adds as much to the compiled program again.
MOST_EXCLUSIONS = 8


@traced
@dataclass(frozen=True)
class WTest(Named):
    """Data snooping (Baarda 1968): w_i = e_i / sqrt(r_i) against the two-sided normal quantile of alpha.

    While the largest |w| is beyond it, that satellite is excluded and the rest is solved and tested again, at most
    ``exclusions`` times and never to less than one degree of freedom. Nothing is excluded where two satellites have
    the same largest |w|, as those have in every draw whose faults look the same in the residuals. The quantile
    holds for one satellite: with n of them some |w| is beyond it about n alpha of the time, and a good satellite is
    excluded.

    Levels of the satellites that are left, ``form``:

    - ``sigma``: K times a standard deviation of the position; ``variance`` says which. ``apriori``: (A'PA)^-1 of
      the satellites left, with the model's own sigma; ``posterior``: that times m^2 = V'PV / dof, both of them.
      Neither knows that satellites were chosen by their residuals, so both are too small on the average.
    - ``reliability``: the external reliability, the largest slope times delta0 of alpha and ``power``: the position
      error that a bias of the size of its MDB causes.

    An alarm means that the final test rejects: the largest |w| of the satellites left beyond its quantile
    (``local``), their V'PV beyond its chi-square quantile (``global``), or either. So it does where a fault was
    found and could not be excluded. It also means levels beyond VAL.

    Attributes:
        alpha: significance of each w-test.
        power: of the test of the MDB, for ``reliability`` alone.
        exclusions: largest number of satellites excluded, 0 to 8.
        final: ``local``, ``global`` or ``both``.
        p_fa: significance of the final global test.
        form: ``sigma`` or ``reliability``.
        variance: ``apriori`` or ``posterior``, for ``sigma`` alone.
        k_horizontal, k_vertical: multipliers, for ``sigma`` alone.
    """

    key = "w_test"

    alpha: float = static(1e-3)
    power: float = static(0.8)
    exclusions: int = static(1)
    final: str = static(BOTH)
    p_fa: float = static(P_FA)
    form: str = static(SIGMA)
    variance: str = static(APRIORI)
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        require_risks("w_test", alpha=self.alpha, power=self.power, p_fa=self.p_fa)
        if self.power <= self.alpha:
            raise InputError(f"w_test: power: it lies above alpha ({self.alpha:g}), not {self.power!r}.")
        hold_whole(self, "exclusions", field="w_test: exclusions", low=0, high=MOST_EXCLUSIONS)
        require_choice(self.final, (LOCAL, GLOBAL, BOTH), field="w_test: final")
        require_choice(self.form, (SIGMA, RELIABILITY), field="w_test: form")
        require_choice(self.variance, (APRIORI, POSTERIOR), field="w_test: variance")
        require_multipliers(self)

    @property
    def quantile(self) -> float:
        """The value that |w| exceeds with probability alpha."""
        return float(-special.ndtri(self.alpha / 2.0))

    @property
    def levels_from_geometry(self) -> bool:
        return self.exclusions == 0 and not (self.form == SIGMA and self.variance == POSTERIOR)

    @property
    def scales_with_k(self) -> str | None:
        return "k_vertical" if self.form == SIGMA else None

    def prepare(self, model: LinearModel) -> Projections:
        return projections(model)

    def statistic(self, model: LinearModel, prepared: Projections, start: LeastSquaresSolution) -> Array:
        return jnp.max(standardised(all_in_view(model, prepared, start)), axis=0) / self.quantile

    def solve(self, model: LinearModel, prepared: Projections, start: LeastSquaresSolution) -> Outcome:
        left = all_in_view(model, prepared, start)
        for _ in range(self.exclusions):
            largest, satellite, unique = pick(standardised(left))
            go = (largest > self.quantile) & unique & (left.dof >= LEAST_FREEDOM)
            left = adopt(go, leave_out(prepared, left, satellite, go), left)
        squares = square_sum(model, left)
        local = jnp.max(standardised(left), axis=0) > self.quantile
        limit = at_dof(thresholds(model.design.shape[0], self.p_fa), left.dof)
        rejects = {LOCAL: local, GLOBAL: squares > limit, BOTH: local | (squares > limit)}[self.final]
        return decided(model.available, left.error_m, self._levels(prepared, left, squares), rejects)

    def _levels(self, parts: Projections, left: Remaining, squares: Array) -> ProtectionLevels:
        if self.form == RELIABILITY:
            horizontal, vertical = slopes(parts, left) * noncentral_shift(self.alpha, self.power)
            return ProtectionLevels(hpl_m=horizontal, vpl_m=vertical)
        levels = sigma_levels(left.covariance_m2, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        if self.variance == APRIORI:
            return levels
        unit_error = safe_sqrt(squares / jnp.maximum(left.dof, 1.0))
        return jax.tree.map(lambda level: level * unit_error, levels)
