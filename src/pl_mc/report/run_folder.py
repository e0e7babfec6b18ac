"""A results folder read back: its manifest, summary, tables and figures, whatever the kind of experiment."""

from __future__ import annotations

import io
import math
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.input_errors import InputError, nearest, shown, system_reason
from pl_mc.report.document import Document, read_document
from pl_mc.report.look import ENDINGS
from pl_mc.runtime.small_files import parsed_json, read_bytes, read_text, shown_reason

MANIFEST = "manifest.json"
SUMMARY = "summary.md"

# Further names are made of it, and file systems take 255 bytes.
_LONGEST_NAME = 200

# Tables of a run have a few megabytes; what is larger than this no page is made of.
_MOST_TABLE_BYTES = 200_000_000

# Columns of words, of which all may be blank.
_WORDS = {"warning"}


@dataclass(frozen=True)
class RunFolder:
    """What a finished run left.

    Attributes:
        folder: where it is.
        name: name of the experiment.
        experiment: its fields, as the manifest records them.
        manifest: the whole manifest.
        summary: text of ``summary.md``.
        tables: the CSV tables by file name without ending.
        figures: names of figures without ending, in alphabetical order.
        document: what the run has to say; none where it is of a version that stored none.
    """

    folder: Path
    name: str
    experiment: Mapping[str, Any]
    manifest: Mapping[str, Any]
    summary: str
    tables: Mapping[str, pd.DataFrame]
    figures: tuple[str, ...]
    document: Document | None

    @property
    def kind(self) -> str:
        """The kind of experiment."""
        return str(self.experiment.get("kind", ""))

    @property
    def title(self) -> str:
        """The experiment's title."""
        return str(self.experiment.get("title", self.name))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what was left out or chosen."""
        return tuple(str(note) for note in self.manifest.get("notes", ()))


def read_run_folder(folder: Path) -> RunFolder:
    """The results in a folder.

    Raises:
        InputError: no such folder, or one that holds no finished run, or files in it that cannot be read.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    try:
        summary = read_text(_within(folder / SUMMARY)) if (folder / SUMMARY).exists() else ""
        tables = {file.stem: _table(_within(file)) for file in sorted(folder.glob("*.csv"))}
        # A long table that the run wrote in both forms may have been kept in the shorter one.
        written = manifest.get("files")
        for file in sorted(folder.glob("*.parquet")):
            if isinstance(written, dict) and f"{file.stem}.csv" in written and file.stem not in tables:
                tables[file.stem] = _table(_within(file))
    except OSError as error:
        raise InputError(f"{folder}: its files cannot be read ({system_reason(error)}).") from None
    figures = {file.stem for ending in ENDINGS for file in folder.glob(f"*.{ending}")}
    return RunFolder(
        folder=folder,
        name=manifest["name"],
        experiment=manifest["experiment"],
        manifest=_in_form(manifest),
        summary=summary,
        tables=tables,
        figures=tuple(sorted(figures)),
        document=read_document(folder),
    )


class StoredTables(Mapping[str, pd.DataFrame]):
    """The tables in a results folder by name, each read when it is first asked for, in its shortest form.

    What reads them always gets the same, whoever wrote them: blank words are empty texts. One that is not there is an
    `InputError`.

    Args:
        folder: the folder.
    """

    def __init__(self, folder: Path) -> None:
        places = (file for ending in ("csv", "parquet") for file in sorted(folder.glob(f"*.{ending}")))
        self._files = {file.stem: file for file in places}
        self._read: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._files:
            raise InputError(f"the table {name} is not in the folder.")
        if name not in self._read:
            table = _table(_within(self._files[name]))
            for column, values in table.items():
                if values.dtype == object or isinstance(values.dtype, pd.StringDtype):
                    table[column] = values.fillna("")
                elif column in _WORDS and values.isna().all():
                    table[column] = ""
            self._read[name] = table
        # What draws may add columns.
        return self._read[name].copy()

    def __contains__(self, name: object) -> bool:
        return name in self._files

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of the finished run in a folder, with its name and experiment.

    Raises:
        InputError: no such folder, or one that holds no finished run.
    """
    path = folder / MANIFEST
    if not folder.is_dir():
        if earlier_place(folder).is_dir():
            raise InputError(
                f"{folder}: a run was ended while it replaced this result, which is in {earlier_place(folder)}; the "
                "next run into this folder puts it in order."
            )
        known = [one.name for one in folder.parent.iterdir()] if folder.parent.is_dir() else []
        raise InputError(f"{folder}: there is no such results folder ({nearest(folder.name, known)}).")
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(f"{folder}: it holds no finished run ({MANIFEST} is not there).") from None
    manifest = parsed_json(text, path=path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("experiment"), dict):
        raise InputError(f"{path}: it is no manifest of a run.")
    if not isinstance(manifest.get("name"), str):
        raise InputError(f"{path}: it is no manifest of a run (name: a word is needed).")
    return manifest


def earlier_place(folder: Path) -> Path:
    """Where a result stands for the moment in which another one takes its place."""
    return folder.with_name(f".{folder.name}.earlier")


def folder_name(name: object, *, source: str) -> str:
    """The name of an experiment, which its results folder gets.

    Raises:
        InputError: it is no text, too long, or anything but the name of one folder.
    """
    if not isinstance(name, str):
        raise InputError(f"{source}: name: the name of a folder is needed, not {shown(name)}.")
    plain = re.sub(r"[\x00-\x1f\x7f\ud800-\udfff]", "", re.split(r"[/\\]", name)[-1]).lstrip(".")
    if plain != name or not name.strip() or len(name.encode()) > _LONGEST_NAME:
        raise InputError(
            f"{source}: name: {shown(name)} is no name of a folder: text of up to {_LONGEST_NAME} bytes without / and "
            f"control characters, and no dot in front (nearest: {shown(plain.strip()[:40] or 'run')})."
        )
    return name


def _in_form(manifest: dict[str, Any]) -> dict[str, Any]:
    """The manifest as a page takes it, whatever stands in it: what is missing or of another form is left out."""
    parted = ("versions", "machine", "noise", "inputs", "code")
    given = {field: manifest[field] for field in parted if field in manifest}
    tables = {field: value if isinstance(value, dict) else {} for field, value in given.items()}
    inputs = {
        field: {key: str(record.get(key, "unknown")) for key in ("file", "sha256")}
        for field, record in tables.get("inputs", {}).items()
        if isinstance(record, dict)
    }
    versions = {"pl_mc": "of an unknown version"} | tables.get("versions", {})
    notes = manifest.get("notes")
    command, date = manifest.get("command"), manifest.get("date")
    parts: dict[str, Any] = {"machine": {}, "noise": {}, "code": {}} | tables | {"inputs": inputs, "versions": versions}
    parts["command"] = shlex.join(map(str, command)) if isinstance(command, list) else ""
    installed = manifest.get("installed")
    parts["installed"] = {
        name: {key: str(value) for key, value in about.items()}
        for name, about in (installed.items() if isinstance(installed, dict) else ())
        if isinstance(about, dict) and "version" in about
    }
    parts["date"] = date if isinstance(date, str) else ""
    return manifest | parts | {"notes": notes if isinstance(notes, list) else []}


def _within(file: Path) -> Path:
    """``file``, which no link leads out of its folder: what lies elsewhere is not a stranger's to show."""
    try:
        inside = file.resolve().parent == file.parent.resolve()
    except RuntimeError:
        # A link that leads to itself, before Python 3.13.
        inside = False
    if not inside:
        raise InputError(f"{file}: it is a link out of the folder, and is not followed.")
    return file


def flat_fields(content: Any, prefix: str = "") -> dict[str, Any]:
    """Leaves of nested tables and lists by their path: ``geometry.epochs``, ``faults.biases.0.G02``.

    Lists of plain values stay whole.
    """
    if isinstance(content, Mapping):
        items = [(str(key), value) for key, value in content.items()]
    elif isinstance(content, list | tuple) and any(isinstance(one, Mapping | list | tuple) for one in content):
        items = [(str(k), value) for k, value in enumerate(content)]
    else:
        return {prefix: content}
    leaves: dict[str, Any] = {}
    for key, value in items:
        leaves |= flat_fields(value, f"{prefix}.{key}" if prefix else key)
    return leaves


def changed_fields(before: Any, now: Any) -> list[tuple[str, str, str]]:
    """Leaves that differ: path, value before, value now, as text; ``nothing`` where a leaf is not there."""
    old, new = flat_fields(before), flat_fields(now)
    before_text, now_text = ({path: value_text(value) for path, value in fields.items()} for fields in (old, new))
    return [
        (path, before_text.get(path, "nothing"), now_text.get(path, "nothing"))
        for path in old | new
        if (path in old) != (path in new) or old.get(path) != new.get(path)
    ]


def value_text(value: Any) -> str:
    """A field's value as an experiment file would say it."""
    if value is None:
        return "not given"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return ", ".join(value_text(one) for one in value) or "none"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} = {value_text(one)}" for key, one in value.items()) or "none"
    return number_text(value) if isinstance(value, int | float) else str(value)


def number_text(value: float, digits: int = 6) -> str:
    """A number as pages tell it: 10,000, 0.25, 1e-7; below a thousandth and from a million on with a power of ten."""
    if isinstance(value, int | np.integer):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    if not math.isfinite(value):
        return str(value)
    size = abs(value)
    if value and not 1e-3 <= size < 1e6:
        shown = f"{value:.{digits - 1}e}"
        figures, power = shown.split("e")
        figures = figures.rstrip("0").rstrip(".") if "." in figures else figures
        return f"{figures}e{int(power)}"
    return f"{value:.{digits}g}"


def _table(file: Path) -> pd.DataFrame:
    content = read_bytes(file, most_bytes=_MOST_TABLE_BYTES)
    try:
        if file.suffix == ".parquet":
            return pd.read_parquet(io.BytesIO(content))
        # A fault's label "none" is a word, not a missing number.
        return pd.read_csv(io.BytesIO(content), keep_default_na=False, na_values=[""], low_memory=False)
    except (ValueError, OverflowError, pd.errors.ParserError) as error:
        raise InputError(f"{file}: it is no table ({shown_reason(str(error))}).") from None
