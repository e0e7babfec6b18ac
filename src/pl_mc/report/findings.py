"""What a study found, as data: tables, pictures, blocks of a summary, sentences. Nothing here is written or drawn.

A study returns `Findings`; one writer each makes files of tables and pictures, the summary in Markdown, the page.
What is charted, and what stands below a picture, is said here by the study and guessed nowhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pandas as pd

from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.report.document import Chart, Quantity, Summary
from pl_mc.report.figures import in_common_look

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The events that most readers look for first, in this order.
FIRST_EVENTS = ("alarm", "misleading", "missed", "exceeded")

# Of more methods than these a note names those with the largest shares.
_MOST_TOLD = 6

_TOLD = {
    "unconverged": "Share whose last iteration still moved the position by more than 1 cm",
    "tied": "Share in which satellites that no residual tells apart had one weight below one",
}


@dataclass(frozen=True)
class Table:
    """A table of a study.

    Attributes:
        name: of its files, without ending; words joined by ``_``.
        data: rows and columns; columns carry their units (``bias_m``).
        chart: what of it is drawn on the page, unless nothing.
        stored: ``csv`` with every digit, ``parquet`` for many rows, or ``both``. Tables in Parquet alone are not
            shown on the page.
    """

    name: str
    data: pd.DataFrame
    chart: Chart | None = None
    stored: Literal["csv", "parquet", "both"] = "csv"


@dataclass(frozen=True)
class Picture:
    """A figure of a study, which is drawn when it is written.

    Attributes:
        name: of its files, without ending.
        caption: a sentence that stands below it.
        draw: what draws it, see `pl_mc.report.figures.new_figure`.
    """

    name: str
    caption: str
    draw: Callable[[], Figure]

    @property
    def figure(self) -> Figure:
        """The figure, in the look that is asked for."""
        return in_common_look(self.draw)()


@dataclass(frozen=True)
class Findings:
    """All that a run of a study found.

    Attributes:
        summary: blocks of the summary below its title, see `pl_mc.report.document`; plain text is a paragraph.
        tables: in the order in which the page shows them.
        pictures: those that its tables do not hold all of; they stand behind those that are drawn from the tables.
        notes: sentences about what was left out or chosen.
        rows: folders of stored rows that are kept beside the tables, by the name that they get there.
        texts: further files of text, by their name with ending.
    """

    summary: Summary
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...] = ()
    notes: tuple[str, ...] = ()
    rows: Mapping[str, Path] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def data(self) -> dict[str, pd.DataFrame]:
        """The tables that a page shows, by name."""
        return {table.name: table.data for table in self.tables if table.stored != "parquet"}


def convergence_note(tables: Sequence[Table]) -> tuple[str, ...]:
    """A sentence on draws that had not settled, and on ties, from the first table that counts them; none without."""
    for data in (table.data for table in tables):
        if not {"method", "unconverged", "tied"} <= set(data.columns) or data.empty:
            continue
        counted = next((name for name in ("draws", "count") if name in data), None)
        draws = data[counted] if counted else pd.Series(1, index=data.index)
        said = []
        for column, means in _TOLD.items():
            count = data[column].astype(int)
            parts = []
            for method, rows in data.groupby("method", sort=False).groups.items():
                seen, of = count[rows], draws[rows]
                if seen.any():
                    most = f", at most {(seen / of).max():.2g} in a row of the table" if "draws" in data else ""
                    share = seen.sum() / of.sum()
                    parts.append((share, f"{method} {share:.2g} ({seen.sum():,} of {of.sum():,}){most}"))
            if len(parts) > _MOST_TOLD:
                *told, (share, _) = sorted(parts, reverse=True)[: _MOST_TOLD + 1]
                parts = [*told, (0.0, f"{len(parts) - _MOST_TOLD} more methods, {share:.2g} or less each")]
            said += [f"{means}: {'; '.join(part for _, part in parts)}."] if parts else []
        return tuple(said) or ("Every iteration had settled to 1 cm.",)
    return ()


def event_quantities(table: pd.DataFrame | None = None) -> tuple[Quantity, ...]:
    """The rates of all events of a sweep's table, with bounds and counts, `FIRST_EVENTS` first.

    Those of exclusions are among them where ``table`` has them.
    """
    exclusions = () if table is None else (event for event in EXCLUSIONS if event.count in table)
    count = {event.name: event.count for event in (*EVENTS, *exclusions)}
    return tuple(
        Quantity(name.replace("_", " "), f"{name}_rate", f"{name}_low", f"{name}_high", count[name])
        for name in dict.fromkeys([*FIRST_EVENTS, *count])
    )


def level_quantities() -> tuple[Quantity, ...]:
    """Medians and 5-95 % ranges of protection levels, see `pl_mc.studies.sweep.views.level_table`."""
    return tuple(
        Quantity(f"{pl.upper()}, median and 5-95 % [m]", f"{pl}_50_m", f"{pl}_05_m", f"{pl}_95_m", is_rate=False)
        for pl in ("vpl", "hpl")
    )
