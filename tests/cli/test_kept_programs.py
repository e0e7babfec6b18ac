"""Programs that the command line keeps: found by the next process, never in the way, and never another answer."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pl_mc.runtime import kept_programs
from pl_mc.runtime.kept_programs import KeptPrograms, cache_folder
from reference.forked import Forked

OF_JAX = "JAX_COMPILATION_CACHE_DIR"
# Says how many programs JAX looked for, and how many of them it found.
COUNTED = """
import jax, jax.numpy as jnp
from collections import Counter
seen = Counter()
jax.monitoring.register_event_listener(lambda event, **_: seen.update([event.rpartition("/")[2]]))
from pl_mc.runtime.kept_programs import keep_programs
keep_programs()
# However busy the machine is.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
print(float(jax.jit(lambda x: jnp.sum(jnp.cos(x) @ jnp.sin(x).T))(jnp.arange(12.0).reshape(3, 4))))
print(seen["compile_requests_use_cache"], seen["cache_hits"])
"""
SMALL = """
kind = "sweep"
title = "Least squares, one bias"
methods = ["ls"]
draws = 512
[geometry]
epochs = 1
[faults]
biases = ["G01:+20m"]
"""


def environment(**variables: str) -> dict[str, str]:
    """The variables of a process whose cache is not that of the suite."""
    ours = (OF_JAX, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", kept_programs.VARIABLE)
    return {name: value for name, value in os.environ.items() if name not in ours} | variables


def answered(folder: Path | str, *, forked: bool = True, **variables: str) -> tuple[str, int, int]:
    """What the small program prints: its number, the programs that it looked for, and those that it found."""
    given = environment(**{kept_programs.VARIABLE: str(folder)} | variables)
    if forked:
        out, err = Forked(COUNTED, env=given).communicate()
    else:
        done = subprocess.run(
            [sys.executable, "-c", COUNTED], env=given, capture_output=True, text=True, timeout=240, check=True
        )
        out, err = done.stdout, done.stderr
    assert err == ""
    number, asked, found = out.split()
    return number, int(asked), int(found)


def kept(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*/*")}


def sound(content: bytes) -> bool:
    return content[:32] == hashlib.sha256(content[32:]).digest()


def test_the_next_process_finds_them_and_spoilt_ones_are_mended(tmp_path: Path) -> None:
    folder = tmp_path / "programs"
    number, asked, found = answered(folder)
    assert asked > 0 == found
    first = kept(folder)
    assert first
    assert all(map(sound, first.values()))
    again = answered(folder)
    assert again[0] == number
    assert again[2] >= len(first)
    assert kept(folder) == first
    for spoil in (lambda old: b"", lambda old: old[:-7], lambda old: old[:50] + bytes([old[50] ^ 1]) + old[51:]):
        for path in folder.glob("*/*"):
            path.write_bytes(spoil(path.read_bytes()))
        assert answered(folder)[::2] == (number, 0)
        assert set(kept(folder)) == set(first)
        assert all(map(sound, kept(folder).values()))
    # Deleted at any time.
    for path in folder.glob("*/*"):
        path.unlink()
    assert answered(folder)[::2] == (number, 0)


@pytest.mark.parametrize("folder", ["off", "/dev/null/programs", "/proc/programs"])
def test_without_a_folder_all_is_compiled_and_nothing_is_said(folder: str, tmp_path: Path) -> None:
    variables = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    assert answered(folder, **variables)[2] == answered(folder, **variables)[2] == 0
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_ones_own_choice_is_left_to_jax(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    variables = {OF_JAX: str(theirs), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    # JAX reads its variables as it is imported.
    number = answered(ours, forked=False, **variables)[0]
    files = list(theirs.iterdir())
    assert files
    assert answered(ours, forked=False, **variables)[2] > 0
    for path in files:
        path.write_bytes(b"spoilt")
    assert answered(ours, forked=False, **variables)[::2] == (number, 0)
    assert not ours.exists()


def test_the_library_keeps_nothing(tmp_path: Path) -> None:
    program = "import jax, pl_mc; pl_mc.sweep; print(jax.config.jax_compilation_cache_dir)"
    variables = environment(**{kept_programs.VARIABLE: str(tmp_path / "programs")})
    done = subprocess.run(
        [sys.executable, "-c", program], env=variables, capture_output=True, text=True, timeout=240, check=True
    )
    assert done.stdout == "None\n"
    assert list(tmp_path.iterdir()) == []


def test_counts_are_the_same_with_kept_programs_and_without(tmp_path: Path) -> None:
    file = tmp_path / "small.toml"
    file.write_text(SMALL)
    tables = []
    for number, folder in enumerate(("off", str(tmp_path / "programs"), str(tmp_path / "programs"))):
        out = tmp_path / f"out{number}"
        done = Forked(
            "from pl_mc.cli.main import main\nmain()", ["run", str(file), "--out", str(out), "-q"],
            env=environment(**{kept_programs.VARIABLE: folder}),
        )  # fmt: skip
        assert done.communicate() == (f"{out}\n", "")
        tables.append((out / "rates.csv").read_bytes())
    assert kept(tmp_path / "programs")
    assert tables[0] == tables[1] == tables[2]


def test_a_full_disk_keeps_nothing_and_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    programs = KeptPrograms(tmp_path)
    programs.put("a", b"program")
    monkeypatch.setattr(kept_programs, "write_whole", full)
    programs.put("b", b"program")
    assert programs.get("a") == b"program"
    assert programs.get("b") is None


def test_each_sort_of_processor_has_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    read, changes = Path.read_text, {"avx2": "sse4_2", "cpu MHz": "cpu MHz 1", "model name": "model name of another"}
    names = [kept_programs._processor()]
    for old, new in changes.items():
        changed = lambda self, *args, old=old, new=new, **kwargs: read(self, *args, **kwargs).replace(old, new)  # noqa: E731
        monkeypatch.setattr(Path, "read_text", changed)
        names.append(kept_programs._processor())
    monkeypatch.setattr(Path, "read_text", read)
    if Path("/proc/cpuinfo").exists() and "avx2" in Path("/proc/cpuinfo").read_text():
        assert names[0] == names[2]
        assert len(set(names)) == 3
    monkeypatch.setattr(kept_programs.platform, "machine", lambda: "riscv64")
    assert kept_programs._processor() not in names


def test_the_oldest_go_when_there_are_too_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for age, name in enumerate(("new", "old", "older", "oldest")):
        path = tmp_path / f"processor{age % 2}" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"0" * 100)
        os.utime(path, (1_000_000_000 - age, 1_000_000_000 - age))
    kept_programs._make_room(tmp_path)
    assert len(kept(tmp_path)) == 4
    monkeypatch.setattr(kept_programs, "MOST_BYTES", 399)
    kept_programs._make_room(tmp_path)
    assert set(kept(tmp_path)) == {"new"}


def test_the_folder_is_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv(kept_programs.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert cache_folder() == Path("/cache/pl_mc/programs")
    for relative in ("", "cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", relative)
        assert cache_folder() == tmp_path / ".cache" / "pl_mc" / "programs"
    monkeypatch.setenv(kept_programs.VARIABLE, "~/mine")
    assert cache_folder() == tmp_path / "mine"
