"""What starting costs: which libraries a command loads, rather than seconds, which are those of a machine."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from pl_mc.runtime import late_imports

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


def test_a_library_that_waits_is_loaded_in_its_own_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "large_one/__init__.py": "from .core import Frame\nimport large_one.more\nKNOWN = 1\n"
        "def __getattr__(name):\n    if name == 'found_late':\n        return 42\n    raise AttributeError(name)\n",
        "large_one/core.py": "import large_one\nclass Frame: pass\n",
        "large_one/more.py": "import large_one.core as core\nMORE = core.Frame\n",
        "large_one/tables.py": "import large_one\nTABLE = large_one.KNOWN\n",
        "spoilt_one/__init__.py": "raise ImportError('its library is gone')\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(late_imports, "_LATE", ("large_one", "spoilt_one"))
    with late_imports.late_imports():
        tables, spoilt = (importlib.import_module(name) for name in ("large_one.tables", "spoilt_one"))
        large = importlib.import_module("large_one")
    assert "large_one.core" not in sys.modules
    assert (tables.TABLE, large.found_late, large.more.MORE) == (1, 42, large.Frame)
    assert not hasattr(large, "nothing")
    for _ in range(2):
        with pytest.raises(ImportError, match="its library is gone"):
            spoilt.anything  # noqa: B018
    for name in [name for name in sys.modules if name.partition(".")[0] in ("large_one", "spoilt_one")]:
        monkeypatch.delitem(sys.modules, name)
