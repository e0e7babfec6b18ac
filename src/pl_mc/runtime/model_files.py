"""Files that hold models by their names and options, such as those that a fit to data writes (TOML)."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pl_mc.input_errors import InputError
from pl_mc.runtime.small_files import parsed, read_text

Model = TypeVar("Model")


def is_model_file(name: object) -> bool:
    """Whether what stands in the place of a model's name is the name of a file."""
    return isinstance(name, str) and name.strip().lower().endswith(".toml")


def model_in_file(name: str, part: str, make: Callable[..., Model], **given: Any) -> Model:
    """What ``make`` makes of the table ``part`` of a file, a model's ``name`` and its options, and of those given.

    Raises:
        InputError: no such file, no TOML, no such table, no name in it, or one that is no model; an option twice.
    """
    path = Path(name.strip())
    try:
        content = parsed(read_text(path), tomllib.loads, path=path, what="TOML")
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file.") from None
    table = content.get(part)
    if not isinstance(table, dict) or not isinstance(table.get("name"), str):
        raise InputError(f"{path}: a table [{part}] with a name is needed, as pl_mc.fit_overbound writes it.")
    if is_model_file(table["name"]):
        raise InputError(f"{path}: {part}.name: a model is needed, not another file.")
    for option in given.keys() & table.keys():
        raise InputError(f"{path}: {part}.{option}: the file says it, so that it cannot be given beside the file.")
    try:
        return make(**table, **given)
    except InputError as error:
        raise InputError(f"{path}: {part}: {error}") from None
