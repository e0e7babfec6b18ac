"""What is made of results folders that are there: the page of a run again, and a comparison of two runs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from pl_mc.experiments.assuming import assumed_of
from pl_mc.experiments.loading import build_experiment, in_this_version
from pl_mc.experiments.output import record_files, result_folder
from pl_mc.experiments.running import RunResult
from pl_mc.experiments.source_files import experiment_of
from pl_mc.input_errors import InputError, shown, system_reason
from pl_mc.report.assumed import Assumed
from pl_mc.report.charts import charts_of
from pl_mc.report.comparison import Comparison, combined_tables, compare_runs, row_name
from pl_mc.report.document import Document, FigureEntry, TableEntry
from pl_mc.report.files import from_markdown, write_table
from pl_mc.report.latex import to_latex
from pl_mc.report.page import PAGE, PageTable, charts_within_limit, page_table, render, text_table, write_page
from pl_mc.report.run_folder import MANIFEST, RunFolder, read_run_folder
from pl_mc.report.text import percent
from pl_mc.runtime.small_files import shown_reason
from pl_mc.runtime.whole_files import write_whole
from pl_mc.studies.registry import study_of
from pl_mc.studies.spec import Experiment, kind_of

COMPARE_PAGE = "compare.html"

# Rows of the page of a comparison; all of them are in compare.csv.
_MOST_ROWS = 2_000


def remake_page(folder: Path) -> RunResult:
    """Write ``report.html`` into a results folder, from what is in it.

    Raises:
        InputError: a folder without a finished run, or one that cannot be written to, or one of a version that
            stored no report and whose experiment means nothing today.
    """
    run = read_run_folder(folder)
    document, assumed = _document(run)
    try:
        write_page(replace(run, document=document), assumed=assumed)
        record_files(folder, [PAGE])
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        reason = f"{type(error).__name__}: {shown_reason(str(error))}"
        raise InputError(f"{folder}: no page can be made of what is in it ({reason}).") from None
    gone = [f"{entry.name}.csv" for entry in document.tables if entry.name not in run.tables]
    gone += [f"{entry.name}.png" for entry in document.figures if entry.name not in run.figures]
    notes = (*run.notes, *(f"{name} is not in the folder; the page does without it." for name in gone))
    return RunResult(folder=folder, summary=run.summary, notes=notes, answer=document.answer, page=PAGE)


def document_of_run(run: RunFolder) -> Document:
    """What a run has to say: what it stored of it, or what its tables and summary give.

    Raises:
        InputError: as `remake_page`.
    """
    return _document(run)[0]


def _document(run: RunFolder) -> tuple[Document, Assumed | None]:
    """What a run has to say, and what its experiment assumes; nothing of that where this version cannot tell."""
    try:
        experiment = build_experiment(experiment_of(run.manifest), source=MANIFEST)
    except InputError as error:
        # A run of another version may have fields that this one does not know; the page does without their meanings.
        if run.document is None:
            raise InputError(
                f"{run.folder}: it holds no report.json, and its experiment is not one of today, from which the page "
                f"could be made ({error})."
            ) from None
        return run.document, None
    return run.document or document_of_files(run, experiment), assumed_of(experiment)


def tex_of(folder: Path, place: Path) -> str:
    """The tables of a run's summary as LaTeX, for a place where they can be written.

    Raises:
        InputError: as `remake_page` and `require_place`.
    """
    require_place("--tex", place, ".tex", folder)
    return to_latex(document_of_run(read_run_folder(folder)))


def require_place(option: str, place: Path, suffix: str, folder: Path) -> None:
    """Raise `InputError` unless an option names a file of an ending, in a folder that is there and not ``folder``."""
    try:
        usable = place.suffix == suffix and place.parent.is_dir() and (place.is_file() or not os.path.lexists(place))
        if not usable or place.is_symlink():
            raise InputError(f"{option}: {place}: the name of a {suffix} file in a folder that is there is needed.")
        inside = folder.resolve() in (one.resolve() for one in (place.absolute(), *place.absolute().parents))
        if inside or (place.parent / MANIFEST).is_file():
            raise InputError(f"{option}: {place}: it would be a foreign file in a results folder; name another folder.")
    except OSError as error:
        raise InputError(f"{option}: {shown(str(place))}: it cannot be written ({system_reason(error)}).") from None


def write_tex(place: Path, tables: str) -> None:
    """Write tables of `tex_of` to its place; an `InputError` where that fails."""
    try:
        write_whole(place, tables)
    except OSError as error:
        raise InputError(f"--tex: {place}: it cannot be written ({system_reason(error)}).") from None


def document_of_files(run: RunFolder, experiment: Experiment) -> Document:
    """The document of a run of a version that stored none: nothing is charted, figures have their names.

    Raises:
        InputError: tables from which this version cannot answer.
    """
    study = study_of(experiment)
    try:
        answer = study.answer(run.tables, experiment)
    except (LookupError, AttributeError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.folder}: it holds no report.json, and its tables are not those from which this version answers "
            f"({type(error).__name__}: {error})."
        ) from None
    captions = {name: f"{name.replace('_', ' ').capitalize()}." for name in run.figures}
    return Document(
        title=run.title,
        kind=kind_of(experiment),
        question=study.asks(experiment),
        answer=answer,
        notes=run.notes,
        val_m=experiment.alert_limits().vertical_m,
        hal_m=experiment.alert_limits().horizontal_m,
        summary=from_markdown(run.summary),
        tables=tuple(TableEntry(name) for name in run.tables),
        figures=tuple(FigureEntry(name, said, f"{said} {run.title}.") for name, said in captions.items()),
    )


@dataclass(frozen=True)
class Compared:
    """A comparison that is written.

    Attributes:
        folder: where it is.
        comparison: what it says.
    """

    folder: Path
    comparison: Comparison

    def content(self) -> dict[str, Any]:
        """The comparison for programs."""
        found = self.comparison
        rates = found.rates.astype(object).where(found.rates.notna(), None)
        return {
            "folder": str(self.folder),
            "report": COMPARE_PAGE,
            "names": list(found.names),
            "same_noise": found.same_noise,
            "verdict": found.verdict,
            "fields": found.fields.to_dict("records"),
            "rates": rates.to_dict("records"),
            "notes": list(found.notes),
        }


def write_comparison(first: Path, second: Path, out: Path | None = None) -> Compared:
    """Compare two runs and write ``compare.html`` and ``compare.csv``.

    Args:
        first, second: their results folders; differences are second minus first.
        out: the folder; ``runs/compare-FIRST-SECOND`` unless given. An earlier comparison there is replaced.

    Raises:
        InputError: folders without a finished run, runs of different kinds, or a place that cannot be written to.
    """
    old, new = (
        replace(run, experiment=in_this_version(experiment_of(run.manifest), source=MANIFEST))
        for run in map(read_run_folder, (first, second))
    )
    found = compare_runs(old, new)
    names = [run.folder.absolute().name for run in (old, new)]
    folder = Path("runs") / f"compare-{names[0]}-{names[1]}" if out is None else Path(out)
    with result_folder(folder, sign=COMPARE_PAGE) as working:
        write_table(found.rates, working, "compare")
        write_whole(working / COMPARE_PAGE, comparison_page(old, new, found))
    return Compared(folder, found)


def comparison_page(first: RunFolder, second: RunFolder, found: Comparison) -> str:
    """The page as text; what is drawn is what a document of the two says, preferably that of the first."""
    document = first.document or second.document
    charts: list[dict[str, Any]] = []
    if document is not None:
        tables = combined_tables(first, second, found.names)
        limits: dict[str, Any] = {"val_m": document.val_m, "hal_m": document.hal_m}
        charts = charts_within_limit(charts_of(document.tables, tables, **limits))
    title, fields = f"fields that differ: {len(found.fields)}", found.fields.to_numpy()
    return render(
        COMPARE_PAGE,
        {
            "title": f"{found.names[1]} against {found.names[0]}",
            "runs": list(zip(found.names, (first, second), strict=True)),
            "found": found,
            "fields": text_table(title, ("field", *found.names), fields) if len(fields) else None,
            "rates": _rates(found) if len(found.rates) else None,
            "charts": charts,
            "folders": [Path(run.folder).as_posix() for run in (first, second)],
        },
    )


def _rates(found: Comparison) -> PageTable:
    """The rates with what differs first, since long tables are cut; all columns are in the file."""
    order = found.rates.assign(size=found.rates.difference.abs())
    order = order.sort_values(["differs", "size"], ascending=False, kind="stable")
    first, second = found.names
    rows = order.to_dict("records")
    shown = pd.DataFrame(
        {
            "row": [row_name(row) for row in rows],
            "event": order.event.to_numpy(),
            first: [_counted(row, "first") for row in rows],
            second: [_counted(row, "second") for row in rows],
            **{column: order[column].to_numpy() for column in ("difference", "low", "high")},
            "differs": order.differs.map({True: "yes", False: ""}).to_numpy(),
            "interval": order.interval.to_numpy(),
        }
    )
    return page_table(shown, name="compare", rows=_MOST_ROWS)


def _counted(row: Mapping[str, Any], side: str) -> str:
    return f"{percent(row[f'{side}_rate'])} %, {row[f'{side}_count']:,} of {row[f'{side}_draws']:,}"
