"""Experiments of the kind ``noise``: the same faults under noise models that the receiver does not believe in.

All of them are made from the same standard normal numbers. What counting does not see is left to the rare-event
estimator; what correlation in time does is counted in exposures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.alert import AlertLimits
from pl_mc.engine import EVENTS, Execution
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.integrity_risk.rare.exposure import exposure
from pl_mc.integrity_risk.rare.risk import risk
from pl_mc.methods import Ls, Method
from pl_mc.noise_models import GAUSSIAN, NoiseModel
from pl_mc.report.figures import save_figure
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import cores, in_order
from pl_mc.statistics.exact import ls_rates
from pl_mc.studies.noise.figures import exposure_figure, noise_figure
from pl_mc.studies.noise.text import NoiseTables, noise_summary
from pl_mc.studies.planned_sweep import PlannedSweep
from pl_mc.studies.spec import Experiment, SimulatedGeometry, Strict
from pl_mc.studies.sweep.run import NoiseChoice

COMPARED = ("alarm", "misleading", "missed")


class FaultChoice(Strict):
    """Biases of one satellite, one at a time, besides the fault-free case [m]."""

    satellite: str
    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)]


class RareChoice(Strict):
    """What is left to the rare-event estimator.

    Attributes:
        event: which event.
        fewest_events: where the sweep counted fewer than this.
        sizes_m: under which faults, 0 for none [m].
        methods: names of methods of the experiment.
        target_cov, max_evaluations: see `pl_mc.risk`.
    """

    event: Literal["missed", "misleading"] = "missed"
    fewest_events: int = Field(default=16, ge=1)
    sizes_m: tuple[float, ...] = (0.0,)
    methods: tuple[str, ...] = ("ls",)
    target_cov: float = Field(default=0.15, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)


class ExposureChoice(Strict):
    """Exposures to Gaussian errors that are correlated in time; see `pl_mc.exposure`.

    Attributes:
        sizes_m: faults, 0 for none [m].
        taus_s: correlation times [s].
        duration_s, interval_s, draws: of the exposures.
        event: which event.
        assumed_samples: the number of independent samples that a budget assumes.
    """

    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)] = (0.0,)
    taus_s: Annotated[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...], Field(min_length=1)]
    duration_s: float = Field(default=150.0, gt=0)
    interval_s: float = Field(default=1.0, gt=0)
    draws: int = Field(default=10_000, ge=1)
    event: Literal["alarm", "missed", "misleading", "exceeded", "hazard"] = "misleading"
    assumed_samples: int = Field(default=25, ge=1)


class NoiseExperiment(Experiment):
    """Noise models at one epoch; the first of ``noises`` is Gaussian, and the others are compared with it."""

    kind: Literal["noise"] = "noise"
    draws: int = Field(ge=1)
    geometry: SimulatedGeometry
    faults: FaultChoice
    noises: Annotated[tuple[NoiseChoice, ...], Field(min_length=2)]
    rare: RareChoice = RareChoice()
    exposure: ExposureChoice

    def noise_records(self) -> tuple[NoiseModel, ...]:
        """The noise models, made records; an `InputError` where the first is not Gaussian or two are the same."""
        made = tuple(choice.build() for choice in self.noises)
        if made[0] != GAUSSIAN:
            raise InputError(
                f"noises: the first has to be gaussian, since the others are compared with it, not {made[0].name}."
            )
        for one in made:
            if made.count(one) > 1:
                raise InputError(f"noises: {one.name} is asked for twice.")
        return made


def sweeps(experiment: NoiseExperiment) -> tuple[PlannedSweep, ...]:
    """The sweeps of the experiment, one for each noise model."""
    g = _epoch(experiment)
    faults = _faults(g, experiment.faults.satellite, tuple(dict.fromkeys((0.0, *experiment.faults.sizes_m))))
    return tuple(
        PlannedSweep(f"noise-{k:02d}", g, faults, experiment.draws, noise)
        for k, noise in enumerate(experiment.noise_records())
    )


def run(experiment: NoiseExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``rates``, ``factors``, ``risks`` and ``exposures.csv`` with figures.

    Returns:
        The summary in Markdown, and notes.
    """
    planned = sweeps(experiment)
    g, faults, alert = planned[0].g, planned[0].faults, experiment.alert_limits()
    methods = experiment.method_records()
    rare, given = experiment.rare, experiment.exposure
    for name in rare.methods:
        require_choice(name, [method.name for method in methods], field="rare.methods")
    rates = pd.concat(
        [one.run(experiment, execution).assign(noise=one.noise.name) for one in planned], ignore_index=True
    )
    tables = NoiseTables(
        rates=rates,
        factors=factor_table(rates, g, faults, methods, alert),
        risks=_risks(experiment, planned, rates, execution),
        exposures=exposure(
            g,
            _faults(g, experiment.faults.satellite, given.sizes_m),
            tau_s=given.taus_s,
            draws=given.draws,
            seed=experiment.seed,
            duration_s=given.duration_s,
            interval_s=given.interval_s,
            methods=methods,
            alert=alert,
            precision=experiment.precision,
            progress=execution.progress,
        ),
    )
    for name in ("rates", "factors", "risks", "exposures"):
        write_table(getattr(tables, name), folder, name)
    save_figure(noise_figure(tables.factors, alert=alert, title=experiment.title), folder, "noise_models")
    figure = exposure_figure(
        tables.exposures, event=given.event, assumed=given.assumed_samples, title=experiment.title
    )
    save_figure(figure, folder, "exposures")
    summary = noise_summary(
        tables, g, satellite=experiment.faults.satellite, alert=alert, title=experiment.title,
        seed=experiment.seed, rare=rare.model_dump(), event=given.event, assumed=given.assumed_samples,
    )  # fmt: skip
    return summary, ()


def factor_table(
    rates: pd.DataFrame, g: Geometry, faults: Faults, methods: tuple[Method, ...], alert: AlertLimits
) -> pd.DataFrame:
    """Rates beside those under Gaussian noise, of which those of least squares are exact.

    Returns:
        One row per noise, method, fault and event of `COMPARED`: ``rate, low, high`` (95 %), ``gaussian_rate,
        gaussian_low, gaussian_high``, and ``factor, factor_low, factor_high``, the quotient of the rates and those
        of opposite bounds; NaN where both were seen too rarely for one.
    """
    exact = ls_rates(g, faults, alert=alert).set_index("fault")
    # Options other than the multiplier have no part in least squares; with another one it is counted.
    known = {method.name for method in methods if method == Ls()}
    first = rates[rates.noise == GAUSSIAN.name].set_index(["method", "fault"])
    rows = []
    for row in rates.itertuples():
        for event in COMPARED:
            before = first.loc[(row.method, row.fault)]
            if row.method in known:
                known_rate = float(exact.loc[row.fault, f"{event}_rate"])
                reference = [known_rate, known_rate, known_rate]
            else:
                reference = [float(before[f"{event}_{part}"]) for part in ("rate", "low", "high")]
            rate, low, high = (float(getattr(row, f"{event}_{part}")) for part in ("rate", "low", "high"))
            known_rates = rate > 0 and reference[0] > 0
            rows.append(
                {
                    "noise": row.noise,
                    "method": row.method,
                    "fault": row.fault,
                    "bias_m": row.bias_m,
                    "event": event,
                    "draws": row.draws,
                    "count": round(rate * row.draws),
                    "rate": rate,
                    "low": low,
                    "high": high,
                    "gaussian_rate": reference[0],
                    "gaussian_low": reference[1],
                    "gaussian_high": reference[2],
                    "factor": rate / reference[0] if known_rates else np.nan,
                    "factor_low": low / reference[2] if rate > 0 and reference[2] > 0 else np.nan,
                    "factor_high": high / reference[1] if reference[1] > 0 else np.nan,
                }
            )
    return pd.DataFrame(rows)


def _risks(
    experiment: NoiseExperiment, planned: tuple[PlannedSweep, ...], rates: pd.DataFrame, execution: Execution
) -> pd.DataFrame:
    """`pl_mc.risk` wherever too few events were counted."""
    rare = experiment.rare
    column = {event.name: event.count for event in EVENTS}[rare.event]
    records = {method.name: method for method in experiment.method_records()}
    work = []
    for one in planned:
        counted = rates[rates.noise == one.noise.name].set_index(["method", "fault"])[column]
        for name in rare.methods:
            wanted = _faults(one.g, experiment.faults.satellite, rare.sizes_m)
            # A fault that the sweep did not have counts as seen never.
            keep = [
                k for k, label in enumerate(wanted.labels) if counted.get((name, label), 0) < rare.fewest_events
            ]
            if not keep:
                continue
            few = Faults(wanted.bias_m[keep], wanted.names, tuple(wanted.labels[k] for k in keep))
            work.append((one, records[name], few))

    def estimate(case: tuple[PlannedSweep, Method, Faults]) -> pd.DataFrame:
        one, method, few = case
        table = risk(
            one.g, few, seed=experiment.seed, event=rare.event, method=method, target_cov=rare.target_cov,
            alert=experiment.alert_limits(), noise=one.noise, max_evaluations=rare.max_evaluations, workers=1,
            progress=False,
        )  # fmt: skip
        table.insert(0, "noise", one.noise.name)
        return table

    threads = cores() if execution.workers is None else execution.workers
    # Every case has a function of its own to compile, so that none need run alone.
    results = in_order(estimate, work, threads, compiled=True)
    shown = with_progress(results, total=len(work), what="Risk", show=execution.progress)
    parts = [table for _, table in shown]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["noise", "method", "fault"])


def _epoch(experiment: NoiseExperiment) -> Geometry:
    g = experiment.geometry.build()
    if g.is_series:
        raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
    return g


def _faults(g: Geometry, satellite: str, sizes_m: tuple[float, ...]) -> Faults:
    made = [biases(g, {satellite: size}) if size else no_fault(g) for size in dict.fromkeys(sizes_m)]
    return sum(made[1:], made[0])
