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


def test_a_check_loads_what_compiles_and_no_tables() -> None:
    # Parts of libraries: they themselves may wait.
    names = (
        "pandas.core",
        "pyarrow.lib",
        "scipy.special._ufuncs",
        "scipy.stats",
        "scipy.optimize",
        "matplotlib",
        "PIL",
    )
    assert loaded(command("check", "ramp"), "jax", *names) == {"jax"}


def test_a_name_that_is_unknown_is_so_at_once() -> None:
    refused = "import contextlib\nwith contextlib.suppress(SystemExit):\n    "
    for arguments in (("run", "rmap"), ("check", "rmap"), ("run", "none.toml")):
        assert loaded(f"{refused}{command(*arguments)}".replace("\nmain", "\n    main"), *HEAVY) == set()


def test_nothing_is_drawn_before_there_is_something_to_draw() -> None:
    every = "import pl_mc.experiments.running\nfrom pl_mc.studies.registry import KINDS\nlist(KINDS.values())"
    assert loaded(every, "jax", "matplotlib", "PIL", "scipy.stats", "scipy.optimize") == {"jax"}


WAITING = """
import sys, threading
from pl_mc.runtime.late_imports import late_imports
with late_imports():
    import pandas as pd
    import pyarrow.parquet as pq
    from scipy import special
parts = ("pandas.core", "pyarrow.lib", "scipy.special._ufuncs")
assert not set(parts) & set(sys.modules)
frames = []
threads = [threading.Thread(target=lambda: frames.append(pd.DataFrame({"a": [1, 2]}))) for _ in range(8)]
for one in threads:
    one.start()
for one in threads:
    one.join()
assert [list(frame["a"]) for frame in frames] == [[1, 2]] * 8
assert "scipy.special._ufuncs" not in sys.modules
assert special.ndtri(0.5) == 0.0
frames[0].to_parquet("/dev/null")
assert pq.ParquetFile is sys.modules["pyarrow.parquet"].ParquetFile
assert type(pd) is type(sys) and pd.api.types.is_float(1.0)
try:
    pd.no_such_name
except AttributeError as error:
    assert "no_such_name" in str(error)
else:
    raise AssertionError
"""


def test_libraries_that_waited_are_whole_when_they_are_used() -> None:
    assert loaded(WAITING, "pandas.core", "pyarrow.lib") == {"pandas.core", "pyarrow.lib"}
