"""Fields of experiments that name files, wherever they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pl_mc.runtime.model_files import is_model_file

# Fields that hold the names of files.
_FILES = ("observations", "navigation", "ionex", "claims", "almanac", "sp3", "truth", "ism", "file")


def named_files(content: Any, within: str = "") -> dict[str, Path]:
    """Files of messages, of errors and of models anywhere in the fields of an experiment, by field.

    Those are integrity support messages, tables of measured errors, and models of errors and noise in TOML.
    """
    parts = enumerate(content) if isinstance(content, list) else content.items() if isinstance(content, dict) else ()
    found: dict[str, Path] = {}
    for key, value in parts:
        is_one = isinstance(value, str) and (key in ("ism", "file") or _is_model(key, value))
        found |= {f"{within}{key}": Path(value)} if is_one else {}
        found |= named_files(value, f"{within}{key}.")
    return found


def read_files(content: Any, field: str = "") -> list[str]:
    """Names of all files that the fields of an experiment name, each once."""
    if isinstance(content, dict):
        found = [name for key, value in content.items() for name in read_files(value, str(key))]
    elif isinstance(content, list | tuple):
        found = [name for value in content for name in read_files(value, field)]
    else:
        # A true position may stand in the place of a track.
        text = str(content) if isinstance(content, str | Path) else ""
        is_one = (field in _FILES and re.search(r"\.[A-Za-z]", text)) or _is_model(field, text)
        found = [text] if is_one else []
    return list(dict.fromkeys(found))


def without_folders(content: Any, field: str = "") -> Any:
    """The fields of an experiment with the names of files alone in the place of their paths."""
    if isinstance(content, dict):
        return {key: without_folders(value, str(key)) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [without_folders(value, field) for value in content]
    if isinstance(content, Path) or (isinstance(content, str) and (field in _FILES or _is_model(field, content))):
        return re.split(r"[/\\]", str(content))[-1]
    return content


def _is_model(field: object, value: str) -> bool:
    return field in ("error_model", "name") and is_model_file(value)
