"""The worst bias on one satellite for the horizontal error of least squares: exact, and found in one dimension.

A bias moves the two components of the error along one direction and V'PV along another, both in proportion to its size.
So its event is an integral for every size (`pl_mc.statistics.length`), of which the largest is searched for. For two
satellites and more the direction of the error would have to be searched for as well, which nothing here does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from pl_mc.alert import HORIZONTAL, AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.worst.ls_exact import MISSED
from pl_mc.integrity_risk.worst.search import GRID_M, bias_columns, fault_columns
from pl_mc.kernels.linear_model import REDUNDANCY_FLOOR
from pl_mc.statistics.exact import LeastSquaresLaw, horizontal_errors
from pl_mc.statistics.least_squares import fault_effects, ls_quantities
from pl_mc.statistics.length import LEAST_RATIO, joint_length_exceedance, length_beyond
from pl_mc.statistics.noncentral import REACH, split_at_threshold

# Sizes of the scan are so far apart, in roots of the noncentrality, and the probability changes within about one.
_STEP = 1.0
# Each round narrows the bracket of a peak four times; peaks of the scan far below its largest value are left.
_ROUNDS, _POINTS = 3, 9
_WORTH_REFINING, _MOST_PEAKS = 0.1, 2
# A direction of unit length moves the position by about one standard deviation; below this share the rest is rounding.
_NO_EFFECT = 1e-9


@dataclass(frozen=True)
class HorizontalFaults:
    """What a metre of bias on each satellite of an epoch does to least squares, in the horizontal error's larger sigma.

    Attributes:
        sigma_m: (n,), standard deviation of each pseudorange [m].
        largest_m: larger standard deviation of the horizontal error [m], the unit of the others.
        ratio: the smaller one over it.
        toward: (n, 2), mean error along both principal axes, the larger first, per metre.
        root: (n,), root of the noncentrality of V'PV per metre.
        dof, threshold: degrees of freedom of V'PV, and its value beyond which there is an alarm.
        slope: protection level per sqrt(V'PV).
        limit: HAL.
    """

    sigma_m: FloatArray
    largest_m: float
    ratio: float
    toward: FloatArray
    root: FloatArray
    dof: int
    threshold: float
    slope: float
    limit: float

    @classmethod
    def of(cls, g: Geometry, law: LeastSquaresLaw, alert: AlertLimits) -> HorizontalFaults:
        """Of a single epoch with redundancy."""
        quantities = ls_quantities(g)
        each = Faults.from_array(g, np.eye(len(g.names)))
        effects, dof = fault_effects(g, each, quantities), int(quantities.dof)
        largest_m, ratio, major, minor = horizontal_errors(quantities, effects, np.ones(len(g.names), bool))
        level_m, limit_m = law.k_horizontal * float(quantities.hdop_m), alert.limit_m[HORIZONTAL]
        return cls(
            sigma_m=np.asarray(g.sigma_m), largest_m=float(largest_m[0]),
            ratio=float(np.clip(ratio[0], LEAST_RATIO, 1.0)),
            toward=np.column_stack([major, minor]), root=np.sqrt(effects.noncentrality), dof=dof,
            threshold=dof * (limit_m / level_m) ** 2, slope=level_m / (float(largest_m[0]) * np.sqrt(max(dof, 1))),
            limit=limit_m / float(largest_m[0]),
        )  # fmt: skip

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """(n,), satellites whose biases move the position and no residual."""
        moves = np.hypot(*self.toward.T) * self.sigma_m > _NO_EFFECT
        return moves & (self.root * self.sigma_m < np.sqrt(REDUNDANCY_FLOOR))

    def quiet(self, root: FloatArray) -> FloatArray:
        """P(no alarm) at each root of the noncentrality (...)."""
        return split_at_threshold(self.threshold, self.dof, np.asarray(root) ** 2)[0]

    def probability(self, event: str, satellite: int, size_m: FloatArray) -> FloatArray:
        """(sizes,), P(event) under biases of these sizes on a satellite, by its place."""
        root, (major, minor) = self.root[satellite] * size_m, self.toward[satellite][:, None] * size_m
        if event == MISSED:
            return length_beyond(self.limit, self.ratio, major, minor)[1] * self.quiet(root)
        joint = joint_length_exceedance(
            self.threshold, self.dof, root**2, self.slope, self.ratio, major, minor, above=False
        )
        return np.minimum(joint[0], 1.0)

    def worst(self, event: str, satellite: int) -> tuple[float, float]:
        """Size [m] and probability of the worst bias; infinite where no residual shows it."""
        if self.hidden[satellite]:
            return np.inf, float(self.quiet(np.zeros(1))[0])
        per_metre = float(self.root[satellite])
        if np.hypot(*self.toward[satellite]) * self.sigma_m[satellite] <= _NO_EFFECT or per_metre == 0.0:
            return 0.0, float(self.probability(event, satellite, np.zeros(1))[0])
        alarm = np.sqrt(self.threshold)
        scan = np.linspace(0.0, alarm + REACH, int((alarm + REACH) / _STEP) + 2)
        # sqrt(V'PV) is at least its component along the fault, which is below the threshold without an alarm.
        bound, values = special.ndtr(alarm - scan), np.zeros(scan.size)
        near = scan <= alarm + 2.0 * _STEP
        values[near] = self.probability(event, satellite, scan[near] / per_metre)
        further = ~near & (bound > _WORTH_REFINING * values.max())
        values[further] = self.probability(event, satellite, scan[further] / per_metre)
        found = [self._refined(event, satellite, scan, at) for at in _peaks(values)]
        return max([(float(scan[values.argmax()] / per_metre), float(values.max())), *found], key=lambda one: one[1])

    def largest_of(self, event: str, satellite: int, size_m: FloatArray) -> tuple[float, float]:
        """The size [m] with the largest probability, of some in order, and that probability."""
        # After the first size only those that could be worse.
        values, bound = np.zeros(size_m.size), special.ndtr(np.sqrt(self.threshold) - self.root[satellite] * size_m)
        values[:1] = self.probability(event, satellite, size_m[:1])
        further = np.flatnonzero(bound > values[0])
        further = further[further > 0]
        values[further] = self.probability(event, satellite, size_m[further])
        return float(size_m[values.argmax()]), float(values.max())

    def _refined(self, event: str, satellite: int, scan: FloatArray, at: int) -> tuple[float, float]:
        """Size [m] and probability at the top of a peak of the scan."""
        low, high = scan[max(at - 1, 0)], scan[min(at + 1, scan.size - 1)]
        for _ in range(_ROUNDS):
            roots = np.linspace(low, high, _POINTS)
            values = self.probability(event, satellite, roots / self.root[satellite])
            best = int(values.argmax())
            low, high = roots[max(best - 1, 0)], roots[min(best + 1, _POINTS - 1)]
        place = roots[best]
        if 0 < best < _POINTS - 1 and values[best - 1] > 0 and values[best + 1] > 0:
            # The top of the parabola through the logarithms about it.
            before, top, after = np.log(values[best - 1 : best + 2])
            if before - 2.0 * top + after < 0.0:
                place += 0.5 * (roots[1] - roots[0]) * (before - after) / (before - 2.0 * top + after)
        size_m = place / self.root[satellite]
        return float(size_m), float(self.probability(event, satellite, np.array([size_m]))[0])


def _peaks(values: FloatArray) -> list[int]:
    """Places of the local maxima that may be the highest, the highest first."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    local = np.flatnonzero((values > padded[:-2]) & (values >= padded[2:]) & (values > 0.0))
    tall = local[np.argsort(-values[local], kind="stable")][:_MOST_PEAKS]
    return [int(k) for k in tall if values[k] >= _WORTH_REFINING * values.max()]


def horizontal_table(
    g: Geometry, law: LeastSquaresLaw, alert: AlertLimits, event: str, groups: Sequence[tuple[int, ...]]
) -> pd.DataFrame:
    """The worst bias of each satellite, of groups of one, with the columns of `pl_mc.worst_case` for exact laws."""
    worst, grid = np.zeros((2, len(groups), 2))
    effect_m, root, alarm = np.full((3, len(groups)), np.nan)
    if bool(ls_quantities(g).available):
        faults = HorizontalFaults.of(g, law, alert)
        for k, (satellite,) in enumerate(groups):
            size_m, probability = worst[k] = faults.worst(event, satellite)
            grid[k] = faults.largest_of(event, satellite, GRID_M)
            if np.isfinite(size_m):
                effect_m[k] = size_m * float(np.hypot(*faults.toward[satellite])) * faults.largest_m
                root[k] = size_m * faults.root[satellite]
            elif probability > 0:
                effect_m[k], root[k] = np.inf, 0.0
        seen = np.isfinite(root)
        alarm[seen] = split_at_threshold(faults.threshold, faults.dof, root[seen] ** 2)[1]
    else:
        alarm[:] = 1.0
    bias, on_grid = np.zeros((2, len(groups), len(g.names)))
    for k, (satellite,) in enumerate(groups):
        # No size where the probability is zero.
        bias[k, satellite] = worst[k, 0]
        bias[k] = bias[k] if worst[k, 1] > 0 else np.nan
        on_grid[k, satellite] = grid[k, 0]
        on_grid[k] = on_grid[k] if grid[k, 1] > 0 else np.nan
    return pd.DataFrame(
        {
            **fault_columns(g, groups, bias),
            "probability": worst[:, 1],
            "standard_error": 0.0,
            "low": worst[:, 1],
            "high": worst[:, 1],
            "horizontal_m": np.where(worst[:, 1] > 0, effect_m, np.nan),
            "noncentrality": np.where(worst[:, 1] > 0, root**2, np.nan),
            "alarm_rate": alarm,
            **bias_columns(groups, on_grid, "grid_"),
            "grid_probability": grid[:, 1],
        }
    )
