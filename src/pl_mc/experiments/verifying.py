"""Whether a results folder is what its run wrote, and whether the run gives the same again."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.engine import Execution
from pl_mc.experiments.loading import load_experiment
from pl_mc.experiments.output import changed_files, content_hash, drawn_again, input_hashes, written_files
from pl_mc.experiments.provenance import machine, recorded_versions
from pl_mc.experiments.redrawing import figure_fields, redraw
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError, shown, system_reason
from pl_mc.report.page import PAGE
from pl_mc.report.run_folder import MANIFEST, changed_fields, read_manifest

# What says numbers in a form that can be compared cell by cell.
_TABLE = ".csv"

# Bytes of a name that file systems take, at most.
_LONGEST_NAME = 255

# Folders within folders of a run, and the one in which sweeps have kept their rows in every version.
_DEEPEST, _ROWS = 8, ("epochs",)


@dataclass(frozen=True)
class Verified:
    """What was found of a results folder.

    Attributes:
        folder: the folder.
        intact: files that are as the run wrote them.
        changed: files that are not, the manifest among them.
        missing: files that the run wrote and that are not there.
        foreign: files that are there and that the run did not write.
        inputs: sentences about files that the run read and that are not as they were.
        redone: sentences about files that another run gives otherwise; None where it was not run again.
        same: files that another run gives bitwise equal.
        notes: what else may explain a difference, and what could not be held against anything.
    """

    folder: Path
    intact: tuple[str, ...]
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    foreign: tuple[str, ...]
    inputs: tuple[str, ...]
    redone: tuple[str, ...] | None = None
    same: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every file is there as it was written, inputs too, and another run gave the same."""
        return not (self.changed or self.missing or self.foreign or self.inputs or self.redone)

    def content(self) -> dict[str, Any]:
        """What is printed as JSON."""
        fields = ("intact", "changed", "missing", "foreign", "inputs", "same", "notes")
        redone = None if self.redone is None else list(self.redone)
        found = {name: list(getattr(self, name)) for name in fields}
        return {"folder": str(self.folder), "passed": self.passed} | found | {"redone": redone}

    def sentences(self) -> list[str]:
        """What is printed, the outcome last."""
        said = [f"{name}: it is not what the run wrote." for name in self.changed]
        said += [f"{name}: the run wrote it, and it is not here." for name in self.missing]
        said += [f"{name}: the run did not write it." for name in self.foreign]
        said += [*self.inputs, *(self.redone or ()), *self.notes]
        files = len(self.intact) + len(self.changed) + len(self.missing)
        end = f"{self.folder}: {len(self.intact)} of {files} files are as the run wrote them"
        if self.redone is not None:
            end += f"; run again, {len(self.same)} of {len(self.same) + len(self.redone)} came out bitwise equal"
        return [*said, f"{end}."]


def verify(folder: Path, *, partial: bool = False, redo: bool = False, progress: bool | None = None) -> Verified:
    """Hold a results folder against its manifest.

    Args:
        folder: a results folder.
        partial: whether files that are not there were left out on purpose.
        redo: whether to run the experiment again, elsewhere, and to compare what is in the folder with what that gives.
        progress: whether to show a progress bar.

    Raises:
        InputError: a folder without a finished run or that cannot be read, a manifest that names no files of it.
    """
    try:
        return _verified(Path(folder), partial, redo, progress)
    except OSError as error:
        raise InputError(f"{shown(str(folder))}: it cannot be read ({system_reason(error)}).") from None


def _verified(folder: Path, partial: bool, redo: bool, progress: bool | None) -> Verified:
    manifest = read_manifest(folder)
    total, files = manifest.pop("sha256", None), manifest.get("files")
    if not isinstance(files, dict) or not files or total is None:
        raise InputError(f"{folder / MANIFEST}: it names no hashes of files, as those of version 0.1.0 do not.")
    odd = next((name for name in files if not is_plain(name)), None)
    if odd is not None:
        raise InputError(f"{folder / MANIFEST}: files: {shown(odd)} is no name of a file in the folder.")
    changed = [] if total == content_hash(manifest) else [MANIFEST]
    there = [name for name in files if os.path.lexists(folder / name)]
    # A link is no file that the run wrote, whatever it leads to.
    links = [name for name in there if (folder / name).is_symlink()]
    changed += dict.fromkeys([*changed_files(folder, files), *links])
    foreign, unhashed = _foreign(folder, files)
    inputs, notes = ([], []) if MANIFEST in changed else _inputs(folder, manifest)
    if PAGE not in files and (folder / PAGE).exists():
        unhashed.append(PAGE)
    notes += [f"{name}: the run was of a version that kept no hash of it." for name in unhashed]
    if redo and MANIFEST in changed:
        notes.append(f"{MANIFEST}: since it is not what the run wrote, nothing was run again.")
    found = Verified(
        folder=folder,
        intact=tuple(name for name in there if name not in changed),
        changed=tuple(changed),
        missing=() if partial else tuple(sorted(set(files) - set(there))),
        foreign=tuple(foreign),
        inputs=tuple(inputs),
        notes=tuple(notes),
    )
    return _redone(found, manifest, progress) if redo and MANIFEST not in changed else found


def is_plain(name: str) -> bool:
    """Whether a name is that of a file in a folder or in a folder of it, and can be shown as it is."""
    parts = name.split("/")
    within = all(0 < len(part) <= _LONGEST_NAME and part not in (".", "..") for part in parts)
    return name.isprintable() and within and len(parts) <= _DEEPEST and "\\" not in name


def _foreign(folder: Path, files: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Files that the run did not write; and folders of which its version kept no hashes."""
    names = [name for name in written_files(folder) if name not in (*files, PAGE)]
    inside = dict.fromkeys(name.partition("/")[0] for name in names if "/" in name)
    unhashed = [] if any("/" in name for name in files) else [name for name in inside if name in _ROWS]
    names = [name for name in names if name.partition("/")[0] not in unhashed]
    return [name if name.isprintable() else shown(name) for name in names], unhashed


def _inputs(folder: Path, manifest: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """A sentence for each file that the run read and that is not what it was; and for what is not at hand."""
    recorded = manifest.get("inputs")
    if not recorded or not isinstance(recorded, dict):
        return [], []
    try:
        now = input_hashes(load_experiment(str(folder / MANIFEST))[1])
    except InputError as error:
        return [], [f"What the run read is not at hand, and was not held against anything ({str(error).rstrip('.')})."]
    except OSError as error:
        return [], [f"{error.filename}: the run read it, and it cannot be read ({system_reason(error)})."]
    # An earlier version recorded fewer.
    known = {field: value for field, value in now.items() if field in recorded}
    return [f"{field}: {was} then, {is_} now." for field, was, is_ in changed_fields(recorded, known)], []


def _redone(found: Verified, manifest: Mapping[str, Any], progress: bool | None) -> Verified:
    """The same with what another run gives."""
    name, experiment = load_experiment(str(found.folder / MANIFEST))
    with tempfile.TemporaryDirectory(prefix="pl-mc-verify-") as place:
        # The name of the folder may stand in its page.
        again = Path(place, found.folder.resolve().name or name)
        run_experiment(name, experiment, again, execution=Execution(progress=progress))
        for fields in drawn_again(manifest):
            redraw(again, figure_fields(fields))
        # A page names versions, machine and time.
        compared = [file for file in manifest["files"] if file != PAGE and (found.folder / file).is_file()]
        same = [file for file in compared if _equal(found.folder / file, again / file)]
        others = [f"{file}: {_difference(found.folder / file, again / file)}" for file in compared if file not in same]
    notes = list(found.notes)
    if others:
        notes += _explanations(manifest)
    return Verified(**(vars(found) | {"redone": tuple(others), "same": tuple(same), "notes": tuple(notes)}))


def _equal(one: Path, other: Path) -> bool:
    return other.is_file() and one.read_bytes() == other.read_bytes()


def _difference(one: Path, other: Path) -> str:
    """What is different in a file that is not the same."""
    if not other.is_file():
        return "another run does not write it."
    if one.suffix != _TABLE:
        return "another run writes it otherwise."
    try:
        before, now = (pd.read_csv(path, keep_default_na=False, na_values=[""]) for path in (one, other))
    except ValueError:
        return "it is no table, which another run writes."
    if list(before.columns) != list(now.columns) or len(before) != len(now):
        if len(before) != len(now):
            return f"another run writes {len(now):,} rows, not {len(before):,}."
        return "another run writes other columns."
    worst = max((_apart(before[name], now[name]), name) for name in before.columns)
    if worst[0] == 0.0:
        return "the same numbers, written otherwise."
    size = "other words" if np.isinf(worst[0]) else f"by up to {worst[0]:.1g} of its value"
    return f"{worst[1]} comes out different ({size})."


def _apart(before: pd.Series, now: pd.Series) -> float:
    """The largest relative difference of two columns; infinite where words differ or one alone is a number."""
    numbers = [pd.to_numeric(column, errors="coerce").to_numpy(float) for column in (before, now)]
    words = [column.astype(str).to_numpy() for column in (before, now)]
    plain = np.isfinite(numbers[0]) & np.isfinite(numbers[1])
    if (words[0] != words[1])[~plain].any():
        return float("inf")
    first, second = (values[plain] for values in numbers)
    size = np.maximum(np.abs(first), np.abs(second))
    return float(np.max(np.abs(first - second) / np.where(size > 0, size, 1.0), initial=0.0))


def _explanations(manifest: Mapping[str, Any]) -> Sequence[str]:
    """What is different between then and now, and may be the reason."""
    now = {"versions": recorded_versions(), "machine": machine()}
    then = {part: manifest.get(part) or {} for part in now}
    # An earlier version recorded less.
    known = {part: {key: value for key, value in now[part].items() if key in then[part]} for part in now}
    changed = changed_fields(then, known)
    if not changed:
        return ["Versions and processor are those of the run: nothing explains a difference."]
    return [f"What may be the reason: {'; '.join(f'{field}: {was} then, {is_} now' for field, was, is_ in changed)}."]
