"""A sweep as one record: everything that decides its counts, nothing of how or where it runs."""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.engine.compiling import compiled_count
from pl_mc.engine.events import EVENTS
from pl_mc.engine.noise import LANES
from pl_mc.engine.plan import Chunk, Plan, make_plan
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.host.precision import dtype_of, precision_scope
from pl_mc.host.threads import in_order
from pl_mc.methods.base import Method
from pl_mc.noise_models import GAUSSIAN, NoiseModel

# Shapes whose function this process has compiled: their first call need not run alone.
_COMPILED: set[tuple[object, ...]] = set()


@dataclass(frozen=True)
class PartCounts:
    """What one part of a sweep counted.

    Attributes:
        number: the part's number.
        places: (e,), its epochs, as indices into `Plan.epochs`.
        draws: (e,), draws behind the counts of each.
        counts: (e, width, methods, events), as `Plan.fault_index` orders the faults.
    """

    number: int
    places: NDArray[np.int64]
    draws: NDArray[np.int64]
    counts: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SweepTask:
    """A sweep, checked and ready to run; it can be sent to another process."""

    geometry: Geometry
    faults: Faults
    draws: int
    seed: int
    methods: tuple[Method, ...]
    alert: AlertLimits
    precision: str
    noise: NoiseModel = GAUSSIAN

    @functools.cached_property
    def plan(self) -> Plan:
        """How it is cut."""
        return make_plan(self.geometry, self.faults, self.draws)

    def count(self, chunk: Chunk, devices: int = 1) -> NDArray[np.int32]:
        """(e, width, methods, events), the counts of one call."""
        dtype = dtype_of(self.precision)
        # Draws beyond this call are other calls', also where several devices round its blocks up.
        stop = chunk.first_block * LANES + self.plan.draws_of(chunk)
        with precision_scope(self.precision):
            counts = compiled_count(devices)(
                self.plan.batch(chunk, dtype),
                np.uint32(self.seed),
                np.int32(chunk.first_block),
                np.int32(stop // LANES),
                np.int32(stop % LANES),
                jnp.asarray(self.alert.vertical_m, dtype),
                methods=self.methods,
                blocks=self.plan.blocks_per_call,
                noise_model=self.noise,
            )
            return np.asarray(counts)[: chunk.stop_epoch - chunk.first_epoch]

    def count_parts(
        self,
        numbers: Iterable[int],
        *,
        threads: int,
        devices: int = 1,
        after_call: Callable[[], None] = lambda: None,
    ) -> Generator[PartCounts]:
        """The counts of parts, one after the other; threads go on with the next while the last calls of one run.

        Args:
            numbers: which parts.
            threads, devices: what computes.
            after_call: called when the result of a call is there, for a progress bar.
        """
        calls = ((number, chunk) for number in numbers for chunk in self.plan.chunks(number))
        current: int | None = None
        found: list[tuple[Chunk, NDArray[np.int32]]] = []
        shape = self._shape(devices)
        results = in_order(
            lambda call: self.count(call[1], devices), calls, threads, compiled=shape in _COMPILED
        )  # fmt: skip
        for (number, chunk), counts in results:
            _COMPILED.add(shape)
            if current is not None and number != current:
                yield self._gather(current, found)
                found = []
            current = number
            found.append((chunk, counts))
            after_call()
        if current is not None:
            yield self._gather(current, found)

    def _shape(self, devices: int) -> tuple[object, ...]:
        """What the compiled function depends on."""
        g, plan = self.plan.geometry, self.plan
        sizes = (plan.epochs_per_call, plan.blocks_per_call, plan.fault_index.shape[1], *g.design.shape[1:])
        return self.methods, self.noise, self.precision, devices, sizes

    def _gather(self, number: int, found: list[tuple[Chunk, NDArray[np.int32]]]) -> PartCounts:
        first, stop = found[0][0].first_epoch, found[-1][0].stop_epoch
        draws = np.zeros(stop - first, dtype=np.int64)
        shape = (stop - first, self.plan.fault_index.shape[1], len(self.methods), len(EVENTS))
        total = np.zeros(shape, dtype=np.int64)
        for chunk, counts in found:
            rows = slice(chunk.first_epoch - first, chunk.stop_epoch - first)
            draws[rows] += self.plan.draws_of(chunk)
            total[rows] += counts
        return PartCounts(number, np.arange(first, stop), draws, total)
