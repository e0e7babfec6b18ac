"""Elimination where every row of the design has one clock at most, as with one clock for each system.

Clocks then meet in N with coordinates alone. All of them are eliminated at once, which leaves three equations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.kernels.small_matrix import lower_triangle

COORDINATES = 3

Result = TypeVar("Result")


class Solved(NamedTuple):
    """A solution of the three equations that are left, and of those of the clocks.

    Attributes:
        solution: t of (...).
        cofactors: 3 of (...), the first diagonal elements of N^-1; none unless asked for.
        regular: (...), whether every pivot reached its floor and is positive; where not the rest is finite but
            meaningless.
    """

    solution: tuple[Array, ...]
    cofactors: tuple[Array, ...]
    regular: Array


def eliminate_clocks(
    packed: Array, right: Array, floor: Array, empty: Array, go: Array, *, cofactors: bool = False
) -> Solved:
    """x with N x = right, clocks eliminated first.

    The steps stand in conditionals for the reasons given at `pl_mc.kernels.small_matrix.eliminate`.

    Args:
        packed: (t (t + 1) / 2, ...), N in the order of `lower_triangle`; elements between clocks are not looked at.
        right: (t, ...), the right-hand side.
        floor: (t,), the smallest acceptable pivots in this order of elimination.
        empty: (t,), 1 for a clock that drops out of the problem, else 0.
        go: (), whether to solve at all; without it nothing is regular.
        cofactors: whether these are wanted.
    """
    t = right.shape[0]
    clocks = range(COORDINATES, t)
    place = {entry: k for k, entry in enumerate(lower_triangle(t))}
    square = np.array([[place[max(i, j), min(i, j)] for j in range(COORDINATES)] for i in range(COORDINATES)])

    def shared(packed: Array, clock: int) -> Array:
        first = place[clock, 0]
        return packed[first : first + COORDINATES]

    def without_clocks(packed: Array, right: Array) -> tuple[Array, Array, tuple[Array, ...], Array]:
        left, sides = packed[square], right[:COORDINATES]
        regular = jnp.ones(right.shape[1:], bool)
        inverses = []
        for clock in clocks:
            pivot = packed[place[clock, clock]] + empty[clock]
            sound = (pivot >= floor[clock]) & (pivot > 0)
            regular = regular & sound
            inverses.append(1.0 / jnp.where(sound, pivot, jnp.ones_like(pivot)))
            column = shared(packed, clock)
            scaled = column * inverses[-1]
            left = left - column[:, None] * scaled[None]
            sides = sides - scaled * right[clock]
        return left, sides, tuple(inverses), regular

    def coordinates(left: Array, sides: Array) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
        # By Cramer's rule, which has one division; a compiler repeats the rest for each result at little cost.
        a, b, c, d, e, f = left[0, 0], left[1, 0], left[2, 0], left[1, 1], left[2, 1], left[2, 2]
        minor = ((d * f - e * e, c * e - b * f, b * e - c * d), (a * f - c * c, b * c - a * e), (a * d - b * b,))
        determinant = a * minor[0][0] + b * minor[0][1] + c * minor[0][2]
        # Pivots are a, minor / a and determinant / minor.
        last = minor[2][0]
        sound = (a >= floor[0]) & (last >= floor[1] * a) & (determinant >= floor[2] * last)
        sound = sound & (a > 0) & (last > 0) & (determinant > 0)
        over = 1.0 / jnp.where(sound, determinant, jnp.ones_like(determinant))
        solution = tuple(
            sum(minor[min(i, j)][abs(i - j)] * sides[j] for j in range(COORDINATES)) * over for i in range(COORDINATES)
        )
        return solution, tuple(minor[k][0] * over for k in range(COORDINATES) if cofactors), sound

    def back(
        packed: Array, right: Array, inverses: tuple[Array, ...], position: tuple[Array, ...]
    ) -> tuple[Array, ...]:
        found = []
        for clock, inverse in zip(clocks, inverses, strict=True):
            column = shared(packed, clock)
            found.append((right[clock] - sum(column[k] * position[k] for k in range(COORDINATES))) * inverse)
        return tuple(found)

    left, sides, inverses, regular = _where(go, without_clocks, packed, right)
    position, diagonal, sound = _where(go, coordinates, left, sides)
    times = _where(go, back, packed, right, inverses, position)
    return Solved(position + times, diagonal, regular & sound)


def _where(go: Array, function: Callable[..., Result], *arguments: Any) -> Result:
    """``function`` of the arguments, or zeros."""
    shapes = jax.eval_shape(function, *arguments)

    def nothing(*_: Any) -> Any:
        return jax.tree.map(lambda one: jnp.zeros(one.shape, one.dtype), shapes)

    return jax.lax.cond(go, function, nothing, *arguments)
