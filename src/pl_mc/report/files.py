"""Findings as files: tables in CSV and Parquet, pictures in PNG and SVG, stored rows, the summary, the document."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pandas as pd
from matplotlib.text import Text

from pl_mc.report.document import Document, FigureEntry, TableEntry, write_document
from pl_mc.report.figures import save_figure
from pl_mc.report.findings import Findings, Picture
from pl_mc.report.markdown import to_markdown
from pl_mc.report.run_folder import SUMMARY

# What is only a number says nothing about a picture; powers of ten on an axis are set as mathematics.
_NUMBER = re.compile(r"(?:[\s\d.,:%+\-−–eE^{}$×]|\\mathdefault|\\times)*")
_MOST_WORDS = 40


def write_findings(
    findings: Findings, folder: Path, *, title: str, kind: str, question: str, answer: tuple[str, ...], val_m: float
) -> Document:
    """Write all files of a run but its manifest and page.

    Args:
        findings: what was found.
        folder: an empty folder.
        title, kind, question, answer, val_m: see `Document`.

    Returns:
        The document, which is stored too.
    """
    for table in findings.tables:
        write_table(table.data, folder, table.name, stored=table.stored)
    for picture in findings.pictures:
        save_figure(picture.figure, folder, picture.name)
    for name, rows in findings.rows.items():
        shutil.copytree(rows, folder / name, ignore=shutil.ignore_patterns(".*"), dirs_exist_ok=True)
    for name, text in findings.texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    document = Document(
        title=title,
        kind=kind,
        question=question,
        answer=answer,
        notes=findings.notes,
        val_m=val_m,
        summary=findings.summary,
        tables=tuple(TableEntry(table.name, table.chart) for table in findings.tables if table.stored != "parquet"),
        figures=tuple(_entry(picture, title) for picture in findings.pictures),
    )
    (folder / SUMMARY).write_text(to_markdown(title, document.summary, document.notes), encoding="utf-8")
    write_document(document, folder)
    return document


def write_table(table: pd.DataFrame, folder: Path, name: str, *, stored: str = "csv") -> None:
    """``name.csv`` with every digit, ``name.parquet``, or both."""
    if stored != "parquet":
        table.to_csv(folder / f"{name}.csv", index=False, lineterminator="\n")
    if stored != "csv":
        table.to_parquet(folder / f"{name}.parquet", index=False, compression="zstd")


def _entry(picture: Picture, title: str) -> FigureEntry:
    """The caption, and for those who do not see it the words that are drawn: headings, axes, names of curves."""
    texts = [artist for artist in picture.figure.findobj(Text) if isinstance(artist, Text) and artist.get_visible()]
    words = dict.fromkeys(" ".join(text.get_text().split()) for text in texts)
    drawn = [word for word in words if word != title and not _NUMBER.fullmatch(word)]
    more = f"; and {len(drawn) - _MOST_WORDS} more" if len(drawn) > _MOST_WORDS else ""
    content = f"Drawn in it: {'; '.join(drawn[:_MOST_WORDS])}{more}." if drawn else f"{title}."
    return FigureEntry(picture.name, picture.caption, f"{picture.caption} {content}")
