"""Orders of methods: mean rates over a ramp with bounds, and pairs whose order holds from geometry to geometry."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from pl_mc.statistics.intervals import shared_noise_bounds


def mean_rates(rates: pd.DataFrame, events: Iterable[str]) -> pd.DataFrame:
    """A row per geometry, method and event: its rate averaged over the biases of the ramp, with 95 % bounds.

    All biases of a geometry and all methods see the same noise, so that the draws behind a mean are those of one
    bias (`pl_mc.statistics.intervals.shared_noise_bounds`); epochs of a sample have noise of their own.

    Args:
        rates: of sweeps, with a column ``geometry``.
    """
    faulted = rates[rates.fault != "none"]
    grouped = faulted.groupby(["geometry", "method"], sort=False)
    draws = grouped.draws.min()
    parts = []
    for event in events:
        rate = grouped[f"{event}_rate"].mean()
        low, high = shared_noise_bounds(rate.to_numpy(), draws.to_numpy())
        part = rate.rename("rate").to_frame().assign(low=low, high=high, draws=draws, event=event).reset_index()
        part["rank"] = part.groupby("geometry", sort=False)["rate"].rank(method="average")
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def orders(means: pd.DataFrame, event: str, first: str, second: str) -> tuple[list[tuple[str, str]], ...]:
    """Pairs of methods that are told apart in both of two geometries: in the same order, and turned.

    Told apart: their bounds do not overlap. The noise that methods share makes their difference smaller than that
    of independent draws, so fewer pairs are told apart than could be. Pairs have the smaller rate of ``first`` in
    front.
    """
    bounds = {
        name: means[(means.event == event) & (means.geometry == name)].set_index("method")[["low", "high"]]
        for name in (first, second)
    }
    methods = [name for name in bounds[first].index if name in bounds[second].index]
    same, turned = [], []
    for a in methods:
        for b in methods:
            if bounds[first].high[a] >= bounds[first].low[b]:
                continue
            if bounds[second].high[a] < bounds[second].low[b]:
                same.append((a, b))
            elif bounds[second].high[b] < bounds[second].low[a]:
                turned.append((a, b))
    return same, turned
