"""Experiments of the kind ``service``: availability and continuity over a grid of users and a day, with maps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd
from pydantic import Field

from pl_mc.alert import OPERATIONS, AlertLimits
from pl_mc.engine import Execution
from pl_mc.error_models import ErrorModel, error_model
from pl_mc.experiments.output import write_table
from pl_mc.geometry import Geometry, simulate
from pl_mc.noise_models import GAUSSIAN
from pl_mc.report.coastlines import coastlines
from pl_mc.report.figures import save_figure
from pl_mc.report.sky_plot import sky_figure
from pl_mc.service.task import ServiceTask
from pl_mc.service.volume import (
    DAY_S,
    MOST_DRAWS,
    ServiceVolume,
    as_operations,
    epoch_count,
    run_service,
    service_task,
)
from pl_mc.studies.service.figures import (
    availability_maps,
    day_figure,
    operation_maps,
    satellite_maps,
    vertical_level_maps,
)
from pl_mc.studies.service.text import service_summary
from pl_mc.studies.spec import Experiment, MethodChoice
from pl_mc.studies.sweep.run import NoiseChoice

# Sites of the lists of the worst.
WORST = 10


class ServiceExperiment(Experiment):
    """A service volume.

    Attributes:
        alert: the operation that the maps of methods show.
        operations: operations of the tables; the one of the maps is added where it is missing.
        step_deg: width and height of a cell; it divides 180 [deg].
        step_s: time between epochs [s].
        duration_s: length of the run [s].
        durations_s: lengths of operations whose continuity is asked for [s].
        draws: noise draws at each geometry, for methods whose levels depend on the noise.
        noise: model of that noise, a table with a name and options of its own.
        site: the place of the sky plot, a name such as CUT0 or Earth-fixed X,Y,Z [m].
    """

    kind: Literal["service"] = "service"
    methods: tuple[MethodChoice, ...] = (
        MethodChoice(name="ls"),
        MethodChoice(name="igg3"),
        MethodChoice(name="araim"),
    )
    draws: int = Field(default=100, ge=1, le=MOST_DRAWS)
    noise: NoiseChoice = NoiseChoice(name="gaussian")
    operations: tuple[str, ...] = ("LPV-200",)
    step_deg: float = Field(default=5.0, gt=0)
    step_s: float = Field(default=300.0, gt=0)
    duration_s: float = Field(default=DAY_S, gt=0)
    durations_s: tuple[float, ...] = (15.0, 150.0)
    start: str = "2017-11-21T00:00:00"
    mask_deg: float = Field(default=10.0, ge=0, lt=90)
    constellations: tuple[str, ...] = ("GPS", "GAL")
    without: tuple[str, ...] = ()
    error_model: str = "residual"
    error_options: dict[str, Any] = Field(default_factory=dict)
    site: str = "CUT0"

    def model(self) -> ErrorModel:
        """The error model."""
        return error_model(self.error_model, **self.error_options)

    def limits(self) -> tuple[AlertLimits, ...]:
        """All operations, that of the maps included."""
        names = self.operations if self.alert in self.operations else (self.alert, *self.operations)
        return as_operations(names)

    def task(self) -> ServiceTask:
        """The service volume, checked."""
        return service_task(
            constellations=self.constellations, without=self.without, step_deg=self.step_deg, step_s=self.step_s,
            duration_s=self.duration_s, start=self.start, mask_deg=self.mask_deg, error_model=self.model(),
            methods=self.method_records(), operations=self.limits(), durations_s=self.durations_s,
            draws=self.draws, seed=self.seed, noise=self.noise.build(), precision=self.precision,
        )  # fmt: skip

    def sky(self) -> Geometry:
        """The satellites over the site of the sky plot, at the epochs of the run but no more than a day of them."""
        epochs = epoch_count(min(self.duration_s, DAY_S), self.step_s)
        return simulate(
            site=self.site, start=self.start, epochs=epochs, interval_s=self.step_s, mask_deg=self.mask_deg,
            constellations=self.constellations, without=self.without, error_model=self.model(),
        )  # fmt: skip


@dataclass(frozen=True)
class PlannedService:
    """A service volume in the place of a sweep: what is stored, resumed and shared of a run.

    Attributes:
        name: of its folder within the run's.
    """

    name: str = "service"

    def volume(self, experiment: ServiceExperiment, execution: Execution) -> ServiceVolume:
        """What it found; parts are stored in a folder of its own."""
        return run_service(experiment.task(), execution.inside(self.name), step_s=experiment.step_s)

    def run(self, experiment: ServiceExperiment, execution: Execution) -> pd.DataFrame:
        """Rates over the world, with sentences about parts in ``attrs["notes"]``."""
        found = self.volume(experiment, execution)
        found.world.attrs["notes"] = list(found.notes)
        return found.world


def sweeps(experiment: ServiceExperiment) -> tuple[PlannedService, ...]:
    """What the experiment counts in parts; a run that was stopped goes on with them."""
    return (PlannedService(),)


def run(experiment: ServiceExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``world.csv``, ``worst_sites.csv``, ``sites.parquet``, ``levels.parquet``, ``satellites.csv``,
    ``by_epoch.parquet`` and the maps.

    Returns:
        The summary in Markdown, and notes.
    """
    alert = OPERATIONS[experiment.alert_limits().name]
    # What is wrong with the site is said before the long part.
    sky = experiment.sky()
    found = sweeps(experiment)[0].volume(experiment, execution)
    worst = worst_sites(found)
    write_table(found.world, folder, "world")
    write_table(worst, folder, "worst_sites")
    write_table(found.satellites, folder, "satellites")
    for name in ("sites", "levels", "by_epoch"):
        getattr(found, name).to_parquet(folder / f"{name}.parquet", index=False, compression="zstd")
    what = experiment.title
    save_figure(availability_maps(found, alert, title=what), folder, "world_availability")
    save_figure(vertical_level_maps(found, title=what), folder, "world_levels")
    save_figure(operation_maps(found, title=what), folder, "world_operations")
    save_figure(satellite_maps(found, title=what), folder, "world_satellites")
    save_figure(day_figure(found, title=what), folder, "world_day")
    title = f"Satellites over {experiment.site}, {experiment.mask_deg:g} deg mask; names at the first epoch"
    save_figure(sky_figure(sky, mask_deg=experiment.mask_deg, title=title), folder, "sky")
    return service_summary(experiment, found, worst), (*_notes(experiment, found), *found.notes)


def worst_sites(found: ServiceVolume) -> pd.DataFrame:
    """The sites with the lowest availability of each method and operation, of those below one."""
    parts = []
    for method in found.methods:
        for limits in found.operations:
            rows = found.worst_sites(method, limits.name, most=WORST)
            parts.append(rows[rows.availability_rate < 1.0])
    return pd.concat(parts, ignore_index=True)


def _notes(experiment: ServiceExperiment, found: ServiceVolume) -> tuple[str, ...]:
    notes = [
        "An operation is available where a method has a solution with VPL and HPL within the operation's limits; "
        f"errors are fault-free and {_law(found)}, constellations nominal, users on the ellipsoid "
        "without terrain.",
        "Continuity is told by whole steps between epochs: an outage between two of them is not seen, every epoch "
        "draws its own noise, and false alerts and failures of satellites are not part of it.",
        "Levels are taken as they are and do not keep the same risk: more availability is no merit by itself. "
        "Without a fault, at one epoch over CUT0, least squares with K 5.33 is exceeded in about 2e-4 of draws and "
        "IGG-III in about 2e-3, while ARAIM is made for 1e-7.",
    ]
    if found.noise != GAUSSIAN.name and found.exact:
        notes.append(f"{', '.join(found.exact)}: the noise model is nothing to levels of the geometry alone.")
    if found.exact:
        notes.append(
            f"{', '.join(found.exact)}: levels depend on the geometry alone, so that one draw tells all; bounds of "
            "the availability say at which moment within a step service may have changed, and continuity has no "
            "sampling interval: its bounds are its value."
        )
    if experiment.without:
        notes.append(f"Switched off: {', '.join(experiment.without)}.")
    if not coastlines():
        notes.append("The maps have no coastlines: their package is not installed (pip install 'pl_mc[maps]').")
    return tuple(notes)


def _law(found: ServiceVolume) -> str:
    """How errors are distributed, in words."""
    return "Gaussian" if found.noise == GAUSSIAN.name else f"after the model {found.noise}"
