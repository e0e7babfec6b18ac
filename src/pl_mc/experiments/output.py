"""A results folder that is either complete or not there, with a manifest that is enough to redo the run.

Beside it stands the folder of an unfinished run: its experiment and the finished parts of its sweeps.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pl_mc.engine import plan
from pl_mc.engine.noise import LANES
from pl_mc.engine.part_task import environment
from pl_mc.experiments.loading import in_this_version
from pl_mc.input_errors import InputError, system_reason
from pl_mc.report.run_folder import MANIFEST, changed_fields
from pl_mc.studies.spec import Experiment

# Packages whose version can change a number or a picture.
_RECORDED = ("pl_mc", "jax", "jaxlib", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pymap3d", "sidereon")

RECORD = "experiment.json"
SUFFIX = ".unfinished"


@contextlib.contextmanager
def result_folder(path: Path, *, sign: str = MANIFEST) -> Iterator[Path]:
    """A folder to write into, which takes its place at ``path`` only when everything is written.

    An earlier result at ``path``, which is known by the file ``sign`` in it, is replaced; any other folder is left
    alone.

    Raises:
        InputError: the place cannot be written to, or holds something else.
    """
    path = Path(path).absolute()
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: the output is a folder, but a file of that name is there.")
    if path.is_dir() and any(path.iterdir()) and not (path / sign).is_file():
        raise InputError(f"{path}: the folder holds something other than an earlier result; name another one.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Made beside its final place, so that the last step is a rename within one file system.
        working = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path}: the output folder cannot be written to ({system_reason(error)}).") from None
    try:
        working.chmod(0o755)
        yield working
        old = None
        if path.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
            os.replace(path, old / path.name)
        os.replace(working, path)
        if old is not None:
            shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        if error.filename is None or not str(error.filename).startswith(str(path.parent)):
            raise
        raise InputError(f"{path}: the results cannot be written ({system_reason(error)}).") from None
    finally:
        shutil.rmtree(working, ignore_errors=True)


def write_manifest(folder: Path, *, name: str, experiment: Experiment, notes: Sequence[str], seconds: float) -> None:
    """Everything that decides the numbers: the experiment in full, versions, inputs and the machine."""
    content = {
        "name": name,
        "experiment": experiment.model_dump(mode="json"),
        "inputs": {
            field: {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
            for field, path in experiment.input_files().items()
        },
        "noise": {"generator": "threefry2x32", "lanes_per_block": LANES},
        "cut": {"scenarios_per_call": plan.SCENARIOS_PER_CALL, "calls_per_part": plan.CALLS_PER_PART},
        "notes": list(notes),
        "versions": {"python": platform.python_version()} | {p: importlib.metadata.version(p) for p in _RECORDED},
        "machine": {"system": platform.system(), **environment()},
        "seconds": round(seconds, 2),
    }
    (folder / MANIFEST).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


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
            before = in_this_version(read_record(self.folder)["experiment"], source=RECORD)
            changed = changed_fields(before, content["experiment"])
            if changed:
                fields = "; ".join(f"{field}: {old} before, {new} now" for field, old, new in changed)
                raise InputError(
                    f"{self.folder}: the unfinished run is one of another experiment ({fields}); --fresh starts anew."
                )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / RECORD).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            reason = system_reason(error)
            raise InputError(f"{self.results}: the output folder cannot be written to ({reason}).") from None

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)


def read_record(folder: Path) -> dict[str, Any]:
    """Name and experiment of an unfinished run."""
    try:
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return {"name": str(content["name"]), "experiment": dict(content["experiment"])}
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{folder}: no record of an unfinished run ({RECORD}) is here.") from None
