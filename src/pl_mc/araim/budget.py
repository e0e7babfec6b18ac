"""Integrity and continuity budgets of an operation: how much risk each part of ARAIM may take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pl_mc.input_errors import InputError, known_options, require_choice, require_number, require_positive, shown

# Fields that hold a probability of their own.
PROBABILITIES = (
    "p_hmi_vertical", "p_hmi_horizontal", "p_fa_vertical", "p_fa_horizontal", "p_threshold", "p_emt",
)  # fmt: skip


@known_options("budget")
@dataclass(frozen=True)
class Budget:
    """What an operation allows, as probabilities per exposure (one approach, for LPV-200).

    Attributes:
        name: the operation.
        p_hmi_vertical, p_hmi_horizontal: integrity risk given to the vertical and to the horizontal error.
        p_fa_vertical, p_fa_horizontal: probability of a false alert of the vertical and of the horizontal tests.
        p_threshold: risk that fault modes may carry without being monitored.
        p_emt: prior probability from which a fault mode counts in the effective monitor threshold.

    What follows belongs to ARAIM v4.2, where probabilities are those of the whole exposure; the values that stand
    here unless others are given say nothing, as in v3.0.

    Attributes:
        exposure_h: how long the operation is exposed to faults [h].
        samples_integrity, samples_continuity: N_es, independent samples of the errors in that time.
        consolidation: F_C, the share of a constellation's own prior below which combinations of faults inside of it
            count as faults of it.
        p_exclusion: P_exc, prior from which a fault mode may be excluded.
        capped: whether a fault counts no more often than it exists over the samples.
        sigma_acc_vertical_m, sigma_acc_horizontal_m: limits of the standard deviations under the accuracy model, up,
            and east and north, to which the adjusted estimator may go [m]; none where they are left out.
    """

    name: str
    p_hmi_vertical: float
    p_hmi_horizontal: float
    p_fa_vertical: float
    p_fa_horizontal: float
    p_threshold: float
    p_emt: float
    exposure_h: float = 0.0
    samples_integrity: float = 1.0
    samples_continuity: float = 1.0
    consolidation: float = 0.0
    p_exclusion: float = 1.0
    capped: bool = False
    sigma_acc_vertical_m: float | None = None
    sigma_acc_horizontal_m: float | None = None

    def __post_init__(self) -> None:
        for field in PROBABILITIES:
            value = require_positive(getattr(self, field), field=f"budget.{field}")
            if value >= 1.0:
                raise InputError(f"budget.{field}: a probability below 1 is needed, not {shown(value)}.")
        for field in ("samples_integrity", "samples_continuity"):
            if require_number(getattr(self, field), field=f"budget.{field}") < 1.0:
                raise InputError(f"budget.{field}: one sample is the least, not {shown(getattr(self, field))}.")
        if require_number(self.exposure_h, field="budget.exposure_h") < 0:
            raise InputError(f"budget.exposure_h: a time is not negative, as {shown(self.exposure_h)} is (nearest: 0).")
        for field in ("consolidation", "p_exclusion"):
            if not 0.0 <= require_number(value := getattr(self, field), field=f"budget.{field}") <= 1.0:
                raise InputError(f"budget.{field}: it lies between 0 and 1, not at {shown(value)}.")
        if not isinstance(self.capped, bool):
            raise InputError(f"budget.capped: true or false is needed, not {shown(self.capped)}.")
        for field in ("sigma_acc_vertical_m", "sigma_acc_horizontal_m"):
            if (value := getattr(self, field)) is not None:
                require_positive(value, field=f"budget.{field}")

    def __str__(self) -> str:
        """The name, as it stands in the name of a method."""
        return self.name

    @property
    def p_hmi(self) -> float:
        """The whole integrity risk."""
        return self.p_hmi_vertical + self.p_hmi_horizontal

    @property
    def has_exposure(self) -> bool:
        """Whether it says anything that belongs to ARAIM v4.2."""
        fields = [field for name, field in self.__dataclass_fields__.items() if name not in ("name", *PROBABILITIES)]
        return any(getattr(self, field.name) != field.default for field in fields)


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

# Settings of the two examples of MAAST for ARAIM, which its authors call the computation of ADD v4.2.
LPV_200_V42 = replace(
    LPV_200,
    name="LPV-200 v4.2",
    p_threshold=6e-8,
    exposure_h=1 / 24,
    samples_integrity=25.0,
    samples_continuity=25.0,
    consolidation=0.01,
    p_exclusion=9e-7,
    capped=True,
    sigma_acc_vertical_m=1.86,
    sigma_acc_horizontal_m=3.0,
)
RNP_V42 = Budget(
    "RNP v4.2",
    p_hmi_vertical=1e-9,
    p_hmi_horizontal=9.9e-8,
    p_fa_vertical=1e-9,
    p_fa_horizontal=5e-7,
    p_threshold=9e-8,
    p_emt=1e-5,
    exposure_h=1.0,
    samples_integrity=450.0,
    samples_continuity=450.0,
    consolidation=0.05,
    p_exclusion=9e-7,
    sigma_acc_vertical_m=10.0,
    sigma_acc_horizontal_m=60.0,
)

V3, V42 = "v3", "v4.2"
STANDARDS = (V3, V42)

# What an ISM has to say where there is an exposure, and the sentence where it does not.
RATES = ("r_sat_per_h", "r_const_per_h")
RATES_NEEDED = (
    "ism: with an exposure the rates and durations of faults are needed, which an ISM has (r_sat_per_h, mfd_sat_h, "
    "r_const_per_h, mfd_const_h; nearest: a budget without exposure_h)."
)

BUDGETS = {budget.name: budget for budget in (LPV_200, LPV_200_V42, RNP_V42)}


def as_budget(given: Any, *, field: str = "budget") -> Budget:
    """A budget from a record, the name of one of those above, or a table of fields.

    Raises:
        InputError: what is none of these, an unknown name or field, a field that is missing or cannot be used.
    """
    if isinstance(given, Budget):
        return given
    if isinstance(given, str):
        require_choice(given, BUDGETS, field=field)
        return BUDGETS[given]
    if not isinstance(given, Mapping):
        raise InputError(
            f"{field}: a budget such as pl_mc.araim.LPV_200, its name or a table of its fields is needed, not "
            f"{shown(given)}."
        )
    known = list(Budget.__dataclass_fields__)
    for key in given:
        require_choice(key, known, field=field)
    for key in ("name", *PROBABILITIES):
        if key not in given:
            raise InputError(f"{field}: {key} is missing (nearest: the name of a budget, {', '.join(BUDGETS)}).")
    return Budget(**given)


def require_standard(standard: Any, budget: Budget, *, of: str = "") -> None:
    """Raise `InputError` for an unknown standard, or one that would ignore what a budget says; ``of`` begins it."""
    require_choice(standard, STANDARDS, field=f"{of}standard")
    if standard == V3 and budget.has_exposure:
        raise InputError(
            f"{of}budget: {budget.name} has fields that have no effect in standard 'v3' (nearest: standard='v4.2')."
        )
