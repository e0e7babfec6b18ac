"""Experiments of the kind ``series``: faults in windows of a series, solved epoch by epoch by two methods.

After the static and the dynamic experiment of Zhao et al. (2021), sections 3.2 and 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import Field, field_validator

from pl_mc.alert import AlertLimits
from pl_mc.engine import solve
from pl_mc.engine.execution import Execution
from pl_mc.engine.noise import LANES
from pl_mc.experiments.output import write_table
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.report.figures import save_figure
from pl_mc.studies.series.figures import flight_figure, levels_figure, position_errors_figure, satellites_figure
from pl_mc.studies.series.sources import AnySource, ReceiverSource, Series
from pl_mc.studies.series.text import SeriesReport, comparison_page, series_summary
from pl_mc.studies.series.window_faults import DrawnFaults, WindowFaults
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS, PAPER, PaperSeries, accuracy_m, paper_table
from pl_mc.studies.spec import Experiment, MethodChoice, satellite_files


class SeriesExperiment(Experiment):
    """Two methods over a series of epochs, the first plain, the second robust, with faults in windows.

    Attributes:
        source: a site, a flight or a receiver's files.
        faults: the windows and what is drawn in them.
        compare: the paper's experiment that the results stand beside, with its table and figure numbers.
        redraws: further draws of satellites, sizes and (if simulated) noise, for the range of the table's values.
        remarks: sentences about the choices of the file, for the notes.
    """

    kind: Literal["series"] = "series"
    source: AnySource
    faults: WindowFaults
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
        if isinstance(self.source, ReceiverSource):
            return self.source.files()
        return satellite_files(self.source, "source")


def run(experiment: SeriesExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Solve the series; write ``epochs.parquet``, ``faults.csv``, ``redraws.csv``, the paper's table and figures.

    Returns:
        The summary in Markdown, and notes.
    """
    source, alert, paper = experiment.source, experiment.alert_limits(), PAPER[experiment.compare]
    series = source.series(draws=experiment.redraws + 1, seed=experiment.seed, precision=experiment.precision)
    table, faults = solved(experiment, series, 0)
    draws = draw_rows(table, faults, 0, alert)
    for redraw in range(1, experiment.redraws + 1):
        draws += draw_rows(*solved(experiment, series, redraw), redraw, alert)
    redraws = pd.DataFrame(draws)
    compared = paper_table(paper, *(group[ACCURACY_COLUMNS] for _, group in redraws.groupby("method", sort=False)))

    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    table.to_parquet(folder / "epochs.parquet", index=False, compression="zstd")
    tables = {"faults": faults.listed, "redraws": redraws, f"table{paper.table}": compared, **series.tables}
    for name, content in tables.items():
        write_table(content, folder, name)
    _save_figures(experiment, table, paper, folder)
    if "flight" in series.tables:
        save_figure(flight_figure(series.tables["flight"], title=experiment.title), folder, "flight")
    report = SeriesReport(
        title=experiment.title,
        source=source.describe(),
        faults=experiment.faults.describe(),
        form=source.kind,
        seed=experiment.seed,
        chosen="; ".join(
            f"{first}-{last}: {' and '.join(names)}"
            for (first, last), names in zip(experiment.faults.windows, faults.chosen, strict=True)
        ),
        alert=alert,
        paper=paper,
        table=table,
        compared=compared,
        redraws=redraws,
    )
    (folder / f"table{paper.table}.md").write_text(comparison_page(report), encoding="utf-8")
    return series_summary(report), (*series.notes, *experiment.remarks)


def draw_rows(table: pd.DataFrame, faults: DrawnFaults, redraw: int, alert: AlertLimits) -> list[dict[str, object]]:
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
            "exceeded": int((group.available & (group.up_m.abs() > group.vpl_m)).sum()),
            "unalerted": int(((group.up_m.abs() > alert.vertical_m) & ~group.alarm).sum()),
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
    table = solve(
        g,
        errors_m,
        methods=experiment.method_records(),
        alert=experiment.alert_limits(),
        precision=experiment.precision,
    )
    table["faulted"] = table.epoch.map(pd.Series(faults.faulted, index=g.epoch))
    return table, faults


def _save_figures(experiment: SeriesExperiment, table: pd.DataFrame, paper: PaperSeries, folder: Path) -> None:
    satellites, before, after, levels = paper.figures
    windows = list(experiment.faults.windows)
    plain, robust = table.method.unique()
    title = experiment.title
    save_figure(satellites_figure(table, windows=windows, title=title), folder, f"fig{satellites}_satellites")
    for number, method, what in ((before, plain, "ls"), (after, robust, "robust")):
        figure = position_errors_figure(table, method=method, windows=windows, title=title)
        save_figure(figure, folder, f"fig{number}_errors_{what}")
    figure = levels_figure(table, windows=windows, alert=experiment.alert_limits(), title=title)
    save_figure(figure, folder, f"fig{levels}_vpl")
