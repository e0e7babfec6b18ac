"""The README: its two commands are the ones that continuous integration uses, its table is that of the stored run.

That its Python runs, and that its links lead somewhere, is checked with the pages of the site in tests/docs.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def cells(text: str) -> list[list[str]]:
    """The cells of every table row."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_the_test_command_is_the_one_of_continuous_integration() -> None:
    commands = re.findall(r"^python3 -m venv .*$", TEXT, flags=re.MULTILINE)
    assert len(commands) == 2
    assert commands[1] in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_contributors_are_told_the_same() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert re.search(r"^\.ci/run$", text, flags=re.MULTILINE)
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111


def test_the_table_is_that_of_the_stored_run() -> None:
    header, *stored = cells((ROOT / "results" / "ramp" / "summary.md").read_text(encoding="utf-8"))
    runs = {row[0]: dict(zip(header, row, strict=True)) for row in stored}
    shown = [row for row in cells(TEXT) if re.fullmatch(r"\d+ m", row[0])]
    assert len(shown) >= 4
    for bias, least_squares, robust, misleading in shown:
        run = runs[f"G01:+{bias.removesuffix(' m')}m"]
        assert least_squares == f"{run['alarm, ls']} ({run['alarm, LS exact']})"
        assert robust == run["alarm, igg3"]
        assert misleading == run["misleading, igg3"]
