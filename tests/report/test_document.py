"""What a run has to say, as data: stored and read back, as Markdown and back, and as a page made again."""

from __future__ import annotations

import itertools
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stored_runs import counts, store_run

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.reading import remake_page
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.charts import charts_of
from pl_mc.report.document import (
    DOCUMENT,
    Block,
    Bullets,
    Chart,
    Document,
    FigureEntry,
    Heading,
    Paragraph,
    Quantity,
    TableEntry,
    TextTable,
    read_document,
    write_document,
)
from pl_mc.report.files import from_markdown, to_markdown, write_findings
from pl_mc.report.findings import Findings, Table
from pl_mc.report.page import page_of_run
from pl_mc.report.run_folder import read_run_folder

pytestmark = pytest.mark.drawn

SMALL_STANFORD = {
    "kind": "stanford",
    "title": "A <b>diagram</b> of 1 & 2",
    "draws": 64,
    "geometry": {"epochs": 2, "interval_s": 3600.0},
}

# A letter to begin with, then whatever Markdown and HTML know, so that nothing of it is taken for more than text.
words = st.text("abcXYZ09 .,;:%()[]<>&|*_`~^#+-=!\"'\\/{}", max_size=30).map(lambda text: f"a{text.rstrip()}")
lines = st.lists(words, min_size=1, max_size=3).map("\n".join)
bullets = st.lists(words, min_size=1, max_size=4).map(lambda items: Bullets(tuple(items)))


@st.composite
def text_tables(draw: st.DrawFn) -> TextTable:
    width = draw(st.integers(1, 4))
    row = st.lists(st.just("") | words, min_size=width, max_size=width).map(tuple)
    return TextTable(draw(row), tuple(draw(st.lists(row, max_size=4))))


# Two lists in a row are one in Markdown.
any_blocks = st.lists(
    st.builds(Paragraph, lines)
    | st.builds(Heading, words.map(lambda text: text.rstrip("# ")), st.integers(2, 4))
    | bullets
    | text_tables(),
    max_size=6,
).filter(lambda blocks: not any(type(a) is type(b) is Bullets for a, b in itertools.pairwise(blocks)))

EVERYTHING = Document(
    title="A title",
    kind="sweep",
    question="What?",
    answer=("12 %.", "3 m."),
    notes=("A note.",),
    val_m=35.0,
    summary=(
        Heading("Findings", level=3),
        Paragraph("Two\nlines"),
        Bullets(("a", Bullets(("b", "c")), "d")),
        TextTable.of(["n", "x"], [[1, 2.5], ["", "z"]]),
    ),
    tables=(
        TableEntry("rates", Chart("Rates", ("method",), (Quantity("alarm", "r", "l", "h", "n"),), menus=("noise",))),
        TableEntry("levels"),
    ),
    figures=(FigureEntry("rates", "A caption.", "A caption. Words."),),
)


@given(any_blocks)
def test_blocks_come_back_from_markdown(blocks: list[Block]) -> None:
    text = to_markdown("A title", blocks, ["a note", "another"])
    assert text.startswith("# A title\n")
    assert text.endswith("\n\nNotes:\n\n- a note\n- another\n")
    assert from_markdown(text) == tuple(blocks)


def test_lists_in_lists_come_back_from_markdown() -> None:
    blocks = (Bullets(("a", Bullets(("b", Bullets(("c",)))), "d")), Paragraph("e"))
    assert to_markdown("t", blocks) == "# t\n\n- a\n  - b\n    - c\n- d\n\ne\n"
    assert from_markdown(to_markdown("t", blocks)) == blocks


def test_a_document_comes_back_from_its_file(tmp_path: Path) -> None:
    assert read_document(tmp_path) is None
    write_document(EVERYTHING, tmp_path)
    assert read_document(tmp_path) == EVERYTHING


@given(any_blocks)
def test_blocks_come_back_from_the_file_of_a_document(
    tmp_path_factory: pytest.TempPathFactory, blocks: list[Block]
) -> None:
    folder = tmp_path_factory.mktemp("document")
    document = Document("t", "sweep", "?", (), (), 35.0, tuple(blocks), (), ())
    write_document(document, folder)
    assert read_document(folder) == document


@pytest.mark.parametrize("content", ["", "[]", "{", '{"title": "t"}', '{"title": 3}'])
def test_a_file_that_is_no_document_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / DOCUMENT).write_text(content)
    with pytest.raises(InputError, match=r"report\.json: it is (no report of a run \(|not JSON: )"):
        read_document(tmp_path)


@pytest.fixture(scope="module")
def run_of_today(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a small experiment, made as a user makes them."""
    out = tmp_path_factory.mktemp("runs") / "today"
    run_experiment("today", build_experiment(SMALL_STANFORD, source="test"), out)
    return out


def test_a_page_made_again_is_the_same_to_the_byte(run_of_today: Path) -> None:
    page = (run_of_today / "report.html").read_bytes()
    (run_of_today / "report.html").unlink()
    result = remake_page(run_of_today)
    assert (run_of_today / "report.html").read_bytes() == page
    document = read_document(run_of_today)
    assert document is not None
    assert result.answer == document.answer
    assert document.question in page.decode()
    for entry in document.figures:
        assert entry.caption in page.decode()
    summary = (run_of_today / "summary.md").read_text()
    assert summary == to_markdown(document.title, document.summary, document.notes)
    assert from_markdown(summary) == document.summary


def test_a_folder_of_a_version_without_documents_gets_a_page(run_of_today: Path, tmp_path: Path) -> None:
    old = tmp_path / "old"
    shutil.copytree(run_of_today, old)
    document = read_document(old)
    assert document is not None
    (old / DOCUMENT).unlink()
    (old / "report.html").unlink()
    assert remake_page(old).answer == document.answer
    page, known = ((folder / "report.html").read_text() for folder in (old, run_of_today))
    assert document.question in page
    # The summary from its Markdown is the one from its blocks, and so are tables and fields.
    for part in ("answer", "summary", "assumed"):
        section = re.compile(rf'<section id="{part}">.*?</section>', re.DOTALL)
        assert section.findall(page) == section.findall(known), part
    assert page.count("<img ") == len(document.figures)
    assert not (old / DOCUMENT).exists()
    # Where the tables are not those that the answer is made from, a sentence says so.
    (old / "regions.csv").unlink()
    with pytest.raises(InputError, match=r"no report\.json, and its tables are not those .*KeyError: 'regions'"):
        remake_page(old)


def test_what_is_taken_out_of_a_folder_is_left_out_of_its_page(run_of_today: Path, tmp_path: Path) -> None:
    less = tmp_path / "less"
    shutil.copytree(run_of_today, less)
    for name in ("stanford.csv", "stanford.png", "stanford.svg"):
        (less / name).unlink()
    remake_page(less)
    page = (less / "report.html").read_text()
    assert "regions.csv" in page
    assert "<img " not in page
    assert "stanford.csv" not in page


def test_nothing_that_a_document_says_is_taken_for_a_tag(tmp_path: Path) -> None:
    """Marks of HTML and of Markdown in every place where a text can stand, and none of them is one."""
    marks = "<h2>x</h2> <table> </script> & &lt; \"q\" 'r' | # [l](u) ![i](u) \\* ~~s~~"
    escaped = "&lt;h2&gt;x&lt;/h2&gt; &lt;table&gt; &lt;/script&gt; &amp; &amp;lt; "
    rates = counts({"ls": (0, 1, 2, 3), "igg3": (0, 0, 0, 0)})
    folder = store_run(tmp_path / "run", rates, with_figure=False)
    rates["fault"] = f"fault {marks}"
    places = ("question", "answer", "note", "heading", "first", "item", "inner", "head", "cell", "title", "chart")
    texts = {place: f"{place} {marks}" for place in places}
    summary = (
        Paragraph(texts["first"]),
        Heading(texts["heading"]),
        Bullets((texts["item"], Bullets((texts["inner"],)))),
        TextTable((texts["head"],), ((texts["cell"],),)),
    )
    quantity = Quantity(f"quantity {marks}", "alarm_rate", "alarm_low", "alarm_high")
    chart = Chart(texts["chart"], ("method",), (quantity,))
    write_findings(
        Findings(summary, (Table("rates", rates, chart=chart),), notes=(texts["note"],)), folder,
        title=texts["title"], kind="sweep", question=texts["question"], answer=(texts["answer"],), val_m=35.0,
    )  # fmt: skip
    run = read_run_folder(folder)
    page = page_of_run(run, shown_as=folder)
    for place in (*places, "fault"):
        assert f"{place} {escaped}" in page, place
    for tag in ("h2", "table", "script"):
        assert len(re.findall(f"<{tag}[ >]", page)) == page.count(f"</{tag}>")
    assert "<h2>x" not in page
    assert "<table>" not in page
    assert not re.search(r'<(a|img|s|del)\b[^>]*"u"', page)
    # The same in Markdown has its marks as they are, and comes back.
    assert from_markdown(to_markdown("t", summary)) == summary
    assert run.document is not None
    (drawn,) = charts_of(run.document.tables, run.tables, val_m=35.0)
    assert (drawn["title"], drawn["quantities"][0]["label"]) == (texts["chart"], f"quantity {marks}")


def test_code_and_strong_words_are_marked_and_nothing_else(tmp_path: Path) -> None:
    folder = store_run(tmp_path / "run", counts({"ls": (0, 1, 2, 3), "igg3": (0, 0, 0, 0)}), with_figure=False)
    text = Paragraph("It is **not** `x < 1`; 2 * 3 * 4 of a_b_c, w_test(p_fa=0.001,p_md=0.0001)")
    write_findings(Findings((text,), ()), folder, title="t", kind="sweep", question="?", answer=(), val_m=35.0)
    page = page_of_run(read_run_folder(folder), shown_as=folder)
    marked = "It is <strong>not</strong> <code>x &lt; 1</code>; 2 * 3 * 4 of a_b_c, w_test(p_fa=0.001,p_md=0.0001)"
    assert f"<p>{marked}</p>" in page


def test_tables_in_parquet_alone_are_stored_and_not_shown(tmp_path: Path) -> None:
    table = pd.DataFrame({"a": [1, 2]})
    tables = (Table("one", table), Table("two", table, stored="parquet"), Table("three", table, stored="both"))
    findings = Findings((), tables)
    document = write_findings(findings, tmp_path, title="t", kind="sweep", question="?", answer=(), val_m=35.0)
    assert list(findings.data) == [entry.name for entry in document.tables] == ["one", "three"]
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {"one.csv", "two.parquet", "three.csv", "three.parquet", "summary.md", "report.json"}
