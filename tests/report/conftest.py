"""What tests of pages share: a browser, and one small results folder."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from browser import Browser, find_browser
from stored_runs import counts, store_run


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Browser:
    """A headless Chromium; tests that need it are skipped where there is none."""
    program = find_browser()
    if program is None:
        pytest.skip("no Chromium is installed here")
    return Browser(program, tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a ramp: least squares alarms more and more, the robust method never."""
    return store_run(
        tmp_path_factory.mktemp("runs") / "small", counts({"ls": (0, 130, 398, 400), "igg3": (0, 0, 0, 0)})
    )
