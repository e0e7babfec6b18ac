"""Least squares with protection levels from the posterior variance (Zhao et al. 2021, eqs 4, 12-16)."""

from __future__ import annotations

from dataclasses import dataclass

from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.input_errors import require_positive
from pl_mc.kernels import LeastSquaresSolution, LinearModel, least_squares, protection_levels
from pl_mc.methods.base import Outcome, name_with_options, outcome_of
from pl_mc.statistics.exact import LeastSquaresLaw


@dataclass(frozen=True)
class Ls:
    """Weighted least squares.

    Attributes:
        k_horizontal, k_vertical: multipliers of the protection levels.
    """

    k_horizontal: float = K_HORIZONTAL
    k_vertical: float = K_VERTICAL

    def __post_init__(self) -> None:
        for field in ("k_horizontal", "k_vertical"):
            require_positive(getattr(self, field), field=f"ls: {field}")

    @property
    def name(self) -> str:
        return name_with_options("ls", self, Ls())

    scales_with_k = "k_vertical"

    @property
    def exact_law(self) -> LeastSquaresLaw:
        return LeastSquaresLaw(self.k_vertical)

    def prepare(self, model: LinearModel) -> tuple[()]:
        return ()

    def solve(self, model: LinearModel, prepared: tuple[()], start: LeastSquaresSolution) -> Outcome:
        estimate = least_squares(model, start)
        levels = protection_levels(estimate, k_horizontal=self.k_horizontal, k_vertical=self.k_vertical)
        return outcome_of(estimate, levels)
