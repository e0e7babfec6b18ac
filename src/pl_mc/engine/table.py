"""The table of a sweep: counts, rates and their confidence bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.engine.events import EVENTS
from pl_mc.engine.task import SweepTask
from pl_mc.engine.totals import EpochTotals, FaultTotals
from pl_mc.statistics.intervals import clopper_pearson, rate_columns, shared_noise_bounds

CONFIDENCE = 0.95

COUNT_COLUMNS = ["draws", *(event.count for event in EVENTS)]


def epoch_table(task: SweepTask, totals: EpochTotals) -> pd.DataFrame:
    """One row per epoch, method and fault."""
    plan, methods = task.plan, [method.name for method in task.methods]
    place, slot = np.nonzero((plan.fault_index >= 0) & (totals.draws > 0)[:, None])
    fault = plan.fault_index[place, slot]
    kept = totals.counts[place, slot]  # (rows, methods, events)
    rows = len(place)
    columns: dict[str, object] = {
        "epoch": np.repeat(plan.geometry.epoch[plan.epochs[place]], len(methods)),
        **_names(task, np.repeat(fault, len(methods)), np.tile(np.arange(len(methods)), rows)),
        "draws": np.repeat(totals.draws[place], len(methods)),
    }
    table = with_rates(pd.DataFrame(columns | _count_columns(kept)))
    # Epoch by epoch, then method by method, the faults in the order in which they were asked for.
    order = np.lexsort(
        (np.repeat(fault, len(methods)), np.tile(np.arange(len(methods)), rows), np.repeat(place, len(methods)))
    )
    return table.iloc[order].reset_index(drop=True)


def fault_table(task: SweepTask, totals: FaultTotals) -> pd.DataFrame:
    """One row per method and fault, summed over the epochs at which it applies; none for faults that never do.

    Epochs have noise of their own, so all draws of a fault are independent; the bounds are those of the mean rate
    over its epochs.
    """
    fault = np.flatnonzero(totals.draws)
    methods = len(task.methods)
    columns = {
        **_names(task, np.tile(fault, methods), np.repeat(np.arange(methods), len(fault))),
        "epochs": np.tile(totals.epochs[fault], methods),
        "draws": np.tile(totals.draws[fault], methods),
    }
    kept = np.moveaxis(totals.counts[fault], 1, 0)  # (methods, faults, events)
    return with_rates(pd.DataFrame(columns | _count_columns(kept)))


def _names(task: SweepTask, fault: NDArray[np.int64], method: NDArray[np.int64]) -> dict[str, object]:
    return {
        "method": np.array([one.name for one in task.methods], dtype=object)[method],
        "fault": np.array(task.faults.labels, dtype=object)[fault],
        "bias_m": task.faults.scalar_bias_m[fault],
    }


def _count_columns(counts: NDArray[np.int64]) -> dict[str, object]:
    flat = counts.reshape(-1, len(EVENTS))
    return {event.count: flat[:, k] for k, event in enumerate(EVENTS)}


def with_rates(counts: pd.DataFrame) -> pd.DataFrame:
    """The table of counts with ``<event>_rate, <event>_low, <event>_high`` for every event.

    Where the table has a column ``independent_draws``, its counts are sums over faults that saw the same noise, and
    the bounds are those of `shared_noise_bounds`; else each draw stands for itself.
    """
    draws = counts["draws"].to_numpy()
    columns: dict[str, NDArray] = {}
    for event in EVENTS:
        seen = counts[event.count].to_numpy()
        if "independent_draws" in counts:
            low, high = shared_noise_bounds(seen / draws, counts["independent_draws"], CONFIDENCE)
        else:
            # The same counts come again and again; their bounds are worth computing once.
            pairs, place = np.unique(np.stack([seen, draws], axis=1), axis=0, return_inverse=True)
            low, high = (bound[place] for bound in clopper_pearson(pairs[:, 0], pairs[:, 1], CONFIDENCE))
        columns |= rate_columns(event.name, seen / draws, low, high)
    return pd.concat([counts, pd.DataFrame(columns, index=counts.index)], axis=1)


def sum_over_faults(table: pd.DataFrame, keys: Sequence[str], *, independent: pd.Series) -> pd.DataFrame:
    """One row per value of ``keys``: counts summed over all else, of faults that saw the same noise.

    Args:
        table: counts.
        keys: columns to keep.
        independent: by all or some of those keys, the draws with each epoch counted once.
    """
    counts = table.groupby(list(keys), sort=False, dropna=False)[COUNT_COLUMNS].sum().reset_index()
    shared = list(independent.index.names)
    counts = counts.merge(independent.rename("independent_draws").reset_index(), on=shared, how="left")
    return with_rates(counts[[*keys, "draws", "independent_draws", *COUNT_COLUMNS[1:]]])
