"""The table of a sweep: counts, rates and their confidence bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.engine.events import EVENTS
from pl_mc.engine.plan import Plan
from pl_mc.statistics.intervals import clopper_pearson, shared_noise_bounds

CONFIDENCE = 0.95

_COUNTS = ["draws", *(event.count for event in EVENTS)]


def rate_table(plan: Plan, counts: NDArray[np.int64], methods: Sequence[str], draws: int) -> pd.DataFrame:
    """One row per epoch, method and fault.

    Args:
        plan: the sweep's plan.
        counts: (epochs, width, methods, events), as `Plan.fault_index` orders them.
        methods: method names.
        draws: draws behind every count.
    """
    place, slot = np.nonzero(plan.fault_index >= 0)
    fault = plan.fault_index[place, slot]
    kept = counts[place, slot]  # (rows, methods, events)
    rows = len(place)
    labels = np.array(plan.faults.labels, dtype=object)
    columns: dict[str, object] = {
        "epoch": np.repeat(plan.geometry.epoch[plan.epochs[place]], len(methods)),
        "method": np.tile(np.array(methods, dtype=object), rows),
        "fault": np.repeat(labels[fault], len(methods)),
        "bias_m": np.repeat(plan.faults.scalar_bias_m[fault], len(methods)),
        "draws": np.full(rows * len(methods), draws, dtype=np.int64),
    }
    flat = kept.reshape(rows * len(methods), len(EVENTS))
    for k, event in enumerate(EVENTS):
        columns[event.count] = flat[:, k]
    table = with_rates(pd.DataFrame(columns))
    # Epoch by epoch, then method by method, the faults in the order in which they were asked for.
    order = np.lexsort(
        (
            np.repeat(fault, len(methods)),
            np.tile(np.arange(len(methods)), rows),
            np.repeat(place, len(methods)),
        )
    )
    return table.iloc[order].reset_index(drop=True)


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
        columns |= {f"{event.name}_rate": seen / draws, f"{event.name}_low": low, f"{event.name}_high": high}
    return pd.concat([counts, pd.DataFrame(columns, index=counts.index)], axis=1)


def sum_over_epochs(table: pd.DataFrame) -> pd.DataFrame:
    """One row per method and fault: counts and draws summed over epochs, rates and bounds of the sums.

    Epochs have noise of their own, so all draws of a fault are independent; the bounds are those of the mean rate
    over its epochs.
    """
    counts = table.groupby(["method", "fault", "bias_m"], sort=False, dropna=False)[_COUNTS].sum()
    return with_rates(counts.reset_index())


def sum_over_faults(table: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """One row per value of ``keys`` (with ``method`` among them): counts summed over all else.

    Faults of one epoch share their noise: ``independent_draws`` counts the draws of each epoch once.
    """
    groups = table.groupby(list(keys), sort=False, dropna=False)
    counts = groups[_COUNTS].sum()
    epochs = table.drop_duplicates([*keys, "epoch"]).groupby(list(keys), sort=False, dropna=False)
    counts.insert(1, "independent_draws", epochs["draws"].sum())
    return with_rates(counts.reset_index())
