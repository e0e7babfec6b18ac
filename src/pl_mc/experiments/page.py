"""The page of an old run, made again from its results folder."""

from __future__ import annotations

from pathlib import Path

from pl_mc.experiments.field_meanings import meanings_of
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.result import RunResult
from pl_mc.input_errors import InputError
from pl_mc.report.answers import answer_of
from pl_mc.report.page import PAGE, write_report
from pl_mc.report.run_folder import MANIFEST, read_run_folder


def remake_page(folder: Path) -> RunResult:
    """Write ``report.html`` into a results folder, from what is in it.

    Raises:
        InputError: a folder without a finished run, or one that cannot be written to.
    """
    run = read_run_folder(folder)
    try:
        meanings = meanings_of(build_experiment(run.experiment, source=MANIFEST))
    except InputError:
        # A run of another version may have fields that this one does not know; the page does without their meaning.
        meanings = {}
    write_report(folder, meanings=meanings)
    return RunResult(folder=folder, summary=run.summary, notes=run.notes, answer=answer_of(run), page=PAGE)
