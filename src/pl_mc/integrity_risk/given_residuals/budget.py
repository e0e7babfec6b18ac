"""What a level may be exceeded with, and how the risk is shared among fault modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pl_mc.alert import HORIZONTAL, VERTICAL
from pl_mc.araim.budget import LPV_200
from pl_mc.arrays import FloatArray
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, known_options, require_number, require_within
from pl_mc.integrity_risk.modes.fault_modes import (
    FAULT_FREE,
    P_SAT,
    PAIR,
    SATELLITE,
    fault_modes,
    not_monitored,
    source_priors,
)

TARGETS = {VERTICAL: LPV_200.p_hmi_vertical, HORIZONTAL: LPV_200.p_hmi_horizontal}


@known_options("budget")
@dataclass(frozen=True)
class RiskBudget:
    """The risk that an error exceeds its level, and the faults that share it; all per sample.

    The event is that the error is beyond the level and the method's own test, if it has one, does not reject; a level
    beyond the alert limit is no excuse. Analysed are the fault-free case and every single satellite, each under the
    size of fault that is worst for it. Every other combination of faults counts as lost: its prior counts whole. As
    ARAIM does with what it does not monitor, what is lost is charged to the risk of both axes together, so that an axis
    keeps ``target * (1 - p_lost / p_hmi)`` for what is analysed, and both axes together p_hmi.

    Attributes:
        target: largest probability of the event on the axis; unless given 9.8e-8 for the vertical and 2e-9 for the
            horizontal, the shares of LPV-200 (ADD v3.0). An operation without a vertical limit has all of it: 9.9e-8
            for RNP.
        p_sat, p_const: prior of a fault of a satellite and of a constellation, one for all, or by name and by system
            letter. Faults of constellations count as lost.
        b_nom_m: largest nominal bias of every satellite [m]. All of them stand at it, with the signs that move the
            error most, once along every component of it.
        p_hmi: the risk of both axes together.

    Example:
        >>> import pl_mc
        >>> pl_mc.RiskBudget(target=1e-8, p_sat=1e-6)
        RiskBudget(target=1e-08, p_sat=1e-06, p_const=0.0, b_nom_m=0.0, p_hmi=1.0000000000000001e-07)
    """

    target: float | None = None
    p_sat: float | Mapping[str, float] = P_SAT
    p_const: float | Mapping[str, float] = 0.0
    b_nom_m: float = 0.0
    p_hmi: float = LPV_200.p_hmi

    def __post_init__(self) -> None:
        if self.target is not None:
            require_within(self.target, field="budget: target", low=1e-15, high=0.1)
        require_within(self.p_hmi, field="budget: p_hmi", low=1e-15, high=0.1)
        if self.target is not None and self.target > self.p_hmi:
            raise InputError(
                f"budget: target: the risk of one axis, {self.target:g}, is no more than that of both, p_hmi = "
                f"{self.p_hmi:g}."
            )
        if not 0.0 <= require_number(self.b_nom_m, field="budget: b_nom_m") <= 100.0:
            raise InputError(f"budget: b_nom_m: from 0 to 100 m, not {self.b_nom_m!r}.")

    def on(self, axis: str) -> float:
        """The target of an axis."""
        return TARGETS[axis] if self.target is None else float(self.target)

    def allowed(self, shares: Shares, axis: str) -> float:
        """What the target of an axis leaves the analysed modes; an `InputError` where that is nothing."""
        left = self.on(axis) * (1.0 - shares.lost / self.p_hmi)
        if left <= 0:
            raise InputError(
                f"budget: what is not analysed has a prior of {shares.lost:.3g}, and p_hmi is {self.p_hmi:g}: nothing "
                "is left (smaller p_sat or p_const, or a larger p_hmi)."
            )
        return left

    def shared(self, g: Geometry) -> Shares:
        """Priors of the modes of one epoch."""
        satellites, constellations = source_priors(g, self.p_sat, self.p_const)
        modes = fault_modes(g, satellites, constellations)
        single = np.zeros(len(g.names))
        for mode in modes:
            if mode.kind == SATELLITE:
                single[g.names.index(mode.label)] = mode.prior
        of_kind = {kind: sum(mode.prior for mode in modes if mode.kind == kind) for kind in (FAULT_FREE, PAIR)}
        rest = sum(mode.prior for mode in modes if mode.kind not in (FAULT_FREE, SATELLITE, PAIR))
        more = not_monitored(modes, [*satellites, *constellations.values()])
        return Shares(of_kind[FAULT_FREE], single, of_kind[PAIR], rest + more)


@dataclass(frozen=True)
class Shares:
    """Priors of one epoch: of no fault, (n,) of each satellite alone, of all pairs, and of all that is left."""

    fault_free: float
    single: FloatArray
    pairs: float
    other: float

    @property
    def lost(self) -> float:
        """Prior of what is not analysed."""
        return self.pairs + self.other


def as_budget(budget: Any) -> RiskBudget:
    """A budget or its fields as a mapping, as experiment files have it."""
    if isinstance(budget, RiskBudget):
        return budget
    if isinstance(budget, Mapping):
        unknown = [key for key in budget if key not in RiskBudget.__dataclass_fields__]
        if unknown:
            raise InputError(
                f"budget: {unknown[0]!r} is unknown (valid: {', '.join(RiskBudget.__dataclass_fields__)})."
            )
        return RiskBudget(**budget)
    raise InputError(f"budget: pl_mc.RiskBudget(target=9.8e-8), or a table of its fields, is needed, not {budget!r}.")
