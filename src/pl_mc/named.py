"""Records that users choose by name with options: methods and tests, built and checked in one way."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any

from pl_mc.input_errors import InputError, known_options, require_choice, require_list, shown


def build_named(name: str, classes: Mapping[str, type], options: Mapping[str, Any], *, what: str) -> Any:
    """The record of that name; an `InputError` names what is unknown and the nearest choice.

    Args:
        name: one of ``classes``.
        classes: frozen dataclasses by name.
        options: their fields; lists, which experiment files have, become tuples, since records are hashable.
        what: what such a record is called, ``method`` or ``test``.
    """
    head, bracket, _ = name.partition("(") if isinstance(name, str) else ("", "", "")
    if bracket and head in classes:
        raise InputError(
            f"{what}: {shown(name)}: options do not stand in a name; in an experiment file they are fields beside "
            f'name = "{head}", in Python {what}("{head}", ...).'
        )
    cls = classes[require_choice(name, classes, field=what)]
    return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in options.items()})


def registry(what: str, classes: Mapping[str, type]) -> dict[str, type]:
    """Records by name that refuse an option which they have not, made by name or by their class alike.

    Args:
        what: what such a record is called, ``method`` or ``test``.
        classes: frozen dataclasses by name.
    """
    for name, cls in classes.items():
        known_options(f"{what} {name}")(cls)
    return dict(classes)


def as_records(
    items: Any, classes: Mapping[str, type], protocol: Any, *, what: str, read: Callable[[Any], Any] | None = None
) -> tuple[Any, ...]:
    """Names and records, made records; an `InputError` for none, for strangers and for two of one name.

    Args:
        items: a sequence of names of ``classes`` and of records.
        classes: frozen dataclasses by name.
        protocol: what every record has to be, a protocol or a union of them.
        what: what such a record is called.
        read: makes what is used of a record that was given; the record itself unless given.
    """
    # One may stand alone.
    alone = isinstance(items, str | type | protocol)
    given: list[Any] = [items] if alone else require_list(items, field=f"{what}s", of=f"{what}s")
    made = tuple(build_named(item, classes, {}, what=what) if isinstance(item, str) else item for item in given)
    if not made:
        raise InputError(f"{what}s: at least one {what} is needed.")
    for item in made:
        # A compiled function is found again by its records, so they have to be hashable.
        if isinstance(item, type):
            raise InputError(f"{what}s: {item.__name__} is a class and no {what}; {item.__name__}() makes one.")
        if not isinstance(item, protocol) or not isinstance(item, Hashable):
            raise InputError(f"{what}s: {shown(item)} is no {what} (valid names: {', '.join(classes)}).")
    if read is not None:
        made = tuple(map(read, made))
    names = [str(item.name) for item in made]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{what}s: {name} is asked for twice.")
    return made
