"""The folder of an unfinished run: its experiment and the finished parts of its sweeps, beside where results go."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pl_mc.input_errors import InputError
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
            changed = _changes(read_record(self.folder)["experiment"], content["experiment"])
            if changed:
                raise InputError(
                    f"{self.folder}: the unfinished run is one of another experiment ({'; '.join(changed)}); "
                    "--fresh starts anew."
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


def _changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    old, new = dict(_flat(before)), dict(_flat(now))
    fields = [*old, *(field for field in new if field not in old)]
    return [
        f"{field}: {old.get(field, 'nothing')} before, {new.get(field, 'nothing')} now"
        for field in fields
        if old.get(field) != new.get(field)
    ]


def _flat(content: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """Leaves with their paths: ``geometry.epochs``, ``faults.biases.0.G02``."""
    if isinstance(content, Mapping):
        items = [(str(key), value) for key, value in content.items()]
    elif isinstance(content, list | tuple):
        items = [(str(k), value) for k, value in enumerate(content)]
    else:
        return [(prefix, content)]
    return [leaf for key, value in items for leaf in _flat(value, f"{prefix}.{key}" if prefix else key)]
