"""Which of many faults needs the largest multiplier at a target: cheap looks first, then curves of the best few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pl_mc.alert import AlertLimits
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.integrity_risk.k_factor.calibrated import SMALLEST_FACTOR, LevelAxis, exact_k_factor, exact_rates
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import RatioState, ratio_state
from pl_mc.integrity_risk.k_factor.from_curve import climb_ratios, mean_curve
from pl_mc.integrity_risk.rare.limit_state import all_axes
from pl_mc.methods import Method
from pl_mc.methods.capabilities import exact_law, require_k

# Draws, the same for every fault, and the quantile of their ratios that orders the faults first.
_DRAWS, _QUANTILE = 4096, 0.995
# How many go on, and the populations of each: of the first few small ones, of the last few whole ones.
_SECOND, _THIRD = 16, 4
_SMALL, _WHOLE = 1024, 4096
_POPULATIONS = (2, 4)


def neediest_fault(
    g: Geometry, faults: Faults, *, method: Method, event: str, alert: AlertLimits, target: float, seed: int,
    axis: LevelAxis = "vertical",
) -> int:  # fmt: skip
    """The fault of those given that needs the largest multiplier, at one epoch with redundancy.

    Exact for a method with an exact law. For others it is the one whose curve, with random numbers of its own, says
    so; what that multiplier is has to be asked afresh, so that the choice of the largest does not bias it.
    Arguments as for `pl_mc.calibrate`.
    """
    require_k(method, axis)
    if exact_law(method) is not None:
        return _neediest_exactly(g, faults, method, event, alert, target, axis)
    states = [ratio_state(g, faults.only(k), method, event, alert, axis) for k in range(len(faults))]
    rng = np.random.default_rng((seed, len(faults)))
    seen = states[0].in_view
    noise = rng.standard_normal((_DRAWS, int(seen.sum())))
    plain = all_axes(seen, 1)
    scores = [float(np.quantile(replace(one, coordinates=plain).ratio(noise), _QUANTILE)) for one in states]
    left = np.argsort(-np.array(scores), kind="stable")[:_SECOND]
    for size, populations, keep in zip((_SMALL, _WHOLE), _POPULATIONS, (_THIRD, 1), strict=True):
        k = [_k_factor(states[one], target, size, populations, np.random.default_rng((seed, size))) for one in left]
        left = left[np.argsort(-np.array(k), kind="stable")[:keep]]
    return int(left[0])


def _k_factor(state: RatioState, target: float, size: int, populations: int, rng: np.random.Generator) -> float:
    """The multiplier of a curve of few populations; zero where none came down to the target."""
    ladders = [climb_ratios(state, rng, target=target, size=size) for _ in range(populations)]
    return float(np.nan_to_num(mean_curve(ladders, target).k_factor(target, 0.5)[0]))


def _neediest_exactly(
    g: Geometry, faults: Faults, method: Method, event: str, alert: AlertLimits, target: float, axis: LevelAxis
) -> int:
    """The fault with the largest risk at a multiplier that keeps the target under every other one."""
    k, best = SMALLEST_FACTOR, 0
    while True:
        rates = exact_rates(g, faults, method, alert, max(k, SMALLEST_FACTOR), axis, event)
        worst = int(rates.argmax())
        if rates[worst] <= target * (1.0 + 1e-6):
            return best
        best = worst
        found, _ = exact_k_factor(g.as_series(), faults.only(worst), method, event, alert, target, axis)
        k = found.k
