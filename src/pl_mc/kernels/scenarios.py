"""Scenarios of one geometry: every fault on the same noise.

What scenarios share is computed once: least squares of noise plus fault is a sum of two projections.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.estimate import LeastSquaresSolution
from pl_mc.kernels.linear_model import LinearModel, product
from pl_mc.kernels.outcome import Method, Outcome

Result = TypeVar("Result")


class Drawn(Protocol):
    """Biases that are drawn with the noise, a pytree of arrays (f, n)."""

    @property
    def rows(self) -> Array:
        """(f, n), which rows have one."""

    def lanes(self, numbers: Array) -> Array:
        """(n, lanes), those of one fault [m], from the numbers (2, n, lanes) that they are drawn from."""


class FaultRows(Protocol):
    """The faults of one geometry.

    Attributes:
        bias_m: (f, n), bias vectors [m].
        applies: (f,), which of them count; the others are skipped.
        drawn: biases besides; None where none is.
    """

    @property
    def bias_m(self) -> Array: ...

    @property
    def applies(self) -> Array: ...

    @property
    def drawn(self) -> Drawn | None: ...


def each_fault(
    model: LinearModel,
    faults: FaultRows,
    noise: Array,
    reduce: Callable[[LeastSquaresSolution, Array], Result],
    *,
    sizes: Array | None = None,
    skipped: Result | None = None,
) -> Result:
    """``reduce`` of the least-squares start and the bias vector (n,) [m], NaN where drawn, for each fault.

    Every fault is added to the same noise (n, lanes). Where a fault does not apply the result is ``skipped``, at no
    cost, unless that is None. ``sizes`` (2, n, lanes) are the numbers of drawn biases, where there are any.
    """
    noise = noise * model.in_view[:, None]
    noise_state = product(model.gain, noise)
    noise_residuals = noise - product(model.design, noise_state)
    noise_square_sum = jnp.sum(noise_residuals * noise_residuals, axis=0)

    bias = faults.bias_m * model.weight_root[None]
    bias_state = product(bias, model.gain.T)
    bias_residuals = bias - product(bias_state, model.design.T)
    cross = product(bias_residuals, noise_residuals)
    noise_residuals, bias_residuals = model.twins.alike(noise_residuals), model.twins.alike(bias_residuals.T).T

    def one_fault(parts: tuple[Array, Array, Array, Array, Array, Drawn | None]) -> Result:
        applies, bias_m, state, residuals, cross_sum, drawn = parts

        def solve() -> Result:
            square_sum = noise_square_sum + 2.0 * cross_sum + jnp.sum(residuals * residuals)
            start = LeastSquaresSolution(
                residuals=noise_residuals + residuals[:, None],
                state=noise_state + state[:, None],
                # A square sum, but for the rounding of its three parts.
                square_sum=jnp.maximum(square_sum, 0.0),
            )
            if drawn is None:
                return reduce(start, bias_m)
            assert sizes is not None, "biases are drawn from numbers"
            return reduce(shifted(start, drawn.lanes(sizes)), jnp.where(drawn.rows, jnp.nan, bias_m))

        def shifted(start: LeastSquaresSolution, drawn_m: Array) -> LeastSquaresSolution:
            bias = drawn_m * model.weight_root[:, None]
            state = product(model.gain, bias)
            residuals = start.residuals + model.twins.alike(bias - product(model.design, state))
            # As it was where nothing is drawn.
            square_sum = jnp.where(jnp.any(drawn_m != 0), jnp.sum(residuals * residuals, axis=0), start.square_sum)
            return LeastSquaresSolution(residuals=residuals, state=start.state + state, square_sum=square_sum)

        return solve() if skipped is None else jax.lax.cond(applies, solve, lambda: skipped)

    return jax.lax.map(one_fault, (faults.applies, faults.bias_m, bias_state, bias_residuals, cross, faults.drawn))


def each_outcome(
    model: LinearModel,
    prepared: list,
    methods: tuple[Method, ...],
    faults: FaultRows,
    noise: Array,
    reduce: Callable[[list[Outcome]], Result],
    *,
    sizes: Array | None = None,
    skipped: Result | None = None,
) -> Result:
    """``reduce`` of the methods' outcomes for each fault; the rest as for `each_fault`."""

    def solve(start: LeastSquaresSolution, _: Array) -> Result:
        return reduce([m.solve(model, p, start) for m, p in zip(methods, prepared, strict=True)])

    return each_fault(model, faults, noise, solve, sizes=sizes, skipped=skipped)
