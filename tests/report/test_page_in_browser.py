"""The pages in a real browser: they ask for nothing, write no error, draw, sort, and fit on a phone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from stored_runs import SIZES_M

from pl_mc.experiments.reading import write_comparison
from pl_mc.report.files import write_findings
from pl_mc.report.findings import Findings
from pl_mc.report.page import write_page
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.observe.course import course_table

pytestmark = pytest.mark.drawn

LOOK = """
out.inner = innerWidth; out.wide = document.documentElement.scrollWidth;
out.requests = performance.getEntriesByType('resource').map((one) => one.name);
out.images = [...document.images].map((one) => [one.complete && one.naturalWidth > 0, one.alt.length]);
const svg = document.querySelector('.canvas svg');
out.curves = svg.querySelectorAll('polyline').length;
out.marks = svg.querySelectorAll('.solid, .hollow').length;
out.bands = svg.querySelectorAll('.band').length;
svg.focus();
for (const _ of [1, 2]) svg.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}));
out.tip = document.querySelector('.tip').textContent;
const scale = document.querySelectorAll('.controls select'); const last = scale[scale.length - 1];
last.value = 1; last.dispatchEvent(new Event('change'));
out.arrows = document.querySelectorAll('.canvas svg path[d*="v14"]').length;
const name = document.querySelector('.legend button'); name.click();
out.pressed = name.getAttribute('aria-pressed');
out.left = document.querySelector('.canvas svg').querySelectorAll('polyline').length;
const tables = [...document.querySelectorAll('#tables table')];
const table = tables.find((one) => one.tHead.textContent.includes('alarms'));
const heads = [...table.tHead.rows[0].cells], at = heads.findIndex((one) => one.textContent === 'alarms');
const column = () => [...table.tBodies[0].rows].map((row) => +row.cells[at].textContent);
out.before = column();
heads[at].querySelector('button').click(); out.up = column(); out.sort = heads[at].getAttribute('aria-sort');
heads[at].querySelector('button').click(); out.down = column();
"""


@pytest.fixture(scope="module")
def page(small_run: Path) -> Path:
    write_page(read_run_folder(small_run))
    return small_run / "report.html"


def test_the_page_draws_sorts_and_asks_for_nothing(browser: Browser, page: Path) -> None:
    seen, console = browser.probe(page, LOOK)
    assert console == []
    assert seen["requests"] == []
    assert seen["images"]
    assert all(loaded and words > 40 for loaded, words in seen["images"])
    # Two methods over all sizes; a mark and a band for each.
    assert seen["curves"] == seen["bands"] == 2
    assert seen["marks"] == 2 * len(SIZES_M)
    # The second bias: 130 of 400 by least squares, none by the robust method.
    assert "bias 25 m" in seen["tip"]
    assert "32.5 %" in seen["tip"]
    assert "130 of 400" in seen["tip"]
    assert "0 (below 0.918 %), 0 of 400" in seen["tip"]
    # On a logarithmic axis each of the five zeros is an upper bound with an arrow.
    assert seen["arrows"] == 5
    assert seen["pressed"] == "false"
    assert seen["left"] == 1
    assert seen["up"] == sorted(seen["before"])
    assert seen["down"] == sorted(seen["before"], reverse=True)
    assert seen["before"] != seen["up"]
    assert seen["sort"] == "ascending"


def test_nothing_is_wider_than_a_phone(browser: Browser, page: Path) -> None:
    # A frame of a phone's width: a window cannot be made that narrow everywhere.
    frame = page.with_name("frame.html")
    frame.write_text(
        f'<!DOCTYPE html><body style="margin:0"><iframe src="{page.name}" width="390" height="2000"></iframe></body>'
    )
    script = (
        "const inner = document.querySelector('iframe').contentDocument.documentElement;"
        "out.wide = inner.scrollWidth; out.inner = inner.clientWidth;"
        "out.boxes = [...inner.querySelectorAll('.scroll')].filter((one) => one.scrollWidth > one.clientWidth + "
        "1).length;"
    )
    try:
        seen, console = browser.probe(frame, script, "--allow-file-access-from-files")
    finally:
        frame.unlink()
    assert console == []
    assert seen["inner"] <= 390
    assert seen["wide"] <= seen["inner"]
    # Wide tables scroll in their own boxes.
    assert seen["boxes"] >= 1


def test_without_scripts_the_figures_and_tables_are_there(browser: Browser, page: Path) -> None:
    # Every script of the page is refused, as by a reader who allows none.
    without = page.with_name("without.html")
    allowed = "script-src 'unsafe-inline'"
    text = page.read_text()
    assert allowed in text
    without.write_text(text.replace(allowed, "script-src 'none'"))
    try:
        document, console = browser.dump(without)
    finally:
        without.unlink()
    assert console
    assert all("Content Security Policy" in line for line in console)
    assert 'class="needs-script" hidden=""' in document
    assert "<svg" not in document
    assert 'src="data:image/' in document
    assert "G07:+25m" in document


def test_dark_light_and_paper(browser: Browser, page: Path, tmp_path: Path) -> None:
    light = browser.brightness(page, tmp_path / "light.png", "--blink-settings=preferredColorScheme=1")
    dark = browser.brightness(page, tmp_path / "dark.png", "--blink-settings=preferredColorScheme=0")
    assert light > 200
    assert dark < 70
    printed = browser.print_pdf(page, tmp_path / "page.pdf")
    assert printed.startswith(b"%PDF")
    assert len(printed) > 10_000


def test_the_page_of_a_comparison_draws_both_runs(browser: Browser, small_run: Path, tmp_path: Path) -> None:
    made = write_comparison(small_run, small_run, tmp_path / "compared")
    script = (
        "out.curves = document.querySelector('.canvas svg').querySelectorAll('polyline').length;"
        "out.rows = document.querySelector('#rates tbody').rows.length;"
        "out.requests = performance.getEntriesByType('resource').map((one) => one.name);"
    )
    seen, console = browser.probe(made.folder / "compare.html", script)
    assert console == []
    assert seen["requests"] == []
    assert seen["curves"] == 4
    # Seven events of eight rows each.
    assert seen["rows"] == 72


def test_lines_in_time_end_where_epochs_are_missing(browser: Browser, small_run: Path, tmp_path: Path) -> None:
    k = np.r_[0:20, 60:80]
    epochs = pd.DataFrame({
        "time": pd.Timestamp("2020-06-25") + pd.to_timedelta(k, unit="s"), "method": "ls", "east_m": 3.0,
        "north_m": 4.0, "up_m": -0.5, "vpl_m": 7.0, "hpl_m": 9.0, "available": True,
    })  # fmt: skip
    folder = tmp_path / "course"
    folder.mkdir()
    (folder / "manifest.json").write_text((small_run / "manifest.json").read_text())
    findings = Findings(("One.",), (course_table(epochs),))
    write_findings(findings, folder, title="t", kind="sweep", question="Is it?", answer=("It is.",), val_m=35.0)
    write_page(read_run_folder(folder))
    script = (
        "const svg = document.querySelector('.canvas svg');"
        "out.curves = svg.querySelectorAll('polyline').length; out.bands = svg.querySelectorAll('.band').length;"
        "svg.focus(); svg.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}));"
        "svg.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}));"
        "out.tip = document.querySelector('.tip').textContent;"
    )
    seen, console = browser.probe(folder / "report.html", script)
    assert console == []
    # The error and the level, each in two parts.
    assert seen["curves"] == seen["bands"] == 4
    assert "2020-06-25 00:00:00 1 s" in seen["tip"]
    assert "least squares, error: 0.5 m" in seen["tip"]
    assert "least squares, level: 7 m" in seen["tip"]


PRINTED = """
const closed = () => document.querySelectorAll('details:not([open])').length;
const curves = () => document.querySelectorAll('.canvas svg polyline').length;
const hidden = () => document.querySelectorAll('.legend button[aria-pressed="false"]').length;
const state = () => [closed(), curves(), hidden()];
document.querySelector('.legend button').click();
document.querySelector('details').open = false;
out.before = state();
dispatchEvent(new Event('beforeprint')); out.paper = state();
dispatchEvent(new Event('afterprint')); out.after = state();
const chart = document.querySelector('.canvas svg').getBoundingClientRect();
const figure = document.querySelector('figure img').getBoundingClientRect();
out.height = chart.height; out.figure = figure.width;
out.main = document.querySelector('main section').getBoundingClientRect().width;
"""


def test_on_paper_nothing_is_closed_or_hidden(browser: Browser, page: Path) -> None:
    seen, console = browser.probe(page, PRINTED)
    assert console == []
    closed, curves, hidden = seen["before"]
    assert closed >= 1
    assert hidden == 1
    assert seen["paper"] == [0, curves + 1, 0]
    assert seen["after"] == [closed, curves, hidden]
    # A chart is less than half of a screen, a figure as wide as the page.
    assert seen["height"] <= 340
    assert seen["figure"] == pytest.approx(seen["main"], abs=1)


def test_a_figure_of_lines_is_dark_on_a_dark_page(browser: Browser, page: Path, tmp_path: Path) -> None:
    alone = "document.body.replaceChildren(document.querySelector('figure'));"
    text = page.read_text(encoding="utf-8").replace("</body>", f"<script>{alone}</script></body>")
    copy = page.with_name("alone.html")
    copy.write_text(text, encoding="utf-8")
    try:
        light = browser.brightness(copy, tmp_path / "light.png", "--blink-settings=preferredColorScheme=1")
        dark = browser.brightness(copy, tmp_path / "dark.png", "--blink-settings=preferredColorScheme=0")
    finally:
        copy.unlink()
    assert light > 200
    assert dark < 70
