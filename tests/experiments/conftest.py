"""A finished run that a file of tests shares, and copies of it to be changed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from reference.small_run import SMALL


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "small"
    run_experiment("small", build_experiment(SMALL, source="small"), folder)
    return folder


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "small"))
