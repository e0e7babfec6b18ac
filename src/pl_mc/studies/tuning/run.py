"""Experiments of the kind ``tuning``: limits of IGG-III that cost least at a given risk, beside the default.

Every target and every objective has its own search (`pl_mc.tune`). Default and tuned limits are judged on the same
fresh draws, each with the multiplier that it needs itself; least squares stands beside them, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import VERTICAL
from pl_mc.engine import Execution
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor.calibrate import calibrate
from pl_mc.integrity_risk.k_factor.calibrated import exact_rates
from pl_mc.integrity_risk.tuning.objective import LEVEL
from pl_mc.integrity_risk.tuning.tune import tune
from pl_mc.integrity_risk.worst.worst_case import worst_case
from pl_mc.methods import Igg3, Ls
from pl_mc.methods.capabilities import with_k
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.runtime.progress import with_progress
from pl_mc.runtime.threads import in_order
from pl_mc.statistics import ls_quantities
from pl_mc.studies.fault_fields import ListedFaults
from pl_mc.studies.study import Work
from pl_mc.studies.tuning.figures import tuning_figure
from pl_mc.studies.tuning.record import TuningExperiment
from pl_mc.studies.tuning.text import each_once, summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Scenarios a second on two cores, from the seconds in the manifest of the shipped experiment.
_SCENARIOS_PER_S = 6.0e5


def run(experiment: TuningExperiment, execution: Execution) -> Findings:
    """Limits by target and objective, the figure and, where they are asked for, the worst faults."""
    g, judged = experiment.geometry.one_epoch(), experiment.decides
    records = experiment.method_records()
    robust = [record for record in records if type(record) is Igg3]
    plain = [record for record in records if isinstance(record, Ls)]
    if len(robust) != 1 or len(robust) + len(plain) != len(records):
        raise InputError("methods: this takes igg3, whose limits are tuned, and ls, which stands beside it.")
    faults, _ = ListedFaults(biases=experiment.faults).build(g)
    if experiment.worst and experiment.event != "misleading":
        raise InputError("worst: the worst fault can be sought for the event misleading, not for exceeded.")

    def tuned(task: tuple[float, Any]) -> pd.DataFrame:
        target, objective = task
        table = tune(
            g, method=robust[0], target=target, objective=objective, event=experiment.event, faults=faults,
            alert=judged.alert, axis=experiment.level_axis, draws=experiment.draws,
            confidence=experiment.confidence, seed=experiment.seed, steps=experiment.steps, grid=0,
            search_draws=experiment.search_draws, target_cov=experiment.target_cov,
            max_evaluations=experiment.max_evaluations,
        )  # fmt: skip
        table.attrs = {}
        return table.drop(columns="axis").assign(method=robust[0].name, target=target, tuned_for=objective)

    tasks = [(target, objective) for target in experiment.targets for objective in experiment.aims()]
    results = in_order(tuned, tasks, execution.threads)
    parts = [_least_squares(g, record, experiment, faults) for record in plain]
    parts += [part for _, part in with_progress(results, total=len(tasks), what="Tuning", show=execution.progress)]
    whole = pd.concat(parts, ignore_index=True)
    front = ["target", "tuned_for", "method", "limits"]
    table = experiment.with_axis(whole[[*front, *(name for name in whole if name not in front)]])
    worst = None
    if experiment.worst:
        worst = experiment.with_axis(_worst_faults(g, table, robust[0], plain, experiment), behind="limits")
    return Findings(
        summary=summary(table, worst, experiment, g, faults),
        tables=(Table("tuned", table), *(() if worst is None else (Table("worst", worst),))),
        notes=g.notes,
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: TuningExperiment) -> tuple[Picture, ...]:
    """Levels and alarms of all limits."""
    caption = "Mean level and fault-free alarms of default and tuned limits, each with the multiplier it needs."

    def draw() -> Figure:
        return tuning_figure(stored["tuned"], judged=experiment.decides, title=experiment.title)

    return (Picture("tuning", caption, draw),)


def work(experiment: TuningExperiment) -> Work:
    """Scenarios of proposals, descents and judgements; rare targets take about half of what they may."""
    faults, number = len(experiment.faults), 0.0
    for target in experiment.targets:
        proposals = 4 * faults * 450_000
        descents = 4 * 15 * 4 * (faults + 1) * experiment.search_draws
        counted = target * experiment.draws >= 20
        judgements = 4 * faults * (experiment.draws if counted else experiment.max_evaluations / 2)
        number += len(experiment.aims()) * (proposals + descents + judgements)
    return Work(None, number / _SCENARIOS_PER_S)


def _worst_faults(
    g: Geometry, table: pd.DataFrame, robust: Igg3, plain: Sequence[Ls], experiment: TuningExperiment
) -> pd.DataFrame:
    """The worst fault for all limits at the smallest target, each with its multiplier.

    The multipliers keep the target under the faults of the experiment; what others do to it is asked here.
    """
    axis = experiment.level_axis
    limits = each_once(table[table.target == min(experiment.targets)])
    parts = []
    for row in limits[np.isfinite(limits[f"k_{axis}"])].to_dict("records"):
        exact = row["limits"] == "exact"
        chosen: Igg3 | Ls = plain[0] if exact else replace(robust, k0=float(row["k0"]), k1=float(row["k1"]))
        record = with_k(chosen, float(row[f"k_{axis}"]), axis)
        for count in dict.fromkeys(experiment.worst):
            faults = worst_case(
                g, method=record, satellites=count, event="misleading", alert=experiment.alert_limits(),
                axis=axis, seed=experiment.seed, target_cov=experiment.target_cov,
                max_evaluations=experiment.max_evaluations,
            ).iloc[:1]  # fmt: skip
            keys = {name: row[name] for name in ("target", "tuned_for", "limits")} | {"failed": count}
            kept = faults.reindex(columns=["fault", "probability", "low", "high", "warning"])
            parts.append(kept.assign(**keys)[[*keys, *kept]])
    return pd.concat(parts, ignore_index=True)


def _least_squares(g: Geometry, method: Ls, experiment: TuningExperiment, faults: Faults) -> pd.DataFrame:
    """Multiplier, mean level and alarms of least squares for every target, exact."""
    rows, alert, axis = [], experiment.alert_limits(), experiment.level_axis
    quantities = ls_quantities(g)
    dof, dop_m = int(quantities.dof), quantities.vdop_m if axis == VERTICAL else quantities.hdop_m
    # Mean of sqrt(chi-square / dof).
    mean_error = math.sqrt(2.0 / dof) * math.exp(math.lgamma((dof + 1) / 2.0) - math.lgamma(dof / 2.0))
    for target in experiment.targets:
        needs = calibrate(
            g, method=method, target=target, faults=faults, event=experiment.event, alert=alert, axis=axis
        )
        worst = needs.loc[needs[f"k_{axis}"].idxmax()]
        k = float(worst[f"k_{axis}"])
        row = {"target": target, "tuned_for": "", "method": method.name, "limits": "exact"}
        row |= dict.fromkeys((f"k_{axis}", "k_best", "k_low"), k)
        row |= {"found": "exact", f"{LEVEL[axis]}_m": k * float(dop_m) * mean_error, "alarms": 0, "draws": 0}
        (alarm,) = exact_rates(g, no_fault(g), method, alert, k, axis, "alarm")
        row |= dict.fromkeys(("alarm_rate", "alarm_low", "alarm_high"), float(alarm))
        row |= dict.fromkeys(("risk", "risk_low", "risk_high"), float(worst["probability"]))
        rows.append(row | {"risk_fault": worst["fault"], "warning": ""})
    return pd.DataFrame(rows).astype({f"k_{axis}": np.float64})
