"""Tables 1 and 2 of Zhao et al. (2021) beside ours: 95 % quantiles and RMS of the errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pl_mc.report.accuracy import DIRECTIONS

STATISTICS = ("95%", "rms")
# Columns for the values of `pl_mc.report.accuracy.accuracy_m`, direction by direction.
ACCURACY_COLUMNS = ["east_95_m", "east_rms_m", "north_95_m", "north_rms_m", "up_95_m", "up_rms_m"]


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
PAPER: Mapping[str, PaperSeries] = {
    "static": PaperSeries(
        table=1, before_m=((2.570, 1.151), (7.763, 2.779), (10.110, 4.851)),
        after_m=((0.956, 0.471), (1.495, 0.800), (3.051, 1.767)), figures=(1, 3, 4, 5),
    ),
    "dynamic": PaperSeries(
        table=2, before_m=((1.709, 8.554), (2.157, 6.449), (20.712, 4.890)),
        after_m=((1.625, 1.389), (0.875, 0.991), (2.792, 1.998)), figures=(2, 7, 8, 9),
    ),
}  # fmt: skip


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


def oddities(paper: PaperSeries, table: pd.DataFrame, faulted_share: float) -> list[str]:
    """Sentences on 95 % quantiles below their RMS, in the paper and in ours.

    Args:
        paper: the paper's experiment.
        table: from `paper_table`.
        faulted_share: share of our epochs that are faulted.
    """
    values = table.set_index(["statistic", "direction"])
    sentences = []
    for whose, prefix in (("the paper's", "paper_"), ("our", "")):
        places = []
        for name in ("before", "after"):
            column = values[f"{prefix}{name}_m"]
            places += [f"{place} {name}" for place in DIRECTIONS if column["95%", place] < column["rms", place]]
        if places:
            sentences.append(f"In {whose} values the 95 % quantile lies below the RMS for {', '.join(places)}.")
    if sentences:
        sentences.append(
            "That takes very large errors at a few epochs, about one in twenty, which the quantile hardly sees; "
            f"{100 * faulted_share:.2f} % of our epochs are faulted."
        )
    if paper.table == 2:
        sentences.append(
            "The paper's RMS before of E and U may be exchanged (a guess); they are printed as they stand."
        )
    return sentences
