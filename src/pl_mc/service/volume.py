"""Service volume: availability and continuity of operations over a grid of users and a day."""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import LPV_200, OPERATIONS, AlertLimits, operation_named
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_SEED
from pl_mc.engine.execution import Execution, run_task
from pl_mc.error_models import ErrorModel, as_error_model
from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError, require_choice, require_list, require_number, require_positive, require_whole
from pl_mc.methods import Method, as_methods
from pl_mc.noise_models import GAUSSIAN, NoiseModel, as_noise_model
from pl_mc.runtime.precision import dtype_of
from pl_mc.runtime.threads import cores
from pl_mc.service.continuity import as_durations
from pl_mc.service.counting import ServiceCounts, epoch_table, level_table, place_columns, site_table, world_table
from pl_mc.service.sky import WorldGrid, WorldSky, world_grid
from pl_mc.service.task import ServiceTask

DAY_S = 86_400.0

# All epochs of a site are in one batch.
MOST_EPOCHS = 20_000
MOST_DRAWS = 10_000


@dataclass(frozen=True)
class ServiceVolume:
    """What a service volume found. Rates have columns ``<what>_rate, <what>_low, <what>_high``.

    Attributes:
        grid: the users.
        time_gps_s: (epochs,), GPS time [s].
        step_s: time from one epoch to the next [s].
        methods: names of the methods.
        operations: the operations.
        draws: noise draws at each geometry, for methods whose levels depend on the noise.
        seed: of the noise.
        noise: name of its model.
        notes: sentences about parts of an earlier run that were of no use.
        exact: names of the methods whose levels depend on the geometry alone.
        sites: a row per site, method and operation: ``site, latitude_deg, longitude_deg, method, operation,
            scenarios, available, availability_*``, and for each duration ``started_15s, stayed_15s,
            continuity_15s_*``.
        world: a row per method and operation, weighted with area: ``availability_*``, ``coverage_*`` (area whose
            sites have an availability of 99.5 % or more, and their number ``coverage_sites``), the worst site, and
            ``continuity_*``.
        levels: a row per site and method: ``hpl_50_m, hpl_99_m, vpl_50_m, vpl_99_m``, not exceeded in 50 and 99 %
            of the scenarios; infinite where there is no solution in so many of them.
        satellites: a row per site: ``satellites_min, satellites_mean, satellites_max`` in view over the epochs.
        by_epoch: a row per epoch, method and operation: ``time_gps_s, area_share``, the share of the Earth's area
            with service, mean over draws.
    """

    grid: WorldGrid
    time_gps_s: FloatArray
    step_s: float
    methods: tuple[str, ...]
    operations: tuple[AlertLimits, ...]
    draws: int
    seed: int
    noise: str
    notes: tuple[str, ...]
    exact: tuple[str, ...]
    sites: pd.DataFrame
    world: pd.DataFrame
    levels: pd.DataFrame
    satellites: pd.DataFrame
    by_epoch: pd.DataFrame

    def worst_sites(self, method: str, operation: str, *, most: int = 10) -> pd.DataFrame:
        """The sites with the lowest availability, at most ``most`` of them, the worst first."""
        require_choice(method, self.methods, field="method")
        require_choice(operation, [one.name for one in self.operations], field="operation")
        rows = self.sites[(self.sites.method == method) & (self.sites.operation == operation)]
        return rows.nsmallest(most, "availability_rate", keep="first").reset_index(drop=True)


@ordinary_arithmetic
def service_volume(
    *,
    constellations: str | Sequence[str] = ("GPS", "GAL"),
    without: str | Sequence[str] = (),
    step_deg: float = 5.0,
    step_s: float = 300.0,
    duration_s: float = DAY_S,
    start: str | date | np.datetime64 = "2017-11-21T00:00:00",
    mask_deg: float = 10.0,
    error_model: str | ErrorModel = "residual",
    methods: Sequence[str | Method] = ("ls", "igg3", "araim"),
    operations: str | AlertLimits | Sequence[str | AlertLimits] = (LPV_200,),
    durations_s: float | Sequence[float] = (15.0, 150.0),
    draws: int = 100,
    seed: int = 20171121,
    noise: str | NoiseModel = GAUSSIAN,
    precision: str = "float64",
    workers: int | None = None,
    folder: Path | str | None = None,
    resume: bool = False,
    progress: bool | None = None,
) -> ServiceVolume:
    """Availability and continuity of operations for users all over the Earth, fault-free.

    An operation is available in a scenario where the method has a solution with VPL <= VAL and HPL <= HAL. A
    receiver's false alerts are not part of it; levels that follow from what a test excluded are.

    Users stand on the ellipsoid at the middles of cells. Satellites are those of `pl_mc.simulate`. A method whose
    levels depend on the geometry alone (`pl_mc.methods.capabilities.LevelsFromGeometry`) gets one draw, since all
    would be alike; ARAIM is computed by `pl_mc.araim.protection_levels`. Every geometry has noise of its own: that
    of a sweep with this seed and the epoch number ``site * epochs + epoch``.

    Args:
        constellations, without, start, mask_deg, error_model: as for `pl_mc.simulate`; ``without`` names satellites
            that are switched off.
        step_deg: width and height of the cells, a divisor of 180 deg [deg].
        step_s: time from one epoch to the next [s].
        duration_s: length of the run [s]; epochs are those before its end.
        methods: names or records of methods.
        operations: names of `pl_mc.alert.OPERATIONS` or alert limits.
        durations_s: lengths of operations whose continuity is asked for [s]; see `pl_mc.service.continuity`.
        draws: noise draws at each geometry.
        seed: chooses the noise, 0 to 2^32 - 1.
        noise: how errors are distributed, a name or a record of `pl_mc.noise_models`, as for `pl_mc.sweep`; it is
            nothing to methods whose levels depend on the geometry alone.
        precision: ``float64`` or ``float32``.
        workers: threads that compute; as many as there are cores unless given. No effect on the counts.
        folder: where to store finished parts of the grid; none unless given.
        resume: go on with what ``folder`` holds of the same service volume.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        A `ServiceVolume`. Its bounds are about the draws. For methods whose levels depend on the geometry alone
        those of the availability are about the moments at which service changes, see
        `pl_mc.service.counting.ServiceCounts.availability_bounds`, and those of the continuity are its value. That
        the Earth is sampled by a grid of users is in none of them.

    Raises:
        InputError: an option that cannot be used.

    Example:
        >>> import pl_mc
        >>> options = {"step_deg": 90.0, "step_s": 43200.0, "draws": 4, "progress": False}
        >>> volume = pl_mc.service_volume(constellations="GPS", methods="ls", **options)
        >>> volume.world[["method", "operation", "sites", "scenarios"]]
          method operation  sites  scenarios
        0     ls   LPV-200      8         64
    """
    if folder is None and resume:
        raise InputError("folder: to resume a service volume, a folder for the parts is needed.")
    where = None if folder is None else Path(folder)
    execution = Execution(workers=workers, folder=where, resume=resume, progress=progress)
    task = service_task(
        constellations=constellations, without=without, step_deg=step_deg, step_s=step_s, duration_s=duration_s,
        start=start, mask_deg=mask_deg, error_model=error_model, methods=methods, operations=operations,
        durations_s=durations_s, draws=draws, seed=seed, noise=noise, precision=precision,
    )  # fmt: skip
    return run_service(task, execution, step_s=float(step_s))


def service_task(
    *, constellations: str | Sequence[str], without: str | Sequence[str], step_deg: float, step_s: float,
    duration_s: float, start: str | date | np.datetime64, mask_deg: float, error_model: str | ErrorModel,
    methods: Sequence[str | Method], operations: str | AlertLimits | Sequence[str | AlertLimits],
    durations_s: float | Sequence[float], draws: int, seed: int, noise: str | NoiseModel, precision: str,
) -> ServiceTask:  # fmt: skip
    """The options of `service_volume`, checked."""
    grid = world_grid(step_deg)
    step = require_positive(step_s, field="step_s")
    epochs = require_epochs(require_positive(duration_s, field="duration_s"), step)
    mask = require_number(mask_deg, field="mask_deg")
    if not 0.0 <= mask < 90.0:
        nearest_valid = "0" if mask < 0 else "below 90"
        raise InputError(
            f"mask_deg: {mask:g} deg is outside the range from 0 to below 90 deg; nearest: {nearest_valid}."
        )
    chosen, limits = as_methods(methods), as_operations(operations)
    lengths = as_durations(durations_s, step_s=step, epochs=epochs)
    time_gps_s = np.asarray(gps_seconds(start) + step * np.arange(epochs), dtype=np.float64)
    return ServiceTask(
        grid=grid,
        sky=WorldSky(constellation_slots(constellations, without), as_error_model(error_model), mask, time_gps_s),
        methods=chosen,
        operations=limits,
        durations=lengths,
        draws=require_whole(draws, field="draws", low=1, high=MOST_DRAWS),
        seed=require_whole(seed, field="seed", low=0, high=LARGEST_SEED),
        precision=str(dtype_of(precision)),
        noise=as_noise_model(noise),
    )


def run_service(task: ServiceTask, execution: Execution, *, step_s: float) -> ServiceVolume:
    """`service_volume` of a task, with the way it runs as one record."""
    counts, notes = count_service(task, execution)
    grid, lengths = task.grid, task.durations
    names, labels = [method.name for method in task.methods], [one.name for one in task.operations]
    least, mean, most = task.in_view.T
    seen = {"satellites_min": least.astype(int), "satellites_mean": mean, "satellites_max": most.astype(int)}
    return ServiceVolume(
        grid=grid,
        time_gps_s=task.sky.time_gps_s,
        step_s=step_s,
        methods=tuple(names),
        operations=task.operations,
        draws=task.draws,
        seed=task.seed,
        noise=task.noise.name,
        notes=notes,
        exact=tuple(name for name, alone in zip(names, task.exact, strict=True) if alone),
        sites=site_table(counts, grid, names, labels, lengths),
        world=world_table(counts, grid, names, labels, lengths),
        levels=level_table(counts, grid, names),
        satellites=pd.DataFrame(place_columns(grid) | seen),
        by_epoch=epoch_table(counts, task.sky.time_gps_s, names, labels),
    )


def count_service(task: ServiceTask, execution: Execution) -> tuple[ServiceCounts, tuple[str, ...]]:
    """The counts of all sites (of one share: of its sites, zero elsewhere), and a sentence for each bad part file.

    The result is bit for bit the same however often it was stopped and resumed.

    Raises:
        InputError: parts of another service volume, a folder that cannot be written, missing parts where none may
            be, or a way to run that service volumes do not have.
    """
    if execution.scheduler is not None or execution.devices is not None:
        field = "scheduler" if execution.scheduler is not None else "devices"
        raise InputError(
            f"{field}: a service volume runs in threads of one process; share it among jobs by a shard instead."
        )
    task.require_satellites()
    task.require_noise(task.geometries(next(task.batches_of(0))))
    threads = execution.workers or cores()
    total, notes = task.nothing(len(task.grid)), []
    rest, early = deque(execution.share_of(task.part_count)), {}
    for found in run_task(task, execution, functools.partial(task.count_parts, threads=threads)):
        if isinstance(found, str):
            notes.append(found)
            continue
        early[found.number] = found.counts
        # In the order of the parts, so that sums round alike.
        while rest and rest[0] in early:
            total.join(task.sites_of(rest[0]), early.pop(rest.popleft()))
    return total, tuple(notes)


def epoch_count(duration_s: float, step_s: float) -> int:
    """Number of epochs of a run, one at its beginning and then one at each step before its end; at least 1."""
    # A length that is a whole number of steps but for rounding has no epoch at its end.
    # Beyond all bounds a quotient may be infinite.
    return max(1, math.ceil(min(duration_s / step_s, 1e15) - 1e-9))


def require_epochs(duration_s: float, step_s: float) -> int:
    """`epoch_count`, where it is no more than is possible."""
    epochs = epoch_count(duration_s, step_s)
    if epochs > MOST_EPOCHS:
        raise InputError(
            f"step_s: {step_s:g} s make {float(epochs):,.6g} epochs; at most {MOST_EPOCHS:,} are possible: for "
            f"{duration_s:g} s, steps of {duration_s / MOST_EPOCHS:g} s or more."
        )
    return epochs


def as_operations(operations: Any) -> tuple[AlertLimits, ...]:
    """Names of `OPERATIONS` and alert limits, made alert limits; an `InputError` for anything else."""
    alone = isinstance(operations, str | AlertLimits)
    given = [operations] if alone else require_list(operations, field="operations", of="names or alert limits")
    if not given:
        raise InputError(f"operations: at least one is needed (valid: {', '.join(OPERATIONS)}).")
    made: list[AlertLimits] = []
    for one in given:
        limits = OPERATIONS[operation_named(one, field="operations")] if isinstance(one, str) else one
        if not isinstance(limits, AlertLimits):
            raise InputError(
                f"operations: a name or alert limits such as pl_mc.LPV_200 are needed, not {type(one).__name__}."
            )
        if any(limits.name == other.name for other in made):
            raise InputError(f"operations: {limits.name} is asked for twice.")
        made.append(limits)
    return tuple(made)
