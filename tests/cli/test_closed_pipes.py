"""A reader that has had enough, as in ``pl-mc list | head -3``: commands end quietly, and keep what they wrote."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pl_mc.runtime.closed_pipes import quiet_end
from reference.forked import Forked

HELP = (("--help",), ("run", "--help"), ("--version",))
TEXTS = (("list",), ("list", "--json"), ("init", "sweep"), ("check", "ramp"), ("check", "ramp", "--json"))
# What imports libraries for seconds is forked from a process that has them, and ends as any other.
SLOW = ("check", "init")
EXPERIMENT = "one.toml"
COMMAND = "from pl_mc.cli.main import main\nmain()"


def ended_with(
    output: int, arguments: tuple[str, ...], *, error_too: bool = False, **variables: str
) -> tuple[int, str]:
    """Exit code and standard error of a command with such an output."""
    environment, error = os.environ | variables, output if error_too else None
    if arguments[0] in SLOW or EXPERIMENT in arguments:
        process = Forked(COMMAND, arguments, env=environment, stdout=output, stderr=error, whole_end=True)
        said = process.communicate()[1]
        return process.wait(), said
    done = subprocess.run(
        [sys.executable, "-m", "pl_mc.cli.main", *arguments], stdout=output, stderr=error or subprocess.PIPE, text=True,
        timeout=240, check=False, env=environment,
    )  # fmt: skip
    return done.returncode, done.stderr or ""


def ended(arguments: tuple[str, ...], *, error_too: bool = False, **variables: str) -> tuple[int, str]:
    """Exit code and standard error of a command whose output nobody reads."""
    read, write = os.pipe()
    os.close(read)
    try:
        return ended_with(write, arguments, error_too=error_too, **variables)
    finally:
        os.close(write)


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


def test_a_run_has_written_all_of_its_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Least squares alone, since nobody waits here for a compiler.
    monkeypatch.chdir(tmp_path)
    Path(EXPERIMENT).write_text(
        'kind = "sweep"\ntitle = "A bias"\nmethods = ["ls"]\n[geometry]\nepochs = 1\nepoch = 0\n[faults]\n'
        'biases = ["G01:+20m"]\n'
    )
    arguments = ("run", EXPERIMENT, "--draws", "100", "--out", "out", "--json")
    assert ended(arguments) == (141, "")
    assert {"manifest.json", "rates.csv", "rates.png", "report.html", "summary.md"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == [EXPERIMENT, "out"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a file that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
# What is short is held back to the end, what is long is written before.
@pytest.mark.parametrize("arguments", [HELP[0], TEXTS[0], TEXTS[1], ("init", "compare-methods")])
def test_a_full_disk_is_told_in_a_sentence(arguments: tuple[str, ...], unbuffered: str) -> None:
    with open("/dev/full", "w") as full:
        ended_so = ended_with(full.fileno(), arguments, PYTHONUNBUFFERED=unbuffered)
    assert ended_so == (2, "pl-mc: the output cannot be written (no space left on device).\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a file that is always full")
@pytest.mark.parametrize("arguments", [TEXTS[1], ("nonsense",)])
def test_where_nothing_can_be_told_the_code_says_it(arguments: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        assert ended_with(full.fileno(), arguments, error_too=True)[0] == 2


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
