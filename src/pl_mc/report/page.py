"""``report.html``: one page about one run, complete in itself, that asks for nothing from anywhere.

It is made from the document that the run stored and from the tables and pictures beside it, so that it can be made
again. Nothing here knows a kind of experiment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
from jinja2.utils import htmlsafe_json_dumps
from markdown_it import MarkdownIt
from markupsafe import Markup

from pl_mc.input_errors import InputError
from pl_mc.report.charts import charts_of
from pl_mc.report.document import Block, Heading, Paragraph
from pl_mc.report.page_figures import page_figures
from pl_mc.report.page_tables import fields_table, page_tables
from pl_mc.report.run_folder import RunFolder

PAGE = "report.html"

# No page is larger; figures get what everything else leaves.
MOST_BYTES = 2_000_000
_LEAST_FOR_FIGURES = 300_000
_MOST_CHART_BYTES = 500_000

# What texts of a document may mark: code, and words that are strong. All else in them is text.
_INLINE = MarkdownIt("zero", {"html": False}).enable(["backticks", "emphasis"])


def write_page(run: RunFolder, *, meanings: Mapping[str, str], shown_as: Path | None = None) -> None:
    """Write ``report.html`` into a results folder.

    Args:
        run: the folder as it is read back, with a document.
        meanings: what the fields of the experiment mean, by their path.
        shown_as: the folder as the page names it, where it is still to be moved there.

    Raises:
        InputError: a folder that cannot be written to.
    """
    path = run.folder / PAGE
    try:
        path.write_text(page_of_run(run, meanings=meanings, shown_as=shown_as or run.folder), encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: the page cannot be written ({(error.strerror or str(error)).lower()})."
        ) from None


def page_of_run(run: RunFolder, *, meanings: Mapping[str, str], shown_as: Path) -> str:
    """The page as text."""
    document = run.document
    assert document is not None
    charts = charts_within_limit(charts_of(document.tables, run.tables, val_m=document.val_m))
    # What has been taken out of the folder is left out.
    shown = [entry.name for entry in document.tables if entry.name in run.tables]
    content: dict[str, Any] = {
        "run": run,
        "document": document,
        "title": document.title,
        "seconds": _duration(run.manifest.get("seconds")),
        "setting": _unbroken(_setting(document.summary)),
        "answer": [_unbroken(sentence) for sentence in document.answer],
        "charts": charts,
        "tables": page_tables({name: run.tables[name] for name in shown}),
        "fields": fields_table(run.experiment, meanings),
        "inputs": run.manifest.get("inputs") or {},
        "folder": shown_as.as_posix(),
    }
    light = render("report.html", content | {"figures": []})
    spare = MOST_BYTES - len(light.encode()) - 4_000 * len(document.figures) - 10_000
    figures = page_figures(run.folder, document.figures, most_bytes=max(_LEAST_FOR_FIGURES, spare))
    return render("report.html", content | {"figures": figures})


def render(template: str, content: Mapping[str, Any]) -> str:
    """A template of ``html/`` with the common style and scripts in it.

    Whatever it is given is escaped, but for what the filters ``inline`` and ``json`` make.
    """
    common = {
        "version": metadata.version("pl_mc"),
        "style": Markup(_asset("style.css")),
        "chart_script": Markup(_asset("chart.js")),
        "table_script": Markup(_asset("table.js")),
    }
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"inline": _inline, "json": json_in_page}
    return environment.get_template(template).render(common | dict(content))


def charts_within_limit(charts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first of the charts that a page has room for."""
    kept: list[dict[str, Any]] = []
    for chart in charts:
        if sum(map(_weight, kept)) + _weight(chart) <= _MOST_CHART_BYTES:
            kept.append(chart)
    return kept


def _asset(name: str) -> str:
    return resources.files("pl_mc.report").joinpath("html", name).read_text(encoding="utf-8")


def json_in_page(content: Any) -> Markup:
    """JSON that can stand inside a page: nothing in it closes the element."""
    return htmlsafe_json_dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _weight(chart: Mapping[str, Any]) -> int:
    return len(json_in_page(chart))


def _inline(text: str) -> Markup:
    """A text of the document in HTML, with what it marks and nothing that could be a tag."""
    return Markup(_INLINE.renderInline(text))


def _setting(blocks: Sequence[Block]) -> str:
    """What the summary says first, which is where the numbers come from; nothing where it is a table or a list."""
    first = next((block for block in blocks if not isinstance(block, Heading)), None)
    if not isinstance(first, Paragraph):
        return ""
    words = " ".join(first.text.split())
    return words[:1].upper() + words[1:]


def _unbroken(text: str) -> str:
    """No line ends between a number and its unit."""
    return re.sub(r"(?<=\d) (?=(?:%|m|s|deg)\b|%)", "\N{NO-BREAK SPACE}", text)


def _duration(seconds: Any) -> str:
    if not isinstance(seconds, int | float):
        return "an unknown time"
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
