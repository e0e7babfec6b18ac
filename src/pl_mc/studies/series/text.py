"""The summary of a series with faults in windows: one screen, and the paper's table beside ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import method_label
from pl_mc.report.text import markdown_table, metres, percent, rate_text, share_text
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.series.zhao2021 import PaperSeries, oddities, paper_table_text, statistic_label

# Two levels that agree to this ratio came from the same weights.
SAME_RATIO = 1e-6

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


@dataclass(frozen=True)
class SeriesReport:
    """What the texts of a series are made from.

    Attributes:
        title, source, faults: heading, where the series comes from, which faults were drawn.
        form: kind of the source: ``site``, ``flight`` or ``receiver``.
        seed: the seed.
        chosen: the satellites of each window, in words.
        alert: alert limits.
        paper: the paper's experiment.
        table: ``epoch, method, satellites, up_m, vpl_m, available, alarm, faulted``.
        compared: from `pl_mc.studies.series.zhao2021.paper_table`.
        redraws: one row per draw and method: ``method, faulted_epochs, alarms, unalerted``.
    """

    title: str
    source: str
    faults: str
    form: str
    seed: int
    chosen: str
    alert: AlertLimits
    paper: PaperSeries
    table: pd.DataFrame
    compared: pd.DataFrame
    redraws: pd.DataFrame

    @property
    def methods(self) -> tuple[str, str]:
        """The plain and the robust method."""
        plain, robust = self.table.method.unique()
        return plain, robust

    @property
    def drawn(self) -> str:
        """What differs from redraw to redraw."""
        return "satellites and sizes" if self.form == "receiver" else "satellites, sizes and noise"


def comparison_page(report: SeriesReport) -> str:
    """The table beside the paper's, with ranges and reasons, in Markdown."""
    why_before, why_after = _WHY[report.form]
    draws = report.redraws.redraw.nunique()
    paragraphs = [
        f"# {report.title}: table {report.paper.table}, errors in m",
        paper_table_text(report.compared, drawn=report.drawn, why_before=why_before, why_after=why_after),
        f"{_key(report)} 95 %: empirical quantile of the absolute error. The ranges are those of {draws} draws of "
        f"{report.drawn}, this one included.",
        *_remarks(report),
    ]
    return "\n\n".join(paragraphs) + "\n"


def series_summary(report: SeriesReport) -> str:
    """The summary in Markdown."""
    first = report.table.drop_duplicates("epoch")
    independent = (
        "they take epochs as independent, but a receiver's errors are correlated over minutes"
        if report.form == "receiver"
        else "simulated epochs are independent but share their satellites"
    )
    short = markdown_table(
        ["", "", "before: ours", "paper", "after: ours", "paper"],
        [
            [row.direction, statistic_label(str(row.statistic)),
             *map(metres, (row.before_m, row.paper_before_m, row.after_m, row.paper_after_m))]
            for row in report.compared.itertuples()
        ],
    )  # fmt: skip
    paragraphs = [
        f"# {report.title}",
        f"{report.source[:1].upper()}{report.source[1:]}. {first.satellites.min()}-{first.satellites.max()} "
        f"satellites (mean {first.satellites.mean():.1f}). Faults: {report.faults}; drawn with seed {report.seed}: "
        f"{report.chosen}. {report.alert.name}, VAL {metres(report.alert.vertical_m)} m.",
        _alarm_table(report),
        f"Alarm: VPL > VAL, or no solution. Bounds: 95 % Clopper-Pearson; {independent}.",
        _redraw_sentence(report),
        _fault_free_sentence(report.table, *report.methods),
        f"Table {report.paper.table} of Zhao et al. (2021) beside ours, errors in m (ranges and reasons: "
        f"`table{report.paper.table}.md`):",
        short,
        " ".join([_key(report), *_remarks(report)]),
    ]
    return "\n\n".join(paragraphs) + "\n"


def _key(report: SeriesReport) -> str:
    plain, robust = report.methods
    return f"Before: {_short(plain)}; after: {_short(robust)}."


def _remarks(report: SeriesReport) -> list[str]:
    share = float(report.table.drop_duplicates("epoch").faulted.mean())
    return oddities(report.paper, report.compared, share)


def _alarm_table(report: SeriesReport) -> str:
    table, rows = report.table, []
    for inside, where in ((True, "in windows"), (False, "outside")):
        for method, group in table[table.faulted == inside].groupby("method", sort=False):
            beyond = group.available & (group.up_m.abs() > group.vpl_m)
            unalerted = (group.up_m.abs() > report.alert.vertical_m) & ~group.alarm
            cells: list[object] = [where, _short(str(method)), len(group), int((~group.available).sum())]
            cells += [share_text(seen) for seen in (group.alarm, beyond, unalerted)]
            rows.append([*cells, metres(group.vpl_m.median()), metres(group.vpl_m.max())])
    header = [
        "epochs", "method", "number", "unavailable", "alarms", "U beyond VPL", "U beyond VAL, no alarm",
        "median VPL [m]",
        "largest VPL [m]",
    ]  # fmt: skip
    return markdown_table(header, rows)


def _redraw_sentence(report: SeriesReport) -> str:
    draws = report.redraws.redraw.nunique()
    parts = []
    for method, group in report.redraws.groupby("method", sort=False):
        alarms, unalerted = group.alarms / group.faulted_epochs, group.unalerted / group.faulted_epochs
        hidden = int((group.unalerted > 0).sum())
        parts.append(
            f"{_short(str(method))} alarms at {percent(alarms.min())} to {percent(alarms.max())} % (median "
            f"{percent(alarms.median())} %), and |U| > VAL without alarm in {hidden} of them"
            + (f", at up to {percent(unalerted.max())} %" if hidden else "")
        )
    return f"Faulted epochs over {draws} draws of {report.drawn} (`redraws.csv`): {'; '.join(parts)}."


def _fault_free_sentence(table: pd.DataFrame, plain: str, robust: str) -> str:
    levels = table[~table.faulted].pivot(index="epoch", columns="method", values="vpl_m").dropna()
    if not len(levels):
        return "No epoch is without a fault."
    ratio = (levels[robust] / levels[plain]).to_numpy()
    same = int((np.abs(ratio - 1) < SAME_RATIO).sum())
    low, high = clopper_pearson(same, ratio.size)
    return (
        f"Without faults the paper finds both VPL alike. Here they agree to {SAME_RATIO:g} in {same} of "
        f"{ratio.size} fault-free epochs, {rate_text(same, ratio.size, float(low), float(high))}; the median of "
        f"VPL_R / VPL is {np.median(ratio):.3f}, since IGG-III reweights good data too."
    )


def _short(method: str) -> str:
    return method_label(method).split(" (")[0]
