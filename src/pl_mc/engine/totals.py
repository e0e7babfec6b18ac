"""Counts of parts, added up: over epochs, which needs little memory, or epoch by epoch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.engine.events import EVENTS
from pl_mc.engine.task import PartCounts, SweepTask


@dataclass(frozen=True)
class FaultTotals:
    """Sums over epochs.

    Attributes:
        counts: (f, methods, events).
        draws: (f,), draws behind them.
        fault_index: (epochs, width), as in `Plan`.
        counted: (epochs,), the epochs of which something was counted.
    """

    counts: NDArray[np.int64]
    draws: NDArray[np.int64]
    fault_index: NDArray[np.int64]
    counted: NDArray[np.bool_]

    @classmethod
    def of(cls, task: SweepTask) -> FaultTotals:
        """Nothing counted yet."""
        faults, index = len(task.faults), task.plan.fault_index
        return cls(
            counts=np.zeros((faults, len(task.methods), len(EVENTS)), dtype=np.int64),
            draws=np.zeros(faults, dtype=np.int64),
            fault_index=index,
            counted=np.zeros(len(index), dtype=bool),
        )

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
    """Counts of every epoch: (epochs, width, methods, events), and draws (epochs,)."""

    counts: NDArray[np.int64]
    draws: NDArray[np.int64]

    @classmethod
    def of(cls, task: SweepTask) -> EpochTotals:
        """Nothing counted yet."""
        shape = (*task.plan.fault_index.shape, len(task.methods), len(EVENTS))
        return cls(np.zeros(shape, dtype=np.int64), np.zeros(shape[0], dtype=np.int64))

    def add(self, task: SweepTask, part: PartCounts) -> None:
        """Add a part."""
        self.counts[part.places] += part.counts
        self.draws[part.places] += part.draws
