"""Weighted least squares of a geometry, in double precision: what does not depend on the draw.

NumPy and a singular value decomposition instead of the normal equations that the vectorised kernels solve, so that
it can stand as a check of those kernels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.faults import Faults, require_faults
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, UP, Geometry, require_geometry
from pl_mc.injection import row_biases
from pl_mc.input_errors import InputError, shown

# Pairs of epoch and fault whose biases are spread over rows at once.
_BLOCK = 65536


@dataclass(frozen=True)
class LsQuantities:
    """Least squares of each epoch; ``...`` is nothing for a single epoch, one axis for a series.

    Attributes:
        vdop_m: (...), standard deviation of the vertical error [m]; NaN where the position is not determined.
        hdop_m: (...), root of the summed variances of the east and north errors [m]; NaN likewise.
        gain: (..., n), vertical row s of N^-1 A'P: vertical error per metre of bias on each row [m/m]; 0 on
            padding, NaN where the position is not determined.
        redundancy: (..., n), redundancy numbers, diagonal of I - A N^-1 A'P; 0 on padding. Their sum is ``dof``
            where the position is determined.
        dof: (...), satellites in view less unknowns, n - t; 0 or negative where nothing is redundant.
        available: (...), whether a position and m = sqrt(V'PV / dof) exist: dof at least 1 and independent columns.
        basis: (..., n, t), orthonormal columns that span P^(1/2) A; zero columns stand for unused unknowns.
        horizontal_gain: (..., 2, n), the rows of N^-1 A'P for east and north [m/m], as ``gain``.
        horizontal_cofactor: (..., 2, 2), the same block of N^-1, the covariance of the horizontal error [m^2].
    """

    vdop_m: FloatArray
    hdop_m: FloatArray
    gain: FloatArray
    redundancy: FloatArray
    dof: NDArray[np.int64]
    available: NDArray[np.bool_]
    basis: FloatArray
    horizontal_gain: FloatArray
    horizontal_cofactor: FloatArray


@dataclass(frozen=True)
class FaultEffects:
    """What each fault does to least squares, one entry per pair of epoch and fault that applies there.

    Attributes:
        epoch_index: (pairs,), position of the epoch in the series (0 for a single epoch).
        fault_index: (pairs,), position of the fault in its `Faults`.
        vertical_m: (pairs,), mean vertical error s.b [m]; NaN where the position is not determined.
        noncentrality: (pairs,), noncentrality of V'PV, b'P(I - A N^-1 A'P)b; NaN likewise.
        horizontal_m: (pairs, 2), mean east and north error [m]; NaN likewise.
    """

    epoch_index: NDArray[np.int64]
    fault_index: NDArray[np.int64]
    vertical_m: FloatArray
    noncentrality: FloatArray
    horizontal_m: FloatArray


@ordinary_arithmetic
def ls_quantities(g: Geometry) -> LsQuantities:
    """DOPs, vertical gains and redundancy of least squares with weights P = diag(1/sigma^2).

    Source: Zhao et al. 2021, eqs 4-5 (solution) and 8-10 (DOPs, which contain P and are therefore in metres). Rows
    out of view and clock columns that no satellite in view observes are left out.

    Args:
        g: the geometry, one epoch or a series.
    """
    seen = np.asarray(require_geometry(g).in_view)
    root_weight = np.where(seen, 1.0 / np.asarray(g.sigma_m), 0.0)
    whitened = np.where(seen[..., None], np.asarray(g.design), 0.0) * root_weight[..., None]
    left, values, right = np.linalg.svd(whitened, full_matrices=False)
    # The rule of numpy.linalg.matrix_rank, by which `Geometry.from_arrays` refuses a single epoch.
    floor = values.max(axis=-1, keepdims=True) * max(whitened.shape[-2:]) * np.finfo(float).eps
    used = values > floor
    basis = left * used[..., None, :]
    inverse = np.where(used, 1.0 / np.where(used, values, 1.0), 0.0)
    # Rows of V S^-1: their products are N^-1, and with the basis the least-squares solution.
    half = np.swapaxes(right, -1, -2) * inverse[..., None, :]
    # The three coordinates are always unknown, even where no row in view has a component along one of them.
    clocks = whitened[..., POSITION_UNKNOWNS:].any(axis=-2).sum(axis=-1)
    unknowns = POSITION_UNKNOWNS + clocks
    determined = used.sum(axis=-1) == unknowns
    dof = seen.sum(axis=-1) - unknowns
    variances = (half**2).sum(axis=-1)
    gains = np.einsum("...ck,...nk->...cn", half[..., :POSITION_UNKNOWNS, :], basis) * root_weight[..., None, :]
    gains = np.where(determined[..., None, None], gains, np.nan)
    flat = half[..., [EAST, NORTH], :]
    cofactor = flat @ np.swapaxes(flat, -1, -2)
    redundancy = np.where(seen, 1.0 - (basis**2).sum(axis=-1), 0.0)
    return LsQuantities(
        vdop_m=np.where(determined, np.sqrt(variances[..., UP]), np.nan),
        hdop_m=np.where(determined, np.sqrt(variances[..., EAST] + variances[..., NORTH]), np.nan),
        gain=gains[..., UP, :],
        redundancy=redundancy,
        dof=np.asarray(dof),
        available=np.asarray(determined & (dof >= 1)),
        basis=basis,
        horizontal_gain=gains[..., [EAST, NORTH], :],
        horizontal_cofactor=np.where(determined[..., None, None], cofactor, np.nan),
    )


@ordinary_arithmetic
def fault_effects(g: Geometry, faults: Faults, quantities: LsQuantities | None = None) -> FaultEffects:
    """Mean errors and noncentrality of V'PV under each fault, where all of its satellites are in view.

    Args:
        g: the geometry, one epoch or a series.
        faults: the faults, made for ``g``.
        quantities: those of ``g``, where they are at hand.

    Returns:
        Pairs in the order of the epochs, and of the faults within an epoch.

    Raises:
        InputError: faults made for another geometry, or quantities that are none.
    """
    require_geometry(g)
    require_faults(faults).require_sizes("an exact law")
    series = g.as_series()
    if quantities is None:
        quantities = ls_quantities(g)
    elif not isinstance(quantities, LsQuantities):
        raise InputError(f"quantities: those of pl_mc.statistics.ls_quantities are needed, not {shown(quantities)}.")
    rows = series.sigma_m.shape[-1]
    gain = quantities.gain.reshape(-1, rows)
    sideways = quantities.horizontal_gain.reshape(-1, 2, rows)
    basis = quantities.basis.reshape(len(gain), rows, -1)
    undetermined = np.isnan(quantities.vdop_m).reshape(-1)
    epoch_index, fault_index = np.nonzero(faults.applies(g))
    vertical, spread = np.zeros(epoch_index.size), np.zeros(epoch_index.size)
    horizontal = np.zeros((epoch_index.size, 2))
    for start in range(0, epoch_index.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        at = epoch_index[block]
        bias, _ = row_biases(series, faults, at, fault_index[block])
        vertical[block] = (gain[at] * bias).sum(axis=-1)
        horizontal[block] = np.einsum("pcn,pn->pc", sideways[at], bias)
        scaled = bias / series.sigma_m[at]
        fitted = np.einsum("pnk,pk->pn", basis[at], np.einsum("pnk,pn->pk", basis[at], scaled))
        # The residuals squared, not a difference of squares: a satellite without redundancy has almost none.
        spread[block] = ((scaled - fitted) ** 2).sum(axis=-1)
        spread[block] = np.where(undetermined[at], np.nan, spread[block])
    return FaultEffects(epoch_index, fault_index, vertical, spread, horizontal)
