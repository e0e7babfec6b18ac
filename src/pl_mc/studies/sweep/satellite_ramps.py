"""Experiments of the kind ``satellite-ramps``: a ramp on one satellite with many draws, and on every other in view.

After figure 6 of Zhao et al. 2021: the protection levels against the bias, at one epoch. The paper shows one
realisation; here every bias gets many, and every satellite of the epoch gets its turn.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.engine import Execution, sample
from pl_mc.experiments.output import write_table
from pl_mc.faults import no_fault, ramps
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.report.figures import save_figure
from pl_mc.report.text import event_text, markdown_table, percent
from pl_mc.statistics import fault_free_exceeded, ls_quantities
from pl_mc.statistics.exact import ls_rates
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.sweep.figures import ramp_figure
from pl_mc.studies.sweep.run import LEVEL_DRAWS, RampFaults, finer_ramp, level_table
from pl_mc.studies.sweep.satellite_figures import realisation_figure, satellite_figure


class SatelliteRampExperiment(Experiment):
    """A ramp on one satellite (``draws``) and on every satellite in view (``draws_per_satellite``)."""

    kind: Literal["satellite-ramps"] = "satellite-ramps"
    draws: int = Field(ge=1)
    draws_per_satellite: int = Field(ge=1)
    geometry: SimulatedGeometry
    faults: RampFaults


def sweeps(experiment: SatelliteRampExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment: the ramp, fault-free in front, and the same ramp on every satellite."""
    return _planned(experiment)[0]


def _planned(experiment: SatelliteRampExperiment) -> tuple[tuple[PlannedSweep, PlannedSweep], tuple[str, ...]]:
    g = experiment.geometry.build()
    if g.is_series:
        raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
    faults, notes = experiment.faults.build(g)
    sizes = experiment.faults
    every = ramps(g, satellites=g.names, start_m=sizes.start_m, stop_m=sizes.stop_m, step_m=sizes.step_m)
    return (
        PlannedSweep("ramp", g, no_fault(g) + faults, experiment.draws),
        PlannedSweep("satellites", g, every, experiment.draws_per_satellite),
    ), notes


def run(experiment: SatelliteRampExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``ramp.csv``, ``ramp_exact.csv``, ``ramp_satellites.csv``, ``levels.csv``, ``satellites.csv``, figures.

    Returns:
        The summary in Markdown, and notes.
    """
    (one_ramp, every_ramp), notes = _planned(experiment)
    g, with_none = one_ramp.g, one_ramp.faults
    alert = experiment.alert_limits()
    ramp = one_ramp.run(experiment, execution)
    exact = ls_rates(g, with_none, alert=alert)
    outcomes = sample(
        g, with_none, draws=min(experiment.draws, LEVEL_DRAWS), seed=experiment.seed,
        methods=experiment.method_records(), alert=alert, precision=experiment.precision,
    )  # fmt: skip
    levels = level_table(outcomes)
    satellites = every_ramp.run(experiment, execution)
    satellites.insert(0, "satellite", satellites.fault.str.split(":").str[0])
    described = _describe(g)

    for name, table in (
        ("ramp", ramp), ("ramp_exact", exact), ("levels", levels), ("ramp_satellites", satellites),
        ("satellites", described),
    ):  # fmt: skip
        write_table(table, folder, name)
    one = outcomes[outcomes.draw == 0]
    save_figure(realisation_figure(one, alert=alert, title=experiment.title), folder, "fig6_vpl_against_bias")
    curve = ls_rates(g, finer_ramp(with_none, g), alert=alert)
    save_figure(ramp_figure(ramp, levels, curve, alert=alert, title=experiment.title), folder, "ramp_rates")
    save_figure(
        satellite_figure(satellites, described, alert=alert, title=experiment.title), folder, "ramp_satellites"
    )
    return _summary(experiment, g, ramp, exact, satellites), notes


def _describe(g: Geometry) -> pd.DataFrame:
    """Name, elevation, azimuth, sigma, redundancy number and vertical effect of each satellite of one epoch."""
    quantities = ls_quantities(g)
    return pd.DataFrame(
        {
            "satellite": g.names,
            "elevation_deg": np.degrees(g.elevation_rad),
            "azimuth_deg": np.degrees(g.azimuth_rad),
            "sigma_m": g.sigma_m,
            "redundancy": redundancy_numbers(g),
            "vertical_metres_per_metre": np.ravel(quantities.gain),
        }
    )


def _summary(
    experiment: SatelliteRampExperiment,
    g: Geometry,
    ramp: pd.DataFrame,
    exact: pd.DataFrame,
    satellites: pd.DataFrame,
) -> str:
    alert = experiment.alert_limits()
    exact = exact.set_index("fault")
    rows = []
    for fault, group in ramp.groupby("fault", sort=False):
        cells = [str(fault)]
        for row in group.itertuples():
            cells += [event_text(row, "alarm"), event_text(row, "exceeded")]
        rows.append([*cells, f"{percent(exact.alarm_rate[fault])} %", _tiny(exact.exceeded_rate[fault])])
    names = list(dict.fromkeys(ramp.method))
    header = ["fault", *(f"{what}, {m}" for m in names for what in ("alarm", "error > PL")), "alarm, LS exact",
              "error > PL, LS exact"]  # fmt: skip
    worst = []
    for method, group in satellites.groupby("method", sort=False):
        for event in ("alarm", "missed", "misleading"):
            at = group.loc[group[f"{event}_rate"].idxmax()]
            worst.append([method, event, at.fault if at[f"{event}_rate"] else "any", event_text(at, event)])
    dof = int(g.satellite_count - g.unknown_count)
    lines = [
        f"# {experiment.title}",
        "",
        f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns. {alert.name}, VAL "
        f"{alert.vertical_m:g} m. {experiment.draws:,} draws a bias, seed {experiment.seed}; 95 % Clopper-Pearson "
        "bounds. error > PL: |vertical error| > VPL, alarm or not.",
        "",
        markdown_table(header, rows),
        "",
        f"Fault-free, LS, exact: P(|vertical error| > VPL) = {fault_free_exceeded(dof):.3e} (Student's t with "
        f"{dof} degrees of freedom), against the 1e-7 that K_V = 5.33 stands for.",
        "",
        f"The same ramp on each of the {g.satellite_count} satellites, {experiment.draws_per_satellite:,} draws a "
        "bias: the fault at which each event is most frequent.",
        "",
        markdown_table(["method", "event", "fault", "rate"], worst),
    ]
    return "\n".join(lines) + "\n"


def _tiny(rate: float) -> str:
    """A rate whose order of magnitude matters; below 1e-30 it is nothing."""
    return f"{rate:.2e}" if rate > 1e-30 else "< 1e-30"
