"""Data that is shipped is named, with whose it is, and who cites finds what CITATION.cff needs."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path

import yaml

import pl_mc

ROOT = Path(__file__).parents[2]
DATA = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
VECTORS = ROOT / "src" / "pl_mc" / "conformance" / "vectors"
# What is written here, not data of others.
OWN = {".py", ".pyi", ".toml", ".md", ".typed", ".html", ".js", ".css", ".pyc"}


def test_every_file_of_data_is_named_with_its_source() -> None:
    folders = (ROOT / "src", ROOT / "tests", ROOT / "experiments", ROOT / "benchmarks")
    found = [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.suffix not in OWN]
    assert len(found) > 20
    shared = re.findall(r"`([\w*.]+)`", (VECTORS / "README.md").read_text(encoding="utf-8"))
    for path in found:
        listed = path.parent == VECTORS and any(fnmatch(path.name, pattern) for pattern in shared)
        assert listed or f"{path.name}`" in DATA, path.name
    rows = [line.strip("|").split("|") for line in DATA.splitlines() if re.match(r"\| [^-]", line)]
    assert all(len(row) == 3 and all(cell.strip() for cell in row) for row in rows)


def test_files_that_are_named_are_there() -> None:
    for name in re.findall(r"`((?:tests|geometry|conformance|report)/[\w./]+)`", DATA):
        assert (ROOT / name).exists() or (ROOT / "src" / "pl_mc" / name).exists(), name


def test_the_citation_has_what_its_format_asks_for() -> None:
    """Citation File Format 1.2.0: four fields that it requires, and those that say which version."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] in ("software", "dataset")
    assert all(set(one) & {"name", "family-names"} for one in citation["authors"])
    assert citation["version"] == pl_mc.__version__
    assert citation["license"] == "MIT"
