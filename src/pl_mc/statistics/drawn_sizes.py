"""Exact rates under a fault whose size is drawn: the mean over its distribution, by a rule that sees all their steps.

Rates change with a size over about one standard deviation of what it moves, be it an error or the root of V'PV. The
rule has panels of a few of those, so that its error is that of the rates themselves; every term is positive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import special

from pl_mc.arrays import FloatArray
from pl_mc.faults import Faults
from pl_mc.faults.bias import FIXED, UNIFORM, Bias
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError

# Points of a panel, and its width in standard deviations of the pseudoranges that the size moves together.
_POINTS, _WIDTH = 12, 4.0
# A normal size is within so many of its own ones.
_REACH = 8.5
# Beyond so many panels the size is not worth an exact law.
_MOST_PANELS = 4096


def mean_over_sizes(
    g: Geometry, faults: Faults, rates_of: Callable[[Faults], pd.DataFrame], columns: Sequence[str]
) -> pd.DataFrame:
    """The table of faults of which some are drawn, of a function that makes it of those that are not.

    Raises:
        InputError: a fault with several sizes or signs that are drawn independently of each other.
    """
    parts: list[Faults] = []
    weights: list[FloatArray] = []
    for k in range(len(faults)):
        one = faults.only(k)
        if one.drawn[0]:
            one, weight = _with_sizes(g, one)
        else:
            weight = np.ones(1)
        parts.append(one)
        weights.append(weight)
    sized = Faults.joined(parts)
    count = [len(one) for one in parts]
    # Labels say which fault and which of its sizes a row is of.
    names = [f"{k} {j}" for k, size in enumerate(count) for j in range(size)]
    table = rates_of(replace(sized, labels=tuple(names)))
    owner = table["fault"].str.split(" ").str[0].astype(int).to_numpy()
    of_name = dict(zip(names, np.concatenate(weights), strict=True))
    table[list(columns)] = table[list(columns)].mul(table["fault"].map(of_name), axis=0)
    table["fault"], table["bias_m"] = owner, faults.scalar_bias_m[owner]
    grouped = table.groupby(["epoch", "fault"], sort=False, as_index=False)
    mean = grouped.agg({"bias_m": "first", **dict.fromkeys(columns, "sum")})
    mean["fault"] = np.array(faults.labels, dtype=object)[mean["fault"]]
    mean[list(columns)] = mean[list(columns)].clip(upper=1.0)
    return mean


def _with_sizes(g: Geometry, fault: Faults) -> tuple[Faults, FloatArray]:
    """A fault with each size of the rule in the place of the one that is drawn, and the weights."""
    biases = fault.shaped[0]
    drawn = [place for place, (bias, _) in enumerate(biases) if bias.drawn]
    place = drawn[0]
    bias, first_s = biases[place]
    several = bias.independent and int(bias.members(g).sum()) > 1
    if len(drawn) > 1 or several:
        raise InputError(
            f"faults: {fault.labels[0]} draws several sizes or signs independently of each other, over which no exact "
            "rates are known here; give it one for all (without independent), or use pl_mc.sweep."
        )
    sizes, weights = _rule(bias, _units(g, bias, first_s))
    made = [Faults(fault.bias_m, fault.names, fault.labels, {0: _replaced(biases, place, size)}) for size in sizes]
    return Faults.joined(made), weights


def _replaced(biases: tuple[tuple[Bias, float], ...], place: int, size: float) -> tuple[tuple[Bias, float], ...]:
    """The biases with a fixed size in one place; a ramp keeps its own."""
    bias, first_s = biases[place]
    # A size of zero is no bias; the smallest there is does as well.
    held = size if round(size, 9) else 1e-9
    fixed = replace(bias, law=FIXED, numbers=(held,), either_sign=False, independent=False)
    return (*biases[:place], (fixed, first_s), *biases[place + 1 :])


def _units(g: Geometry, bias: Bias, first_s: float) -> float:
    """How many standard deviations of pseudoranges a unit of the size moves together, at most over the epochs."""
    series = g.as_series()
    rows = bias.rows(series)
    spread = np.sqrt(np.where(rows, 1.0 / np.asarray(series.sigma_m) ** 2, 0.0).sum(axis=1))
    scale = series.time_gps_s - first_s if bias.per_second else np.ones(len(series))
    return float((spread * np.abs(scale)).max())


def _rule(bias: Bias, units: float) -> tuple[FloatArray, FloatArray]:
    """Sizes and weights with sum one."""
    first, last = bias.numbers[0], bias.numbers[-1]
    if bias.law == FIXED:
        sizes, weights = np.array([first]), np.ones(1)
    else:
        low, high = (first, last) if bias.law == UNIFORM else (first - _REACH * last, first + _REACH * last)
        own = 0.0 if bias.law == UNIFORM else 1.0 / last
        panels = int(np.ceil((high - low) * max(units, own) / _WIDTH)) + 1
        if panels > _MOST_PANELS:
            raise InputError(
                f"faults: {bias} reaches over {(high - low) * units:.3g} standard deviations, too far for exact rates; "
                "use pl_mc.sweep."
            )
        points, share = special.roots_legendre(_POINTS)
        starts = np.linspace(low, high, panels + 1)[:-1, None]
        sizes = (starts + (points + 1.0) / 2.0 * (high - low) / panels).reshape(-1)
        weights = np.tile(share / (2.0 * panels), panels)
        if bias.law != UNIFORM:
            weights = weights * np.exp(-0.5 * ((sizes - first) / last) ** 2)
        weights = weights / weights.sum()
    if bias.either_sign:
        sizes, weights = np.concatenate([sizes, -sizes]), np.concatenate([weights, weights]) / 2.0
    return sizes, weights
