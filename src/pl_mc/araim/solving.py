"""Solution separation: position solutions without the satellites of each fault mode.

How far those solutions stand from the one with all satellites decides the thresholds of the tests, and so the levels
of `pl_mc.araim.risk_equations`. Everything is whitened (rows of the design divided by sigma). Fault modes and
geometries run along the last two axes; satellites are the outer loop, so that all sums are elementwise and no axis
is short where it matters.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from pl_mc.geometry.record import EAST, NORTH, UP
from pl_mc.kernels.linear_model import COORDINATES
from pl_mc.kernels.small_matrix import cholesky, lower_triangle, pivot_floor, solve


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Whole:
    """The solution with all satellites in view, for each of ``g`` geometries; meaningless where not regular.

    Attributes:
        sigma_m: (3, g), standard deviation under the integrity model, east, north, up [m].
        bias_m: (3, g), largest effect of the nominal biases [m].
        sigma_accuracy_m: (3, g), standard deviation under the accuracy model [m].
        regular: (g,), whether there is such a solution.
        gain: (3, n, g), what a whitened observation adds to the position [m].
    """

    sigma_m: Array
    bias_m: Array
    sigma_accuracy_m: Array
    regular: Array
    gain: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Subsets:
    """The solutions of ``m`` fault modes for each of ``g`` geometries; east, north, up along the axis of length 3.

    Attributes:
        difference: (3, n, m, g), what a whitened observation adds to the difference from the solution with all
            satellites [m]; exactly zero where there is no difference but rounding.
        sigma_m: (3, m, g), standard deviation under the integrity model [m].
        bias_m: (3, m, g), largest effect of the nominal biases [m].
        sigma_separation_m: (3, m, g), standard deviation of that difference under the accuracy model [m].
        regular: (m, g), whether the satellites that are left determine a position; where not, all is finite and
            meaningless.
    """

    difference: Array
    sigma_m: Array
    bias_m: Array
    sigma_separation_m: Array
    regular: Array


def separation_floor(dtype: jax.typing.DTypeLike) -> float:
    """Differences of two solutions below this share of their standard deviation are rounding."""
    return max(1e-9, 1e3 * float(jnp.finfo(dtype).eps))


def fit_subsets(
    design: Array, in_view: Array, excluded: Array, bias_ratio: Array, accuracy_ratio: Array
) -> tuple[Whole, Subsets]:
    """Least squares with all satellites, and without those of each mode (ADD v3.0: S^(k), sigma, b, sigma_ss).

    A clock that no satellite left observes drops out.

    Args:
        design: (n, t, g), whitened design, zero on padding [1/m].
        in_view: (n, g), which rows count; excluded: (n, m, g), which satellites each mode leaves out.
        bias_ratio, accuracy_ratio: (n, g), nominal bias over sigma, accuracy over integrity variance.
    """
    t = design.shape[1]
    places = lower_triangle(t)
    rows, columns = np.array(places).T
    # The first of the modes leaves nothing out.
    kept = in_view[:, None] & ~jnp.concatenate([jnp.zeros_like(excluded[:, :1]), excluded], axis=1)
    mask = kept.astype(design.dtype)
    shape = mask.shape[1:]

    def add_row(packed: Array, row: tuple[Array, Array]) -> tuple[Array, None]:
        a, used = row
        return packed + (a[rows] * a[columns])[:, None] * used[None], None

    # One axis more, of length one, over which east, north and up are spread below.
    packed = jax.lax.scan(add_row, jnp.zeros((len(places), *shape), design.dtype), (design, mask))[0][:, None]
    # A clock that nothing observes has an element of exactly zero, being a sum of products with zeros.
    idle = (packed == 0) & jnp.asarray((rows == columns) & (rows >= COORDINATES))[:, None, None, None]
    packed = jnp.where(idle, 1.0, packed)
    factor = cholesky(packed, pivot_floor(packed[rows == columns]))
    # Columns of the inverse, which are its rows: (3, m, g) for each unknown.
    units = [jnp.broadcast_to(jnp.asarray(unit, design.dtype)[:, None, None], (3, *shape)) for unit in np.eye(t, 3)]
    inverse = solve(factor, units)

    def add_satellite(
        total: tuple[Array, Array, Array], row: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array, Array], tuple[Array, Array]]:
        bias, square, own = total
        a, used, nominal, accuracy = row
        gain = used[None] * sum(x * a[j][None, None] for j, x in enumerate(inverse))
        step = gain - gain[:, :1]
        scale = accuracy[None, None]
        total = (
            bias + jnp.abs(gain) * nominal[None, None],
            square + step * step * scale,
            own + (gain[:, :1] * gain[:, :1] * scale)[:, 0],
        )
        return total, (step[:, 1:], gain[:, 0])

    start = jnp.zeros((COORDINATES, *shape), design.dtype)
    (bias, square, own), (difference, gain) = jax.lax.scan(
        add_satellite, (start, start, start[:, 0]), (design, mask, bias_ratio, accuracy_ratio)
    )
    sigma = jnp.sqrt(jnp.stack([jnp.maximum(inverse[q][q], 0.0) for q in range(COORDINATES)]))
    regular = factor.regular[0]
    separation = jnp.sqrt(square)
    differs = (separation > separation_floor(design.dtype) * sigma)[:, 1:]
    whole = Whole(sigma[:, 0], bias[:, 0], jnp.sqrt(own), regular[0], jnp.moveaxis(gain, 0, 1))
    modes = Subsets(
        difference=jnp.where(differs[:, None], jnp.moveaxis(difference, 0, 1), 0.0),
        sigma_m=sigma[:, 1:],
        bias_m=bias[:, 1:],
        sigma_separation_m=jnp.where(differs, separation[:, 1:], 0.0),
        regular=regular[1:],
    )
    return whole, modes


def by_axis(horizontal: ArrayLike, vertical: ArrayLike) -> NDArray[np.float64]:
    """(3, ...), what belongs to each axis."""
    values = {EAST: horizontal, NORTH: horizontal, UP: vertical}
    return np.stack([np.asarray(values[q], dtype=float) for q in sorted(values)])
