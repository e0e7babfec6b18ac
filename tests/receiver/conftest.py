"""Shared inputs of the receiver tests: a made-up pair of files."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import hatanaka
import pytest
from receiver_files import Sky, navigation_text, observation_text, simulate, write_pair


@pytest.fixture(scope="session")
def made_sky() -> Sky:
    """Three epochs with 30 m added to G05 and 20 m taken from C22."""
    return simulate(bias_m={"G05": 30.0, "C22": -20.0})


@pytest.fixture(scope="session")
def made_files(made_sky: Sky, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Observation and navigation file of `made_sky`."""
    return write_pair(tmp_path_factory.mktemp("made"), observation_text(made_sky), navigation_text(made_sky.orbits))


@pytest.fixture(scope="session")
def plain(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The path of a real file by its name. Hatanaka's compression is undone once: a test of its own is about that."""
    folder = tmp_path_factory.mktemp("plain")

    def path_of(name: str) -> Path:
        path, undone = data_folder / name, folder / name.replace(".crx", ".rnx").removesuffix(".gz")
        if ".crx" not in name:
            return path
        if not undone.exists():
            content = path.read_bytes()
            undone.write_bytes(hatanaka.crx2rnx(gzip.decompress(content) if path.suffix == ".gz" else content))
        return undone

    return path_of
