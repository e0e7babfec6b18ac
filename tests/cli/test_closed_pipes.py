"""A reader that has had enough, as in ``pl-mc list | head -3``: commands end quietly, and keep what they wrote."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pl_mc.runtime.closed_pipes import quiet_end

HELP = (("--help",), ("run", "--help"), ("--version",))
TEXTS = (("list",), ("list", "--json"), ("init", "sweep"), ("check", "ramp"), ("check", "ramp", "--json"))


def ended(arguments: tuple[str, ...], *, error_too: bool = False, **variables: str) -> tuple[int, str]:
    """Exit code and standard error of a command whose output nobody reads."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pl_mc.cli.main", *arguments],
            stdout=write, stderr=write if error_too else subprocess.PIPE, text=True, timeout=240,
            env=os.environ | variables,
        )  # fmt: skip
    finally:
        os.close(write)
    return done.returncode, done.stderr or ""


@pytest.mark.parametrize("arguments", [*HELP, *TEXTS])
def test_a_command_that_prints_ends_without_a_word(arguments: tuple[str, ...]) -> None:
    assert ended(arguments, PYTHONUNBUFFERED="") == (141, "")


@pytest.mark.parametrize("arguments", [HELP[0], TEXTS[0]])
def test_one_that_holds_nothing_back_does_too(arguments: tuple[str, ...]) -> None:
    assert ended(arguments, PYTHONUNBUFFERED="1") == (141, "")


@pytest.mark.parametrize("arguments", [("nonsense",), ("run", "nonsense")])
def test_an_error_that_nobody_reads_ends_likewise(arguments: tuple[str, ...]) -> None:
    assert ended(arguments, error_too=True) == (141, "")
    code, said = ended(arguments)
    assert code == 2
    assert said.startswith("pl-mc: ")


def test_a_run_has_written_all_of_its_results(tmp_path: Path) -> None:
    # Least squares alone, since nobody waits here for a compiler.
    experiment = tmp_path / "one.toml"
    experiment.write_text(
        'kind = "sweep"\ntitle = "A bias"\nmethods = ["ls"]\n[geometry]\nepochs = 1\nepoch = 0\n[faults]\n'
        'biases = ["G01:+20m"]\n'
    )
    arguments = ("run", str(experiment), "--draws", "100", "--out", str(tmp_path / "out"), "--json")
    assert ended(arguments) == (141, "")
    assert {"manifest.json", "rates.csv", "rates.png", "report.html", "summary.md"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.toml", "out"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a file that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
# What is short is held back to the end, what is long is written before.
@pytest.mark.parametrize("arguments", [HELP[0], TEXTS[0], TEXTS[1], ("init", "compare-methods")])
def test_a_full_disk_is_told_in_a_sentence(arguments: tuple[str, ...], unbuffered: str) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "pl_mc.cli.main", *arguments], stdout=full, stderr=subprocess.PIPE, text=True,
            timeout=240, check=False, env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (2, "pl-mc: the output cannot be written (no space left on device).\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a file that is always full")
@pytest.mark.parametrize("arguments", [TEXTS[1], ("nonsense",)])
def test_where_nothing_can_be_told_the_code_says_it(arguments: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "pl_mc.cli.main", *arguments]
        done = subprocess.run(command, stdout=full, stderr=full, timeout=240, check=False)
    assert done.returncode == 2


def test_another_pipe_that_breaks_is_an_error() -> None:
    with pytest.raises(BrokenPipeError), quiet_end():
        raise BrokenPipeError("the worker is gone")
    with pytest.raises(FileNotFoundError), quiet_end():
        raise FileNotFoundError("no such file")
    # Nor is a disk full that no standard stream writes to.
    before = sys.stdout
    with pytest.raises(OSError, match="No space"), quiet_end():
        raise OSError(28, "No space left on device")
    assert sys.stdout is before
