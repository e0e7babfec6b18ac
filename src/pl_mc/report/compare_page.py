"""``compare.html``: the page about two runs, complete in itself."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pl_mc.report.charts import charts_of
from pl_mc.report.comparison import Comparison, combined_tables, row_name
from pl_mc.report.page import charts_within_limit, render
from pl_mc.report.page_tables import PageColumn, PageTable, page_table
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import percent

# Rows of the page; all of them are in compare.csv.
_MOST_ROWS = 2_000


def comparison_page(first: RunFolder, second: RunFolder, found: Comparison) -> str:
    """The page as text; what is drawn is what a document of the two says, preferably that of the first."""
    document = first.document or second.document
    charts: list[dict[str, Any]] = []
    if document is not None:
        tables = combined_tables(first, second, found.names)
        charts = charts_within_limit(charts_of(document.tables, tables, val_m=document.val_m))
    return render(
        "compare.html",
        {
            "title": f"{found.names[1]} against {found.names[0]}",
            "runs": [(name, run) for name, run in zip(found.names, (first, second), strict=True)],
            "found": found,
            "fields": _fields(found.fields, found.names),
            "rates": _rates(found) if len(found.rates) else None,
            "charts": charts,
            "folders": [Path(run.folder).as_posix() for run in (first, second)],
        },
    )


def _fields(fields: pd.DataFrame, names: tuple[str, str]) -> PageTable | None:
    if fields.empty:
        return None
    return PageTable(
        title=f"fields that differ: {len(fields)}",
        columns=tuple(PageColumn(label) for label in ("field", *names)),
        rows=tuple(tuple(str(cell) for cell in row) for row in fields.itertuples(index=False)),
        open=True,
    )


def _rates(found: Comparison) -> PageTable:
    """The rates with what differs first, since long tables are cut; all columns are in the file."""
    order = found.rates.assign(size=found.rates.difference.abs())
    order = order.sort_values(["differs", "size"], ascending=False, kind="stable")
    first, second = found.names
    shown = pd.DataFrame(
        {
            "row": [row_name(row) for row in order.to_dict("records")],
            "event": order.event.to_numpy(),
            first: [_counted(row, "first") for row in order.to_dict("records")],
            second: [_counted(row, "second") for row in order.to_dict("records")],
            "difference": order.difference.to_numpy(),
            "low": order.low.to_numpy(),
            "high": order.high.to_numpy(),
            "differs": order.differs.map({True: "yes", False: ""}).to_numpy(),
            "interval": order.interval.to_numpy(),
        }
    )
    return page_table(shown, name="compare", rows=_MOST_ROWS)


def _counted(row: Mapping[str, Any], side: str) -> str:
    return f"{percent(row[f'{side}_rate'])} %, {row[f'{side}_count']:,} of {row[f'{side}_draws']:,}"
