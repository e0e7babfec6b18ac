"""The IGG-III robust estimate with rebuilt protection levels (Zhao et al. 2021, eqs 6, 7, 17-19)."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_positive
from pl_mc.kernels import Igg3Weight, IrlsOptions, LinearModel, Start, irls, protection_levels
from pl_mc.methods.base import Outcome, name_with_options, outcome_of


@dataclass(frozen=True)
class Igg3:
    """IGG-III reweighting; the options are explained at `pl_mc.kernels.IrlsOptions`.

    Attributes:
        k0, k1: standardised residuals where the weight begins to fall and where it reaches zero.
        iterations: reweighted solutions after the least-squares one.
        scale: ``posterior_floored``, ``apriori``, ``posterior``, ``mad`` or ``mad_floored``.
        cofactor: N of the residuals' standard deviations: ``fault_free``, ``reweighted`` or ``none``.
        redundancy: divisor of the unit-weight error: ``all``, ``kept`` or ``weights``.
        start: ``ls``, or ``huber``: five solutions with Huber's weights before the first with those of IGG-III.
        weight_floor: smallest weight factor; above zero no satellite is thrown out.
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    k0: float = 1.5
    k1: float = 5.0
    iterations: int = 10
    scale: str = "posterior_floored"
    cofactor: str = "fault_free"
    redundancy: str = "all"
    start: str = "ls"
    weight_floor: float = 0.0
    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        for field in ("k_horizontal", "k_vertical"):
            require_positive(getattr(self, field), field=f"igg3: {field}")
        # The kernel's own records check the other values, here and not at the first trace.
        _ = self.options

    @property
    def name(self) -> str:
        return name_with_options("igg3", self, Igg3())

    @property
    def options(self) -> IrlsOptions:
        """The kernel's view of these options."""
        return IrlsOptions(
            weight=Igg3Weight(self.k0, self.k1),
            iterations=self.iterations,
            scale=self.scale,
            cofactor=self.cofactor,
            redundancy=self.redundancy,
            start=self.start,
            weight_floor=self.weight_floor,
        )

    def prepare(self, model: LinearModel) -> tuple[()]:
        return ()

    def solve(self, model: LinearModel, prepared: tuple[()], start: Start) -> Outcome:
        estimate = irls(model, start, self.options)
        levels = protection_levels(estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        return outcome_of(estimate, levels)
