"""Experiments of the kind ``time-ramps``: errors that grow on one satellite, and how long they stay unseen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field

from pl_mc.engine import Execution
from pl_mc.experiments.output import write_table
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3
from pl_mc.report.figures import save_figure
from pl_mc.runtime.progress import with_progress
from pl_mc.statistics import ls_quantities
from pl_mc.studies.spec import Experiment, SimulatedGeometry, Strict
from pl_mc.studies.time_ramps.figures import alert_figure, late_figure
from pl_mc.studies.time_ramps.text import comparable, time_ramps_summary
from pl_mc.time_ramps import sequential, time_to_alert
from pl_mc.time_ramps.passes import Test

# Scales of IGG-III that are no smaller than the root mean square of the residuals.
_OF_THE_RESIDUALS = ("posterior", "posterior_floored")


class SequentialChoice(Strict):
    """A sequential test by name; every further field is an option of that test."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str

    def build(self) -> Any:
        """The test's record."""
        return sequential(self.name, **(self.model_extra or {}))


class TimeRampsExperiment(Experiment):
    """Ramps of several rates on one satellite over a pass, at equal false-alarm rates; see `pl_mc.time_to_alert`.

    Attributes:
        sequential: sequential tests to compare with the methods, each a table with a name (sequential_parity or
            kalman) and options of its own.
        satellite: the satellite whose error grows, in view throughout.
        rates_m_per_s: rates of the ramp [m/s]; 0 for the fault-free pass.
        taus_s: correlation times of the correlated part of the errors [s]; 0 for white errors.
        share: share of the correlated part in the variance of an error.
        onset_s: time before the ramp, in which windows and filters fill [s].
        draws: passes for each rate and correlation time.
        calibration_draws: fault-free passes for the thresholds, and as many to count false alarms.
        p_fa: false-alarm probability of a pass, the same for every method.
    """

    kind: Literal["time-ramps"] = "time-ramps"
    geometry: SimulatedGeometry
    satellite: str
    rates_m_per_s: Annotated[tuple[Annotated[float, Field(allow_inf_nan=False)], ...], Field(min_length=1)]
    taus_s: Annotated[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...], Field(min_length=1)]
    share: float = Field(default=0.5, ge=0, le=0.999)
    onset_s: float = Field(default=300.0, gt=0)
    draws: int = Field(ge=1)
    calibration_draws: int = Field(default=4000, ge=100)
    p_fa: float = Field(default=0.01, gt=0, lt=1)
    sequential: tuple[SequentialChoice, ...] = (
        SequentialChoice(name="sequential_parity"),
        SequentialChoice(name="kalman"),
    )

    def tests(self) -> tuple[Test, ...]:
        """Methods and sequential tests, made records."""
        return (*self.method_records(), *(choice.build() for choice in self.sequential))


def run(experiment: TimeRampsExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``time_to_alert.csv``, ``geometry.csv`` and figures.

    Returns:
        The summary in Markdown, and notes.
    """
    g, alert, tests = experiment.geometry.build(), experiment.alert_limits(), experiment.tests()
    taus = with_progress(
        iter(experiment.taus_s), total=len(experiment.taus_s), what="Correlation times", show=execution.progress
    )
    tables = [
        time_to_alert(
            g,
            experiment.satellite,
            experiment.rates_m_per_s,
            tests,
            tau_s=tau_s,
            draws=experiment.draws,
            seed=experiment.seed,
            share=experiment.share,
            onset_s=experiment.onset_s,
            p_fa=experiment.p_fa,
            calibration_draws=experiment.calibration_draws,
            alert=alert,
            progress=False,
        )
        for tau_s in taus
    ]
    table = pd.concat(tables, ignore_index=True)
    described = _describe(g, experiment.satellite)
    write_table(table, folder, "time_to_alert")
    write_table(described, folder, "geometry")
    shown = comparable(table)
    notes = tuple(
        f"{method}: it has no solution in more than {100 * experiment.p_fa:g} % of fault-free passes, so that no "
        "threshold keeps the false-alarm rate; it is in the table and left out of the comparison."
        for method in dict.fromkeys(table.method)
        if method not in set(shown.method)
    )
    notes += _notes_on_igg3(experiment, int(described.redundant.max()))
    if shown.empty:
        raise InputError("methods: none of them can be brought to the false-alarm rate p_fa in this geometry.")
    save_figure(alert_figure(shown, alert=alert, title=experiment.title), folder, "time_to_alert")
    save_figure(late_figure(shown, title=experiment.title), folder, "late_alerts")
    summary = time_ramps_summary(
        shown, described, title=experiment.title, satellite=experiment.satellite, alert=alert,
        p_fa=experiment.p_fa, onset_s=experiment.onset_s, seed=experiment.seed,
    )  # fmt: skip
    return summary, notes


def _notes_on_igg3(experiment: TimeRampsExperiment, redundant: int) -> tuple[str, ...]:
    """Where IGG-III cannot but be least squares.

    With r redundant satellites no residual is beyond sqrt(r) times its own standard deviation if the scale is that
    of the same residuals: v_i^2 / q_i is the part of v'Pv along one direction. Below k0 every weight is one.
    """
    same = [
        one.name
        for one in experiment.method_records()
        if isinstance(one, Igg3)
        and one.start == "ls"
        and one.scale in _OF_THE_RESIDUALS
        and one.k0 >= np.sqrt(redundant)
    ]
    if not same:
        return ()
    return (
        f"{', '.join(same)}: with {redundant} redundant satellites it is least squares by construction. Its "
        "residuals are divided by a scale that they make themselves, so that none is beyond the root of the number "
        f"of redundant satellites, {np.sqrt(redundant):.3g}, which its limit k0 is not below: no weight is ever "
        "changed. What is said of it here says nothing of IGG-III where more satellites are in view.",
    )


def _describe(g: Geometry, satellite: str) -> pd.DataFrame:
    """About every minute: satellites, redundancy, and what the faulted satellite does to the vertical position."""
    found = []
    every = max(1, len(g) // 36)
    for k in range(0, len(g), every):
        one = g[k]
        if satellite not in one.names or one.satellite_count <= one.unknown_count:
            continue
        place, quantities = one.names.index(satellite), ls_quantities(one)
        redundancy = float(redundancy_numbers(one)[place])
        gain, sigma = float(quantities.gain[place]), float(one.sigma_m[place])
        found.append(
            {
                "epoch": int(one.epoch),
                "satellites": int(one.satellite_count),
                "redundant": int(one.satellite_count - one.unknown_count),
                "sigma_m": sigma,
                "redundancy": redundancy,
                "vertical_metres_per_metre": gain,
                "slope_m": abs(gain) * sigma / float(np.sqrt(redundancy)) if redundancy > 1e-9 else np.inf,
                "sigma_up_m": float(quantities.vdop_m),
            }
        )
    return pd.DataFrame(found)
