"""Experiments of the kind ``observe``: real receiver files, every method at every epoch, with injected faults."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from pl_mc.engine import solve
from pl_mc.experiments.common import Experiment, ReceiverFiles
from pl_mc.experiments.output import write_table
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.injection import Injection, inject, parse_injection
from pl_mc.receiver import read_receiver_series, read_truth
from pl_mc.report.error_figures import error_figure
from pl_mc.report.figures import method_label, save_figure
from pl_mc.report.text import markdown_table, metres, rate_text
from pl_mc.statistics.intervals import clopper_pearson


class ObserveExperiment(Experiment, ReceiverFiles):
    """Receiver files and a true position or track; see `pl_mc.receiver.read_receiver_series`.

    ``faults`` holds texts such as ``G02:+30m:545-645``: satellite, bias, first and last epoch, counted from 0.
    """

    kind: Literal["observe"] = "observe"
    faults: tuple[str, ...] = ()

    def input_files(self) -> Mapping[str, Path]:
        """The two RINEX files, and the track where the truth is one."""
        files = {"observations": self.observations, "navigation": self.navigation}
        return files | ({"truth": Path(self.truth)} if Path(self.truth).is_file() else {})


def run(experiment: ObserveExperiment, folder: Path, *, progress: bool | None) -> tuple[str, tuple[str, ...]]:
    """Solve every epoch with every method; write ``epochs.csv``, ``epochs.parquet`` and a figure.

    Returns:
        The summary in Markdown, and notes.
    """
    injections = [parse_injection(text) for text in experiment.faults]
    series = read_receiver_series(
        experiment.observations,
        experiment.navigation,
        read_truth(experiment.truth),
        systems=experiment.systems,
        mask_deg=experiment.mask_deg,
        error_model=experiment.model(),
    )
    g = series.geometry
    errors_m, faulted, notes = inject(g, series.errors_m, injections)
    alert = experiment.alert_limits()
    table = solve(g, errors_m, methods=experiment.method_records(), alert=alert, precision=experiment.precision)
    table["faulted"] = table.epoch.map(pd.Series(faulted, index=g.epoch))
    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    write_table(table, folder, "epochs", parquet=True)
    save_figure(error_figure(table, alert=alert, title=experiment.title), folder, "epochs")
    return _summary(experiment, table, injections), (*series.notes, *notes)


def accuracy_table(table: pd.DataFrame) -> pd.DataFrame:
    """Per method, over available epochs: 95 % quantile of |error|, RMS and largest |error| in E, N, U [m]."""
    rows = []
    for method, group in table.groupby("method", sort=False):
        known = group[group.available]
        for direction, column in (("E", "east_m"), ("N", "north_m"), ("U", "up_m")):
            size = known[column].abs()
            rows.append(
                {
                    "method": method,
                    "direction": direction,
                    "epochs": len(known),
                    "q95_m": size.quantile(0.95),
                    "rms_m": float(np.sqrt((size**2).mean())),
                    "largest_m": size.max(),
                }
            )
    return pd.DataFrame(rows)


def _summary(experiment: ObserveExperiment, table: pd.DataFrame, injections: list[Injection]) -> str:
    alert = experiment.alert_limits()
    first = table.drop_duplicates("epoch")
    accuracy = accuracy_table(table)
    accuracy_rows = [
        [row.method, row.direction, metres(row.q95_m), metres(row.rms_m), metres(row.largest_m)]
        for row in accuracy.itertuples()
    ]
    alarm_rows = []
    for method, group in table.groupby("method", sort=False):
        for label, part in (("as observed", group[~group.faulted]), ("with injected fault", group[group.faulted])):
            if len(part):
                beyond = part.available & (part.up_m.abs() > part.vpl_m)
                cells = [str(method), label, len(part), int((~part.available).sum())]
                for seen in (part.alarm, beyond, beyond & ~part.alarm, part.up_m.abs() > alert.vertical_m):
                    low, high = clopper_pearson(int(seen.sum()), len(part))
                    cells.append(
                        f"{int(seen.sum())}: {rate_text(int(seen.sum()), len(part), float(low), float(high))}"
                    )
                alarm_rows.append([*cells, metres(part.vpl_m.median()), metres(part.hpl_m.median())])
    labels = "; ".join(f"{m}: {method_label(m)}" for m in table.method.unique() if method_label(m) != m)
    lines = [
        f"# {experiment.title}",
        "",
        f"{len(first)} epochs from {first.time.iloc[0]} to {first.time.iloc[-1]} (GPS time), systems "
        f"{', '.join(experiment.systems)}, {first.satellites.min()}-{first.satellites.max()} satellites (mean "
        f"{first.satellites.mean():.1f}), mask {experiment.mask_deg:g} deg, error model {experiment.error_model}. "
        f"Alert limit: {alert.name}, VAL {metres(alert.vertical_m)} m."
        + (f" Injected: {'; '.join(map(str, injections))}." if injections else ""),
        "",
        "Position errors over all available epochs [m]:",
        "",
        markdown_table(["method", "direction", "95 %", "RMS", "largest"], accuracy_rows),
        "",
        "Alarms and errors beyond the protection level, epochs and rates:",
        "",
        markdown_table(
            ["method", "epochs", "number", "unavailable", "alarm", "|U| > VPL", "|U| > VPL, no alarm",
             "|U| > VAL", "median VPL [m]", "median HPL [m]"],
            alarm_rows,
        ),
        "",
        "Intervals are 95 % Clopper-Pearson bounds; they take epochs as independent, but the errors of a real "
        "receiver are correlated over minutes, so the true uncertainty is larger.",
        "",
        labels + ".",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
