"""Experiments of the kind ``risk``: what can be proven about a protection level at one geometry.

Risk against the size of a bias, the worst fault of every satellite, budgets over fault modes, and the multiplier
that a level should have, with what it costs in alarms. Least squares is exact; other methods are estimated, at a
price, so that the file says at which biases, for which satellites and down to which risk.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.experiments.output import write_table
from pl_mc.faults import biases, no_fault, require_satellite
from pl_mc.input_errors import InputError, require_choice
from pl_mc.methods import as_methods
from pl_mc.report.figures import save_figure
from pl_mc.studies.risk.calibration import CalibrationCase, calibration_table, equal_risk_table
from pl_mc.studies.risk.calibration_figure import calibration_figure
from pl_mc.studies.risk.figures import risk_curve_figure, sky_figure, step_figure, worst_figure
from pl_mc.studies.risk.tables import BudgetCase, budget_table, curve_table, pair_table, step_table, worst_table
from pl_mc.studies.risk.text import RiskTables, risk_summary
from pl_mc.studies.spec import Experiment, MethodChoice, SimulatedGeometry, Strict
from pl_mc.studies.stanford.run import scaled_noise

EventName = Literal["missed", "misleading"]


class CurveChoice(Strict):
    """Risk against bias.

    Attributes:
        satellites: which get the ramp, one at a time.
        start_m, stop_m, step_m: the ramp of the exact curves [m].
        misleading_m, missed_m: sizes at which other methods are estimated [m].
        target_cov, max_evaluations: of these estimates, see `pl_mc.integrity_risk.rare.risk.risk`.
    """

    satellites: Annotated[tuple[str, ...], Field(min_length=1)]
    start_m: float = 0.0
    stop_m: float = 100.0
    step_m: float = 0.5
    misleading_m: tuple[float, ...] = ()
    missed_m: tuple[float, ...] = ()
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)


class WorstChoice(Strict):
    """The worst fault of every satellite.

    Attributes:
        events: for which it is computed by least squares.
        estimated: satellites for which it is searched for by estimates; ``["all"]`` for every one in view.
        estimated_events: for which.
        refined: for each of these, how many satellites, the worst first, get a last estimate with noise of its own;
            all unless given.
        pair_events: for which the worst pairs of satellites are searched for, of least squares and of the others.
        target_cov, max_evaluations: of the last estimates.
    """

    events: Annotated[tuple[EventName, ...], Field(min_length=1)] = ("misleading", "missed")
    estimated: tuple[str, ...] = ()
    estimated_events: tuple[EventName, ...] = ("misleading",)
    refined: tuple[Annotated[int, Field(ge=1)], ...] = ()
    pair_events: tuple[EventName, ...] = ()
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)


class BudgetChoice(Strict):
    """One budget; fields are those of `pl_mc.integrity_risk.budget.budget.risk_budget`.

    ``method`` is the name of one of the experiment's methods.
    """

    method: str
    event: EventName = "missed"
    p_sat: float | dict[str, float] = 1e-5
    p_const: float | dict[str, float] = 1e-4
    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)] | None = None
    constellation: Literal["independent", "common"] = "independent"
    pairs: int | Literal["all"] | None = None
    samples_per_approach: int = Field(default=25, ge=1)
    target: float = Field(default=2e-7, gt=0)
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)

    def case(self, methods: dict[str, Any]) -> BudgetCase:
        """The budget's options as `risk_budget` takes them."""
        options = self.model_dump(exclude={"method", "sizes_m"})
        options["bias"] = "worst" if self.sizes_m is None else list(self.sizes_m)
        name = require_choice(self.method, methods, field="budgets.method")
        return BudgetCase(method=methods[name], options=options)


class CalibrationChoice(Strict):
    """The multiplier that keeps a target.

    Attributes:
        event: ``misleading`` or ``exceeded``.
        targets: probabilities of the event per sample.
        faults: faults under which they have to be kept, tables of biases by satellite [m]; an empty one is the
            fault-free case.
        confidence: of the bounds of a multiplier that is counted or estimated.
        draws_per_event: a target is counted with this number over it, but at least ``fewest_draws``.
        fewest_draws, most_draws: draws; a target that needs more than the latter is left to the rare-event
            estimator.
        rare_faults: how many of the faults, from the first, get such targets; the others end before them.
        also: methods that are calibrated besides those of the experiment.
        worst_sizes_m: sizes of a fault on any satellite, of which each method gets the one that needs the largest
            multiplier at the smallest target as a further fault; none unless given [m].
        target_cov, max_evaluations: of that estimator.
        alarm_satellite, alarm_biases_m: the ramp under which alarms at equal risk are compared [m].
        alarm_draws: noise draws of that comparison.
    """

    event: Literal["misleading", "exceeded"] = "misleading"
    targets: Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1)]
    faults: Annotated[tuple[dict[str, float], ...], Field(min_length=1)] = ({},)
    confidence: float = Field(default=0.95, gt=0, lt=1)
    draws_per_event: float = Field(default=5.0, ge=3.5)
    fewest_draws: int = Field(default=200_000, ge=1)
    most_draws: int = Field(default=5_000_000, ge=1)
    rare_faults: int = Field(default=1, ge=0)
    also: tuple[MethodChoice, ...] = ()
    worst_sizes_m: tuple[Annotated[float, Field(gt=0)], ...] = ()
    target_cov: float = Field(default=0.2, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)
    alarm_satellite: str
    alarm_biases_m: Annotated[tuple[float, ...], Field(min_length=1)]
    alarm_draws: int = Field(default=20_000, ge=1)


class RiskExperiment(Experiment):
    """Curves, worst cases, budgets and calibration at one epoch.

    Attributes:
        geometry: with an epoch.
        noise_scale: factor of every sigma, in the noise and in the weights.
        curves, worst, budgets, calibration: the parts.
    """

    kind: Literal["risk"] = "risk"
    geometry: SimulatedGeometry
    noise_scale: float = Field(default=1.0, gt=0)
    curves: CurveChoice
    worst: WorstChoice = WorstChoice()
    budgets: tuple[BudgetChoice, ...] = ()
    calibration: CalibrationChoice


def run(experiment: RiskExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write the tables and the figures.

    Returns:
        The summary in Markdown, and notes.
    """
    built = experiment.geometry.build()
    if built.is_series:
        raise InputError("geometry.epoch: this kind of experiment needs one epoch.")
    g = scaled_noise(built, experiment.noise_scale)
    alert, methods, seed = experiment.alert_limits(), experiment.method_records(), experiment.seed
    # Everything named is looked up before the first long computation.
    curves, worst, calibration = experiment.curves, experiment.worst, experiment.calibration
    for name in (*curves.satellites, calibration.alarm_satellite):
        require_satellite(g, name)
    estimated = g.names if worst.estimated == ("all",) else worst.estimated
    for name in estimated:
        require_satellite(g, name)
    if worst.refined and len(worst.refined) != len(worst.estimated_events):
        raise InputError(
            f"worst.refined: one number for each of the {len(worst.estimated_events)} events of estimated_events, "
            f"or none at all, is needed, not {len(worst.refined)}."
        )
    budgets = [choice.case({one.name: one for one in methods}) for choice in experiment.budgets]
    made = [biases(g, one) if one else no_fault(g) for one in calibration.faults]
    case = CalibrationCase(
        faults=sum(made[1:], made[0]),
        **calibration.model_dump(exclude={"faults", "also", "alarm_satellite", "alarm_biases_m", "alarm_draws"}),
    )
    further = as_methods([choice.build() for choice in calibration.also]) if calibration.also else ()
    common: dict[str, Any] = {"methods": methods, "alert": alert, "seed": seed}
    calibrated = common | {"methods": (*methods, *further)}
    workers = execution.workers

    multipliers, multiplier_curves = calibration_table(g, case, **calibrated, workers=workers)
    tables = RiskTables(
        curves=curve_table(g, **curves.model_dump(), **common, workers=workers, progress=execution.progress),
        worst=worst_table(g, **(worst.model_dump(exclude={"pair_events"}) | {"estimated": estimated}), **common),
        budgets=budget_table(g, budgets, alert=alert, seed=seed),
        calibration=multipliers,
        multiplier_curves=multiplier_curves,
    )
    tables.pairs = pair_table(
        g, events=worst.pair_events, target_cov=worst.target_cov, max_evaluations=worst.max_evaluations, **common,
        workers=workers,
    )  # fmt: skip
    steps = step_table(g, tables.worst, methods=methods, alert=alert, stop_m=curves.stop_m)
    tables.equal_risk = equal_risk_table(
        g, tables.calibration, satellite=calibration.alarm_satellite, biases_m=calibration.alarm_biases_m,
        draws=calibration.alarm_draws, **calibrated,
    )  # fmt: skip
    for name, table in (
        ("curves", tables.curves), ("worst", tables.worst), ("steps", steps), ("pairs", tables.pairs),
        ("budgets", tables.budgets),
        ("calibration", tables.calibration), ("multiplier_curves", multiplier_curves),
        ("equal_risk", tables.equal_risk),
    ):  # fmt: skip
        write_table(table, folder, name)
    title = experiment.title
    save_figure(risk_curve_figure(tables.curves, alert=alert, title=title), folder, "risk_against_bias")
    save_figure(worst_figure(tables.worst, alert=alert, title=title), folder, "worst_case")
    save_figure(step_figure(steps, tables.worst, alert=alert, title=title), folder, "grid_steps")
    save_figure(sky_figure(tables.worst, g, title=title), folder, "worst_sky")
    save_figure(
        calibration_figure(tables.calibration, multiplier_curves, tables.equal_risk, alert=alert, title=title),
        folder, "calibration",
    )  # fmt: skip
    summary = risk_summary(
        tables, g, methods=(*methods, *further), alert=alert, title=title, seed=seed,
        noise_scale=experiment.noise_scale, confidence=calibration.confidence,
    )  # fmt: skip
    return summary, ()
