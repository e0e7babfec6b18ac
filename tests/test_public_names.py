"""The public names: all there, and importing the package loads nothing heavy."""

from __future__ import annotations

import subprocess
import sys

import pytest

import pl_mc


@pytest.mark.parametrize("name", pl_mc.__all__)
def test_every_public_name_is_found(name: str) -> None:
    assert getattr(pl_mc, name) is not None
    assert name in dir(pl_mc)


def test_the_list_of_names_and_the_lazy_table_agree() -> None:
    assert set(pl_mc.__all__) == {*pl_mc._PUBLIC, "__version__"}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="sweeep"):
        _ = pl_mc.sweeep  # type: ignore[attr-defined]


def test_importing_the_package_leaves_jax_alone() -> None:
    code = "import sys, pl_mc; sys.exit(any(m in sys.modules for m in ('jax', 'pandas', 'matplotlib')))"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
