"""Tables 1 and 2 of Zhao et al. (2021) beside ours: 95 % quantiles and RMS, and why the two differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.report.text import markdown_table, metres

DIRECTIONS = ("E", "N", "U")
STATISTICS = ("95%", "rms")
# Columns for the values of `accuracy_m`, direction by direction.
ACCURACY_COLUMNS = ["east_95_m", "east_rms_m", "north_95_m", "north_rms_m", "up_95_m", "up_rms_m"]
_COLUMNS = ["east_m", "north_m", "up_m"]


@dataclass(frozen=True)
class PaperSeries:
    """One of the paper's two experiments.

    Attributes:
        table: number of its table.
        before_m, after_m: (3, 2), values by `DIRECTIONS` and `STATISTICS`, least squares and robust [m].
        figures: numbers of its figures: satellites, errors before, errors after, protection levels.
    """

    table: int
    before_m: tuple[tuple[float, float], ...]
    after_m: tuple[tuple[float, float], ...]
    figures: tuple[int, int, int, int]


# Zhao, Yang, Xu, Jing and Ma (2021), doi 10.13203/j.whugis20190043, tables 1 and 2, as printed.
PAPER: Mapping[str, PaperSeries] = MappingProxyType(
    {
        "static": PaperSeries(
            table=1,
            before_m=((2.570, 1.151), (7.763, 2.779), (10.110, 4.851)),
            after_m=((0.956, 0.471), (1.495, 0.800), (3.051, 1.767)),
            figures=(1, 3, 4, 5),
        ),
        "dynamic": PaperSeries(
            table=2,
            before_m=((1.709, 8.554), (2.157, 6.449), (20.712, 4.890)),
            after_m=((1.625, 1.389), (0.875, 0.991), (2.792, 1.998)),
            figures=(2, 7, 8, 9),
        ),
    }
)


def accuracy_m(solved: pd.DataFrame, method: str) -> NDArray[np.float64]:
    """(3, 2), a method's 95 % quantile of the absolute error and RMS in east, north, up over available epochs [m].

    The quantile is the empirical one, interpolated linearly between order statistics.

    Args:
        solved: ``method, available, east_m, north_m, up_m``, one row per epoch and method.
        method: its name.
    """
    known = solved.loc[(solved.method == method) & solved.available, _COLUMNS].to_numpy()
    if len(known) == 0:
        return np.full((3, 2), np.nan)
    return np.stack([np.quantile(np.abs(known), 0.95, axis=0), np.sqrt((known**2).mean(axis=0))], axis=-1)


def paper_table(paper: PaperSeries, before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Ours beside the paper's.

    Args:
        paper: the paper's table.
        before, after: `ACCURACY_COLUMNS` of least squares and of the robust method, one row per draw; the first
            row is the run itself.

    Returns:
        Six rows: ``direction, statistic, before_m, after_m, paper_before_m, paper_after_m``, and the smallest and
        largest value over all draws, ``before_low_m, before_high_m, after_low_m, after_high_m``.
    """
    columns: dict[str, object] = {
        "direction": np.repeat(DIRECTIONS, len(STATISTICS)),
        "statistic": np.tile(STATISTICS, len(DIRECTIONS)),
    }
    ours = {"before": before[ACCURACY_COLUMNS].to_numpy(), "after": after[ACCURACY_COLUMNS].to_numpy()}
    columns |= {f"{name}_m": values[0] for name, values in ours.items()}
    columns |= {"paper_before_m": np.ravel(paper.before_m), "paper_after_m": np.ravel(paper.after_m)}
    for name, values in ours.items():
        columns |= {f"{name}_low_m": values.min(axis=0), f"{name}_high_m": values.max(axis=0)}
    return pd.DataFrame(columns)


def paper_table_text(table: pd.DataFrame, *, drawn: str, why_before: str, why_after: str) -> str:
    """The table in Markdown, with what each difference from the paper comes from.

    Args:
        table: from `paper_table`.
        drawn: what differs from redraw to redraw.
        why_before, why_after: what makes the values of least squares and of the robust method differ where redraws
            do not reach the paper's.
    """
    rows = []
    for row in table.to_dict("records"):
        cells = [row["direction"], statistic_label(row["statistic"])]
        reasons = []
        for name, why in (("before", why_before), ("after", why_after)):
            low_m, high_m, paper_m = row[f"{name}_low_m"], row[f"{name}_high_m"], row[f"paper_{name}_m"]
            cells += [metres(row[f"{name}_m"]), f"{metres(low_m)} to {metres(high_m)}", metres(paper_m)]
            reasons.append(f"{name}: {_reason(paper_m, low_m, high_m, drawn, why)}")
        rows.append([*cells, "; ".join(reasons)])
    header = [
        "", "", "before: ours", "with redraws", "before: paper", "after: ours", "with redraws", "after: paper",
        "why they differ",
    ]  # fmt: skip
    return markdown_table(header, rows)


def statistic_label(statistic: str) -> str:
    """A statistic as tables for readers print it."""
    return {"95%": "95 %", "rms": "RMS"}[statistic]


def oddities(paper: PaperSeries, table: pd.DataFrame, faulted_share: float) -> list[str]:
    """Sentences on 95 % quantiles below their RMS, in the paper and in ours.

    Args:
        paper: the paper's experiment.
        table: from `paper_table`.
        faulted_share: share of our epochs that are faulted.
    """
    values = table.set_index(["direction", "statistic"])
    found = []
    for label, prefix in (("the paper's", "paper_"), ("our", "")):
        places = [
            f"{direction} {name}"
            for name in ("before", "after")
            for direction in DIRECTIONS
            if values.loc[(direction, "95%"), f"{prefix}{name}_m"]
            < values.loc[(direction, "rms"), f"{prefix}{name}_m"]
        ]
        if places:
            found.append(f"In {label} values the 95 % quantile lies below the RMS for {', '.join(places)}.")
    if found:
        found.append(
            "That takes very large errors at a few epochs, about one in twenty, which the quantile hardly sees; "
            f"{100 * faulted_share:.2f} % of our epochs are faulted."
        )
    if paper.table == 2:
        found.append(
            "The paper's RMS before of E and U may be exchanged (a guess); they are printed as they stand."
        )
    return found


def _reason(paper_m: float, low_m: float, high_m: float, drawn: str, why: str) -> str:
    if low_m <= paper_m <= high_m:
        return f"the paper is within the redraws of {drawn}"
    side = "below" if paper_m < low_m else "above"
    return f"the paper is {side} all redraws: {why}"
