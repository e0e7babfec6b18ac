"""The study of growth with the number of geometries: chunks change what is held, not what comes out."""

from __future__ import annotations

from types import ModuleType

import pytest

from reference.scripts import loaded


@pytest.fixture
def growth(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return loaded("growth", monkeypatch)


@pytest.mark.parametrize("standard", ["v3", "v4.2"])
def test_levels_in_chunks_are_those_of_all_at_once(growth: ModuleType, standard: str) -> None:
    """Each chunk is simulated anew from its own first epoch, and the last one is not full."""
    whole, chunks = growth.araim(standard, 30, 30), growth.araim(standard, 30, 12)
    assert chunks["points"] == whole["points"] == 30
    assert chunks["vpl_median_m"] == pytest.approx(whole["vpl_median_m"], abs=1e-9)
    assert 0 < whole["vpl_median_m"] < 100
    assert min(whole["wall_s"], whole["processor_s"]) > 0
