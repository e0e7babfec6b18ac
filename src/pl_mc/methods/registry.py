"""Methods by name, as experiment files and the command line call them."""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Iterable, Sequence
from typing import Any

from pl_mc.input_errors import InputError, nearest, require_choice
from pl_mc.methods.base import Method
from pl_mc.methods.igg3 import Igg3
from pl_mc.methods.ls import Ls

METHODS: dict[str, type] = {"ls": Ls, "igg3": Igg3}


def method(name: str, **options: Any) -> Method:
    """A method by name with its options; an `InputError` names what is unknown and the nearest choice."""
    cls = METHODS[require_choice(name, METHODS, field="method")]
    fields = [field.name for field in dataclasses.fields(cls)]
    for option in options:
        if option not in fields:
            raise InputError(f"method {name}: the option {option!r} is unknown ({nearest(option, fields)}).")
    return cls(**options)


def as_methods(methods: Sequence[str | Method]) -> tuple[Method, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name."""
    if isinstance(methods, str) or not isinstance(methods, Iterable):
        raise InputError(f"methods: a sequence of methods is needed, such as ('ls', 'igg3'), not {methods!r}.")
    made = tuple(method(item) if isinstance(item, str) else item for item in methods)
    if not made:
        raise InputError("methods: at least one method is needed.")
    for item in made:
        # The compiled sweep is found again by its methods, so they have to be hashable.
        if isinstance(item, type) or not isinstance(item, Method) or not isinstance(item, Hashable):
            raise InputError(f"methods: {item!r} is no method (valid names: {', '.join(METHODS)}).")
    names = [item.name for item in made]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"methods: {name} is asked for twice.")
    return made
