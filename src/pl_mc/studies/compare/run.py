"""Experiments of the kind ``compare``: many methods under one ramp, and their tests at one false-alarm rate.

An alarm rate under a fault says nothing without the false-alarm rate beside it. So methods are counted twice: as
they are by default, with what they do without a fault beside; and those that test once more with settings for the
same false-alarm rate, which is measured before anything is compared.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Annotated, Literal

import pandas as pd
from pydantic import Field

from pl_mc.alert import EITHER, Judged, as_axes
from pl_mc.engine import Execution
from pl_mc.input_errors import InputError
from pl_mc.methods import METHODS, Method, as_methods, method
from pl_mc.report.document import Chart
from pl_mc.report.findings import Findings, Table, event_quantities
from pl_mc.studies.compare.day import DAY, DayChoice, Place, comparable_elsewhere, further_geometries
from pl_mc.studies.compare.tables import Comparison, EqualTables, equal_table, fault_free_table, joined, overview_table
from pl_mc.studies.compare.text import summary
from pl_mc.studies.fault_fields import RampFaults
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import ByOneAxis, MethodChoice, SimulatedGeometry
from pl_mc.studies.strict import Strict

# What a reader who ranks methods by level or availability has to know.
LEVELS_DIFFER = (
    "Levels are taken as they are and do not keep the same risk, as the misleading rates show: a smaller level or "
    "more availability is no merit by itself."
)


class EqualTests(Strict):
    """Methods with a test, set for the same false-alarm rate.

    Attributes:
        p_fa: false-alarm probability of the tests that give none of their own.
        draws: noise draws for each fault and for the fault-free case.
        faults: a ramp on one satellite.
        methods: the methods, each with a test.
    """

    p_fa: float = Field(default=1e-3, gt=0, lt=1)
    draws: int = Field(ge=1)
    faults: RampFaults
    methods: Annotated[tuple[MethodChoice, ...], Field(min_length=1)]

    def records(self) -> tuple[Method, ...]:
        """The methods, made records; an `InputError` for one that has no ``p_fa``."""
        able = [name for name, cls in METHODS.items() if "p_fa" in inspect.signature(cls).parameters]
        for choice in self.methods:
            if choice.name in METHODS and choice.name not in able:
                raise InputError(
                    f"equal.methods: {choice.name} has no test with a false-alarm probability (methods that have: "
                    f"{', '.join(able)})."
                )
        return as_methods([method(choice.name, **{"p_fa": self.p_fa} | choice.options) for choice in self.methods])


class CompareExperiment(ByOneAxis):
    """All methods under one ramp, and tests once more at one false-alarm rate.

    Attributes:
        draws: noise draws for each fault and for the fault-free case, the same for all methods.
        faults: a ramp on one satellite; the fault-free case is always there.
        equal: tests at one false-alarm rate; left out unless given.
        day: further geometries of the same series, whether orders hold there; left out unless given.
    """

    kind: Literal["compare"] = "compare"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry
    faults: RampFaults
    equal: EqualTests | None = None
    day: DayChoice | None = None

    def judged_axes(self) -> tuple[str, ...]:
        """Whatever decides on events: levels have to be within all limits that there are."""
        limits = tuple(self.alert_limits().limit_m)
        return limits if len(limits) == 1 else (EITHER,)

    @property
    def decides(self) -> Judged:
        """The axis that decides on events, with its limits."""
        (axis,) = as_axes(self.axes, self.alert_limits())
        return Judged(self.alert_limits(), axis)

    def places(self) -> tuple[Place, ...]:
        """The experiment's own geometry, and the further ones if they are asked for."""
        g = self.geometry.one_epoch()
        axis = self.decides.axis
        own = Place(f"epoch {int(g.epoch)}", g, None, (self.faults.satellite,), axis)
        if self.day is None:
            return (own,)
        series = self.geometry.model_copy(update={"epoch": None}).build()
        return (own, *further_geometries(series, self.day.every, axis))

    def planned(self, place: Place) -> tuple[PlannedSweep, ...]:
        """The sweeps of a place: of all methods, and of the tests that have the false-alarm rate there, if any."""
        equal, day, g = self.equal, self.day if place.name == DAY else None, place.g
        further = f"-{place.name}" if place.satellite else ""
        draws = self.draws if day is None else day.draws
        methods = PlannedSweep(f"all{further}", g, place.faults(self.faults), draws)
        if equal is None:
            return (methods,)
        records = equal.records()
        if further:
            records = comparable_elsewhere(records, equal.p_fa, g, self.seed)
        draws = equal.draws if day is None else day.equal_draws
        tests = PlannedSweep(f"equal{further}", g, place.faults(equal.faults), draws, methods=records)
        return (methods, tests) if records else (methods,)


def sweeps(experiment: CompareExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment, place by place."""
    return tuple(planned for place in experiment.places() for planned in experiment.planned(place))


def run(experiment: CompareExperiment, execution: Execution) -> Findings:
    """Rates and overviews of all methods, and of tests at one false-alarm rate, at one geometry or at several."""
    places = experiment.places()
    counted = _count(experiment, places, execution)
    own, several, tests, named = counted.reference, len(places) > 1, counted.equal, experiment.with_axis
    tables = [
        Table("rates", counted.own_rates, _chart("all methods")),
        Table("overview", named(counted.overview if several else counted.own(counted.overview))),
    ]
    if several:
        elsewhere = counted.rates[counted.rates.geometry != own]
        tables += [
            Table("day_rates", elsewhere, _chart("all methods at further geometries", "geometry")),
            Table("geometries", counted.geometries),
            Table("means", named(counted.means())),
            Table("day_epochs", counted.epochs, stored="parquet"),
        ]
    if tests:
        fits = joined({name: part.tests for name, part in tests.items()})
        tables += [
            Table("equal_rates", tests[own].rates, _chart("tests at one false-alarm rate")),
            Table("equal", named(fits if len(tests) > 1 else counted.own(fits))),
        ]
    if len(tests) > 1:
        elsewhere = joined({name: part.rates for name, part in tests.items() if name != own})
        chart = _chart("tests at one false-alarm rate at further geometries", "geometry")
        tables += [Table("equal_means", named(counted.equal_means())), Table("day_equal_rates", elsewhere, chart)]
    return Findings(
        summary=summary(counted, places[0].g, experiment),
        tables=tuple(tables),
        notes=(*experiment.faults.build(places[0].g)[1], LEVELS_DIFFER, *counted.own_rates.attrs["notes"]),
    )


def _count(experiment: CompareExperiment, places: Sequence[Place], execution: Execution) -> Comparison:
    rates, overviews, equal, epochs = {}, {}, {}, pd.DataFrame()
    # All of them are planned before anything is counted, so that wrong input is told at once.
    for place, (methods, *tests) in [(place, experiment.planned(place)) for place in places]:
        rates[place.name] = methods.run(experiment, execution)
        overviews[place.name] = overview_table(rates[place.name], fault_free_table(experiment, methods))
        if place.name == DAY:
            epochs = pd.concat(list(methods.rows(execution)), ignore_index=True)
        if tests and experiment.equal is not None:
            tested, p_fa = tests[0].run(experiment, execution), experiment.equal.p_fa
            equal[place.name] = EqualTables(tested, equal_table(tested, p_fa), p_fa)
    about = pd.DataFrame([place.about() for place in places])
    return Comparison(about, rates[places[0].name], joined(rates), joined(overviews), equal, epochs)


def _chart(what: str, *menus: str) -> Chart:
    title = f"Rates of events against the bias, {what}"
    return Chart(title, curves=("method",), quantities=event_quantities(), menus=menus)
