"""Experiments of the kind ``stanford``: vertical error against protection level over many scenarios."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.engine.stanford import REGIONS, Grid, StanfordCounts, stanford_counts
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, no_fault, ramps
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.figures import method_label, save_figure
from pl_mc.report.text import markdown_table, rate_text
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.stanford.figures import stanford_figure
from pl_mc.studies.sweep.map import RampSizes

# The regions that are parts of the plane.
_IN_PLANE = 6


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


def run(experiment: StanfordExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``stanford.csv`` (counts by cell), ``regions.csv`` and the diagram.

    Returns:
        The summary in Markdown, and notes.
    """
    alert, grid = experiment.alert_limits(), Grid(experiment.reach_m, experiment.cell_m)
    grid.require_limit(alert.vertical_m)
    g = scaled_noise(experiment.geometry.build(), experiment.noise_scale)
    found = stanford_counts(
        g, _faults(experiment, g), draws=experiment.draws, seed=experiment.seed,
        methods=experiment.method_records(), alert=alert, grid=grid, precision=experiment.precision,
        workers=execution.workers, progress=execution.progress,
    )  # fmt: skip
    regions = found.regions()
    write_table(found.cells(), folder, "stanford")
    write_table(regions, folder, "regions")
    figure = stanford_figure(
        found.counts[:, :_IN_PLANE].sum(axis=1), regions, grid.edges_m, alert=alert, title=experiment.title
    )
    save_figure(figure, folder, "stanford")
    return _summary(experiment, g, found, regions), ()


def scaled_noise(g: Geometry, factor: float) -> Geometry:
    """The geometry with every sigma multiplied."""
    return g if factor == 1.0 else dataclasses.replace(g, sigma_m=g.sigma_m * factor)


def _faults(experiment: StanfordExperiment, g: Geometry) -> Faults:
    sizes = experiment.faults
    if sizes is None:
        if experiment.satellites:
            raise InputError("satellites: they get a ramp, which faults has to give.")
        return no_fault(g)
    names = experiment.satellites or g.names
    return ramps(g, satellites=names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)


def _summary(experiment: StanfordExperiment, g: Geometry, found: StanfordCounts, regions: pd.DataFrame) -> str:
    alert, sizes = experiment.alert_limits(), experiment.faults
    rows = []
    for region in REGIONS:
        part = regions[regions.region == region].set_index("method")
        cells = [region]
        for method in found.methods:
            row = part.loc[method]
            text = rate_text(int(row["count"]), int(row["scenarios"]), row["low"], row["high"])
            cells += [f"{int(row['count']):,}", text]
        rows.append(cells)
    what = (
        "fault-free"
        if sizes is None
        else f"{sizes.start_m:g} to {sizes.stop_m:g} m in steps of {sizes.step_m:g} m on "
        f"{', '.join(experiment.satellites) or 'every satellite'} in turn, each size as often as the others"
    )
    epochs = f"{len(g)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    lines = [
        f"# {experiment.title}",
        "",
        f"{epochs}, {what}; {experiment.draws:,} draws each, seed {experiment.seed}, sigma times "
        f"{experiment.noise_scale:g}: {found.scenarios:,} scenarios a method. {alert.name}, VAL "
        f"{alert.vertical_m:g} m. Rates over all scenarios with 95 % bounds that count each noise draw once "
        f"({found.independent_draws:,}), since all faults of an epoch share its noise. They are means over the "
        "faults of this run, not risks of a flight: a fault has no probability here.",
        "",
        markdown_table(["region", *(f"{w}, {m}" for m in found.methods for w in ("count", "rate"))], rows),
        "",
        "system unavailable: VPL > VAL, an alarm. misleading: error beyond the level without an alarm, but within "
        "VAL. hazardously misleading: beyond VAL, which is a missed detection. Together they are what a sweep "
        "calls misleading.",
        "",
        "; ".join(f"{m}: {method_label(m)}" for m in found.methods if method_label(m) != m) + ".",
    ]
    return "\n".join(lines) + "\n"
