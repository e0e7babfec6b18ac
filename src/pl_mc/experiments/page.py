"""The page of an old run, made again from its results folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pl_mc.experiments.field_meanings import meanings_of
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.result import RunResult
from pl_mc.input_errors import InputError
from pl_mc.report.document import Document, FigureEntry, TableEntry
from pl_mc.report.markdown import from_markdown
from pl_mc.report.page import PAGE, write_page
from pl_mc.report.run_folder import MANIFEST, RunFolder, read_run_folder
from pl_mc.studies.registry import study_of
from pl_mc.studies.spec import Experiment, kind_of


def remake_page(folder: Path) -> RunResult:
    """Write ``report.html`` into a results folder, from what is in it.

    Raises:
        InputError: a folder without a finished run, or one that cannot be written to, or one of a version that
            stored no report and whose experiment means nothing today.
    """
    run = read_run_folder(folder)
    experiment, reason = _experiment(run)
    if run.document is None:
        if experiment is None:
            raise InputError(
                f"{folder}: it holds no report.json, and its experiment is not one of today, from which the page "
                f"could be made ({reason})."
            )
        run = replace(run, document=document_of_files(run, experiment))
    assert run.document is not None
    # A run of another version may have fields that this one does not know; the page does without their meaning.
    write_page(run, meanings=meanings_of(experiment) if experiment is not None else {})
    return RunResult(folder=folder, summary=run.summary, notes=run.notes, answer=run.document.answer, page=PAGE)


def _experiment(run: RunFolder) -> tuple[Experiment | None, str]:
    try:
        return build_experiment(run.experiment, source=MANIFEST), ""
    except InputError as error:
        return None, str(error)


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
    return Document(
        title=run.title,
        kind=kind_of(experiment),
        question=study.asks(experiment),
        answer=answer,
        notes=run.notes,
        val_m=experiment.alert_limits().vertical_m,
        summary=from_markdown(run.summary),
        tables=tuple(TableEntry(name) for name in run.tables),
        figures=tuple(FigureEntry(name, named := _sentence(name), f"{named} {run.title}.") for name in run.figures),
    )


def _sentence(name: str) -> str:
    return f"{name.replace('_', ' ').capitalize()}."
