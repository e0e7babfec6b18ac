"""Fault detection and exclusion by all solutions that leave one satellite out."""

from __future__ import annotations

from dataclasses import dataclass

from jax import Array

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.leave_one_out import Projections, all_in_view, projections, standardised
from pl_mc.kernels.parameters import static, traced
from pl_mc.methods.base import Outcome
from pl_mc.methods.exclusion import Excluding, exclude_and_test
from pl_mc.methods.raim_levels import NONCENTRAL, P_FA, P_MD, SIGMA, at_dof, decided, thresholds

# Projections of a geometry, and the threshold of all its satellites.
_Checked = tuple[Projections, Array]


@traced
@dataclass(frozen=True)
class LeaveOneOut(Excluding):
    """Least squares; where V'PV > T, the best of the n sets that leave one satellite out, if it passes its test.

    The square sum of set i is V'PV - e_i^2 / r_i, with one degree of freedom less, and its position is one step of
    rank one away (`pl_mc.kernels.leave_one_out`): no further solves (sets of n - 1 as Brown & McBurney 1988 compare
    them). Best is the smallest square sum; all sets have equally many degrees of freedom, so that is also the
    largest |w|, and the satellite is the one that ``w_test`` and ``parity`` exclude. The levels are those of the
    set in use.

    An alarm means that all satellites fail their test and so does the best set, or that there is no best one: two
    sets fit equally well (satellites whose faults look the same in the residuals; all of them for n - t = 1, where
    no redundancy would be left either). Position and levels are then those of all satellites. It also means levels
    beyond VAL. Where a satellite of the set in use moves the position and nothing checks it there is no solution,
    but for ``sigma``.

    Attributes:
        p_fa: false-alarm probability of each chi-square test.
        p_md: missed-detection probability behind the levels, but for ``sigma``.
        form: ``sigma``: K times the a-priori standard deviation of the set in use; or a form of slope-based level.
        k_horizontal, k_vertical: multipliers, for ``sigma`` alone.
    """

    key = "leave_one_out"

    p_fa: float = static(P_FA)
    p_md: float = static(P_MD)
    form: str = static(NONCENTRAL)
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    @property
    def scales_with_k(self) -> str | None:
        return "k_vertical" if self.form == SIGMA else None

    def prepare(self, model: LinearModel) -> _Checked:
        """Projections of the geometry, and the threshold of all satellites."""
        return projections(model), at_dof(thresholds(model.design.shape[0], self.p_fa), model.dof)

    def statistic(self, model: LinearModel, prepared: _Checked, start: LeastSquaresSolution) -> Array:
        return start.square_sum / prepared[1]

    def solve(self, model: LinearModel, prepared: _Checked, start: LeastSquaresSolution) -> Outcome:
        parts, threshold = prepared
        whole = all_in_view(model, parts, start)
        # Roots of what the square sum loses with each satellite: the largest belongs to the best set.
        used, alarm = exclude_and_test(
            model, parts, whole, suspicion=standardised(whole), found=start.square_sum > threshold, p_fa=self.p_fa
        )
        return decided(model.available, used.error_m, self._levels(parts, used), alarm)
