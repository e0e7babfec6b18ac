"""The table of a sweep: counts, rates and their confidence bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.engine.events import EVENTS
from pl_mc.engine.plan import Plan
from pl_mc.statistics.intervals import clopper_pearson

CONFIDENCE = 0.95


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
    for k, event in enumerate(EVENTS):
        columns[f"{event.name}_rate"] = flat[:, k] / draws
        columns[f"{event.name}_low"], columns[f"{event.name}_high"] = clopper_pearson(flat[:, k], draws, CONFIDENCE)
    table = pd.DataFrame(columns)
    # Epoch by epoch, then method by method, the faults in the order in which they were asked for.
    order = np.lexsort(
        (
            np.repeat(fault, len(methods)),
            np.tile(np.arange(len(methods)), rows),
            np.repeat(place, len(methods)),
        )
    )
    return table.iloc[order].reset_index(drop=True)
