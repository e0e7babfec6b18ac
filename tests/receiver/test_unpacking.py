"""Files unpacked within limits: a decompressor that hangs, breaks down or never ends is a sentence."""

from __future__ import annotations

import gzip
import os
import time
from pathlib import Path

import hatanaka
import psutil
import pytest
from receiver_files import observation_text, simulate

from pl_mc.input_errors import InputError
from pl_mc.runtime import unpacking
from pl_mc.runtime.unpacking import read_unpacked, read_unzipped

TEXT = observation_text(simulate(seconds=(0.0, 30.0))).encode()


@pytest.fixture
def compact(tmp_path: Path) -> Path:
    path = tmp_path / "made.crx"
    path.write_bytes(hatanaka.rnx2crx(TEXT))
    return path


def replace_decompressor(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "program.py").write_text(program, encoding="ascii")
    monkeypatch.setattr(unpacking.hatanaka_worker, "__file__", str(tmp_path / "program.py"))
    monkeypatch.setattr(unpacking, "_START_LIMIT_S", 5.0)


def has_ended(pid: int) -> bool:
    """Whether a process is gone, or has ended and waits for its parent to notice."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_what_was_packed_comes_back(compact: Path) -> None:
    assert read_unpacked(compact) == TEXT
    compact.write_bytes(gzip.compress(compact.read_bytes()))
    assert read_unpacked(compact) == TEXT


def test_a_decompressor_that_hangs_is_given_up_with_what_it_started(
    compact: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the real one: a program of Python that waits for a native one."""
    mark = tmp_path / "started"
    replace_decompressor(
        "import pathlib, subprocess\n"
        "child = subprocess.Popen(['sleep', '120'])\n"
        f"pathlib.Path({str(mark)!r}).write_text(str(child.pid))\n"
        "child.wait()\n",
        tmp_path,
        monkeypatch,
    )
    begin = time.monotonic()
    with pytest.raises(InputError, match=r"made.crx: undoing its Hatanaka compression was given up after 5 s"):
        read_unpacked(compact)
    assert time.monotonic() - begin < 30
    started = int(mark.read_text())
    # The signal is sent before `read_unpacked` returns; the system delivers it to what is no child of this process
    # in its own time.
    end = time.monotonic() + 5.0
    while not has_ended(started) and time.monotonic() < end:
        time.sleep(0.01)
    assert has_ended(started)


@pytest.mark.parametrize(
    ("program", "rule"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "the decompressor broke down, exit code -9"),
        ("raise ValueError('no')", "the decompressor broke down, exit code 1"),
        ("import sys; sys.stderr.write('bad'); sys.exit(3)", r"cannot be undone \(bad\)"),
    ],
)
def test_a_decompressor_that_breaks_down_is_a_sentence(
    program: str, rule: str, compact: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_decompressor(program, tmp_path, monkeypatch)
    with pytest.raises(InputError, match=rule) as caught:
        read_unpacked(compact)
    assert "\n" not in str(caught.value)


def test_files_that_unpack_to_too_much_are_refused(
    compact: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "LARGEST_BYTES", len(TEXT) - 1)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_unpacked(compact)
    bomb = tmp_path / "bomb.gz"
    bomb.write_bytes(gzip.compress(b"0" * 1_000_000))
    assert bomb.stat().st_size < len(TEXT)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_unzipped(bomb)
    plain = tmp_path / "plain"
    plain.write_bytes(TEXT)
    with pytest.raises(InputError, match="longer than"):
        read_unzipped(plain)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have no name here")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="no regular file"):
        read_unzipped(tmp_path / "pipe")
