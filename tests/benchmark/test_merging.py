"""The study of very many parts: what it writes is what a merge takes."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from reference.scripts import loaded


@pytest.fixture
def merging(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return loaded("merging", monkeypatch)


def test_parts_that_nobody_counted_are_merged(
    merging: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some are written, the others are copies with another number: a merge takes them alike, or refuses them."""
    monkeypatch.setattr(merging, "REALLY_WRITTEN", 2)
    found = merging.merged(3, tmp_path / "parts")
    files = list((tmp_path / "parts").glob("part-*.parquet"))
    assert len(files) == found["parts"] >= 3
    assert found["part_bytes"] == sum(path.stat().st_size for path in files) / len(files)
