"""The parity vector: detection by its length, identification by its direction."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import InputError
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import Projections, all_in_view, before_observations, parity_basis, projections
from pl_mc.kernels.linear_model import COORDINATES, product, redundancy_floor
from pl_mc.kernels.parameters import static, traced
from pl_mc.methods.base import Outcome
from pl_mc.methods.exclusion import Excluding, exclude_and_test
from pl_mc.methods.raim_levels import LINE, P_FA, P_MD, SIGMA, at_dof, decided, thresholds


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides.

    Attributes:
        parts: its projections.
        basis: (n, n), rows of the parity transformation, zero beyond n - t.
        directions: (n, n), row i the unit vector of satellite i's column; zero where the column is.
        threshold: (), of |p|^2.
        levels: of all satellites.
    """

    parts: Projections
    basis: Array
    directions: Array
    threshold: Array
    levels: ProtectionLevels


@traced
@dataclass(frozen=True)
class Parity(Excluding):
    """Parity-space RAIM (after Sturza 1988): p = Q z with Q A = 0 and Q Q' = I; |p|^2 > T rejects.

    Q'Q = R, so |p|^2 is V'PV and the test is the chi-square test of the residuals, draw by draw; the column of
    satellite i has the length sqrt(r_i), a fault moves p along it, and the error per length of p is the slope
    |G_q,i| / |Q_i|. The default level is that of the fault's line: slope times sqrt(T) + Q^-1(p_md), which a single
    fault with a larger mean error is missed with less than p_md, since |p| is at least its projection on the line.

    Sturza's paper ("Navigation system integrity monitoring using redundant measurements", Navigation 35:483-501)
    was not at hand; transformation, test and identification are those that later texts give under its name, and
    that they are the residuals' own chi-square test and Baarda's w follows from the algebra above. The level of
    the fault's line and the rules of ``exclude`` are this file's own.

    With ``exclude`` the satellite whose column lies best along p (the largest |p . Q_i| / |Q_i|, which is Baarda's
    w) is left out, if the rest passes its own test; the levels are then those of the rest.

    An alarm means: |p|^2 is beyond the threshold and, with ``exclude``, the rest fails as well, or would have no
    redundancy left, or two columns have the same direction (position and levels are then those of all satellites);
    or levels beyond VAL. Where a satellite in use moves the position and nothing checks it there is no solution,
    but for ``sigma``.

    Attributes:
        p_fa: false-alarm probability of each test.
        p_md: missed-detection probability behind the levels, but for ``sigma``.
        form: ``line`` or another form of slope-based level; or ``sigma``, K times the a-priori standard deviation
            of the satellites in use.
        exclude: whether to identify and exclude.
        k_horizontal, k_vertical: multipliers, for ``sigma`` alone.
    """

    key = "parity"

    p_fa: float = static(P_FA)
    p_md: float = static(P_MD)
    form: str = static(LINE)
    exclude: bool = static(False)
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.exclude, bool):
            raise InputError(f"parity: exclude: true or false is needed, not {self.exclude!r}.")

    @property
    def levels_from_geometry(self) -> bool:
        return not self.exclude

    @property
    def scales_with_k(self) -> str | None:
        return "k_vertical" if self.form == SIGMA else None

    def prepare(self, model: LinearModel) -> Prepared:
        parts = projections(model)
        basis, _ = parity_basis(model, parts)
        columns = basis.T
        square = jnp.sum(columns * columns, axis=1)
        sound = square >= redundancy_floor(square.dtype)
        scale = jnp.where(sound, jax.lax.rsqrt(jnp.where(sound, square, 1.0)), 0.0)
        return Prepared(
            parts=parts,
            basis=basis,
            directions=columns * scale[:, None],
            threshold=at_dof(thresholds(model.design.shape[0], self.p_fa), model.dof),
            levels=self._levels(parts, before_observations(model, parts)),
        )

    def statistic(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Array:
        return start.square_sum / prepared.threshold

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        # Of the observations only the residuals are not explained by the model: Q z = Q e.
        parity = product(prepared.basis, start.residuals)
        found = product(jnp.ones_like(model.mask_row), parity * parity)[0] > prepared.threshold
        if not self.exclude:
            return decided(model.available, start.state[:COORDINATES], prepared.levels, found)
        used, alarm = exclude_and_test(
            model, prepared.parts, all_in_view(model, prepared.parts, start),
            suspicion=jnp.abs(product(prepared.directions, parity)), found=found, p_fa=self.p_fa,
        )  # fmt: skip
        return decided(model.available, used.error_m, self._levels(prepared.parts, used), alarm)
