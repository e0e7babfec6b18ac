"""Experiments of the kind ``risk``: what can be proven about a protection level at one geometry.

Risk against the size of a bias, the worst fault of every satellite, budgets over fault modes, and the multiplier
that a level should have, with what it costs in alarms. Least squares is exact; other methods are estimated, at a
price, so that the file says at which biases, for which satellites and down to which risk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pandas as pd

from pl_mc.engine import Execution
from pl_mc.methods import as_methods
from pl_mc.report.document import Chart, Quantity
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.studies.risk import figures, tables
from pl_mc.studies.risk.record import RiskExperiment, checks
from pl_mc.studies.risk.text import summary
from pl_mc.studies.spec import scaled_noise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CHARTS = {
    "curves": Chart(
        "Probability against the bias", curves=("method",), menus=("event", "satellite"), logarithmic=True,
        quantities=(Quantity("probability", "probability", "low", "high"),),
    ),
    "equal_risk": Chart(
        "Alarm against the bias", curves=("method",), menus=("target",),
        quantities=(Quantity("alarm", "alarm_rate", "alarm_low", "alarm_high"),),
    ),
}  # fmt: skip

# Tables that say by which axis methods are judged.
_WITH_METHODS = ("curves", "worst", "steps", "pairs", "budgets", "calibration", "multiplier_curves", "equal_risk")


def run(experiment: RiskExperiment, execution: Execution) -> Findings:
    """Curves, worst faults, budgets and multipliers, as tables and figures."""
    g = scaled_noise(experiment.geometry.one_epoch(), experiment.noise_scale)
    judged, methods = experiment.decides, experiment.method_records()
    choice = experiment.calibration
    # Everything named is looked up before the first long computation.
    for _, require in checks(experiment, g):
        require()
    budgets = [(budget, budget.method_of(methods)) for budget in experiment.budgets]
    further = as_methods([method.build() for method in choice.also]) if choice.also else ()
    setting = tables.Setting(g, methods, judged, experiment.seed, execution)
    calibrated = replace(setting, methods=(*methods, *further))

    multipliers, multiplier_curves = tables.calibration_table(calibrated, choice)
    curves, worst = tables.curve_table(setting, experiment.curves), tables.worst_table(setting, experiment.worst)
    data = {
        "curves": curves,
        "worst": worst,
        "steps": tables.step_table(setting, worst, stop_m=experiment.curves.stop_m),
        "pairs": tables.pair_table(setting, experiment.worst),
        "budgets": tables.budget_table(setting, budgets),
        "calibration": multipliers,
        "multiplier_curves": multiplier_curves,
        "equal_risk": tables.equal_risk_table(calibrated, choice, multipliers),
    }
    for name in _WITH_METHODS:
        experiment.with_axis(data[name])
    return Findings(
        summary=summary(data, experiment, g, calibrated.methods),
        tables=tuple(Table(name, table, _CHARTS.get(name)) for name, table in data.items()),
        notes=g.notes,
    )


def pictures(stored: Mapping[str, pd.DataFrame], experiment: RiskExperiment) -> tuple[Picture, ...]:
    """Curves, worst faults, multipliers."""
    drawn: dict[str, Any] = {"judged": experiment.decides, "title": experiment.title}

    def sky() -> Figure:
        g = scaled_noise(experiment.geometry.one_epoch(), experiment.noise_scale)
        return figures.sky_figure(stored["worst"], g, axis=experiment.decides.axis, title=experiment.title)

    return (
        Picture(
            "risk_against_bias", "Probability of misleading information and missed detection against the bias.",
            lambda: figures.risk_curve_figure(stored["curves"], **drawn),
        ),
        Picture(
            "worst_case", "The worst fault of every satellite, beside the worst of a grid of biases.",
            lambda: figures.worst_figure(stored["worst"], **drawn),
        ),
        Picture(
            "grid_steps", "How much of the worst case a grid of biases misses, by its step.",
            lambda: figures.step_figure(stored["steps"], stored["worst"], **drawn),
        ),
        Picture("worst_sky", "Where the satellites with the worst faults stand in the sky.", sky),
        Picture(
            "calibration", "The multiplier that keeps a target, and its price in alarms.",
            lambda: figures.calibration_figure(
                stored["calibration"], stored["multiplier_curves"], stored["equal_risk"], **drawn
            ),
        ),
    )  # fmt: skip
