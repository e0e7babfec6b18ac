"""The cost of IGG-III limits k0, k1 at a given risk, over noise that stays the same.

The multiplier follows from the limits: it is where the share of draws whose ratio
(`pl_mc.integrity_risk.k_factor.error_to_level_ratio`) is above it is the target. A share jumps from draw to draw; with
a logistic step of width ``h`` in the logarithm of the ratio it passes from one to the next. Where the target is too
rare for plain draws, the ratios are those of draws from another density with their weights, which do not depend on
the limits (`pl_mc.integrity_risk.tuning.draws`).

The search goes by differences over some per cent of the limits, not by derivatives. What a settled estimate says of a
draw near the border of two solutions changes steeply with the limits, and at the border it jumps: a derivative is right
for the draws as they are, but a few of them carry it, and those that go over are not in it (measured at epoch 545 and a
target of 1e-3, two sets of 131,072 draws, by k1: -0.024 and -0.046; by differences over 5 % -0.024 and -0.021; of three
descents by derivatives over 32,768 draws one stayed where it began, a third above the others).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy import special

from pl_mc.alert import HORIZONTAL, VERTICAL
from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import ratio_of
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.events import levels_of
from pl_mc.kernels.linear_model import has_one_clock_per_row
from pl_mc.methods import Igg3
from pl_mc.runtime.precision import precision_scope

# Design (n, t) [m/m], sigma (n,) [m], bias (n,) [m], whitened noise (N, n), alert limit [m], whether the
# event is the misleading one.
Scenario = tuple[Array, Array, Array, Array, Array, Array]

# The mean level of an axis, or the share of alarms.
LEVEL = {VERTICAL: "vpl", HORIZONTAL: "hpl"}
ALARMS = "alarms"

# Scenarios per tile of a call, and per call, which is always whole: one compilation serves any number.
_TILE, _CALL = 512, 4096
# Logarithm of a ratio of zero: no event, whatever the multiplier.
NO_EVENT = -700.0


@dataclass(frozen=True)
class Draws:
    """Ratios and levels of each draw, for one pair of limits.

    Attributes:
        log_ratio: (f, N), of each fault.
        log_unit_m: (N,), fault-free, VPL for a multiplier of one [m]; infinite where there is an alarm anyway.
        weight: (f, N), of the ratios, so that those of draws in an event add up to its probability; none where all
            draws count alike.
    """

    log_ratio: FloatArray
    log_unit_m: FloatArray
    weight: FloatArray | None = None


@dataclass(frozen=True)
class WeightedNoise:
    """Draws for a risk that is too rare for plain ones, and plain ones for the price.

    Attributes:
        plain: (N, n), whitened noise, for the price.
        noise: (f, M, n), whitened noise from a proposal of each fault.
        weight: (f, M), density of the noise over that of the proposal, over M.
    """

    plain: FloatArray
    noise: FloatArray
    weight: FloatArray


@dataclass(frozen=True)
class TuningProblem:
    """What is tuned at one epoch.

    Attributes:
        design: (n, t) [m/m]; sigma_m: (n,) [m].
        bias_m: (f, n), faults under which the target is kept [m].
        method: the estimate; its limits and its multiplier are of no account.
        target: probability of the event.
        misleading: whether the event is misleading information, else an error beyond the level.
        objective: ``vpl`` (``hpl``) or ``alarms``, both fault-free.
        limit_m: alert limit of the axis [m].
        step: h, width of the logistic steps, in the logarithm of ratio and level.
        axis: whose error, level and limit they are.
    """

    design: FloatArray
    sigma_m: FloatArray
    bias_m: FloatArray
    method: Igg3
    target: float
    misleading: bool
    objective: str
    limit_m: float
    step: float
    axis: str = VERTICAL

    @property
    def level(self) -> str:
        """``vpl``, which columns of its level are called by."""
        return LEVEL[self.axis]

    @functools.cached_property
    def _one_clock_per_row(self) -> bool:
        """What the model is told; a search asks for draws again and again."""
        return has_one_clock_per_row(self.design)

    def draws(self, limits: FloatArray, noise: FloatArray | WeightedNoise) -> Draws:
        """Ratios and levels of whitened noise (N, n), or of weighted draws, with limits (k0, k1)."""
        if isinstance(noise, WeightedNoise):
            each = zip(self.bias_m, noise.noise, strict=True)
            ratio = np.stack([self._logs(limits, bias, own)[0] for bias, own in each])
            return Draws(ratio, self._logs(limits, np.zeros_like(self.sigma_m), noise.plain)[1], noise.weight)
        fault_free = np.flatnonzero(~self.bias_m.any(axis=1))
        biases = self.bias_m if fault_free.size else np.concatenate([self.bias_m, np.zeros((1, len(self.sigma_m)))])
        free = int(fault_free[0]) if fault_free.size else len(self.bias_m)
        found = np.stack([self._logs(limits, bias, noise) for bias in biases], axis=1)
        return Draws(found[0, : len(self.bias_m)], found[1, free])

    def log_ratio(self, limits: FloatArray, fault: int, noise: FloatArray) -> FloatArray:
        """(N,), logarithm of the ratio of whitened noise (N, n) under one of the faults."""
        return self._logs(limits, self.bias_m[fault], noise)[0]

    def _logs(self, limits: FloatArray, bias_m: FloatArray, noise: FloatArray) -> FloatArray:
        """(2, N), of ratio and level."""
        found = np.empty((2, len(noise)))
        limits = np.asarray(limits, dtype=np.float64)
        static = {"axis": self.axis, "one_clock_per_row": self._one_clock_per_row}
        with precision_scope("float64"):
            for begin in range(0, len(noise), _CALL):
                some = noise[begin : begin + _CALL]
                whole = np.zeros((_CALL, noise.shape[1]))
                whole[: len(some)] = some
                scenario = (
                    self.design, self.sigma_m, bias_m, whole, np.float64(self.limit_m),
                    np.bool_(self.misleading),
                )  # fmt: skip
                values = _values(limits, scenario, self.method, **static)
                found[:, begin : begin + len(some)] = np.asarray(values)[:, : len(some)]
        return found

    def smooth(self, limits: FloatArray, noise: FloatArray | WeightedNoise) -> tuple[float, float]:
        """Logarithm of the smoothed objective, and the multiplier."""
        drawn = self.draws(limits, noise)
        log_k = self._binding(drawn)[1]
        finite = np.isfinite(drawn.log_unit_m)
        unit = drawn.log_unit_m[finite]
        if self.objective != ALARMS:
            return log_k + float(unit.max() + np.log(np.exp(unit - unit.max()).mean())), float(np.exp(log_k))
        place = (log_k + unit - np.log(self.limit_m)) / self.step
        rate = (special.expit(place).sum() + (~finite).sum()) / finite.size
        return float(np.log(max(rate, 1e-300))), float(np.exp(log_k))

    def effective(self, limits: FloatArray, noise: FloatArray | WeightedNoise) -> float:
        """Effective number of draws behind the multiplier: (sum s)^2 / sum s^2 of the weighted steepness s of steps."""
        drawn = self.draws(limits, noise)
        worst, log_k = self._binding(drawn)
        place = (drawn.log_ratio[worst] - log_k) / self.step
        steep = special.expit(place) * special.expit(-place)
        if drawn.weight is not None:
            # In units of the largest, lest a square be too small for a double.
            steep = steep * (drawn.weight[worst] / drawn.weight[worst].max())
        return float(steep.sum() ** 2 / max((steep**2).sum(), 1e-300))

    def _binding(self, drawn: Draws) -> tuple[int, float]:
        """The fault with the largest multiplier, and its logarithm."""
        weights = [None] * len(drawn.log_ratio) if drawn.weight is None else list(drawn.weight)
        roots = [self._log_k_factor(row, own) for row, own in zip(drawn.log_ratio, weights, strict=True)]
        worst = int(np.argmax(roots))
        return worst, roots[worst]

    def _log_k_factor(self, log_ratio: FloatArray, weight: FloatArray | None = None) -> float:
        """Where the smoothed share of the draws is the target."""
        from scipy import optimize

        def surplus(log_k: float) -> float:
            above = special.expit((log_ratio - log_k) / self.step)
            share = above.mean() if weight is None else (weight * above).sum()
            return float(np.log(max(share, 1e-300) / self.target))

        # At the target's own quantile half of a step is already above: some widths beyond lies the root.
        if weight is None:
            middle = float(np.quantile(log_ratio, 1.0 - self.target))
        else:
            middle = weighted_quantile(log_ratio, weight, self.target)
        reach = self.step
        while surplus(middle - reach) <= 0.0 and reach < 1e3:
            reach *= 2.0
        far = self.step
        while surplus(middle + far) >= 0.0 and far < 1e3:
            far *= 2.0
        return float(optimize.brentq(surplus, middle - reach, middle + far, xtol=1e-12))


def weighted_quantile(values: FloatArray, weight: FloatArray, target: float) -> float:
    """The value that draws (N,) are above with this probability, by weights that add up to probabilities."""
    order = np.argsort(-values, kind="stable")
    place = int(np.searchsorted(np.cumsum(weight[order]), target))
    return float(values[order[min(place, len(values) - 1)]])


def cost(objective: str, k: float, log_unit_m: FloatArray, limit_m: float) -> FloatArray:
    """(N,), the objective of each draw as it is, not smoothed: its mean is what counts.

    The level [m] where there is a solution, missing elsewhere; or whether it alarms.
    """
    level = k * np.exp(log_unit_m)
    if objective != ALARMS:
        return np.where(np.isfinite(level), level, np.nan)
    return (level > limit_m).astype(float)


@functools.partial(jax.jit, static_argnames=("axis", "one_clock_per_row"))
def _values(limits: Array, scenario: Scenario, method: Igg3, *, axis: str, one_clock_per_row: bool) -> Array:
    """(2, N), logarithms of the ratio and of the level for a multiplier of one."""
    design, sigma_m, bias_m, noise, limit_m, misleading = scenario
    model = linear_model(design, sigma_m, one_clock_per_row=one_clock_per_row)
    numbers: dict[str, Any] = {"k0": limits[0], "k1": limits[1], f"k_{axis}": 1.0}
    limited = replace(method, **numbers)
    prepared = limited.prepare(model)

    def one_tile(tile: Array) -> Array:
        start = start_from(model, tile.T * sigma_m[:, None] + bias_m[:, None])
        outcome = limited.solve(model, prepared, start)
        ratio = ratio_of(outcome, limit_m, misleading, axis)
        event = (ratio > 0) & jnp.isfinite(ratio)
        (level_m,) = levels_of(outcome, axis)
        level = outcome.available & (level_m > 0)
        return jnp.stack(
            [
                jnp.where(event, jnp.log(jnp.where(event, ratio, 1.0)), jnp.where(ratio > 0, -NO_EVENT, NO_EVENT)),
                jnp.where(
                    level, jnp.log(jnp.where(level, level_m, 1.0)), jnp.where(outcome.available, NO_EVENT, jnp.inf)
                ),
            ]
        )

    found = jax.lax.map(one_tile, noise.reshape(-1, _TILE, noise.shape[1]))
    return jnp.moveaxis(found, 1, 0).reshape(2, -1)
