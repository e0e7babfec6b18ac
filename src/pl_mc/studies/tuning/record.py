"""The record of an experiment of the kind ``tuning``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pl_mc.geometry import Geometry
from pl_mc.input_errors import require_choice
from pl_mc.integrity_risk.tuning.objective import ALARMS, LEVEL
from pl_mc.studies.fault_fields import OneFault
from pl_mc.studies.spec import ByOneLevel, SimulatedGeometry
from pl_mc.studies.study import Check

ObjectiveName = Literal["vpl", "hpl", "alarms"]


class TuningExperiment(ByOneLevel):
    """Tuned limits of IGG-III at one epoch, for several targets and objectives.

    Attributes:
        geometry: the satellites in view, at one epoch.
        targets: probabilities of the event per sample that are kept.
        objectives: what is made small, fault-free: the mean level (vpl, horizontally hpl) or the share of alarms
            (alarms); both unless given.
        event: the event whose probability is kept, misleading or exceeded.
        faults: faults under each of which the target is kept, tables of biases by satellite [m] or texts; an
            empty one is the fault-free case.
        draws: fresh noise draws that judge; targets of which they have 20 events are counted.
        search_draws: weighted draws of the search, for each fault.
        steps: most steps of each descent.
        confidence: with which the multipliers keep the target.
        target_cov: relative standard error of the risk that judges a target that cannot be counted.
        max_evaluations: scenarios that it may take, for each fault and pair of limits.
        worst: how many satellites fail together, 1 or 2 or both: the worst of such faults is sought for all limits
            at the smallest target, with the multipliers that they need for the faults above.
    """

    double_alone: ClassVar[bool] = True

    kind: Literal["tuning"] = "tuning"
    geometry: SimulatedGeometry
    targets: Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(min_length=1)]
    objectives: Annotated[tuple[ObjectiveName, ...], Field(min_length=1)] | None = None
    event: Literal["misleading", "exceeded"] = "misleading"
    faults: Annotated[tuple[OneFault, ...], Field(min_length=1)] = ({},)
    draws: int = Field(default=400_000, ge=1000)
    search_draws: int = Field(default=16_384, ge=1024)
    steps: int = Field(default=30, ge=1)
    confidence: float = Field(default=0.95, gt=0, lt=1)
    target_cov: float = Field(default=0.1, gt=0, lt=1)
    max_evaluations: int = Field(default=10_000_000, ge=500_000)
    worst: tuple[Literal[1, 2], ...] = ()

    def aims(self) -> tuple[str, ...]:
        """The objectives; an `InputError` for the level of the axis that does not decide."""
        known = (LEVEL[self.level_axis], ALARMS)
        return tuple(require_choice(one, known, field="objectives") for one in self.objectives or known)


def checks(experiment: TuningExperiment, g: Geometry | None) -> Iterator[Check]:
    """The level that is made small is that of the limit that decides."""
    yield "objectives", experiment.aims
