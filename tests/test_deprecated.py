"""Names of earlier versions: all work, warn with today's name where they are used, and are in the upgrade notes."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import pl_mc
from pl_mc import injection
from pl_mc.deprecated import MOVED

NOTES = (Path(__file__).parents[1] / "docs" / "upgrading.md").read_text(encoding="utf-8")


def modules_and_names(old: str) -> tuple[ModuleType, str, Any]:
    """A module, a name in it that has moved, and what it is today."""
    row = MOVED[old]
    today = importlib.import_module(row.found) if "_" not in row.found.split(".")[-1] else None
    if today is not None:
        name = next(name for name, value in vars(today).items() if getattr(value, "__module__", "") == row.found)
        return importlib.import_module(old), name, getattr(today, name)
    (place, _, name), (new_place, _, new_name) = old.rpartition("."), row.found.rpartition(".")
    return importlib.import_module(place), name, getattr(importlib.import_module(new_place), new_name)


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_warns_where_it_is_used_and_is_what_it_was(old: str) -> None:
    row = MOVED[old]
    module, name, today = modules_and_names(old)
    with pytest.warns(DeprecationWarning, match=rf"{old} is {row.instead} since .*; {row.gone_with} will not") as said:
        value = getattr(module, name)
    assert [one.filename for one in said] == [__file__]
    assert value is today
    # What to write in its place is there.
    place, _, name = row.instead.rpartition(".")
    assert getattr(importlib.import_module(place), name) is not None
    # Not yet gone.
    numbers = [[int(part) for part in version.split(".")] for version in (pl_mc.__version__, row.gone_with)]
    assert numbers == sorted(numbers)
    assert numbers[0] != numbers[1]
    assert f"`{old}`" in NOTES


def test_what_was_written_for_0_1_0_still_injects() -> None:
    g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=3)
    errors_m = np.zeros(g.sigma_m.shape)
    with pytest.warns(DeprecationWarning, match="0.4.0 will not"):
        biases = [injection.parse_injection("G08:+30m:1-2"), injection.Injection("G01", -5.0)]
    with pytest.warns(DeprecationWarning, match=r"inject of a list is pl_mc\.biases"):
        old = injection.inject(g, errors_m, biases)
    new = injection.inject(g, errors_m, pl_mc.biases(g, "G08:+30m:1-2,G01:-5m"))
    assert np.array_equal(old[0], new[0])
    assert np.array_equal(old[1], new[1])
    assert old[2] == new[2] == ()


def test_no_name_that_was_never_there_is_found() -> None:
    with pytest.raises(AttributeError, match="parse_injections"):
        _ = injection.parse_injections  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="EVENT"):
        _ = importlib.import_module("pl_mc.engine.events").EVENT
