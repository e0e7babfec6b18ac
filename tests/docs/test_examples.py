"""Every public function and record has an example in its docstring, and the examples run as they are printed."""

from __future__ import annotations

import doctest
import inspect
from typing import Any

import pandas as pd
import pytest

import pl_mc

PUBLIC = {
    name: value for name in pl_mc.__all__ if inspect.isfunction(value := getattr(pl_mc, name)) or inspect.isclass(value)
}
PUBLIC["exact.ls_rates"] = pl_mc.exact.ls_rates


@pytest.mark.parametrize("name", PUBLIC)
def test_the_example_of(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    found = inspect.cleandoc(PUBLIC[name].__doc__ or "")
    (example,) = [doctest.DocTestParser().get_doctest(found, {}, name, None, 0)]
    assert example.examples, f"{name}: its docstring has no example"
    said: list[str] = []
    with pd.option_context("display.width", 120, "display.max_columns", 20):
        doctest.DocTestRunner(verbose=False).run(example, out=said.append)
    assert not said, "".join(said)
