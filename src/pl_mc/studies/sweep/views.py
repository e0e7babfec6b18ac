"""The views of a sweep: rates fault by fault, a ramp on one satellite and on every other, maps over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np
import pandas as pd

from pl_mc.alert import HORIZONTAL, VERTICAL
from pl_mc.engine import Execution, sample
from pl_mc.engine.table import count_columns, sum_over_faults, with_rates
from pl_mc.faults import Faults, no_fault, ramps
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.noise_models import GAUSSIAN
from pl_mc.report.document import Chart
from pl_mc.report.findings import Findings, Table, event_quantities, level_quantities
from pl_mc.statistics import ls_quantities
from pl_mc.statistics.exact import ls_rates
from pl_mc.studies.fault_fields import RampSizes
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.sweep.record import SweepExperiment
from pl_mc.studies.sweep.text import EVENTS, faults_summary, map_summary, of_axis, satellites_summary

# Draws whose protection levels are kept one by one, for medians and quantiles.
LEVEL_DRAWS = 2000

_LEVELS = Chart("VPL and HPL against the bias", ("method",), level_quantities())


def sweeps(experiment: SweepExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment."""
    return planned(experiment)[0]


def run(experiment: SweepExperiment, execution: Execution) -> Findings:
    """Tables, figures and summary of the view."""
    of_view = {"faults": by_fault, "satellites": by_satellite, "map": over_time}
    return of_view[experiment.view](experiment, execution)


def planned(experiment: SweepExperiment) -> tuple[tuple[PlannedSweep, ...], tuple[str, ...]]:
    """The sweeps of the view, and a sentence about the faulted satellite where there is one."""
    g, given, draws = experiment.geometry.build(), experiment.faults, experiment.draws
    if isinstance(given, RampSizes):
        series = g.as_series()
        return (PlannedSweep("sweep", series, _on_every_satellite(experiment, series, free=True), draws),), g.notes
    faults, notes = given.build(g)
    notes = g.notes + notes
    if experiment.draws_per_satellite is None:
        return (PlannedSweep("sweep", g, faults, draws, experiment.noise.build()),), notes
    return (
        # A ramp from zero has the fault-free case already.
        PlannedSweep("ramp", g, faults if no_fault(g).labels[0] in faults.labels else no_fault(g) + faults, draws),
        PlannedSweep("satellites", g, _on_every_satellite(experiment, g, free=False), experiment.draws_per_satellite),
    ), notes


def by_fault(experiment: SweepExperiment, execution: Execution) -> Findings:
    """Rates of a ramp or of listed faults, with least squares in closed form beside them.

    Rates of a series are sums over its epochs; the counts of every epoch are kept as the rows ``epochs``.
    """
    (sweep,), notes = planned(experiment)
    g, faults = sweep.g, sweep.faults
    rates = sweep.run(experiment, execution)
    # No closed form stands beside what is drawn.
    exact = exact_rates(experiment, g, faults.only(*np.flatnonzero(~faults.drawn)))
    # Faults of the same bias on different satellites have no place on one curve.
    of_size = rates[rates.bias_m.notna()]
    on_curves = len(of_size) > 0 and not of_size.duplicated([*keys_of(rates), "bias_m"]).any()
    tables = [Table("rates", rates, chart=_rates_chart(rates) if on_curves else None)]
    tables += [Table("exact", exact)] if len(exact) else []
    if has_levels(sweep):
        tables.append(Table("levels", level_table(outcomes_of(experiment, g, faults)), chart=_LEVELS))
    return Findings(
        summary=faults_summary(experiment, g, rates, exact, sweep.noise),
        tables=tuple(tables),
        notes=(*notes, *rates.attrs["notes"]),
        rows={"epochs": sweep.stored(execution)} if g.is_series else {},
    )


def by_satellite(experiment: SweepExperiment, execution: Execution) -> Findings:
    """A ramp on one satellite with many draws, and on every other in view, at one epoch.

    After figure 6 of Zhao et al. 2021: the protection levels against the bias. The paper shows one realisation;
    here every bias gets many, and every satellite of the epoch gets its turn.
    """
    (of_one, of_every), notes = planned(experiment)
    g, faults = of_one.g, of_one.faults
    ramp = of_one.run(experiment, execution)
    exact, levels = exact_rates(experiment, g, faults), level_table(outcomes_of(experiment, g, faults))
    satellites = of_every.run(experiment, execution)
    satellites.insert(0, "satellite", _satellite(satellites))
    described = _describe(g, horizontally=any(axis != VERTICAL for axis in experiment.judged_axes()))
    return Findings(
        summary=satellites_summary(experiment, g, ramp, exact, satellites),
        tables=(
            Table("ramp", ramp, chart=_rates_chart(ramp)),
            Table("ramp_satellites", satellites, chart=_rates_chart(satellites, " on any satellite", "satellite")),
            Table("levels", levels, chart=_LEVELS),
            Table("ramp_exact", exact),
            Table("satellites", described),
        ),
        notes=notes,
    )


def over_time(experiment: SweepExperiment, execution: Execution) -> Findings:
    """A ramp on every satellite at every epoch, one at a time, as maps of three events.

    The counts of every epoch and fault are kept as the rows ``epochs``.
    """
    (sweep,), notes = planned(experiment)
    # A satellite that is out of view at some epochs, of which the table has a note, is no news on a map.
    rates = sweep.run(experiment, execution)
    by_place = rates_by_place(sweep.rows(execution))
    rates["satellite"] = _satellite(rates)
    keys = keys_of(rates)
    faulted = rates[rates.bias_m != 0]
    of_satellite = sum_over_faults(faulted, ["satellite", *keys], independent=_draws_by(by_place, ["satellite"]))
    of_bias = sum_over_faults(rates, ["bias_m", *keys], independent=_draws_by(by_place, []))
    return Findings(
        summary=map_summary(experiment, sweep.g, of_bias, of_satellite),
        tables=(
            Table("by_bias", of_bias, chart=_rates_chart(of_bias)),
            Table("by_satellite", of_satellite),
            Table("by_epoch_satellite", by_place, stored="parquet"),
        ),
        notes=(*notes, *_without_map(of_bias, by_place, experiment)),
        rows={"epochs": sweep.stored(execution)},
    )


def _without_map(of_bias: pd.DataFrame, by_place: pd.DataFrame, experiment: SweepExperiment) -> Iterator[str]:
    """A sentence about each event that was seen nowhere, of which there is no map."""
    for one in experiment.judged():
        counted, placed = (of_axis(table, one) for table in (of_bias, by_place))
        for event in EVENTS:
            if not counted[f"{event}_rate"].any():
                yield (
                    f"No map of {event}, {one.probability(event)}, {one.limits()}: it was seen at no epoch with no "
                    f"satellite, which bounds its rate at each of them by {placed[f'{event}_high'].max():.2g} (95 %)."
                )


def keys_of(table: pd.DataFrame) -> list[str]:
    """The columns that tell methods, and axes where they are named, apart."""
    return ["method", "axis"] if "axis" in table else ["method"]


def exact_rates(experiment: SweepExperiment, g: Geometry, faults: Faults) -> pd.DataFrame:
    """Rates of least squares on each axis that has a closed form, with a column ``axis`` where a sweep has one."""
    alert = experiment.alert_limits()
    exact: dict[str, Literal["vertical", "horizontal"]] = {VERTICAL: "vertical", HORIZONTAL: "horizontal"}
    parts = {
        axis: ls_rates(g, faults, alert=alert, axis=exact[axis]) for axis in experiment.judged_axes() if axis in exact
    }
    if experiment.asked_axes() is None and VERTICAL in parts:
        return parts[VERTICAL]
    for axis, part in parts.items():
        part.insert(1, "axis", axis)
    # Nothing is known in closed form of both together; a table without rows says so.
    return pd.concat(parts.values(), ignore_index=True) if parts else _no_rates(g, faults)


def _no_rates(g: Geometry, faults: Faults) -> pd.DataFrame:
    none = ls_rates(g, faults).iloc[:0]
    none.insert(1, "axis", pd.Series(dtype=object))
    return none


def _rates_chart(rates: pd.DataFrame, of: str = "", *menus: str) -> Chart:
    """Rates of events against the bias, with a menu of the axes where the table names any."""
    axes = ("axis",) if "axis" in rates else ()
    return Chart(f"Rates of events against the bias{of}", ("method",), event_quantities(rates), menus=(*axes, *menus))


def level_table(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Quantiles (5, 50, 95 %) of VPL and HPL by method and fault, over the draws that are available."""
    rows = []
    for method, of_method in outcomes.groupby("method", sort=False):
        for fault, group in of_method.groupby("fault", sort=False):
            row: dict[str, object] = {"method": method, "fault": fault, "bias_m": group.bias_m.iloc[0]}
            row |= {"draws": len(group), "available": int(group.available.sum())}
            for level in ("vpl", "hpl"):
                quantiles = group[f"{level}_m"].quantile([0.05, 0.5, 0.95])
                row |= {f"{level}_{100 * part:02.0f}_m": value for part, value in quantiles.items()}
            rows.append(row)
    return pd.DataFrame(rows)


def rates_by_place(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """One row per epoch, satellite and method, summed over biases but zero, from the rows of a sweep part by part."""
    sums = []
    for rows in parts:
        rows = rows[rows.bias_m != 0]
        keys = ["epoch", "satellite", *keys_of(rows)]
        rows = rows.assign(satellite=_satellite(rows), **{key: rows[key].astype(str) for key in keys[2:]})
        # Rows of one epoch and part have the same draws; all biases of a satellite saw the same noise.
        first = rows.groupby(keys, sort=False)["draws"].first().rename("independent_draws")
        sums.append(rows.groupby(keys, sort=False)[count_columns(rows)].sum().join(first))
    total = pd.concat(sums).groupby(level=keys, sort=False).sum()
    return with_rates(total[["draws", "independent_draws", *count_columns(total)[1:]]].reset_index())


def _draws_by(by_place: pd.DataFrame, keys: list[str]) -> pd.Series:
    """Independent draws by ``keys``, method and axis: those of every epoch, each counted once."""
    keys = [*keys, *keys_of(by_place)]
    once = by_place.drop_duplicates([*keys, "epoch"])
    return once.groupby(keys, sort=False)["independent_draws"].sum()


def _satellite(rates: pd.DataFrame) -> pd.Series:
    """The faulted satellite of each row."""
    return rates.fault.astype(str).str.split(":").str[0]


def _on_every_satellite(experiment: SweepExperiment, g: Geometry, *, free: bool) -> Faults:
    """A ramp on each; what ramps from zero have without a fault is one case for all, or left to another sweep."""
    sizes = experiment.faults.model_dump(include=set(RampSizes.model_fields))
    faults = ramps(g, satellites=g.names, **sizes)
    kept = faults.scalar_bias_m != 0
    if not kept.any():
        nearest = f"(nearest: {sizes['step_m']:g})"
        raise InputError(f"faults.stop_m: a ramp on every satellite has a size above zero {nearest}, not 0.")
    if free:
        kept[np.flatnonzero(~kept)[:1]] = True
    return faults.only(*np.flatnonzero(kept))


def has_levels(sweep: PlannedSweep) -> bool:
    """Whether levels are told and the exact curve drawn: of a ramp at one epoch, with Gaussian noise."""
    sizes_m = sweep.faults.scalar_bias_m
    is_ramp = np.isfinite(sizes_m).all() and len(np.unique(sizes_m)) == len(sweep.faults) > 1
    return bool(is_ramp) and not sweep.g.is_series and sweep.noise == GAUSSIAN


def finer(faults: Faults, g: Geometry, steps: int = 100) -> Faults:
    """Faults between the first and the last of a ramp, for a smooth curve."""
    part = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return Faults.from_array(g, (1 - part) * faults.bias_m[0] + part * faults.bias_m[-1])


def outcomes_of(experiment: SweepExperiment, g: Geometry, faults: Faults) -> pd.DataFrame:
    """The first draws one by one, see `pl_mc.sample`."""
    return sample(
        g, faults, draws=min(experiment.draws, LEVEL_DRAWS), seed=experiment.seed,
        methods=experiment.method_records(), alert=experiment.alert_limits(), precision=experiment.precision,
        axis=experiment.judged_axes()[0],
    )  # fmt: skip


def _describe(g: Geometry, *, horizontally: bool) -> pd.DataFrame:
    """Name, elevation, azimuth, sigma, redundancy number and effect of each satellite of one epoch."""
    quantities = ls_quantities(g)
    across = np.hypot(*quantities.horizontal_gain)
    return pd.DataFrame(
        {
            "satellite": g.names,
            "elevation_deg": np.degrees(g.elevation_rad),
            "azimuth_deg": np.degrees(g.azimuth_rad),
            "sigma_m": g.sigma_m,
            "redundancy": redundancy_numbers(g),
            "vertical_metres_per_metre": np.ravel(quantities.gain),
            **({"horizontal_metres_per_metre": across} if horizontally else {}),
        }
    )
