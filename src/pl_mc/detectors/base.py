"""What a detector is: from a least-squares start to a statistic, a threshold, a decision and a suspect.

A detector is a frozen record of its options. Like a method it is given one geometry and a batch of scenarios and
knows nothing of the sweep. To add one, write a file beside this one and list its class in
`pl_mc.detectors.registry`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.kernels import LeastSquaresSolution, LinearModel
from pl_mc.kernels.linear_model import per_lane, product

# Systems as kernels know them: the place of a letter here; -1 on padding.
SYSTEM_LETTERS = tuple(SYSTEM_NAMES)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Verdict:
    """What a detector says in each scenario (``...``, the lanes).

    Attributes:
        statistic: (...), the test statistic, no unit.
        threshold: (), the value above which there is a fault at the nominal false-alarm probability.
        decision: (...), whether the statistic is above it.
        satellite: (...), row of the satellite that is suspected most (int32), whatever the decision.
        error_m: (...), estimated error of that satellite's pseudorange [m].
    """

    statistic: Array
    threshold: Array
    decision: Array
    satellite: Array
    error_m: Array


@dataclass(frozen=True)
class View:
    """What one epoch offers to a test, as the host knows it before any noise is drawn.

    Attributes:
        counts: number of satellites in view by RINEX letter; systems without one are left out.
        dof: n - t.
        determined: whether the satellites determine all unknowns.
    """

    counts: Mapping[str, int]
    dof: int
    determined: bool


@runtime_checkable
class Detector(Protocol):
    """One detector with its options; a frozen, hashable record."""

    @property
    def test(self) -> str:
        """Name of the test, as tables and the registry have it."""
        ...

    @property
    def label(self) -> str:
        """Which reading of the test this is, with further options that are not the default."""
        ...

    @property
    def name(self) -> str:
        """Test with whatever is not the default in brackets."""
        ...

    def reason_against(self, view: View) -> str | None:
        """Why the test is not defined at an epoch, in words that follow a colon; None where it is."""
        ...

    def prepare(self, model: LinearModel, system: Array, p_fa: float) -> Any:
        """What depends on the geometry alone, computed once for all its scenarios (any pytree).

        ``system`` (n,) is each row's place in `SYSTEM_LETTERS`; ``p_fa`` the nominal false-alarm probability.
        """
        ...

    def examine(self, model: LinearModel, prepared: Any, start: LeastSquaresSolution) -> Verdict:
        """The verdict on each lane of ``start``."""
        ...


def nothing_redundant(view: View) -> str | None:
    """The reason that every test of residuals shares: there are none, or they are zero by construction."""
    if not view.determined:
        return "the satellites in view do not determine the unknowns"
    if view.dof < 1:
        return "there are as many satellites as unknowns (n = t), so every residual is zero"
    return None


def satellite_errors_m(model: LinearModel, residuals: Array) -> Array:
    """s_i = -v_i / r_i (n, ...) [m]: the shift that a mean-shift fit with H = e_i finds (Guo et al. 2022, eq 13).

    Zero where nothing checks the satellite, and on padding.

    Args:
        model: the geometry.
        residuals: (n, ...), whitened, as in `LeastSquaresSolution`.
    """
    scale = jnp.where(model.weight_root > 0, model.weight_root, 1.0)
    inverse_root = model.inverse_residual_sigma
    return residuals * per_lane(inverse_root * inverse_root * model.in_view / scale, residuals)


def largest(values: Array, carried: Array) -> tuple[Array, Array, Array]:
    """The largest of ``values`` along the first axis, its place (int32; the first of equals) and what goes with it.

    Written out row by row: reductions over a short leading axis are slow in jaxlib 0.10.
    """
    best, extra = values[0], carried[0]
    place = jnp.zeros(best.shape, jnp.int32)
    for k in range(1, values.shape[0]):
        better = values[k] > best
        best = jnp.where(better, values[k], best)
        extra = jnp.where(better, carried[k], extra)
        place = jnp.where(better, jnp.int32(k), place)
    return best, place, extra


def suspected(model: LinearModel, start: LeastSquaresSolution) -> tuple[Array, Array]:
    """Row (...) of the largest |v_i| / (sigma_i sqrt(r_i)), Baarda's w-test (1968), and its s_i (...) [m]."""
    standardised = jnp.abs(start.residuals) * per_lane(model.inverse_residual_sigma, start.residuals)
    _, satellite, error_m = largest(standardised, satellite_errors_m(model, start.residuals))
    return satellite, error_m


def by_count(table: NDArray[np.float64], dtype: Any, *counts: Array) -> Array:
    """The entry of a table of thresholds at whole numbers that were counted inside a trace."""
    return jnp.asarray(table, dtype)[tuple(jnp.round(count).astype(jnp.int32) for count in counts)]


def hat_matrix(design: Array) -> Array:
    """Projection (n, n) onto the columns of a whitened design (n, k): fitted whitened observations.

    By Gram and Schmidt, each column cleared twice. Columns that are empty or depend on earlier ones drop out: the
    residuals exist whether or not the unknowns do. One epoch at a time, so speed is no matter; a loop of vectors
    compiles in no time, unlike a Cholesky factor written out element by element.
    """
    n, k = design.shape
    floor = 1e3 * float(jnp.finfo(design.dtype).eps)

    def add_column(j: Array, basis: Array) -> Array:
        given = jax.lax.dynamic_index_in_dim(design, j, axis=1, keepdims=False)
        column = given
        for _ in range(2):
            column = column - product(basis, product(basis.T, column))
        size, left = jnp.sqrt(jnp.sum(given * given)), jnp.sqrt(jnp.sum(column * column))
        new = (left > floor * size) & (size > 0)
        unit = jnp.where(new, column / jnp.where(new, left, 1.0), 0.0)
        return jax.lax.dynamic_update_index_in_dim(basis, unit, j, axis=1)

    basis = jax.lax.fori_loop(0, k, add_column, jnp.zeros((n, k), design.dtype))
    return product(basis, basis.T)
