"""Running an experiment: results, summary and manifest appear together, or not at all.

Sweeps store their finished parts in a folder beside the results, so that a run that was stopped can go on, and so
that shares of it can be counted elsewhere and merged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pl_mc.engine import Execution
from pl_mc.experiments.field_meanings import meanings_of
from pl_mc.experiments.output import result_folder, write_manifest
from pl_mc.experiments.result import RunResult
from pl_mc.experiments.unfinished import Unfinished
from pl_mc.input_errors import InputError
from pl_mc.report.files import write_findings
from pl_mc.report.markdown import to_markdown
from pl_mc.report.page import PAGE, write_page
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.registry import KINDS, study_of
from pl_mc.studies.spec import Experiment, kind_of
from pl_mc.studies.study import Parted, Study


class Interrupted(KeyboardInterrupt):
    """A run was interrupted; the message says what is left of it."""


def run_experiment(
    name: str,
    experiment: Experiment,
    out: Path | None = None,
    *,
    execution: Execution | None = None,
    fresh: bool = False,
) -> RunResult:
    """Run an experiment into a folder.

    Args:
        name: its name, which the manifest records.
        experiment: the record.
        out: the results folder; ``runs/<name>`` unless given.
        execution: how it runs and whether it shows its progress; in this process unless given. Its folder is not
            used.
        fresh: forget an unfinished run of the same results folder.

    Raises:
        InputError: input that cannot be used, or a folder that cannot be written.
        Interrupted: by Ctrl-C.
    """
    folder = Path("runs") / name if out is None else Path(out)
    how = execution or Execution()
    study = study_of(experiment)
    if _shared(how):
        _sweeps(experiment)
    begin = time.perf_counter()
    # The output is checked before anything is computed.
    with result_folder(folder) as working, _parts(name, experiment, folder, study, how, fresh) as how:
        findings = study.run(experiment, how)
        document = write_findings(
            findings,
            working,
            title=experiment.title,
            kind=kind_of(experiment),
            question=study.asks(experiment),
            answer=study.answer(findings.data, experiment),
            val_m=experiment.alert_limits().vertical_m,
        )
        seconds = time.perf_counter() - begin
        write_manifest(working, name=name, experiment=experiment, notes=document.notes, seconds=seconds)
        write_page(read_run_folder(working), meanings=meanings_of(experiment), shown_as=folder)
    Unfinished(folder).remove()
    summary = to_markdown(document.title, document.summary, document.notes)
    return RunResult(folder=folder, summary=summary, notes=document.notes, answer=document.answer, page=PAGE)


def run_shard(name: str, experiment: Experiment, out: Path | None, execution: Execution) -> RunResult:
    """Count one share of the parts of an experiment's sweeps and store them beside the results folder.

    Args:
        name, experiment, out: as for `run_experiment`.
        execution: with its shard.
    """
    assert execution.shard is not None
    folder = Path("runs") / name if out is None else Path(out)
    # Shares of one run may store their parts in one folder: those of others are no obstacle.
    how = replace(execution, resume=True)
    sweeps = _sweeps(experiment)
    notes: list[str] = []
    with _parts(name, experiment, folder, study_of(experiment), how, fresh=False) as how:
        for planned in sweeps(experiment):
            notes += planned.run(experiment, how).attrs["notes"]
    place = Unfinished(folder)
    index, count = execution.shard
    summary = f"Shard {index} of {count}: {place.part_count} parts are finished; pl-mc merge makes the results.\n"
    if notes:
        summary += "\nNotes:\n\n" + "".join(f"- {note}\n" for note in notes)
    return RunResult(folder=place.folder, summary=summary, notes=tuple(notes))


@contextmanager
def _parts(
    name: str, experiment: Experiment, folder: Path, study: Study, how: Execution, fresh: bool
) -> Iterator[Execution]:
    """The way to run with a folder for parts, which goes when nothing in it is worth keeping."""
    if study.sweeps is None:
        yield how
        return
    place = Unfinished(folder)
    place.begin(name, experiment, resume=how.resume or how.stored_only, fresh=fresh)
    try:
        # Whatever is in the folder passed the check above.
        yield replace(how, folder=place.folder, resume=True)
    except KeyboardInterrupt:
        count = place.part_count
        kept = f"{count} finished parts are kept in {place.folder}, --resume goes on"
        raise Interrupted(f"interrupted; {kept if count else 'nothing was written'}.") from None
    finally:
        place.remove_if_empty()


def _sweeps(experiment: Experiment) -> Callable[[Any], tuple[Parted, ...]]:
    """What names the sweeps of an experiment; an `InputError` for a kind that is not made of parts."""
    sweeps = study_of(experiment).sweeps
    if sweeps is None:
        able = ", ".join(kind for kind, study in KINDS.items() if study.sweeps is not None)
        raise InputError(
            f"experiment: runs of the kind {kind_of(experiment)} are not made of parts that can be stored or "
            f"shared (kinds that are: {able})."
        )
    return sweeps


def _shared(how: Execution) -> bool:
    return how.resume or how.scheduler is not None or how.devices is not None or how.stored_only
