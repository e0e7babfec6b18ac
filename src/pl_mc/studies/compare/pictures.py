"""The figures of a comparison of methods, from its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import pandas as pd

from pl_mc.report.findings import Picture
from pl_mc.studies.compare import figures
from pl_mc.studies.compare.run import CompareExperiment
from pl_mc.studies.compare.tables import Comparison, EqualTables, joined

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Mapping[str, pd.DataFrame]


def pictures(stored: Tables, experiment: CompareExperiment) -> tuple[Picture, ...]:
    """Maps of rates, and curves of the tests at one false-alarm rate."""

    def methods() -> Figure:
        draw = figures.comparison_figure if experiment.day is None else figures.several_geometries_figure
        return draw(_comparison(stored, experiment), experiment)

    def tests() -> Figure:
        made = _comparison(stored, experiment)
        equal = _equal_tables(stored, made.reference, experiment)
        draw: Callable[..., Figure] = figures.several_equal_figure if len(equal) > 1 else figures.equal_figure
        return draw(made, equal, experiment)

    rates = Picture("methods", "Rates of events by method and bias, and availability.", methods)
    if experiment.equal is None:
        return (rates,)
    return (rates, Picture("tests", "Detection rates of the tests at one false-alarm rate.", tests))


def _comparison(stored: Tables, experiment: CompareExperiment) -> Comparison:
    """What was counted, without its tests and without epochs."""
    rates, overview = stored["rates"], stored["overview"]
    if experiment.day is None:
        geometries = pd.DataFrame({"geometry": [f"epoch {experiment.geometry.epoch}"]})
        overview = overview.assign(geometry=geometries.geometry.iloc[0])
    else:
        geometries = stored["geometries"]
    every = joined({str(geometries.geometry.iloc[0]): rates})
    if experiment.day is not None:
        every = pd.concat([every, stored["day_rates"]], ignore_index=True)
    return Comparison(geometries, rates, every, overview, {}, pd.DataFrame())


def _equal_tables(stored: Tables, reference: str, experiment: CompareExperiment) -> dict[str, EqualTables]:
    """The tests at one false-alarm rate, by geometry."""
    assert experiment.equal is not None
    tests, rates = stored["equal"], joined({reference: stored["equal_rates"]})
    if "geometry" in tests:
        rates = pd.concat([rates, stored["day_equal_rates"]], ignore_index=True)
    else:
        tests = tests.assign(geometry=reference)
    return {
        str(name): EqualTables(rates[rates.geometry == name], own, experiment.equal.p_fa)
        for name, own in tests.groupby("geometry", sort=False)
    }
