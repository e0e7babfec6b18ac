"""The public names: all there, and importing the package loads nothing heavy."""

from __future__ import annotations

import importlib.metadata
import pkgutil
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

import pl_mc


@pytest.mark.parametrize("name", pl_mc.__all__)
def test_every_public_name_is_found(name: str) -> None:
    assert getattr(pl_mc, name) is not None
    assert name in dir(pl_mc)


def test_the_reference_describes_every_public_name() -> None:
    pages = Path(__file__).parents[1].joinpath("docs", "reference").glob("*.md")
    paths = re.findall(r"^\.\. auto\w+:: (pl_mc(?:\.\w+)+)", "\n".join(map(_text, pages)), re.MULTILINE)
    described = [(path, pkgutil.resolve_name(path)) for path in paths]
    for name in set(pl_mc.__all__) - {"__version__"}:
        value = getattr(pl_mc, name)
        if isinstance(value, ModuleType):
            # A room is described by what is in it.
            assert any(path.startswith((f"pl_mc.{name}.", f"{value.__name__}.")) for path, _ in described), name
        else:
            assert any(value is thing for _, thing in described), name


def test_the_version_is_said_once() -> None:
    assert pl_mc.__version__ == importlib.metadata.version("pl_mc")
    citation = Path(__file__).parents[1].joinpath("CITATION.cff")
    assert f"version: {pl_mc.__version__}\n" in _text(citation)


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def test_the_extra_all_is_what_users_may_want_beside() -> None:
    project = tomllib.loads(_text(Path(__file__).parents[1] / "pyproject.toml"))["project"]
    extras = project["optional-dependencies"]
    of_developers = {"all", "test", "docs", "dev"}
    assert set(extras["all"]) == {f"pl_mc[{name}]" for name in set(extras) - of_developers}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="sweeep"):
        _ = pl_mc.sweeep  # type: ignore[attr-defined]


def test_importing_the_package_leaves_jax_alone() -> None:
    code = "import sys, pl_mc; sys.exit(any(m in sys.modules for m in ('jax', 'pandas', 'matplotlib')))"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
