"""Experiments of the kind ``stanford``: error against protection level over many scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.engine.stanford import REGIONS, Grid, StanfordCounts, stanford_counts
from pl_mc.faults import Faults, no_fault, ramps, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.document import Summary, TextTable
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.report.stanford import stanford_figure
from pl_mc.report.text import by_method, method_key, row_rate
from pl_mc.studies.fault_fields import ListedFaults, RampSizes, SizesOrFaults
from pl_mc.studies.spec import ByOneLevel, Distinct, SimulatedGeometry, scaled_noise
from pl_mc.studies.study import Check, Work, refuse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The regions that are parts of the plane.
_IN_PLANE = 6

# Scenarios a second of both methods of the shipped experiment, from the seconds of its manifest, on two cores.
_SCENARIOS_PER_S = 3.4e5

_MEANS = {
    "misleading": "The {error} is beyond the protection level but within the alert limit, without alarm",
    "hazardously misleading": "It is beyond the alert limit without alarm (hazardously misleading)",
    "system unavailable": "The protection level is above the alert limit (an alarm)",
}


class StanfordExperiment(ByOneLevel):
    """Scenarios of a series, put into cells.

    Attributes:
        draws: noise draws for each fault at each epoch.
        geometry: the series, or one epoch.
        noise_scale: factor of every sigma, in the noise and in the weights.
        faults: the ramp, or ``biases``, faults as texts; the fault-free case unless given.
        satellites: satellites that get the ramp, one at a time; all of the geometry unless given.
        reach_m, cell_m: where the cells end, and how wide they are [m].
    """

    kind: Literal["stanford"] = "stanford"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry()
    noise_scale: float = Field(default=1.0, gt=0)
    faults: SizesOrFaults | None = None
    satellites: Distinct = ()
    reach_m: float = 60.0
    cell_m: float = 0.5


def run(experiment: StanfordExperiment, execution: Execution) -> Findings:
    """Counts by cell and by region, and the diagram."""
    judged, grid = experiment.decides, Grid(experiment.reach_m, experiment.cell_m)
    ((_, _, limit_m),) = judged.levels
    grid.require_limit(limit_m)
    g = scaled_noise(experiment.geometry.build(), experiment.noise_scale)
    counts = stanford_counts(
        g, _faults(experiment, g), draws=experiment.draws, seed=experiment.seed,
        methods=experiment.method_records(), alert=judged.alert, grid=grid, axis=judged.axis,
        precision=experiment.precision, workers=execution.workers, progress=execution.progress,
    )  # fmt: skip
    regions, cells = (experiment.with_axis(table) for table in (counts.regions(), counts.cells()))
    return Findings(
        summary=summary(experiment, g, counts, regions),
        tables=(Table("stanford", cells), Table("regions", regions)),
        notes=g.notes,
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: StanfordExperiment) -> tuple[Picture, ...]:
    """The diagram."""
    judged, edges_m = experiment.decides, Grid(experiment.reach_m, experiment.cell_m).edges_m

    def draw() -> Figure:
        cells, regions = stored["stanford"], stored["regions"]
        methods = list(dict.fromkeys(regions.method))
        cells = cells[cells.region.isin(REGIONS[:_IN_PLANE])]
        plane = np.zeros((len(methods), edges_m.size - 1, edges_m.size - 1), dtype=np.int64)
        error, level = (np.rint(cells[f"{what}_from_m"] / experiment.cell_m).astype(int) for what in ("error", "level"))
        np.add.at(plane, (pd.Index(methods).get_indexer(cells.method), error, level), cells["count"])
        return stanford_figure(plane, regions, edges_m, judged=judged, title=experiment.title)

    caption = (
        f"{judged.axis.capitalize()} error against {judged.axis} protection level, number of scenarios in each cell."
    )
    return (Picture("stanford", caption, draw),)


def work(experiment: StanfordExperiment) -> Work:
    """What a run costs."""
    g = experiment.geometry.build()
    cases = int(_faults(experiment, g).applies(g).sum()) * experiment.draws
    scenarios = cases * len(experiment.method_records())
    # The rate is of two methods, counted once.
    return Work(scenarios, scenarios / 2 / _SCENARIOS_PER_S)


def checks(experiment: StanfordExperiment, g: Geometry | None) -> Iterator[Check]:
    """The plane holds the alert limit, and satellites have a ramp."""
    # Wrong limits are told of as such.
    with suppress(InputError):
        ((_, _, limit_m),) = experiment.decides.levels
        yield "reach_m", lambda: Grid(experiment.reach_m, experiment.cell_m).require_limit(limit_m)
    if not isinstance(experiment.faults, RampSizes) and experiment.satellites:
        yield "satellites", lambda: refuse("they get a ramp, which faults has to give.")
    if g is not None:
        for name in experiment.satellites:
            yield "satellites", partial(require_satellite, g, name)


def _faults(experiment: StanfordExperiment, g: Geometry) -> Faults:
    sizes = experiment.faults
    if not isinstance(sizes, RampSizes):
        if experiment.satellites:
            raise InputError("satellites: they get a ramp, which faults has to give.")
        return no_fault(g) if sizes is None else sizes.build(g)[0]
    names = experiment.satellites or g.names
    return ramps(g, satellites=names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)


def summary(experiment: StanfordExperiment, g: Geometry, counts: StanfordCounts, regions: pd.DataFrame) -> Summary:
    """The blocks of the summary; ``regions`` is the table of that name."""
    judged, sizes = experiment.decides, experiment.faults
    (called,) = judged.called
    by_region = regions.set_index(["region", "method"])
    rows = []
    for region in REGIONS:
        parts = [by_region.loc[(region, method)] for method in counts.methods]
        rows.append([region, *(cell for row in parts for cell in (f"{int(row['count']):,}", _rate(row)))])
    what = (
        "fault-free"
        if sizes is None
        else sizes.describe()
        if isinstance(sizes, ListedFaults)
        else f"{sizes.start_m:g} to {sizes.stop_m:g} m in steps of {sizes.step_m:g} m on "
        f"{', '.join(experiment.satellites) or 'every satellite'} in turn, each size as often as the others"
    )
    epochs = f"{len(g)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    return (
        f"{epochs}, {what}; {experiment.draws:,} draws each, seed {experiment.seed}, sigma times "
        f"{experiment.noise_scale:g}: {counts.scenarios:,} scenarios a method. {judged.alert.name}, "
        f"{judged.limits()}. Rates over all scenarios with 95 % bounds that count each noise draw once "
        f"({counts.independent_draws:,}), since all faults of an epoch share its noise. They are means over "
        "the faults of this run, not risks of a flight: a fault has no probability here.",
        TextTable.of(["region", *(f"{word}, {m}" for m in counts.methods for word in ("count", "rate"))], rows),
        f"system unavailable: {judged.alarm}, an alarm. misleading: error beyond the level without an alarm, but "
        f"within {called.limit}. hazardously misleading: beyond {called.limit}, which is a missed detection. Together "
        "they are what a sweep calls misleading.",
        method_key(counts.methods, judged.axis),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: StanfordExperiment) -> tuple[str, ...]:
    """How often misleading, hazardously misleading and unavailable."""
    rows, judged = list(tables["regions"].itertuples()), experiment.decides
    (called,) = judged.called

    def in_rate(row: Any) -> str:
        return f"in {_rate(row._asdict())}"

    return tuple(
        f"{means.format(error=called.error)}: "
        f"{by_method((row for row in rows if row.region == region), in_rate, judged.axis)} of all scenarios."
        for region, means in _MEANS.items()
    )


def _rate(row: Any) -> str:
    return row_rate(row, "count", "scenarios")
