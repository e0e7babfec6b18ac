"""What a file of the kind ``risk`` says, what is asked of it before it runs, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from pl_mc.faults import require_satellite
from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError, require_choice
from pl_mc.methods import Method
from pl_mc.studies.spec import ByOneLevel, MethodChoice, SimulatedGeometry
from pl_mc.studies.strict import Strict
from pl_mc.studies.study import Check, Work, refuse

EventName = Literal["missed", "misleading"]

# Estimates a second on two cores, from the seconds in the manifest of the shipped experiment.
_ESTIMATES_PER_S = 0.25
# Satellites in view, where all of them are estimated.
_ALL_SATELLITES = 16


class CurveChoice(Strict):
    """Risk against bias; ``target_cov`` and ``max_evaluations`` are those of `pl_mc.integrity_risk.rare.risk.risk`.

    Attributes:
        satellites: which get the ramp, one at a time.
        start_m, stop_m, step_m: the ramp of the exact curves [m].
        misleading_m, missed_m: sizes at which other methods are estimated [m].
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
    """The worst fault of every satellite; ``target_cov`` and ``max_evaluations`` are of the last estimates.

    Attributes:
        events: events for which the worst fault is computed by least squares.
        estimated: satellites whose worst fault is estimated for the other methods; ``["all"]`` for every one in
            view.
        estimated_events: events for which that is done.
        refined: for each of these events, how many satellites, the worst first, get a last estimate with noise of
            its own; all unless given.
        pair_events: for which the worst pairs of satellites are searched for, of least squares and of the others.
    """

    events: Annotated[tuple[EventName, ...], Field(min_length=1)] = ("misleading", "missed")
    estimated: tuple[str, ...] = ()
    estimated_events: tuple[EventName, ...] = ("misleading",)
    refined: tuple[Annotated[int, Field(ge=1)], ...] = ()
    pair_events: tuple[EventName, ...] = ()
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)

    def named(self) -> tuple[str, ...]:
        """The satellites of ``estimated``, nothing where it means all."""
        return () if self.estimated == ("all",) else self.estimated

    def require_refined(self) -> None:
        """An `InputError` unless every estimated event has its number."""
        if self.refined and len(self.refined) != len(self.estimated_events):
            raise InputError(
                f"worst.refined: one number for each of the {len(self.estimated_events)} events of "
                f"estimated_events, or none at all, is needed, not {len(self.refined)}."
            )


class BudgetChoice(Strict):
    """One budget; fields are those of `pl_mc.integrity_risk.budget.budget.risk_budget`.

    ``method`` is the name of one of the experiment's methods.

    Attributes:
        sizes_m: bias sizes at which a method is estimated, instead of the worst one.
    """

    method: str
    event: EventName = "missed"
    p_sat: float | dict[str, float] = 1e-5
    p_const: float | dict[str, float] = 1e-4
    ism: str | dict[str, Any] | None = Field(
        default=None, description="integrity support message with these priors: a CSV file, or a table of its fields"
    )
    sizes_m: Annotated[tuple[float, ...], Field(min_length=1)] | None = None
    constellation: Literal["independent", "common"] = "independent"
    pairs: int | Literal["all"] | None = None
    samples_per_approach: int = Field(default=25, ge=1)
    target: float = Field(default=2e-7, gt=0)
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=2_000_000, ge=500_000)

    def method_of(self, methods: Iterable[Method]) -> Method:
        """The method among those of the experiment; an `InputError` where it is none of them."""
        known = {method.name: method for method in methods}
        return known[require_choice(self.method, known, field="budgets.method")]


class CalibrationChoice(Strict):
    """The multiplier that keeps a target; ``target_cov`` and ``max_evaluations`` are of the rare-event estimator.

    Attributes:
        event: the event whose probability is kept.
        targets: probabilities of the event per sample.
        faults: faults under which they have to be kept, tables of biases by satellite [m]; an empty one is the
            fault-free case.
        confidence: confidence of the bounds of a multiplier that is counted or estimated.
        draws_per_event: a target is counted with this number over it as draws, within the limits below.
        fewest_draws: draws of the counting, at the least.
        most_draws: draws of the counting, at the most; a target that needs more is left to the rare-event
            estimator.
        rare_faults: how many of the faults, from the first, get targets that cannot be counted.
        also: methods that are calibrated besides those of the experiment.
        worst_sizes_m: sizes of a fault on any satellite, of which each method gets the one that needs the largest
            multiplier at the smallest target as a further fault; none unless given [m].
        alarm_satellite: satellite of the ramp under which alarms at equal risk are compared.
        alarm_biases_m: biases of that ramp [m].
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

    def counts(self, target: float) -> bool:
        """Whether a target is common enough to be counted."""
        return self._needed(target) <= self.most_draws

    def draws(self, target: float) -> int:
        """Draws for a target; so few that it is estimated where it would take too many."""
        return self._needed(target) if self.counts(target) else min(self.fewest_draws, math.ceil(1.0 / target))

    def _needed(self, target: float) -> int:
        return max(self.fewest_draws, math.ceil(self.draws_per_event / target))


class RiskExperiment(ByOneLevel):
    """Curves, worst cases, budgets and calibration at one epoch.

    Attributes:
        geometry: the satellites in view, at one epoch.
        noise_scale: factor of every sigma, in the noise and in the weights.
        curves: risk against the bias.
        worst: the worst fault of every satellite.
        budgets: risk budgets over the fault modes.
        calibration: the multiplier that keeps a target.
    """

    double_alone: ClassVar[bool] = True

    kind: Literal["risk"] = "risk"
    geometry: SimulatedGeometry
    noise_scale: float = Field(default=1.0, gt=0)
    curves: CurveChoice
    worst: WorstChoice = WorstChoice()
    budgets: tuple[BudgetChoice, ...] = ()
    calibration: CalibrationChoice


def checks(experiment: RiskExperiment, g: Geometry | None) -> Iterator[Check]:
    """There is one epoch, and every satellite that is named is in view at it."""
    yield "worst.refined", experiment.worst.require_refined
    if g is None:
        return
    if g.is_series:
        yield "geometry.epoch", lambda: refuse("this kind of experiment needs one epoch.")
        return
    for field, names in (
        ("curves.satellites", experiment.curves.satellites),
        ("worst.estimated", experiment.worst.named()),
        ("calibration.alarm_satellite", (experiment.calibration.alarm_satellite,)),
        *((f"calibration.faults.{k}", tuple(fault)) for k, fault in enumerate(experiment.calibration.faults)),
    ):
        for name in names:
            yield field, partial(require_satellite, g, name)


def work(experiment: RiskExperiment) -> Work:
    """Estimates of rare events; least squares is exact and costs nothing beside them."""
    curves, worst, calibration = experiment.curves, experiment.worst, experiment.calibration
    estimated = sum(method.name != "ls" for method in experiment.method_records())
    satellites = _ALL_SATELLITES if worst.estimated == ("all",) else len(worst.estimated)
    number = estimated * len(curves.satellites) * (len(curves.misleading_m) + len(curves.missed_m))
    number += estimated * satellites * len(worst.estimated_events)
    for budget in experiment.budgets:
        if budget.method != "ls" and budget.sizes_m:
            number += 1 + _ALL_SATELLITES * len(budget.sizes_m)
    number += estimated * len(calibration.faults) * len(calibration.targets)
    return Work(None, number / _ESTIMATES_PER_S)
