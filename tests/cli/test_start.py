"""What starting costs: which libraries a command loads, rather than seconds, which are those of a machine."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = (
    "jax",
    "jaxlib",
    "pandas",
    "pyarrow",
    "scipy",
    "matplotlib",
    "PIL",
    "pydantic",
    "pl_mc.engine",
    "pl_mc.methods",
)
LISTED = "import sys; print('LOADED', *(set({names!r}) & set(sys.modules)))"


def loaded(program: str, *names: str) -> set[str]:
    """Those of the modules that are there after a program."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", f"{program}\n{LISTED.format(names=names)}"],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("LOADED")[2].split())


def command(*arguments: str) -> str:
    return f"from pl_mc.cli.main import main\nmain({list(arguments)!r})"


def test_the_package_loads_nothing() -> None:
    assert loaded("import pl_mc", "numpy", "rich", "cyclopts", *HEAVY) == set()


@pytest.mark.parametrize(
    "arguments", [("--help",), ("run", "--help"), ("--version",), ("list",), ("list", "--json"), ("list", "-q")]
)
def test_texts_need_no_library(arguments: tuple[str, ...]) -> None:
    assert loaded(command(*arguments), *HEAVY) == set()


def test_a_check_loads_what_compiles_and_nothing_that_draws_or_fits() -> None:
    assert loaded(command("check", "ramp"), "jax", "scipy.stats", "scipy.optimize", "matplotlib", "PIL") == {"jax"}


def test_a_name_that_is_unknown_is_so_at_once() -> None:
    refused = "import contextlib\nwith contextlib.suppress(SystemExit):\n    "
    for arguments in (("run", "rmap"), ("check", "rmap"), ("run", "none.toml")):
        assert loaded(f"{refused}{command(*arguments)}".replace("\nmain", "\n    main"), *HEAVY) == set()


def test_nothing_is_drawn_before_there_is_something_to_draw() -> None:
    every = "import pl_mc.experiments.running\nfrom pl_mc.studies.registry import KINDS\nlist(KINDS.values())"
    assert loaded(every, "jax", "matplotlib", "PIL", "scipy.stats", "scipy.optimize") == {"jax"}
