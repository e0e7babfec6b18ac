"""The worst fault by estimates: scan, climb, and a last estimate with noise that the search has not seen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.faults import Faults, fault_label
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.rare.risk import FEWEST_EVALUATIONS, risk
from pl_mc.methods import Method

# From faults, a target coefficient of variation and a seed to a table with one row per fault and the columns
# probability, standard_error, low, high, warning.
Estimator = Callable[[Faults, float, int], pd.DataFrame]

# The usual ramp, on which the worst size is looked for when nobody computes it: 5, 10, ..., 100 m.
GRID_M = np.arange(5.0, 101.0, 5.0)

# What is scanned: the usual ramp and both sides of it for one satellite; for two, whose number of directions
# multiplies the cost, a coarser one.
_SCAN_M = np.array([2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 150.0])
_PAIR_SCAN_M = np.array([10.0, 20.0, 40.0, 80.0])
PAIR_RATIOS = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
_SCAN_COV, _REFINE_COV = 0.5, 0.2
_REFINE_ROUNDS = 3
MOST_SATELLITES = 2

NO_ESTIMATE = "no estimate"
_COUNTS = ("evaluations", "subset_evaluations")


@dataclass(frozen=True)
class Search:
    """What all searches by estimates are given.

    Attributes:
        estimate: the estimator.
        target_cov: coefficient of variation of the last estimates.
        refine: how many groups get one.
        seed: of the search; last estimates have another.
    """

    estimate: Estimator
    target_cov: float
    refine: int
    seed: int


def rare_event_estimator(
    g: Geometry, method: Method, event: str, alert: AlertLimits, axis: str, *, target_cov: float, max_evaluations: int
) -> Estimator:
    """`pl_mc.risk` as an `Estimator`; it may spend ``max_evaluations`` once ``target_cov`` is asked for."""
    options: dict[str, Any] = {"event": event, "method": method, "alert": alert, "axis": axis}

    def estimate(faults: Faults, cov: float, seed: int) -> pd.DataFrame:
        most = max_evaluations if cov <= target_cov else min(max_evaluations, FEWEST_EVALUATIONS)
        return risk(g, faults, target_cov=cov, seed=seed, max_evaluations=most, **options)

    return estimate


def no_events(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
    """The estimator of an epoch without redundancy: there is always an alarm."""
    zero = np.zeros(len(faults))
    return pd.DataFrame({"probability": zero, "standard_error": zero, "low": zero, "high": zero, "warning": ""})


def estimated_table(g: Geometry, groups: Sequence[tuple[int, ...]], search: Search) -> pd.DataFrame:
    """The search by estimates: scan, refinement, and a last estimate with noise that the search has not seen."""
    scans = [scan_faults(group, len(g.names), _SCAN_M if len(group) == 1 else _PAIR_SCAN_M) for group in groups]
    owner = np.repeat(np.arange(len(groups)), [len(scan) for scan in scans])
    faults = np.concatenate(scans) if scans else np.zeros((0, len(g.names)))
    scan = estimates(g, faults, search.estimate, max(search.target_cov, _SCAN_COV), search.seed)
    value = heights(scan)
    on_grid = (np.isin(np.abs(faults), GRID_M) | (faults == 0)).all(axis=1)
    bias, grid_bias = np.zeros((len(groups), len(g.names))), np.zeros((len(groups), len(g.names)))
    rows, grid_probability, warned = np.zeros(len(groups), int), np.zeros(len(groups)), [""] * len(groups)
    for k in range(len(groups)):
        own = np.flatnonzero(owner == k)
        rows[k] = own[value[own].argmax()]
        bias[k] = faults[rows[k]]
        grid = own[on_grid[own]]
        best = grid[value[grid].argmax()]
        grid_bias[k], grid_probability[k] = faults[best], scan["probability"].iloc[best]
        unknown = int(scan["probability"].iloc[own].isna().sum())
        warned[k] = f"{unknown} of {own.size} faults of the scan have no estimate" if unknown else ""
    table = scan.iloc[rows].reset_index(drop=True)
    chosen = np.argsort(-heights(table), kind="stable")[: search.refine]
    bias[chosen] = climb_faults(g, bias[chosen], [groups[k] for k in chosen], search.estimate, search.seed)
    table["warning"] = joined(table["warning"], warned)
    last_estimates(g, table, chosen, bias, search, doubts=warned)
    return searched_table(g, groups, bias, table.assign(grid_probability=grid_probability), grid_bias, chosen)


def searched_table(
    g: Geometry, groups: Sequence[tuple[int, ...]], bias_m: FloatArray, table: pd.DataFrame, grid_m: FloatArray,
    chosen: NDArray[np.intp], *, also: Sequence[str] = (),
) -> pd.DataFrame:  # fmt: skip
    """What a search found, one row per group: its fault, columns of ``table``, the best of the grid, if refined."""
    return pd.DataFrame(
        {
            **fault_columns(g, groups, bias_m),
            **{name: table[name] for name in ("probability", "standard_error", "low", "high", *also)},
            **bias_columns(groups, grid_m, "grid_"),
            "grid_probability": table["grid_probability"],
            "refined": np.isin(np.arange(len(groups)), chosen),
            "warning": table["warning"],
        }
    )


def scan_faults(group: tuple[int, ...], n: int, sizes_m: FloatArray) -> FloatArray:
    """(faults, n), one satellite or a pair in every ratio [m]; a fault and its negative are equally bad."""
    if len(group) > MOST_SATELLITES:
        raise InputError(f"satellites: the search by estimates takes 1 or 2 at a time, not {len(group)}.")
    ratios = PAIR_RATIOS if len(group) == 2 else (0.0,)
    sizes, ratio = (part.reshape(-1) for part in np.meshgrid(sizes_m, ratios, indexing="ij"))
    faults = np.zeros((sizes.size, n))
    # The larger of both has the scanned size.
    faults[:, group[0]] = sizes / np.maximum(1.0, np.abs(ratio))
    if len(group) == 2:
        faults[:, group[1]] = faults[:, group[0]] * ratio
    return faults


def climb_faults(
    g: Geometry, bias_m: FloatArray, groups: Sequence[tuple[int, ...]], estimate: Estimator, seed: int
) -> FloatArray:
    """Better faults (m, n) [m] near given ones: in each round every size up and down by a step that halves."""
    bias_m = bias_m.copy()
    for turn in range(_REFINE_ROUNDS):
        factor = 1.0 + 0.25 / 2**turn
        tries, owner = [], []
        for k, group in enumerate(groups):
            # One satellite: its size. Two: both together, and each against the other.
            for chosen in [group] if len(group) == 1 else [group, group[:1], group[1:]]:
                for step in (factor, 1.0 / factor):
                    moved = bias_m[k].copy()
                    moved[list(chosen)] *= step
                    tries.append(moved)
                    owner.append(k)
        if not tries:
            break
        # The centre once more, so that it is compared at the same accuracy.
        faults = np.concatenate([bias_m, tries])
        place = np.concatenate([np.arange(len(groups)), owner])
        values = heights(estimates(g, faults, estimate, _REFINE_COV, seed))
        for k in range(len(groups)):
            own = np.flatnonzero(place == k)
            best = own[values[own].argmax()]
            bias_m[k] = faults[best]
    return bias_m


def estimates(
    g: Geometry, bias_m: FloatArray, estimate: Estimator, target_cov: float, seed: int, *, also: Sequence[str] = ()
) -> pd.DataFrame:
    """One row per fault (f, n), with columns ``also`` besides; no probability where the estimator has none."""
    columns = ["probability", "standard_error", "low", "high", "warning"]
    if not len(bias_m):
        return pd.DataFrame({name: pd.Series(dtype=object if name == "warning" else float) for name in columns})
    table = estimate(Faults.from_array(g, bias_m), target_cov, seed)
    missing = [name for name in columns if name not in table]
    if missing or len(table) != len(bias_m):
        raise InputError(
            f"estimator: one row for each of {len(bias_m)} faults with {', '.join(columns)} is needed, not "
            f"{len(table)} rows with {', '.join(map(str, table.columns))}."
        )
    table = table[[*columns, *also]].reset_index(drop=True)
    notes = table["warning"].fillna("")
    table["warning"] = notes.mask((notes == "") & table["probability"].isna(), NO_ESTIMATE)
    return table.astype(dict.fromkeys(columns[:-1], float))


def last_estimates(
    g: Geometry, table: pd.DataFrame, chosen: NDArray[np.intp], bias_m: FloatArray, search: Search, *,
    doubts: Sequence[str], also: Sequence[str] = (),
) -> int:  # fmt: skip
    """Put estimates with noise that the search has not seen into the chosen rows (c,) of its table.

    Of many estimates the largest is too large on average, a fresh one is not. Faults are (groups, n) [m]; what the
    search says against itself, for each group, stands behind the estimate's warning. Gives the number of scenarios
    computed, as far as the estimator says.
    """
    if not chosen.size:
        return 0
    spent = 0

    def counting(faults: Faults, cov: float, fresh_seed: int) -> pd.DataFrame:
        nonlocal spent
        made = search.estimate(faults, cov, fresh_seed)
        spent += sum(int(made[column].sum()) for column in _COUNTS if column in made)
        return made

    fresh = (search.seed + 1) % (LARGEST_SEED + 1)
    last = estimates(g, bias_m[chosen], counting, search.target_cov, fresh, also=also)
    last["warning"] = joined(last["warning"], [doubts[k] for k in chosen])
    for column in last:
        table.loc[chosen, column] = last[column].to_numpy()
    return spent


def joined(first: Iterable[str], second: Iterable[str]) -> NDArray[np.object_]:
    """Pairs of warnings, each made one."""
    return np.array(["; ".join(filter(None, pair)) for pair in zip(first, second, strict=True)], dtype=object)


def heights(table: pd.DataFrame) -> FloatArray:
    """Probabilities for comparison: a fault without an estimate is never the worst."""
    return table["probability"].fillna(-1.0).to_numpy()


def fault_columns(g: Geometry, groups: Sequence[tuple[int, ...]], bias_m: FloatArray) -> dict[str, Any]:
    labels = []
    for group, row in zip(groups, bias_m, strict=True):
        known = not np.isnan(row).any()
        labels.append(fault_label({g.names[i]: row[i] for i in group}) if known else "")
    return {
        "satellites": np.array([",".join(g.names[i] for i in group) for group in groups], dtype=object),
        "fault": np.array(labels, dtype=object),
        **bias_columns(groups, bias_m),
    }


def bias_columns(groups: Sequence[tuple[int, ...]], bias_m: FloatArray, prefix: str = "") -> dict[str, FloatArray]:
    """``bias_m``, and ``bias_1_m, bias_2_m, ...`` where several satellites fail together."""
    single = [row[group[0]] if len(group) == 1 else np.nan for group, row in zip(groups, bias_m, strict=True)]
    columns = {f"{prefix}bias_m": np.array(single, dtype=float)}
    most = max((len(group) for group in groups), default=1)
    for k in range(most if most > 1 else 0):
        values = [row[group[k]] if k < len(group) else np.nan for group, row in zip(groups, bias_m, strict=True)]
        columns[f"{prefix}bias_{k + 1}_m"] = np.array(values, dtype=float)
    return columns
