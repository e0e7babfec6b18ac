"""Records that users choose by name with options: methods and tests, built and checked in one way."""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Iterable, Mapping
from typing import Any

from pl_mc.input_errors import InputError, nearest, require_choice


def build_named(name: str, classes: Mapping[str, type], options: Mapping[str, Any], *, what: str) -> Any:
    """The record of that name; an `InputError` names what is unknown and the nearest choice.

    Args:
        name: one of ``classes``.
        classes: frozen dataclasses by name.
        options: their fields; lists, which experiment files have, become tuples, since records are hashable.
        what: what such a record is called, ``method`` or ``test``.
    """
    cls = classes[require_choice(name, classes, field=what)]
    fields = [field.name for field in dataclasses.fields(cls)]
    for option in options:
        if option not in fields:
            raise InputError(f"{what} {name}: the option {option!r} is unknown ({nearest(option, fields)}).")
    return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in options.items()})


def as_records(items: Any, classes: Mapping[str, type], protocol: Any, *, what: str) -> tuple[Any, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name.

    Args:
        items: a sequence of names of ``classes`` and of records.
        classes: frozen dataclasses by name.
        protocol: what every record has to be, a protocol or a union of them.
        what: what such a record is called.
    """
    if isinstance(items, str) or not isinstance(items, Iterable):
        given = "a word" if isinstance(items, str) else repr(items)
        raise InputError(f"{what}s: a sequence of {what}s is needed, such as {tuple(classes)}, not {given}.")
    made = tuple(build_named(item, classes, {}, what=what) if isinstance(item, str) else item for item in items)
    if not made:
        raise InputError(f"{what}s: at least one {what} is needed.")
    for item in made:
        # A compiled function is found again by its records, so they have to be hashable.
        if isinstance(item, type) or not isinstance(item, protocol) or not isinstance(item, Hashable):
            raise InputError(f"{what}s: {item!r} is no {what} (valid names: {', '.join(classes)}).")
    names = [item.name for item in made]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{what}s: {name} is asked for twice.")
    return made
