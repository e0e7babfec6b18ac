"""Least squares of one epoch as integrity risk sees it: two numbers per fault, and the worst fault of a kind.

A fault enters through two numbers alone: the mean vertical error s.b and the noncentrality b'Mb of V'PV, with
M = P - P A N^-1 A'P. For a given noncentrality every event here becomes likelier the larger |s.b| is. Hence of all
faults that have the form D c (the columns of D span what may fail together: one satellite, a pair, a constellation)
the worst has the direction of the largest slope |s.b| / sqrt(b'Mb), which is c = (D'MD)^-1 D's (Angus 2006, RAIM
with multiple faults, NAVIGATION 53); only its size is left to be searched for, in one dimension.

Everything is in the error's standard deviations and the square root of the noncentrality, so that the answers
depend on no unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.alert import EITHER, HORIZONTAL, VERTICAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import EAST, NORTH, UP, Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.kernels.linear_model import REDUNDANCY_FLOOR
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, refusal
from pl_mc.statistics.exact import CHI2_ALARM, PL_ALARM, LeastSquaresLaw
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.noncentral import joint_exceedance, split_at_threshold
from pl_mc.statistics.student import chi2_threshold

MISSED, MISLEADING = "missed", "misleading"
EVENTS = (MISSED, MISLEADING)

# A direction of unit length moves the height by at most one VDOP; below this share the rest is rounding.
_NO_EFFECT = 1e-9
# sqrt(V'PV) is never this far below its offset: the probability would be below the smallest double.
_REACH = 40.0
_STEPS_PER_UNIT, _FEWEST_STEPS, _MOST_STEPS = 3.0, 150, 1500
# Peaks of the scan below this share of the largest value are not refined, nor more than so many per row.
_WORTH_REFINING, _MOST_PEAKS = 0.1, 3
# Each round narrows the bracket four times; 8 of them reach the rounding of a probability at its top.
_ROUNDS, _POINTS = 8, 9
# A peak that is higher than no fault at all by less than this is the rounding of a peak at zero.
_FLAT = 1e-10


@dataclass(frozen=True)
class LsEpoch:
    """Least squares of one epoch with its alarm.

    Attributes:
        available: whether there is a solution with a posterior variance; else it alarms always.
        sigma_m: (n,), standard deviation of each pseudorange [m].
        vdop_m: standard deviation of the vertical error [m].
        sensitivity: (n,), mean vertical error per whitened bias, both in standard deviations; of length 1.
        basis: (n, t), orthonormal columns that span the whitened design.
        dof: degrees of freedom of V'PV, n - t.
        threshold: V'PV above which there is an alarm.
        level_slope: protection level per sqrt(V'PV), in standard deviations of the vertical error.
        limit: VAL in these standard deviations.
    """

    available: bool
    sigma_m: FloatArray
    vdop_m: float
    sensitivity: FloatArray
    basis: FloatArray
    dof: int
    threshold: float
    level_slope: float
    limit: float

    def effects(self, bias_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean vertical error [its standard deviations] and root of the noncentrality of faults (..., n) [m]."""
        whitened = bias_m / self.sigma_m
        residual = whitened - (whitened @ self.basis) @ self.basis.T
        return whitened @ self.sensitivity, np.sqrt((residual**2).sum(axis=-1))

    def hazard(self, shift: FloatArray) -> FloatArray:
        """P(|vertical error| > VAL) for mean errors in its standard deviations."""
        return special.ndtr(shift - self.limit) + special.ndtr(-shift - self.limit)


@dataclass(frozen=True)
class Direction:
    """The worst direction among faults D c.

    Attributes:
        slope: largest mean vertical error, in its standard deviations, per unit of the root of the noncentrality;
            infinite where a fault moves the height and no residual.
        bias_m: (n,), the fault with noncentrality 1; of unit length where the slope is infinite [m].
    """

    slope: float
    bias_m: FloatArray


def ls_epoch(
    g: Geometry, law: LeastSquaresLaw, *, alarm: str, p_fa: float, alert: AlertLimits, component: int = UP
) -> LsEpoch:
    """The quantities of a single epoch; ``alarm``, ``p_fa`` and ``alert`` as for `pl_mc.worst_case`.

    Of a horizontal ``component``, EAST or NORTH, everything that is said of the vertical holds of that error and its
    share of the level: no exact law of the horizontal, but one that knows which faults move it.
    """
    require_choice(alarm, (PL_ALARM, CHI2_ALARM), field="alarm")
    quantities = ls_quantities(g)
    available, dof = bool(quantities.available), int(quantities.dof)
    vdop_m, gain = float(quantities.vdop_m), quantities.gain
    limit_m, multiplier = alert.val_m, law.k_vertical
    if component != UP:
        k = (EAST, NORTH).index(component)
        vdop_m, gain = float(np.sqrt(quantities.horizontal_cofactor[k, k])), quantities.horizontal_gain[k]
        limit_m, multiplier = alert.hal_m, law.k_horizontal
    threshold = np.nan
    if available and alarm == PL_ALARM:
        threshold = dof * (limit_m / (multiplier * vdop_m)) ** 2
    elif available:
        threshold = float(chi2_threshold(dof, p_fa))
    elif alarm == CHI2_ALARM:
        chi2_threshold(1, p_fa)  # The check of the probability.
    return LsEpoch(
        available=available,
        sigma_m=np.asarray(g.sigma_m),
        vdop_m=vdop_m,
        sensitivity=gain * np.asarray(g.sigma_m) / vdop_m,
        basis=quantities.basis,
        dof=dof,
        threshold=threshold,
        level_slope=multiplier / np.sqrt(max(dof, 1)),
        limit=limit_m / vdop_m,
    )


def ls_epochs(
    g: Geometry, law: LeastSquaresLaw, axis: str, *, alarm: str, p_fa: float, alert: AlertLimits
) -> tuple[LsEpoch, ...]:
    """`ls_epoch` of every component of the errors of an axis."""
    components = {VERTICAL: (UP,), HORIZONTAL: (EAST, NORTH), EITHER: (UP, EAST, NORTH)}[axis]
    return tuple(ls_epoch(g, law, alarm=alarm, p_fa=p_fa, alert=alert, component=each) for each in components)


def worst_direction(epoch: LsEpoch, directions: FloatArray) -> Direction:
    """The direction of largest slope among the faults ``directions @ c``.

    A direction that no residual shows counts as undetected where it moves the height, and is left out where it does
    not, such as a common bias of all satellites that share a clock. The columns (n, k) span the faults [m].
    """
    whitened = directions / epoch.sigma_m[:, None]
    # Columns of one length, so that a small singular value means little redundancy and not a small unit.
    whitened = whitened / np.linalg.norm(whitened, axis=0)
    residual = whitened - epoch.basis @ (epoch.basis.T @ whitened)
    _, values, right = np.linalg.svd(residual, full_matrices=True)
    values = np.concatenate([values, np.zeros(right.shape[0] - values.size)])
    effect = right @ (whitened.T @ epoch.sensitivity)
    seen = values >= np.sqrt(REDUNDANCY_FLOOR)
    hidden = ~seen & (np.abs(effect) > _NO_EFFECT)
    if hidden.any():
        unseen = (whitened @ (right.T @ np.where(hidden, effect, 0.0))) * epoch.sigma_m
        return Direction(np.inf, unseen / np.linalg.norm(unseen))
    per_unit = np.where(seen, effect / np.where(seen, values, 1.0), 0.0)
    slope = float(np.linalg.norm(per_unit))
    if slope <= _NO_EFFECT:
        # No fault of this kind moves the height; any of them will do, and the worst size is none.
        return Direction(0.0, directions[:, 0])
    step = right.T @ np.where(seen, per_unit / np.where(seen, values, 1.0), 0.0)
    return Direction(slope, (whitened @ step) * epoch.sigma_m / slope)


def event_probability(epoch: LsEpoch, event: str, shift: ArrayLike, root: ArrayLike) -> FloatArray:
    """P(event) of faults (...) at an available epoch, relative accuracy 1e-9.

    A fault is its mean vertical error ``shift``, in standard deviations, and the root of the noncentrality of V'PV.
    """
    shift, root = np.abs(shift), np.asarray(root, dtype=float)
    if event == MISSED:
        return epoch.hazard(shift) * quiet_probability(epoch, root)
    return np.minimum(joint_exceedance(epoch.threshold, epoch.dof, root**2, epoch.level_slope, shift)[0], 1.0)


def quiet_probability(epoch: LsEpoch, root: ArrayLike) -> FloatArray:
    """P(no alarm) at each root of the noncentrality (...)."""
    return split_at_threshold(epoch.threshold, epoch.dof, np.asarray(root, dtype=float) ** 2)[0]


def alarm_probability(epoch: LsEpoch, root: ArrayLike) -> FloatArray:
    """P(alarm) at each root of the noncentrality (...), with the relative accuracy of a small one."""
    return split_at_threshold(epoch.threshold, epoch.dof, np.asarray(root, dtype=float) ** 2)[1]


def upper_bound(epoch: LsEpoch, event: str, shift: ArrayLike, root: ArrayLike) -> FloatArray:
    """A bound of `event_probability` that costs no integral; the arguments are the same.

    sqrt(V'PV) is at least B, its component along the fault, Normal(root, 1): without an alarm B <= sqrt(threshold),
    and an error A beyond the level has A > slope B or -A > slope B.
    """
    shift, root = np.abs(shift), np.asarray(root, dtype=float)
    quiet = special.ndtr(np.sqrt(epoch.threshold) - root)
    if event == MISSED:
        return quiet * epoch.hazard(shift)
    steep = epoch.level_slope
    length = np.hypot(1.0, steep)
    beyond = special.ndtr((shift - steep * root) / length) + special.ndtr((-shift - steep * root) / length)
    return np.minimum(quiet, beyond)


def peaks(epoch: LsEpoch, event: str, slopes: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """The worst size along directions of given slopes: root of the noncentrality (m,) and probability (m,).

    A scan over all sizes at which the probability is not below the smallest double, then every peak of it that may
    be the highest is narrowed down. Both signs of a fault are equally likely to be missed. An infinite slope gives
    an infinite size and P(no alarm) without a fault, which the probability approaches.
    """
    slopes = np.atleast_1d(np.asarray(slopes, dtype=float))
    best_root, best = np.full(slopes.size, np.inf), np.full(slopes.size, float(quiet_probability(epoch, 0.0)))
    rows = np.flatnonzero(np.isfinite(slopes))
    if rows.size == 0:
        return best_root, best
    # From 0 to where an alarm is certain.
    last = np.sqrt(epoch.threshold) + _REACH
    steps = int(np.clip(_STEPS_PER_UNIT * last, _FEWEST_STEPS, _MOST_STEPS))
    scan = np.linspace(0.0, last, steps + 1)
    values = _along(epoch, event, slopes[rows], np.broadcast_to(scan, (rows.size, scan.size)), shared=True)
    place, peak = _peaks_of(values)
    low, high = scan[np.maximum(peak - 1, 0)], scan[np.minimum(peak + 1, scan.size - 1)]
    found, top = _refine(epoch, event, slopes[rows][place], low, high)
    for k, row in enumerate(rows):
        own = np.flatnonzero(place == k)
        first = own[top[own].argmax()]
        best_root[row], best[row] = found[first], top[first]
        if top[first] <= values[k, 0] * (1.0 + _FLAT):
            best_root[row], best[row] = 0.0, values[k, 0]
    return best_root, best


def _along(epoch: LsEpoch, event: str, slopes: FloatArray, roots: FloatArray, *, shared: bool = False) -> FloatArray:
    """The event's probability (m, points) at roots (m, points) along directions of these slopes (m,)."""
    shift = slopes[:, None] * roots
    if event == MISSED and shared:
        # The same roots in every row: the integral is done once.
        return epoch.hazard(shift) * quiet_probability(epoch, roots[0])
    # Far beyond the alarm nothing is left to integrate.
    alive = upper_bound(epoch, event, shift, roots) > 0.0
    values = np.zeros(roots.shape)
    values[alive] = event_probability(epoch, event, shift[alive], roots[alive])
    return values


def _peaks_of(values: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of the local maxima of (m, points) that may be the highest of their row."""
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=-np.inf)
    # Of equal neighbours the first counts, so that a row of zeros has one peak.
    local = (values > padded[:, :-2]) & (values >= padded[:, 2:])
    height = np.where(local, values, -np.inf)
    order = np.argsort(-height, axis=1, kind="stable")[:, :_MOST_PEAKS]
    tall = np.take_along_axis(height, order, axis=1)
    row, which = np.nonzero((tall >= _WORTH_REFINING * tall[:, :1]) & (tall > -np.inf))
    return row, order[row, which]


def _refine(
    epoch: LsEpoch, event: str, slopes: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The top of the peak inside each bracket: root (m,) and probability (m,)."""
    rows = np.arange(slopes.size)
    for _ in range(_ROUNDS):
        roots = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _POINTS)
        values = _along(epoch, event, slopes, roots)
        at = values.argmax(axis=1)
        low, high = roots[rows, np.maximum(at - 1, 0)], roots[rows, np.minimum(at + 1, _POINTS - 1)]
    return roots[rows, at], values[rows, at]


def require_event(event: str) -> str:
    """``event`` if its worst case can be asked for."""
    return require_choice(event, EVENTS, field="event")


def law_with(
    alarm: str, method: Method, *, estimated: bool, axis: str = VERTICAL, single: bool = False
) -> LeastSquaresLaw | None:
    """The exact law of a method; None where it has none, or estimates take its place.

    They do so horizontally unless ``single`` satellites fail, and where either limit decides.

    Raises:
        InputError: another alarm than that of the level, which only an exact law can have.
    """
    if axis != VERTICAL and alarm != PL_ALARM:
        raise InputError(f"alarm: {alarm!r} is for exact worst cases of the vertical error; take {PL_ALARM!r}.")
    estimated = estimated or axis not in ((VERTICAL, HORIZONTAL) if single else (VERTICAL,))
    found = None if estimated else exact_law(method)
    # Of a level that no residual changes worst cases have no closed form here.
    law = found if isinstance(found, LeastSquaresLaw) else None
    if law is None and alarm != PL_ALARM:
        field = f"alarm: {alarm!r} is for exact laws, {PL_ALARM!r} for estimates too"
        raise refusal(method, "exact_law", able=exact_law, field=field)
    return law
