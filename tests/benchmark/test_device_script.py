"""The script that measures a device: it runs on a processor, with few libraries, and its checks can fail."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pl_mc

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "device.py"
# A machine with JAX, NumPy, SciPy and pandas alone.
MISSING = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"pyarrow", "pydantic", "pymap3d", "cyclopts", "rich", "matplotlib", "PIL"}:
            raise ModuleNotFoundError(f"no {name} here", name=name)
sys.meta_path.insert(0, Missing())
"""


def test_it_runs_in_seconds_with_few_libraries(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(MISSING)
    few_libraries = {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--quick", "--out", str(tmp_path / "device.json")],
        env=os.environ | few_libraries, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert json.loads((tmp_path / "device.json").read_text()) == found
    assert found["passed"]
    assert found["backend"] == "cpu"
    for precision in ("float64", "float32"):
        about = {one["what"]: one for one in found["checks"] if one["precision"] == precision}
        assert len(about) == 3
        assert about["against the processor, draw by draw"]["decided_otherwise"] == 0
        assert about["against the processor, draw by draw"]["largest_difference_of_counts"]["ls"] == 0
        assert found["arithmetic_limit_gflops"][precision] > 0
        ratio = next(one for one in found["ratios"] if one["precision"] == precision)
        assert ratio["to_all_cores_of_the_processor"] > 0
        assert ratio["of_the_arithmetic_limit"] > 0
    assert [one["precision"] for one in found["rates"]] == ["float64", "float32"]
    assert all(one["million_scenarios_per_s"] > 0 for one in found["rates"] + found["rates_of_the_processor"])


@pytest.fixture(scope="module")
def script() -> Any:
    spec = importlib.util.spec_from_file_location("device", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = sys.path[:]
    spec.loader.exec_module(module)
    sys.path[:] = before
    return module


@pytest.fixture
def scope(script: Any) -> Any:
    scope = script.Scope(quick=True, seconds=10.0)
    scope.precisions = ("float64",)
    return scope


@pytest.fixture
def arrays(scope: Any) -> dict[str, np.ndarray]:
    """What a device gives that is right: counts of the exact law, and eight draws."""
    exact = pl_mc.exact.ls_rates(*scope.problem(12))
    counts = np.zeros((2, scope.steps, 9), dtype=np.int64)
    for column, event in ((0, "alarm"), (1, "hazard"), (3, "exceeded"), (4, "misleading")):
        counts[0, :, column] = np.round(exact[f"{event}_rate"] * scope.draws)
    sample = np.ones((8, 7))
    return {"counts float64": counts, "again float64": counts.copy(), "sample float64": sample}


def failed(script: Any, scope: Any, ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> list[str]:
    return [one["what"] for one in script.checks(scope, ours, theirs) if not one["passed"]]


def test_a_device_that_counts_rightly_passes(script: Any, scope: Any, arrays: dict[str, np.ndarray]) -> None:
    assert failed(script, scope, arrays, arrays) == []


def test_one_that_counts_wrongly_fails(script: Any, scope: Any, arrays: dict[str, np.ndarray]) -> None:
    for shift in (scope.draws // 8, -1, scope.draws):
        wrong = arrays | {"counts float64": arrays["counts float64"] + np.int64(shift)}
        assert "least squares against the exact law" in failed(script, scope, wrong, arrays)
    once = arrays["again float64"].copy()
    once[1, -1, 0] += 1
    assert failed(script, scope, arrays | {"again float64": once}, arrays) == ["counted again: bitwise equal"]
    assert failed(script, scope, arrays | {"spread float64": once}, arrays) == [
        "spread over all devices: bitwise equal"
    ]
    other = arrays["sample float64"].copy()
    other[:4, -1] = 0.0
    assert failed(script, scope, arrays | {"sample float64": other}, arrays) == ["against the processor, draw by draw"]


def test_operations_grow_with_satellites_and_solutions(script: Any) -> None:
    # Ten solutions of 24 satellites, counted by hand: 24 (9 + 28 + 8 + 4) + 125 / 3 + 50 each.
    assert script.operations(24, 20) == pytest.approx(10 * (24 * 49 + 125 / 3 + 50) + 240 + 108)
