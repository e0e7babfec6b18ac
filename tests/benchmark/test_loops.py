"""The script that measures the other loops: it runs on several trees, and says where one has no such call."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from reference.scripts import BENCHMARKS, loaded

SCRIPT = BENCHMARKS / "loops.py"


@pytest.fixture
def loops(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return loaded("loops", monkeypatch)


def test_trees_are_measured_in_turn(tmp_path: Path) -> None:
    """This tree beside itself gives the same bits; a package without the call gives a row that says so."""
    (tmp_path / "pl_mc").mkdir()
    (tmp_path / "pl_mc" / "__init__.py").write_text("def simulate(**options):\n    return [None]\n")
    command = [sys.executable, str(SCRIPT), "--short", "--rounds", "1", "--calls", "1", "--loop", "worst_case, ls"]
    trees = [
        "--tree",
        f"other={tmp_path}",
        "--tree",
        f"same={SCRIPT.parents[1] / 'src'}",
        "--out",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command + trees, env=os.environ, capture_output=True, text=True, timeout=280, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    with (tmp_path / "out" / "loops.csv").open(encoding="utf-8", newline="") as file:
        other, same, this = csv.DictReader(file)
    assert other["answer"].startswith("no such call (AttributeError: module 'pl_mc' has no attribute 'worst_case'")
    assert (other["wall_s"], same["answer"], this["answer"]) == ("", "", "the same bits")
    for row in (same, this):
        assert float(row["first_wall_s"]) > 0
        assert float(row["cpu_s"]) > 0
    text = (tmp_path / "out" / "loops.md").read_text(encoding="utf-8")
    assert done.stdout.splitlines()[-1] in text
    assert "- worst_case, ls: misleading, all pairs, exact." in text


@pytest.mark.parametrize("name", ["detect", "service_volume", "araim, fixed rows", "calibrate, counted"])
def test_a_call_gives_the_same_bits_again(loops: ModuleType, name: str) -> None:
    first, again = loops.worker(name, True, 1), loops.worker(name, True, 0)
    assert len(first["times"]) == 2
    assert first["bits"] == again["bits"]


def test_geometries_are_the_same_with_every_satellite_in_its_row(loops: ModuleType) -> None:
    """Rows in view first, or each satellite in a row of its own: the same rows are in view."""
    packed, fixed = loops._skies(30, packed=True), loops._skies(30, packed=False)
    assert fixed["in_view"].shape == (30, 48)
    for k in range(30):
        one, other = packed["in_view"][k], fixed["in_view"][k]
        assert one.sum() == other.sum() > 8
        assert (packed["design"][k][one] == fixed["design"][k][other]).all()
