"""Small symmetric matrices: Cholesky factors element by element, and elimination for batches of scenarios.

A matrix is a packed list of its lower triangle; each element is an array over scenarios of any shape. No LAPACK
routine is called: a batch of them deadlocks in jaxlib 0.10 on few cores, and is slow for matrices of this size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
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


def eliminate(packed: Array, right: Array, floor: Array, go: Array) -> tuple[Array, Array]:
    """x with N x = right by Gauss-Jordan elimination, without pivoting: N is positive definite or of no use.

    Each stage stands in a conditional. That skips the work where no scenario wants it; above all it keeps a
    compiler from fusing stages, which would compute the early ones again in every later one.

    Args:
        packed: (t (t + 1) / 2, ...), N in the order of `lower_triangle`.
        right: (t, k, ...), k right-hand sides.
        floor: (t,), the smallest acceptable pivots, which are those of a Cholesky factor.
        go: (), whether to solve at all.

    Returns:
        (t, k, ...), the solutions, and (...), whether every pivot reached its floor and is positive; where not, or
        without ``go``, the solution is finite but meaningless.
    """
    t = floor.shape[0]
    place = {entry: k for k, entry in enumerate(lower_triangle(t))}
    full = packed[np.array([[place[max(i, j), min(i, j)] for j in range(t)] for i in range(t)])]
    table = jnp.concatenate([full, right], axis=1)
    row_number = jnp.arange(t, dtype=jnp.int32).reshape((t,) + (1,) * (table.ndim - 1))
    regular = jnp.ones(table.shape[2:], bool)
    for k in range(t):

        def stage(table: Array, regular: Array, k: int = k) -> tuple[Array, Array]:
            pivot = table[k, 0]
            sound = (pivot >= floor[k]) & (pivot > 0)
            row = table[k, 1:] * (1.0 / jnp.where(sound, pivot, jnp.ones_like(pivot)))
            rest = table[:, 1:] - table[:, :1] * row[None]
            return jnp.where(row_number == k, row[None], rest), regular & sound

        def skip(table: Array, regular: Array) -> tuple[Array, Array]:
            return table[:, 1:], regular

        table, regular = jax.lax.cond(go, stage, skip, table, regular)
    return table, regular


def _forward_substitute(factor: Cholesky, right: Sequence[Array] | Array, *, start: int) -> list[Array]:
    """y with L y = right, where the elements before ``start`` are zero and left out of ``right`` and of y."""
    found: list[Array] = []
    for i in range(start, len(factor.inverse_diagonal)):
        value = right[i - start]
        for k in range(start, i):
            value = value - factor.lower[i, k] * found[k - start]
        found.append(value * factor.inverse_diagonal[i])
    return found
