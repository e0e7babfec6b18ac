"""Experiments of the kind ``readings``: one series under several readings of the paper, and how near each comes.

Nothing is tuned: every reading stands in the file, and the defaults of the package do not follow from the result.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from pydantic import Field

from pl_mc.engine import Execution
from pl_mc.report.document import Summary, TextTable
from pl_mc.report.findings import Findings, Table
from pl_mc.report.text import metres, percent
from pl_mc.studies.series.run import SeriesExperiment, draw_rows, solved
from pl_mc.studies.series.run import work as series_work
from pl_mc.studies.series.zhao2021 import ACCURACY_COLUMNS, PAPER
from pl_mc.studies.spec import ByOneAxis
from pl_mc.studies.strict import Strict
from pl_mc.studies.study import Work
from pl_mc.studies.validation import validated

# Columns of the median levels at epochs without a fault begin so.
_CLEAN = "median_clean_"

# Every reading compiles its method anew; from the seconds of the manifest of the shipped experiment, on two cores.
_SOLUTIONS_PER_S = 3.1e4


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


class ReadingsExperiment(ByOneAxis):
    """A base, with the fields of a ``series``, and readings that each change something of it.

    Attributes:
        compare: the paper's experiment that the results stand beside.
        redraws: further draws of satellites, sizes and noise.
        readings: the readings, each with what it changes of the base.
    """

    kind: Literal["readings"] = "readings"
    source: dict[str, Any]
    faults: dict[str, Any]
    compare: Literal["static", "dynamic"]
    redraws: int = Field(default=20, ge=0)
    readings: Annotated[tuple[Reading, ...], Field(min_length=1)]

    def input_files(self) -> Mapping[str, Path]:
        """Those of the first reading, and those that others put in their place."""
        files: dict[str, Path] = {}
        for k, reading in enumerate(self.readings):
            for name, path in self.series(reading).input_files().items():
                if files.setdefault(name, path) != path:
                    files[f"readings.{k}.{name}"] = path
        return files

    def base(self) -> SeriesExperiment:
        """The base, of which no reading changes anything."""
        return self.series(Reading(label="base", varies="nothing"))

    def series(self, reading: Reading) -> SeriesExperiment:
        """The series of one reading; an `InputError` names an unsound field."""
        content = self.model_dump(include={"alert", "axes", "seed", "precision", "compare", "redraws"}) | {
            "kind": "series", "title": f"{self.title}: {reading.label}",
            "source": self.source | reading.source, "faults": self.faults | reading.faults,
            "methods": [{"name": "ls"}, {"name": "igg3"} | reading.igg3],
        }  # fmt: skip
        made = validated(SeriesExperiment, content, source=f"readings, {reading.label}")
        assert isinstance(made, SeriesExperiment)
        return made


def run(experiment: ReadingsExperiment, execution: Execution) -> Findings:
    """One row per reading and draw, and how far each reading is from the paper."""
    # All readings are sound before the first is run.
    made = [(reading, experiment.series(reading)) for reading in experiment.readings]
    judged, paper = experiment.decides, PAPER[experiment.compare]
    rows: list[dict[str, object]] = []
    for reading, base in made:
        series = base.source.series(draws=base.redraws + 1, seed=base.seed, precision=base.precision)
        for redraw in range(base.redraws + 1):
            table, faults = solved(base, series, redraw)
            clean = table[~table.faulted]
            for row, role in zip(draw_rows(table, faults, redraw, judged), ("before", "after"), strict=True):
                part = clean[clean.method == row["method"]]
                extra: dict[str, object] = {f"{_CLEAN}{pl}_m": part[f"{pl}_m"].median() for pl, _, _ in judged.levels}
                extra["clean_alarm_rate"] = part.alarm.mean()
                rows.append({"varies": reading.varies, "reading": reading.label, "role": role} | row | extra)
    draws = experiment.with_axis(pd.DataFrame(rows))
    distances = experiment.with_axis(distance_table(draws, paper.before_m, paper.after_m), behind="reading")
    return Findings(
        summary=summary(experiment, distances), tables=(Table("distances", distances), Table("readings", draws))
    )


def work(experiment: ReadingsExperiment) -> Work:
    """What a run costs."""
    series = map(experiment.series, experiment.readings)
    works = [series_work(reading, solutions_per_s=_SOLUTIONS_PER_S) for reading in series]
    known = [part.scenarios for part in works if part.scenarios is not None]
    return Work(sum(known) if len(known) == len(works) else None, sum(part.seconds for part in works))


def distance_table(draws: pd.DataFrame, before_m: ArrayLike, after_m: ArrayLike) -> pd.DataFrame:
    """How far each reading is from the paper's table: the typical factor between our values and the paper's.

    The factor of one draw is exp(rms of ln(ours / paper)) over the six values of a column of the table, 1 where all
    are met; the table gives the median over draws with the smallest and the largest.

    Args:
        draws: rows of `run`.
        before_m, after_m: (3, 2), the paper's values [m].
    """
    paper = {"before": np.ravel(before_m), "after": np.ravel(after_m)}
    rows = []
    for (varies, label), group in draws.groupby(["varies", "reading"], sort=False):
        row: dict[str, object] = {"varies": varies, "reading": label}
        for role, part in group.groupby("role", sort=False):
            log_ratio = np.log(part[ACCURACY_COLUMNS].to_numpy() / paper[str(role)])
            factor = np.exp(np.sqrt((log_ratio**2).mean(axis=1)))
            numbers = {"factor": np.median(factor), "factor_low": factor.min(), "factor_high": factor.max()}
            numbers |= {name: part[name].median() for name in ("up_95_m", "up_rms_m")}
            for rate, count in (("alarm_rate", "alarms"), ("unavailable_rate", "unavailable")):
                numbers[rate] = part[count].sum() / part.faulted_epochs.sum()
            numbers |= {name: part[name].median() for name in part if str(name).startswith(_CLEAN)}
            numbers["clean_alarm_rate"] = part.clean_alarm_rate.mean()
            row |= {f"{role}_{name}": number for name, number in numbers.items()}
        rows.append(row)
    return pd.DataFrame(rows)


def summary(experiment: ReadingsExperiment, distances: pd.DataFrame) -> Summary:
    """Each reading's distance from the paper's table, and what it does to alarms.

    ``distances`` is from `distance_table`.
    """
    paper, judged = PAPER[experiment.compare], experiment.decides

    def change(row: Mapping[str, Any], column: str) -> str:
        words = percent if column.endswith("rate") else metres
        return f"{words(row[f'before_{column}'])} -> {words(row[f'after_{column}'])}"

    rows = [
        [row["varies"], row["reading"], _factor(row, "before", ".2f", "-"), _factor(row, "after", ".2f", "-"),
         *(change(row, column) for column in ("up_95_m", "up_rms_m", "alarm_rate")),
         percent(row["after_unavailable_rate"]), *(change(row, f"{_CLEAN}{pl}_m") for pl, _, _ in judged.levels)]
        for row in distances.to_dict("records")
    ]  # fmt: skip
    printed = [f"{metres(b)} -> {metres(a)}" for b, a in zip(paper.before_m[2], paper.after_m[2], strict=True)]
    rows.append(
        ["", f"Zhao et al. 2021, table {paper.table}", "1", "1", *printed, "-", "-", *("-" for _ in judged.levels)]
    )
    header = [
        "question", "reading", "factor, before", "factor, after", "U 95 % [m]", "U RMS [m]",
        "alarms in windows [%]", "no solution, robust [%]",
        *(f"median {name}, no fault [m]" for _, name, _ in judged.levels),
    ]  # fmt: skip
    # What the paper judges by needs no word.
    judging = f" Alarm: {judged.alarm} ({judged.alert.name}, {judged.limits()}), or no solution."
    nearest = distances.loc[distances.after_factor.idxmin()]
    return (
        f"Each reading changes one thing of the base (first row). {experiment.redraws + 1} draws of "
        "satellites, sizes and noise; medians, with the smallest and largest in brackets. Before: least "
        "squares; after: IGG-III. The factor, exp(rms ln(ours / paper)), is the typical one between our six "
        f"values and the paper's column of table {paper.table}; 1 would be every value met."
        + (judging if "axis" in distances else ""),
        TextTable.of(header, rows),
        f"Nearest after: {nearest['reading']} ({nearest['after_factor']:.2f}). What n is in n - t touches "
        "protection levels alone, so the paper's table of errors cannot tell those readings apart.",
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: ReadingsExperiment) -> tuple[str, ...]:
    """How near the base comes, which reading comes nearest, which one stays farthest."""
    table = tables["distances"]
    base, near, far = table.iloc[0], table.loc[table.after_factor.idxmin()], table.loc[table.after_factor.idxmax()]
    return (
        f"The base reading ({base.reading}) meets the paper's robust column within a typical factor of "
        f"{_factor(base)} and its least-squares column within {_factor(base, 'before')}; 1 would be every value "
        "met.",
        f"Nearest of {len(table)} readings in the robust column is {near.varies}: {near.reading}, at {_factor(near)}.",
        f"Farthest is {far.varies}: {far.reading}, at {_factor(far)}.",
    )


def _factor(row: Any, role: str = "after", form: str = ".3g", between: str = " to ") -> str:
    value, low, high = (format(row[f"{role}_factor{end}"], form) for end in ("", "_low", "_high"))
    return f"{value} ({low}{between}{high})"
