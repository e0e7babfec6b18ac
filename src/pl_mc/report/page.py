"""``report.html``: one page about one run, complete in itself, that asks for nothing from anywhere.

It is made from the document that the run stored and from the tables and pictures beside it, so that it can be made
again. Nothing here knows a kind of experiment.
"""

from __future__ import annotations

import base64
import functools
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps
from markdown_it import MarkdownIt
from markupsafe import Markup

from pl_mc.input_errors import InputError, system_reason
from pl_mc.report.assumed import ASSUMED, Assumed
from pl_mc.report.charts import charts_of
from pl_mc.report.columns import column_meaning
from pl_mc.report.document import Block, FigureEntry, Heading, Paragraph, TextTable
from pl_mc.report.run_folder import RunFolder, flat_fields, number_text, value_text
from pl_mc.report.short_names import hidden_options, methods_in, options_of
from pl_mc.runtime.progress import duration_text
from pl_mc.runtime.typed_command import without_home
from pl_mc.runtime.whole_files import write_whole

PAGE = "report.html"

# No page is larger; figures get what everything else leaves.
MOST_BYTES = 2_000_000
_LEAST_FOR_FIGURES = 300_000
_MOST_CHART_BYTES = 500_000

# Pictures that are not shown: unpacked they would fill the memory.
_MOST_PICTURE_BYTES, _MOST_PIXELS = 20_000_000, 50_000_000

# Rows of a table on a page, and cells of all of them; the files beside the page hold the rest.
MOST_ROWS = 400
MOST_CELLS = 30_000
_OPEN_ROWS = 14

# Of a picture that is so much reduced, a part with a saturation beyond which it is coloured, both of 255.
_REDUCED, _COLOURED, _MOST_COLOURED = (120, 120), 90, 34.0

# Files of a figure by their ending, and what they are.
_PICTURES = {".png": "image/png", ".svg": "image/svg+xml"}

# Words of a figure that would be wrong where light and dark change places.
_SHADES = re.compile(r"\b(?:white|black|grey|gray|dark|darker|light|lighter|bright|brighter)\b", re.IGNORECASE)

# A number as Python writes it, 1e-07, but for those in the options of a method, which are its name.
_POWER = re.compile(r"(?<![=\w.])(\d+(?:\.\d+)?)e([+-])0*(\d+)(?!\w)")

# What texts of a document may mark: code, and words that are strong. All else in them is text.
_INLINE = MarkdownIt("zero", {"html": False}).enable(["backticks", "emphasis"])


@dataclass(frozen=True)
class PageColumn:
    """Heading of a column, whether it sorts by number, what it means, and its cells' style."""

    label: str
    number: bool = False
    about: str = ""

    @property
    def css(self) -> str:
        """Style of its cells."""
        return "number" if self.number else "wide" if self.label in ("meaning", "value", "options") else ""


@dataclass(frozen=True)
class PageTable:
    """A table of a page, all of it text."""

    title: str
    columns: tuple[PageColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    file: str = ""
    open: bool = False


@dataclass(frozen=True)
class PageFigure:
    """A figure of a page.

    Attributes:
        caption: what stands below it.
        alt: what stands in its place where it cannot be seen.
        files: its files beside the page.
        data: the picture as a data address; empty where there is no room for it.
        size: width and height on the screen [CSS pixels], unless unknown.
        as_it_is: whether its words name shades or areas of it have colours, which a dark page must not turn round.
    """

    caption: str
    alt: str
    files: tuple[str, ...]
    data: str
    size: tuple[int, int] | None
    as_it_is: bool = False


def write_page(run: RunFolder, *, assumed: Assumed | None = None, shown_as: Path | None = None) -> None:
    """Write ``report.html`` into a results folder.

    Args:
        run: the folder as it is read back, with a document.
        assumed: the conditions of its numbers; the fields of the experiment alone stand there unless given.
        shown_as: the folder as the page names it, where it is still to be moved there.

    Raises:
        InputError: a folder that cannot be written to.
    """
    path = run.folder / PAGE
    try:
        write_whole(path, page_of_run(run, assumed=assumed, shown_as=shown_as or run.folder))
    except OSError as error:
        raise InputError(f"{path}: the page cannot be written ({system_reason(error)}).") from None


def page_of_run(run: RunFolder, *, assumed: Assumed | None = None, shown_as: Path) -> str:
    """The page as text."""
    document = run.document
    assert document is not None
    short = methods_in(run.tables.values())
    limits: dict[str, Any] = {"val_m": document.val_m, "hal_m": document.hal_m}
    charts = charts_within_limit(charts_of(document.tables, run.tables, short=short, **limits))
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
        "summary": [_with_short_names(block, short) for block in document.summary],
        "methods": methods_table(short),
        "tables": page_tables({name: run.tables[name] for name in shown}),
        "lead": () if assumed is None else assumed.lead,
        "fields": fields_table(run.experiment) if assumed is None else conditions_table(assumed),
        "assumed_file": ASSUMED if (run.folder / ASSUMED).is_file() else "",
        "inputs": run.manifest.get("inputs") or {},
        "folder": without_home(shown_as.as_posix()),
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
    return _environment().get_template(template).render(common | dict(content))


@functools.cache
def _environment() -> jinja2.Environment:
    """One for all pages: its templates are compiled once, which takes as long as the rest of a small page."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"inline": _inline, "json": json_in_page}
    return environment


def charts_within_limit(charts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first of the charts that a page has room for."""
    kept: list[dict[str, Any]] = []
    left = _MOST_CHART_BYTES
    for chart in charts:
        if (weight := len(json_in_page(chart))) <= left:
            kept.append(chart)
            left -= weight
    return kept


def page_tables(tables: Mapping[str, pd.DataFrame]) -> list[PageTable]:
    """The tables of a run, the first rows of those that are long."""
    made, cells = [], MOST_CELLS
    for name, table in tables.items():
        width = max(1, len(table.columns))
        rows = min(len(table), MOST_ROWS, max(20, cells // width))
        cells -= rows * width
        made.append(page_table(table, name=name, rows=rows))
    return made


def page_table(table: pd.DataFrame, *, name: str, rows: int = MOST_ROWS) -> PageTable:
    """One table, stored beside the page as ``name.csv``."""
    numbers = table.select_dtypes("number").columns
    return PageTable(
        title=f"{name}: {len(table):,} rows",
        columns=tuple(PageColumn(str(name), name in numbers, column_meaning(str(name))) for name in table.columns),
        rows=tuple(tuple(map(_cell, row)) for row in table.head(rows).itertuples(index=False)),
        note=f"The first {rows:,} of {len(table):,} rows; all of them:" if rows < len(table) else "All rows:",
        file=f"{name}.csv",
        open=len(table) <= _OPEN_ROWS,
    )


def text_table(title: str, labels: Sequence[str], rows: Sequence[Sequence[object]]) -> PageTable:
    """An open table of whatever can be said as text, which has no file of its own."""
    texts = tuple(tuple(map(str, row)) for row in rows)
    return PageTable(title, tuple(map(PageColumn, labels)), texts, open=True)


def fields_table(experiment: Mapping[str, Any]) -> PageTable:
    """The fields of an experiment with their values."""
    rows = [(path, value_text(value)) for path, value in flat_fields(experiment).items()]
    return text_table("fields of the experiment", ("field", "value"), rows)


def conditions_table(assumed: Assumed) -> PageTable:
    """Every field and option with its value and meaning."""
    rows = [(one.topic, one.field, one.said, one.meaning) for one in assumed.conditions]
    title = f"fields of the experiment and options, with what nobody typed: {len(rows)}"
    return replace(text_table(title, ("about", "field", "value", "meaning"), rows), open=len(rows) <= MOST_ROWS)


def methods_table(short: Mapping[str, str]) -> PageTable | None:
    """The options of methods that charts and the summary call by short names; none where there are none."""
    rows = [(called, *options_of(whole)) for called, whole in hidden_options(short)]
    named = [(called, base, ", ".join(options)) for called, base, options in rows]
    return text_table("methods by their short names", ("here", "method", "options"), named) if named else None


def _with_short_names(block: Block, short: Mapping[str, str]) -> Block:
    """A table of the summary with short names in the cells that hold the name of a method alone."""
    if not isinstance(block, TextTable):
        return block
    return replace(block, rows=tuple(tuple(short.get(cell, cell) for cell in row) for row in block.rows))


def page_figures(folder: Path, entries: Sequence[FigureEntry], *, most_bytes: int) -> list[PageFigure]:
    """The figures, all of them together within ``most_bytes`` characters of data.

    Where they are heavier, pictures get fewer colours, then half the size; what still finds no room is named alone.
    What has been taken out of the folder is left out.
    """
    files = {
        entry: paths
        for entry in entries
        if (paths := [path for end in _PICTURES if _is_picture(path := folder / f"{entry.name}{end}")])
    }
    pictures = {
        entry: min((_address(path.read_bytes(), _PICTURES[path.suffix]) for path in paths), key=len)
        for entry, paths in files.items()
    }
    for scale in (1, 2):
        if sum(map(len, pictures.values())) <= most_bytes:
            break
        pictures = {entry: _redrawn(files[entry][0], address, scale) for entry, address in pictures.items()}
    made, left = [], most_bytes
    for entry, address in pictures.items():
        data = address if len(address) <= left else ""
        left -= len(data)
        names = tuple(path.name for path in files[entry])
        shades = bool(_SHADES.search(f"{entry.caption} {entry.alt}")) or _is_coloured(files[entry][0])
        made.append(PageFigure(entry.caption, entry.alt, names, data, _size(files[entry][0]), shades))
    return made


def _is_picture(path: Path) -> bool:
    """Whether a file of the folder itself, of a size that is drawn, begins like what its name says."""
    from PIL import Image

    if not path.is_file() or path.is_symlink() or path.stat().st_size > _MOST_PICTURE_BYTES:
        return False
    if path.suffix != ".png":
        return True
    try:
        with Image.open(path) as image:
            return image.format == "PNG" and image.width * image.height <= _MOST_PIXELS
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return False


def _is_coloured(path: Path) -> bool:
    """Whether areas of a picture have colours, as those of maps do, and not lines alone."""
    from PIL import Image, ImageStat

    if path.suffix != ".png":
        return False
    with Image.open(path) as image:
        # Reduced by averages, so that lines fade.
        saturation = image.convert("RGB").resize(_REDUCED, Image.Resampling.BOX).convert("HSV").getchannel("S")
    return float(ImageStat.Stat(saturation.point(lambda level: 255 * (level > _COLOURED))).mean[0]) > _MOST_COLOURED


def _asset(name: str) -> str:
    return resources.files("pl_mc.report").joinpath("html", name).read_text(encoding="utf-8")


def json_in_page(content: Any) -> Markup:
    """JSON that can stand inside a page: nothing in it closes the element."""
    return htmlsafe_json_dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _inline(text: str) -> Markup:
    """A text of the document in HTML, with what it marks and nothing that could be a tag; powers of ten in one form."""
    plain = _POWER.sub(lambda found: f"{found[1]}e{found[2].strip('+')}{found[3]}", text)
    return Markup(_INLINE.renderInline(plain))


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
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 <= seconds < 1e12:
        return "an unknown time"
    return f"{seconds:.1f} s" if seconds < 90 else duration_text(seconds)


def _cell(value: Any) -> str:
    """A value with six digits in the one form of numbers; nothing for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return number_text(value) if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def _address(data: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _redrawn(path: Path, address: str, scale: int) -> str:
    """The picture with 64 colours and its sides divided by ``scale``, if that is lighter; an SVG stays as it is."""
    from PIL import Image

    if path.suffix != ".png":
        return address
    with Image.open(path) as image:
        plain = image.convert("RGB")
        if scale > 1:
            plain = plain.resize((plain.width // scale, plain.height // scale), Image.Resampling.LANCZOS)
        out = io.BytesIO()
        plain.quantize(64, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return min(address, _address(out.getvalue(), _PICTURES[".png"]), key=len)


def _size(path: Path) -> tuple[int, int] | None:
    """Size on the screen of a picture of 150 dots an inch."""
    from PIL import Image

    if path.suffix != ".png":
        return None
    with Image.open(path) as image:
        return round(image.width * 96 / 150), round(image.height * 96 / 150)
