"""Numbers as a reader wants them: rates with their intervals, tables in Markdown."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pl_mc.alert import VERTICAL, Judged
from pl_mc.report.figures import method_label
from pl_mc.statistics.intervals import clopper_pearson

# The events of which an answer has a sentence each.
ANSWERED = ("alarm", "misleading", "missed")

Key = TypeVar("Key")
Value = TypeVar("Value")


def rate_text(count: int, total: int, low: float, high: float) -> str:
    """``12.3 % [11.9, 12.7]``; where nothing was counted the upper bound, since zero events are not zero risk."""
    if total == 0:
        return "no draw"
    if count == 0:
        return f"0 (< {percent(high)} %)"
    if count == total:
        return f"all (> {percent(low)} %)"
    # A lower bound that small says nothing; with one or two events it is a tail of a continued formula.
    lower = percent(low) if low > 1e-10 else "0"
    return f"{percent(count / total)} % [{lower}, {percent(high)}]"


def counted_rate(count: int, total: int) -> str:
    """The rate of what was counted, with 95 % Clopper-Pearson bounds."""
    low, high = clopper_pearson(count, total)
    return rate_text(count, total, float(low), float(high))


def share_text(seen: ArrayLike) -> str:
    """How many of some epochs: ``3: 1.5 % [0.3, 4.3]``, with 95 % Clopper-Pearson bounds."""
    flags = np.asarray(seen, dtype=bool)
    count = int(flags.sum())
    return f"{count}: {counted_rate(count, flags.size)}"


def share_of(count: int, total: int) -> str:
    """``3 of 200 (1.5 % [0.3, 4.3])``, with 95 % Clopper-Pearson bounds."""
    return f"{count} of {total:,} ({counted_rate(count, total)})" if total else "0 of 0"


def row_rate(row: Any, count: str, total: str, bounds: str = "") -> str:
    """The rate that a row counted, by its columns, and its bounds, whose names begin with ``bounds``."""
    return rate_text(int(row[count]), int(row[total]), row[f"{bounds}low"], row[f"{bounds}high"])


def event_text(row: Any, event: str) -> str:
    """The rate of one event in a row of a sweep's table, with the bounds that the table gives."""
    rate, low, high = (getattr(row, f"{event}_{part}") for part in ("rate", "low", "high"))
    return rate_text(round(rate * row.draws), int(row.draws), low, high)


def percent(rate: float) -> str:
    """A rate in per cent: three significant digits, of the complement where that is small."""
    value = 100.0 * rate
    if 0 < value < 0.001:
        return _plain_power(f"{value:.2e}")
    if 99.5 < value < 100.0:
        # As many decimals as show two digits of what is missing to 100.
        return f"{value:.{1 - math.floor(math.log10(100.0 - value))}f}"
    return f"{value:.3g}"


def probability_text(value: float) -> str:
    """A probability: three significant digits, of the complement where that is small."""
    if 0.995 < value < 1.0:
        return f"{value:.{1 - math.floor(math.log10(1.0 - value))}f}"
    return _plain_power(f"{value:.3g}")


def _plain_power(number: str) -> str:
    """``1.27e-4``, as tables and charts have it, for Python's ``1.27e-04``."""
    return re.sub(r"e([+-])0*(?=\d)", lambda power: f"e{power[1].strip('+')}", number)


def metres(value: float) -> str:
    """A length with four significant digits below 100 m, to the decimetre beyond; a dash where there is none."""
    if math.isnan(value):
        return "-"
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.2f}" if abs(value) < 100 else f"{value:.1f}"


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table whose columns are padded, so that it also reads well as plain text."""
    # A bar inside a cell would end it.
    cells = [[str(cell).replace("|", "\\|") for cell in row] for row in (header, *rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in cells]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def method_key(names: Iterable[str], axis: str = VERTICAL) -> str:
    """``ls: least squares (VPL); igg3: IGG-III (VPL_R).``, of the methods whose label says more than their name."""
    labels = {name: method_label(name, axis) for name in names}
    return "; ".join(f"{name}: {label}" for name, label in labels.items() if label != name) + "."


def listed(words: Sequence[str]) -> str:
    """``a, b and c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def grouped(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, list[Value]]:
    """The second parts of pairs by the first, all in order of appearance."""
    groups: dict[Key, list[Value]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups


def by_method(rows: Iterable[Any], words: Callable[[Any], str], axis: str = VERTICAL) -> str:
    """``least squares (VPL) in 3 of 200; IGG-III (VPL_R) in 2 of 200``: words about rows that have a method."""
    return "; ".join(f"{method_label(str(row.method), axis)} {words(row)}" for row in rows)


def span(low: int, high: int, between: str = "-") -> str:
    """``16-19``, or one number where both are the same."""
    return f"{low}" if low == high else f"{low}{between}{high}"


def event_sentences(table: pd.DataFrame, judged: Judged) -> tuple[str, ...]:
    """A sentence for each event of `ANSWERED`: at which fault it is most frequent, method by method.

    Args:
        table: rates of the axis, one row per method and fault.
        judged: the axis with its limits.
    """
    sentences = []
    for event in ANSWERED:
        # Methods of which the same is to be said share one clause.
        by_name = table.groupby("method", sort=False)
        said = grouped((_most(group, event), method_label(str(name), judged.axis)) for name, group in by_name)
        clauses = "; ".join(f"{listed(names)} {what}" for what, names in said.items())
        sentences.append(f"{judged.means(event)}: {clauses}.")
    return tuple(sentences)


def _most(group: pd.DataFrame, event: str) -> str:
    rate = group[f"{event}_rate"]
    if not rate.max() > 0:
        # Faults that share their noise have fewer independent draws than draws.
        draws = group["independent_draws" if "independent_draws" in group else "draws"]
        faults = f"any of {len(group)} faults" if len(group) > 1 else "the one fault"
        return (
            f"never, under {faults}, with at least {int(draws.min()):,} draws of noise each "
            f"(below {percent(group[f'{event}_high'].max())} %)"
        )
    return f"most often at {group.loc[rate.idxmax(), 'fault']}, {event_text(group.loc[rate.idxmax()], event)}"
