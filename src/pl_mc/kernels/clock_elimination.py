"""Elimination where every row of the design has one clock at most, as with one clock for each system.

Clocks then meet in N with coordinates alone. All of them are eliminated at once, which leaves three equations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.small_matrix import lower_triangle

# Columns of the design that are coordinates; the others are clocks.
COORDINATES = 3

Result = TypeVar("Result")


def clocks_apart(t: int) -> list[tuple[int, int]]:
    """Row and column of each element of N that can differ from zero where every row of the design has one clock.

    Those of the coordinates come first, as in `lower_triangle`, then for each clock those with the coordinates and its
    own.
    """
    clocks = range(COORDINATES, t)
    return lower_triangle(COORDINATES) + [(clock, k) for clock in clocks for k in (*range(COORDINATES), clock)]


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
        packed: N in the order of `clocks_apart`, along the first axis; what follows is not looked at.
        right: (t, ...), the right-hand side.
        floor: (t,), the smallest acceptable pivots in this order of elimination.
        empty: (t,), 1 for a clock that drops out of the problem, else 0.
        go: (), whether to solve at all; without it nothing is regular.
        cofactors: whether these are wanted.
    """
    t = right.shape[0]
    clocks = range(COORDINATES, t)
    place = {entry: k for k, entry in enumerate(clocks_apart(t))}

    def shared(packed: Array, clock: int) -> Array:
        first = place[clock, 0]
        return packed[first : first + COORDINATES]

    def without_clocks(packed: Array, right: Array) -> tuple[tuple[Array, ...], Array, tuple[Array, ...], Array]:
        # Row by row of the lower triangle, in slices: nothing is gathered.
        left = [packed[place[k, 0] : place[k, k] + 1] for k in range(COORDINATES)]
        sides = right[:COORDINATES]
        regular = jnp.ones(right.shape[1:], bool)
        inverses = []
        for clock in clocks:
            pivot = packed[place[clock, clock]] + empty[clock]
            sound = (pivot >= floor[clock]) & (pivot > 0)
            regular = regular & sound
            inverses.append(1.0 / jnp.where(sound, pivot, jnp.ones_like(pivot)))
            column = shared(packed, clock)
            scaled = column * inverses[-1]
            left = [row - column[k] * scaled[: k + 1] for k, row in enumerate(left)]
            sides = sides - scaled * right[clock]
        return tuple(left), sides, tuple(inverses), regular

    def coordinates(left: tuple[Array, ...], sides: Array) -> tuple[tuple[Array, ...], tuple[Array, ...], Array]:
        # By Cramer's rule, which has one division; a compiler repeats the rest for each result at little cost.
        a, b, c, d, e, f = left[0][0], left[1][0], left[2][0], left[1][1], left[2][1], left[2][2]
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
