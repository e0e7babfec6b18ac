"""Experiments of the kind ``stanford``: vertical error against protection level over many scenarios."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Literal

from pydantic import Field

from pl_mc.alert import BY_NAME
from pl_mc.engine import Execution
from pl_mc.engine.stanford import Grid, stanford_counts
from pl_mc.faults import Faults, no_fault, ramps, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.studies.spec import Experiment, RampSizes, SimulatedGeometry, scaled_noise
from pl_mc.studies.stanford.figures import stanford_figure
from pl_mc.studies.stanford.text import summary
from pl_mc.studies.study import Check, Work, refuse

# The regions that are parts of the plane.
_IN_PLANE = 6

# Scenarios a second of both methods of the shipped experiment, from the seconds of its manifest, on two cores.
_SCENARIOS_PER_S = 3.4e5


class StanfordExperiment(Experiment):
    """Scenarios of a series, put into cells.

    Attributes:
        draws: noise draws for each fault at each epoch.
        geometry: the series, or one epoch.
        noise_scale: factor of every sigma, in the noise and in the weights.
        faults: the ramp; the fault-free case unless given.
        satellites: satellites that get the ramp, one at a time; all of the geometry unless given.
        reach_m, cell_m: where the cells end, and how wide they are [m].
    """

    kind: Literal["stanford"] = "stanford"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry()
    noise_scale: float = Field(default=1.0, gt=0)
    faults: RampSizes | None = None
    satellites: tuple[str, ...] = ()
    reach_m: float = 60.0
    cell_m: float = 0.5


def run(experiment: StanfordExperiment, execution: Execution) -> Findings:
    """Counts by cell and by region, and the diagram."""
    alert, grid = experiment.alert_limits(), Grid(experiment.reach_m, experiment.cell_m)
    grid.require_limit(alert.vertical_m)
    g = scaled_noise(experiment.geometry.build(), experiment.noise_scale)
    counts = stanford_counts(
        g, _faults(experiment, g), draws=experiment.draws, seed=experiment.seed,
        methods=experiment.method_records(), alert=alert, grid=grid, precision=experiment.precision,
        workers=execution.workers, progress=execution.progress,
    )  # fmt: skip
    regions = counts.regions()
    plane = counts.counts[:, :_IN_PLANE].sum(axis=1)
    figure = stanford_figure(plane, regions, grid.edges_m, alert=alert, title=experiment.title)
    return Findings(
        summary=summary(experiment, g, counts, regions),
        tables=(Table("stanford", counts.cells()), Table("regions", regions)),
        pictures=(
            Picture(
                "stanford", figure,
                "Vertical error against vertical protection level, number of scenarios in each cell.",
            ),
        ),
    )  # fmt: skip


def work(experiment: StanfordExperiment) -> Work:
    """What a run costs."""
    g = experiment.geometry.build()
    cases = int(_faults(experiment, g).applies(g).sum()) * experiment.draws
    scenarios = cases * len(experiment.method_records())
    # The rate is of two methods, counted once.
    return Work(scenarios, scenarios / 2 / _SCENARIOS_PER_S)


def checks(experiment: StanfordExperiment, g: Geometry | None) -> Iterator[Check]:
    """The plane holds the alert limit, and satellites have a ramp."""
    limit_m = BY_NAME[experiment.alert].vertical_m if experiment.alert in BY_NAME else 0.0
    yield "reach_m", lambda: Grid(experiment.reach_m, experiment.cell_m).require_limit(limit_m)
    if experiment.faults is None and experiment.satellites:
        yield "satellites", lambda: refuse("they get a ramp, which faults has to give.")
    if g is not None:
        for name in experiment.satellites:
            yield "satellites", partial(require_satellite, g, name)


def _faults(experiment: StanfordExperiment, g: Geometry) -> Faults:
    sizes = experiment.faults
    if sizes is None:
        if experiment.satellites:
            raise InputError("satellites: they get a ramp, which faults has to give.")
        return no_fault(g)
    names = experiment.satellites or g.names
    return ramps(g, satellites=names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)
