"""The check of the BeiDou residual mean against that of GPS (Guo et al. 2022, eqs 16-22), in four readings.

K = mean(v_BDS) - mean(v_GPS), T = |K| / sqrt(s1^2/n1 + s2^2/n2) with a-priori variances s1^2, s2^2, against a
Student quantile with Satterthwaite's degrees of freedom. For each satellite i a mean-shift fit (H = e_i) gives its
shift s_i and residuals, and the largest T_i decides.

The trap. With one clock per system the normal equations make the weighted mean residual of each system exactly
zero, whatever the errors are; with equal weights inside a system that is the plain mean, and T is zero by
construction. The same holds for each mean-shift fit, since it is a fit too. T says something only

- if the shift is left in the residual of the satellite that it was estimated for, v = A x - L with x from the
  mean-shift fit, so v_i = -s_i (``shift_kept``, ``separate_fits``); then, with equal weights, T_i is nothing but
  |s_i| / n_k over a constant: the estimated shift of one satellite, diluted by the number n_k in its system;
- or if both systems share one clock because the bias between them is known (``shared_clock``);
- or if weights differ inside a system, so that the plain mean is not the weighted one (``weighted``).

All of these are linear in the observations: T_i = |m_i . z| with a row m_i that depends on the geometry alone, so
one matrix product serves all n fits of a scenario.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray
from scipy import special

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.detectors.base import SYSTEM_LETTERS, Verdict, View, by_count, hat_matrix, largest, nothing_redundant
from pl_mc.detectors.chi2 import SYSTEMS, VARIANCES_M2, require_systems, require_variances, variances_text
from pl_mc.geometry.record import POSITION_UNKNOWNS, SYSTEM_NAMES
from pl_mc.input_errors import InputError, require_choice, require_one_shape, require_true
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import product, redundancy_floor

SHIFT_KEPT, SHARED_CLOCK, SEPARATE_FITS, WEIGHTED = "shift_kept", "shared_clock", "separate_fits", "weighted"
READINGS = (SHIFT_KEPT, SHARED_CLOCK, SEPARATE_FITS, WEIGHTED)
_KEEPS_SHIFT = {SHIFT_KEPT: True, SHARED_CLOCK: False, SEPARATE_FITS: True, WEIGHTED: False}
SHIFTS = ("of_reading", "kept", "removed")

# Fits of one system alone need this many satellites for a residual that is not zero.
_ENOUGH_ALONE = POSITION_UNKNOWNS + 2

# A row of T's matrix below this share of the largest that it could be is rounding: the statistic is zero.
_NOTHING = 1e-9


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """The mean check of one geometry.

    Attributes:
        rows: (n, n), T_i with its sign is row i times the whitened residuals.
        state_rows: (n, t), and this times the least-squares state: zero for fits with one clock per system.
        shift_rows: (n, n), s_i is row i times the whitened residuals [m].
        shift_state_rows: (n, t), and this times the state [m].
        threshold: (), Student quantile.
    """

    rows: Array
    state_rows: Array
    shift_rows: Array
    shift_state_rows: Array
    threshold: Array


@dataclass(frozen=True)
class MeanCheck:
    """The inter-system mean check.

    Attributes:
        reading: ``shift_kept`` (default): fits of all satellites with one clock per system, the shift left in the
            residual. ``shared_clock``: one clock for both systems, their bias known and taken away; the shift
            removed. ``separate_fits``: each system with a position and clock of its own ("adjusted separately");
            the shift left in. ``weighted``: as ``shift_kept``, but with the shift removed (the residuals of the
            mean-shift fit itself): zero unless weights differ inside a system.
        shift: ``of_reading``, or ``kept`` or ``removed`` instead of what the reading says.
        one_sided: threshold at 1 - P_FA instead of 1 - P_FA / 2. Neither corrects for the n hypotheses.
        systems: the two systems, the first with index 1 of the paper.
        variances_m2: s1^2 and s2^2, which take the place of sample variances [m^2].
    """

    reading: str = SHIFT_KEPT
    shift: str = "of_reading"
    one_sided: bool = False
    systems: tuple[str, str] = SYSTEMS
    variances_m2: tuple[float, float] = VARIANCES_M2

    def __post_init__(self) -> None:
        require_choice(self.reading, READINGS, field="mean_check.reading")
        require_choice(self.shift, SHIFTS, field="mean_check.shift")
        if not isinstance(self.one_sided, bool):
            raise InputError(f"mean_check.one_sided: true or false is needed, not {self.one_sided!r}.")
        require_systems("mean_check", self.systems)
        require_variances("mean_check", self.variances_m2)

    @property
    def test(self) -> str:
        return "mean_check"

    @property
    def label(self) -> str:
        parts = [self.reading]
        parts += [] if self.shift == "of_reading" else [f"shift {self.shift}"]
        parts += ["one-sided"] if self.one_sided else []
        if (self.systems, self.variances_m2) != (SYSTEMS, VARIANCES_M2):
            parts.append(variances_text(self.systems, self.variances_m2))
        return ", ".join(parts)

    @property
    def name(self) -> str:
        return "mean_check" if self.label == SHIFT_KEPT else f"mean_check({self.label})"

    @property
    def keeps_shift(self) -> bool:
        """Whether the shift stays in the residual of its satellite."""
        return _KEEPS_SHIFT[self.reading] if self.shift == "of_reading" else self.shift == "kept"

    def reason_against(self, view: View) -> str | None:
        first, second = self.systems
        for letter, other in ((first, second), (second, first)):
            if not view.counts.get(letter, 0):
                return f"{SYSTEM_NAMES[letter]} has no satellite in view to compare {SYSTEM_NAMES[other]} with"
        for letter in self.systems:
            if view.counts[letter] == 1:
                return (
                    f"{SYSTEM_NAMES[letter]} has a single satellite; its degrees of freedom (n_k - 1, "
                    "Satterthwaite) are zero"
                )
            if self.reading == SEPARATE_FITS and view.counts[letter] < _ENOUGH_ALONE:
                return (
                    f"{SYSTEM_NAMES[letter]} has {view.counts[letter]} satellites, and a fit of its own with "
                    f"residuals needs {_ENOUGH_ALONE}"
                )
        return nothing_redundant(view)

    def prepare(self, model: LinearModel, system: Array, p_fa: float) -> Prepared:
        seen = model.in_view > 0
        member = [seen & (system == SYSTEM_LETTERS.index(letter)) for letter in self.systems]
        hat, fitted = self._fit(model, member)
        dtype = model.design.dtype
        first, second = (jnp.sum(rows, dtype=dtype) for rows in member)
        # The paper's K: the mean of the second system less that of the first, over residuals in metres.
        mean = member[1].astype(dtype) / jnp.maximum(second, 1.0) - member[0].astype(dtype) / jnp.maximum(first, 1.0)
        sigma = jnp.where(seen, 1.0 / jnp.where(seen, model.weight_root, 1.0), 0.0)
        # v = -sigma (I - hat) z, with z whitened observations; s_i = sigma_i ((I - hat) z)_i / r_i.
        residual = jnp.diag(fitted.astype(dtype)) - hat
        redundancy = jnp.diagonal(residual)
        tested = fitted & (redundancy >= redundancy_floor(dtype))
        shift = jnp.where(tested, sigma / jnp.where(tested, redundancy, 1.0), 0.0)[:, None] * residual
        # A shift of a metre on i moves K by c_i = sum_j mean_j (A N^-1 A'P)_ji, and by mean_i less where removed.
        weight = jnp.where(sigma > 0, 1.0 / jnp.where(sigma > 0, sigma, 1.0), 0.0)
        moved = product(mean * sigma, hat) * weight - (0.0 if self.keeps_shift else mean)
        rows = -product(mean * sigma, residual)[None, :] - moved[:, None] * shift
        variance = self.variances_m2[0] / jnp.maximum(first, 1.0) + self.variances_m2[1] / jnp.maximum(second, 1.0)
        rows = rows / jnp.sqrt(variance)
        # Sums that vanish by the normal equations leave rounding errors, which must not be tested.
        size = jnp.sqrt(jnp.sum((mean * sigma) ** 2) / variance)
        kept = tested[:, None] & (jnp.max(jnp.abs(rows), axis=1, keepdims=True) > _NOTHING * size)
        rows = jnp.where(kept, rows, 0.0)
        shared = self.reading == SHARED_CLOCK
        nothing = jnp.zeros_like(model.design)
        threshold = by_count(self._thresholds(model.design.shape[0], p_fa), dtype, first, second)
        return Prepared(
            rows=rows,
            state_rows=product(rows, model.design) if shared else nothing,
            shift_rows=shift,
            shift_state_rows=product(shift, model.design) if shared else nothing,
            # Without a solution there is nothing to compare.
            threshold=jnp.where(model.available, threshold, jnp.inf),
        )

    def examine(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Verdict:
        check = product(prepared.rows, start.residuals)
        shift = product(prepared.shift_rows, start.residuals)
        if self.reading == SHARED_CLOCK:
            # The clock difference, which the start's fit has absorbed, shows in the residuals of this fit.
            check = check + product(prepared.state_rows, start.state)
            shift = shift + product(prepared.shift_state_rows, start.state)
        statistic, satellite, error = largest(jnp.abs(check), shift)
        return Verdict(statistic, prepared.threshold, statistic > prepared.threshold, satellite, error)

    def _fit(self, model: LinearModel, member: list[Array]) -> tuple[Array, Array]:
        """Projection (n, n) onto what the fit can reach, in whitened observations, and its satellites (n,)."""
        position, clocks = model.design[:, :POSITION_UNKNOWNS], model.design[:, POSITION_UNKNOWNS:]
        both = member[0] | member[1]
        if self.reading == SHARED_CLOCK:
            used = jnp.any((clocks != 0) & both[:, None], axis=0)
            merged = jnp.sum(jnp.where(used, clocks, 0.0), axis=1, keepdims=True)
            design = jnp.concatenate([position, merged, jnp.where(used, 0.0, clocks)], axis=1)
            return hat_matrix(design), model.in_view > 0
        if self.reading == SEPARATE_FITS:
            alone = jnp.concatenate([position, model.weight_root[:, None]], axis=1)
            parts = [hat_matrix(jnp.where(rows[:, None], alone, 0.0)) for rows in member]
            return parts[0] + parts[1], both
        return product(model.design, model.gain), model.in_view > 0

    def _thresholds(self, most: int, p_fa: float) -> NDArray[np.float64]:
        """(most + 1, most + 1), threshold by numbers of satellites; infinite where a system has fewer than two."""
        count = np.arange(most + 1)
        first, second = np.meshgrid(count, count, indexing="ij")
        valid = (first > 1) & (second > 1)
        dof = satterthwaite(*self.variances_m2, np.where(valid, first, 2), np.where(valid, second, 2))
        tail = p_fa if self.one_sided else p_fa / 2.0
        return np.where(valid, -special.stdtrit(dof, tail), np.inf)


@ordinary_arithmetic
def satterthwaite(
    variance_1: float, variance_2: float, count_1: NDArray | int, count_2: NDArray | int
) -> NDArray[np.float64]:
    """Satterthwaite's degrees of freedom of a difference of two means (Guo et al. 2022, eq 22).

    Args:
        variance_1, variance_2: variances of single values.
        count_1, count_2: (...), numbers of values, at least 2.
    """
    one, other, n_1, n_2 = require_one_shape(
        variance_1=variance_1, variance_2=variance_2, count_1=count_1, count_2=count_2
    )
    for field, value in (("variance_1", one), ("variance_2", other)):
        rule = "a variance from 1e-100 to 1e100 is needed"
        require_true((value >= 1e-100) & (value <= 1e100), field=field, rule=rule, of=value)
    for field, value in (("count_1", n_1), ("count_2", n_2)):
        require_true((value >= 2) & (value <= 2**53), field=field, rule="at least 2 values are needed", of=value)
    first, second = one / n_1, other / n_2
    spread = first**2 / (n_1 - 1) + second**2 / (n_2 - 1)
    return np.asarray((first + second) ** 2 / spread)
