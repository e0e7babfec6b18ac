"""Running an experiment: results, summary and manifest appear together, or not at all.

Sweeps store their finished parts in a folder beside the results, so that a run that was stopped can go on, and so
that shares of it can be counted elsewhere and merged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pl_mc.engine import Execution, checkpoint_store
from pl_mc.experiments.assuming import assumed_of
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.output import (
    RECORD,
    SUFFIX,
    Unfinished,
    absolute,
    read_record,
    record_files,
    require_as_written,
    require_finished_alike,
    result_folder,
    write_manifest,
    writing,
)
from pl_mc.input_errors import InputError, system_reason
from pl_mc.report.assumed import ASSUMED
from pl_mc.report.files import to_markdown, write_findings
from pl_mc.report.page import PAGE, write_page
from pl_mc.report.run_folder import MANIFEST, folder_name, read_run_folder
from pl_mc.runtime.whole_files import write_whole
from pl_mc.studies.figure_fields import with_figures
from pl_mc.studies.registry import KINDS, study_of
from pl_mc.studies.spec import Experiment, kind_of
from pl_mc.studies.study import Parted, Study


@dataclass(frozen=True)
class RunResult:
    """What a finished run hands back: a summary for the screen and for ``summary.md``, and where the files are.

    Attributes:
        folder: the results.
        summary: one screen of text in Markdown.
        notes: sentences about what was left out or chosen.
        answer: the answer in three sentences; none for a share of a run.
        page: name of the page in the folder; empty for a share.
    """

    folder: Path
    summary: str
    notes: tuple[str, ...]
    answer: tuple[str, ...] = ()
    page: str = ""


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
    folder = results_place(name, out)
    how = execution or Execution()
    study = study_of(experiment)
    place = Unfinished(folder)
    if how.resume and not fresh and not place.part_count and (folder / MANIFEST).is_file():
        return _finished(folder, experiment)
    if how.resume or how.scheduler is not None or how.devices is not None or how.stored_only:
        _sweeps(experiment)
    begin = time.perf_counter()
    said: list[str] = []
    # The output is checked before anything is computed.
    with (
        result_folder(folder, then=place.remove, said=said) as working,
        _parts(name, experiment, place, study, how, fresh, said) as how,
    ):
        findings = study.found(experiment, how)
        document = write_findings(
            findings,
            working,
            title=experiment.title,
            kind=kind_of(experiment),
            question=study.asks(experiment),
            answer=study.answer(findings.data, experiment),
            val_m=experiment.alert_limits().vertical_m,
            hal_m=experiment.alert_limits().horizontal_m,
            pictures=lambda tables: study.pictures(tables, experiment),
            look=experiment.figures.look,
        )
        assumed = assumed_of(experiment)
        write_whole(working / ASSUMED, assumed.markdown(document.title, document.notes))
        seconds = time.perf_counter() - begin
        write_manifest(working, name=name, experiment=experiment, notes=document.notes, seconds=seconds)
        write_page(read_run_folder(working), assumed=assumed, shown_as=folder)
        record_files(working, [PAGE])
    notes = tuple(dict.fromkeys([*said, *document.notes]))
    summary = to_markdown(document.title, document.summary, notes)
    return RunResult(folder=folder, summary=summary, notes=notes, answer=document.answer, page=PAGE)


def _finished(folder: Path, experiment: Experiment) -> RunResult:
    """What a run that is finished left; nothing is counted."""
    require_finished_alike(folder, experiment)
    require_as_written(folder)
    run = read_run_folder(folder)
    note = f"{folder}: this run was finished before, and nothing was counted; without --resume it is counted anew."
    answer = () if run.document is None else run.document.answer
    page = PAGE if (folder / PAGE).is_file() else ""
    notes = [note]
    if experiment.figures.told().get("figures") not in (None, run.manifest.get("figures")):
        notes.append(f"{folder}: its figures are as they were; pl-mc report draws them again.")
    return RunResult(folder, "\n\n".join([*notes, run.summary]), (*notes, *run.notes), answer, page)


def run_shard(name: str, experiment: Experiment, out: Path | None, execution: Execution) -> RunResult:
    """Count one share of the parts of an experiment's sweeps and store them beside the results folder.

    Args:
        name, experiment, out: as for `run_experiment`.
        execution: with its shard.
    """
    assert execution.shard is not None
    place = Unfinished(results_place(name, out))
    # Shares of one run may store their parts in one folder: those of others are no obstacle.
    how = replace(execution, resume=True)
    sweeps = _sweeps(experiment)
    notes: list[str] = []
    with (
        writing(absolute(place.results), shared=True),
        _parts(name, experiment, place, study_of(experiment), how, False, notes) as how,
    ):
        notes += [note for planned in sweeps(experiment) for note in planned.run(experiment, how).attrs["notes"]]
    index, count = execution.shard
    done = f"{place.part_count} parts are finished" if place.part_count else "there are fewer parts, none for this one"
    summary = f"Shard {index} of {count}: {done}; pl-mc merge makes the results.\n"
    notes = list(dict.fromkeys(notes))
    if notes:
        summary += "\nNotes:\n\n" + "".join(f"- {note}\n" for note in notes)
    return RunResult(folder=place.folder, summary=summary, notes=tuple(notes))


def merge(folders: Sequence[Path], out: Path, *, progress: bool | None = None) -> RunResult:
    """The results of a run from the parts that its shares stored.

    Args:
        folders: the shares' results folders, or their ``.unfinished`` folders; one if they shared one.
        out: the results folder.
        progress: whether to show a progress bar.

    Raises:
        InputError: folders of different experiments, or parts that are missing or damaged.
    """
    sources = [_source(folder) for folder in folders]
    if not sources:
        raise InputError("merge: at least one folder of a share is needed.")
    first = read_record(sources[0])
    for source in sources[1:]:
        if read_record(source)["experiment"] != first["experiment"]:
            raise InputError(f"{source}: it is a share of another experiment than {sources[0]}.")
    place = Unfinished(absolute(out))
    experiment = build_experiment(with_figures(first["experiment"], first.get("figures", {})), source=RECORD)
    with writing(place.results):
        # Refuses to gather among the parts of something else.
        place.begin(first["name"], experiment, resume=True, fresh=False)
        try:
            gathered: set[Path] = set()
            for source in sources:
                if source.absolute() != place.folder:
                    gathered |= _copied(source, place.folder, gathered)
        except OSError as error:
            raise InputError(f"{place.folder}: the parts cannot be gathered ({system_reason(error)}).") from None
    how = Execution(stored_only=True, progress=progress)
    return run_experiment(first["name"], experiment, out, execution=how)


@contextmanager
def _parts(
    name: str, experiment: Experiment, place: Unfinished, study: Study, how: Execution, fresh: bool, said: list[str]
) -> Iterator[Execution]:
    """The way to run with a folder for parts, which goes when nothing in it is worth keeping."""
    if study.sweeps is None:
        yield how
        return
    said += filter(None, [place.begin(name, experiment, resume=how.resume or how.stored_only, fresh=fresh)])
    # That a share has nothing to do is worth knowing where shares are merged.
    empty_too = False
    try:
        # Whatever is in the folder passed the check above.
        yield replace(how, folder=place.folder, resume=True, said=said)
        empty_too = how.shard is not None
    except KeyboardInterrupt:
        count = place.part_count
        kept = f"{count} finished parts are kept in {place.folder}, --resume goes on"
        raise Interrupted(f"interrupted; {kept if count else 'nothing was written'}.") from None
    finally:
        if not place.part_count and not empty_too:
            place.remove()


def results_place(name: str, out: Path | None) -> Path:
    """Where the results go: what was asked for, or a folder by the name of the experiment."""
    name = folder_name(name, source="experiment")
    folder = Path("runs") / name if out is None else Path(out)
    absolute(folder)
    return folder


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


def _source(folder: Path) -> Path:
    for place in (folder, folder.with_name(folder.name + SUFFIX)):
        if (place / RECORD).is_file():
            return place
    done = " (a finished run)" if (folder / MANIFEST).is_file() else ""
    raise InputError(f"{folder}: it holds no parts of a share{done}.")


def _copied(source: Path, target: Path, gathered: Set[Path]) -> set[Path]:
    """Add what a share stored; the whole parts among it. One that another share counted too is the same in both."""
    parts = set()
    for path in sorted(source.rglob("*")):
        if path.is_symlink():
            raise InputError(f"{path}: it is a link; the parts of a share are files of its folder.")
        if path.name.startswith(".") or not path.is_file():
            continue
        if path.stat().st_size > checkpoint_store.MOST_BYTES:
            raise InputError(f"{path}: it is larger than any part, {checkpoint_store.MOST_BYTES / 1e6:.0f} MB.")
        place, content = target / path.relative_to(source), path.read_bytes()
        whole = checkpoint_store.is_whole(content)
        # What an earlier attempt left here may be what was refused then.
        if place.exists() and (place in gathered or not whole):
            continue
        place.parent.mkdir(parents=True, exist_ok=True)
        write_whole(place, content)
        if whole:
            parts.add(place)
    return parts
