"""The folder of an unfinished run: its experiment and the finished parts of its sweeps, beside where results go."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from pl_mc.experiments.loading import build_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import changed_fields
from pl_mc.studies.spec import Experiment

RECORD = "experiment.json"
SUFFIX = ".unfinished"


class Unfinished:
    """The unfinished run beside a results folder.

    Args:
        results: the results folder.
    """

    def __init__(self, results: Path) -> None:
        self.results = results
        self.folder = results.with_name(results.name + SUFFIX)

    @property
    def part_count(self) -> int:
        """Finished parts that are there."""
        return sum(1 for _ in self.folder.glob("*/part-*.parquet"))

    def begin(self, name: str, experiment: Experiment, *, resume: bool, fresh: bool) -> None:
        """Prepare the folder for a run.

        Raises:
            InputError: parts are there and neither ``resume`` nor ``fresh`` is asked for, or they are those of
                another experiment, or the folder cannot be written.
        """
        if fresh:
            self.remove()
        content: dict[str, Any] = {"name": name, "experiment": experiment.model_dump(mode="json")}
        if self.part_count:
            if not resume:
                raise InputError(
                    f"{self.folder}: {self.part_count} finished parts of an earlier run are here; --resume goes on "
                    "with it, --fresh starts anew."
                )
            before = _in_this_version(read_record(self.folder)["experiment"])
            changed = changed_fields(before, content["experiment"])
            if changed:
                fields = "; ".join(f"{field}: {old} before, {new} now" for field, old, new in changed)
                raise InputError(
                    f"{self.folder}: the unfinished run is one of another experiment ({fields}); --fresh starts "
                    "anew."
                )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / RECORD).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(f"{self.results}: the output folder cannot be written to ({reason}).") from None

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def remove_if_empty(self) -> None:
        """Remove the folder unless a part is finished."""
        if not self.part_count:
            self.remove()


def read_record(folder: Path) -> dict[str, Any]:
    """Name and experiment of an unfinished run."""
    try:
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return {"name": str(content["name"]), "experiment": dict(content["experiment"])}
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{folder}: no record of an unfinished run ({RECORD}) is here.") from None


def _in_this_version(content: dict[str, Any]) -> dict[str, Any]:
    """The record of an earlier version as this one would write it, with the defaults of fields that it lacked."""
    try:
        return build_experiment(content, source=RECORD).model_dump(mode="json")
    except InputError:
        return content
