"""Numbers as a reader wants them: rates with their intervals, tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pl_mc.statistics.intervals import clopper_pearson


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


def share_text(seen: ArrayLike) -> str:
    """How many of some epochs: ``3: 1.5 % [0.3, 4.3]``, with 95 % Clopper-Pearson bounds."""
    flags = np.asarray(seen, dtype=bool)
    count = int(flags.sum())
    low, high = clopper_pearson(count, flags.size)
    return f"{count}: {rate_text(count, flags.size, float(low), float(high))}"


def event_text(row: Any, event: str) -> str:
    """The rate of one event in a row of a sweep's table, with the bounds that the table gives."""
    rate, low, high = (getattr(row, f"{event}_{part}") for part in ("rate", "low", "high"))
    return rate_text(round(rate * row.draws), int(row.draws), low, high)


def percent(rate: float) -> str:
    """A rate in per cent: three significant digits, of the complement where that is small."""
    value = 100.0 * rate
    if 0 < value < 0.001:
        return f"{value:.2e}"
    if 99.5 < value < 100.0:
        # As many decimals as show two digits of what is missing to 100.
        return f"{value:.{1 - math.floor(math.log10(100.0 - value))}f}"
    return f"{value:.3g}"


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
