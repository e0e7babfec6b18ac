"""The test of a method beside detectors: its statistic over its own threshold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jax import Array

from pl_mc.detectors import DETECTORS, Detector, Verdict, View
from pl_mc.detectors.base import nothing_redundant, suspected
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.methods import METHODS, Method
from pl_mc.methods.capabilities import refusal, statistic
from pl_mc.named import as_records


@dataclass(frozen=True)
class MethodTest:
    """The test of a method that has a statistic (`pl_mc.methods.capabilities.Statistic`), as a detector.

    The statistic is the ratio, so that the nominal threshold is 1, whatever false-alarm probability is asked for.
    Where the method has no solution the ratio is infinite. The suspect is that of the chi-square test.
    """

    method: Method

    label = "own threshold"

    @property
    def test(self) -> str:
        return self.method.name

    name = test

    def reason_against(self, view: View) -> str | None:
        return nothing_redundant(view)

    def prepare(self, model: LinearModel, system: Array, p_fa: float) -> Any:
        return self.method.prepare(model)

    def examine(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Verdict:
        own = statistic(self.method)
        assert own is not None
        ratio = own(model, prepared, start)
        one = jnp.ones((), ratio.dtype)
        return Verdict(ratio, one, ratio > one, *suspected(model, start))


def as_tests(tests: Sequence[str | Detector | Method]) -> tuple[Detector, ...]:
    """Names and records of detectors and of methods with a statistic, made detectors.

    Raises:
        InputError: none, strangers, two of one name, a method without a statistic.
    """
    made = as_records(tests, DETECTORS | METHODS, Detector | Method, what="test")
    for test in made:
        if not isinstance(test, Detector) and statistic(test) is None:
            raise refusal(test, "statistic", able=statistic, field="tests", also=DETECTORS)
    return tuple(test if isinstance(test, Detector) else MethodTest(test) for test in made)
