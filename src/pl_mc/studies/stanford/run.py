"""Experiments of the kind ``stanford``: error against protection level over many scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from pydantic import Field

from pl_mc.alert import Judged
from pl_mc.engine import Execution
from pl_mc.engine.stanford import REGIONS, Grid, StanfordCounts, stanford_counts
from pl_mc.faults import Faults, no_fault, ramps, require_satellite
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.report.document import Summary, TextTable
from pl_mc.report.figures import DASHED, in_common_look, method_label, new_figure, note
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.report.text import by_method, method_key, row_rate
from pl_mc.studies.fault_fields import ListedFaults, RampSizes, SizesOrFaults
from pl_mc.studies.spec import ByOneLevel, Distinct, SimulatedGeometry, scaled_noise
from pl_mc.studies.study import Check, Work, refuse

# The regions that are parts of the plane.
_IN_PLANE = 6

# Scenarios a second of both methods of the shipped experiment, from the seconds of its manifest, on two cores.
_SCENARIOS_PER_S = 3.4e5

_MEANS = {
    "misleading": "The {error} is beyond the protection level but within the alert limit, without alarm",
    "hazardously misleading": "It is beyond the alert limit without alarm (hazardously misleading)",
    "system unavailable": "The protection level is above the alert limit (an alarm)",
}

# Shades of the regions in which something is wrong; the counts lie over them.
_MISLEADING, _HAZARDOUS, _UNAVAILABLE = "#FBE7D3", "#F3C6AE", "0.93"
# Cells are coloured from light to dark, so that many is dark in grey too and an empty cell shows its region.
_COLOURS = "viridis_r"


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
    plane = counts.counts[:, :_IN_PLANE].sum(axis=1)
    return Findings(
        summary=summary(experiment, g, counts, regions),
        tables=(Table("stanford", cells), Table("regions", regions)),
        pictures=(
            Picture(
                "stanford",
                stanford_figure(plane, regions, grid.edges_m, judged=judged, title=experiment.title),
                f"{judged.axis.capitalize()} error against {judged.axis} protection level, number of scenarios in each "
                "cell.",
            ),
        ),
        notes=g.notes,
    )


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


@in_common_look
def stanford_figure(
    plane: NDArray[np.int64], regions: pd.DataFrame, edges_m: NDArray[np.float64], *, judged: Judged, title: str
) -> Figure:
    """One panel per method, all with the same axes and colours.

    Args:
        plane: (methods, cells + 1, cells + 1), counts by cell of error and level; the last of each axis is beyond.
        regions: ``method, region, count, scenarios, rate, low, high``, methods in the order of ``plane``.
        edges_m: (cells + 2,), edges of the cells, the last infinite [m].
        judged: the axis with its limit, which is drawn.
        title: heading.
    """
    methods, (called,), ((_, _, limit_m),) = list(dict.fromkeys(regions.method)), judged.called, judged.levels
    width_in = 4.55 * len(methods) + 1.0
    figure, axes = new_figure(1, len(methods), width_in=width_in, height_in=5.1, title=title, sharey=True)
    reach = edges_m[-2]
    # What is beyond the reach has a strip of its own, set off from the plane.
    gap, strip = 0.012 * reach, 0.035 * reach
    norm = LogNorm(1, max(int(plane.max()), 10))
    end = reach + gap + strip
    inner, beyond = edges_m[:-1], np.array([reach + gap, end])
    ticks = [tick for tick in np.arange(0, reach, 10.0) if reach - tick > 4]
    ticks, labels = [*ticks, reach + gap + strip / 2], [*(f"{tick:g}" for tick in ticks), f"> {reach:g}"]
    options: Any = {"norm": norm, "cmap": _COLOURS, "rasterized": True, "zorder": 2}
    for panel, method, counts in zip(axes, methods, plane, strict=True):
        _regions(panel, limit_m, called.limit, reach, end)
        shown = np.ma.masked_equal(counts.T, 0)  # rows are levels
        for x, columns in ((inner, np.s_[:-1]), (beyond, np.s_[-1:])):
            panel.pcolormesh(x, inner, shown[:-1, columns], **options)
            panel.pcolormesh(x, beyond, shown[-1:, columns], **options)
        panel.axhline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        panel.axvline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        _numbers(panel, regions[regions.method == method].set_index("region"), limit_m, reach)
        panel.set(xlim=(0, end), ylim=(0, end), xlabel=f"{called.size} [m]", aspect="equal")
        panel.set_xticks(ticks, labels)
        panel.set_yticks(ticks, labels)
        panel.grid(visible=False)
        panel.set_title(method_label(method, judged.axis))
    axes[0].set_ylabel(f"{judged.axis} protection level [m]")
    cell = edges_m[1] - edges_m[0]
    bar = figure.colorbar(axes[0].collections[0], ax=axes, pad=0.012, shrink=0.86)
    bar.set_label(f"scenarios in a cell of {cell:g} m by {cell:g} m, or beyond {reach:g} m")
    return figure


def _regions(panel: Axes, limit: float, name: str, reach: float, end: float) -> None:
    """The regions as shades, with the diagonal and the alert limit."""
    for corners, colour in (
        ([(0, 0), (limit, 0), (limit, limit)], _MISLEADING),
        ([(limit, 0), (end, 0), (end, limit), (limit, limit)], _HAZARDOUS),
        ([(0, limit), (end, limit), (end, end), (0, end)], _UNAVAILABLE),
    ):
        panel.add_patch(Polygon(corners, closed=True, facecolor=colour, edgecolor="none", zorder=0.5))
    panel.plot([0, reach], [0, reach], color="0.15", linewidth=1.0, zorder=3)
    for ends in (([0, end], [limit, limit]), ([limit, limit], [0, limit])):
        panel.plot(*ends, **DASHED | {"linewidth": 1.0, "zorder": 3})
    look: Any = {"ha": "right", "va": "top", "color": "0.15", "zorder": 4}
    note(panel, f"{name} {limit:g} m", (reach, limit), shift=(-3, -3), **look)


def _numbers(panel: Axes, rows: pd.DataFrame, limit: float, reach: float) -> None:
    """Name, count and rate of each region, written where it is."""
    high = (limit + reach) / 2
    for region, heading, x, y, side in (
        ("nominal", "nominal", 0.25 * limit, 0.895 * limit, "left"),
        ("misleading", "misleading", 0.985 * limit, 0.17 * limit, "right"),
        ("hazardously misleading", "hazardously\nmisleading", (limit + reach) / 2, 0.5 * limit, "center"),
        ("system unavailable", "system unavailable", 0.26 * limit, high + 0.1 * (reach - limit), "left"),
        ("system unavailable, error beyond level", "unavailable and\nmisleading", 0.99 * reach,
         limit + 0.3 * (reach - limit), "right"),
    ):  # fmt: skip
        row = rows.loc[region]
        rate = row_rate(row, "count", "scenarios")
        lines = [heading, f"{int(row['count']):,}", *([] if rate.startswith("all") else [rate])]
        # Readable over cells of any colour.
        box = {"facecolor": "white", "alpha": 0.78, "edgecolor": "none", "pad": 1.5}
        panel.text(
            x, y, "\n".join(lines), ha=side, va="center", fontsize=7.2, linespacing=1.15, color="0.05", zorder=5,
            bbox=box,
        )  # fmt: skip
