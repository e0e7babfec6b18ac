"""The worst size of a fault on one satellite, for a method without exact probabilities, however rare the event.

The search looks at curves of the probability against the size (`pl_mc.integrity_risk.worst.bias_curve`): a coarse
one for each satellite, and for the worst satellites a finer one about the best size. The probability that is
reported comes from neither but from a last estimate with noise of its own, so that choosing the largest does not
bias it. A fault and its negative are equally bad: positive sizes alone are searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.worst.bias_curve import (
    LEAST_ESS,
    SIZES_M,
    BiasCurve,
    Explored,
    Region,
    Shared,
    coarse_curve,
    explore,
    finer_curve,
)
from pl_mc.integrity_risk.worst.search import GRID_M, NO_ESTIMATE, Search, heights, last_estimates, searched_table
from pl_mc.runtime.threads import cores, in_order

# Sizes at which the finer curve is looked up.
_LOOKS = 41
_CHECKS = ("subset_probability", "subset_standard_error")

EXPLORED, CURVES, REFINED = "explored", "curves", "refined"


def single_table(g: Geometry, rows: Sequence[int], region: Region, search: Search) -> pd.DataFrame:
    """One row per satellite, of an epoch with redundancy; the columns are explained at `pl_mc.worst_case`."""
    count = SIZES_M.size
    traces = np.concatenate([SIZES_M[:, None] * region.traces[row] for row in rows])

    def source(stage: int, place: int) -> np.random.Generator:
        return np.random.default_rng((search.seed, int(g.epoch), stage, place))

    def population(place: int) -> Explored:
        return explore(region, traces[place], source(1, place))

    def coarse(j: int) -> BiasCurve:
        own = found[j * count : (j + 1) * count]
        return coarse_curve(region, own, shared, region.traces[rows[j]], source(2, j))

    def finer(j: int) -> BiasCurve:
        return finer_curve(region, curves[j], *_bracket(size[j]), source(3, j))

    found = [one for _, one in in_order(population, range(len(traces)), cores())]
    shared = Shared.of(found, traces)
    curves = [one for _, one in in_order(coarse, range(len(rows)), cores(), compiled=True)]
    table, size = _searched(curves, found)
    chosen = np.argsort(-heights(table), kind="stable")[: search.refine]
    chosen = chosen[table["probability"].to_numpy()[chosen] > 0]
    second = [one for _, one in in_order(finer, [int(j) for j in chosen], cores(), compiled=True)]
    for j, curve in zip(chosen, second, strict=True):
        sizes = np.linspace(*_bracket(size[j]), _LOOKS)
        values = np.nan_to_num(curve.known(sizes), nan=-1.0)
        size[j] = sizes[values.argmax()] if values.max() > 0 else size[j]
    bias = _on(g, rows, size)
    spent = {EXPLORED: sum(one.evaluations for one in found)}
    spent[CURVES] = sum(one.evaluations for one in (*curves, *second))
    spent[REFINED] = last_estimates(g, table, chosen, bias, search, doubts=list(table["warning"]), also=_CHECKS)
    groups = [(row,) for row in rows]
    grid_m = _on(g, rows, table["grid_m"].to_numpy())
    whole = searched_table(g, groups, bias, table, grid_m, chosen, also=_CHECKS)
    whole.attrs["evaluations"] = spent
    return whole


def _searched(curves: Sequence[BiasCurve], found: Sequence[Explored]) -> tuple[pd.DataFrame, FloatArray]:
    """What the coarse curves say of each satellite, and its best size (satellites,) [m]."""
    looked = np.union1d(SIZES_M, GRID_M)
    on_grid = np.isin(looked, GRID_M)
    rows: list[dict[str, Any]] = []
    sizes: list[float] = []
    for j, curve in enumerate(curves):
        value, error, ess = curve.at(SIZES_M)
        known = np.where(ess >= LEAST_ESS, value, -1.0)
        best = int(known.argmax())
        if known[best] <= 0:
            sizes.append(np.nan)
            rows.append(dict.fromkeys(("probability", "standard_error"), np.nan) | {"low": 0.0, "high": 1.0})
            rows[-1] |= {"grid_m": np.nan, "grid_probability": np.nan, "warning": NO_ESTIMATE}
            continue
        cov = error[best] / value[best]
        reach = np.exp(min(float(special.stdtrit(ess[best] - 1.0, 0.975)) * cov, 700.0))
        grid = np.where(on_grid, np.nan_to_num(curve.known(looked), nan=-1.0), -1.0)
        top = int(grid.argmax())
        open_m = curve.open_sizes(found[j * SIZES_M.size : (j + 1) * SIZES_M.size])
        doubt = f"the search cannot tell whether it is worse at {', '.join(f'{one:g}' for one in open_m)} m"
        sizes.append(SIZES_M[best])
        rows.append(
            {
                "probability": value[best],
                "standard_error": error[best],
                "low": value[best] / reach,
                "high": min(value[best] * reach, 1.0),
                "grid_m": looked[top] if grid[top] > 0 else np.nan,
                "grid_probability": grid[top] if grid[top] > 0 else np.nan,
                "warning": doubt if open_m.size else "",
            }
        )
    table = pd.DataFrame(rows)
    table[list(_CHECKS)] = np.nan
    return table, np.array(sizes)


def _on(g: Geometry, rows: Sequence[int], sizes_m: FloatArray) -> FloatArray:
    """(satellites, n), each size on its satellite [m]."""
    bias = np.zeros((len(rows), len(g.names)))
    bias[np.arange(len(rows)), list(rows)] = sizes_m
    return bias


def _bracket(size_m: float) -> tuple[float, float]:
    """The neighbours of a size of the grid."""
    k = int(np.argmin(np.abs(SIZES_M - size_m)))
    return float(SIZES_M[max(k - 1, 0)]), float(SIZES_M[min(k + 1, SIZES_M.size - 1)])
