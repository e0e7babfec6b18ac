"""Experiments of the kind ``observe``: real receiver files, every method at every epoch, with injected faults."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import pandas as pd

from pl_mc.engine import solve
from pl_mc.engine.execution import Execution
from pl_mc.experiments.output import write_table
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.injection import inject, parse_injection
from pl_mc.receiver import read_receiver_series, read_truth
from pl_mc.report.figures import save_figure
from pl_mc.studies.observe.figures import error_figure
from pl_mc.studies.observe.text import observe_summary
from pl_mc.studies.spec import Experiment, ReceiverFiles


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


def run(experiment: ObserveExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
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
    summary = observe_summary(
        table,
        title=experiment.title,
        source=f"systems {', '.join(experiment.systems)}, mask {experiment.mask_deg:g} deg, error model "
        f"{experiment.error_model}",
        injections=[str(one) for one in injections],
        alert=alert,
    )
    return summary, (*series.notes, *notes)
