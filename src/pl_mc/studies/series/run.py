"""Experiments of the kind ``series``: faults in windows of a series, solved epoch by epoch by two methods.

After the static and the dynamic experiment of Zhao et al. (2021), sections 3.2 and 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import Field, field_validator

from pl_mc.alert import Judged
from pl_mc.engine import Execution, solve
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.kernels.noise import LANES
from pl_mc.report.accuracy import accuracy_m, beyond_level, beyond_limit, beyond_words
from pl_mc.report.document import Block, Paragraph, Summary, TextTable
from pl_mc.report.figures import short_label
from pl_mc.report.files import to_markdown
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.report.text import by_method, counted_rate, metres, percent, share_of, share_text
from pl_mc.studies.series.figures import (
    Windows,
    flight_figure,
    level_words,
    levels_figure,
    position_errors_figure,
    satellites_figure,
)
from pl_mc.studies.series.window_faults import AnyWindowFaults, DrawnFaults, GivenFaults, faulted_windows
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS, PAPER, oddities, paper_table
from pl_mc.studies.sources import AnySource, ReceiverSource, Series, expected_epochs
from pl_mc.studies.spec import ByOneAxis, MethodChoice
from pl_mc.studies.study import Work

# Solutions of an epoch by a method a second, from the seconds of manifests of shipped experiments, on two cores.
_SOLUTIONS_PER_S = 1.05e5

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


class SeriesExperiment(ByOneAxis):
    """Two methods over a series of epochs, the first plain, the second robust, with faults in windows.

    Attributes:
        source: a site, a flight or a receiver's files.
        faults: the windows and what is drawn in them; or ``biases``, faults as texts that are all added.
        compare: the paper's experiment that the results stand beside, with its table and figure numbers.
        redraws: further draws of satellites, sizes and (if simulated) noise, for the range of the table's values.
        remarks: sentences about the choices of the file, for the notes.
    """

    kind: Literal["series"] = "series"
    source: AnySource
    faults: AnyWindowFaults
    compare: Literal["static", "dynamic"]
    redraws: int = Field(default=20, ge=0, lt=LANES)
    remarks: tuple[str, ...] = ()

    @field_validator("methods")
    @classmethod
    def _two(cls, methods: tuple[MethodChoice, ...]) -> tuple[MethodChoice, ...]:
        if len(methods) != 2:
            raise ValueError("two methods are needed, the plain one first and the robust one second")
        return methods

    def input_files(self) -> Mapping[str, Path]:
        """The receiver's files, or the almanac or SP3 file of a simulated source that has one."""
        return self.source.files()


def run(experiment: SeriesExperiment, execution: Execution) -> Findings:
    """The series with each draw of its faults; the paper's table and figures from the first of them."""
    judged, paper = experiment.decides, PAPER[experiment.compare]
    series = experiment.source.series(
        draws=experiment.redraws + 1, seed=experiment.seed, precision=experiment.precision
    )
    table, faults = solved(experiment, series, 0)
    rows = draw_rows(table, faults, 0, judged)
    for redraw in range(1, experiment.redraws + 1):
        rows += draw_rows(*solved(experiment, series, redraw), redraw, judged)
    redraws = experiment.with_axis(pd.DataFrame(rows))
    compared = paper_table(paper, *(group for _, group in redraws.groupby("method", sort=False)))
    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    remarks = oddities(paper, compared, float(faults.faulted.mean()))
    return Findings(
        summary=summary(experiment, table, faults, compared, redraws, remarks),
        tables=(
            Table("epochs", table, stored="parquet"),
            Table("faults", faults.listed),
            *(Table(name, track) for name, track in series.tables.items()),
            Table("redraws", redraws),
            Table(f"table{paper.table}", compared),
        ),
        notes=(*series.notes, *faults.notes, *experiment.remarks),
        texts={f"table{paper.table}.md": comparison(experiment, compared, redraws, remarks)},
    )


def work(experiment: SeriesExperiment, *, solutions_per_s: float = _SOLUTIONS_PER_S) -> Work:
    """What a run costs."""
    epochs = expected_epochs(experiment.source)
    solutions = epochs * (experiment.redraws + 1) * len(experiment.method_records())
    known = not isinstance(experiment.source, ReceiverSource)
    return Work(solutions if known else None, solutions / solutions_per_s)


def draw_rows(table: pd.DataFrame, faults: DrawnFaults, redraw: int, judged: Judged) -> list[dict[str, object]]:
    """One row per method of a draw: its satellites, counts over faulted epochs, errors over all epochs [m]."""
    rows: list[dict[str, object]] = []
    for method, group in table[table.faulted].groupby("method", sort=False):
        row: dict[str, object] = {
            "redraw": redraw,
            "satellites": "; ".join("+".join(names) for names in faults.chosen),
            "method": method,
            "faulted_epochs": len(group),
            "unavailable": int((~group.available).sum()),
            "alarms": int(group.alarm.sum()),
            "exceeded": int((group.available & beyond_level(group, judged)).sum()),
            "unalerted": int((beyond_limit(group, judged) & ~group.alarm).sum()),
        }
        accuracy = accuracy_m(table, str(method)).ravel()
        rows.append(row | dict(zip(ACCURACY_COLUMNS, accuracy.tolist(), strict=True)))
    return rows


def solved(experiment: SeriesExperiment, series: Series, redraw: int) -> tuple[pd.DataFrame, DrawnFaults]:
    """Every epoch by every method with the faults of one draw, and those faults.

    The table is that of `pl_mc.solve` with ``faulted``. Errors of a receiver are the same in all draws.
    """
    g = series.geometry
    faults = experiment.faults.draw(g, seed=experiment.seed, redraw=redraw)
    errors_m = series.errors_m[min(redraw, len(series.errors_m) - 1)] + faults.bias_m
    methods, judged = experiment.method_records(), experiment.decides
    table = solve(g, errors_m, methods=methods, alert=judged.alert, axis=judged.axis, precision=experiment.precision)
    experiment.with_axis(table)["faulted"] = table.epoch.map(pd.Series(faults.faulted, index=g.epoch))
    return table, faults


def pictures(stored: Mapping[str, pd.DataFrame], experiment: SeriesExperiment) -> tuple[Picture, ...]:
    """The figures under the paper's numbers, and that of a flight."""
    satellites, before, after, levels = PAPER[experiment.compare].figures
    (plain, robust), judged = (method.name for method in experiment.method_records()), experiment.decides
    title, epochs = experiment.title, partial(_epochs, stored, experiment)
    errors = "East, north and up errors of {} over the epochs."
    made = (
        Picture(
            f"fig{satellites}_satellites", "Satellites in view over the epochs.",
            lambda: satellites_figure(*epochs(), title=title),
        ),
        Picture(
            f"fig{before}_errors_ls", errors.format("least squares"),
            lambda: position_errors_figure(*epochs(), method=plain, title=title),
        ),
        Picture(
            f"fig{after}_errors_robust", errors.format("the robust estimate"),
            lambda: position_errors_figure(*epochs(), method=robust, title=title),
        ),
        Picture(
            f"fig{levels}_{'_'.join(pl for pl, _, _ in judged.levels)}", f"{level_words(judged)} over the epochs.",
            lambda: levels_figure(*epochs(), judged=judged, title=title),
        ),
    )  # fmt: skip
    flight = Picture(
        "flight", "The flight: track, height and bank angle.", lambda: flight_figure(stored["flight"], title=title)
    )
    return (*made, flight) if "flight" in stored else made


def _epochs(stored: Mapping[str, pd.DataFrame], experiment: SeriesExperiment) -> tuple[pd.DataFrame, Windows]:
    """The table of the epochs, and its windows with faults."""
    table, given = stored["epochs"], experiment.faults
    return table, getattr(given, "windows", None) or faulted_windows(table.drop_duplicates("epoch"))


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
        cells, reasons = [row["direction"], _STATISTIC[row["statistic"]]], []
        for name, why in zip(("before", "after"), _WHY[experiment.source.kind], strict=True):
            low_m, high_m, paper_m = row[f"{name}_low_m"], row[f"{name}_high_m"], row[f"paper_{name}_m"]
            cells += [metres(row[f"{name}_m"]), f"{metres(low_m)} to {metres(high_m)}", metres(paper_m)]
            outside = f"{'below' if paper_m < low_m else 'above'} all redraws: {why}"
            place = f"within the redraws of {drawn}" if low_m <= paper_m <= high_m else outside
            reasons.append(f"{name}: the paper is {place}")
        rows.append([*cells, "; ".join(reasons)])
    header = [
        "", "", "before: ours", "with redraws", "before: paper", "after: ours", "with redraws", "after: paper",
        "why they differ",
    ]  # fmt: skip
    ranges = (
        f"{_key(experiment)} 95 %: empirical quantile of the absolute error. The ranges are those of "
        f"{redraws.redraw.nunique()} draws of {drawn}, this one included."
    )
    blocks: list[Block] = [TextTable.of(header, rows), *map(Paragraph, (ranges, *remarks))]
    return to_markdown(f"{experiment.title}: table {PAPER[experiment.compare].table}, errors in m", blocks)


def summary(
    experiment: SeriesExperiment, table: pd.DataFrame, faults: DrawnFaults, compared: pd.DataFrame,
    redraws: pd.DataFrame, remarks: Sequence[str],
) -> Summary:  # fmt: skip
    """The blocks of the summary.

    Args:
        experiment, compared, redraws, remarks: as for `comparison`.
        table: ``epoch, time, method, satellites, up_m, vpl_m, available, alarm, faulted`` of the first draw.
        faults: of that draw.
    """
    judged, source = experiment.decides, experiment.source.describe()
    number, count = PAPER[experiment.compare].table, table.drop_duplicates("epoch").satellites
    windows = zip(faults.windows, faults.chosen, strict=True)
    chosen = "; ".join(f"{first}-{last}: {' and '.join(names)}" for (first, last), names in windows)
    independent = (
        "they take epochs as independent, but a receiver's errors are correlated over minutes"
        if isinstance(experiment.source, ReceiverSource)
        else "simulated epochs are independent but share their satellites"
    )
    rows = []
    for row in compared.itertuples():
        lengths = (row.before_m, row.paper_before_m, row.after_m, row.paper_after_m)
        rows.append([row.direction, _STATISTIC[row.statistic], *map(metres, lengths)])
    return (
        f"{source[:1].upper()}{source[1:]}. {count.min()}-{count.max()} satellites (mean {count.mean():.1f}). "
        f"Faults: {experiment.faults.describe()}; drawn with seed {experiment.seed}: {chosen}. "
        f"{judged.alert.name}, {judged.limits(metres)}.",
        _alarms(table, judged),
        f"Alarm: {judged.alarm}, or no solution. Bounds: 95 % Clopper-Pearson; {independent}.",
        f"Faulted epochs over {redraws.redraw.nunique()} draws of {_drawn(experiment)} (`redraws.csv`): "
        f"{_redraws(redraws, judged)}.",
        *(_fault_free(table, name) for _, name, _ in judged.levels),
        f"Table {number} of Zhao et al. (2021) beside ours, errors in m (ranges and reasons: `table{number}.md`):",
        TextTable.of(["", "", "before: ours", "paper", "after: ours", "paper"], rows),
        " ".join([_key(experiment), *remarks]),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: SeriesExperiment) -> tuple[str, ...]:
    """Alarms and integrity under the faults, accuracy, and how much a draw matters."""
    redraws, paper = tables["redraws"], tables[f"table{PAPER[experiment.compare].table}"]
    judged = experiment.decides
    first, groups = list(redraws[redraws.redraw == 0].itertuples()), redraws.groupby("method", sort=False)
    alarms = by_method(first, lambda row: f"in {share_of(row.alarms, row.faulted_epochs)}", judged.axis)
    missed = by_method(first, lambda row: share_of(row.unalerted, row.faulted_epochs), judged.axis)
    accuracy = by_method(first, lambda row: f"{metres(row.up_rms_m)} m rms, {metres(row.up_95_m)} m 95 %", judged.axis)
    up = paper[(paper.direction == "U") & (paper.statistic == "rms")].iloc[0]
    ranges = groups.up_rms_m.agg(["min", "max"]).reset_index().itertuples()
    spread = by_method(ranges, lambda row: f"{metres(row.min)} to {metres(row.max)} m", judged.axis)
    draws = redraws.redraw.nunique()
    of = _drawn(experiment) if isinstance(experiment.faults, GivenFaults) else "satellites, sizes and noise"
    return (
        f"Alarms under the injected faults: {alarms} epochs; {' or '.join(one.error for one in judged.called)} beyond "
        f"{'the' if len(judged.called) == 1 else 'its'} alert limit without alarm: {missed}.",
        f"Vertical errors over all epochs: {accuracy} (the paper: {metres(up.paper_before_m)} and "
        f"{metres(up.paper_after_m)} m rms).",
        f"Over {draws} draws of {of} the vertical error ranges from (rms) {spread}."
        if draws > 1
        else f"One draw of {of} was made, so that its chance is in every number.",
    )


def _key(experiment: SeriesExperiment) -> str:
    plain, robust = (short_label(method.name) for method in experiment.method_records())
    return f"Before: {plain}; after: {robust}."


def _drawn(experiment: SeriesExperiment) -> str:
    """What differs from draw to draw; a receiver has its own noise."""
    what = "sizes" if isinstance(experiment.faults, GivenFaults) else "satellites, sizes"
    noise = "" if isinstance(experiment.source, ReceiverSource) else " and noise"
    return what + noise if noise else what.replace(", ", " and ")


def _alarms(table: pd.DataFrame, judged: Judged) -> TextTable:
    rows = []
    for faulted, where in ((True, "in windows"), (False, "outside")):
        for method, group in table[table.faulted == faulted].groupby("method", sort=False):
            beyond = group.available & beyond_level(group, judged)
            unalerted = beyond_limit(group, judged) & ~group.alarm
            shares = map(share_text, (group.alarm, beyond, unalerted))
            cells = [where, short_label(str(method)), len(group), (~group.available).sum(), *shares]
            levels = [group[f"{pl}_m"] for pl, _, _ in judged.levels]
            rows.append([*cells, *(metres(value) for level in levels for value in (level.median(), level.max()))])
    level, limit = beyond_words(judged)
    header = [
        "epochs", "method", "number", "unavailable", "alarms", level, f"{limit}, no alarm",
        *(f"{what} {name} [m]" for _, name, _ in judged.levels for what in ("median", "largest")),
    ]  # fmt: skip
    return TextTable.of(header, rows)


def _redraws(redraws: pd.DataFrame, judged: Judged) -> str:
    beyond = judged.beyond_limit.replace("vertical error", "U").replace("horizontal error", "H")
    parts = []
    for method, group in redraws.groupby("method", sort=False):
        alarms, unalerted = group.alarms / group.faulted_epochs, group.unalerted / group.faulted_epochs
        hidden = int((group.unalerted > 0).sum())
        parts.append(
            f"{short_label(str(method))} alarms at {percent(alarms.min())} to {percent(alarms.max())} % (median "
            f"{percent(alarms.median())} %), and {beyond} without alarm in {hidden} of them"
            + (f", at up to {percent(unalerted.max())} %" if hidden else "")
        )
    return "; ".join(parts)


def _fault_free(table: pd.DataFrame, name: str) -> str:
    """How near the two methods' levels of a name are without faults; the paper has vertical ones alone."""
    levels = table[~table.faulted].pivot(index="epoch", columns="method", values=f"{name.lower()}_m").dropna()
    if not len(levels):
        return "No epoch is without a fault."
    plain, robust = table.method.unique()
    ratio = (levels[robust] / levels[plain]).to_numpy()
    same = int((np.abs(ratio - 1) < SAME_RATIO).sum())
    return (
        f"Without faults {'the paper finds both VPL alike. Here they' if name == 'VPL' else f'both {name}'} agree to "
        f"{SAME_RATIO:g} in {same} of "
        f"{ratio.size} fault-free epochs, {counted_rate(same, ratio.size)}; the median of {name}_R / {name} is "
        f"{np.median(ratio):.3f}, since IGG-III reweights good data too."
    )
