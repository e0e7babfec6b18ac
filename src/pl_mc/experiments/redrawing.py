"""Figures of a finished run drawn again, from its tables and in another look; nothing is counted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pl_mc.experiments.loading import load_experiment
from pl_mc.experiments.output import record_files, require_as_written
from pl_mc.input_errors import InputError, system_reason
from pl_mc.report.files import write_pictures
from pl_mc.report.run_folder import MANIFEST, StoredTables, read_run_folder
from pl_mc.studies.figure_fields import FigureFields
from pl_mc.studies.registry import study_of
from pl_mc.studies.validation import problems_of, told_lines


def figure_fields(given: Mapping[str, Any]) -> FigureFields:
    """The fields of figures that a command gives; an `InputError` names every wrong one."""
    problems = problems_of(FigureFields, given)
    if problems:
        raise InputError(told_lines([f"--{problem.field}: {problem.reason}" for problem in problems]))
    return FigureFields.model_validate(given)


def redraw(folder: Path, fields: FigureFields) -> tuple[str, ...]:
    """Draw the figures of a run again, in place of those of the same forms.

    Args:
        folder: a results folder.
        fields: how.

    Returns:
        A sentence where figures of the run could not be drawn from what is in the folder.

    Raises:
        InputError: a folder without a finished run, with tables that are not what the run wrote, or that cannot be
            written to; an experiment that is none of today.
    """
    run = read_run_folder(folder)
    again = f"pl-mc run {folder / MANIFEST}"
    require_as_written(folder, only=(".csv", ".parquet"), advice=f"no figure is drawn from it ({again} counts anew)")
    _, experiment = load_experiment(str(folder / MANIFEST))
    known = run.figures if run.document is None else tuple(entry.name for entry in run.document.figures)
    made = study_of(experiment).pictures(StoredTables(folder), experiment)
    look = fields.look
    # A page names the figures of its report; where none is stored it shows all that there are.
    wanted = made if run.document is None else [one for one in made if one.name in known]
    try:
        drawn, why = write_pictures(wanted, folder, look, run.title)
    except OSError as error:
        raise InputError(f"{folder}: figures cannot be written there ({system_reason(error)}).") from None
    files = [f"{entry.name}.{ending}" for entry in drawn for ending in look.endings]
    if files:
        record_files(folder, files, fields.model_dump(mode="json"))
    left = [one for one in known if one not in {entry.name for entry in drawn}]
    if not left and drawn:
        return ()
    if not left:
        return ("No figure was drawn: the run has none that is made of its tables.",)
    told = "; ".join(f"{one} ({why[one]})" if one in why else one for one in left)
    return (
        f"Not drawn again, since the folder does not hold all that they are made of: {told}; {again} "
        "with the same options draws them.",
    )
