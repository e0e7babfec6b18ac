"""Tables in LaTeX: what a compiler of it needs is there, and nothing is lost of a cell."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from pl_mc.cli.main import main
from pl_mc.experiments.reading import tex_of
from pl_mc.input_errors import InputError
from pl_mc.report.document import Bullets, Document, Heading, Paragraph, TextTable
from pl_mc.report.latex import escaped, to_latex

ROOT = Path(__file__).parents[2]


def document(*blocks: object) -> Document:
    return Document(
        title="A 50 % case", kind="sweep", question="", answer=(), notes=(), val_m=35.0, hal_m=None,
        summary=blocks, tables=(), figures=(),
    )  # type: ignore[arg-type]  # fmt: skip


def test_a_table_is_set_with_rules_its_heading_and_numbers_flush_right() -> None:
    table = TextTable.of(
        ("method", "alarms", "note"),
        [("`igg3_gated`", "12.3 % [11.9, 12.7]", "[a] & b"), ("ls", "0 (< 0.0184 %)", "**x_1** > 3 \u00d7 10^-7")],
    )
    text = to_latex(document(Heading("Rates"), Bullets(("no table",)), table, Paragraph("By size:"), table))
    lines = text.splitlines()
    assert lines[0] == "% Tables of A 50 % case. In the preamble: \\usepackage{booktabs}."
    assert lines.count(r"\caption{Rates}") == 1
    assert lines.count(r"\caption{By size}") == 1
    assert lines.count(r"\begin{tabular}{@{}lrl@{}}") == 2
    assert r"{}\texttt{igg3\_gated} & 12.3 \% [11.9, 12.7] & [a] \& b \\" in lines
    assert r"{}ls & 0 ($<$ 0.0184 \%) & \textbf{x\_1} $>$ 3 $\times$ 10\textasciicircum{}-7 \\" in lines
    assert [rule for rule in lines if rule.endswith("rule")] == [r"\toprule", r"\midrule", r"\bottomrule"] * 2


def test_nothing_is_left_that_latex_takes_for_a_command() -> None:
    text = escaped("".join(map(chr, range(32, 127))))
    assert not re.search(r"(?<!\\)[&#%_]", text)
    # Every dollar opens or closes mathematics, or is escaped.
    assert len(re.findall(r"(?<!\\)\$", text)) % 2 == 0
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0


def test_the_tables_of_a_stored_run_have_all_their_cells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Path(shutil.copytree(ROOT / "results" / "ramp", tmp_path / "ramp"))
    main(["report", str(folder), "--tex", str(tmp_path / "ramp.tex")])
    text = (tmp_path / "ramp.tex").read_text(encoding="utf-8")
    rows = [line for line in (folder / "summary.md").read_text().splitlines() if line.startswith("|")]
    tables = sum(line.startswith("|-") for line in rows)
    assert text.count(r"\begin{tabular}") == tables > 0
    assert len(re.findall(r"\\\\$", text, re.M)) == len(rows) - tables
    assert max(map(ord, text)) < 128
    capsys.readouterr()


def test_what_is_no_table_and_what_is_no_character() -> None:
    with pytest.raises(InputError, match=r"report\.json: a table below 'Rates' has rows of other lengths"):
        to_latex(document(Heading("Rates"), TextTable(("a", "b"), (("1",),))))
    text = to_latex(document(Paragraph("One\n\ntwo \ud800"), TextTable(("a",), (("b\ud800",),))))
    assert r"\caption{One two ?}" in text
    text.encode()


def test_the_results_folder_gets_no_foreign_file() -> None:
    folder = ROOT / "results" / "frontier-receiver"
    for name in (folder / "tables.tex", Path("y" * 300 + ".tex")):
        with pytest.raises(InputError, match=r"^--tex: "):
            tex_of(folder, name)
    assert not (folder / "tables.tex").exists()


@pytest.mark.parametrize("name", ["ramp.txt", "nowhere/ramp.tex"])
def test_a_place_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    folder = Path(shutil.copytree(ROOT / "results" / "ramp", tmp_path / "ramp"))
    page = (folder / "report.html").read_bytes()
    with pytest.raises(SystemExit, match="2"):
        main(["report", str(folder), "--tex", str(tmp_path / name)])
    assert (folder / "report.html").read_bytes() == page
    assert capsys.readouterr().err.endswith("the name of a .tex file in a folder that is there is needed.\n")
