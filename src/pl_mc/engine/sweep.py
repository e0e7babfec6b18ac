"""The sweep: geometry x fault x noise, all methods on the same noise, counted in constant memory."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from pl_mc.alert import LPV_200, AlertLimits, as_axes, unjudged_note
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, notes_on_faults, notes_on_redundancy, require_inputs
from pl_mc.engine.execution import Execution, run_task, sweep_engine
from pl_mc.engine.table import EpochTotals, FaultTotals, epoch_table, fault_table
from pl_mc.engine.task import SweepTask
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_path, require_truth, require_whole
from pl_mc.methods import Method, as_methods
from pl_mc.noise_models import GAUSSIAN, NoiseModel, as_noise_model
from pl_mc.runtime.precision import dtype_of


def sweep(
    g: Geometry,
    faults: Faults,
    *,
    draws: int,
    seed: int,
    methods: Sequence[str | Method] = ("ls", "igg3"),
    alert: str | AlertLimits = LPV_200,
    axes: str | Sequence[str] | None = None,
    noise: str | NoiseModel = GAUSSIAN,
    precision: str = "float64",
    by_epoch: bool = False,
    workers: int | None = None,
    devices: int | None = None,
    scheduler: str | None = None,
    folder: Path | str | None = None,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Count alarms, hazards and missed detections of every method, for every fault at every epoch.

    Args:
        g: one epoch or a series.
        faults: from `ramp`, `biases`, `pairs` or `no_fault`; what is drawn of them is drawn anew for each draw of
            the noise, from numbers of its own.
        draws: noise draws for each fault at each epoch; every method and every fault sees the same draws.
        seed: chooses the noise, 0 to 2^32 - 1. The same seed gives the same counts.
        methods: names or records of methods.
        alert: alert limits, by name or as a record.
        axes: which of the limits decide, ``vertical``, ``horizontal`` or ``either`` of them, or several of these; the
            vertical one unless given, the horizontal one where there is no other.
        noise: how errors are distributed, a name or a record of `pl_mc.noise_models`; methods and weights go on
            believing that they have each satellite's sigma.
        precision: ``float64`` or ``float32``. Single precision draws other noise from the same seed, and none
            beyond 5.42 sigma: rates near 1e-7 are not to be had from it.
        by_epoch: one row for each epoch of a series, which takes memory for each, instead of sums over epochs.
        workers, devices, scheduler: what computes, see `pl_mc.engine.Execution`. No effect on the counts.
        folder: where to store finished parts, a Parquet file each with the rows of its epochs; none unless given.
        resume: go on with what ``folder`` holds of the same sweep.
        shard: (i, n), count one of n shares only; other processes count the others.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Returns:
        A table with one row per method, axis and fault: ``method, fault, bias_m, epochs, draws``, the counts ``alarms,
        hazards, missed, exceeded, misleading, false_alarms, unavailable, unconverged, tied`` (defined in
        `pl_mc.kernels.events`), and for each of them ``<event>_rate, <event>_low, <event>_high``: count / draws with
        95 % Clopper-Pearson bounds. Where one of the methods names the satellite that it excludes these are followed
        by ``right_exclusions, wrong_exclusions, failed_exclusions, no_exclusions``, of which each draw with a solution
        is one (zero for methods that do not). A column ``axis`` follows the method where axes were given or the
        horizontal one decides. For a single epoch, or ``by_epoch``, ``epoch`` stands in front instead of the
        number of ``epochs``. A fault counts at the epochs at which all its satellites are in view;
        ``table.attrs["notes"]`` says where they are not, ``table.attrs["unjudged"]`` which limit decides
        nothing.

    Raises:
        InputError: bad options, faults of another geometry, or a folder that cannot be used.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> faults = pl_mc.no_fault(g) + pl_mc.biases(g, "G08:+20m")
        >>> table = pl_mc.sweep(g, faults, draws=200, seed=7, methods="ls", progress=False)
        >>> table[["method", "fault", "draws", "alarms", "hazards", "missed"]]
          method     fault  draws  alarms  hazards  missed
        0     ls      none    200       0        0       0
        1     ls  G08:+20m    200     199        0       0
    """
    require_truth(resume, field="resume")
    if folder is None and (resume or shard is not None):
        raise InputError("folder: to resume a sweep, or to count a shard of it, a folder for the parts is needed.")
    execution = Execution(
        workers=workers, devices=devices, scheduler=scheduler,
        folder=None if folder is None else require_path(folder, field="folder"),
        resume=resume, shard=shard, progress=progress,
    )  # fmt: skip
    return run_sweep(
        g, faults, draws=draws, seed=seed, methods=methods, alert=alert, axes=axes, noise=noise,
        precision=precision, by_epoch=by_epoch, execution=execution,
    )  # fmt: skip


@ordinary_arithmetic
def run_sweep(
    g: Geometry,
    faults: Faults,
    *,
    draws: int,
    seed: int,
    methods: Sequence[str | Method],
    alert: str | AlertLimits,
    axes: str | Sequence[str] | None = None,
    precision: str,
    noise: str | NoiseModel = GAUSSIAN,
    by_epoch: bool = False,
    execution: Execution,
) -> pd.DataFrame:
    """`pl_mc.sweep`, with the way it runs as one record."""
    alert = require_inputs(g, faults, alert, any_axis=True, drawn=True)
    require_truth(by_epoch, field="by_epoch")
    task = SweepTask(
        geometry=g,
        faults=faults,
        draws=require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS),
        seed=require_whole(seed, field="seed", low=0, high=LARGEST_SEED),
        methods=as_methods(methods, g),
        alert=alert,
        precision=str(dtype_of(precision)),
        noise=as_noise_model(noise, g),
        axes=as_axes(axes, alert),
    )
    single = by_epoch or not g.is_series
    totals: EpochTotals | FaultTotals = EpochTotals.of(task) if single else FaultTotals.of(task)
    notes = [*notes_on_faults(g, faults), *notes_on_redundancy(g, task.methods)]
    if execution.shard is not None:
        notes.append("Shard {} of {}: the counts of its share alone.".format(*execution.shard))
    for found in run_task(task, execution, partial(sweep_engine(execution), task)):
        if isinstance(found, str):
            notes.append(found)
        else:
            totals.add(task, found)
    table = epoch_table(task, totals) if isinstance(totals, EpochTotals) else fault_table(task, totals)
    if axes is not None and "axis" not in table:
        table.insert(table.columns.get_loc("method") + 1, "axis", task.axes[0])
    table.attrs["notes"] = notes
    table.attrs["unjudged"] = unjudged_note(alert, task.axes)
    return table
