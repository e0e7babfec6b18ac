"""Tables of a page: six digits, the first rows of long ones, columns that know whether they hold numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pl_mc.report.run_folder import flat_fields, value_text

# Rows of a table on a page, and cells of all of them; the files beside the page hold the rest.
MOST_ROWS = 400
MOST_CELLS = 30_000
_OPEN_ROWS = 14


@dataclass(frozen=True)
class PageColumn:
    """Heading of a column, whether it sorts by number, and its cells' style."""

    label: str
    number: bool = False

    @property
    def css(self) -> str:
        """Style of its cells."""
        return "number" if self.number else "wide" if self.label in ("meaning", "value") else ""


@dataclass(frozen=True)
class PageTable:
    """A table of a page, all of it text."""

    title: str
    columns: tuple[PageColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    file: str = ""
    open: bool = False


def page_tables(tables: Mapping[str, pd.DataFrame]) -> list[PageTable]:
    """The tables of a run, the first rows of those that are long."""
    made, cells = [], MOST_CELLS
    for name, table in tables.items():
        width = max(1, len(table.columns))
        rows = min(len(table), MOST_ROWS, max(20, cells // width))
        cells -= rows * width
        made.append(page_table(table, name=name, rows=rows))
    return made


def page_table(table: pd.DataFrame, *, name: str, rows: int = MOST_ROWS) -> PageTable:
    """One table, stored beside the page as ``name.csv``."""
    numbers = [
        bool(pd.api.types.is_numeric_dtype(kind)) and not pd.api.types.is_bool_dtype(kind) for kind in table.dtypes
    ]
    columns = tuple(PageColumn(str(c), number) for c, number in zip(table.columns, numbers, strict=True))
    cells = tuple(tuple(cell(value) for value in row) for row in table.head(rows).itertuples(index=False))
    shown = f"The first {rows:,} of {len(table):,} rows; all of them:" if rows < len(table) else "All rows:"
    return PageTable(
        title=f"{name}: {len(table):,} rows",
        columns=columns,
        rows=cells,
        note=shown,
        file=f"{name}.csv",
        open=len(table) <= _OPEN_ROWS,
    )


def fields_table(experiment: Mapping[str, Any], meanings: Mapping[str, str]) -> PageTable:
    """The fields of an experiment with their values and, where known, meanings."""
    rows = tuple(
        (path, value_text(value), meanings.get(path, "")) for path, value in flat_fields(experiment).items()
    )
    known: Sequence[str] = ("field", "value", "meaning") if any(row[2] for row in rows) else ("field", "value")
    return PageTable(
        title="fields of the experiment",
        columns=tuple(PageColumn(label) for label in known),
        rows=tuple(row[: len(known)] for row in rows),
        open=True,
    )


def cell(value: Any) -> str:
    """A value with six digits; nothing for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)
