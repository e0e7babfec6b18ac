"""Experiments of the kind ``observe``: real receiver files, every method at every epoch, with injected faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pl_mc.engine import Execution, solve
from pl_mc.engine.drawn_biases import numbers_of_draw
from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry import Geometry
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.injection import inject
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_receiver_series, read_truth
from pl_mc.report.findings import Findings, Table
from pl_mc.runtime.progress import progress_bar
from pl_mc.studies.observe.claims import read_all
from pl_mc.studies.observe.course import course_table
from pl_mc.studies.observe.record import ObserveExperiment
from pl_mc.studies.observe.sky_figures import pictures_of_files
from pl_mc.studies.observe.stanford import stanford_table
from pl_mc.studies.observe.text import summary
from pl_mc.studies.spec import numbered
from pl_mc.studies.study import Check, Work, refuse

# A day with an epoch every 30 s takes less than a series of it, which is solved 42 times [s].
_SECONDS_A_DAY = 1.2

# Of the progress that is shown: files, methods, counts.
_STEPS = 3


def run(experiment: ObserveExperiment, execution: Execution) -> Findings:
    """Every epoch by every method, and the errors over the epochs."""
    with progress_bar(total=_STEPS, what="Read, solve, count", show=execution.progress) as advance:
        return _run(experiment, advance)


def _run(experiment: ObserveExperiment, advance: Callable[[], None]) -> Findings:
    files = experiment.input_files()
    truth = read_truth(str(files["truth"]) if experiment.has_track() else experiment.truth)
    series = read_receiver_series(
        _of(files, "observations"), _of(files, "navigation"), truth, systems=experiment.systems,
        signals=experiment.signals, mask_deg=experiment.mask_deg, error_model=experiment.model(),
        ionosphere=experiment.ionosphere, snr_dbhz=experiment.snr_dbhz,
        ionex=_of(files, "ionex") or None,
    )  # fmt: skip
    advance()
    g = series.geometry
    _require_solution(experiment, g, series.notes)
    injected = Faults.joined([no_fault(g), *(biases(g, text) for text in experiment.faults)])
    numbers = numbers_of_draw(g, seed=experiment.seed) if injected.drawn.any() else None
    errors_m, faulted, notes = inject(g, series.errors_m, injected, numbers)
    judged = experiment.decides
    table = solve(
        g, errors_m, methods=experiment.method_records(), alert=judged.alert, axis=judged.axis,
        precision=experiment.precision, tests=True,
    )  # fmt: skip
    advance()
    claims = read_all(_of(files, "claims"), g, truth)
    rows = [part for one in claims for part in one.rows(g, judged, experiment.claim_multiplier)]
    table = pd.concat([table.assign(faulted=table.epoch.map(pd.Series(faulted, index=g.epoch))), *rows])
    table["faulted"] = table.faulted.eq(True)
    table = table.sort_values("epoch", kind="stable").reset_index(drop=True)
    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    stanford = stanford_table(table, judged.alert)
    coverage = pd.DataFrame([row for one in claims for row in one.coverage(g)])
    advance()
    errors = series.residuals()
    pictures = pictures_of_files(g, table, errors, series.truth_m, experiment.title)
    if not table.rejected.any():
        del table["rejected"]
    experiment.with_axis(table)
    counted = [Table("stanford", stanford), *([Table("coverage", coverage)] if len(coverage) else [])]
    residuals = [Table("residuals", errors, stored="parquet")] if experiment.residuals else []
    return Findings(
        summary=summary(experiment, table, injected, series.signals, claims, stanford, coverage),
        tables=(Table("epochs", table, stored="both"), course_table(table), *counted, *residuals),
        pictures=pictures,
        notes=(*truth.notes, *series.notes, *notes, *(note for one in claims for note in one.notes)),
    )


def work(experiment: ObserveExperiment) -> Work:
    """What a run costs; how long the files are shows only when they are read."""
    return Work(None, _SECONDS_A_DAY, "for files of a day with an epoch every 30 s")


def checks(experiment: ObserveExperiment, g: Geometry | None) -> Iterator[Check]:
    """Every file is there."""
    for field, path in experiment.input_files().items():
        if not path.is_file():
            yield field, partial(refuse, f"{field}: {path}: there is no such file.")


def _of(files: Mapping[str, Path], field: str) -> list[Path]:
    """The files of a field that may have several."""
    return [path for name, path in files.items() if name.split()[0] == field]


def _require_solution(experiment: ObserveExperiment, g: Geometry, notes: Sequence[str]) -> None:
    """Raise `InputError` where no epoch has as many satellites as there are unknowns."""
    seen, unknown = g.in_view.sum(axis=1), g.unknown_count
    if (seen >= unknown).any():
        return
    best = int(np.argmax(seen - unknown))
    named = " and ".join(map(str, numbered("observations", experiment.observations).values()))
    because = f" Notes: {' '.join(notes)}" if notes else ""
    raise InputError(
        f"{named}: no epoch has a solution; at best {seen[best]} of the {unknown[best]} satellites "
        f"that are needed are in view (epoch {g.epoch[best]}), three for the position and one for the clock of each "
        f"system.{because}"
    )
