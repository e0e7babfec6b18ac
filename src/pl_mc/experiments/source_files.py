"""Files of experiments by name or by path, read but not checked: for that little is loaded."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pl_mc.input_errors import InputError, nearest, shown
from pl_mc.runtime.small_files import parsed, parsed_json, read_text
from pl_mc.studies.registry import EXTRAS, PACKAGED_FOLDERS


def experiment_files() -> dict[str, Path]:
    """The experiments that come with the package, by name."""
    folder = next((folder for folder in PACKAGED_FOLDERS if folder.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.toml"))}


@dataclass(frozen=True)
class ExperimentSource:
    """An experiment as it is written, before any field is checked.

    Attributes:
        name: what a run of it is called.
        path: the file.
        text: the file's text; empty for a manifest, whose lines say nothing to a reader.
        content: the fields.
    """

    name: str
    path: Path
    text: str
    content: Mapping[str, Any]


def read_source(which: str) -> ExperimentSource:
    """The fields of an experiment as they are written; ``which`` and errors as for `load_experiment`."""
    path = Path(which)
    known = experiment_files()
    if which in known:
        path = known[which]
    elif path.suffix not in (".toml", ".json"):
        raise InputError(f"experiment {shown(which)}: it is unknown ({nearest(which, known)}); a path ends in .toml.")
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(f"{which}: there is no such file ({nearest(path.stem, known)}).") from None
    if path.suffix != ".json":
        return ExperimentSource(path.stem, path, text, parsed(text, tomllib.loads, path=path, what="TOML"))
    manifest = parsed_json(text, path=path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("experiment"), dict):
        raise InputError(f"{path}: it is no manifest of a run.")
    from pl_mc.report.run_folder import folder_name

    name = folder_name(manifest.get("name"), source=str(path))
    drawn = {"figures": manifest["figures"]} if "figures" in manifest else {}
    return ExperimentSource(name, path, "", {**experiment_of(manifest), **drawn})


def needs_of(content: Mapping[str, Any]) -> dict[str, list[str]]:
    """What an experiment needs that does not come with the package: files by name, and extras to install."""
    from pl_mc.studies.file_fields import read_files

    named = read_files(dict(content))
    files = [name for name in named if not any((folder / name).is_file() for folder in PACKAGED_FOLDERS)]
    extras = [*EXTRAS.get(str(content.get("kind")), ())]
    extras += ["ubx"] * any(name.lower().endswith(".ubx") for name in named)
    return {"files": files, "extras": extras}


def experiment_of(manifest: Mapping[str, Any]) -> Mapping[str, Any]:
    """The experiment of a manifest, with the defaults of the version that wrote it where today's are others."""
    manifest = _at_home(manifest)
    versions = manifest.get("versions")
    first = isinstance(versions, Mapping) and versions.get("pl_mc") == "0.1.0"
    return _with_ten_iterations(manifest["experiment"]) if first else manifest["experiment"]


def _at_home(content: Any) -> Any:
    """A manifest with the user's home in the place of ``~`` in paths."""
    if isinstance(content, Mapping):
        return {key: _at_home(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_at_home(value) for value in content]
    return os.path.expanduser(content) if isinstance(content, str) and content.startswith("~/") else content


def _with_ten_iterations(content: Mapping[str, Any]) -> dict[str, Any]:
    """A manifest of version 0.1.0 in words of today: there reweighted estimates took ten plain iterations."""

    from pl_mc.methods import METHODS

    def told(options: Any, name: Any) -> Any:
        known = isinstance(options, dict) and isinstance(name, str) and name in METHODS
        ten = {"iterations": 10} if known and getattr(METHODS[name], "iterations", 10) is None else {}
        return ten | options if ten else options

    def each(field: str, change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        if not isinstance(rows := content.get(field), list):
            return {}
        return {field: [change(row) if isinstance(row, dict) else row for row in rows]}

    return (
        dict(content)
        | each("methods", lambda row: told(row, row.get("name")))
        | each("readings", lambda row: row | {"igg3": told(row.get("igg3", {}), "igg3")})
    )
