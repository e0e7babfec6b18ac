"""Methods by short names: what tells those of one run apart, and nothing else; a table has all of their options."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import pandas as pd

_OPTIONS = re.compile(r"([a-z][a-z0-9_]*)\((.*)\)")
_LONG_NUMBER = re.compile(r"\d+\.\d{4,}(?:e[+-]?\d+)?")
# Letters of a name that fits into a legend.
_SHORT = 28
# Stands for options that no other method of that name has otherwise.
_HIDDEN = "..."


def options_of(name: str) -> tuple[str, tuple[str, ...]]:
    """What a method is called, and its options as they stand in its name."""
    found = _OPTIONS.fullmatch(name)
    if found is None:
        return name, ()
    parts, depth = [""], 0
    for letter in found[2]:
        depth += (letter in "([{") - (letter in ")]}")
        if depth < 0:
            # The brackets are two pairs.
            return name, ()
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return found[1], tuple(part.strip() for part in parts)


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Short names by whole ones: of methods of one name those options in which they differ, numbers of three digits.

    Names that are no longer than others, and those that would be called the same, stay whole.
    """
    given = {name: options_of(name) for name in dict.fromkeys(names)}
    made = {}
    for name, (base, options) in given.items():
        if len(name) <= _SHORT:
            made[name] = name
            continue
        others = [set(two) for whole, (one, two) in given.items() if one == base and whole != name]
        own = [option for option in options if any(option not in other for other in others)]
        shown = [_LONG_NUMBER.sub(lambda number: f"{float(number[0]):.3g}", option) for option in own]
        hidden = [_HIDDEN] if len(own) < len(options) else []
        made[name] = f"{base}({', '.join([*shown, *hidden])})" if shown or hidden else base
    twice = [short for short in made.values() if list(made.values()).count(short) > 1]
    return {name: name if short in twice else short for name, short in made.items()}


def methods_in(tables: Iterable[pd.DataFrame]) -> dict[str, str]:
    """The short names of all methods that tables name."""
    columns = [table["method"] for table in tables if "method" in table]
    return short_names(str(name) for column in columns for name in column.dropna().unique())


def hidden_options(short: Mapping[str, str]) -> list[tuple[str, str]]:
    """Short name and whole name of those methods of which the short one does not say all."""
    return [(called, whole) for whole, called in short.items() if called != whole]
