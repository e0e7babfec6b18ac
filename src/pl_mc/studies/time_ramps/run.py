"""Experiments of the kind ``time-ramps``: errors that grow on one satellite, and how long they stay unseen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field

from pl_mc.engine import Execution
from pl_mc.faults import require_satellite
from pl_mc.geometry import Geometry, redundancy_numbers
from pl_mc.input_errors import InputError
from pl_mc.methods import Igg3
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.runtime.progress import with_progress
from pl_mc.statistics import ls_quantities
from pl_mc.studies.spec import Experiment, SimulatedGeometry, Strict
from pl_mc.studies.study import Check, Work, refuse
from pl_mc.studies.time_ramps.figures import alert_figure, late_figure
from pl_mc.studies.time_ramps.text import comparable, summary
from pl_mc.time_ramps import sequential, time_to_alert
from pl_mc.time_ramps.passes import Test
from pl_mc.time_ramps.timing import require_calibration, require_onset

# Scales of IGG-III that are no smaller than the root mean square of the residuals.
_OF_THE_RESIDUALS = ("posterior", "posterior_floored")

# Epochs that a test solves a second, from the seconds of the shipped experiment's manifest, on two cores.
_EPOCHS_PER_S = 2.0e6


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


def run(experiment: TimeRampsExperiment, execution: Execution) -> Findings:
    """Times to alert at every rate and correlation time, and the geometry through the pass."""
    g, alert, tests = experiment.geometry.build(), experiment.alert_limits(), experiment.tests()
    taus = with_progress(
        iter(experiment.taus_s), total=len(experiment.taus_s), what="Correlation times", show=execution.progress
    )
    tables = [
        time_to_alert(
            g, experiment.satellite, experiment.rates_m_per_s, tests, tau_s=tau_s, draws=experiment.draws,
            seed=experiment.seed, share=experiment.share, onset_s=experiment.onset_s, p_fa=experiment.p_fa,
            calibration_draws=experiment.calibration_draws, alert=alert, progress=False,
        )
        for tau_s in taus
    ]  # fmt: skip
    table = pd.concat(tables, ignore_index=True)
    shown, geometry = comparable(table), _through_the_pass(g, experiment.satellite)
    if shown.empty:
        raise InputError("methods: none of them can be brought to the false-alarm rate p_fa in this geometry.")
    left_out = tuple(
        f"{method}: it has no solution in more than {100 * experiment.p_fa:g} % of fault-free passes, so that no "
        "threshold keeps the false-alarm rate; it is in the table and left out of the comparison."
        for method in dict.fromkeys(table.method)
        if method not in set(shown.method)
    )
    return Findings(
        summary=summary(shown, geometry, experiment),
        tables=(Table("time_to_alert", table), Table("geometry", geometry)),
        pictures=(
            Picture(
                "time_to_alert", alert_figure(shown, alert=alert, title=experiment.title),
                "Error at the alarm, and its delay after the hazard begins, by the rate of the ramp.",
            ),
            Picture(
                "late_alerts", late_figure(shown, title=experiment.title),
                "How often the alarm comes later than 6, 10 and 30 s after the hazard begins.",
            ),
        ),
        notes=left_out + notes_on_igg3(experiment, int(geometry.redundant.max())),
    )  # fmt: skip


def work(experiment: TimeRampsExperiment) -> Work:
    """Epochs solved: passes of every rate and those of the calibration, by every test, at every correlation."""
    passes = len(experiment.rates_m_per_s) * experiment.draws + 2 * experiment.calibration_draws
    solved = len(experiment.taus_s) * passes * experiment.geometry.epochs * len(experiment.tests())
    return Work(None, solved / _EPOCHS_PER_S)


def checks(experiment: TimeRampsExperiment, g: Geometry | None) -> Iterator[Check]:
    """Passes enough for the thresholds; and in the series a time before the ramp, and the satellite."""
    yield "calibration_draws", lambda: require_calibration(experiment.calibration_draws, experiment.p_fa)
    if g is None:
        return
    if not g.is_series:
        yield "geometry.epoch", lambda: refuse("a ramp in time needs a series of epochs; leave it out.")
        return
    yield "onset_s", lambda: require_onset(experiment.onset_s, experiment.geometry.interval_s, len(g))
    yield "satellite", lambda: require_satellite(g, experiment.satellite)


def notes_on_igg3(experiment: TimeRampsExperiment, redundant: int) -> tuple[str, ...]:
    """Where IGG-III cannot but be least squares.

    With r redundant satellites no residual is beyond sqrt(r) times its own standard deviation if the scale is that
    of the same residuals: v_i^2 / q_i is the part of v'Pv along one direction. Below k0 every weight is one.
    """
    limit = np.sqrt(redundant)
    same = [
        method.name
        for method in experiment.method_records()
        if isinstance(method, Igg3)
        and method.start == "ls"
        and method.scale in _OF_THE_RESIDUALS
        and method.k0 >= limit
    ]
    if not same:
        return ()
    return (
        f"{', '.join(same)}: with {redundant} redundant satellites it is least squares by construction. Its "
        "residuals are divided by a scale that they make themselves, so that none is beyond the root of the number "
        f"of redundant satellites, {limit:.3g}, which its limit k0 is not below: no weight is ever changed. What "
        "is said of it here says nothing of IGG-III where more satellites are in view.",
    )


def _through_the_pass(g: Geometry, satellite: str) -> pd.DataFrame:
    """About every minute: satellites, redundancy, and what the faulted satellite does to the vertical position."""
    rows = []
    for k in range(0, len(g), max(1, len(g) // 36)):
        epoch = g[k]
        redundant = int(epoch.satellite_count - epoch.unknown_count)
        if satellite not in epoch.names or redundant <= 0:
            continue
        place, quantities = epoch.names.index(satellite), ls_quantities(epoch)
        redundancy = float(redundancy_numbers(epoch)[place])
        gain, sigma = float(quantities.gain[place]), float(epoch.sigma_m[place])
        rows.append(
            {
                "epoch": int(epoch.epoch),
                "satellites": int(epoch.satellite_count),
                "redundant": redundant,
                "sigma_m": sigma,
                "redundancy": redundancy,
                "vertical_metres_per_metre": gain,
                "slope_m": abs(gain) * sigma / float(np.sqrt(redundancy)) if redundancy > 1e-9 else np.inf,
                "sigma_up_m": float(quantities.vdop_m),
            }
        )
    return pd.DataFrame(rows)
