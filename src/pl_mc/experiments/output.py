"""A results folder that is either complete or not there, with a manifest that is enough to redo the run."""

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

from pl_mc.engine import plan
from pl_mc.engine.noise import LANES
from pl_mc.engine.part_task import environment
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import MANIFEST
from pl_mc.studies.spec import Experiment

# Packages whose version can change a number or a picture.
_RECORDED = ("pl_mc", "jax", "jaxlib", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pymap3d", "pyrtklib")


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
        raise InputError(f"{path}: the output folder cannot be written to ({_reason(error)}).") from None
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
        raise InputError(f"{path}: the results cannot be written ({_reason(error)}).") from None
    finally:
        shutil.rmtree(working, ignore_errors=True)


def write_manifest(
    folder: Path,
    *,
    name: str,
    experiment: Experiment,
    notes: Sequence[str],
    seconds: float,
) -> None:
    """Everything that decides the numbers: the experiment in full, versions, inputs and the machine."""
    content = {
        "name": name,
        "experiment": experiment.model_dump(mode="json"),
        "inputs": {field: file_record(path) for field, path in experiment.input_files().items()},
        "noise": {"generator": "threefry2x32", "lanes_per_block": LANES},
        "cut": {"scenarios_per_call": plan.SCENARIOS_PER_CALL, "calls_per_part": plan.CALLS_PER_PART},
        "notes": list(notes),
        "versions": {"python": platform.python_version()} | {p: importlib.metadata.version(p) for p in _RECORDED},
        "machine": {"system": platform.system(), **environment()},
        "seconds": round(seconds, 2),
    }
    (folder / MANIFEST).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def file_record(path: Path) -> dict[str, str]:
    """Name and SHA-256 of a file."""
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
