"""The document of a run: what its page says, but for the numbers of tables, which lie in files beside it.

It is stored as ``report.json`` and read back from there; Markdown and the page are made from it. Texts may mark
code by backticks and strong words by asterisks, as in Markdown, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from pl_mc.input_errors import InputError
from pl_mc.runtime.whole_files import write_whole

DOCUMENT = "report.json"


@dataclass(frozen=True)
class Heading:
    """A heading within the summary; level 2 is the highest."""

    text: str
    level: int = 2
    form: Literal["heading"] = "heading"


@dataclass(frozen=True)
class Paragraph:
    """One paragraph."""

    text: str
    form: Literal["paragraph"] = "paragraph"


@dataclass(frozen=True)
class Bullets:
    """A list; a list within it belongs to the item before it."""

    items: tuple[str | Bullets, ...]
    form: Literal["bullets"] = "bullets"


@dataclass(frozen=True)
class TextTable:
    """A table of the summary, all of it text."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    form: Literal["table"] = "table"

    @classmethod
    def of(cls, header: Iterable[object], rows: Iterable[Iterable[object]]) -> TextTable:
        """A table of whatever can be said as text."""
        return cls(tuple(map(str, header)), tuple(tuple(map(str, row)) for row in rows))


Block = Annotated[Heading | Paragraph | Bullets | TextTable, Field(discriminator="form")]
# What a study writes of a summary; plain text is a paragraph.
Summary = tuple[Block | str, ...]


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
    count: str | None = None
    is_rate: bool = True


@dataclass(frozen=True)
class Chart:
    """What of a table is drawn on the page.

    Attributes:
        title: heading.
        curves: columns that name the curves.
        quantities: what can be shown.
        menus: columns that, with the curve and ``x``, tell all rows apart; each becomes a menu.
        x, x_label: column of the horizontal axis, and its name.
        logarithmic: whether the vertical axis is, as for probabilities that span many decades.
    """

    title: str
    curves: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    menus: tuple[str, ...] = ()
    x: str = "bias_m"
    x_label: str = "bias [m]"
    logarithmic: bool = False


@dataclass(frozen=True)
class TableEntry:
    """A table of the page, ``name.csv`` beside it."""

    name: str
    chart: Chart | None = None


@dataclass(frozen=True)
class FigureEntry:
    """A figure of the page, ``name.png`` and mostly ``name.svg`` beside it.

    Attributes:
        name: of the files.
        caption: what stands below it.
        alt: what stands in its place where it cannot be seen.
    """

    name: str
    caption: str
    alt: str


@dataclass(frozen=True)
class Document:
    """What a run has to say.

    Attributes:
        title: the experiment's.
        kind: of experiment.
        question: what was asked, in a sentence.
        answer: the answer in sentences with numbers.
        notes: sentences about what was left out or chosen.
        val_m: vertical alert limit, drawn where levels are [m].
        summary: its blocks.
        tables, figures: what lies beside the page.
    """

    title: str
    kind: str
    question: str
    answer: tuple[str, ...]
    notes: tuple[str, ...]
    val_m: float
    summary: tuple[Block, ...]
    tables: tuple[TableEntry, ...]
    figures: tuple[FigureEntry, ...]


_FORM = TypeAdapter(Document)


def write_document(document: Document, folder: Path) -> None:
    """Store a document as ``report.json``."""
    write_whole(folder / DOCUMENT, _FORM.dump_json(document, indent=1) + b"\n")


def read_document(folder: Path) -> Document | None:
    """The document of a results folder; none where the folder is of a version that stored none.

    Raises:
        InputError: a file that is no document.
    """
    path = folder / DOCUMENT
    if not path.is_file():
        return None
    try:
        return _FORM.validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        raise InputError(f"{path}: it is no report of a run ({reason}).") from None
