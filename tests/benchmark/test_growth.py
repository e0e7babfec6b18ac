"""The study of growth with the number of geometries: chunks change what is held, not what comes out."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

PLACE = Path(__file__).parents[2] / "benchmarks" / "growth.py"


@pytest.fixture
def growth(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("growth", PLACE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "growth", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("standard", ["v3", "v4.2"])
def test_levels_in_chunks_are_those_of_all_at_once(growth: ModuleType, standard: str) -> None:
    """Each chunk is simulated anew from its own first epoch, and the last one is not full."""
    whole, chunks = growth.araim(standard, 30, 30), growth.araim(standard, 30, 12)
    assert chunks["points"] == whole["points"] == 30
    assert chunks["vpl_median_m"] == pytest.approx(whole["vpl_median_m"], abs=1e-9)
    assert 0 < whole["vpl_median_m"] < 100
    assert min(whole["wall_s"], whole["processor_s"]) > 0
