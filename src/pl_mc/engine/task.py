"""A sweep as one record: everything that decides its counts, nothing of how or where it runs.

The rows of a stored part are what a user reads: epoch, fault, method, draws and counts.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import jax
import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.engine import plan as cut
from pl_mc.engine.calls import Chunk, run_calls
from pl_mc.engine.compiling import compiled_count
from pl_mc.engine.part_task import Kind, array_fingerprint
from pl_mc.engine.plan import Plan, make_plan
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.kernels.events import EVENTS, Event, counted_events, limits_of
from pl_mc.kernels.noise import LANES
from pl_mc.kernels.parameters import as_trees
from pl_mc.methods.base import Method
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.runtime.precision import dtype_of

# Shapes whose function this process has compiled: their first call need not run alone.
_COMPILED: set[tuple[object, ...]] = set()


@dataclass(frozen=True)
class PartCounts:
    """What one part of a sweep counted.

    Attributes:
        number: the part's number.
        places: (e,), its epochs, as indices into `Plan.epochs`.
        draws: (e,), draws behind the counts of each.
        counts: (e, width, rows, events), as `Plan.fault_index` orders the faults; the rows are those of `SweepTask`.
    """

    number: int
    places: NDArray[np.int64]
    draws: NDArray[np.int64]
    counts: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SweepTask:
    """A sweep, checked and ready to run; it can be sent to another process.

    Its ``rows`` are each method by each axis, method by method.
    """

    kind: ClassVar = Kind("sweep", record="_sweep.json", edge="an event", unit="scenarios")

    geometry: Geometry
    faults: Faults
    draws: int
    seed: int
    methods: tuple[Method, ...]
    alert: AlertLimits
    precision: str
    noise: NoiseModel = GAUSSIAN
    axes: tuple[str, ...] = (VERTICAL,)

    @property
    def rows(self) -> int:
        """Number of rows, methods by axes."""
        return len(self.methods) * len(self.axes)

    @functools.cached_property
    def events(self) -> tuple[Event, ...]:
        """What is counted."""
        return counted_events(self.methods)

    @functools.cached_property
    def plan(self) -> Plan:
        """How it is cut."""
        return make_plan(self.geometry, self.faults, self.draws)

    @property
    def part_count(self) -> int:
        """Number of parts."""
        return self.plan.part_count

    def asked(self) -> dict[str, Any]:
        """What decides the counts, in a form that can be stored and compared."""
        g = self.geometry.as_series()
        # Ramps depend on the times.
        times_s = [g.time_gps_s] if self.faults.shaped else []
        asked = {
            "geometry": array_fingerprint(g.design, g.sigma_m, g.in_view, g.satellite, g.epoch, g.names),
            "faults": array_fingerprint(self.faults.bias_m, self.faults.names, self.faults.labels, *times_s),
            "draws": self.draws,
            "seed": self.seed,
            "methods": [repr(method) for method in self.methods],
            "vertical alert limit [m]": self.alert.val_m,
            "precision": self.precision,
            "draws per block": LANES,
            "scenarios per call": cut.SCENARIOS_PER_CALL,
            "calls per part": self.plan.calls_per_part,
        }
        # What Gaussian sweeps and those of the vertical alone have stored stays theirs: they say nothing of the rest.
        noise = {} if self.noise == GAUSSIAN else {"noise": repr(self.noise)}
        judged = {"horizontal alert limit [m]": self.alert.hal_m, "axes": list(self.axes)}
        return asked | noise | ({} if self.axes == (VERTICAL,) else judged)

    def work_of(self, numbers: Sequence[int]) -> tuple[int, float]:
        """Calls that parts take, and scenarios of a call on average: cases of fault and noise, by all methods."""
        cases = [self.plan.cases_of(chunk) for number in numbers for chunk in self.plan.chunks(number)]
        return len(cases), sum(cases) / len(cases)

    def count(self, chunk: Chunk, *noise: np.int32, devices: int = 1) -> NDArray[np.int32]:
        """(e, width, rows, events), the counts of one call, as `run_calls` makes it."""
        dtype = dtype_of(self.precision)
        counts = compiled_count(devices)(
            self.plan.batch(chunk, dtype), np.uint32(self.seed), *noise, limits_of(self.alert, dtype),
            as_trees(self.methods), axes=self.axes, blocks=self.plan.blocks_per_call, noise_model=self.noise,
        )  # fmt: skip
        return np.asarray(counts)[: chunk.size]

    def count_parts(
        self, numbers: Iterable[int], *, threads: int, devices: int = 1,
        after_call: Callable[[], None] = lambda: None,
    ) -> Generator[PartCounts]:  # fmt: skip
        """The counts of parts, one after the other; threads go on with the next while the last calls of one run.

        ``after_call`` is called when the result of a call is there, for a progress bar.
        """
        plan, shape, numbers = self.plan, self._shape(devices), list(numbers)
        results = run_calls(
            plan, functools.partial(self.count, devices=devices), precision=self.precision, threads=threads,
            chunks=(chunk for number in numbers for chunk in plan.chunks(number)), compiled=shape in _COMPILED,
        )  # fmt: skip
        for number in numbers:
            gathered = []
            for result in itertools.islice(results, len(list(plan.chunks(number)))):
                gathered.append(result)
                after_call()
            _COMPILED.add(shape)
            yield self._part(number, gathered)

    def part_rows(self, part: PartCounts) -> pa.Table:
        """A part as a table, one row for each epoch, fault, method and axis; the vertical alone goes without saying."""
        plan, labels = self.plan, self.faults.labels
        place, slot = self._cases(part.places)
        fault = plan.fault_index[part.places[place], slot]
        names, judged = [method.name for method in self.methods], list(self.axes)
        repeat = self.rows
        of_axis = pd.Categorical.from_codes(np.tile(np.arange(len(judged)), len(place) * len(names)), judged)
        columns: dict[str, object] = {
            "epoch": np.repeat(plan.geometry.epoch[plan.epochs[part.places[place]]], repeat),
            "fault": pd.Categorical.from_codes(np.repeat(fault, repeat), list(labels))
            if len(set(labels)) == len(labels)
            else np.repeat(np.array(labels, dtype=object)[fault], repeat),
            "bias_m": np.repeat(self.faults.scalar_bias_m[fault], repeat),
            "method": pd.Categorical.from_codes(
                np.tile(np.repeat(np.arange(len(names)), len(judged)), len(place)), names
            ),
            **({} if self.axes == (VERTICAL,) else {"axis": of_axis}),
            "draws": np.repeat(part.draws[place], repeat),
        }
        flat = part.counts[place, slot].reshape(len(place) * repeat, len(self.events))
        table = pd.DataFrame(columns | {name: flat[:, k] for k, name in enumerate(self._counts)})
        return pa.Table.from_pandas(table, preserve_index=False)

    def part_of(self, number: int, rows: pa.Table) -> PartCounts:
        """The part behind its rows; a `KeyError`, `TypeError` or `ValueError` where they are not those of one."""
        chunks = list(self.plan.chunks(number))
        if not chunks:
            raise ValueError("the sweep has no part of that number")
        places = np.arange(chunks[0].first_epoch, chunks[-1].stop_epoch)
        place, slot = self._cases(places)
        draws, counts = self._nothing(len(places))
        for chunk in chunks:
            draws[chunk.first_epoch - places[0] : chunk.stop_epoch - places[0]] += self.plan.draws_of(chunk)
        # Epochs, faults, methods and draws are those of the plan; a checksum alone says who wrote, not what is true.
        expected = self.part_rows(PartCounts(number, places, draws, counts)).to_pandas()
        table = rows.to_pandas()
        whole = all(table[name].dtype == np.int64 for name in self._counts)
        texts = {name: str for name in ("fault", "method", "axis") if name in expected}
        if not whole or not table.drop(columns=self._counts).astype(texts).equals(
            expected.drop(columns=self._counts).astype(texts)
        ):
            raise ValueError("its rows are not those of the plan")
        flat = table[self._counts].to_numpy(np.int64).reshape(len(place), self.rows, len(self.events))
        least = table.hazards - table.missed + table.false_alarms + table.unavailable
        if (flat < 0).any() or (flat > draws[place][:, None, None]).any() or (table.alarms != least).any():
            raise ValueError("its counts contradict each other")
        # Each draw with a solution is one of the exclusions, where the method names them.
        excluded, solved = flat[..., len(EVENTS) :].sum(axis=-1), (table.draws - table.unavailable).to_numpy()
        if ((excluded != 0) & (excluded != solved.reshape(excluded.shape))).any():
            raise ValueError("its exclusions contradict each other")
        counts[place, slot] = flat
        return PartCounts(number, places, draws, counts)

    @property
    def _counts(self) -> list[str]:
        """Columns of the counts."""
        return [event.count for event in self.events]

    def _cases(self, places: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Index into a part's epochs, and slot, of each fault that applies."""
        place, slot = np.nonzero(self.plan.fault_index[places] >= 0)
        return place, slot

    def _nothing(self, epochs: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Draws and counts of a part's epochs before anything is counted."""
        shape = (epochs, self.plan.fault_index.shape[1], self.rows, len(self.events))
        return np.zeros(epochs, dtype=np.int64), np.zeros(shape, dtype=np.int64)

    def _shape(self, devices: int) -> tuple[object, ...]:
        """What the compiled function depends on."""
        g, plan = self.plan.geometry, self.plan
        sizes = (plan.epochs_per_call, plan.blocks_per_call, plan.fault_index.shape[1], *g.design.shape[1:])
        structure, drawn = jax.tree.structure(as_trees(self.methods)), bool(self.faults.drawn.any())
        return structure, self.axes, self.noise, self.precision, devices, drawn, sizes

    def _part(self, number: int, gathered: list[tuple[Chunk, NDArray[np.int32]]]) -> PartCounts:
        first, stop = gathered[0][0].first_epoch, gathered[-1][0].stop_epoch
        draws, total = self._nothing(stop - first)
        for chunk, counts in gathered:
            rows = slice(chunk.first_epoch - first, chunk.stop_epoch - first)
            draws[rows] += self.plan.draws_of(chunk)
            total[rows] += counts
        return PartCounts(number, np.arange(first, stop), draws, total)


class Engine(Protocol):
    """What counts parts of sweeps: this process, or a cluster."""

    def __call__(
        self, task: SweepTask, numbers: Sequence[int], after_call: Callable[[], None]
    ) -> Generator[PartCounts]: ...
