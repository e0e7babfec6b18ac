"""Noncentral chi-square tails, alone and together with a normal error, good in their far ends.

Both serve events on V'PV, the weighted sum of squared residuals: ``V'PV <= threshold`` (no alarm) and "the error
is beyond a limit that is proportional to sqrt(V'PV)" (the protection level does not hold). All integrals run over
r = sqrt(V'PV), in which the density is about one unit wide wherever it lies, so that one rule serves every fault
size: find the stretch that holds the integral, then a composite Gauss-Legendre rule on that stretch. Everything is
positive and nothing is subtracted, so a probability of 1e-15 (or 1e-100) has the relative accuracy of one near 1.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.input_errors import require_numbers, require_one_shape, require_true

# Beyond this many standard deviations a normal density is below the smallest double.
REACH = 40.0
# Each round narrows a stretch many times; a few are the rule, many serve a level of millions of VDOPs.
_MOST_ROUNDS = 16
# Half the width of the step of P(|Z + shift| > slope r), in its own units; outside it is flat or a plain decay.
STEP_HALF_WIDTH = 9.0
# Pairs of epoch and fault that are integrated at once: arrays of a few megabytes.
_BLOCK = 4096

# With more degrees of freedom the Bessel function of the density would fall below the smallest double; beyond the
# others neighbouring doubles are too far apart for an integral over them, or their products overflow.
_MOST_DOF = 300
_MOST_NONCENTRALITY = 1e16
MOST_SHIFT = 1e9
_MOST_SLOPE = 1e150

_SERIES_BELOW = 2.0
_SERIES_TERMS = 14
_ASYMPTOTIC_ABOVE = 1e4
_ASYMPTOTIC_TERMS = 12


class Rule(NamedTuple):
    """How an integral is taken.

    Attributes:
        depth: parts of the integrand below exp(-depth) of its largest value are left out.
        steps: of the grid that finds them; a round narrows a stretch up to half as many times.
        panels, nodes: equal panels of what is left, Gauss-Legendre nodes in each.
    """

    depth: float
    steps: int
    panels: int
    nodes: int


# The first for one integral: 64 bits and a margin for the grid. The second where there is one more inside: horizontal
# rates take 0.3 of the time, with the same errors (400 random problems, from a rule of 12 panels of 20 nodes: 99 % of
# both below 3e-13, the worst 3e-7 and 6e-7).
FINE, NESTED = Rule(depth=60.0, steps=40, panels=8, nodes=16), Rule(depth=32.0, steps=16, panels=5, nodes=16)


@ordinary_arithmetic
def split_at_threshold(threshold: ArrayLike, dof: ArrayLike, noncentrality: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """P(Y <= threshold) and P(Y > threshold) of a noncentral chi-square Y.

    Args:
        threshold: (...), not negative; may be infinite.
        dof: (...), degrees of freedom, 1 to 300.
        noncentrality: (...), sum of squared means, 0 (the central chi-square) to 1e16.

    Returns:
        Two arrays (...), each with a relative error below 1e-10 down to 1e-290 (noncentrality up to 1e8), and
        with sum 1.

    Raises:
        InputError: a value outside its range.
    """
    below, above = integrate_both_sides(threshold, dof, noncentrality)
    rare_above = above < 0.5
    return np.where(rare_above, 1.0 - above, below), np.where(rare_above, above, 1.0 - below)


@ordinary_arithmetic
def joint_exceedance(
    threshold: ArrayLike, dof: ArrayLike, noncentrality: ArrayLike, slope: ArrayLike, shift: ArrayLike, *,
    above: bool = True,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """P(|Z + shift| > slope sqrt(Y)), split into Y <= threshold and Y > threshold.

    Z is standard normal and independent of the noncentral chi-square Y. With Y = V'PV, the vertical error over VDOP
    as Z + shift and slope = K_V / sqrt(n - t) this is the probability that the error exceeds the protection level
    (Zhao et al. 2021, eqs 15-16), without and with an alarm.

    Args:
        threshold, dof, noncentrality: (...), as in `split_at_threshold`.
        slope: (...), positive.
        shift: (...), mean of the error in its standard deviations, any sign.
        above: whether the second part is computed; it is zero otherwise, at half the cost.

    Returns:
        Two arrays (...), relative error below 1e-10 down to 1e-290, where ``shift`` is below 1e5: beyond, the
        rounding of ``slope`` sqrt(Y) - ``shift`` adds to it in proportion.

    Raises:
        InputError: a value outside its range.
    """
    require_slope(slope)
    shift = require_numbers(shift, field="shift")
    require_true(
        np.abs(shift) <= MOST_SHIFT, field="shift", rule=f"a number of at most {MOST_SHIFT:g} is needed", of=shift
    )
    return integrate_both_sides(threshold, dof, noncentrality, _ErrorTail, above=above, slope=slope, shift=shift)


class Tail:
    """Logarithm of the probability that an error is beyond slope r, for some rows of problems.

    Attributes:
        steps: values of r (k, rows) in order, between which the tail falls.
        rule: how integrals over r are taken.
    """

    steps: FloatArray
    rule: Rule = FINE

    def __call__(self, root: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        """At ``root`` (rows chosen, points)."""
        raise NotImplementedError


class _ErrorTail(Tail):
    """Of |Z + shift|."""

    def __init__(self, slope: FloatArray, shift: FloatArray) -> None:
        self.slope, self.mean = slope, np.abs(shift)
        # Where the error's tail falls it may be much steeper than the density: that part gets its own panels.
        self.steps = (self.mean + STEP_HALF_WIDTH * np.array([[-1.0], [1.0]])) / slope

    def __call__(self, root: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        return log_tail(self.slope[rows, None] * root, self.mean[rows, None])


def log_tail(limit: FloatArray, mean: FloatArray) -> FloatArray:
    """Logarithm of P(|Z + mean| > limit)."""
    return np.logaddexp(special.log_ndtr(mean - limit), special.log_ndtr(-mean - limit))


def log_density_of_root(root: FloatArray, dof: FloatArray, offset: FloatArray) -> FloatArray:
    """Logarithm of the density of r = sqrt(Y), Y noncentral chi-square with noncentrality offset^2.

    r (r/offset)^v exp(-(r^2 + offset^2)/2) I_v(offset r), v = dof/2 - 1; the arguments broadcast.
    """
    root, dof, offset = np.broadcast_arrays(root, dof, offset)
    product = root * offset
    order = dof / 2.0 - 1.0
    far = product > _ASYMPTOTIC_ABOVE + 4.0 * order**2
    near = product < _SERIES_BELOW
    value = np.empty_like(product)
    for chosen, part in ((near, _near_zero), (far, _far), (~(near | far), _middle)):
        if chosen.any():
            value[chosen] = part(root[chosen], dof[chosen], offset[chosen])
    return value


def _near_zero(root: FloatArray, dof: FloatArray, offset: FloatArray) -> FloatArray:
    """The central density times a series in (offset r / 2)^2.

    In the other form the powers and the Bessel function under- and overflow against each other near zero.
    """
    quarter = (root * offset) ** 2 / 4.0
    series = np.ones_like(quarter)
    for term in range(_SERIES_TERMS, 0, -1):
        series = 1.0 + series * quarter / (term * (dof / 2.0 - 1.0 + term))
    central = special.xlogy(dof - 1.0, root) - (dof / 2.0 - 1.0) * np.log(2.0) - special.gammaln(dof / 2.0)
    return central - (root**2 + offset**2) / 2.0 + np.log(series)


def _middle(root: FloatArray, dof: FloatArray, offset: FloatArray) -> FloatArray:
    """With the Bessel function scaled by exp(-argument), so that the exponent is that of a normal density."""
    bessel = np.log(special.ive(dof / 2.0 - 1.0, root * offset))
    return np.log(root) + (dof / 2.0 - 1.0) * np.log(root / offset) - (root - offset) ** 2 / 2.0 + bessel


def _far(root: FloatArray, dof: FloatArray, offset: FloatArray) -> FloatArray:
    """With the expansion of the Bessel function in 1/argument: the library's ends at arguments of about 1e9."""
    product, square = root * offset, (dof - 2.0) ** 2
    tail = np.ones_like(product)
    for term in range(_ASYMPTOTIC_TERMS, 0, -1):
        tail = 1.0 - tail * (square - (2.0 * term - 1.0) ** 2) / (8.0 * term * product)
    # r (r/offset)^v / sqrt(2 pi r offset) is (r/offset)^((dof - 1)/2) / sqrt(2 pi).
    power = (dof - 1.0) / 2.0 * np.log(root / offset) - np.log(2.0 * np.pi) / 2.0
    return power - (root - offset) ** 2 / 2.0 + np.log(tail)


def integrate_both_sides(
    threshold: ArrayLike,
    dof: ArrayLike,
    noncentrality: ArrayLike,
    tail: Callable[..., Tail] | None = None,
    *,
    above: bool = True,
    **of_tail: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """The integrals below and above the threshold, block by block over the flattened arguments.

    ``tail`` is made of the arrays ``of_tail``; without one the density alone is integrated. What is not asked for,
    ``above``, is zero.
    """
    arrays = require_one_shape(threshold=threshold, dof=dof, noncentrality=noncentrality, **of_tail)
    _require_ranges(*arrays[:3])
    shape = arrays[0].shape
    flat = [value.reshape(-1) for value in arrays]
    sides = np.zeros((2, flat[0].size))
    for start in range(0, flat[0].size, _BLOCK):
        block = slice(start, start + _BLOCK)
        limit, count, spread, *others = (value[block] for value in flat)
        limit, offset = np.sqrt(limit), np.sqrt(spread)
        # sqrt(Y) is within 40 of the offset on the low side, and within 40 + sqrt(dof) on the high side.
        first = np.maximum(offset - REACH, 0.0)
        last = offset + np.sqrt(count) + REACH
        edges = [first, last]
        error = None if tail is None else tail(*others)
        if error is not None:
            edges[1:1] = list(np.clip(error.steps, first, last))
        log_integrand, rule = _log_integrand(count, offset, error), FINE if error is None else error.rule
        for low, high in pairwise(edges):
            sides[0, block] += integrate(log_integrand, low, np.minimum(limit, high), rule)
            if above:
                sides[1, block] += integrate(log_integrand, np.maximum(limit, low), high, rule)
    first, second = sides.reshape(2, *shape)
    return first, second


def _log_integrand(
    dof: FloatArray, offset: FloatArray, error: Tail | None
) -> Callable[[FloatArray, NDArray[np.bool_]], FloatArray]:
    """Logarithm of the density of r, times the probability of the error beyond it; r is (rows chosen, points)."""

    def evaluate(root: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        value = log_density_of_root(root, dof[rows, None], offset[rows, None])
        return value if error is None else value + error(root, rows)

    return evaluate


def integrate(
    log_integrand: Callable[[FloatArray, NDArray[np.bool_]], FloatArray],
    first: FloatArray,
    last: FloatArray,
    rule: Rule,
) -> FloatArray:
    """Integral from ``first`` to ``last`` per row; 0 where the stretch is empty."""
    total = np.zeros_like(first)
    rows = last > first
    if not rows.any():
        return total
    low, high = first[rows], last[rows]
    # Again and again the part of the stretch within reach of the largest value, until the rule sees features that
    # are wide in its own units, be it a bell or a steep decay from one end.
    for _ in range(_MOST_ROUNDS):
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, rule.steps + 1)
        values = log_integrand(grid, rows)
        held = values > values.max(axis=1, keepdims=True) - rule.depth
        left = np.maximum(held.argmax(axis=1) - 1, 0)
        right = np.minimum(rule.steps - held[:, ::-1].argmax(axis=1) + 1, rule.steps)
        low, high = (np.take_along_axis(grid, at[:, None], axis=1)[:, 0] for at in (left, right))
        if (right - left > rule.steps // 2).all():
            break
    points, weights = _composite(rule.panels, rule.nodes)
    width = high - low
    values = log_integrand(low[:, None] + width[:, None] * points, rows)
    total[rows] = width * (np.exp(values) @ weights)
    return total


@functools.cache
def _composite(panels: int, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights on [0, 1]: equal panels, Gauss-Legendre in each."""
    points, weights = special.roots_legendre(nodes)
    starts = np.arange(panels)[:, None]
    return ((starts + (points + 1.0) / 2.0) / panels).reshape(-1), np.tile(weights / (2.0 * panels), panels)


def _require_ranges(threshold: FloatArray, dof: FloatArray, noncentrality: FloatArray) -> None:
    for name, value, valid, rule in (
        ("threshold", threshold, threshold >= 0.0, "it is not negative"),
        ("dof", dof, (dof >= 1.0) & (dof <= _MOST_DOF), f"degrees of freedom from 1 to {_MOST_DOF} are needed"),
        (
            "noncentrality",
            noncentrality,
            (noncentrality >= 0.0) & (noncentrality <= _MOST_NONCENTRALITY),
            f"a number from 0 to {_MOST_NONCENTRALITY:g} is needed",
        ),
    ):
        require_true(valid, field=name, rule=rule, of=value)


def require_slope(slope: ArrayLike) -> None:
    value = require_numbers(slope, field="slope")
    valid = (value >= 1.0 / _MOST_SLOPE) & (value <= _MOST_SLOPE)
    require_true(valid, field="slope", rule="a positive, finite number is needed", of=value)
