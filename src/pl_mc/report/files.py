"""Findings as files: tables in CSV and Parquet, pictures, stored rows, the summary, the document.

The summary is Markdown; it is read back where a version stored nothing else.
"""

from __future__ import annotations

import io
import itertools
import re
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode

from pl_mc.report.document import (
    Block,
    Bullets,
    Document,
    FigureEntry,
    Heading,
    Paragraph,
    TableEntry,
    TextTable,
    write_document,
)  # fmt: skip
from pl_mc.report.figures import save_figure
from pl_mc.report.findings import Findings, Picture, convergence_note
from pl_mc.report.look import USUAL, Look, drawn_in
from pl_mc.report.run_folder import SUMMARY, StoredTables
from pl_mc.report.text import markdown_table
from pl_mc.runtime.whole_files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What is only a number says nothing about a picture; powers of ten on an axis are set as mathematics.
_NUMBER = re.compile(r"(?:[\s\d.,:%+\-−–eE^{}$×]|\\mathdefault|\\times)*")
_MOST_WORDS = 40


def write_findings(
    findings: Findings,
    folder: Path,
    *,
    title: str,
    kind: str,
    question: str,
    answer: tuple[str, ...],
    val_m: float | None,
    hal_m: float | None = None,
    pictures: Callable[[Mapping[str, pd.DataFrame]], Iterable[Picture]] = lambda tables: (),
    look: Look = USUAL,
) -> Document:
    """Write all files of a run but its manifest and page.

    Args:
        findings: what was found.
        folder: an empty folder.
        title, kind, question, answer, val_m, hal_m: see `Document`.
        pictures: makes those of the tables, as they are read back from the folder.
        look: how pictures are drawn.

    Returns:
        The document, which is stored too.
    """
    # What a new kind of experiment gets wrong most easily, and would see only in its files.
    if isinstance(findings.summary, str) or isinstance(answer, str):
        raise TypeError(f"{kind}: summary and answer are tuples, of blocks and of sentences, not one text each")
    names = [table.name for table in findings.tables]
    if len(set(names)) < len(names):
        raise ValueError(f"{kind}: two tables have one name ({', '.join(names)})")
    for table in findings.tables:
        write_table(table.data, folder, table.name, stored=table.stored)
    figures, why = write_pictures([*pictures(StoredTables(folder)), *findings.pictures], folder, look, title)
    undrawn = tuple(f"The figure {name} could not be drawn ({reason})." for name, reason in why.items())
    # Several tables of one geometry say the same of it.
    notes = tuple(dict.fromkeys((*findings.notes, *convergence_note(findings.tables), *undrawn)))
    for name, rows in findings.rows.items():
        shutil.copytree(rows, folder / name, ignore=shutil.ignore_patterns(".*"), dirs_exist_ok=True)
    for name, text in findings.texts.items():
        write_whole(folder / name, text)
    document = Document(
        title=title, kind=kind, question=question, answer=answer, notes=notes, val_m=val_m, hal_m=hal_m,
        summary=tuple(Paragraph(block) if isinstance(block, str) else block for block in findings.summary),
        tables=tuple(TableEntry(table.name, table.chart) for table in findings.tables if table.stored != "parquet"),
        figures=figures,
    )  # fmt: skip
    write_whole(folder / SUMMARY, to_markdown(title, document.summary, document.notes))
    write_document(document, folder)
    return document


def write_pictures(
    pictures: Iterable[Picture], folder: Path, look: Look, title: str
) -> tuple[tuple[FigureEntry, ...], dict[str, str]]:
    """Draw and write pictures: what is said of each, and by name why others could not be drawn."""
    made, why = [], {}
    with drawn_in(look):
        for picture in pictures:
            figure = picture.figure
            reason = save_figure(figure, folder, picture.name)
            if reason:
                why[picture.name] = reason
            else:
                made.append(_entry(picture, figure, title))
    return tuple(made), why


def write_table(table: pd.DataFrame, folder: Path, name: str, *, stored: str = "csv") -> None:
    """``name.csv`` with every digit, ``name.parquet``, or both."""
    if stored != "parquet":
        write_whole(folder / f"{name}.csv", table.to_csv(index=False, lineterminator="\n"))
    if stored != "csv":
        content = io.BytesIO()
        table.to_parquet(content, index=False, compression="zstd")
        write_whole(folder / f"{name}.parquet", content.getvalue())


def _entry(picture: Picture, figure: Figure, title: str) -> FigureEntry:
    """The caption, and for those who do not see it the words that are drawn: headings, axes, names of curves."""
    from matplotlib.text import Text

    texts = [artist for artist in figure.findobj(Text) if isinstance(artist, Text) and artist.get_visible()]
    words = dict.fromkeys(" ".join(text.get_text().split()) for text in texts)
    drawn = [word for word in words if word != title and not _NUMBER.fullmatch(word)]
    more = f"; and {len(drawn) - _MOST_WORDS} more" if len(drawn) > _MOST_WORDS else ""
    content = f"Drawn in it: {'; '.join(drawn[:_MOST_WORDS])}{more}." if drawn else f"{title}."
    return FigureEntry(picture.name, picture.caption, f"{picture.caption} {content}")


def to_markdown(title: str, blocks: Iterable[Block], notes: Sequence[str] = ()) -> str:
    """A summary: its title, the blocks, and the notes as a list."""
    parts = [f"# {title}", *map(_block, blocks)]
    if notes:
        parts += ["Notes:", _bullets(notes)]
    return "\n\n".join(parts) + "\n"


def from_markdown(text: str) -> tuple[Block, ...]:
    """The blocks of a summary, without its title and notes."""
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    blocks = map(_of_node, SyntaxTreeNode(parser.parse(text)).children)
    shown = itertools.takewhile(lambda block: block != Paragraph("Notes:"), blocks)
    return tuple(block for block in shown if block is not None)


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {block.text}"
    if isinstance(block, Bullets):
        return _bullets(block.items)
    if isinstance(block, TextTable):
        return markdown_table(block.header, block.rows)
    return block.text


def _bullets(items: Iterable[str | Bullets], indent: str = "") -> str:
    return "\n".join(
        f"{indent}- {item}" if isinstance(item, str) else _bullets(item.items, f"{indent}  ") for item in items
    )


def _of_node(node: SyntaxTreeNode) -> Block | None:
    if node.type == "heading":
        return Heading(_text(node), level=int(node.tag[1:])) if node.tag != "h1" else None
    if node.type == "bullet_list":
        return _list(node)
    if node.type == "table":
        header, *bodies = node.children
        rows = tuple(tuple(_text(cell) for cell in row.children) for body in bodies for row in body.children)
        return TextTable(tuple(_text(cell) for cell in header.children[0].children), rows)
    return Paragraph(_text(node))


def _list(node: SyntaxTreeNode) -> Bullets:
    parts = [part for item in node.children for part in item.children]
    return Bullets(tuple(_list(part) if part.type == "bullet_list" else _text(part) for part in parts))


def _text(node: SyntaxTreeNode) -> str:
    return " ".join(child.content for child in node.children if child.type == "inline") or node.content
