"""What lies in results/: what a reader opens, and nothing that a text cites is missing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
FILES = sorted(path for path in RESULTS.rglob("*") if path.is_file())
TEXTS = sorted([*RESULTS.rglob("*.md"), ROOT / "README.md", *ROOT.joinpath("docs").rglob("*.md")])

# One page is kept as a sample of what a run makes.
SAMPLE = RESULTS / "ramp" / "report.html"
LARGEST_TABLE, LARGEST = 1_000_000, 15_000_000

_LINK = re.compile(r"\]\((?!\w+:|#)([^)#\s]+)")
_NAMED = re.compile(r"`([a-z0-9_]+\.(?:csv|json|md|png|parquet|svg|html))`")


def named_in(text: Path) -> set[str]:
    return set(_NAMED.findall(text.read_text(encoding="utf-8")))


def test_the_folder_is_small_and_has_what_readers_open() -> None:
    assert sum(path.stat().st_size for path in FILES) <= LARGEST
    assert {path.suffix for path in FILES} == {".csv", ".html", ".json", ".md", ".png"}
    assert [path for path in FILES if path.suffix == ".html"] == [SAMPLE]
    cited = {path.parent / name for path in RESULTS.glob("*/*.md") for name in named_in(path)}
    large = {path for path in FILES if path.suffix == ".csv" and path.stat().st_size > LARGEST_TABLE}
    assert large <= cited


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(text: Path) -> None:
    for target in _LINK.findall(text.read_text(encoding="utf-8")):
        assert (text.parent / target).exists(), target


@pytest.mark.parametrize("folder", sorted({path.parent for path in RESULTS.glob("*/summary.md")}), ids=lambda p: p.name)
def test_files_that_a_summary_names_are_there(folder: Path) -> None:
    for name in named_in(folder / "summary.md"):
        assert (folder / name).is_file(), name
