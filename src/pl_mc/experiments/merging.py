"""Shares of a run, counted by several processes, made into its results."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from pl_mc.engine import Execution, checkpoint_store
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.result import RunResult
from pl_mc.experiments.running import run_experiment
from pl_mc.experiments.unfinished import RECORD, SUFFIX, Unfinished, read_record
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import MANIFEST


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
    place = Unfinished(out)
    try:
        for source in sources:
            if source.absolute() != place.folder.absolute():
                _copy(source, place.folder)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{place.folder}: the parts cannot be gathered ({reason}).") from None
    experiment = build_experiment(first["experiment"], source=RECORD)
    how = Execution(stored_only=True, progress=progress)
    return run_experiment(first["name"], experiment, out, execution=how)


def _source(folder: Path) -> Path:
    for place in (folder, folder.with_name(folder.name + SUFFIX)):
        if (place / RECORD).is_file():
            return place
    done = " (a finished run)" if (folder / MANIFEST).is_file() else ""
    raise InputError(f"{folder}: it holds no parts of a share{done}.")


def _copy(source: Path, target: Path) -> None:
    """Add what a share stored; a part that two shares counted is the same in both."""
    for path in sorted(source.rglob("*")):
        if path.name.startswith(".") or not path.is_file():
            continue
        place = target / path.relative_to(source)
        if place.exists() and (path.suffix == ".json" or checkpoint_store.is_whole(place.read_bytes())):
            continue
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, place)
