"""The figures of each view of a sweep, from its tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import pandas as pd

from pl_mc.alert import EITHER, Judged
from pl_mc.report.findings import Picture
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.sweep import figures
from pl_mc.studies.sweep.record import SweepExperiment
from pl_mc.studies.sweep.text import EVENTS, of_axis
from pl_mc.studies.sweep.views import exact_rates, finer, has_levels, outcomes_of, planned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Mapping[str, pd.DataFrame]
# What draws for one axis, with the name and the caption of its figure.
_Drawn = tuple[str, str, Callable[[Judged], "Figure"]]

_RAMP_CAPTION = "Protection levels and rates of events against the bias, or fault by fault."


def pictures(tables: Tables, experiment: SweepExperiment) -> tuple[Picture, ...]:
    """The figures of the view, axis by axis; of several axes the first keeps the names, and captions tell."""
    of_view = {"faults": _by_fault, "satellites": _by_satellite, "map": _over_time}[experiment.view]
    judged, made = experiment.judged(), []
    for one in judged:
        for name, caption, draw in of_view(tables, experiment, one):
            if len(judged) > 1:
                name += "" if one == judged[0] else f"_{one.axis}"
                caption = f"{caption.removesuffix('.')}; judged by {one.limits()}."
            made.append(Picture(name, caption, partial(draw, one)))
    return tuple(made)


def _by_fault(tables: Tables, experiment: SweepExperiment, judged: Judged) -> Iterator[_Drawn]:
    def draw(one: Judged) -> Figure:
        (sweep,), _ = planned(experiment)
        rates = of_axis(tables["rates"], one)
        if has_levels(sweep):
            return _ramp(experiment, sweep, rates, tables["levels"], one)
        return figures.rates_by_fault_figure(rates, judged=one, title=experiment.title)

    yield "rates", _RAMP_CAPTION, draw


def _ramp(
    experiment: SweepExperiment, sweep: PlannedSweep, rates: pd.DataFrame, levels: pd.DataFrame, one: Judged
) -> Figure:
    curve = of_axis(exact_rates(experiment, sweep.g, finer(sweep.faults, sweep.g)), one)
    return figures.ramp_figure(rates, levels, curve, judged=one, title=experiment.title)


def _by_satellite(tables: Tables, experiment: SweepExperiment, judged: Judged) -> Iterator[_Drawn]:
    title, both = experiment.title, judged.axis == EITHER

    def one_draw(one: Judged) -> Figure:
        (sweep, _), _ = planned(experiment)
        outcomes = outcomes_of(experiment, sweep.g, sweep.faults)
        return figures.realisation_figure(outcomes[outcomes.draw == 0], judged=one, title=title)

    def ramp(one: Judged) -> Figure:
        (sweep, _), _ = planned(experiment)
        return _ramp(experiment, sweep, of_axis(tables["ramp"], one), tables["levels"], one)

    def satellites(one: Judged) -> Figure:
        rates = of_axis(tables["ramp_satellites"], one)
        return figures.satellite_figure(rates, tables["satellites"], judged=one, title=title)

    level = "Protection levels" if both else f"{judged.axis.capitalize()} protection level"
    name = f"fig6_{'levels' if both else judged.levels[0][0]}_against_bias"
    yield name, f"{level} of one draw of noise against the bias.", one_draw
    yield "ramp_rates", _RAMP_CAPTION, ramp
    yield "ramp_satellites", "The same ramp on every satellite in view.", satellites


def _over_time(tables: Tables, experiment: SweepExperiment, judged: Judged) -> Iterator[_Drawn]:
    def draw(event: str, one: Judged) -> Figure:
        rates = of_axis(tables["by_epoch_satellite"], one)
        return figures.map_figure(rates, event=event, judged=one, title=experiment.title)

    counted = of_axis(tables["by_bias"], judged) if "by_bias" in tables else None
    for event in EVENTS:
        # Nothing is to be seen on a map of what never was; a note says so.
        if counted is not None and not counted[f"{event}_rate"].any():
            continue
        caption = f"Rate of the event {event} by epoch and faulted satellite, over all biases."
        yield f"map_{event}", caption, partial(draw, event)
