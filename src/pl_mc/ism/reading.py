"""Integrity support messages out of what users write: a record, a table, or a CSV file with a satellite a line."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pl_mc.input_errors import InputError, nearest, require_path, shown
from pl_mc.ism.codes import LETTERS
from pl_mc.ism.message import FIELDS, RULES, Ism, require_satellite
from pl_mc.runtime.small_files import read_text

SATELLITE = "satellite"

_FORMS = "an Ism, a table of its fields, or the path of a CSV file, is needed"


def as_ism(given: Any, *, field: str = "ism") -> Ism:
    """An ISM from a record, a table or the path of a file.

    Args:
        given: an `Ism`; a mapping from its fields to numbers or to tables by satellite and constellation, or from
            satellites and constellations to tables of its fields; or the path of a CSV file, see `read_ism`.
        field: what it is called in the sentences of errors.

    Raises:
        InputError: what is none of these, and whatever `Ism` and `read_ism` refuse.
    """
    if isinstance(given, Ism):
        return given
    if isinstance(given, str | Path):
        return read_ism(given)
    if not isinstance(given, Mapping):
        raise InputError(f"{field}: {_FORMS}, not {shown(given)}.")
    content = {key: value for key, value in given.items() if key != "name"}
    if any(key in FIELDS for key in content):
        for key in content:
            if key not in FIELDS:
                raise InputError(f"{field}: the field {shown(key)} is unknown ({nearest(str(key), FIELDS)}).")
    else:
        content = _by_field(content, field)
    return Ism(**content, name=given.get("name", "own"), source=field)


def _by_field(content: Mapping[str, Any], field: str) -> dict[str, dict[str, Any]]:
    """Tables by satellite as tables by field."""
    found: dict[str, dict[str, Any]] = {}
    for key, table in content.items():
        if not isinstance(table, Mapping):
            close = nearest(str(key), [*FIELDS, *LETTERS])
            raise InputError(f"{field}: {shown(key)} is no field, and no satellite with a table of fields ({close}).")
        require_satellite(field, key)
        for name, value in table.items():
            if name not in FIELDS:
                raise InputError(f"{field}: {key}: the field {shown(name)} is unknown ({nearest(str(name), FIELDS)}).")
            found.setdefault(name, {})[key] = value
    return found


def read_ism(path: str | Path) -> Ism:
    """An ISM from a CSV file with a satellite or a constellation a line.

    The first line names the columns: ``satellite`` (G07, or the letter of a constellation) and any fields of `Ism`,
    in any order. An empty cell says nothing of that field. Empty lines and lines that begin with # are passed over.

    Raises:
        InputError: a file that cannot be read; a column, satellite or value that cannot be used, with its line; a
            satellite that is there twice.
    """
    path = require_path(path, field="ism")
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(f"ism: {path}: there is no such file.") from None
    rows = [
        (number, [cell.strip() for cell in cells])
        for number, cells in _cells(text.removeprefix("\ufeff"), path)
        if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#")
    ]
    if not rows:
        raise InputError(f"{path}: it is empty; a first line such as '{SATELLITE},{','.join(FIELDS)}' is needed.")
    columns = _columns(f"{path}: line {rows[0][0]}", rows[0][1])
    place, lines, found = columns.index(SATELLITE), dict[str, int](), dict[str, dict[str, float]]()
    for number, cells in rows[1:]:
        where = f"{path}: line {number}"
        if len(cells) != len(columns):
            raise InputError(f"{where}: {len(columns)} cells are needed, as in the first line, not {len(cells)}.")
        name = require_satellite(f"{where}: {SATELLITE}", cells[place])
        if lines.setdefault(name, number) != number:
            raise InputError(f"{where}: {SATELLITE}: {name} is there already, in line {lines[name]}.")
        for field, cell in zip(columns, cells, strict=True):
            if field != SATELLITE and cell:
                found.setdefault(field, {})[name] = RULES[field].checked(f"{where}: {field}", _number(cell))
    if not lines:
        raise InputError(f"{path}: it has no line for a satellite or a constellation.")
    return Ism(**found, name=path.name, source=str(path))


def _cells(text: str, path: Path) -> list[tuple[int, list[str]]]:
    """The cells of each line with its number, from 1."""
    reader = csv.reader(text.splitlines(), strict=True)
    try:
        return [(reader.line_num, cells) for cells in reader if cells]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: it is no line of a CSV file ({error}).") from None


def _columns(where: str, names: list[str]) -> list[str]:
    for name in names:
        if name != SATELLITE and name not in FIELDS:
            raise InputError(f"{where}: the column {shown(name)} is unknown ({nearest(name, [SATELLITE, *FIELDS])}).")
        if names.count(name) > 1:
            raise InputError(f"{where}: the column {name} is there twice.")
    if SATELLITE not in names or len(names) == 1:
        lacks = SATELLITE if SATELLITE not in names else f"of a field ({', '.join(FIELDS)})"
        raise InputError(f"{where}: the column {lacks} is missing.")
    return names


def _number(cell: str) -> float | str:
    """The number that a cell holds, or its text, which is none."""
    try:
        return float(cell) if "_" not in cell else cell
    except ValueError:
        return cell
