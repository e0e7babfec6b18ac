"""The tables of a summary in LaTeX, for the package booktabs, with every interval that Markdown has."""

from __future__ import annotations

import re

from pl_mc.input_errors import InputError, shown
from pl_mc.report.document import Document, Heading, Paragraph, TextTable

_HEAD = "% Tables of {title}. In the preamble: \\usepackage{{booktabs}}.\n"

_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%", "_": r"\_",
    "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": r"$<$", ">": r"$>$", "\u2013": "--",
    "\u2212": r"$-$", "\u00d7": r"$\times$", "\u00b1": r"$\pm$", "\u00b0": r"$^\circ$", "\u03c3": r"$\sigma$",
    "\u2264": r"$\leq$", "\u2265": r"$\geq$", "\u00b2": r"$^2$", "\u00b7": r"$\cdot$",
}  # fmt: skip

# Words that Markdown marks: code and strong ones.
_MARKED = re.compile(r"`(?P<code>[^`]+)`|\*\*(?P<strong>[^*]+)\*\*")
_NUMBER = re.compile(r"[-+<>]? ?\d[\d,.]*(e[-+]?\d+)?( ?%)?( .*)?")


def to_latex(document: Document) -> str:
    """The tables of a document, each with the nearest heading or paragraph before it as its caption."""
    parts, caption = [], document.title
    for block in document.summary:
        if isinstance(block, Heading | Paragraph):
            caption = block.text
        elif isinstance(block, TextTable):
            parts.append(_table(block, caption))
    return "\n".join([_HEAD.format(title=" ".join(document.title.split())), *parts])


def _table(table: TextTable, caption: str) -> str:
    columns = range(len(table.header))
    if any(len(row) != len(table.header) for row in table.rows):
        raise InputError(f"report.json: a table below {shown(caption)} has rows of other lengths than its header.")
    # Columns of numbers are flush right.
    numbers = [
        k > 0 and all(_NUMBER.fullmatch(row[k]) or not row[k].strip("- ") for row in table.rows) for k in columns
    ]
    lines = [
        r"\begin{table}", rf"\caption{{{escaped(caption.rstrip(':'))}}}",
        rf"\begin{{tabular}}{{@{{}}{''.join('r' if one else 'l' for one in numbers)}@{{}}}}", r"\toprule",
        _row(table.header), r"\midrule", *map(_row, table.rows), r"\bottomrule", r"\end{tabular}", r"\end{table}",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _row(cells: tuple[str, ...]) -> str:
    # A row that begins with a bracket would give its length to the line break before it.
    return "{}" + " & ".join(map(escaped, cells)) + r" \\"


def escaped(text: str) -> str:
    """Text as LaTeX sets it: what it takes for commands is escaped, marked words are marked."""
    parts, end = [], 0
    for found in _MARKED.finditer(text):
        command, word = (r"\texttt", found["code"]) if found["code"] else (r"\textbf", found["strong"])
        parts += [_plain(text[end : found.start()]), f"{command}{{{_plain(word)}}}"]
        end = found.end()
    return "".join([*parts, _plain(text[end:])])


def _plain(text: str) -> str:
    # A blank line would end a paragraph, and what is no character cannot be written.
    plain = " ".join(text.split()).encode(errors="replace").decode() if not text.isprintable() else text
    return "".join(_SPECIAL.get(letter, letter) for letter in plain)
