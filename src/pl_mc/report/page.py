"""``report.html``: one page about one run, complete in itself, that asks for nothing from anywhere.

It is made from what the results folder holds, so that the page of an old run can be made again. What it says of a
kind of experiment stands in `pl_mc.report.answers`; everything else is the same for all kinds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
from markdown_it import MarkdownIt
from markupsafe import Markup

from pl_mc.input_errors import InputError
from pl_mc.report.answers import answer_of, question_of
from pl_mc.report.charts import charts_of
from pl_mc.report.page_figures import page_figures
from pl_mc.report.page_tables import fields_table, page_tables
from pl_mc.report.run_folder import RunFolder, read_run_folder

PAGE = "report.html"

# No page is larger; figures get what everything else leaves.
MOST_BYTES = 2_000_000
_LEAST_FOR_FIGURES = 300_000
_MOST_CHART_BYTES = 500_000


def write_report(folder: Path, *, meanings: Mapping[str, str] | None = None, shown_as: Path | None = None) -> Path:
    """Write ``report.html`` into a results folder, from what is in it.

    Args:
        folder: the results.
        meanings: what the fields of the experiment mean, by their path.
        shown_as: the folder as the page names it, where it is still to be moved there.

    Raises:
        InputError: a folder without a finished run, or one that cannot be written to.
    """
    run = read_run_folder(folder)
    path = folder / PAGE
    try:
        path.write_text(report_page(run, meanings=meanings or {}, shown_as=shown_as or folder), encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: the page cannot be written ({(error.strerror or str(error)).lower()})."
        ) from None
    return path


def report_page(run: RunFolder, *, meanings: Mapping[str, str], shown_as: Path) -> str:
    """The page as text."""
    charts = charts_within_limit(charts_of(run))
    tables = page_tables(run.tables)
    content: dict[str, Any] = {
        "run": run,
        "title": run.title,
        "seconds": _duration(run.manifest.get("seconds")),
        "question": question_of(run),
        "setting": _unbroken(_first_paragraph(run.summary)),
        "answer": [_unbroken(sentence) for sentence in answer_of(run)],
        "charts": charts,
        "chart_data": json_in_page(charts),
        "tables": tables,
        "summary": _summary(run.summary),
        "fields": fields_table(run.experiment, meanings),
        "inputs": run.manifest.get("inputs") or {},
        "folder": shown_as.as_posix(),
    }
    light = render("report.html", content | {"figures": []})
    room = max(_LEAST_FOR_FIGURES, MOST_BYTES - len(light.encode()) - 4_000 * len(run.figures) - 10_000)
    figures = page_figures(run.folder, run.figures, title=run.title, most_bytes=room)
    return render("report.html", content | {"figures": figures})


def render(template: str, content: Mapping[str, Any]) -> str:
    """A template of ``html/`` with the common style and scripts in it."""
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
    return environment.get_template(template).render(common | dict(content))


def charts_within_limit(charts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Charts with headings, the first of them that a page has room for."""
    kept: list[dict[str, Any]] = []
    for chart in charts:
        if sum(map(_weight, kept)) + _weight(chart) <= _MOST_CHART_BYTES:
            kept.append(chart | {"title": _chart_title(chart)})
    titles = [one["title"] for one in kept]
    return [
        one | {"title": f"{one['title']}, {one['id'].replace('_', ' ')}"} if titles.count(one["title"]) > 1 else one
        for one in kept
    ]


def _asset(name: str) -> str:
    return resources.files("pl_mc.report").joinpath("html", name).read_text(encoding="utf-8")


def json_in_page(content: Any) -> Markup:
    """JSON that can stand inside a page: nothing in it closes the element."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def _weight(chart: Mapping[str, Any]) -> int:
    return len(json_in_page(chart))


def _summary(text: str) -> Markup:
    """The summary without its heading and notes, which the page has elsewhere."""
    lines = text.split("\n\nNotes:\n")[0].splitlines()
    if lines and lines[0].startswith("# "):
        lines = lines[1:]
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    page = parser.render("\n".join(lines))
    # Headings of a summary are parts of a part here; its tables scroll in their own box.
    page = page.replace("<h2>", "<h3>").replace("</h2>", "</h3>")
    box = (
        '<div class="scroll" tabindex="0" role="region" aria-label="table of the summary"><table class="sortable">'
    )
    return Markup(page.replace("<table>", box).replace("</table>", "</table></div>"))


def _first_paragraph(text: str) -> str:
    """What the summary says first, which is where the numbers come from; nothing where it is a table or a list."""
    parts = [part.strip() for part in text.split("\n\n")]
    words = next((part for part in parts if part and not part.startswith("#")), "")
    if words.startswith(("|", "-")):
        return ""
    words = " ".join(words.replace("`", "").split())
    return words[:1].upper() + words[1:]


def _unbroken(text: str) -> str:
    """No line ends between a number and its unit."""
    return re.sub(r"(?<=\d) (?=(?:%|m|s|deg)\b|%)", "\N{NO-BREAK SPACE}", text)


def _chart_title(chart: Mapping[str, Any]) -> str:
    quantities = chart["quantities"]
    labels = [one["label"].split(",")[0] for one in quantities]
    if all(one["rate"] for one in quantities) and len(labels) > 2:
        return "Rates of events against the bias"
    what = " and ".join(labels)
    return f"{what[:1].upper()}{what[1:]} against the bias"


def _duration(seconds: Any) -> str:
    if not isinstance(seconds, int | float):
        return "an unknown time"
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
