"""How a sweep is cut: into calls of the compiled function, and into parts, which are what is stored.

The cut never changes a count: noise is found by epoch and block, and counts are whole numbers. It depends on what
is asked for alone, never on the machine, so that any machine can count any part.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pl_mc.engine.calls import Chunk, Cut
from pl_mc.engine.core import EpochBatch
from pl_mc.engine.drawn_biases import DrawnBiases
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.injection import row_biases
from pl_mc.ism import satellite_codes
from pl_mc.kernels.linear_model import has_one_clock_per_row
from pl_mc.kernels.noise import LANES
from pl_mc.runtime.precision import on_device

# Scenarios per call: large enough to hide a call's cost, small enough for a live progress bar and little memory.
SCENARIOS_PER_CALL = 2**20

# Calls per part: what a killed sweep loses at most, and what a worker of a cluster is given at a time. About twenty
# seconds of two cores.
CALLS_PER_PART = 32


@dataclass(frozen=True, kw_only=True)
class Plan(Cut):
    """A sweep's work. Epochs at which no fault applies are left out.

    Attributes:
        geometry: the series.
        faults: all faults.
        epochs: indices into the series, those with at least one applicable fault.
        fault_index: (epochs, width), indices into the faults; -1 beyond those that apply at an epoch.
        calls_per_part: calls that are stored together; part of the plan, so that it goes with it to other machines.
    """

    geometry: Geometry
    faults: Faults
    epochs: NDArray[np.int64]
    fault_index: NDArray[np.int64]
    calls_per_part: int

    @property
    def part_count(self) -> int:
        """Number of parts."""
        return math.ceil(self.chunk_count / self.calls_per_part)

    def chunks(self, part: int) -> Iterator[Chunk]:
        """The calls of a part, in order."""
        first = part * self.calls_per_part
        return map(self.chunk, range(first, min(first + self.calls_per_part, self.chunk_count)))

    def block_by_block(self) -> Plan:
        """The same work in calls of a single block of noise."""
        return replace(self, blocks_per_call=1)

    def cases_of(self, chunk: Chunk) -> int:
        """Cases of fault and noise that a call counts."""
        faults = self.fault_index[chunk.first_epoch : chunk.stop_epoch] >= 0
        return int(faults.sum()) * self.draws_of(chunk)

    def scenarios(self, chunk: Chunk) -> NDArray[np.bool_]:
        """(epochs, blocks, faults, LANES), which scenarios of a call are part of the sweep; epochs those it has."""
        applies = self.fault_index[chunk.first_epoch : chunk.stop_epoch] >= 0
        live = np.arange(self.blocks_per_call * LANES).reshape(-1, LANES) < self.draws_of(chunk)
        return applies[:, None, :, None] & live[None, :, None, :]

    @functools.cached_property
    def one_clock_per_row(self) -> bool:
        """Whether no row of the design has more than one clock; all calls take the same way."""
        return has_one_clock_per_row(self.geometry.design[self.epochs])

    def batch(self, chunk: Chunk, dtype: np.dtype) -> EpochBatch:
        """The arrays of one call, made in the precision scope in which it runs.

        Where a call is not full the last epoch is repeated, with no fault that applies.
        """
        places = self.places(chunk)
        index = self.epochs[places]
        g = self.geometry
        # (e, f, n): the bias of the satellite in each row, for the faults that apply; zero elsewhere.
        bias, drawn = row_biases(g, self.faults, index[:, None], self.fault_index[places])
        applies = self.fault_index[places] >= 0
        surplus = np.arange(self.epochs_per_call) >= chunk.size
        return EpochBatch(
            design=on_device(g.design[index], dtype),
            sigma_m=on_device(g.sigma_m[index], dtype),
            in_view=on_device(g.in_view[index]),
            bias_m=on_device(np.where(applies[:, :, None], bias, 0.0), dtype),
            applies=on_device(applies & ~surplus[:, None]),
            epoch=on_device(g.epoch[index], np.uint32),
            drawn=None if drawn is None else DrawnBiases.of_rows(drawn, dtype),
            one_clock_per_row=self.one_clock_per_row,
            satellite=on_device(satellite_codes(g, g.satellite[index])),
        )


def fault_slots(applies: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """(epochs, width), the faults of each epoch, those that apply there (epochs, f) first; and whether they do."""
    width = int(applies.sum(axis=1).max(initial=1))
    order = np.argsort(~applies, axis=1, kind="stable")[:, :width]
    return order, np.take_along_axis(applies, order, axis=1)


def make_plan(g: Geometry, faults: Faults, draws: int) -> Plan:
    """Cut ``draws`` draws of every applicable fault at every epoch into calls of about equal work."""
    series = g.as_series()
    applies = faults.applies(g)
    epochs = np.flatnonzero(applies.any(axis=1))
    order, given = fault_slots(applies[epochs])
    fault_index = np.where(given, order, -1)
    width = fault_index.shape[1]

    blocks = math.ceil(draws / LANES)
    blocks_at_most = max(1, SCENARIOS_PER_CALL // (width * LANES))
    blocks_per_call = math.ceil(blocks / math.ceil(blocks / blocks_at_most))
    epochs_at_most = max(1, blocks_at_most // blocks_per_call)
    epoch_count = max(1, len(epochs))
    epochs_per_call = math.ceil(epoch_count / math.ceil(epoch_count / epochs_at_most))
    return Plan(
        geometry=series, faults=faults, epochs=epochs, fault_index=fault_index, draws=draws,
        epoch_count=len(epochs), epochs_per_call=epochs_per_call, blocks_per_call=blocks_per_call,
        calls_per_part=CALLS_PER_PART,
    )  # fmt: skip
