"""Cholesky factors of small symmetric matrices, written out element by element.

A matrix is a packed list of its lower triangle; each element is an array over scenarios of any shape. No LAPACK
routine is called: a batch of them deadlocks in jaxlib 0.10 on few cores, and is slow for matrices of this size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

# A pivot below this fraction of the same pivot of the fault-free matrix leaves the solution undetermined; in single
# precision the rounding of the pivot itself is larger.
PIVOT_FLOOR = 1e-10


def pivot_floor(pivots: Array) -> Array:
    """The smallest acceptable pivots of a reweighted matrix, from those of the fault-free one."""
    return max(PIVOT_FLOOR, 10.0 * float(jnp.finfo(pivots.dtype).eps)) * pivots


def lower_triangle(t: int) -> list[tuple[int, int]]:
    """Row and column of each packed element of a t x t lower triangle: (0,0), (1,0), (1,1), (2,0), ..."""
    return [(row, column) for row in range(t) for column in range(row + 1)]


class Cholesky(NamedTuple):
    """A factor L of L L' = N.

    Attributes:
        lower: elements L[row, column] below the diagonal.
        inverse_diagonal: (t, ...), 1 / L[j, j].
        pivots: (t, ...), L[j, j]^2 as found, before any guard.
        regular: (...), whether every pivot reached its floor; where False the factor is finite but meaningless.
    """

    lower: dict[tuple[int, int], Array]
    inverse_diagonal: list[Array]
    pivots: list[Array]
    regular: Array


def cholesky(packed: Sequence[Array] | Array, floor: Sequence[Array] | Array) -> Cholesky:
    """Factor a packed symmetric matrix; pivots below ``floor`` (t,), or not positive, are flagged.

    Args:
        packed: t (t + 1) / 2 elements, in the order of `lower_triangle`.
        floor: the smallest acceptable value of each pivot.
    """
    t = len(floor)
    element = {place: packed[k] for k, place in enumerate(lower_triangle(t))}
    lower: dict[tuple[int, int], Array] = {}
    inverse_diagonal: list[Array] = []
    pivots: list[Array] = []
    regular = jnp.ones_like(element[0, 0], dtype=bool)
    for j in range(t):
        pivot = element[j, j]
        for k in range(j):
            pivot = pivot - lower[j, k] * lower[j, k]
        # A column of zeros has a pivot and a floor of zero.
        sound = (pivot >= floor[j]) & (pivot > 0)
        regular = regular & sound
        pivots.append(pivot)
        inverse_diagonal.append(jax.lax.rsqrt(jnp.where(sound, pivot, jnp.ones_like(pivot))))
        for i in range(j + 1, t):
            value = element[i, j]
            for k in range(j):
                value = value - lower[i, k] * lower[j, k]
            lower[i, j] = value * inverse_diagonal[j]
    return Cholesky(lower, inverse_diagonal, pivots, regular)


def solve(factor: Cholesky, right: Sequence[Array] | Array) -> list[Array]:
    """x with N x = right, for the t elements of ``right``."""
    t = len(factor.inverse_diagonal)
    forward = _forward_substitute(factor, right, start=0)
    solution: list[Array] = [forward[0]] * t
    for i in reversed(range(t)):
        value = forward[i]
        for k in range(i + 1, t):
            value = value - factor.lower[k, i] * solution[k]
        solution[i] = value * factor.inverse_diagonal[i]
    return solution


def inverse_columns(factor: Cholesky) -> list[list[Array]]:
    """Columns of L^-1, each from its diagonal element down; N^-1 = sum over rows of their products."""
    t = len(factor.inverse_diagonal)
    one = jnp.ones_like(factor.inverse_diagonal[0])
    zero = jnp.zeros_like(one)
    return [_forward_substitute(factor, [one] + [zero] * (t - 1 - j), start=j) for j in range(t)]


def inverse_diagonal_element(factor: Cholesky, index: int) -> Array:
    """(N^-1)[index, index], the squared length of a column of L^-1."""
    one = jnp.ones_like(factor.inverse_diagonal[0])
    unit = [one] + [jnp.zeros_like(one)] * (len(factor.inverse_diagonal) - 1 - index)
    return sum_of_squares(_forward_substitute(factor, unit, start=index))


def sum_of_squares(values: Sequence[Array]) -> Array:
    """The sum of the squares of a list of arrays."""
    total = values[0] * values[0]
    for value in values[1:]:
        total = total + value * value
    return total


def _forward_substitute(factor: Cholesky, right: Sequence[Array] | Array, *, start: int) -> list[Array]:
    """y with L y = right, where the elements before ``start`` are zero and left out of ``right`` and of y."""
    found: list[Array] = []
    for i in range(start, len(factor.inverse_diagonal)):
        value = right[i - start]
        for k in range(start, i):
            value = value - factor.lower[i, k] * found[k - start]
        found.append(value * factor.inverse_diagonal[i])
    return found
