"""Integrity and continuity budgets of an operation: how much risk each part of ARAIM may take."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.input_errors import InputError, require_positive, shown


@dataclass(frozen=True)
class Budget:
    """What an operation allows, as probabilities per exposure (one approach, for LPV-200).

    Attributes:
        name: the operation.
        p_hmi_vertical, p_hmi_horizontal: integrity risk given to the vertical and to the horizontal error.
        p_fa_vertical, p_fa_horizontal: probability of a false alert of the vertical and of the horizontal tests.
        p_threshold: risk that fault modes may carry without being monitored.
        p_emt: prior probability from which a fault mode counts in the effective monitor threshold.
    """

    name: str
    p_hmi_vertical: float
    p_hmi_horizontal: float
    p_fa_vertical: float
    p_fa_horizontal: float
    p_threshold: float
    p_emt: float

    def __post_init__(self) -> None:
        for field in list(self.__dataclass_fields__)[1:]:
            value = require_positive(getattr(self, field), field=f"budget.{field}")
            if value >= 1.0:
                raise InputError(f"budget.{field}: a probability below 1 is needed, not {shown(value)}.")

    def __str__(self) -> str:
        """The name, as it stands in the name of a method."""
        return self.name

    @property
    def p_hmi(self) -> float:
        """The whole integrity risk."""
        return self.p_hmi_vertical + self.p_hmi_horizontal


# ARAIM Algorithm Description Document v3.0 (Working Group C, 2017), table of constants for LPV-200.
LPV_200 = Budget(
    "LPV-200",
    p_hmi_vertical=9.8e-8,
    p_hmi_horizontal=2e-9,
    p_fa_vertical=3.9e-6,
    p_fa_horizontal=9e-8,
    p_threshold=8e-8,
    p_emt=1e-5,
)
