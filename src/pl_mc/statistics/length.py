"""The length of a Gaussian vector in the plane against a limit, alone and together with a noncentral chi-square.

It serves the horizontal error, whose two components along its principal axes are independent. P(length > L) is that
the second component alone is beyond L, and else an integral over it of tails of the first; all terms are positive.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.input_errors import require_numbers, require_one_shape, require_true
from pl_mc.statistics.noncentral import (
    MOST_SHIFT,
    NESTED,
    REACH,
    STEP_HALF_WIDTH,
    Tail,
    integrate,
    integrate_both_sides,
    log_tail,
    require_slope,
)

# A horizontal error that is so much narrower in one direction than in the other has one component alone.
LEAST_RATIO = 1e-3


@ordinary_arithmetic
def joint_length_exceedance(
    threshold: ArrayLike,
    dof: ArrayLike,
    noncentrality: ArrayLike,
    slope: ArrayLike,
    ratio: ArrayLike,
    major: ArrayLike,
    minor: ArrayLike,
    *,
    above: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """P(|(Z + major, ratio Z' + minor)| > slope sqrt(Y)), split into Y <= threshold and Y > threshold.

    Z and Z' are standard normal, and both independent of the noncentral chi-square Y. With Y = V'PV, the horizontal
    error along its principal axes over its larger standard deviation s and slope = K_H HDOP / (s sqrt(n - t)) this is
    the probability that the error exceeds the protection level (Zhao et al. 2021, eqs 14 and 16), without and with an
    alarm.

    Args:
        threshold, dof, noncentrality: (...), as in `split_at_threshold`.
        slope: (...), positive.
        ratio: (...), the smaller standard deviation over the larger one, 0.001 to 1.
        major, minor: (...), means along both axes, in units of the larger standard deviation.
        above: whether the second part is computed; it is zero otherwise, at half the cost.

    Returns:
        Two arrays (...), relative error below 1e-6 down to 1e-290.

    Raises:
        InputError: a value outside its range.
    """
    require_slope(slope)
    _require_axes(ratio, major, minor)
    return integrate_both_sides(
        threshold, dof, noncentrality, LengthTail, above=above, slope=slope, ratio=ratio, major=major, minor=minor
    )


@ordinary_arithmetic
def length_beyond(
    limit: ArrayLike, ratio: ArrayLike, major: ArrayLike, minor: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """P(|(Z + major, ratio Z' + minor)| <= limit) and P(... > limit), as in `joint_length_exceedance`.

    Args:
        limit: (...), positive.
        ratio, major, minor: (...), as there.

    Returns:
        Two arrays (...) with sum 1, each with a relative error below 1e-6.
    """
    _require_axes(ratio, major, minor)
    arrays = require_one_shape(limit=limit, ratio=ratio, major=major, minor=minor)
    require_true(arrays[0] > 0, field="limit", rule="a positive number is needed", of=arrays[0])
    limit, ratio, major, minor = (value.reshape(-1) for value in arrays)
    tail = LengthTail(np.ones_like(limit), ratio, major, minor)
    rows = np.ones(limit.size, bool)
    beyond = np.exp(tail(limit[:, None], rows))[:, 0]
    within = np.exp(tail.within(limit))
    rare = beyond < 0.5
    shape = arrays[0].shape
    return np.where(rare, 1.0 - beyond, within).reshape(shape), np.where(rare, beyond, 1.0 - within).reshape(shape)


class LengthTail(Tail):
    """Of |(Z + major, ratio Z' + minor)|: an integral over the second component, of tails of the first."""

    rule = NESTED

    def __init__(self, slope: FloatArray, ratio: FloatArray, major: FloatArray, minor: FloatArray) -> None:
        self.slope, self.ratio, self.major, self.minor = slope, ratio, np.abs(major), np.abs(minor)
        length = np.hypot(major, minor)
        # Its own standard deviation where the length is far from zero, and the larger one.
        own = np.where(length > 0, np.hypot(major, ratio * minor) / np.where(length > 0, length, 1.0), 1.0)
        widths = STEP_HALF_WIDTH * np.stack([-np.ones_like(own), -own, own, np.ones_like(own)])
        self.steps = (length + widths) / slope

    def __call__(self, root: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        limit = self.slope[rows, None] * root
        ratio, major, minor = (
            np.broadcast_to(value[rows, None], limit.shape).reshape(-1)
            for value in (self.ratio, self.major, self.minor)
        )
        flat = limit.reshape(-1)
        outside = log_tail(flat / ratio, minor / ratio)
        inside = self._inside(flat, ratio, major, minor, log_tail)
        return np.logaddexp(outside, inside).reshape(limit.shape)

    def within(self, limit: FloatArray) -> FloatArray:
        """(rows,), logarithm of the probability of the rest."""
        return self._inside(limit, self.ratio, self.major, self.minor, _log_within)

    @staticmethod
    def _inside(
        limit: FloatArray, ratio: FloatArray, major: FloatArray, minor: FloatArray, of_first: Callable[..., FloatArray]
    ) -> FloatArray:
        """(points,), logarithm of the probability that the second component is within, and the first as asked."""

        def log_integrand(angle: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
            # The second component is limit sin(angle), the first one's limit is limit cos(angle).
            bound = limit[rows, None]
            across, along = bound * np.sin(angle), bound * np.cos(angle)
            density = -0.5 * ((across - minor[rows, None]) / ratio[rows, None]) ** 2 - np.log(ratio[rows, None])
            slope = np.log(np.maximum(along, np.finfo(float).tiny)) - 0.5 * np.log(2.0 * np.pi)
            return density + slope + of_first(along, major[rows, None])

        right = np.full(limit.shape, np.pi / 2.0)
        # The bell of the second component, where it is narrow in the circle, has panels of its own.
        bounds = minor + REACH * ratio * np.array([[-1.0], [1.0]])
        reach = np.clip(bounds / np.maximum(limit, 1e-100), -1.0, 1.0)
        edges = [-right, *np.arcsin(reach), right]
        with np.errstate(divide="ignore"):
            return np.log(sum(integrate(log_integrand, low, high, NESTED) for low, high in pairwise(edges)))


def _log_within(limit: FloatArray, mean: FloatArray) -> FloatArray:
    """Logarithm of P(|Z + mean| <= limit), in the lower tail, where it keeps its relative accuracy."""
    with np.errstate(divide="ignore"):
        return np.log(np.maximum(special.ndtr(limit - mean) - special.ndtr(-limit - mean), 0.0))


def _require_axes(ratio: ArrayLike, major: ArrayLike, minor: ArrayLike) -> None:
    value = require_numbers(ratio, field="ratio")
    valid = (value >= LEAST_RATIO) & (value <= 1.0)
    require_true(valid, field="ratio", rule=f"a number from {LEAST_RATIO:g} to 1 is needed", of=value)
    for name, given in (("major", major), ("minor", minor)):
        shift = require_numbers(given, field=name)
        rule = f"a number of at most {MOST_SHIFT:g} is needed"
        require_true(np.abs(shift) <= MOST_SHIFT, field=name, rule=rule, of=shift)
