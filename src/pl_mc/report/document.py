"""The document of a run: what its page says, but for the numbers of tables, which lie in files beside it.

It is stored as ``report.json`` and read back from there; Markdown and the page are made from it. Texts may mark
code by backticks and strong words by asterisks, as in Markdown, and nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from pl_mc.input_errors import InputError, shown
from pl_mc.runtime.small_files import parsed_json, read_text
from pl_mc.runtime.whole_files import write_whole

DOCUMENT = "report.json"

# A field that is not known is a slip, or of a later version.
_ALL_KNOWN = ConfigDict(extra="forbid")


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class Heading:
    """A heading within the summary; level 2 is the highest."""

    text: str
    level: int = 2
    form: Literal["heading"] = "heading"


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class Paragraph:
    """One paragraph."""

    text: str
    form: Literal["paragraph"] = "paragraph"


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class Bullets:
    """A list; a list within it belongs to the item before it."""

    items: tuple[str | Bullets, ...]
    form: Literal["bullets"] = "bullets"


@with_config(_ALL_KNOWN)
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


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class Quantity:
    """One thing that a chart can show: a value with bounds, and where the count is.

    Attributes:
        label: what it is, for the menu and the axis.
        value, low, high: columns.
        count: column of the number of events, where the table has one.
        is_rate: whether it is a probability; else metres.
        bounds: what bounds of metres are.
    """

    label: str
    value: str
    low: str
    high: str
    count: str | None = None
    is_rate: bool = True
    bounds: str = "5-95 %"


@with_config(_ALL_KNOWN)
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
        gap: steps of ``x`` that no line goes across are longer; None where lines go across all.
    """

    title: str
    curves: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    menus: tuple[str, ...] = ()
    x: str = "bias_m"
    x_label: str = "bias [m]"
    logarithmic: bool = False
    gap: float | None = None


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class TableEntry:
    """A table of the page, ``name.csv`` beside it."""

    name: str
    chart: Chart | None = None


@with_config(_ALL_KNOWN)
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


@with_config(_ALL_KNOWN)
@dataclass(frozen=True)
class Document:
    """What a run has to say.

    Attributes:
        title: the experiment's.
        kind: of experiment.
        question: what was asked, in a sentence.
        answer: the answer in sentences with numbers.
        notes: sentences about what was left out or chosen.
        val_m, hal_m: vertical and horizontal alert limit, drawn where levels are [m]; none where there is none.
        summary: its blocks.
        tables, figures: what lies beside the page.
    """

    title: str
    kind: str
    question: str
    answer: tuple[str, ...]
    notes: tuple[str, ...]
    val_m: float | None
    summary: tuple[Block, ...]
    tables: tuple[TableEntry, ...]
    figures: tuple[FigureEntry, ...]
    hal_m: float | None = None


_NAME = re.compile(r"[A-Za-z0-9_][\w+-]{0,99}(?:\.[\w+-]+)*")
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
    content = parsed_json(read_text(path), path=path)
    try:
        document = _FORM.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"]))[:80]
        raise InputError(f"{path}: it is no report of a run ({where}: {first['msg']}).") from None
    named = {"kind": [document.kind], "tables": [], "figures": []}
    named |= {field: [one.name for one in getattr(document, field)] for field in ("tables", "figures")}
    for field, names in named.items():
        for name in names:
            # They become names of files beside the page.
            if not _NAME.fullmatch(name):
                raise InputError(f"{path}: it is no report of a run ({field}: {shown(name)} is no name).")
        if len(set(names)) < len(names):
            raise InputError(f"{path}: it is no report of a run ({field}: two have one name).")
    return document
