"""The choices of an iteratively reweighted estimate; where the first paper is silent, an option names the choice."""

from __future__ import annotations

from dataclasses import dataclass

from jax import Array

from pl_mc.input_errors import InputError, hold_whole, require_choice, require_number
from pl_mc.kernels.parameters import checkable, static, traced
from pl_mc.kernels.weights import Igg3Weight, WeightFunction

SCALES = ("posterior_floored", "apriori", "posterior", "mad", "mad_floored")
COFACTORS = ("fault_free", "reweighted", "none")
REDUNDANCIES = ("all", "kept", "weights")
STARTS = ("ls", "huber")
ACCELERATIONS = ("none", "aitken")
FIXED_WEIGHTS, SANDWICH = "weights", "sandwich"
COVARIANCES = (FIXED_WEIGHTS, SANDWICH)

# Solutions of the default, with Aitken's acceleration: under the worst of 113 single faults 7 of 8,192 draws have not
# settled to a centimetre (results/zhao2021.md), for which plain iteration takes twice as many.
SETTLED = 36

# Solutions before the first extrapolation.
AITKEN_START = 15

# Solutions with Huber's weights before the first one with those of the estimate. They throw nothing out, so five of
# them take most of a single large error off the good satellites before weights of zero are given.
HUBER_START = 5


@traced
@dataclass(frozen=True)
class IrlsOptions:
    """The choices of a reweighted estimate; its weight function and the smallest weight are leaves.

    Attributes:
        weight: weight function of the standardised residual.
        iterations: reweighted solutions after the least-squares one; `SETTLED` of them unless given.
        acceleration: ``none``, or ``aitken``: after 15 solutions every third one is moved on along its last step d,
            to where it would end if steps shrank by a constant ratio r, that of the last two: by r / (1 - r) d
            (Aitken 1926). It ends at the same solutions sooner; what has settled before the first of these stays, and
            takes the last solution next. ``aitken`` unless ``iterations`` is given, which
            alone means plain ones.
        scale: what multiplies the standard deviation of a residual: ``posterior_floored`` max(1, m), m the
            unit-weight error of the iterate; ``apriori`` 1; ``posterior`` m; ``mad`` 1.4826 times the median of the
            residuals over their standard deviations; ``mad_floored`` max(1, mad).
        cofactor: which N gives those standard deviations, sqrt(diag(P^-1 - A N^-1 A')): the ``fault_free`` one, the
            ``reweighted`` one of the iterate (the fault-free one where it leaves no positive variance), or ``none``
            for sigma itself.
        redundancy: what divides the weighted square sum in the unit-weight error of the final solution: ``all``
            n - t, rejected satellites included; ``kept`` satellites with w > 0, less t; ``weights`` sum w less t.
        start: what the first weights come from: ``ls`` the residuals of least squares; ``huber`` those of
            `HUBER_START` solutions after it with Huber's weights (k = 1.345), of the same scale and cofactor. They
            are solutions more than ``iterations``.
        weight_floor: the smallest weight factor, below one. With zero satellites can be thrown out; above zero none
            is.
        covariance: what unit-weight error and cofactors of the final solution make together: ``weights`` the covariance
            of a solution whose weights were known before, m^2 (A' P_bar A)^-1; ``sandwich`` that of the M-estimate,
            from its influence function (`pl_mc.kernels.sandwich`), without which there is no solution either.
    """

    weight: WeightFunction = Igg3Weight()  # noqa: RUF009 (a frozen record)
    iterations: int | None = static(None)
    scale: str = static("posterior_floored")
    cofactor: str = static("fault_free")
    redundancy: str = static("all")
    start: str = static("ls")
    weight_floor: float | Array = 0.0
    acceleration: str | None = static(None)
    covariance: str = static(FIXED_WEIGHTS)

    def __post_init__(self) -> None:
        require_choice(self.scale, SCALES, field="scale")
        require_choice(self.cofactor, COFACTORS, field="cofactor")
        require_choice(self.redundancy, REDUNDANCIES, field="redundancy")
        require_choice(self.start, STARTS, field="start")
        require_choice(self.covariance, COVARIANCES, field="covariance")
        if self.iterations is not None:
            hold_whole(self, "iterations", low=1)
        if self.acceleration is not None:
            require_choice(self.acceleration, ACCELERATIONS, field="acceleration")
        if self.acceleration == "aitken" and self.solutions <= AITKEN_START:
            raise InputError(
                f"acceleration: 'aitken' begins after {AITKEN_START} solutions and does nothing in {self.iterations}; "
                f"take iterations of at least {AITKEN_START + 1}, or the acceleration 'none'."
            )
        floor = self.weight_floor
        if checkable(floor) and not 0.0 <= require_number(floor, field="weight_floor") < 1.0:  # type: ignore[arg-type]
            raise InputError(f"weight_floor: a number from 0 to below 1 is needed, not {self.weight_floor!r}.")

    @property
    def solutions(self) -> int:
        """Reweighted solutions after the least-squares one."""
        return SETTLED if self.iterations is None else self.iterations

    @property
    def accelerated(self) -> bool:
        """Whether some of them are extrapolated."""
        return self.iterations is None if self.acceleration is None else self.acceleration == "aitken"
