"""Epochs counted by the regions of Stanford diagrams, for every axis that has a limit."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits, Judged
from pl_mc.engine.stanford import REGIONS
from pl_mc.studies.observe.claims import bounded, independent_epochs

_REJECTED, _NO_SOLUTION = 5, 6


def stanford_table(table: pd.DataFrame, alert: AlertLimits) -> pd.DataFrame:
    """One row per method, axis and region: ``count, epochs, independent, rate, low, high`` (95 %).

    Args:
        table: that of the epochs, with ``rejected``.
        alert: the limits.
    """
    rows = []
    for axis in alert.limit_m:
        judged = Judged(alert, axis)
        for method, part in table.groupby("method", sort=False):
            if not part[f"{judged.levels[0][0]}_m"].notna().any():
                continue
            independent = independent_epochs(part, judged)
            counts = np.bincount(regions_of(part, judged), minlength=len(REGIONS))
            rows += [
                {
                    "method": method, "axis": axis, "region": region, "count": count, "epochs": len(part),
                    "independent": independent, **bounded(count, len(part), independent, ""),
                }
                for region, count in zip(REGIONS, counts.tolist(), strict=True)
            ]  # fmt: skip
    return pd.DataFrame(rows).rename(columns=lambda name: name.removeprefix("_"))


def sizes_m(table: pd.DataFrame, judged: Judged) -> list[pd.Series]:
    """Sizes of the errors that are judged, one by one [m]."""
    size_m = {"vpl": table.up_m.abs(), "hpl": np.hypot(table.east_m, table.north_m)}
    return [size_m[pl] for pl, _, _ in judged.levels]


def regions_of(part: pd.DataFrame, judged: Judged) -> NDArray[np.int64]:
    """(k,), place in `REGIONS` of each row, by one axis; see `pl_mc.engine.stanford`."""
    ((pl, _, limit_m),), (size_m,) = judged.levels, sizes_m(part, judged)
    level_m = part[f"{pl}_m"]
    beyond = size_m > level_m
    region = np.where(level_m > limit_m, np.where(beyond, 4, 3), np.where(beyond, np.where(size_m > limit_m, 2, 1), 0))
    region = np.where(part.rejected, _REJECTED, region)
    return np.where(part.available & level_m.notna(), region, _NO_SOLUTION)
