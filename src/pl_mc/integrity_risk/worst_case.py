"""The worst fault: which satellites, of what size and direction, make a dangerous event likeliest.

For least squares this is exact: the worst direction has a closed form and its size is found in one dimension
(`pl_mc.integrity_risk.ls_exact`). For any other method the event's probability is itself an estimate; the same
question is then put to the rare-event estimator, fault by fault, first coarsely and then near the top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.engine.checks import LARGEST_SEED, require_geometry_and_alert
from pl_mc.faults import Faults, fault_label, require_satellite
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_positive, require_whole
from pl_mc.integrity_risk.ls_exact import (
    LsEpoch,
    alarm_probability,
    event_probability,
    ls_epoch,
    peaks,
    require_event,
    upper_bound,
    worst_direction,
)
from pl_mc.methods import Ls, Method, as_methods

FloatArray = NDArray[np.float64]

# From faults, a target coefficient of variation and a seed to a table with one row per fault and the columns
# probability, standard_error, low, high, warning.
Estimator = Callable[[Faults, float, int], pd.DataFrame]

# The usual ramp, on which the worst size is looked for when nobody computes it: 5, 10, ..., 100 m.
GRID_M = np.arange(5.0, 101.0, 5.0)

# What the search by estimates scans: the usual ramp and both sides of it for one satellite; for two, whose number
# of directions multiplies the cost, a coarser one.
_SCAN_M = np.array([2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 150.0])
_PAIR_SCAN_M = np.array([10.0, 20.0, 40.0, 80.0])
_PAIR_RATIOS = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
_SCAN_COV, _REFINE_COV = 0.5, 0.2
_REFINE_ROUNDS = 3
_MOST_GRID_SATELLITES = 2
_NEGLIGIBLE = 1e-9

NO_ESTIMATE = "no estimate"


def worst_case(
    g: Geometry,
    *,
    method: str | Method = "ls",
    satellites: int | Sequence[str | Sequence[str]] = 1,
    alarm: Literal["pl", "chi2"] = "pl",
    event: Literal["missed", "misleading"] = "missed",
    p_fa: float = 1e-3,
    alert: AlertLimits = LPV_200,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
    refine: int = 3,
    seed: int = 0,
    estimator: Estimator | None = None,
) -> pd.DataFrame:
    """The fault of each satellite (or pair) that makes a missed or misleading event likeliest, the worst first.

    For least squares all numbers are exact. The noise has the sigma of the geometry. A fault and its negative are
    equally bad; the one with a positive bias on the first satellite is given.

    For other methods the probability is estimated, fault by fault: a scan with a coefficient of variation of
    0.5, then three rounds around the best fault of the ``refine`` worst satellites, then a last estimate of these
    with ``target_cov`` and noise of its own, so that choosing the largest of many estimates does not bias it. The
    scan of n satellites takes 12 n estimates, some seconds each where the event is rare, and that of all pairs
    12 n (n - 1); a list in ``satellites`` shortens it.

    Args:
        g: the geometry, one epoch or a series; each epoch is searched on its own.
        method: name or record of a method; the multiplier of the protection level is the record's.
        satellites: how many fail together, 1 or 2, or which: names and tuples of names, such as
            ``["G03", ("G05", "E08")]``.
        alarm: ``pl``, alarm when VPL > VAL; ``chi2`` (least squares alone), alarm when V'PV exceeds its fault-free
            quantile at ``p_fa``, with VAL as the limit of the error.
        event: ``missed``, |vertical error| > VAL and no alarm, or ``misleading``, |vertical error| > VPL and no
            alarm.
        p_fa: fault-free alarm probability of ``chi2``.
        alert: alert limits; the vertical one, VAL, is used.
        target_cov, max_evaluations, seed: of the last estimates: coefficient of variation, largest number of
            evaluations for each fault, seed; not used by least squares.
        refine: how many of the worst satellites or pairs per epoch are refined; not used by least squares.
        estimator: a function of faults, coefficient of variation and seed that gives a table with the columns
            ``probability, standard_error, low, high, warning``, one row per fault; it takes the place of the
            rare-event estimator (and of the exact probability of least squares).

    Returns:
        One row per epoch and satellite or pair, within an epoch the largest probability first: ``epoch, method,
        satellites`` (``G03`` or ``G03,E08``), ``fault`` (label), ``bias_m`` [m] (missing for pairs), for pairs
        ``bias_1_m, bias_2_m`` [m], ``probability, standard_error, low, high`` (95 %), and for comparison the
        largest probability on the usual grid of 5, 10, ..., 100 m (for pairs both sizes on the grid, with either
        relative sign): ``grid_bias_m`` (or ``grid_bias_1_m, grid_bias_2_m``) and ``grid_probability``. For least
        squares also ``vertical_m``, mean vertical error under the fault [m], ``noncentrality`` of V'PV, and
        ``alarm_rate``. For other methods also ``refined`` and ``warning``; the grid is what the scan has of it, at
        the scan's accuracy. A bias is infinite where no residual shows the fault, and missing where the
        probability is zero: at an epoch without redundancy, which always alarms, or below about 1e-290.

    Raises:
        InputError: unknown names, options outside their range, ``chi2`` for a method other than least squares.
    """
    require_geometry_and_alert(g, alert)
    require_event(event)
    (chosen,) = as_methods([method])
    exact = isinstance(chosen, Ls) and estimator is None
    if not exact and alarm != "pl":
        raise InputError(f"alarm: {alarm!r} is for exact least squares alone; use 'pl' with {chosen.name}.")
    require_whole(refine, field="refine", low=1)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    require_positive(target_cov, field="target_cov")
    parts = []
    for one in g.as_series():
        groups = satellite_groups(one, satellites, g.names)
        record = chosen if isinstance(chosen, Ls) else Ls()
        epoch = ls_epoch(one, record, alarm=alarm, p_fa=p_fa, alert=alert)
        if exact:
            table = _exact_table(one, epoch, event, groups)
        else:
            estimate: Estimator = _never
            if epoch.available:
                estimate = estimator or rare_event_estimator(
                    one, chosen, event, alert, target_cov=target_cov, max_evaluations=max_evaluations
                )
            table = _estimated_table(one, groups, estimate, target_cov=target_cov, refine=refine, seed=seed)
        table.insert(0, "epoch", int(one.epoch))
        table.insert(1, "method", chosen.name)
        parts.append(table.sort_values("probability", ascending=False, kind="stable"))
    return pd.concat([part for part in parts if len(part)] or parts[:1], ignore_index=True)


@dataclass(frozen=True)
class Worst:
    """The worst fault of each of several kinds.

    Attributes:
        bias_m: (m, n), biases [m]; infinite where no residual shows the fault, NaN where the probability is zero.
        root: (m,), root of the noncentrality.
        shift: (m,), mean vertical error in its standard deviations.
        probability: (m,).
    """

    bias_m: FloatArray
    root: FloatArray
    shift: FloatArray
    probability: FloatArray


def satellite_groups(
    g: Geometry, satellites: int | Sequence[str | Sequence[str]], names: Sequence[str] | None = None
) -> list[tuple[int, ...]]:
    """Rows of the satellites that fail together; at an epoch of a series those groups that are all in view.

    Args:
        g: one epoch.
        satellites: 1 or 2, for all satellites or pairs; or names and tuples of names.
        names: all satellites of the series.
    """
    if not isinstance(satellites, Iterable):
        number = require_whole(satellites, field="satellites", low=1, high=2)
        return list(combinations(range(len(g.names)), number))
    if isinstance(satellites, str):
        raise InputError(f"satellites: 1, 2 or a list of names is needed, such as [{satellites!r}], not a word.")
    groups = []
    known = g.names if names is None else names
    for item in satellites:
        group = (item,) if isinstance(item, str) else tuple(item)
        for name in group:
            if name not in known:
                require_satellite(g, name)
        if not group or len(set(group)) < len(group):
            raise InputError(f"satellites: different names that fail together are needed, not {group!r}.")
        if all(name in g.names for name in group):
            groups.append(tuple(g.names.index(name) for name in group))
    if not satellites:
        raise InputError("satellites: at least one name is needed.")
    return groups


def exact_worst(epoch: LsEpoch, event: str, kinds: Sequence[tuple[int, ...]] | Sequence[FloatArray]) -> Worst:
    """The worst fault of each kind under least squares.

    Args:
        epoch: the epoch.
        event: ``missed`` or ``misleading``.
        kinds: for each the rows of the satellites that fail, or columns (n, k) that span its faults [m].
    """
    n = epoch.sigma_m.size
    if not epoch.available:
        nothing = np.full(len(kinds), np.nan)
        return Worst(np.full((len(kinds), n), np.nan), nothing, nothing, np.zeros(len(kinds)))
    columns = [np.eye(n)[:, list(kind)] if isinstance(kind, tuple) else kind for kind in kinds]
    directions = [worst_direction(epoch, each) for each in columns]
    slopes = np.array([direction.slope for direction in directions])
    root, probability = peaks(epoch, event, slopes)
    bias = np.array([direction.bias_m for direction in directions]).reshape(-1, n)
    bias = np.where(np.abs(bias) > _NEGLIGIBLE * np.abs(bias).max(axis=1, keepdims=True), bias, 0.0)
    first = np.take_along_axis(bias, (bias != 0).argmax(axis=1)[:, None], axis=1)
    bias = bias * np.where(first < 0, -1.0, 1.0)
    sign = np.where(bias @ (epoch.sensitivity / epoch.sigma_m) < 0, -1.0, 1.0)
    finite = np.isfinite(root)
    size = np.where(finite, root, 0.0)[:, None] * bias
    hidden = np.where(bias != 0, np.copysign(np.inf, bias), 0.0)
    size = np.where(finite[:, None], size, hidden)
    steep = np.where(finite, slopes, 1.0)
    # With a zero added, so that no fault does not give minus zero.
    shift = np.where(finite, sign * steep * np.where(finite, root, 0.0), sign * np.inf) + 0.0
    zero = probability <= 0.0
    return Worst(
        bias_m=np.where(zero[:, None], np.nan, size),
        # A fault that no residual shows leaves V'PV as it is.
        root=np.where(zero, np.nan, np.where(finite, root, 0.0)),
        shift=np.where(zero, np.nan, shift),
        probability=probability,
    )


def rare_event_estimator(
    g: Geometry, method: Method, event: str, alert: AlertLimits, *, target_cov: float, max_evaluations: int
) -> Estimator:
    """`pl_mc.risk` as an `Estimator`; it may spend ``max_evaluations`` once ``target_cov`` is asked for."""
    # Found when needed: exact least squares has no use for the samplers and what they load.
    from pl_mc.integrity_risk.rare import FEWEST_EVALUATIONS, risk

    options: dict[str, Any] = {"event": event, "method": method, "alert": alert}

    def estimate(faults: Faults, cov: float, seed: int) -> pd.DataFrame:
        most = max_evaluations if cov <= target_cov else min(max_evaluations, FEWEST_EVALUATIONS)
        return risk(g, faults, target_cov=cov, seed=seed, max_evaluations=most, **options)

    return estimate


def _never(faults: Faults, target_cov: float, seed: int) -> pd.DataFrame:
    """The estimator of an epoch without redundancy: there is always an alarm."""
    zero = np.zeros(len(faults))
    return pd.DataFrame({"probability": zero, "standard_error": zero, "low": zero, "high": zero, "warning": ""})


def _exact_table(g: Geometry, epoch: LsEpoch, event: str, groups: Sequence[tuple[int, ...]]) -> pd.DataFrame:
    worst = exact_worst(epoch, event, groups)
    alarm = np.ones(len(groups))
    grid_bias, grid_probability = np.full_like(worst.bias_m, np.nan), np.zeros(len(groups))
    if epoch.available:
        seen = np.isfinite(worst.root)
        alarm = np.full(len(groups), np.nan)
        alarm[seen] = alarm_probability(epoch, worst.root[seen])
        grid_bias, grid_probability = _largest_on_grid(epoch, event, groups)
    return pd.DataFrame(
        {
            **_fault_columns(g, groups, worst.bias_m),
            "probability": worst.probability,
            "standard_error": 0.0,
            "low": worst.probability,
            "high": worst.probability,
            "vertical_m": worst.shift * epoch.vdop_m,
            "noncentrality": worst.root**2,
            "alarm_rate": alarm,
            **_bias_columns(groups, grid_bias, "grid_"),
            "grid_probability": grid_probability,
        }
    )


def _largest_on_grid(
    epoch: LsEpoch, event: str, groups: Sequence[tuple[int, ...]]
) -> tuple[FloatArray, FloatArray]:
    """Biases (m, n) [m] and probability (m,) of the worst fault on `GRID_M`; NaN for three satellites and more."""
    bias = np.full((len(groups), epoch.sigma_m.size), np.nan)
    best = np.full(len(groups), np.nan)
    for k, group in enumerate(groups):
        if len(group) > _MOST_GRID_SATELLITES:
            continue
        faults = np.zeros((GRID_M.size ** len(group) * 2 ** (len(group) - 1), epoch.sigma_m.size))
        faults[:, list(group)] = list(product(GRID_M, *[np.concatenate([GRID_M, -GRID_M])] * (len(group) - 1)))
        shift, root = epoch.effects(faults)
        bound = upper_bound(epoch, event, shift, root)
        # Where the bound is largest first; after it only faults that could be worse.
        first = int(bound.argmax())
        found = float(event_probability(epoch, event, shift[first], root[first]))
        others = np.flatnonzero(bound > found)
        values = event_probability(epoch, event, shift[others], root[others])
        if others.size and values.max() > found:
            first, found = int(others[values.argmax()]), float(values.max())
        best[k] = found
        bias[k] = faults[first] if found > 0 else np.nan
    return bias, best


def _estimated_table(
    g: Geometry,
    groups: Sequence[tuple[int, ...]],
    estimate: Estimator,
    *,
    target_cov: float,
    refine: int,
    seed: int,
) -> pd.DataFrame:
    """The search by estimates: scan, refinement, and a last estimate with noise that the search has not seen."""
    scans = [_scan_faults(group, len(g.names)) for group in groups]
    owner = np.repeat(np.arange(len(groups)), [len(scan) for scan in scans])
    faults = np.concatenate(scans) if scans else np.zeros((0, len(g.names)))
    scan = _estimates(g, faults, estimate, max(target_cov, _SCAN_COV), seed)
    value = _heights(scan)
    on_grid = (np.isin(np.abs(faults), GRID_M) | (faults == 0)).all(axis=1)
    bias, grid_bias = np.zeros((len(groups), len(g.names))), np.zeros((len(groups), len(g.names)))
    rows, grid_probability, warned = np.zeros(len(groups), int), np.zeros(len(groups)), [""] * len(groups)
    for k in range(len(groups)):
        mine = np.flatnonzero(owner == k)
        rows[k] = mine[value[mine].argmax()]
        bias[k] = faults[rows[k]]
        grid = mine[on_grid[mine]]
        best = grid[value[grid].argmax()]
        grid_bias[k], grid_probability[k] = faults[best], scan["probability"].iloc[best]
        unknown = int(scan["probability"].iloc[mine].isna().sum())
        warned[k] = f"{unknown} of {mine.size} faults of the scan have no estimate" if unknown else ""
    table = scan.iloc[rows].reset_index(drop=True)
    chosen = np.argsort(-_heights(table), kind="stable")[:refine]
    bias[chosen] = _climb(g, bias[chosen], [groups[k] for k in chosen], estimate, seed)
    if chosen.size:
        # Another seed: the largest of many estimates is too large on average, a fresh one is not.
        last = _estimates(g, bias[chosen], estimate, target_cov, (seed + 1) % (LARGEST_SEED + 1))
        for column in last:
            table.loc[chosen, column] = last[column].to_numpy()
    notes = ["; ".join(filter(None, pair)) for pair in zip(table["warning"], warned, strict=True)]
    return pd.DataFrame(
        {
            **_fault_columns(g, groups, bias),
            **{name: table[name] for name in ("probability", "standard_error", "low", "high")},
            **_bias_columns(groups, grid_bias, "grid_"),
            "grid_probability": grid_probability,
            "refined": np.isin(np.arange(len(groups)), chosen),
            "warning": np.array(notes, dtype=object),
        }
    )


def _scan_faults(group: tuple[int, ...], n: int) -> FloatArray:
    """(faults, n), what is scanned of one satellite or a pair [m]; a fault and its negative are equally bad."""
    if len(group) > _MOST_GRID_SATELLITES:
        raise InputError(f"satellites: the search by estimates takes 1 or 2 at a time, not {len(group)}.")
    if len(group) == 1:
        faults = np.zeros((_SCAN_M.size, n))
        faults[:, group[0]] = _SCAN_M
        return faults
    faults = np.zeros((_PAIR_SCAN_M.size * len(_PAIR_RATIOS), n))
    sizes, ratios = (part.reshape(-1) for part in np.meshgrid(_PAIR_SCAN_M, _PAIR_RATIOS, indexing="ij"))
    # The larger of both has the scanned size.
    faults[:, group[0]] = sizes / np.maximum(1.0, np.abs(ratios))
    faults[:, group[1]] = faults[:, group[0]] * ratios
    return faults


def _climb(
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
        values = _heights(_estimates(g, faults, estimate, _REFINE_COV, seed))
        for k in range(len(groups)):
            mine = np.flatnonzero(place == k)
            best = mine[values[mine].argmax()]
            bias_m[k] = faults[best]
    return bias_m


def _estimates(g: Geometry, bias_m: FloatArray, estimate: Estimator, target_cov: float, seed: int) -> pd.DataFrame:
    """One row per fault (f, n); a probability is missing where the estimator has none to give."""
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
    table = table[columns].reset_index(drop=True)
    notes = table["warning"].fillna("")
    table["warning"] = notes.mask((notes == "") & table["probability"].isna(), NO_ESTIMATE)
    return table.astype(dict.fromkeys(columns[:-1], float))


def _heights(table: pd.DataFrame) -> FloatArray:
    """Probabilities for comparison: a fault without an estimate is never the worst."""
    return table["probability"].fillna(-1.0).to_numpy()


def _fault_columns(g: Geometry, groups: Sequence[tuple[int, ...]], bias_m: FloatArray) -> dict[str, Any]:
    labels = []
    for group, row in zip(groups, bias_m, strict=True):
        known = not np.isnan(row).any()
        labels.append(fault_label({g.names[i]: row[i] for i in group}) if known else "")
    return {
        "satellites": np.array([",".join(g.names[i] for i in group) for group in groups], dtype=object),
        "fault": np.array(labels, dtype=object),
        **_bias_columns(groups, bias_m),
    }


def _bias_columns(groups: Sequence[tuple[int, ...]], bias_m: FloatArray, prefix: str = "") -> dict[str, FloatArray]:
    """``bias_m``, and ``bias_1_m, bias_2_m, ...`` where several satellites fail together."""
    single = [row[group[0]] if len(group) == 1 else np.nan for group, row in zip(groups, bias_m, strict=True)]
    columns = {f"{prefix}bias_m": np.array(single, dtype=float)}
    most = max((len(group) for group in groups), default=1)
    for k in range(most if most > 1 else 0):
        values = [row[group[k]] if k < len(group) else np.nan for group, row in zip(groups, bias_m, strict=True)]
        columns[f"{prefix}bias_{k + 1}_m"] = np.array(values, dtype=float)
    return columns
