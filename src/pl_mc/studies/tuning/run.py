"""Experiments of the kind ``tuning``: limits of IGG-III that cost least at a given risk, beside the default.

Every target and every objective has its own search (`pl_mc.tune`). Default and tuned limits are judged on the same
fresh draws, each with the multiplier that it needs itself; least squares stands beside them, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.alert import AlertLimits
from pl_mc.engine import Execution
from pl_mc.experiments.output import write_table
from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor.calibrate import calibrate
from pl_mc.integrity_risk.tuning.tune import tune
from pl_mc.integrity_risk.worst.worst_case import worst_case
from pl_mc.methods import Igg3, Method
from pl_mc.methods.capabilities import exact_law, with_k
from pl_mc.report.figures import save_figure
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import cores, in_order
from pl_mc.statistics import ls_quantities, ls_rates
from pl_mc.studies.spec import Experiment, SimulatedGeometry
from pl_mc.studies.tuning.figures import tuning_figure
from pl_mc.studies.tuning.text import judged, tuning_summary

ObjectiveName = Literal["vpl", "alarms"]


class TuningExperiment(Experiment):
    """Tuned limits of IGG-III at one epoch, for several targets and objectives.

    Attributes:
        geometry: the satellites in view, at one epoch.
        targets: probabilities of the event per sample that are kept.
        objectives: what is made small, fault-free: the mean level (vpl) or the share of alarms (alarms).
        event: the event whose probability is kept, misleading or exceeded.
        faults: faults under each of which the target is kept, tables of biases by satellite [m]; an empty one is
            the fault-free case.
        draws: fresh noise draws that judge; targets of which they have 20 events are counted.
        search_draws: weighted draws of the search, for each fault.
        steps: most steps of each descent.
        confidence: with which the multipliers keep the target.
        target_cov: relative standard error of the risk that judges a target that cannot be counted.
        max_evaluations: scenarios that it may take, for each fault and pair of limits.
        worst: how many satellites fail together, 1 or 2 or both: the worst of such faults is sought for all limits
            at the smallest target, with the multipliers that they need for the faults above.
    """

    kind: Literal["tuning"] = "tuning"
    geometry: SimulatedGeometry
    targets: Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1)]
    objectives: Annotated[tuple[ObjectiveName, ...], Field(min_length=1)] = ("vpl", "alarms")
    event: Literal["misleading", "exceeded"] = "misleading"
    faults: Annotated[tuple[dict[str, float], ...], Field(min_length=1)] = ({},)
    draws: int = Field(default=400_000, ge=1000)
    search_draws: int = Field(default=16_384, ge=1024)
    steps: int = Field(default=30, ge=1)
    confidence: float = Field(default=0.95, gt=0, lt=1)
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=10_000_000, ge=500_000)
    worst: tuple[Literal[1, 2], ...] = ()


def run(experiment: TuningExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``tuned.csv``, the figure and, where the worst faults are asked for, ``worst.csv``.

    Returns:
        The summary in Markdown, and notes.
    """
    g = experiment.geometry.build()
    if g.is_series:
        raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
    records = experiment.method_records()
    tuned = [one for one in records if type(one) is Igg3]
    plain = [one for one in records if exact_law(one)]
    if len(tuned) != 1 or len(tuned) + len(plain) != len(records):
        raise InputError("methods: this takes igg3, whose limits are tuned, and ls, which stands beside it.")
    made = [biases(g, one) if one else no_fault(g) for one in experiment.faults]
    faults, alert = sum(made[1:], made[0]), experiment.alert_limits()
    if experiment.worst and experiment.event != "misleading":
        raise InputError("worst: the worst fault can be sought for the event misleading, not for exceeded.")
    tasks = [(target, objective) for target in experiment.targets for objective in experiment.objectives]

    def one(task: tuple[float, ObjectiveName]) -> pd.DataFrame:
        target, objective = task
        table = tune(
            g, method=tuned[0], target=target, objective=objective, event=experiment.event, faults=faults,
            alert=alert, draws=experiment.draws, confidence=experiment.confidence, seed=experiment.seed,
            steps=experiment.steps, grid=0, search_draws=experiment.search_draws,
            target_cov=experiment.target_cov, max_evaluations=experiment.max_evaluations,
        )  # fmt: skip
        table.attrs = {}
        return table.assign(method=tuned[0].name, target=target, tuned_for=objective)

    threads = cores() if execution.workers is None else execution.workers
    results = in_order(one, tasks, threads)
    found = [part for _, part in with_progress(results, total=len(tasks), what="Tuning", show=execution.progress)]
    exact = [_least_squares(g, record, experiment, faults, alert) for record in plain]
    whole = pd.concat([*exact, *found], ignore_index=True)
    front = ["target", "tuned_for", "method", "limits"]
    table = whole[[*front, *(name for name in whole if name not in front)]]
    write_table(table, folder, "tuned")
    save_figure(tuning_figure(table, alert=alert, title=experiment.title), folder, "tuning")
    worst = _worst_faults(g, table, tuned[0], plain, experiment, alert) if experiment.worst else None
    if worst is not None:
        write_table(worst, folder, "worst")
    summary = tuning_summary(
        table, g, faults=faults, alert=alert, title=experiment.title, seed=experiment.seed, event=experiment.event,
        confidence=experiment.confidence, worst=worst,
    )  # fmt: skip
    return summary, ()


def _worst_faults(
    g: Geometry,
    table: pd.DataFrame,
    tuned: Igg3,
    plain: Sequence[Method],
    experiment: TuningExperiment,
    alert: AlertLimits,
) -> pd.DataFrame:
    """The worst fault for all limits at the smallest target, each with its multiplier.

    The multipliers keep the target under the faults of the experiment; what others do to it is asked here.
    """
    shown = judged(table[table.target == min(experiment.targets)])
    parts = []
    for row in shown[np.isfinite(shown.k_vertical)].itertuples():
        k = float(row.k_vertical)
        record = (
            with_k(plain[0], k)
            if row.limits == "exact"
            else replace(tuned, k_vertical=k, k0=float(row.k0), k1=float(row.k1))
        )
        for count in dict.fromkeys(experiment.worst):
            found = worst_case(
                g, method=record, satellites=count, event="misleading", alert=alert, seed=experiment.seed,
                target_cov=experiment.target_cov, max_evaluations=experiment.max_evaluations,
            ).iloc[:1]  # fmt: skip
            keys = {"target": row.target, "tuned_for": row.tuned_for, "limits": row.limits, "failed": count}
            kept = found.reindex(columns=["fault", "probability", "low", "high", "warning"])
            parts.append(kept.assign(**keys)[[*keys, *kept]])
    return pd.concat(parts, ignore_index=True)


def _least_squares(
    g: Geometry, method: Method, experiment: TuningExperiment, faults: Faults, alert: AlertLimits
) -> pd.DataFrame:
    """Multiplier, mean level and alarms of least squares for every target, exact."""
    rows: list[dict[str, Any]] = []
    quantities = ls_quantities(g)
    dof = int(quantities.dof)
    # Mean of sqrt(chi-square / dof).
    mean_error = math.sqrt(2.0 / dof) * math.exp(math.lgamma((dof + 1) / 2.0) - math.lgamma(dof / 2.0))
    for target in experiment.targets:
        found = calibrate(g, method=method, target=target, faults=faults, event=experiment.event, alert=alert)
        worst = found.loc[found["k_vertical"].idxmax()]
        k = float(worst["k_vertical"])
        alarm = float(ls_rates(g, no_fault(g), alert=alert, k_vertical=k)["alarm_rate"].iloc[0])
        risk = float(worst["probability"])
        rows.append(
            {
                "target": target,
                "tuned_for": "",
                "method": method.name,
                "limits": "exact",
                "k_vertical": k,
                "k_best": k,
                "k_low": k,
                "found": "exact",
                "vpl_m": k * float(quantities.vdop_m) * mean_error,
                "alarms": 0,
                "draws": 0,
                "alarm_rate": alarm,
                "alarm_low": alarm,
                "alarm_high": alarm,
                "risk": risk,
                "risk_low": risk,
                "risk_high": risk,
                "risk_fault": worst["fault"],
                "warning": "",
            }
        )
    return pd.DataFrame(rows).astype({"k_vertical": np.float64})
