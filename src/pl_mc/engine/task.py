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
        place, slot = self._cases(part.places)
        flat = part.counts[place, slot].reshape(len(place) * self.rows, len(self.events))
        # A data frame in between would take more than half of the time, and its description much of a small file.
        columns = {
            name: column.stored() if isinstance(column, _Texts) else pa.array(column, from_pandas=True)
            for name, column in self._planned(part.places, part.draws).items()
        }
        return pa.table(columns | {name: pa.array(flat[:, k]) for k, name in enumerate(self._counts)})

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
        # Columns are compared as they lie in the file: as data frames they take ten times as long, which counts where
        # parts are many and small.
        planned, counted = self._planned(places, draws), {name: rows.column(name) for name in self._counts}
        if (
            [name for name in rows.column_names if name not in counted] != list(planned)
            or not all(_same(rows.column(name), column) for name, column in planned.items())
            or any(column.type != pa.int64() or column.null_count for column in counted.values())
        ):
            raise ValueError("its rows are not those of the plan")
        of = {name: column.to_numpy().reshape(len(place), self.rows) for name, column in counted.items()}
        flat, drawn = np.stack(list(of.values()), axis=-1), draws[place][:, None]
        least = of["hazards"] - of["missed"] + of["false_alarms"] + of["unavailable"]
        if (flat < 0).any() or (flat > drawn[..., None]).any() or (of["alarms"] != least).any():
            raise ValueError("its counts contradict each other")
        # Each draw with a solution is one of the exclusions, where the method names them.
        excluded, solved = flat[..., len(EVENTS) :].sum(axis=-1), drawn - of["unavailable"]
        if ((excluded != 0) & (excluded != solved)).any():
            raise ValueError("its exclusions contradict each other")
        counts[place, slot] = flat
        return PartCounts(number, places, draws, counts)

    def _planned(
        self, places: NDArray[np.int64], draws: NDArray[np.int64]
    ) -> dict[str, NDArray[np.int64] | NDArray[np.float64] | _Texts]:
        """The columns of a part's rows that are known before anything is counted."""
        plan, (place, slot) = self.plan, self._cases(places)
        fault, cases, judged = plan.fault_index[places[place], slot], len(place), len(self.axes)
        method = np.tile(np.repeat(np.arange(len(self.methods)), judged), cases)
        axis = {"axis": _Texts(np.tile(np.arange(judged), cases * len(self.methods)), self.axes)}
        return {
            "epoch": np.repeat(plan.geometry.epoch[plan.epochs[places[place]]], self.rows),
            "fault": _Texts(np.repeat(fault, self.rows), self.faults.labels),
            "bias_m": np.repeat(self.faults.scalar_bias_m[fault], self.rows),
            "method": _Texts(method, self._names),
            **({} if self.axes == (VERTICAL,) else axis),
            "draws": np.repeat(draws[place], self.rows),
        }

    @functools.cached_property
    def _names(self) -> list[str]:
        """Names of the methods, which methods make anew whenever they are asked."""
        return [method.name for method in self.methods]

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


@dataclass(frozen=True)
class _Texts:
    """A column of texts of which many are the same: which of ``texts`` stands in each row."""

    index: NDArray[np.int64]
    texts: Sequence[str]

    def stored(self) -> pa.Array:
        """As it is stored: each text once, unless two of them are the same."""
        texts = pa.array(list(self.texts), pa.string())
        if len(set(self.texts)) == len(self.texts):
            return pa.DictionaryArray.from_arrays(pa.array(self.index.astype(np.int32)), texts)
        return texts.take(pa.array(self.index))


def _same(column: pa.ChunkedArray, planned: NDArray[np.int64] | NDArray[np.float64] | _Texts) -> bool:
    """Whether a stored column is the planned one; texts may be stored in any way."""
    if isinstance(planned, _Texts):
        texts = pa.array(list(planned.texts), pa.string()).take(pa.array(planned.index))
        return bool(column.cast(pa.string()).equals(pa.chunked_array([texts])))
    # A number that is none is stored as a missing one, which among whole numbers makes others of them.
    values = column.to_numpy() if column.type == pa.from_numpy_dtype(planned.dtype) else None
    return values is not None and values.dtype == planned.dtype and np.array_equal(values, planned, equal_nan=True)


class Engine(Protocol):
    """What counts parts of sweeps: this process, or a cluster."""

    def __call__(
        self, task: SweepTask, numbers: Sequence[int], after_call: Callable[[], None]
    ) -> Generator[PartCounts]: ...
