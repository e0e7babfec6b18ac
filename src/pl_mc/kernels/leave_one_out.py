"""Least squares without some satellites, from the solution with all of them: exact, and without another solve.

In whitened form, z = A x + noise of unit variance, let R = I - A N^-1 A' (so that e = R z are the residuals and r
its diagonal) and G = N^-1 A'. Leaving satellite i out is then a step of rank one,

    f = e_i / sqrt(r_i),   u = (R; G)_i / sqrt(r_i),   (e; x) <- (e; x) - u f,   (R; G) <- (R; G) - u u_R',
    V'PV <- V'PV - f^2,   N^-1 <- N^-1 + u_G u_G',

which is the Sherman-Morrison formula; f is Baarda's w of the satellite. The new R and G belong to the satellites
that are left and can be stepped again. A satellite with r_i = 0 is not checked by the others: without it the
position is undetermined, unless it is alone in its system and serves to find that system's clock only.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from pl_mc.kernels.estimate import LeastSquaresSolution
from pl_mc.kernels.linear_model import COORDINATES, LinearModel, per_lane, product, redundancy_floor
from pl_mc.kernels.roots import safe_sqrt

# Elements of the covariance of a position that levels need: east, north and up variances, east-north covariance.
_FIRST, _SECOND = (0, 1, 2, 0), (0, 1, 2, 1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Projections:
    """What a geometry decides.

    Attributes:
        rows: (n + 3, n), R above the coordinates of G [-, m]; zero on padding.
        free: (n,), whether a satellite is alone in its system: it has no part in the position and no check.
    """

    rows: Array
    free: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Remaining:
    """Least squares of the satellites that are left (``...``, the lanes, or nothing for the geometry alone).

    Attributes:
        combined: (n + 3, ...), whitened residuals e above the east, north, up error [m].
        redundancy: (n, ...), their redundancy numbers; zero for what is left out.
        covariance_m2: (4, ...), of the position: EE, NN, UU, EN, with the model's own sigma [m^2].
        dof: (...), degrees of freedom.
        steps: one (n + 3, ...) vector u for each satellite left out.
    """

    combined: Array
    redundancy: Array
    covariance_m2: Array
    dof: Array
    steps: tuple[Array, ...] = ()

    @property
    def residuals(self) -> Array:
        return self.combined[:-COORDINATES]

    @property
    def error_m(self) -> Array:
        return self.combined[-COORDINATES:]


def projections(model: LinearModel) -> Projections:
    """R, G and the satellites without a part in the position."""
    residual = jnp.diag(model.in_view) - product(model.design, model.gain)
    clocks = model.design[:, COORDINATES:] != 0
    alone = jnp.sum(clocks, axis=0, dtype=jnp.int32) == 1
    free = jnp.any(clocks & alone[None], axis=1)
    # What rounding leaves of them must not look like a check, or like an effect.
    coordinates = jnp.where(free[None], 0.0, model.gain[:COORDINATES])
    residual = jnp.where(free[None] | free[:, None], 0.0, residual)
    return Projections(rows=jnp.concatenate([residual, coordinates]), free=free)


def all_in_view(model: LinearModel, parts: Projections, start: LeastSquaresSolution) -> Remaining:
    """The solution with every satellite, before any is left out."""
    shape = start.square_sum.shape
    redundancy = jnp.where(parts.free, 0.0, model.redundancy)
    covariance = covariance_of(parts.rows[-COORDINATES:])
    return Remaining(
        combined=jnp.concatenate([start.residuals, start.state[:COORDINATES]]),
        redundancy=jnp.broadcast_to(per_lane(redundancy, start.residuals), start.residuals.shape),
        covariance_m2=jnp.broadcast_to(per_lane(covariance, start.residuals), (len(_FIRST), *shape)),
        dof=jnp.broadcast_to(model.dof, shape),
    )


def before_observations(model: LinearModel, parts: Projections) -> Remaining:
    """The same for the geometry alone: residuals and error are zero."""
    zeros = LeastSquaresSolution(jnp.zeros_like(model.in_view), jnp.zeros_like(model.empty), jnp.zeros_like(model.dof))
    return all_in_view(model, parts, zeros)


def covariance_of(gain: Array) -> Array:
    """(4,), covariance EE, NN, UU, EN of the position ``gain`` (3, n) times observations of unit variance."""
    square = product(gain, gain.T)
    return jnp.stack([square[j, k] for j, k in zip(_FIRST, _SECOND, strict=True)])


def standardised(left: Remaining) -> Array:
    """(n, ...), |w_i| = |e_i| / sqrt(r_i) (Baarda 1968); zero where nothing checks the satellite."""
    return jnp.abs(left.residuals) * _inverse_root(left.redundancy)


def pick(sizes: Array) -> tuple[Array, Array, Array]:
    """The satellite with the largest of ``sizes`` (n, ...).

    Returns:
        (...), the largest; (n, ...), 1 at the first satellite that has it and 0 elsewhere; and (...), whether no
        other has it too, but for rounding. Satellites whose faults look the same in the residuals do, in every
        draw.
    """
    largest, place = jnp.max(sizes, axis=0), jnp.argmax(sizes, axis=0)
    rows = jnp.arange(sizes.shape[0], dtype=place.dtype)
    equal = sizes >= (largest * (1.0 - equality(sizes.dtype)))[None]
    unique = jnp.sum(equal, axis=0, dtype=jnp.int32) == 1
    return largest, (per_lane(rows, sizes) == place[None]).astype(sizes.dtype), unique


def leave_out(parts: Projections, left: Remaining, satellite: Array, go: Array) -> Remaining:
    """The same without one satellite in each lane.

    Args:
        parts: those of the geometry.
        left: before.
        satellite: (n, ...), 1 for the satellite, 0 for the others; one that is not checked stays.
        go: (...), where to do it.
    """
    chosen = jnp.where(go[None], satellite, 0.0)
    step = product(parts.rows, chosen)
    for earlier in left.steps:
        step = step - earlier * _dot(earlier[:-COORDINATES], chosen)[None]
    redundancy = _dot(left.redundancy, chosen)
    inverse_root = _inverse_root(redundancy)
    step = step * inverse_root[None]
    size = _dot(left.residuals, chosen) * inverse_root
    out = redundancy >= redundancy_floor(chosen.dtype)
    kept = jnp.where(out[None], 1.0 - chosen, 1.0)
    move = step[-COORDINATES:]
    square = jnp.stack([move[j] * move[k] for j, k in zip(_FIRST, _SECOND, strict=True)])
    return Remaining(
        combined=left.combined - step * size[None],
        redundancy=jnp.maximum(left.redundancy - step[:-COORDINATES] ** 2, 0.0) * kept,
        covariance_m2=left.covariance_m2 + square,
        dof=left.dof - out.astype(left.dof.dtype),
        steps=(*left.steps, step),
    )


def adopt(where: Array, after: Remaining, before: Remaining) -> Remaining:
    """``after``, which is one step on from ``before``, in the lanes of ``where``, and ``before`` in the others."""
    return Remaining(
        combined=jnp.where(where[None], after.combined, before.combined),
        redundancy=jnp.where(where[None], after.redundancy, before.redundancy),
        covariance_m2=jnp.where(where[None], after.covariance_m2, before.covariance_m2),
        dof=jnp.where(where, after.dof, before.dof),
        steps=(*before.steps, jnp.where(where[None], after.steps[-1], 0.0)),
    )


def square_sum(model: LinearModel, left: Remaining) -> Array:
    """(...), V'PV of the satellites that are left."""
    return product(model.mask_row, left.residuals * left.residuals)[0]


def slopes(parts: Projections, left: Remaining) -> Array:
    """(2, ...), largest horizontal and vertical error [m] that one fault causes per unit of sqrt(noncentrality).

    |G_q,i| / sqrt(r_i) over the satellites that are left; infinite where a satellite moves the position and nothing
    checks it.
    """
    gain = per_lane(parts.rows[-COORDINATES:], left.redundancy)
    for step in left.steps:
        gain = gain - step[-COORDINATES:, None] * step[None, :-COORDINATES]
    return largest_slopes(gain, left.redundancy, left.covariance_m2)


def largest_slopes(gain: Array, redundancy: Array, covariance_m2: Array) -> Array:
    """(2, ...), the largest horizontal and vertical slope of ``gain`` (3, n, ...), as `slopes` describes them."""
    inverse = _inverse_root(redundancy)
    squared = gain * gain
    effects = ((squared[0] + squared[1], covariance_m2[0] + covariance_m2[1]), (squared[2], covariance_m2[2]))
    found = []
    for effect, whole in effects:
        unchecked = (inverse == 0) & (effect > effect_floor(effect.dtype) ** 2 * whole[None])
        # As a sum of squares and a root of the largest: no root of zero, whose gradient is infinite.
        size = jnp.where(unchecked, jnp.inf, effect * inverse * inverse)
        largest = jnp.max(size, axis=0)
        finite = jnp.isfinite(largest)
        found.append(jnp.where(finite, safe_sqrt(jnp.where(finite, largest, 1.0)), jnp.inf))
    return jnp.stack(found)


def major_axis(covariance_m2: Array) -> Array:
    """(...), standard deviation along the longest axis of the horizontal error ellipse [m] (RTCA DO-229, d_major).

    Args:
        covariance_m2: (4, ...), EE, NN, UU, EN [m^2].
    """
    east, north, _, cross = covariance_m2
    half = 0.5 * (east - north)
    return safe_sqrt(0.5 * (east + north) + safe_sqrt(half * half + cross * cross))


def parity_basis(model: LinearModel, parts: Projections) -> tuple[Array, Array]:
    """Rows of an orthonormal basis of parity space, and the redundant satellites that it was made from.

    Cholesky's factorisation of R with the largest remaining diagonal first. Its rows Q obey Q A = 0, Q Q' = I and
    Q'Q = R. The pivots are the satellites whose absence costs the others least; what is left beside them determines
    the unknowns, and no more.

    Returns:
        (n, n), the basis in the first n - t rows and zeros below, in whitened observations; and (n, n), 1 in row k
        at the satellite of pivot k.
    """
    residual = parts.rows[:-COORDINATES]
    n, dtype = residual.shape[0], residual.dtype
    numbers = jnp.arange(n, dtype=jnp.int32)

    def add_row(k: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        basis, pivots, diagonal = state
        chosen = (numbers == jnp.argmax(diagonal).astype(jnp.int32)).astype(dtype)
        largest = jnp.max(diagonal)
        column = product(residual, chosen) - product(basis.T, product(basis, chosen))
        sound = (k < model.dof) & (largest >= redundancy_floor(dtype))
        row = jnp.where(sound, column * jax.lax.rsqrt(jnp.where(sound, largest, 1.0)), 0.0)
        diagonal = jnp.maximum(diagonal - row * row, 0.0) * (1.0 - chosen)
        here = numbers == k
        basis = jnp.where(here[:, None], row[None], basis)
        return basis, jnp.where(here[:, None] & sound, chosen[None], pivots), diagonal

    zeros = jnp.zeros((n, n), dtype)
    basis, pivots, _ = jax.lax.fori_loop(0, n, add_row, (zeros, zeros, jnp.diagonal(residual)))
    return basis, pivots


def effect_floor(dtype: jax.typing.DTypeLike) -> float:
    """Effects on the position below this share of its standard deviation are rounding."""
    return max(1e-9, 1e3 * float(jnp.finfo(dtype).eps))


def equality(dtype: jax.typing.DTypeLike) -> float:
    """Relative difference below which two standardised residuals are the same number."""
    return max(1e-7, 300.0 * float(jnp.finfo(dtype).eps))


def _dot(first: Array, second: Array) -> Array:
    """(...), sum over satellites of products."""
    return jnp.sum(first * second, axis=0)


def _inverse_root(redundancy: Array) -> Array:
    checked = redundancy >= redundancy_floor(redundancy.dtype)
    return jnp.where(checked, jax.lax.rsqrt(jnp.where(checked, redundancy, 1.0)), 0.0)
