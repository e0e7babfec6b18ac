"""What the kernels know of one geometry before any observation: everything that scenarios share.

The model is whitened: row i of the design is divided by sigma_i, so that observations have unit variance. Zhao et
al. 2021, eqs 1-5, with P = diag(1 / sigma^2).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from pl_mc.kernels.clock_elimination import COORDINATES, clocks_apart
from pl_mc.kernels.small_matrix import cholesky, inverse_columns, lower_triangle, pivot_floor, solve
from pl_mc.kernels.twins import Twins, twins_of

# A satellite with a smaller redundancy number is not checked by the others: its residual is always zero.
REDUNDANCY_FLOOR = 1e-10


def has_one_clock_per_row(design: np.ndarray) -> bool:
    """Whether no row of designs (..., n, t) has more than one clock: what `LinearModel.one_clock_per_row` promises."""
    return bool(((design[..., COORDINATES:] != 0).sum(axis=-1) <= 1).all())


def redundancy_floor(dtype: jax.typing.DTypeLike) -> float:
    """The redundancy number below which a residual is nothing but rounding, in the precision at hand."""
    return max(REDUNDANCY_FLOOR, 100.0 * float(jnp.finfo(dtype).eps))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearModel:
    """One geometry, prepared for many scenarios. Rows beyond ``in_view`` are zero and count for nothing.

    Attributes:
        design: (n, t), design rows divided by sigma [1/m].
        weight_root: (n,), 1 / sigma [1/m]; zero on padding.
        in_view: (n,), 1 where the row is a satellite, else 0.
        design_rows: (t, n), the same design with unknowns first: a matrix product runs faster over rows.
        mask_row: (1, n), ``in_view`` as a matrix.
        products: (t (t + 1) / 2 + 1, n), products of pairs of design columns [1/m^2] and the mask: N of any weights
            and their sum are one matrix product with these.
        products_apart: the same without products of two clocks, in the order of `clocks_apart`; empty unless
            ``one_clock_per_row``, where those are zero.
        gain: (t, n), N^-1 A' P^(1/2): the least-squares state is this times the whitened observations [m].
        cofactor: (t,), diagonal of N^-1 [m^2].
        redundancy: (n,), redundancy numbers, the diagonal of I - A N^-1 A' P; zero on padding.
        inverse_residual_sigma: (n,), 1 / sqrt(redundancy), zero where the redundancy number is below its floor.
        twins: satellites that no residual tells apart.
        empty: (t,), 1 for a clock that no satellite in view observes (its unknown is dropped), else 0.
        pivot_floor: (t,), smallest acceptable Cholesky pivots of a reweighted N [1/m^2].
        apart_floor: (t,), the same where clocks are eliminated before coordinates.
        unknowns: number of unknowns, dropped ones not counted.
        dof: n - t, degrees of freedom of the residuals.
        determined: whether there is a solution at all: N regular.
        available: whether one with a posterior variance exists: N regular and n > t.
        one_clock_per_row: whether every row has one clock at most, so that clocks meet in N with coordinates alone;
            a promise of the caller, which allows a faster elimination.
        satellite: (n,), code of each row's satellite (`pl_mc.ism.codes_of`), for methods that tell satellites apart;
            None where nobody said.
        loop_lanes: lanes that iterations take at a time; None for all of them. For `pl_mc.engine`, with whose compiler
            options alone a processor gains by it.
    """

    design: Array
    weight_root: Array
    in_view: Array
    design_rows: Array
    mask_row: Array
    products: Array
    products_apart: Array
    gain: Array
    cofactor: Array
    redundancy: Array
    inverse_residual_sigma: Array
    twins: Twins
    empty: Array
    pivot_floor: Array
    apart_floor: Array
    unknowns: Array
    dof: Array
    determined: Array
    available: Array
    one_clock_per_row: bool = field(default=False, metadata={"static": True})
    satellite: Array | None = None
    loop_lanes: int | None = field(default=None, metadata={"static": True})


def linear_model(
    design: Array, sigma_m: Array, in_view: Array | None = None, *, one_clock_per_row: bool = False,
    satellite: Array | None = None,
) -> LinearModel:  # fmt: skip
    """Prepare one geometry.

    Args:
        design: (n, t), position columns and clock columns [m/m].
        sigma_m: (n,), standard deviations [m].
        in_view: (n,), which rows count; all unless given.
        one_clock_per_row: the caller's promise that every row has one clock at most.
        satellite: (n,), codes of the satellites, for methods that tell them apart.
    """
    n, t = design.shape
    seen = jnp.ones((n,), bool) if in_view is None else jnp.asarray(in_view, bool)
    mask = seen.astype(design.dtype)
    weight_root = jnp.where(seen, 1.0 / jnp.where(seen, sigma_m, 1.0), 0.0).astype(design.dtype)
    whitened = jnp.where(seen[:, None], design, 0.0) * weight_root[:, None]
    products = jnp.stack([whitened[:, j] * whitened[:, k] for j, k in lower_triangle(t)])
    # A clock without satellites drops out of the problem; a coordinate never does.
    unobserved = ~jnp.any(whitened != 0, axis=0) & (jnp.arange(t) >= COORDINATES)
    empty = unobserved.astype(design.dtype)
    packed = add_empty(jnp.sum(products, axis=1), empty)
    diagonal = jnp.stack([packed[k] for k, (row, column) in enumerate(lower_triangle(t)) if row == column])
    factor = cholesky(packed, pivot_floor(diagonal))
    gain = jnp.stack(solve(factor, whitened.T))
    columns = inverse_columns(factor)
    cofactor = jnp.stack([jnp.sum(jnp.stack(column) ** 2) for column in columns])
    # Rows of the orthogonal basis of the fitted space: their squared lengths are the leverages.
    leverage = jnp.sum(whitened * gain.T, axis=1)
    redundancy = jnp.clip(mask - leverage, 0.0, 1.0)
    checked = redundancy >= redundancy_floor(design.dtype)
    inverse_sigma = jnp.where(checked, jax.lax.rsqrt(jnp.where(checked, redundancy, 1.0)), 0.0)
    unknowns = t - jnp.sum(empty)
    dof = jnp.sum(mask) - unknowns
    place = {entry: k for k, entry in enumerate(lower_triangle(t))}
    apart = np.array([place[entry] for entry in clocks_apart(t)] + [len(place)] if one_clock_per_row else [], int)
    products_and_mask = jnp.concatenate([products, mask[None]])
    return LinearModel(
        design=whitened,
        weight_root=weight_root,
        in_view=mask,
        design_rows=whitened.T,
        mask_row=mask[None],
        products=products_and_mask,
        products_apart=products_and_mask[apart],
        gain=gain,
        cofactor=cofactor,
        redundancy=redundancy,
        inverse_residual_sigma=inverse_sigma,
        twins=twins_of(whitened, gain, redundancy, inverse_sigma, redundancy_floor(design.dtype)),
        empty=empty,
        pivot_floor=pivot_floor(jnp.stack(factor.pivots)),
        apart_floor=pivot_floor(_clocks_first_pivots(packed, t)),
        unknowns=unknowns,
        dof=dof,
        determined=factor.regular,
        available=factor.regular & (dof >= 1),
        one_clock_per_row=one_clock_per_row,
        satellite=satellite,
    )


def _clocks_first_pivots(packed: Array, t: int) -> Array:
    """(t,), the pivots of N when clocks are eliminated first, in the order of the unknowns."""
    order = [*range(COORDINATES, t), *range(COORDINATES)]
    place = {entry: k for k, entry in enumerate(lower_triangle(t))}
    moved = [packed[place[max(order[i], order[j]), min(order[i], order[j])]] for i, j in lower_triangle(t)]
    pivots = cholesky(moved, jnp.zeros(t, packed.dtype)).pivots
    return jnp.stack([pivots[order.index(k)] for k in range(t)])


def add_empty(packed: Array, empty: Array) -> Array:
    """The packed normal matrix with a one on the diagonal of each unknown that nothing observes."""
    places = lower_triangle(empty.shape[0])
    diagonal = jnp.stack([empty[row] if row == column else jnp.zeros_like(empty[0]) for row, column in places])
    return packed + per_lane(diagonal, packed)


def per_lane(vector: Array, like: Array) -> Array:
    """``vector`` with as many trailing axes of length one as ``like`` has axes beyond its first."""
    return vector.reshape(vector.shape + (1,) * (like.ndim - 1))


def product(matrix: Array, lanes: Array) -> Array:
    """Matrix product in full precision, also where a device would round its factors by default."""
    return jnp.matmul(matrix, lanes, precision=jax.lax.Precision.HIGHEST)
