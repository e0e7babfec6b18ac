"""Records whose numbers JAX can see: leaves of a pytree, beside structure that shapes the program.

A compiled function takes such records as arguments like arrays: another number compiles nothing, and `jax.grad` and
`jax.vmap` go through. A constructor checks numbers alone, and leaves arrays and what JAX traces unread.
"""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import numpy as np

from pl_mc.input_errors import InputError, require_positive

Record = TypeVar("Record")

# Records as arguments of a compiled function, of which `of_trees` makes them again inside.
Trees = tuple[Any, ...]


def static(default: Any) -> Any:
    """A field of a record that is structure: what shapes the compiled program, hashable."""
    return dataclasses.field(default=default, metadata={"static": True})


def traced(cls: type[Record]) -> type[Record]:
    """Make a frozen dataclass a pytree whose fields are its leaves, but for those made by `static`.

    As `jax.tree_util.register_dataclass`, except that what JAX builds again is not checked again, and that a number
    zero, a word, true or false, and a function or record which is no pytree, may stand in any field and count as
    structure. A subclass is one of its own.
    """
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]
    leaves = [field.name for field in fields if not field.metadata.get("static")]
    structure = [field.name for field in fields if field.metadata.get("static")]

    def flatten(record: Record) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        children = tuple(_child(getattr(record, name)) for name in leaves)
        return children, tuple(getattr(record, name) for name in structure)

    def flatten_with_keys(record: Record) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        children, rest = flatten(record)
        keys = map(jax.tree_util.GetAttrKey, leaves)
        return tuple(zip(keys, children, strict=True)), rest

    def unflatten(rest: tuple[Any, ...], children: Iterable[Any]) -> Record:
        record = object.__new__(cls)
        for name, value in zip((*leaves, *structure), (*children, *rest), strict=True):
            object.__setattr__(record, name, value.record if isinstance(value, Structure) else value)
        return record

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Structure:
    """Something hashable that is all structure, as a pytree without leaves."""

    record: Any = dataclasses.field(metadata={"static": True})


def _child(value: Any) -> Any:
    if isinstance(value, bool | str):
        return Structure(value)
    if isinstance(value, numbers.Real):
        # A zero switches something off, and what is off costs nothing. Whole numbers become floats, since a function
        # would be compiled once more for them.
        return float(value) if value else Structure(0.0)
    return Structure(value) if callable(value) and _opaque(value) else value


def _opaque(value: Any) -> bool:
    return jax.tree_util.all_leaves((value,))


def as_trees(records: Iterable[Any]) -> Trees:
    """Records as pytrees; those that are none are structure."""
    return tuple(Structure(record) if _opaque(record) else record for record in records)


def of_trees(trees: Trees) -> tuple[Any, ...]:
    """The records of `as_trees`, inside that function."""
    return tuple(tree.record if isinstance(tree, Structure) else tree for tree in trees)


def is_array(value: Any) -> bool:
    """Whether a value is an array, or stands for one while JAX traces: then no check can read it."""
    return isinstance(value, jax.Array | np.ndarray)


def is_off(value: Any) -> bool:
    """Whether a value is the number zero, and no array: what it stands for is switched off."""
    return not is_array(value) and value == 0


def checkable(*values: Any) -> bool:
    """Whether none of the values `is_array`, so that they are to be checked."""
    return not any(map(is_array, values))


def require_positive_leaf(value: float | jax.Array, *, field: str) -> None:
    """Raise `InputError` for a number that is not positive; arrays go unread."""
    if not is_array(value):
        require_positive(value, field=field)  # type: ignore[arg-type]


def with_numbers(record: Record) -> Record:
    """The record with numbers in place of arrays of one; an `InputError` for other arrays, and for what JAX traces."""
    if not dataclasses.is_dataclass(record) or isinstance(record, type):
        return record
    arrays = {f.name: value for f in dataclasses.fields(record) if is_array(value := getattr(record, f.name))}
    for name, value in arrays.items():
        if isinstance(value, jax.core.Tracer) or value.size != 1:
            raise InputError(
                f"{getattr(record, 'key', type(record).__name__)}: {name}: one number is needed, not an array of shape "
                f"{value.shape} or what JAX traces; "
                "under jax.vmap, jax.grad or jax.jit take the functions of pl_mc.kernels."
            )
    return dataclasses.replace(record, **{name: value.item() for name, value in arrays.items()}) if arrays else record
