"""Running an experiment: results, summary and manifest appear together, or not at all."""

from __future__ import annotations

import time
from pathlib import Path

from pl_mc.experiments.common import Experiment
from pl_mc.experiments.output import result_folder, write_manifest
from pl_mc.experiments.registry import KINDS
from pl_mc.experiments.result import RunResult


def run_experiment(
    name: str, experiment: Experiment, out: Path | None = None, *, progress: bool | None = None
) -> RunResult:
    """Run an experiment into a folder.

    Args:
        name: its name, which the manifest records.
        experiment: the record.
        out: the results folder; ``runs/<name>`` unless given.
        progress: whether to show a progress bar; where standard error is a terminal unless given.

    Raises:
        InputError: input that cannot be used, or a folder that cannot be written.
    """
    folder = Path("runs") / name if out is None else Path(out)
    begin = time.perf_counter()
    kind: str = experiment.kind  # type: ignore[attr-defined]
    with result_folder(folder) as working:
        summary, notes = KINDS[kind].run(experiment, working, progress=progress)
        if notes:
            summary += "\nNotes:\n\n" + "".join(f"- {note}\n" for note in notes)
        (working / "summary.md").write_text(summary, encoding="utf-8")
        write_manifest(working, name=name, experiment=experiment, notes=notes, seconds=time.perf_counter() - begin)
    return RunResult(folder=folder, summary=summary, notes=notes)
