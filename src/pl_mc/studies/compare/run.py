"""Experiments of the kind ``compare``: many methods under one ramp, and their tests at one false-alarm rate.

An alarm rate under a fault says nothing without the false-alarm rate beside it. So methods are counted twice: as
they are by default, with what they do without a fault beside; and those that test once more with settings for the
same false-alarm rate, which is measured before anything is compared.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.alert import AlertLimits
from pl_mc.engine import Execution, sample
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.methods import METHODS, Method, as_methods, method
from pl_mc.report.figures import save_figure
from pl_mc.statistics.intervals import binomial_p_value, clopper_pearson
from pl_mc.studies.compare.day import (
    DAY,
    DayChoice,
    FurtherGeometry,
    comparable_elsewhere,
    describe,
    further_geometries,
)
from pl_mc.studies.compare.day_text import (
    DayTables,
    day_summary,
    equal_means,
    several_equal_figure,
    several_geometries_figure,
)
from pl_mc.studies.compare.figures import EqualTables, comparison_figure, equal_figure
from pl_mc.studies.compare.orders import mean_rates
from pl_mc.studies.compare.text import compare_summary
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, MethodChoice, SimulatedGeometry, Strict
from pl_mc.studies.sweep.run import RampFaults

# What a reader who ranks methods by level or availability has to know.
LEVELS_DIFFER = (
    "Levels are taken as they are and do not keep the same risk, as the misleading rates show: a smaller level or "
    "more availability is no merit by itself."
)

EVENTS_COMPARED = ("alarm", "missed", "misleading", "hazard")

# A measured false-alarm rate is another one than p_fa where a test at this level, shared by all tests, says so.
_LEVEL = 0.05


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
        able = [
            name for name, cls in METHODS.items() if "p_fa" in [field.name for field in dataclasses.fields(cls)]
        ]
        made = []
        for choice in self.methods:
            options: dict[str, Any] = dict(choice.model_extra or {})
            if choice.name in METHODS and choice.name not in able:
                raise InputError(
                    f"equal.methods: {choice.name} has no test with a false-alarm probability (methods that have: "
                    f"{', '.join(able)})."
                )
            made.append(method(choice.name, **({"p_fa": self.p_fa} | options)))
        return as_methods(made)


class CompareExperiment(Experiment):
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

    def further(self) -> tuple[FurtherGeometry, ...]:
        """The further geometries, if any are asked for."""
        if self.day is None:
            return ()
        series = self.geometry.model_copy(update={"epoch": None}).build()
        return further_geometries(series, self.day.every)


def sweeps(experiment: CompareExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment: all methods, and the tests at one false-alarm rate if they are asked for."""
    return _planned(experiment)[0]


def _planned(experiment: CompareExperiment) -> tuple[tuple[PlannedSweep, ...], tuple[str, ...]]:
    g = experiment.geometry.build()
    if g.is_series:
        raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
    faults, notes = experiment.faults.build(g)
    planned = [PlannedSweep("all", g, no_fault(g) + faults, experiment.draws)]
    if experiment.equal is not None:
        smaller, _ = experiment.equal.faults.build(g)
        records, draws = experiment.equal.records(), experiment.equal.draws
        planned.append(PlannedSweep("equal", g, no_fault(g) + smaller, draws, methods=records))
    for one in experiment.further():
        planned += _planned_further(experiment, one)
    return tuple(planned), notes


def _planned_further(experiment: CompareExperiment, one: FurtherGeometry) -> list[PlannedSweep]:
    """The sweeps of one of the further geometries, named after it."""
    assert experiment.day is not None
    equal, is_day = experiment.equal, one.name == DAY
    draws = experiment.day.draws if is_day else experiment.draws
    planned = [PlannedSweep(f"all-{one.name}", one.g, _ramp(one, experiment.faults), draws)]
    if equal is not None:
        records = comparable_elsewhere(equal.records(), equal.p_fa, one.g, experiment.seed)
        if records:
            draws = experiment.day.equal_draws if is_day else equal.draws
            planned.append(
                PlannedSweep(f"equal-{one.name}", one.g, _ramp(one, equal.faults), draws, methods=records)
            )
    return planned


def _ramp(one: FurtherGeometry, sizes: RampFaults) -> Faults:
    return one.faults(sizes.start_m, sizes.stop_m, sizes.step_m)


def run(experiment: CompareExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``rates``, ``overview``, ``equal_rates`` and ``equal.csv`` with figures; of further geometries the rows
    of ``overview`` and ``equal``, and ``day_rates``, ``day_equal_rates``, ``geometries``, ``means`` and
    ``day_epochs.parquet``.

    Returns:
        The summary in Markdown, and notes.
    """
    planned, notes = _planned(experiment)
    g, alert, title = planned[0].g, experiment.alert_limits(), experiment.title
    rates = planned[0].run(experiment, execution)
    overview = overview_table(rates, fault_free_table(g, experiment.method_records(), experiment, alert))
    write_table(rates, folder, "rates")
    further = _count_further(experiment, planned, execution, rates, overview, alert)
    write_table(overview if further is None else further.overview, folder, "overview")
    if further is None:
        save_figure(comparison_figure(rates, overview, alert=alert, title=title), folder, "methods")
    tests = None
    if experiment.equal is not None:
        p_fa = experiment.equal.p_fa
        counted = planned[1].run(experiment, execution)
        tests = EqualTables(rates=counted, tests=equal_table(counted, p_fa), p_fa=p_fa)
        write_table(counted, folder, "equal_rates")
        if further is None or not further.equal:
            write_table(tests.tests, folder, "equal")
            save_figure(equal_figure(tests, alert=alert, title=title), folder, "tests")
    summary = compare_summary(rates, overview, tests, g, title=title, alert=alert, seed=experiment.seed)
    if further is not None:
        further = further.with_reference(tests)
        _write_further(further, folder, alert, title)
        summary = day_summary(summary, further, alert=alert)
    return summary, (*notes, LEVELS_DIFFER, *rates.attrs["notes"])


def _count_further(
    experiment: CompareExperiment,
    planned: tuple[PlannedSweep, ...],
    execution: Execution,
    rates: pd.DataFrame,
    overview: pd.DataFrame,
    alert: AlertLimits,
) -> DayTables | None:
    """The tables of all geometries, that of the experiment in front; None where there are no further ones."""
    found = experiment.further()
    if not found:
        return None
    g, satellite = planned[0].g, experiment.faults.satellite
    reference = f"epoch {int(g.epoch)}"
    by_name = {one.name: one for one in planned}
    all_rates, overviews = [rates.assign(geometry=reference)], [overview.assign(geometry=reference)]
    described, equal = [describe(reference, g, [satellite])], {}
    epochs = pd.DataFrame()
    for one in found:
        sweep = by_name[f"all-{one.name}"]
        counted = sweep.run(experiment, execution)
        fault_free = fault_free_table(one.g, experiment.method_records(), experiment, alert, draws=sweep.draws)
        all_rates.append(counted.assign(geometry=one.name))
        overviews.append(overview_table(counted, fault_free).assign(geometry=one.name))
        described.append(describe(one.name, one.g, one.true_names))
        if one.name == DAY:
            epochs = pd.concat(list(sweep.rows(execution)), ignore_index=True)
        if experiment.equal is not None and f"equal-{one.name}" in by_name:
            tested = by_name[f"equal-{one.name}"].run(experiment, execution)
            p_fa = experiment.equal.p_fa
            equal[one.name] = EqualTables(rates=tested, tests=equal_table(tested, p_fa), p_fa=p_fa)
    joined = pd.concat(all_rates, ignore_index=True)
    return DayTables(
        reference=reference,
        geometries=pd.DataFrame(described),
        rates=joined,
        overview=pd.concat(overviews, ignore_index=True),
        means=mean_rates(joined, EVENTS_COMPARED),
        epochs=epochs,
        equal=equal,
    )


def _write_further(further: DayTables, folder: Path, alert: AlertLimits, title: str) -> None:
    write_table(further.rates[further.rates.geometry != further.reference], folder, "day_rates")
    write_table(further.geometries, folder, "geometries")
    write_table(further.means, folder, "means")
    further.epochs.to_parquet(folder / "day_epochs.parquet", index=False, compression="zstd")
    save_figure(several_geometries_figure(further, alert=alert, title=title), folder, "methods")
    if further.equal:
        write_table(equal_means(further), folder, "equal_means")
        tests = [one.tests.assign(geometry=name) for name, one in further.equal.items()]
        write_table(pd.concat(tests, ignore_index=True), folder, "equal")
        rates = [one.rates.assign(geometry=n) for n, one in further.equal.items() if n != further.reference]
        write_table(pd.concat(rates, ignore_index=True), folder, "day_equal_rates")
        save_figure(several_equal_figure(further, title=title), folder, "tests")


def fault_free_table(
    g: Geometry,
    methods: tuple[Method, ...],
    experiment: CompareExperiment,
    alert: AlertLimits,
    *,
    draws: int | None = None,
) -> pd.DataFrame:
    """What methods say where nothing is wrong, draw by draw of the sweep's own noise, at one epoch or at several.

    Returns:
        ``method, draws, within`` (both levels within their alert limits), the share with its bounds, and quantiles
        of the levels [m].
    """
    series = g.as_series()
    # Epoch by epoch, of which no more is kept than levels.
    drawn = [
        sample(
            series[k : k + 1], no_fault(series), draws=draws or experiment.draws, seed=experiment.seed,
            methods=methods, alert=alert, precision=experiment.precision,
        )[["method", "vpl_m", "hpl_m"]]
        for k in range(len(series))
    ]  # fmt: skip
    outcomes = pd.concat(drawn, ignore_index=True)
    rows = []
    for name, group in outcomes.groupby("method", sort=False):
        # Missing levels, those of an unavailable solution, are within nothing.
        within = (group.vpl_m <= alert.vertical_m) & (group.hpl_m <= alert.horizontal_m)
        low, high = clopper_pearson(int(within.sum()), len(group))
        row: dict[str, object] = {
            "method": name,
            "draws": len(group),
            "within": int(within.sum()),
            "availability": float(within.mean()),
            "availability_low": float(low),
            "availability_high": float(high),
        }
        for level in ("vpl", "hpl"):
            known = group[f"{level}_m"].dropna()
            for percent in (50, 95):
                row[f"{level}_{percent}_m"] = known.quantile(percent / 100) if len(known) else np.nan
        rows.append(row)
    return pd.DataFrame(rows)


def overview_table(rates: pd.DataFrame, fault_free: pd.DataFrame) -> pd.DataFrame:
    """One row per method: fault-free alarms, availability and levels, and each event at the bias that is worst.

    Args:
        rates: of a sweep whose first fault is none.
        fault_free: see `fault_free_table`.
    """
    rows = []
    for name, group in rates.groupby("method", sort=False):
        nothing, faulted = group[group.fault == "none"].iloc[0], group[group.fault != "none"]
        row: dict[str, object] = {"method": name}
        row |= {
            f"fault_free_{event}_{part}": nothing[f"{event}_{part}"]
            for event in ("alarm", "misleading")
            for part in ("rate", "low", "high")
        }
        for event in EVENTS_COMPARED[1:]:
            worst = faulted.loc[faulted[f"{event}_rate"].idxmax()]
            row[f"{event}_bias_m"] = worst.bias_m if worst[f"{event}_rate"] > 0 else np.nan
            row |= {f"{event}_{part}": worst[f"{event}_{part}"] for part in ("rate", "low", "high")}
        rows.append(row)
    return pd.DataFrame(rows).merge(fault_free, on="method", how="left", sort=False)


def equal_table(rates: pd.DataFrame, p_fa: float) -> pd.DataFrame:
    """One row per test: its measured false alarms, and whether they fit the rate that all were set to.

    ``fits``: an exact binomial test does not reject p_fa at a level of 5 % for all tests together.
    """
    nothing = rates[rates.fault == "none"]
    table = nothing[["method", "draws", "alarms", "alarm_rate", "alarm_low", "alarm_high"]].reset_index(drop=True)
    table["p_value"] = binomial_p_value(table.alarms, table.draws, np.full(len(table), p_fa))
    table["fits"] = table.p_value >= _LEVEL / len(table)
    return table
