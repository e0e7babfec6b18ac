"""What a series with faults in windows says: one screen, the paper's table beside ours, an answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pl_mc.report.document import Block, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.markdown import to_markdown
from pl_mc.report.text import counted_rate, metres, percent, share_of, share_text
from pl_mc.studies.series.window_faults import DrawnFaults
from pl_mc.studies.series.zhao2021 import PAPER
from pl_mc.studies.sources import ReceiverSource

if TYPE_CHECKING:
    from pl_mc.studies.series.run import SeriesExperiment

# Two levels that agree to this ratio came from the same weights.
SAME_RATIO = 1e-6

_STATISTIC = {"95%": "95 %", "rms": "RMS"}

# Why redraws do not reach the paper's values: of least squares, of the robust method.
_WHY = {
    "site": (
        "nominal instead of the day's real satellites, and a range of sizes that the paper does not print",
        "noise drawn from eq 3 with our ionosphere and troposphere, white and without the station's own errors",
    ),
    "flight": (
        "a made-up flight and nominal satellites, and a range of sizes that the paper does not print",
        "noise drawn from eq 3 with our ionosphere and troposphere, on a made-up flight; the paper's truth is "
        "itself a PPP solution",
    ),
    "receiver": (
        "another receiver, place and day, and a range of sizes that the paper does not print",
        "another receiver, place and day, with its own ionosphere, multipath and truth",
    ),
}


def short_label(method: str) -> str:
    """A method's name without that of its level."""
    return method_label(method).split(" (")[0]


def comparison(
    experiment: SeriesExperiment, compared: pd.DataFrame, redraws: pd.DataFrame, remarks: Sequence[str]
) -> str:
    """The table beside the paper's, with ranges and what differences come from, in Markdown.

    Args:
        experiment: what was run.
        compared: from `pl_mc.studies.series.zhao2021.paper_table`.
        redraws: from `pl_mc.studies.series.run.draw_rows`, of all draws.
        remarks: from `pl_mc.studies.series.zhao2021.oddities`.
    """
    drawn = _drawn(experiment)
    rows = []
    for row in compared.to_dict("records"):
        cells = [row["direction"], _STATISTIC[row["statistic"]]]
        reasons = []
        for name, why in zip(("before", "after"), _WHY[experiment.source.kind], strict=True):
            low_m, high_m, paper_m = row[f"{name}_low_m"], row[f"{name}_high_m"], row[f"paper_{name}_m"]
            cells += [metres(row[f"{name}_m"]), f"{metres(low_m)} to {metres(high_m)}", metres(paper_m)]
            if low_m <= paper_m <= high_m:
                reasons.append(f"{name}: the paper is within the redraws of {drawn}")
            else:
                side = "below" if paper_m < low_m else "above"
                reasons.append(f"{name}: the paper is {side} all redraws: {why}")
        rows.append([*cells, "; ".join(reasons)])
    header = [
        "", "", "before: ours", "with redraws", "before: paper", "after: ours", "with redraws", "after: paper",
        "why they differ",
    ]  # fmt: skip
    ranges = (
        f"{_key(experiment)} 95 %: empirical quantile of the absolute error. The ranges are those of "
        f"{redraws.redraw.nunique()} draws of {drawn}, this one included."
    )
    blocks: list[Block] = [TextTable.of(header, rows), *(Paragraph(text) for text in (ranges, *remarks))]
    return to_markdown(f"{experiment.title}: table {PAPER[experiment.compare].table}, errors in m", blocks)


def summary(
    experiment: SeriesExperiment, table: pd.DataFrame, faults: DrawnFaults, compared: pd.DataFrame,
    redraws: pd.DataFrame, remarks: Sequence[str],
) -> tuple[Block, ...]:  # fmt: skip
    """The blocks of the summary.

    Args:
        experiment, compared, redraws, remarks: as for `comparison`.
        table: ``epoch, time, method, satellites, up_m, vpl_m, available, alarm, faulted`` of the first draw.
        faults: of that draw.
    """
    alert, source = experiment.alert_limits(), experiment.source.describe()
    number, count = PAPER[experiment.compare].table, table.drop_duplicates("epoch").satellites
    windows = zip(experiment.faults.windows, faults.chosen, strict=True)
    chosen = "; ".join(f"{first}-{last}: {' and '.join(names)}" for (first, last), names in windows)
    independent = (
        "they take epochs as independent, but a receiver's errors are correlated over minutes"
        if isinstance(experiment.source, ReceiverSource)
        else "simulated epochs are independent but share their satellites"
    )
    rows = [
        [row.direction, _STATISTIC[row.statistic],
         *map(metres, (row.before_m, row.paper_before_m, row.after_m, row.paper_after_m))]
        for row in compared.itertuples()
    ]  # fmt: skip
    return (
        Paragraph(
            f"{source[:1].upper()}{source[1:]}. {count.min()}-{count.max()} satellites (mean {count.mean():.1f}). "
            f"Faults: {experiment.faults.describe()}; drawn with seed {experiment.seed}: {chosen}. {alert.name}, "
            f"VAL {metres(alert.vertical_m)} m."
        ),
        _alarms(table, alert.vertical_m),
        Paragraph(f"Alarm: VPL > VAL, or no solution. Bounds: 95 % Clopper-Pearson; {independent}."),
        Paragraph(
            f"Faulted epochs over {redraws.redraw.nunique()} draws of {_drawn(experiment)} (`redraws.csv`): "
            f"{_redraws(redraws)}."
        ),
        Paragraph(_fault_free(table)),
        Paragraph(
            f"Table {number} of Zhao et al. (2021) beside ours, errors in m (ranges and reasons: "
            f"`table{number}.md`):"
        ),
        TextTable.of(["", "", "before: ours", "paper", "after: ours", "paper"], rows),
        Paragraph(" ".join([_key(experiment), *remarks])),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: SeriesExperiment) -> tuple[str, ...]:
    """Alarms and integrity under the faults, accuracy, and how much a draw matters."""
    redraws, paper = tables["redraws"], tables[f"table{PAPER[experiment.compare].table}"]
    alarms, missed, accuracy = [], [], []
    for row in redraws[redraws.redraw == 0].itertuples():
        label = method_label(row.method)
        alarms.append(f"{label} in {share_of(row.alarms, row.faulted_epochs)}")
        missed.append(f"{label} {share_of(row.unalerted, row.faulted_epochs)}")
        accuracy.append(f"{label} {metres(row.up_rms_m)} m rms, {metres(row.up_95_m)} m 95 %")
    up = paper[(paper.direction == "U") & (paper.statistic == "rms")].iloc[0]
    spread = "; ".join(
        f"{method_label(str(name))} {metres(group.up_rms_m.min())} to {metres(group.up_rms_m.max())} m"
        for name, group in redraws.groupby("method", sort=False)
    )
    draws = redraws.redraw.nunique()
    return (
        f"Alarms under the injected faults: {'; '.join(alarms)} epochs; vertical error beyond the alert limit "
        f"without alarm: {'; '.join(missed)}.",
        f"Vertical errors over all epochs: {'; '.join(accuracy)} (the paper: {metres(up.paper_before_m)} and "
        f"{metres(up.paper_after_m)} m rms).",
        f"Over {draws} draws of satellites, sizes and noise the vertical error ranges from (rms) {spread}."
        if draws > 1
        else "One draw of satellites, sizes and noise was made, so that its chance is in every number.",
    )


def _key(experiment: SeriesExperiment) -> str:
    plain, robust = (short_label(method.name) for method in experiment.method_records())
    return f"Before: {plain}; after: {robust}."


def _drawn(experiment: SeriesExperiment) -> str:
    """What differs from draw to draw; a receiver has its own noise."""
    real = isinstance(experiment.source, ReceiverSource)
    return "satellites and sizes" if real else "satellites, sizes and noise"


def _alarms(table: pd.DataFrame, val_m: float) -> TextTable:
    rows = []
    for faulted, where in ((True, "in windows"), (False, "outside")):
        for method, group in table[table.faulted == faulted].groupby("method", sort=False):
            beyond = group.available & (group.up_m.abs() > group.vpl_m)
            unalerted = (group.up_m.abs() > val_m) & ~group.alarm
            shares = map(share_text, (group.alarm, beyond, unalerted))
            cells = [where, short_label(str(method)), len(group), (~group.available).sum(), *shares]
            rows.append([*cells, metres(group.vpl_m.median()), metres(group.vpl_m.max())])
    header = [
        "epochs", "method", "number", "unavailable", "alarms", "U beyond VPL", "U beyond VAL, no alarm",
        "median VPL [m]", "largest VPL [m]",
    ]  # fmt: skip
    return TextTable.of(header, rows)


def _redraws(redraws: pd.DataFrame) -> str:
    parts = []
    for method, group in redraws.groupby("method", sort=False):
        alarms, unalerted = group.alarms / group.faulted_epochs, group.unalerted / group.faulted_epochs
        hidden = int((group.unalerted > 0).sum())
        parts.append(
            f"{short_label(str(method))} alarms at {percent(alarms.min())} to {percent(alarms.max())} % (median "
            f"{percent(alarms.median())} %), and |U| > VAL without alarm in {hidden} of them"
            + (f", at up to {percent(unalerted.max())} %" if hidden else "")
        )
    return "; ".join(parts)


def _fault_free(table: pd.DataFrame) -> str:
    levels = table[~table.faulted].pivot(index="epoch", columns="method", values="vpl_m").dropna()
    if not len(levels):
        return "No epoch is without a fault."
    plain, robust = table.method.unique()
    ratio = (levels[robust] / levels[plain]).to_numpy()
    same = int((np.abs(ratio - 1) < SAME_RATIO).sum())
    return (
        f"Without faults the paper finds both VPL alike. Here they agree to {SAME_RATIO:g} in {same} of "
        f"{ratio.size} fault-free epochs, {counted_rate(same, ratio.size)}; the median of VPL_R / VPL is "
        f"{np.median(ratio):.3f}, since IGG-III reweights good data too."
    )
