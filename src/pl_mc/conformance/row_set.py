"""A set of reference numbers of one kind: what a subject is given, what is expected of it, and how closely."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.input_errors import InputError, system_reason


@dataclass(frozen=True)
class Tolerance:
    """The largest deviation that passes: ``absolute`` plus ``relative`` times the size of the reference."""

    absolute: float
    relative: float = 0.0


@dataclass(frozen=True)
class RowSet:
    """Reference numbers of one kind, as one task.

    Attributes:
        name: of the set.
        file: the file that the numbers stand in.
        source: whose they are.
        task: what is asked for, with all settings, in plain words and numbers; it becomes ``task.json``.
        tables: what a subject is given, by the name of its CSV file without the ending.
        expected: a row each, with columns ``keys`` and those of ``tolerances``; its index are the rows of ``file``.
        keys: columns that say which row is which.
        tolerances: by column.
    """

    name: str
    file: str
    source: str
    task: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame]
    expected: pd.DataFrame
    keys: tuple[str, ...]
    tolerances: Mapping[str, Tolerance]


@dataclass
class Folder:
    """CSV files of a folder of vectors.

    Attributes:
        place: the folder.
        lacks: files that others would need, in sentences.
        rows: number of reference rows by file, of those that were read.
    """

    place: Path
    lacks: list[str] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)

    def has(self, *names: str) -> bool:
        """Whether all of some files are there; where only the first is, that is kept in ``lacks``."""
        there = [(self.place / name).is_file() for name in names]
        if there[0] and not all(there):
            missing = [name for name, is_there in zip(names, there, strict=True) if not is_there]
            self.lacks.append(f"{names[0]}: nothing of it is checked without {', '.join(missing)} beside it.")
        return all(there)

    def reference(self, name: str, *columns: str) -> pd.DataFrame:
        """The table of a file of reference numbers, all rows of which are to be checked."""
        table = self.read(name, *columns)
        self.rows[name] = len(table)
        return table

    def read(self, name: str, *columns: str) -> pd.DataFrame:
        """The table of a file, with words where there are words; an `InputError` where it is no such table."""
        path = self.place / name
        try:
            table = pd.read_csv(path)
        except (OSError, ValueError) as error:
            reason = system_reason(error) if isinstance(error, OSError) else str(error).splitlines()[0]
            raise InputError(f"{path}: it cannot be read as a table ({reason}).") from None
        for column in columns:
            if column not in table:
                raise InputError(f"{path}: the column {column} is needed, and there are {', '.join(table.columns)}.")
        return table


def deviations(row_set: RowSet, answers: pd.DataFrame) -> pd.DataFrame:
    """How far answers are from what is expected, by row and column, in units of the tolerance.

    Returns:
        A row for each reference number: ``row`` of the file, ``column``, ``deviation``, ``tolerance``, ``ratio``;
        infinite where there is no answer, or none that is a number.
    """
    keys, expected = list(row_set.keys), row_set.expected
    for key in keys:
        if key not in answers:
            answers = answers.assign(**{key: ""})
    # Keys are compared as words, so that 7, 7.0 and "7" are one.
    index = pd.MultiIndex.from_frame(answers[keys].map(_word))
    found = answers[~index.duplicated()].set_axis(index[~index.duplicated()])
    wanted = pd.MultiIndex.from_frame(expected[keys].map(_word))
    parts = []
    for column, tolerance in row_set.tolerances.items():
        reference = pd.to_numeric(expected[column], errors="coerce").to_numpy(float)
        given = found[column] if column in found else pd.Series(np.nan, index=found.index)
        answer = pd.to_numeric(given.reindex(wanted), errors="coerce").to_numpy(float)
        asked = np.isfinite(reference)
        off = np.abs(answer - reference)
        allowed = tolerance.absolute + tolerance.relative * np.abs(reference)
        off = np.where(np.isfinite(off), off, np.inf)
        ratio = off / allowed
        table = {"row": expected.index, "column": column, "deviation": off, "tolerance": allowed, "ratio": ratio}
        parts.append(pd.DataFrame(table)[asked])
    return pd.concat(parts, ignore_index=True)


def _word(value: Any) -> str:
    if isinstance(value, float) and np.isnan(value):
        return ""
    return f"{value:g}" if isinstance(value, int | float | np.number) else str(value)
