"""The multiplier by a search, where an estimator of the caller's own gives the probability at one at a time.

Each trial costs an estimate. Methods of the package need no such search: one curve serves every multiplier
(`pl_mc.integrity_risk.k_factor.exceedance_curve`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy import stats

from pl_mc.arrays import FloatArray
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.k_factor.record import LARGEST_FACTOR, RARE, SMALLEST_FACTOR, Found

# Multipliers that may be tried, and how close to the target the search has to come.
_MOST_TRIALS, _MOST_STEPS = 12, 12
_STRIDE, _CLOSE, _TOLERANCE = 1.25, 1.02, 1e-4
# The ratios from whose tail the search starts.
_TAIL = 200


def bounds_of(row: pd.Series, confidence: float) -> tuple[float, float, float]:
    """An estimated probability with bounds that each have the confidence, its logarithm being about normal.

    Where the estimator takes its number back, the middle of its interval, and its ends; where nothing reached the
    event, zero, with the bound that it gives.
    """
    value, error = float(row["probability"]), float(row["standard_error"])
    if value > 0:
        # An exponential beyond 700 is more than a double holds.
        reach = min(float(stats.norm.ppf(confidence)) * error / value, 700.0)
        return value, value * math.exp(-reach), min(value * math.exp(reach), 1.0)
    low = float(row["low"]) if np.isfinite(row["low"]) else 0.0
    high = float(row["high"]) if np.isfinite(row["high"]) else 1.0
    return math.sqrt(low * high), low, high


def first_guess(ratio: FloatArray, target: float) -> float:
    """A multiplier near the one that is looked for: the tail of the drawn ratios, continued as a power law."""
    known = np.sort(ratio[np.isfinite(ratio) & (ratio > 0)])[::-1]
    if known.size < _TAIL:
        return float(known[0]) if known.size else 1.0
    far, near = known[_TAIL // 10 - 1], known[_TAIL - 1]
    steep = math.log(far / near) / math.log(10.0)
    decades = math.log(_TAIL / 10 / ratio.size / target)
    # A power law overstates a lighter tail: half of its way is a start from which either side is near.
    return float(far * math.exp(0.5 * steep * max(decades, 0.0)))


def searched(trial: Callable[[float], tuple[float, float, float, str]], first: float, target: float) -> Found:
    """The multiplier by estimates: bracket the target, narrow the bracket, then step to where the bounds clear it.

    Args:
        trial: from a multiplier to the event's probability, its bounds, each at the confidence, and a warning.
        first: where to begin.
        target: the probability that is wanted.
    """
    seen: dict[float, tuple[float, float, float, str]] = {}

    def surplus(k: float) -> float:
        if k not in seen:
            seen[k] = trial(k)
        return math.log(max(seen[k][0], 1e-300) / target)

    low = high = min(max(first, SMALLEST_FACTOR), LARGEST_FACTOR)
    while surplus(high) > 0:
        low, high = high, high * _STRIDE
        if high > LARGEST_FACTOR:
            raise InputError(f"target: no multiplier below {LARGEST_FACTOR:g} brings the risk down to {target:g}.")
    while surplus(low) <= 0:
        low, high = low / _STRIDE, low
        if low < SMALLEST_FACTOR:
            value, lower, upper, warning = seen[high]
            return Found(0.0, 0.0, 0.0, value, lower, upper, RARE, 0, warning)
    k = high
    for _ in range(_MOST_TRIALS):
        if high / low < 1.0 + _TOLERANCE:
            break
        # On logarithms a tail bends downwards, so that its chord lies below it; half-way where an end has no
        # events.
        above, below = surplus(low), surplus(high)
        share = above / (above - below) if below > -50.0 else 0.5
        k = low * (high / low) ** min(max(share, 0.05), 0.95)
        if abs(surplus(k)) < math.log(_CLOSE):
            break
        low, high = (k, high) if surplus(k) > 0 else (low, k)
    steep = max((surplus(low) - surplus(high)) / math.log(high / low), 1.0) if high > low else 1.0
    bounds, warnings = [], [seen[k][3]]
    for side, clears in ((1.0, lambda row: row[2] <= target), (-1.0, lambda row: row[1] >= target)):
        bound = k
        for _ in range(_MOST_STEPS):
            surplus(bound)
            value, lower, upper, _ = seen[bound]
            if clears(seen[bound]):
                break
            gap = math.log(upper / target) if side > 0 else math.log(target / max(lower, 0.1 * value, 1e-300))
            bound *= math.exp(side * min(1.1 * max(gap, 1e-3) / steep, 5.0))
        if bound not in seen or not clears(seen[bound]):
            warnings.append(f"no {'upper' if side > 0 else 'lower'} bound was reached")
            bound = math.inf if side > 0 else 0.0
        bounds.append(bound)
    k_high, k_low = bounds
    reached = seen[k_high] if math.isfinite(k_high) else seen[max(seen)]
    warnings.append(reached[3])
    note = "; ".join(dict.fromkeys(filter(None, warnings)))
    return Found(k, k_low, k_high, reached[0], reached[1], reached[2], RARE, 0, note)
