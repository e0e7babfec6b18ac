"""Accuracy of positions as papers print it, and errors beyond levels and limits, of tables of solutions."""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import Judged

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


def sizes_m(solved: pd.DataFrame, judged: Judged) -> list[pd.Series]:
    """Sizes of the errors that are judged, one by one [m]; ``solved`` has ``east_m, north_m, up_m``."""
    size_m = {"vpl": solved.up_m.abs(), "hpl": np.hypot(solved.east_m, solved.north_m)}
    return [size_m[pl] for pl, _, _ in judged.levels]


def beyond_level(solved: pd.DataFrame, judged: Judged) -> pd.Series:
    """Whether an error is beyond its level; of what is not available it is not."""
    levels = [solved[f"{pl}_m"] for pl, _, _ in judged.levels]
    return _any(size_m > level for size_m, level in zip(sizes_m(solved, judged), levels, strict=True))


def beyond_limit(solved: pd.DataFrame, judged: Judged) -> pd.Series:
    """Whether an error is beyond its alert limit."""
    limits = [limit for _, _, limit in judged.levels]
    return _any(size_m > limit for size_m, limit in zip(sizes_m(solved, judged), limits, strict=True))


def beyond_words(judged: Judged) -> tuple[str, str]:
    """``U beyond VPL`` and ``U beyond VAL``; the horizontal error is ``H``."""
    letters = [name[0].replace("V", "U") for _, name, _ in judged.levels]
    level, limit = (
        " or ".join(f"{letter} beyond {words}" for letter, words in zip(letters, names, strict=True))
        for names in ([one.level for one in judged.called], [one.limit for one in judged.called])
    )
    return level, limit


def _any(flags: Iterable[pd.Series]) -> pd.Series:
    return functools.reduce(operator.or_, flags)
