"""Accuracy of positions as papers print it: 95 % quantile and RMS of the error, direction by direction."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

DIRECTIONS = ("E", "N", "U")
# Columns of a table of solutions, in that order.
ERRORS = ["east_m", "north_m", "up_m"]


def accuracy_m(solved: pd.DataFrame, method: str) -> NDArray[np.float64]:
    """(3, 2), a method's 95 % quantile of the absolute error and RMS in east, north, up over available epochs [m].

    The quantile is the empirical one, interpolated linearly between order statistics.

    Args:
        solved: ``method, available, east_m, north_m, up_m``, one row per epoch and method.
        method: its name.
    """
    known = solved.loc[(solved.method == method) & solved.available, ERRORS].to_numpy()
    if len(known) == 0:
        return np.full((3, 2), np.nan)
    return np.stack([np.quantile(np.abs(known), 0.95, axis=0), np.sqrt((known**2).mean(axis=0))], axis=-1)
