"""Files unpacked within limits, whatever packed them; what is damaged or never ends is a sentence."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import random
import zipfile
from collections.abc import Callable
from pathlib import Path

import hatanaka
import ncompress
import pytest
from receiver_files import navigation_text, observation_text, orbits, simulate

from pl_mc.input_errors import InputError
from pl_mc.receiver import read_rinex
from pl_mc.runtime import unpacking
from pl_mc.runtime.unpacking import read_unzipped

TEXT = observation_text(simulate(seconds=(0.0, 30.0))).encode()


def zipped(content: bytes, count: int = 1) -> bytes:
    """An archive with that content, and empty files beside it."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.mkdir("day")
        archive.writestr("day/made.obs", content)
        for k in range(1, count):
            archive.writestr(f"day/other{k}", b"")
    return packed.getvalue()


PACKINGS: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.compress,
    "bzip2": bz2.compress,
    "xz": lzma.compress,
    "zip": zipped,
    ".Z": ncompress.compress,
}


@pytest.mark.parametrize("packing", PACKINGS)
def test_what_was_packed_comes_back(packing: str, tmp_path: Path) -> None:
    path = tmp_path / "made"
    path.write_bytes(PACKINGS[packing](TEXT))
    assert read_unzipped(path) == TEXT
    path.write_bytes(zipped(PACKINGS[packing](hatanaka.rnx2crx(TEXT))))
    (tmp_path / "nav").write_text(navigation_text(orbits()))
    assert len(read_rinex(path, tmp_path / "nav").time_gps_s) == 2


@pytest.mark.parametrize("size", [0, 1, 2, 300, 70_000, 600_000])
@pytest.mark.parametrize("alphabet", [b"a", b"0123456789 .", bytes(range(256))])
def test_compress_is_undone_whatever_it_packed(size: int, alphabet: bytes, tmp_path: Path) -> None:
    """Longer codes, a table that is full and one that is cleared are all among these."""
    content = bytes(random.Random(size).choices(alphabet, k=size)) + b"ab" * size
    path = tmp_path / "made.Z"
    path.write_bytes(ncompress.compress(content))
    assert read_unzipped(path) == content


@pytest.mark.parametrize("packing", PACKINGS)
def test_damaged_packings_are_refused_or_seen_later(packing: str, tmp_path: Path) -> None:
    path = tmp_path / "made"
    packed = PACKINGS[packing](TEXT)
    path.write_bytes(packed[: len(packed) // 2])
    if packing == ".Z":
        # It has no sum of its content, so that a cut shows in what it holds alone.
        assert TEXT.startswith(read_unzipped(path))
        path.write_bytes(packed[:3] + b"\xff" * 40)
    with pytest.raises(InputError, match=f"made: the {packing} file is cut short or damaged"):
        read_unzipped(path)


def test_archives_of_other_than_one_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "made.zip"
    path.write_bytes(zipped(TEXT, 3))
    with pytest.raises(InputError, match=r"it holds 3 files, and one is needed; unpack it"):
        read_unzipped(path)


@pytest.mark.parametrize("packing", PACKINGS)
def test_files_that_unpack_to_too_much_are_refused(
    packing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "LARGEST_BYTES", len(TEXT) - 1)
    bomb = tmp_path / "bomb"
    bomb.write_bytes(PACKINGS[packing](b"0" * 1_000_000))
    assert bomb.stat().st_size < len(TEXT)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_unzipped(bomb)
    plain = tmp_path / "plain"
    plain.write_bytes(TEXT)
    with pytest.raises(InputError, match="longer than"):
        read_unzipped(plain)


def test_files_of_more_lines_than_anyone_writes_are_refused(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb"
    bomb.write_bytes(bz2.compress(b"\r" * 20_000_001))
    with pytest.raises(InputError, match="more than 20 million lines; cut it into"):
        read_unzipped(bomb)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have no name here")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="no regular file"):
        read_unzipped(tmp_path / "pipe")
