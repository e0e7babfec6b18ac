"""Interactive charts of a page: the data of what a study says is to be drawn, see `pl_mc.report.document.Chart`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from pl_mc.alert import EITHER, VERTICAL
from pl_mc.input_errors import InputError
from pl_mc.report.columns import LITERATURE
from pl_mc.report.document import Chart, Quantity, TableEntry
from pl_mc.report.figures import method_label

# Points of one chart; beyond them it would weigh more than the rest of the page.
MOST_ROWS = 10_000

# Beyond this number of rows only the first quantities are drawn.
_MANY_ROWS, _FEW_QUANTITIES = 1_000, 4

# Points that most curves have at the least; fewer are better read in the table.
_FEWEST_POINTS = 3

# What menus are called whose column has a name that a chart needs for itself.
_MENUS = {"axis": "limits that decide"}


def charts_of(
    entries: Iterable[TableEntry],
    tables: Mapping[str, pd.DataFrame],
    *,
    val_m: float | None = None,
    hal_m: float | None = None,
    short: Mapping[str, str] | None = None,
) -> list[dict[str, Any]]:
    """The charts of a run, ready for JSON; see ``html/chart.js`` for what it does with them.

    Args:
        entries: tables and what of them is drawn.
        tables: the tables by name.
        val_m, hal_m: alert limits, drawn where a quantity is a level of their axis [m].
        short: short names of methods by whole ones.

    Raises:
        InputError: a table without a column that its chart names, or with words in one of numbers.
    """
    drawn = ((entry.name, entry.chart) for entry in entries if entry.name in tables)
    limits = {"vpl": ("VAL", val_m), "hpl": ("HAL", hal_m)}
    made = (chart_data(name, chart, tables[name], limits, short) for name, chart in drawn if chart is not None)
    return [chart for chart in made if chart is not None]


def chart_data(
    name: str,
    chart: Chart,
    table: pd.DataFrame,
    limits: Mapping[str, tuple[str, float | None]],
    short: Mapping[str, str] | None = None,
) -> dict[str, Any] | None:
    """The data of one chart; None where no curves can be drawn.

    ``limits`` are a name and a length [m] by the word with which columns of a level begin.

    That is where the table has too many rows, most curves too few points, or nothing tells some of the rows apart.
    """
    needed = [(each.value, each.low, each.high, each.count) for each in chart.quantities]
    columns = [*chart.curves, *chart.menus, chart.x, *filter(None, itertools.chain(*needed))]
    absent = [column for column in columns if column not in table]
    if absent:
        raise InputError(f"{name}: its chart needs columns that are not there: {', '.join(absent)}.")
    numbers = [chart.x, *itertools.chain(*((each.value, each.low, each.high) for each in chart.quantities))]
    words = next((column for column in numbers if not pd.api.types.is_numeric_dtype(table[column])), None)
    if words is not None:
        raise InputError(f"{name}.csv: {words}: its chart needs a number in every row.")
    table = table[table[chart.x].notna()]
    # A column that is the same everywhere needs no menu.
    menus = [menu for menu in chart.menus if table[menu].nunique() > 1]
    keys = [*chart.curves, *menus]
    sizes = table.groupby(keys, sort=False, dropna=False)[chart.x].nunique()
    if not len(sizes) or len(table) > MOST_ROWS or float(sizes.median()) < _FEWEST_POINTS:
        return None
    if table.duplicated([*keys, chart.x]).any():
        return None
    quantities = [quantity for quantity in chart.quantities if table[quantity.value].notna().any()]
    if len(table) > _MANY_ROWS:
        quantities = quantities[:_FEW_QUANTITIES]
    # Curves that are of both levels are called by neither.
    both = any(quantity.value.startswith("hpl") for quantity in quantities) or "axis" in menus
    axis = EITHER if both else str(table["axis"].iloc[0]) if "axis" in table else VERTICAL
    short = {} if short is None else short
    parts = table[list(chart.curves)].astype(str).replace({"method": short} if "method" in chart.curves else {})
    curves = parts.agg(", ".join, axis=1).map(lambda name: method_label(name, axis))
    names = list(dict.fromkeys(curves))
    choices = [list(dict.fromkeys(table[menu].dropna().astype(str))) for menu in menus]
    fullest = table.groupby(menus, sort=False)[chart.x].nunique().idxmax() if menus else ()
    begin = fullest if isinstance(fullest, tuple) else (fullest,)
    cells: list[Sequence[Any]] = [
        [names.index(curve) for curve in curves],
        *([_place(value, values) for value in table[menu]] for menu, values in zip(menus, choices, strict=True)),
        _shorts(table[chart.x]),
        _wholes(table, "draws"),
    ]
    for quantity in quantities:
        bounds = (quantity.value, quantity.low, quantity.high)
        cells += [*(_shorts(table[column]) for column in bounds), _wholes(table, quantity.count)]
    return {
        "id": name,
        "file": f"{name}.csv",
        "title": chart.title,
        "x": chart.x_label,
        "curves": names,
        "menus": [
            {
                "label": _MENUS.get(menu, menu.replace("_", " ")),
                "values": values,
                "begin": max(0, _place(first, values)),
            }
            for menu, values, first in zip(menus, choices, begin, strict=True)
        ],
        "quantities": [
            {"label": _in_words(quantity), "rate": quantity.is_rate}
            | ({} if quantity.is_rate else {"bounds": quantity.bounds})
            | _limit(quantity.value, limits)
            for quantity in quantities
        ],
        "log": chart.logarithmic,
        **({} if chart.gap is None else {"gap": chart.gap}),
        "rows": [list(row) for row in zip(*cells, strict=True)],
    }


def _in_words(quantity: Quantity) -> str:
    """What is drawn, with what the literature calls it."""
    short, name = LITERATURE.get(quantity.label, ("", ""))
    return f"{name} ({short})" if short else quantity.label


def _limit(column: str, limits: Mapping[str, tuple[str, float | None]]) -> dict[str, Any]:
    name, limit_m = limits.get(column.partition("_")[0], ("", None))
    return {} if limit_m is None else {"limit": {"name": name, "m": limit_m}}


def _place(value: Any, values: Sequence[str]) -> int:
    """The place in a menu; -1 for rows that belong to every choice, such as those without a fault."""
    text = str(value)
    return values.index(text) if text in values else -1


def _shorts(column: pd.Series) -> list[float | None]:
    return [None if value is None or not math.isfinite(value) else float(f"{value:.4g}") for value in column]


def _wholes(table: pd.DataFrame, column: str | None) -> list[int | None]:
    """Counts of a column; nothing where the table has none."""
    if column not in table:
        return [None] * len(table)
    return [None if pd.isna(value) else int(value) for value in table[column]]
