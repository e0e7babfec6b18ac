"""The readings of the paper side by side, in words and one table."""

from __future__ import annotations

import pandas as pd

from pl_mc.report.text import markdown_table, metres, percent
from pl_mc.studies.series.zhao2021 import PaperSeries


def readings_summary(title: str, distances: pd.DataFrame, paper: PaperSeries, redraws: int) -> str:
    """One screen: each reading's distance from the paper's table, and what it does to alarms.

    Args:
        title: heading.
        distances: from `pl_mc.studies.readings.run.distance_table`.
        paper: the paper's table.
        redraws: further draws behind every row.
    """
    rows = [
        [
            row["varies"],
            row["reading"],
            _factor(row, "before"),
            _factor(row, "after"),
            f"{metres(row['before_up_95_m'])} -> {metres(row['after_up_95_m'])}",
            f"{metres(row['before_up_rms_m'])} -> {metres(row['after_up_rms_m'])}",
            f"{percent(row['before_alarm_rate'])} -> {percent(row['after_alarm_rate'])}",
            percent(row["after_unavailable_rate"]),
            f"{metres(row['before_median_clean_vpl_m'])} -> {metres(row['after_median_clean_vpl_m'])}",
        ]
        for row in distances.to_dict("records")
    ]
    (before, after) = (paper.before_m[2], paper.after_m[2])
    rows.append(
        [
            "", f"Zhao et al. 2021, table {paper.table}", "1", "1", f"{metres(before[0])} -> {metres(after[0])}",
            f"{metres(before[1])} -> {metres(after[1])}", "-", "-", "-",
        ]
    )  # fmt: skip
    header = ["question", "reading", "factor, before", "factor, after", "U 95 % [m]", "U RMS [m]",
              "alarms in windows [%]", "no solution, robust [%]", "median VPL, no fault [m]"]  # fmt: skip
    nearest = distances.loc[distances.after_factor.idxmin()]
    lines = [
        f"# {title}",
        "",
        f"Each reading changes one thing of the base (first row). {redraws + 1} draws of satellites, sizes and "
        "noise; medians, with the smallest and largest in brackets. Before: least squares; after: IGG-III. The "
        f"factor, exp(rms ln(ours / paper)), is the typical one between our six values and the paper's column of "
        f"table {paper.table}; 1 would be every value met.",
        "",
        markdown_table(header, rows),
        "",
        f"Nearest after: {nearest['reading']} ({nearest['after_factor']:.2f}). What n is in n - t touches "
        "protection levels alone, so the paper's table of errors cannot tell those readings apart.",
    ]
    return "\n".join(lines) + "\n"


def _factor(row: dict, role: str) -> str:
    return f"{row[f'{role}_factor']:.2f} ({row[f'{role}_factor_low']:.2f}-{row[f'{role}_factor_high']:.2f})"
