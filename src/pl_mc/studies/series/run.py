"""Experiments of the kind ``series``: faults in windows of a series, solved epoch by epoch by two methods.

After the static and the dynamic experiment of Zhao et al. (2021), sections 3.2 and 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import pandas as pd
from pydantic import Field, field_validator

from pl_mc.alert import AlertLimits
from pl_mc.engine import Execution, solve
from pl_mc.engine.noise import LANES
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.report.accuracy import accuracy_m
from pl_mc.report.findings import Findings, Picture, Table
from pl_mc.studies.series.figures import flight_figure, levels_figure, position_errors_figure, satellites_figure
from pl_mc.studies.series.text import comparison, summary
from pl_mc.studies.series.window_faults import DrawnFaults, WindowFaults
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS, PAPER, oddities, paper_table
from pl_mc.studies.sources import AnySource, ReceiverSource, Series, expected_epochs
from pl_mc.studies.spec import Experiment, MethodChoice
from pl_mc.studies.study import Work

# Solutions of an epoch by a method a second, from the seconds of manifests of shipped experiments, on two cores.
_SOLUTIONS_PER_S = 1.05e5


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
        return self.source.files()


def run(experiment: SeriesExperiment, execution: Execution) -> Findings:
    """The series with each draw of its faults; the paper's table and figures from the first of them."""
    alert, paper = experiment.alert_limits(), PAPER[experiment.compare]
    series = experiment.source.series(
        draws=experiment.redraws + 1, seed=experiment.seed, precision=experiment.precision
    )
    table, faults = solved(experiment, series, 0)
    rows = draw_rows(table, faults, 0, alert)
    for redraw in range(1, experiment.redraws + 1):
        rows += draw_rows(*solved(experiment, series, redraw), redraw, alert)
    redraws = pd.DataFrame(rows)
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
        pictures=_pictures(experiment, table, series.tables.get("flight")),
        notes=(*series.notes, *experiment.remarks),
        texts={f"table{paper.table}.md": comparison(experiment, compared, redraws, remarks)},
    )


def work(experiment: SeriesExperiment, *, solutions_per_s: float = _SOLUTIONS_PER_S) -> Work:
    """What a run costs."""
    epochs = expected_epochs(experiment.source)
    solutions = epochs * (experiment.redraws + 1) * len(experiment.method_records())
    known = not isinstance(experiment.source, ReceiverSource)
    return Work(solutions if known else None, solutions / solutions_per_s)


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
    methods, alert = experiment.method_records(), experiment.alert_limits()
    table = solve(g, errors_m, methods=methods, alert=alert, precision=experiment.precision)
    table["faulted"] = table.epoch.map(pd.Series(faults.faulted, index=g.epoch))
    return table, faults


def _pictures(
    experiment: SeriesExperiment, table: pd.DataFrame, flight: pd.DataFrame | None
) -> tuple[Picture, ...]:
    """The figures under the paper's numbers."""
    satellites, before, after, levels = PAPER[experiment.compare].figures
    plain, robust = table.method.unique()
    common: dict[str, Any] = {"windows": experiment.faults.windows, "title": experiment.title}
    errors = "East, north and up errors of {} over the epochs."
    pictures = [
        Picture(
            f"fig{satellites}_satellites", satellites_figure(table, **common), "Satellites in view over the epochs."
        ),
        Picture(
            f"fig{before}_errors_ls", position_errors_figure(table, method=plain, **common),
            errors.format("least squares"),
        ),
        Picture(
            f"fig{after}_errors_robust", position_errors_figure(table, method=robust, **common),
            errors.format("the robust estimate"),
        ),
        Picture(
            f"fig{levels}_vpl", levels_figure(table, alert=experiment.alert_limits(), **common),
            "Vertical protection levels over the epochs.",
        ),
    ]  # fmt: skip
    if flight is not None:
        figure = flight_figure(flight, title=experiment.title)
        pictures.append(Picture("flight", figure, "The flight: track, height and bank angle."))
    return tuple(pictures)
