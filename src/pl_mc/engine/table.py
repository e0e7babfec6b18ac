"""The table of a sweep: counts of parts, added up over epochs or epoch by epoch, with rates and their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import VERTICAL
from pl_mc.engine.task import PartCounts, SweepTask
from pl_mc.kernels.events import EVENTS, EXCLUSIONS, Event
from pl_mc.statistics.intervals import clopper_pearson, rate_columns, shared_noise_bounds

CONFIDENCE = 0.95

# Of every sweep; `count_columns` are those of a table.
COUNT_COLUMNS = ["draws", *(event.count for event in EVENTS)]


@dataclass(frozen=True)
class FaultTotals:
    """Sums over epochs, in little memory: counts (f, rows, events) and draws (f,).

    ``fault_index`` is that of the `Plan`; ``counted``: (epochs,), the epochs of which something was counted.
    """

    counts: NDArray[np.int64]
    draws: NDArray[np.int64]
    fault_index: NDArray[np.int64]
    counted: NDArray[np.bool_]

    @classmethod
    def of(cls, task: SweepTask) -> FaultTotals:
        """Nothing counted yet."""
        faults, index = len(task.faults), task.plan.fault_index
        counts = np.zeros((faults, task.rows, len(task.events)), dtype=np.int64)
        return cls(counts, np.zeros(faults, dtype=np.int64), index, np.zeros(len(index), dtype=bool))

    @property
    def epochs(self) -> NDArray[np.int64]:
        """(f,), epochs behind the counts of each fault; those of a share of a sweep may be part of all."""
        index = self.fault_index[self.counted]
        return np.bincount(index[index >= 0], minlength=len(self.draws))

    def add(self, task: SweepTask, part: PartCounts) -> None:
        """Add a part."""
        self.counted[part.places] = True
        place, slot = np.nonzero(self.fault_index[part.places] >= 0)
        fault = self.fault_index[part.places[place], slot]
        np.add.at(self.counts, fault, part.counts[place, slot])
        np.add.at(self.draws, fault, part.draws[place])


@dataclass(frozen=True)
class EpochTotals:
    """Counts of every epoch: (epochs, width, rows, events), and draws (epochs,)."""

    counts: NDArray[np.int64]
    draws: NDArray[np.int64]

    @classmethod
    def of(cls, task: SweepTask) -> EpochTotals:
        """Nothing counted yet."""
        shape = (*task.plan.fault_index.shape, task.rows, len(task.events))
        return cls(np.zeros(shape, dtype=np.int64), np.zeros(shape[0], dtype=np.int64))

    def add(self, task: SweepTask, part: PartCounts) -> None:
        """Add a part."""
        self.counts[part.places] += part.counts
        self.draws[part.places] += part.draws


def epoch_table(task: SweepTask, totals: EpochTotals) -> pd.DataFrame:
    """One row per epoch, method, axis and fault."""
    plan, rows = task.plan, task.rows
    place, slot = np.nonzero((plan.fault_index >= 0) & (totals.draws > 0)[:, None])
    kept = totals.counts[place, slot]
    row = np.tile(np.arange(rows), len(place))
    fault, place = np.repeat(plan.fault_index[place, slot], rows), np.repeat(place, rows)
    columns: dict[str, object] = {
        "epoch": plan.geometry.epoch[plan.epochs[place]],
        **_names(task, fault, row),
        "draws": totals.draws[place],
    }
    table = with_rates(pd.DataFrame(columns | _count_columns(task, kept)))
    # Epoch by epoch, then method by method, the faults in the order in which they were asked for.
    return table.iloc[np.lexsort((fault, row, place))].reset_index(drop=True)


def fault_table(task: SweepTask, totals: FaultTotals) -> pd.DataFrame:
    """One row per method, axis and fault, summed over the epochs at which it applies; none for faults that never do.

    Epochs have noise of their own, so all draws of a fault are independent; the bounds are those of the mean rate
    over its epochs.
    """
    fault = np.flatnonzero(totals.draws)
    rows = task.rows
    columns = {
        **_names(task, np.tile(fault, rows), np.repeat(np.arange(rows), len(fault))),
        "epochs": np.tile(totals.epochs[fault], rows),
        "draws": np.tile(totals.draws[fault], rows),
    }
    kept = np.moveaxis(totals.counts[fault], 1, 0)  # (rows, faults, events)
    return with_rates(pd.DataFrame(columns | _count_columns(task, kept)))


def _names(task: SweepTask, fault: NDArray[np.int64], row: NDArray[np.int64]) -> dict[str, object]:
    method, axis = np.divmod(row, len(task.axes))
    return {
        "method": np.array([one.name for one in task.methods], dtype=object)[method],
        **({} if task.axes == (VERTICAL,) else {"axis": np.array(task.axes, dtype=object)[axis]}),
        "fault": np.array(task.faults.labels, dtype=object)[fault],
        "bias_m": task.faults.scalar_bias_m[fault],
    }


def _count_columns(task: SweepTask, counts: NDArray[np.int64]) -> dict[str, object]:
    flat = counts.reshape(-1, len(task.events))
    return {event.count: flat[:, k] for k, event in enumerate(task.events)}


def events_in(table: pd.DataFrame) -> list[Event]:
    """The events that a table of counts has."""
    return [*EVENTS, *(event for event in EXCLUSIONS if event.count in table)]


def count_columns(table: pd.DataFrame) -> list[str]:
    """The columns of draws and counts that a table has."""
    return ["draws", *(event.count for event in events_in(table))]


def with_rates(counts: pd.DataFrame) -> pd.DataFrame:
    """The table of counts with ``<event>_rate, <event>_low, <event>_high`` for every event.

    Where the table has a column ``independent_draws``, its counts are sums over faults that saw the same noise, and
    the bounds are those of `shared_noise_bounds`; else each draw stands for itself.
    """
    draws = counts["draws"].to_numpy()
    columns: dict[str, NDArray] = {}
    for event in events_in(counts):
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
    columns = count_columns(table)
    counts = table.groupby(list(keys), sort=False, dropna=False)[columns].sum().reset_index()
    shared = list(independent.index.names)
    counts = counts.merge(independent.rename("independent_draws").reset_index(), on=shared, how="left")
    return with_rates(counts[[*keys, "draws", "independent_draws", *columns[1:]]])
