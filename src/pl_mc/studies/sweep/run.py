"""Experiments of the kind ``sweep``: a simulated geometry, a fault or a ramp of faults, methods, noise draws."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Discriminator, Field, Tag

from pl_mc.engine import Execution, sample
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, biases, no_fault, ramps
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError, nearest
from pl_mc.noise_models import GAUSSIAN, NoiseModel, noise_model
from pl_mc.report.figures import method_label, save_figure
from pl_mc.report.text import event_text, markdown_table, metres
from pl_mc.statistics.exact import ls_rates
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, SimulatedGeometry, Strict
from pl_mc.studies.sweep.figures import ramp_figure, rates_by_fault_figure

# Draws whose protection levels are kept one by one, for medians and quantiles.
LEVEL_DRAWS = 2000


class RampFaults(Strict):
    """The same ramp on one satellite.

    ``otherwise = "median_redundancy"``: where the satellite is out of view, the satellite of its system with the
    median redundancy number takes its place (the lower one of two), which the summary says.
    """

    satellite: str
    otherwise: Literal["median_redundancy"] | None = None
    start_m: float
    stop_m: float
    step_m: float

    def build(self, g: Geometry) -> tuple[Faults, tuple[str, ...]]:
        """The faults, and a sentence about the satellite."""
        name, why = self.satellite, "as asked for"
        if name not in g.names and self.otherwise is not None:
            name = median_redundancy_satellite(g, system=self.satellite[:1])
            why = f"{self.satellite} is out of view; {name} has the median redundancy number of its system"
        faults = ramps(g, satellites=[name], start_m=self.start_m, stop_m=self.stop_m, step_m=self.step_m)
        if g.is_series:
            return faults, (f"Faulted satellite: {name} ({why}).",)
        row = g.names.index(name)
        elevation = np.degrees(g.elevation_rad[row])
        redundancy = redundancy_numbers(g)[row]
        return faults, (
            f"Faulted satellite: {name} ({why}); elevation {elevation:.1f} deg, redundancy number "
            f"{redundancy:.3f}.",
        )


class ListedFaults(Strict):
    """Faults one by one, each a table of biases by satellite [m]; an empty table is the fault-free case."""

    biases: Annotated[tuple[dict[str, float], ...], Field(min_length=1)]

    def build(self, g: Geometry) -> tuple[Faults, tuple[str, ...]]:
        """The faults, in order."""
        made = [biases(g, one) if one else no_fault(g) for one in self.biases]
        return sum(made[1:], made[0]), ()


def _form_of_faults(given: Any) -> str:
    listed = "biases" in given if isinstance(given, dict) else isinstance(given, ListedFaults)
    return "Listed" if listed else "Ramp"


AnyFaults = Annotated[
    Annotated[RampFaults, Tag("Ramp")] | Annotated[ListedFaults, Tag("Listed")], Discriminator(_form_of_faults)
]


class NoiseChoice(Strict):
    """A noise model by name; every further field is an option of that model."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str

    def build(self) -> NoiseModel:
        """The model's record."""
        return noise_model(self.name, **(self.model_extra or {}))


class SweepExperiment(Experiment):
    """A sweep; see `pl_mc.sweep` for what is counted, `pl_mc.noise_models` for the noise."""

    kind: Literal["sweep"] = "sweep"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry = SimulatedGeometry()
    faults: AnyFaults
    noise: NoiseChoice = NoiseChoice(name="gaussian")


def sweeps(experiment: SweepExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment."""
    return (_planned(experiment)[0],)


def _planned(experiment: SweepExperiment) -> tuple[PlannedSweep, tuple[str, ...]]:
    g = experiment.geometry.build()
    faults, notes = experiment.faults.build(g)
    return PlannedSweep("sweep", g, faults, experiment.draws, experiment.noise.build()), notes


def run(experiment: SweepExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Run the sweep and write ``rates.csv``, ``exact.csv``, ``levels.csv`` and a figure into ``folder``.

    The rates of a series are sums over its epochs; the counts of every epoch are in ``epochs/*.parquet``.

    Returns:
        The summary in Markdown, and notes.
    """
    planned, notes = _planned(experiment)
    g, faults = planned.g, planned.faults
    alert, methods = experiment.alert_limits(), experiment.method_records()
    rates = planned.run(experiment, execution)
    if g.is_series:
        planned.keep_rows(execution, folder)
    notes = (*notes, *rates.attrs["notes"])
    exact = ls_rates(g, faults, alert=alert)
    write_table(rates, folder, "rates")
    write_table(exact, folder, "exact")
    mean_exact = exact.groupby("fault", sort=False).mean(numeric_only=True).reset_index()
    scalar = np.isfinite(faults.scalar_bias_m).all() and len(np.unique(faults.scalar_bias_m)) == len(faults) > 1
    # Levels one by one and the exact curve are those of Gaussian noise.
    if scalar and not g.is_series and planned.noise == GAUSSIAN:
        levels = level_table(
            sample(
                g, faults, draws=min(experiment.draws, LEVEL_DRAWS), seed=experiment.seed, methods=methods,
                alert=alert, precision=experiment.precision,
            )
        )  # fmt: skip
        write_table(levels, folder, "levels")
        curve = ls_rates(g, finer_ramp(faults, g), alert=alert)
        figure = ramp_figure(rates, levels, curve, alert=alert, title=experiment.title)
    else:
        figure = rates_by_fault_figure(rates, alert=alert, title=experiment.title)
    save_figure(figure, folder, "rates")
    return _summary(experiment, g, rates, mean_exact, planned.noise), notes


def level_table(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Quantiles (5, 50, 95 %) of VPL and HPL by method and fault, over the draws that are available."""
    rows = []
    for (method, fault), group in outcomes.groupby(["method", "fault"], sort=False):
        row: dict[str, object] = {"method": method, "fault": fault, "bias_m": group.bias_m.iloc[0]}
        row |= {"draws": len(group), "available": int(group.available.sum())}
        for level in ("vpl", "hpl"):
            known = group[f"{level}_m"].dropna()
            for percent in (5, 50, 95):
                row[f"{level}_{percent:02d}_m"] = known.quantile(percent / 100) if len(known) else np.nan
        rows.append(row)
    return pd.DataFrame(rows).sort_values("method", kind="stable", key=_first_seen).reset_index(drop=True)


def median_redundancy_satellite(g: Geometry, *, system: str) -> str:
    """The satellite of a system whose redundancy number is the median one (the lower of the two middle ones)."""
    if g.is_series:
        raise InputError("faults.otherwise: a median redundancy number needs one epoch; give geometry.epoch.")
    redundancy = redundancy_numbers(g)
    rows = [k for k, letter in enumerate(g.systems) if letter == system]
    if not rows:
        raise InputError(
            f"faults.satellite: no satellite of system {system!r} ({nearest(system, set(g.systems))})."
        )
    ordered = sorted(rows, key=lambda k: (redundancy[k], g.names[k]))
    return g.names[ordered[(len(ordered) - 1) // 2]]


def finer_ramp(faults: Faults, g: Geometry, steps: int = 100) -> Faults:
    """Faults between the first and the last of a ramp, for a smooth curve."""
    part = np.linspace(0.0, 1.0, steps + 1)[:, None]
    return Faults.from_array(g, (1 - part) * faults.bias_m[0] + part * faults.bias_m[-1])


def _first_seen(column: pd.Series) -> pd.Series:
    order = {value: k for k, value in enumerate(column.unique())}
    return column.map(order)


def _summary(
    experiment: SweepExperiment, g: Geometry, total: pd.DataFrame, exact: pd.DataFrame, noise: NoiseModel
) -> str:
    alert = experiment.alert_limits()
    series = g.as_series()
    epochs = f"{len(series)} epochs" if g.is_series else f"epoch {int(g.epoch)}"
    count = series.satellite_count
    satellites = f"{count.min()}" if count.min() == count.max() else f"{count.min()}-{count.max()}"
    header = [
        "fault",
        *(f"{what}, {m}" for m in total.method.unique() for what in ("alarm", "missed", "misleading")),
    ]
    named = "" if noise == GAUSSIAN else f", noise {noise.name}"
    exact_alarm = exact.set_index("fault").alarm_rate
    rows = []
    for fault, group in total.groupby("fault", sort=False):
        cells = [str(fault)]
        for row in group.itertuples():
            cells += [event_text(row, event) for event in ("alarm", "missed", "misleading")]
        rows.append([*cells, f"{100 * exact_alarm[fault]:.4g} %"])
    lines = [
        f"# {experiment.title}",
        "",
        f"Geometry: {epochs}, {satellites} satellites, {series.design.shape[2]} unknowns, error model "
        f"{experiment.geometry.error_model}{named}. Alert limit: {alert.name}, VAL {metres(alert.vertical_m)} m. "
        f"{experiment.draws:,} draws a fault and epoch, seed {experiment.seed}. Rates with 95 % Clopper-Pearson "
        "bounds; `0 (< x %)` is the upper bound where nothing was seen.",
        "",
        markdown_table([*header, "alarm, LS exact" + ("" if noise == GAUSSIAN else ", gaussian")], rows),
        "",
        "alarm: VPL > VAL, or no solution. missed: |vertical error| > VAL and no alarm. misleading: |vertical "
        "error| > VPL and no alarm.",
        "",
        "; ".join(f"{name}: {method_label(name)}" for name in total.method.unique() if method_label(name) != name)
        + ".",
    ]
    return "\n".join(lines) + "\n"
