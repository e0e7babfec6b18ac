"""Machine code in one piece, and loops over few lanes: how a processor is kept in its first cache.

The compiler makes a function of each operation of a program. Calling one costs a processor some 70 ns, and one solution
of a reweighted estimate has forty of them, so that many lanes have to share each call: too many for its first cache.
What stands in a call with the attributes below becomes one function, whatever is in it, and few lanes are enough.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import jaxpr_as_fun

Moving = TypeVar("Moving")

# The first makes one function of a call, the second keeps the call; a compiler that does not know them ignores them.
_ATTRIBUTES = {"xla_cpu_small_call": "true", "inlineable": "false"}

# What such a function can hold (jaxlib 0.10). Sorting, writing to chosen places and what calls a library are not here.
# fmt: off
_HOLDS = {
    "abs", "add", "and", "argmax", "argmin", "atan2", "broadcast_in_dim", "ceil", "clamp", "concatenate", "cond",
    "convert_element_type", "copy", "cos", "cumsum", "custom_jvp_call", "custom_vjp_call", "div", "dot_general",
    "dynamic_slice", "dynamic_update_slice", "eq", "exp", "expand_dims", "floor", "gather", "ge", "gt",
    "integer_pow", "iota", "is_finite", "jit", "le", "le_to", "log", "log1p", "lt", "lt_to", "max", "min", "mul",
    "ne", "neg", "not", "or", "pad", "pow", "reduce_and", "reduce_max", "reduce_min", "reduce_or", "reduce_sum",
    "rem", "reshape", "rev", "round", "rsqrt", "scan", "select_n", "sign", "sin", "slice", "split", "sqrt",
    "square", "squeeze", "stack", "stop_gradient", "sub", "transpose", "xor",
}
# fmt: on


def in_one_call(function: Callable[..., Array], *arguments: Any) -> Array | None:
    """``function`` of the arguments, compiled as one function of machine code; None where that cannot hold it."""
    traced = jax.make_jaxpr(function)(*arguments)
    if not all(name in _HOLDS for name in _primitives(traced.jaxpr)):
        return None
    whole = jax.jit(jaxpr_as_fun(traced))
    with set_xla_metadata(**_ATTRIBUTES):
        return whole(*jax.tree.leaves(arguments))[0]


def _primitives(jaxpr: Any) -> Iterator[str]:
    """Names of all operations, those of inner programs included."""
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for given in equation.params.values():
            for one in given if isinstance(given, tuple | list) else (given,):
                inner = getattr(one, "jaxpr", one)
                if hasattr(inner, "eqns"):
                    yield from _primitives(inner)


def by_pieces(function: Callable[[Moving, Any], Moving], moving: Moving, fixed: Any, lanes: int | None) -> Moving:
    """``function(moving, fixed)``, which keeps shapes, for so many lanes (the last axis of everything) at a time.

    All at once where ``lanes`` is None or does not divide their number.
    """
    total = jax.tree.leaves(moving)[0].shape[-1]
    if lanes is None or total % lanes or total == lanes:
        return function(moving, fixed)

    def piece(moving: Moving, first: Array) -> tuple[Moving, None]:
        def cut(one: Array) -> Array:
            return jax.lax.dynamic_slice_in_dim(one, first, lanes, axis=one.ndim - 1)

        def put(one: Array, new: Array) -> Array:
            return jax.lax.dynamic_update_slice_in_dim(one, new, first, axis=one.ndim - 1)

        new = function(jax.tree.map(cut, moving), jax.tree.map(cut, fixed))
        return jax.tree.map(put, moving, new), None

    return jax.lax.scan(piece, moving, jnp.arange(0, total, lanes, dtype=jnp.int32))[0]
