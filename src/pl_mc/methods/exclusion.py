"""What methods that exclude satellites share: one exclusion with its test, and the levels of what is left."""

from __future__ import annotations

from jax import Array

from pl_mc.input_errors import require_choice
from pl_mc.kernels import LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import Projections, Remaining, adopt, leave_out, pick, slopes, square_sum
from pl_mc.methods.base import Named, require_multipliers
from pl_mc.methods.raim_levels import FORMS, SIGMA, at_dof, require_risks, sigma_levels, slope_levels, thresholds

# What is left after an exclusion has to be testable itself.
LEAST_FREEDOM = 2


def exclude_and_test(
    model: LinearModel, parts: Projections, whole: Remaining, *, suspicion: Array, found: Array, p_fa: float
) -> tuple[Remaining, Array]:
    """Exclude the satellite that is suspected most, where the rest then passes its own chi-square test.

    Args:
        model, parts: the geometry.
        whole: the solution with all satellites.
        suspicion: (n, ...), the larger the likelier; zero or less for a satellite that cannot be excluded.
        found: (...), where a fault was found.
        p_fa: of the test of the rest.

    Returns:
        The solution without the satellite where that passed, and with all of them elsewhere; and (...), where a
        fault was found and not dealt with: the rest fails its test, or would have no redundancy left to be tested,
        or two satellites are suspected alike.
    """
    largest, satellite, unique = pick(suspicion)
    go = found & unique & (whole.dof >= LEAST_FREEDOM) & (largest > 0)
    rest = leave_out(parts, whole, satellite, go)
    limit = at_dof(thresholds(model.design.shape[0], p_fa), rest.dof)
    passed = go & (square_sum(model, rest) <= limit)
    return adopt(passed, rest, whole), found & ~passed


class Excluding(Named):
    """What methods have whose levels are those of the satellites in use, by one of `FORMS` or K times sigma."""

    p_fa: float
    p_md: float
    form: str
    k_horizontal: float
    k_vertical: float

    def __post_init__(self) -> None:
        require_risks(self.key, p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.form, (SIGMA, *FORMS), field=f"{self.key}: form")
        require_multipliers(self)

    def _levels(self, parts: Projections, left: Remaining) -> ProtectionLevels:
        """Levels of the satellites that are left in each lane.

        ``sigma`` is K times the a-priori standard deviation: that of (A'PA)^-1 of these satellites with the model's
        own sigma, no residual in it. It does not know that satellites were chosen by looking at the residuals.
        """
        if self.form == SIGMA:
            return sigma_levels(left.covariance_m2, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        return slope_levels(
            slopes(parts, left), left.covariance_m2, left.dof, most=parts.free.shape[0], p_fa=self.p_fa,
            p_md=self.p_md, form=self.form,
        )  # fmt: skip
