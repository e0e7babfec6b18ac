"""The vertical or the horizontal error beyond its limit, for errors that are jointly Gaussian.

P(either) is P(horizontal) plus the probability that the vertical error alone is beyond: an integral over the disc of
the horizontal limit, of the tails that the vertical error has given the horizontal one. All terms are positive.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.statistics.length import LengthTail, length_beyond
from pl_mc.statistics.noncentral import NESTED, STEP_HALF_WIDTH, Tail, integrate_both_sides

# Points of the rules along the two horizontal axes, the more the less of the vertical error the horizontal one leaves
# open (its standard deviation given that one); how far they reach in standard deviations, since a rare vertical error
# draws the horizontal one with it; and points of the disc that are held at once.
_NODES = ((0.65, 72), (0.4, 128), (0.0, 240))
_REACH = 13.0
_AT_ONCE = 2_000_000
# The vertical error given the horizontal one has this standard deviation at the least.
_LEAST_REST = 1e-6


@dataclass(frozen=True)
class JointErrors:
    """Errors of least squares; the vertical one in its standard deviations, the horizontal one in its larger one.

    Attributes:
        vertical: (...), mean of the vertical error.
        ratio: (...), smaller over larger standard deviation of the horizontal error.
        major, minor: (...), mean of the horizontal error along its principal axes.
        with_major, with_minor: (...), correlation of the vertical error with these components.
    """

    vertical: FloatArray
    ratio: FloatArray
    major: FloatArray
    minor: FloatArray
    with_major: FloatArray
    with_minor: FloatArray


@ordinary_arithmetic
def joint_either_exceedance(
    threshold: FloatArray, dof: FloatArray, noncentrality: FloatArray, upward: FloatArray, sideways: FloatArray,
    errors: JointErrors,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """P(vertical error > upward sqrt(Y), or horizontal one > sideways sqrt(Y)): (pairs,) for Y <= threshold, and above.

    Y is noncentral chi-square and independent of the errors; relative error below 1e-6 down to 1e-30.
    """
    fields = dict(zip(JointErrors.__dataclass_fields__, astuple(errors), strict=True))
    return integrate_both_sides(threshold, dof, noncentrality, _EitherTail, slope=upward, sideways=sideways, **fields)


@ordinary_arithmetic
def either_beyond(vertical: FloatArray, horizontal: FloatArray, errors: JointErrors) -> tuple[FloatArray, FloatArray]:
    """P(both errors within their limits) and P(either beyond), each (pairs,), for limits in units of `JointErrors`."""
    sideways = length_beyond(horizontal, errors.ratio, errors.major, errors.minor)[1]
    within = _over_disc(vertical, horizontal, errors, beyond=False)
    return within, np.minimum(sideways + _over_disc(vertical, horizontal, errors, beyond=True), 1.0)


class _EitherTail(Tail):
    """Of the vertical error beyond slope r, or the horizontal one beyond sideways r."""

    rule = NESTED

    def __init__(
        self, slope: FloatArray, sideways: FloatArray, vertical: FloatArray, ratio: FloatArray, major: FloatArray,
        minor: FloatArray, with_major: FloatArray, with_minor: FloatArray,
    ) -> None:  # fmt: skip
        self.slope, self.sideways = slope, sideways
        self.errors = JointErrors(vertical, ratio, major, minor, with_major, with_minor)
        self.length = LengthTail(sideways, ratio, major, minor)
        own = (np.abs(vertical) + STEP_HALF_WIDTH * np.array([[-1.0], [1.0]])) / slope
        self.steps = np.sort(np.concatenate([own, self.length.steps]), axis=0)

    def __call__(self, root: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        each = [np.broadcast_to(value[rows, None], root.shape).reshape(-1) for value in astuple(self.errors)]
        limits = [(value[rows, None] * root).reshape(-1) for value in (self.slope, self.sideways)]
        alone = _over_disc(limits[0], limits[1], JointErrors(*each), beyond=True).reshape(root.shape)
        with np.errstate(divide="ignore"):
            return np.logaddexp(self.length(root, rows), np.log(alone))


def _over_disc(vertical: FloatArray, horizontal: FloatArray, errors: JointErrors, *, beyond: bool) -> FloatArray:
    """(pairs,), P(horizontal error within its limit, and the vertical one beyond its own, or within it)."""
    found = np.empty(vertical.shape)
    rest = float(np.sqrt(np.maximum(1.0 - errors.with_major**2 - errors.with_minor**2, 0.0)).min(initial=1.0))
    nodes = next(count for least, count in _NODES if rest >= least)
    step = max(_AT_ONCE // nodes**2, 1)
    for start in range(0, vertical.size, step):
        block = slice(start, start + step)
        part = JointErrors(*(value[block] for value in astuple(errors)))
        found[block] = _disc(vertical[block], horizontal[block], part, beyond, nodes)
    return found


def _disc(vertical: FloatArray, horizontal: FloatArray, errors: JointErrors, beyond: bool, nodes: int) -> FloatArray:
    points, weights = special.roots_legendre(nodes)
    limit = np.maximum(horizontal, 1e-100)[:, None]
    ratio, major, minor = (value[:, None] for value in (errors.ratio, errors.major, errors.minor))
    # The minor component is limit sin(angle), the major one goes along the chord; both as far as their bells reach.
    low, high = (np.arcsin(np.clip((minor + side * _REACH * ratio) / limit, -1.0, 1.0)) for side in (-1.0, 1.0))
    angle = 0.5 * (high + low) + 0.5 * (high - low) * points
    across, chord = limit * np.sin(angle), limit * np.cos(angle)
    of_minor = 0.5 * (high - low) * weights * chord / (ratio * np.sqrt(2.0 * np.pi))
    from_minor = (across - minor) / ratio
    of_minor = of_minor * np.exp(-0.5 * from_minor**2)
    first, last = (np.clip(major + side * _REACH, -chord, chord) for side in (-1.0, 1.0))
    along = (0.5 * (last + first))[..., None] + (0.5 * (last - first))[..., None] * points
    from_major = along - major[..., None]
    density = np.exp(-0.5 * from_major**2) / np.sqrt(2.0 * np.pi) * weights * (0.5 * (last - first))[..., None]
    rho, other = (value[:, None, None] for value in (errors.with_major, errors.with_minor))
    rest = np.sqrt(np.maximum(1.0 - rho**2 - other**2, _LEAST_REST**2))
    mean = errors.vertical[:, None, None] + rho * from_major + other * from_minor[..., None]
    bound = vertical[:, None, None]
    if beyond:
        chance = special.ndtr((mean - bound) / rest) + special.ndtr((-mean - bound) / rest)
    else:
        size = np.abs(mean)
        chance = special.ndtr((bound - size) / rest) - special.ndtr((-bound - size) / rest)
    return np.einsum("pk,pkj,pkj->p", of_minor, density, chance)
