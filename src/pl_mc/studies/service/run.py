"""Experiments of the kind ``service``: availability and continuity over a grid of users and a day, with maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import pandas as pd
from pydantic import Field

from pl_mc.alert import EITHER, OPERATIONS, AlertLimits, as_limits
from pl_mc.engine import Execution
from pl_mc.error_models import ErrorModel, error_model
from pl_mc.geometry import Geometry, simulate
from pl_mc.noise_models import GAUSSIAN
from pl_mc.report.findings import Findings, Table
from pl_mc.report.maps import coastlines
from pl_mc.service.continuity import as_durations
from pl_mc.service.levels import levels_from_geometry
from pl_mc.service.sky import world_grid
from pl_mc.service.task import ServiceTask
from pl_mc.service.volume import (
    DAY_S,
    MOST_DRAWS,
    MOST_EPOCHS,
    ServiceVolume,
    as_operations,
    epoch_count,
    require_epochs,
    run_service,
    service_task,
)
from pl_mc.studies.service.text import summary
from pl_mc.studies.spec import Experiment, MethodChoice, NoiseChoice
from pl_mc.studies.study import Check, Work

# Sites of the lists of the worst.
WORST = 10

# Solutions a second, from the seconds of the shipped experiment's manifest, on two cores.
_SCENARIOS_PER_S = 4.8e5


class ServiceExperiment(Experiment):
    """A service volume.

    Attributes:
        alert: the operation that the maps of methods show.
        step_deg: width and height of a cell; it divides 180 [deg].
        step_s: time between epochs [s].
        duration_s: length of the run [s].
        durations_s: lengths of operations whose continuity is asked for [s].
        draws: noise draws at each geometry, for methods whose levels depend on the noise.
        noise: model of that noise, a table with a name and options of its own.
        site: the place of the sky plot, a name such as CUT0 or Earth-fixed X,Y,Z [m].
    """

    kind: Literal["service"] = "service"
    methods: tuple[MethodChoice, ...] = tuple(MethodChoice(name=name) for name in ("ls", "igg3", "araim"))
    draws: int = Field(default=100, ge=1, le=MOST_DRAWS)
    noise: NoiseChoice = NoiseChoice(name="gaussian")
    operations: tuple[str, ...] = Field(
        default=("LPV-200",),
        description=f"operations of the tables, of {', '.join(OPERATIONS)}; the one of the maps is added where it "
        "is missing",
    )
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
        own = self.alert_limits()
        return as_operations(self.operations if own.name in self.operations else (own, *self.operations))

    def alert_limits(self) -> AlertLimits:
        """Those of the maps, of which both decide."""
        return as_limits(self.given_limits())

    def judged_axes(self) -> tuple[str, ...]:
        """Both levels have to be within their limits."""
        return (EITHER,)

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
        volume = self.volume(experiment, execution)
        volume.world.attrs["notes"] = list(volume.notes)
        return volume.world


def sweeps(experiment: ServiceExperiment) -> tuple[PlannedService, ...]:
    """What the experiment counts in parts; a run that was stopped goes on with them."""
    return (PlannedService(),)


def run(experiment: ServiceExperiment, execution: Execution) -> Findings:
    """Rates over the world, the worst sites, maps, and the sky over one site."""
    # What is wrong with the site is said before the long part.
    experiment.sky()
    volume = PlannedService().volume(experiment, execution)
    worst = worst_sites(volume)
    return Findings(
        summary=summary(_setting(experiment, volume), volume, worst),
        tables=(
            Table("world", volume.world),
            Table("worst_sites", worst),
            Table("satellites", volume.satellites),
            *(Table(name, getattr(volume, name), stored="parquet") for name in ("sites", "levels", "by_epoch")),
        ),
        notes=(*_notes(experiment, volume), *volume.notes),
    )


def work(experiment: ServiceExperiment) -> Work:
    """Solutions at all sites and epochs; one draw tells all of a method whose levels depend on geometry alone."""
    epochs = require_epochs(experiment.duration_s, experiment.step_s)
    draws = sum(1 if levels_from_geometry(one) else experiment.draws for one in experiment.method_records())
    scenarios = len(world_grid(experiment.step_deg)) * epochs * draws
    return Work(scenarios, scenarios / _SCENARIOS_PER_S)


def checks(experiment: ServiceExperiment, g: Geometry | None) -> Iterator[Check]:
    """Operations, grid, epochs, and the satellites, for which this kind has fields of its own."""
    step_s, duration_s = experiment.step_s, experiment.duration_s
    yield "operations", lambda: as_operations(experiment.operations)
    yield "step_deg", lambda: world_grid(experiment.step_deg)
    yield "step_s", lambda: require_epochs(duration_s, step_s)
    epochs = epoch_count(duration_s, step_s)
    if epochs <= MOST_EPOCHS:
        yield "durations_s", lambda: as_durations(experiment.durations_s, step_s=step_s, epochs=epochs)
    yield "error_model", experiment.model
    # Fields one by one, so that one that is wrong hides no other.
    names = experiment.constellations
    yield "site", lambda: simulate(site=experiment.site, epochs=1)
    yield "start", lambda: simulate(start=experiment.start, epochs=1)
    yield "constellations", lambda: simulate(constellations=names, without=experiment.without, epochs=1)


def worst_sites(volume: ServiceVolume) -> pd.DataFrame:
    """The sites with the lowest availability of each method and operation, of those below one."""
    parts = [
        volume.worst_sites(method, limits.name, most=WORST) for method in volume.methods for limits in volume.operations
    ]
    return pd.concat([rows[rows.availability_rate < 1.0] for rows in parts], ignore_index=True)


def _setting(experiment: ServiceExperiment, volume: ServiceVolume) -> str:
    noisy, exact = [name for name in volume.methods if name not in volume.exact], ", ".join(volume.exact)
    epochs, sites = len(volume.time_gps_s), len(volume.grid)
    scenarios = f"{epochs * sites * volume.draws:,} scenarios for {', '.join(noisy)}" if noisy else ""
    counted = filter(None, (scenarios, f"one for each geometry for {exact}" if exact else ""))
    law = "" if volume.noise == GAUSSIAN.name else f", noise {volume.noise}"
    off = f", without {', '.join(experiment.without)}" if experiment.without else ""
    fewest, mean = volume.satellites.satellites_min.min(), volume.satellites.satellites_mean
    return (
        f"{sites:,} users in cells of {volume.grid.step_deg:g} deg, {epochs} epochs of {volume.step_s:g} s from "
        f"{experiment.start}; {', '.join(experiment.constellations)}{off}, {experiment.mask_deg:g} deg mask, error "
        f"model {experiment.error_model}{law}, seed {volume.seed}: {'; '.join(counted)}. Satellites in view: "
        f"{fewest} at least, {(volume.grid.weight * mean).sum():.1f} on average."
    )


def _notes(experiment: ServiceExperiment, volume: ServiceVolume) -> tuple[str, ...]:
    is_gaussian, exact = volume.noise == GAUSSIAN.name, ", ".join(volume.exact)
    law = "Gaussian" if is_gaussian else f"after the model {volume.noise}"
    notes = [
        "An operation is available where a method has a solution with VPL and HPL within the operation's limits; "
        f"errors are fault-free and {law}, constellations nominal, users on the ellipsoid without terrain.",
        "Continuity is told by whole steps between epochs: an outage between two of them is not seen, every epoch "
        "draws its own noise, and false alerts and failures of satellites are not part of it.",
        "Levels are taken as they are and do not keep the same risk: more availability is no merit by itself. "
        "Without a fault, at one epoch over CUT0, least squares with K 5.33 is exceeded in about 2e-4 of draws and "
        "IGG-III in about 2e-3, while ARAIM is made for 1e-7.",
    ]
    if exact and not is_gaussian:
        notes.append(f"{exact}: the noise model is nothing to levels of the geometry alone.")
    if exact:
        notes.append(
            f"{exact}: levels depend on the geometry alone, so that one draw tells all; bounds of the availability "
            "say at which moment within a step service may have changed, and continuity has no sampling interval: "
            "its bounds are its value."
        )
    if experiment.without:
        notes.append(f"Switched off: {', '.join(experiment.without)}.")
    if not coastlines():
        notes.append("The maps have no coastlines: their package is not installed (pip install 'pl_mc[maps]').")
    return tuple(notes)
