"""Interactive charts of a page: which columns of a table are rates with bounds against a bias, and their data.

Nothing here knows a kind of experiment. A table is drawn where it has ``bias_m`` with several values, a column that
names the curves, and rates with bounds (or quantiles of a level); columns that tell rows apart otherwise become
menus.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pl_mc.report.figures import method_label
from pl_mc.report.run_folder import RunFolder

# Points of one chart; beyond them it would weigh more than the rest of the page.
MOST_ROWS = 10_000

# Beyond this number of rows only the first events are drawn.
_MANY_ROWS, _FEW_QUANTITIES = 1_000, 4

_CURVES = ("variant", "method", "test")
_MENUS = ("event", "level", "noise", "geometry", "fault_class", "satellite", "satellites", "epoch", "target")
_PLAIN_RATES = ("detection_rate", "probability", "rate")
_FIRST = ("alarm", "misleading", "missed", "exceeded")
_HIDDEN = frozenset({"p_fa"})


@dataclass(frozen=True)
class Quantity:
    """One thing that a chart can show: a value with bounds, and where the count is.

    Attributes:
        label: what it is, for the menu and the axis.
        value, low, high: columns.
        count: column of the number of events, where the table has one.
        is_rate: whether it is a probability; else metres.
    """

    label: str
    value: str
    low: str
    high: str
    count: str | None
    is_rate: bool


def charts_of(run: RunFolder) -> list[dict[str, Any]]:
    """The charts of all tables of a run, ready for JSON; see ``html/chart.js`` for what it does with them."""
    made = [chart for name, table in run.tables.items() if (chart := _chart(name, table, run)) is not None]
    # Alarms and probabilities are what most readers look for first.
    return sorted(made, key=lambda chart: chart["quantities"][0]["label"] not in (_FIRST[0], "probability"))


def _chart(name: str, table: pd.DataFrame, run: RunFolder) -> dict[str, Any] | None:
    curve = next((column for column in _CURVES if column in table), None)
    quantities = _quantities(table)
    if curve is None or not quantities or "bias_m" not in table or len(table) > MOST_ROWS:
        return None
    table = table[table["bias_m"].notna()]
    keys = [curve, *(["reading"] if curve == "test" and "reading" in table else [])]
    menus = _menus(table, keys)
    if menus is None or not _is_ramp(table, [*keys, *menus]):
        return None
    curves = table[keys].astype(str).agg(", ".join, axis=1).map(method_label)
    names = list(dict.fromkeys(curves))
    choices = [list(dict.fromkeys(table[menu].dropna().astype(str))) for menu in menus]
    if len(table) > _MANY_ROWS:
        quantities = quantities[:_FEW_QUANTITIES]
    fullest = table.groupby(menus, sort=False)["bias_m"].nunique().idxmax() if menus else ()
    begin = fullest if isinstance(fullest, tuple) else (fullest,)
    columns: list[Sequence[Any]] = [
        [names.index(one) for one in curves],
        *([_place(one, values) for one in table[menu]] for menu, values in zip(menus, choices, strict=True)),
        [_short(one) for one in table["bias_m"]],
        [_whole(one) for one in table["draws"]] if "draws" in table else [None] * len(table),
    ]
    for quantity in quantities:
        for column in (quantity.value, quantity.low, quantity.high):
            columns.append([_short(one) for one in table[column]])
        counts = table[quantity.count] if quantity.count else [None] * len(table)
        columns.append([_whole(one) for one in counts])
    return {
        "id": name,
        "file": f"{name}.csv",
        "x": "bias [m]",
        "curves": names,
        "menus": [
            {"label": menu.replace("_", " "), "values": values, "begin": max(0, _place(first, values))}
            for menu, values, first in zip(menus, choices, begin, strict=True)
        ],
        "quantities": [{"label": q.label, "rate": q.is_rate} for q in quantities],
        "limit": run.alert.vertical_m,
        # A probability that spans many decades says nothing on a linear axis.
        "log": "probability" in table,
        "rows": [list(row) for row in zip(*columns, strict=True)],
    }


def _quantities(table: pd.DataFrame) -> list[Quantity]:
    found = []
    for column in table.columns:
        stem = column.removesuffix("_rate")
        if column.endswith("_rate") and {f"{stem}_low", f"{stem}_high"} <= set(table) and stem not in _HIDDEN:
            count = next((c for c in (f"{stem}s", f"{stem}_count", stem) if c in table), None)
            label = stem.replace("_", " ")
            found.append(Quantity(label, column, f"{stem}_low", f"{stem}_high", count, True))
        elif column.endswith("_50_m"):
            stem = column.removesuffix("_50_m")
            bounds = f"{stem}_05_m", f"{stem}_95_m"
            if set(bounds) <= set(table):
                found.append(Quantity(f"{stem.upper()}, median and 5-95 % [m]", column, *bounds, None, False))
        elif column in _PLAIN_RATES and {"low", "high"} <= set(table):
            count = next((c for c in ("detections", "count") if c in table), None)
            label = column.removesuffix("_rate").replace("_", " ")
            found.append(Quantity(label, column, "low", "high", count, True))
    order = {name: k for k, name in enumerate(_FIRST)}
    known = [q for q in found if table[q.value].notna().any()]
    return sorted(known, key=lambda q: order.get(q.label, len(order)))


def _menus(table: pd.DataFrame, keys: Sequence[str]) -> list[str] | None:
    """Columns that, with the curve and the bias, tell all rows apart; None where no such columns are known."""
    # Those with the fewest values first, so that a menu that says the same as another is never made.
    candidates = [c for c in _MENUS if c in table and table[c].nunique() > 1]
    menus = [c for c in candidates if c in ("event", "level")]
    for column in [None, *(c for c in candidates if c not in menus)]:
        if column is not None:
            menus.append(column)
        if not table.duplicated([*keys, *menus, "bias_m"]).any():
            return menus
    return None


def _is_ramp(table: pd.DataFrame, keys: Sequence[str]) -> bool:
    """Whether most curves have at least three points."""
    sizes = table.groupby(list(keys), sort=False, dropna=False)["bias_m"].nunique()
    return bool(len(sizes)) and float(sizes.median()) >= 3


def _place(value: Any, values: Sequence[str]) -> int:
    """The place in a menu; -1 for rows that belong to every choice, such as those without a fault."""
    text = str(value)
    return values.index(text) if text in values else -1


def _short(value: float) -> float | None:
    return None if value is None or not math.isfinite(value) else float(f"{value:.4g}")


def _whole(value: Any) -> int | None:
    return None if value is None or pd.isna(value) else int(value)
