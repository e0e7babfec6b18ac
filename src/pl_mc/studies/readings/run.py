"""Experiments of the kind ``readings``: one series under several readings of the paper, and how near each comes.

Nothing is tuned: every reading stands in the file, and the defaults of the package do not follow from the result.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from pl_mc.engine.execution import Execution
from pl_mc.experiments.output import write_table
from pl_mc.studies.readings.text import readings_summary
from pl_mc.studies.series.run import SeriesExperiment, draw_rows, solved
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS, PAPER
from pl_mc.studies.spec import Experiment, Strict
from pl_mc.studies.validation import validated


class Reading(Strict):
    """One reading: what it changes of the base.

    Attributes:
        label: its name in the table.
        varies: the question that it answers; readings of one question stand together.
        igg3: options of the robust method.
        source, faults: fields of those parts of the base.
    """

    label: str
    varies: str
    igg3: dict[str, Any] = Field(default_factory=dict)
    source: dict[str, Any] = Field(default_factory=dict)
    faults: dict[str, Any] = Field(default_factory=dict)


class ReadingsExperiment(Experiment):
    """A base, with the fields of a ``series``, and readings that each change something of it."""

    kind: Literal["readings"] = "readings"
    source: dict[str, Any]
    faults: dict[str, Any]
    compare: Literal["static", "dynamic"]
    redraws: int = Field(default=20, ge=0)
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]

    def series(self, reading: Reading) -> SeriesExperiment:
        """The series of one reading; an unsound field is an `InputError`."""
        content = {
            "kind": "series",
            "title": f"{self.title}: {reading.label}",
            "alert": self.alert,
            "seed": self.seed,
            "precision": self.precision,
            "source": self.source | reading.source,
            "faults": self.faults | reading.faults,
            "compare": self.compare,
            "redraws": self.redraws,
            "methods": [{"name": "ls"}, {"name": "igg3"} | reading.igg3],
        }
        return validated(SeriesExperiment, content, source=f"readings, {reading.label}")


def run(experiment: ReadingsExperiment, folder: Path, *, execution: Execution) -> tuple[str, tuple[str, ...]]:
    """Write ``readings.csv`` (one row per reading and draw) and ``distances.csv`` (one row per reading).

    Returns:
        The summary in Markdown, and notes.
    """
    made = [(reading, experiment.series(reading)) for reading in experiment.readings]
    alert = experiment.alert_limits()
    rows: list[dict[str, object]] = []
    for reading, one in made:
        series = one.source.series(draws=one.redraws + 1, seed=one.seed, precision=one.precision)
        for redraw in range(one.redraws + 1):
            table, faults = solved(one, series, redraw)
            clean = table[~table.faulted]
            for row, role in zip(draw_rows(table, faults, redraw, alert), ("before", "after"), strict=True):
                part = clean[clean.method == row["method"]]
                extra = {"median_clean_vpl_m": part.vpl_m.median(), "clean_alarm_rate": part.alarm.mean()}
                rows.append({"varies": reading.varies, "reading": reading.label, "role": role} | row | extra)
    draws = pd.DataFrame(rows)
    distances = distance_table(draws, PAPER[experiment.compare].before_m, PAPER[experiment.compare].after_m)
    write_table(draws, folder, "readings")
    write_table(distances, folder, "distances")
    return readings_summary(experiment.title, distances, PAPER[experiment.compare], experiment.redraws), ()


def distance_table(draws: pd.DataFrame, before_m: Any, after_m: Any) -> pd.DataFrame:
    """How far each reading is from the paper's table: the typical factor between our values and the paper's.

    The factor of one draw is exp(rms of ln(ours / paper)) over the six values of a column of the table, 1 where all
    are met; the table gives the median over draws with the smallest and the largest.

    Args:
        draws: rows of `run`.
        before_m, after_m: (3, 2), the paper's values [m].
    """
    paper: Mapping[str, np.ndarray] = {"before": np.ravel(before_m), "after": np.ravel(after_m)}
    rows = []
    for (varies, label), group in draws.groupby(["varies", "reading"], sort=False):
        row: dict[str, object] = {"varies": varies, "reading": label}
        for role, part in group.groupby("role", sort=False):
            log_ratio = np.log(part[ACCURACY_COLUMNS].to_numpy() / paper[str(role)])
            factor = np.exp(np.sqrt((log_ratio**2).mean(axis=1)))
            row |= {
                f"{role}_factor": np.median(factor),
                f"{role}_factor_low": factor.min(),
                f"{role}_factor_high": factor.max(),
                f"{role}_up_95_m": part.up_95_m.median(),
                f"{role}_up_rms_m": part.up_rms_m.median(),
                f"{role}_alarm_rate": part.alarms.sum() / part.faulted_epochs.sum(),
                f"{role}_unavailable_rate": part.unavailable.sum() / part.faulted_epochs.sum(),
                f"{role}_median_clean_vpl_m": part.median_clean_vpl_m.median(),
                f"{role}_clean_alarm_rate": part.clean_alarm_rate.mean(),
            }
        rows.append(row)
    return pd.DataFrame(rows)
