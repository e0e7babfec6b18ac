"""A service volume as one record: everything that decides its counts, cut into batches and into parts.

A batch is one call of the compiled function, a few sites with all their epochs. A part is what is stored, some
batches on end. The cut depends on what is asked for alone, never on the machine.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.arrays import FloatArray
from pl_mc.engine.part_task import Kind, array_fingerprint
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Method
from pl_mc.methods.capabilities import declared, levels_from_geometry
from pl_mc.noise_models import NoiseModel
from pl_mc.runtime.threads import in_order
from pl_mc.service.continuity import Duration
from pl_mc.service.counting import ServiceCounts
from pl_mc.service.levels import levels_of_batch
from pl_mc.service.sky import Geometries, WorldGrid, WorldSky

# Geometries of a batch: a few sites with all their epochs. Memory is that of a few batches, whatever the grid.
GEOMETRIES_PER_BATCH = 2_304

# Scenarios of a part, by all methods whose levels depend on noise: what a killed run loses at most, about twenty
# seconds of two cores. Where there is none a part has no more batches than this.
SCENARIOS_PER_PART = 8_000_000
MOST_BATCHES_PER_PART = 64

_WHOLE, _REAL = pa.list_(pa.int64()), pa.list_(pa.float64())
_SCHEMA = pa.schema([("array", pa.string()), ("shape", _WHOLE), ("counts", _WHOLE), ("values", _REAL)])


@dataclass(frozen=True)
class ServicePart:
    """The counts of the sites of one part, with its number."""

    number: int
    counts: ServiceCounts


@dataclass(frozen=True, eq=False)
class ServiceTask:
    """A service volume, checked and ready to run; fields as `pl_mc.service_volume` has them."""

    kind: ClassVar = Kind("service volume", record="_service.json", edge="a limit", unit="geometries")

    grid: WorldGrid
    sky: WorldSky
    methods: tuple[Method, ...]
    operations: tuple[AlertLimits, ...]
    durations: tuple[Duration, ...]
    draws: int
    seed: int
    precision: str
    noise: NoiseModel

    @functools.cached_property
    def exact(self) -> tuple[bool, ...]:
        """Of each method, whether its levels depend on the geometry alone."""
        return tuple(levels_from_geometry(method) for method in self.methods)

    @property
    def sites_per_batch(self) -> int:
        """Sites of a batch."""
        return min(len(self.grid), max(1, GEOMETRIES_PER_BATCH // self.sky.epochs))

    @property
    def sites_per_part(self) -> int:
        """Sites of a part: whole batches."""
        noisy = self.exact.count(False)
        of_a_batch = self.sites_per_batch * self.sky.epochs * max(1, self.draws * noisy)
        return self.sites_per_batch * min(MOST_BATCHES_PER_PART, max(1, SCENARIOS_PER_PART // of_a_batch))

    @property
    def part_count(self) -> int:
        """Number of parts."""
        return -(-len(self.grid) // self.sites_per_part)

    def sites_of(self, part: int) -> slice:
        """The sites of a part."""
        first = part * self.sites_per_part
        return slice(first, min(first + self.sites_per_part, len(self.grid)))

    def batches_of(self, part: int) -> Iterator[slice]:
        """The sites of each batch of a part."""
        sites = self.sites_of(part)
        for first in range(sites.start, sites.stop, self.sites_per_batch):
            yield slice(first, min(first + self.sites_per_batch, sites.stop))

    @functools.cached_property
    def places_rad(self) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude of each site [rad]."""
        return np.radians(self.grid.latitude_deg), np.radians(self.grid.longitude_deg)

    @functools.cached_property
    def in_view(self) -> NDArray[np.float64]:
        """(sites, 3), smallest, mean and largest number of satellites in view over the epochs."""
        latitude, longitude = self.places_rad
        found = []
        for sites in (batch for part in range(self.part_count) for batch in self.batches_of(part)):
            seen = self.sky.counts(latitude[sites], longitude[sites])
            found.append(np.stack([seen.min(axis=1), seen.mean(axis=1), seen.max(axis=1)], axis=1))
        return np.concatenate(found)

    @functools.cached_property
    def width(self) -> int:
        """Rows of the geometries: as many as satellites are in view anywhere at once, and not fewer than one."""
        return max(int(self.in_view[:, 2].max()), 1)

    def nothing(self, sites: int) -> ServiceCounts:
        """Counts of so many sites before anything is counted."""
        return ServiceCounts.of(sites, self.sky.epochs, self.draws, self.exact, len(self.operations), self.durations)

    def geometries(self, sites: slice) -> Geometries:
        """The geometries of a batch, of the same shape in every call: it is filled up with its last site."""
        latitude, longitude = self.places_rad
        numbers = self._filled(sites)
        return self.sky.geometries(latitude[numbers], longitude[numbers], self.width)

    def require_noise(self, batch: Geometries) -> None:
        """Raise `InputError` where the noise model cannot serve the geometries of a batch."""
        slots, many = self.sky.slots, len(batch.design)
        geometry = Geometry(
            design=batch.design, sigma_m=batch.sigma_m, in_view=batch.in_view,
            satellite=batch.satellite.astype(np.int32), epoch=np.arange(many), time_gps_s=np.full(many, np.nan),
            names=tuple(slot.name for slot in slots), systems=tuple(slot.system for slot in slots),
            clocks=self.sky.clocks,
        )  # fmt: skip
        self.noise.require_geometry(geometry)

    def levels(self, sites: slice) -> list[tuple[FloatArray, FloatArray]]:
        """HPL and VPL (sites, epochs, draws) of each method at the sites of a batch [m]."""
        batch = self.geometries(sites)
        self.require_noise(batch)
        epochs, held = self.sky.epochs, self.sites_per_batch
        numbers = (self._filled(sites)[:, None] * epochs + np.arange(epochs)).ravel()
        found = levels_of_batch(
            batch, numbers, self.methods, draws=self.draws, seed=self.seed, precision=self.precision,
            noise=self.noise,
        )  # fmt: skip
        kept = sites.stop - sites.start
        return [(hpl.reshape(held, epochs, -1)[:kept], vpl.reshape(held, epochs, -1)[:kept]) for hpl, vpl in found]

    def work_of(self, numbers: Sequence[int]) -> tuple[int, float]:
        """Batches of parts, and geometries of a batch."""
        return sum(1 for number in numbers for _ in self.batches_of(number)), self.sites_per_batch * self.sky.epochs

    def count_parts(
        self, numbers: Iterable[int], after_call: Callable[[], None], *, threads: int
    ) -> Generator[ServicePart]:
        """The counts of parts in order; ``after_call`` is called after each batch."""
        # Functions for many geometries have threads of their own.
        threads = 1 if all(declared(method, "batched_levels") for method in self.methods) else threads
        calls = ((number, sites) for number in numbers for sites in self.batches_of(number))
        for (number, sites), levels in in_order(lambda call: self.levels(call[1]), calls, threads):
            part = self.sites_of(number)
            if sites.start == part.start:
                counts = self.nothing(part.stop - part.start)
            here = slice(sites.start - part.start, sites.stop - part.start)
            counts.add(here, self.grid.weight[sites], levels, self.operations)
            after_call()
            if sites.stop == part.stop:
                yield ServicePart(number, counts)

    def part_rows(self, part: ServicePart) -> pa.Table:
        """A part as a table, one row for each array of the counts."""
        kinds = {"counts": np.int64, "values": np.float64}
        rows = [
            {"array": name, "shape": list(array.shape)}
            | {column: array.ravel().tolist() if array.dtype == kind else None for column, kind in kinds.items()}
            for name, array in part.counts.arrays().items()
        ]
        return pa.Table.from_pylist(rows, schema=_SCHEMA)

    def part_of(self, number: int, rows: pa.Table) -> ServicePart:
        """The part behind its rows; a `KeyError`, `TypeError` or `ValueError` where they are not those of one."""
        sites = self.sites_of(number)
        counts = self.nothing(sites.stop - sites.start)
        found = list(_arrays(rows))
        mine = [(name, array.dtype) for name, array in counts.arrays().items()]
        if rows.schema.types != _SCHEMA.types or [(name, array.dtype) for name, array in found] != mine:
            raise ValueError("its rows are not those of the plan")
        counts.fill(dict(found))
        # Sums over sites and over epochs are sums of the same scenarios.
        served = self.grid.weight[sites] @ counts.available.reshape(sites.stop - sites.start, -1)
        by_epoch = (counts.by_epoch.mean(axis=0) * counts.scenarios[:, None]).ravel()
        small = all((array >= 0).all() for _, array in found) and (counts.available <= counts.scenarios[:, None]).all()
        if not small or not np.allclose(served, by_epoch, rtol=1e-9, atol=1e-9):
            raise ValueError("its counts contradict each other")
        return ServicePart(number, counts)

    def asked(self) -> dict[str, Any]:
        """What decides the counts, in a form that can be stored and compared."""
        latitude, longitude = self.places_rad
        some = slice(0, len(self.grid), max(1, len(self.grid) // 16))
        seen = self.sky.geometries(latitude[some], longitude[some], self.width)
        return {
            "step_deg": self.grid.step_deg,
            "epochs": self.sky.epochs,
            "first epoch, GPS time [s]": float(self.sky.time_gps_s[0]),
            "last epoch, GPS time [s]": float(self.sky.time_gps_s[-1]),
            "mask_deg": self.sky.mask_deg,
            "satellites": " ".join(slot.name for slot in self.sky.slots),
            # Of some sites over the Earth at all epochs: constellations and error models may be anybody's.
            "geometry": array_fingerprint(seen.design, seen.sigma_m, seen.in_view, seen.satellite),
            "methods": [repr(method) for method in self.methods],
            "operations": [repr(limits) for limits in self.operations],
            "durations_s": [one.seconds for one in self.durations],
            "draws": self.draws,
            "seed": self.seed,
            "noise": repr(self.noise),
            "precision": self.precision,
            "draws per block": LANES,
            "sites per batch": self.sites_per_batch,
            "sites per part": self.sites_per_part,
        }

    def require_satellites(self) -> None:
        """Raise `InputError` where no user ever sees a satellite."""
        if self.in_view[:, 2].max() == 0:
            raise InputError(
                f"geometry: no satellite is above the mask of {self.sky.mask_deg:g} deg anywhere at any epoch."
            )

    def _filled(self, sites: slice) -> NDArray[np.int64]:
        return np.minimum(np.arange(sites.start, sites.start + self.sites_per_batch), sites.stop - 1)


def _arrays(rows: pa.Table) -> Iterator[tuple[str, NDArray]]:
    for row in rows.to_pylist():
        whole = row["counts"] is not None
        flat = np.array(row["counts"] if whole else row["values"], dtype=np.int64 if whole else np.float64)
        yield row["array"], flat.reshape(row["shape"])
