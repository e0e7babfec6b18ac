"""What methods that exclude satellites share: one exclusion with its test, and the levels of what is left."""

from __future__ import annotations

from jax import Array

from pl_mc.input_errors import require_choice, require_positive
from pl_mc.kernels import LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import Projections, Remaining, adopt, leave_out, pick, slopes, square_sum
from pl_mc.methods.raim_levels import (
    FORMS,
    SIGMA,
    at_dof,
    sigma_levels,
    slope_levels,
    thresholds,
)

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


def require_level(owner: str, form: str, k_horizontal: float, k_vertical: float) -> None:
    """Raise `InputError` unless these describe a level."""
    require_choice(form, (SIGMA, *FORMS), field=f"{owner}: form")
    for field, value in (("k_horizontal", k_horizontal), ("k_vertical", k_vertical)):
        require_positive(value, field=f"{owner}: {field}")


def levels_of(
    parts: Projections,
    left: Remaining,
    *,
    form: str,
    p_fa: float,
    p_md: float,
    k_horizontal: float,
    k_vertical: float,
) -> ProtectionLevels:
    """Levels of the satellites that are left in each lane: ``sigma``, or one of `FORMS`.

    ``sigma`` is K times the a-priori standard deviation: that of (A'PA)^-1 of these satellites with the model's own
    sigma, no residual in it. It does not know that the satellites were chosen by looking at the residuals.
    """
    if form == SIGMA:
        return sigma_levels(left.covariance_m2, k_horizontal=k_horizontal, k_vertical=k_vertical)
    return slope_levels(
        slopes(parts, left), left.covariance_m2, left.dof,
        most=parts.free.shape[0], p_fa=p_fa, p_md=p_md, form=form,
    )  # fmt: skip
