"""A position with weights that level the slopes: accuracy given up for a smaller protection level."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.input_errors import hold_whole, require_choice
from pl_mc.kernels import LeastSquaresSolution, LinearModel, ProtectionLevels
from pl_mc.kernels.leave_one_out import covariance_of, effect_floor, largest_slopes, projections
from pl_mc.kernels.linear_model import COORDINATES, add_empty, product, redundancy_floor
from pl_mc.kernels.small_matrix import cholesky, solve
from pl_mc.methods.base import Named, Outcome
from pl_mc.methods.raim_levels import (
    FORMS,
    NONCENTRAL,
    P_FA,
    P_MD,
    at_dof,
    decided,
    require_risks,
    slope_levels,
    thresholds,
)

VERTICAL, HORIZONTAL = "vertical", "horizontal"

# The largest weight over the smallest: weights go like 1 / |effect|, which may vanish.
_WEIGHT_RANGE = 1e3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Prepared:
    """What a geometry decides.

    Attributes:
        gain: (3, n), the position is this times the whitened observations [m].
        levels: of that position.
        threshold: (), of V'PV.
    """

    gain: Array
    levels: ProtectionLevels
    threshold: Array


@dataclass(frozen=True)
class Nioraim(Named):
    """Novel integrity-optimised RAIM (Hwang & Brown 2006): x = (A'WPA)^-1 A'WP L with weights W beside P.

    The position S L stays unbiased for every W, and the test stays that of the parity vector, which W does not
    change: V'PV of least squares against its chi-square quantile. Faults have the slopes |S_q,i| sigma_i /
    sqrt(r_i), and the weights make the largest of them small. That is Chebyshev's problem min max |s_i| / sqrt(r_i)
    with s A = e_q, whose dual min sum sqrt(r_i) |a_i'u| with u_q = 1 is solved by least squares with weights
    sqrt(r_i) / |a_i'u|: each weight is divided by its slope, a fixed number of times, and the best weights met are
    used (those of least squares are the first). It is done once for a geometry.

    Of Hwang & Brown's papers only an abstract was at hand, and a patent text on the same method
    ("Integrity-Optimized Receiver Autonomous Integrity Monitoring"): the aim, the estimator (H'VH)^-1 H'V z with a
    diagonal V, and a test by the parity vector, with covariance sigma^2 I, that the weights leave alone, are from
    there. How the weights are found, and the levels, are this file's own: theirs evaluate a horizontal limit with
    the noise of the suboptimal position by precomputed tables; here the levels are the forms of
    `pl_mc.methods.raim_levels`.

    The price is a larger standard deviation of the position, which only the forms with noise hold against the
    weights. An alarm means that V'PV exceeds its threshold, or levels beyond VAL.

    Attributes:
        p_fa: false-alarm probability of the test, for each sample.
        p_md: missed-detection probability behind the levels.
        form: of the level, as for ``slope``.
        target: ``vertical`` or ``horizontal``, the level that is made small; one set of weights serves both.
        iterations: weights tried after those of least squares.
    """

    key = "nioraim"

    p_fa: float = P_FA
    p_md: float = P_MD
    form: str = NONCENTRAL
    target: str = VERTICAL
    iterations: int = 20

    def __post_init__(self) -> None:
        require_risks("nioraim", p_fa=self.p_fa, p_md=self.p_md)
        require_choice(self.form, FORMS, field="nioraim: form")
        require_choice(self.target, (VERTICAL, HORIZONTAL), field="nioraim: target")
        hold_whole(self, "iterations", field="nioraim: iterations", low=1)

    levels_from_geometry = True

    def prepare(self, model: LinearModel) -> Prepared:
        parts = projections(model)
        redundancy = jnp.where(parts.free, 0.0, model.redundancy)
        checked = redundancy >= redundancy_floor(redundancy.dtype)

        def levels_of(gain: Array) -> ProtectionLevels:
            covariance = covariance_of(gain)
            return slope_levels(
                largest_slopes(gain, redundancy, covariance), covariance, model.dof,
                most=gain.shape[1], p_fa=self.p_fa, p_md=self.p_md, form=self.form,
            )  # fmt: skip

        def goal(gain: Array) -> Array:
            levels = levels_of(gain)
            return levels.vpl_m if self.target == VERTICAL else levels.hpl_m

        def relevel(weights: Array, gain: Array) -> Array:
            """Weights over their slopes: sqrt(r) over the effect of a unit weight."""
            squared = gain * gain
            effect = squared[2] if self.target == VERTICAL else squared[0] + squared[1]
            effect = jnp.where(checked, jnp.sqrt(effect) / weights, 0.0)
            largest = jnp.max(effect)
            floor = jnp.maximum(largest / _WEIGHT_RANGE, jnp.finfo(effect.dtype).tiny)
            relative = jnp.sqrt(redundancy) * largest / jnp.maximum(effect, floor)
            return jnp.where(checked & (largest > 0), relative, 1.0)

        def improve(_: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
            weights, gain, best, least = state
            weights = relevel(weights, gain)
            gain = _weighted_gain(model, weights, parts.free)
            value = goal(gain)
            better = value < least
            return weights, gain, jnp.where(better, gain, best), jnp.where(better, value, least)

        gain = parts.rows[-COORDINATES:]
        first = (jnp.ones_like(redundancy), gain, gain, goal(gain))
        *_, best, _ = jax.lax.fori_loop(0, self.iterations, improve, first)
        threshold = at_dof(thresholds(gain.shape[1], self.p_fa), model.dof)
        return Prepared(best, levels_of(best), threshold)

    def solve(self, model: LinearModel, prepared: Prepared, start: LeastSquaresSolution) -> Outcome:
        # S A = (I 0), so the difference from least squares is what S makes of the residuals.
        error = start.state[:COORDINATES] + product(prepared.gain, start.residuals)
        return decided(model.available, error, prepared.levels, start.square_sum > prepared.threshold)


def _weighted_gain(model: LinearModel, weights: Array, free: Array) -> Array:
    """(3, n), S of weights beside P, in whitened observations [m]; zero for satellites that have no part in it."""
    packed = add_empty(product(model.products[:-1], weights), model.empty)
    factor = cholesky(packed, jnp.zeros_like(model.pivot_floor))
    gain = jnp.stack(solve(factor, model.design_rows)[:COORDINATES]) * weights[None]
    # Rounding of effects that are zero.
    size = jnp.sqrt(jnp.sum(gain * gain, axis=1, keepdims=True))
    return jnp.where(free[None] | (jnp.abs(gain) <= effect_floor(gain.dtype) * size), 0.0, gain)
