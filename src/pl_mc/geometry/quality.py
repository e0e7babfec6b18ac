"""Quality of a geometry: dilution of precision, and how well each satellite is checked by the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pl_mc.arrays import ordinary_arithmetic
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, UP, Geometry, require_geometry
from pl_mc.input_errors import require_truth

# Normal equations whose smallest eigenvalue falls below this share of the largest determine no position; the digits
# of an inverse would be rounding errors.
_SINGULAR = 1e-13


@dataclass(frozen=True)
class Dops:
    """Dilutions of precision; NaN where the satellites in view do not determine all unknowns that they observe.

    Attributes:
        gdop: (...), of all unknowns: ``gdop^2 = pdop^2 + tdop^2``.
        pdop: (...), of the position.
        hdop: (...), of east and north.
        vdop: (...), of up.
        tdop: (...), of the clocks; with several systems the root of the sum of their squares.
    """

    gdop: NDArray[np.float64]
    pdop: NDArray[np.float64]
    hdop: NDArray[np.float64]
    vdop: NDArray[np.float64]
    tdop: NDArray[np.float64]


@ordinary_arithmetic
def dops(g: Geometry, *, weighted: bool = False) -> Dops:
    """Dilutions of precision of each epoch (Kaplan and Hegarty, Understanding GPS, section 7.3.1).

    A clock that no satellite in view observes is no unknown of that epoch.

    Args:
        g: the geometry, a single epoch or a series.
        weighted: False for pure numbers (every row counts alike); True to weight each row by 1/sigma^2, which gives
            standard deviations in metres, the "DOPs" of Zhao et al. (2021), equations 8 to 15.
    """
    require_truth(weighted, field="weighted")
    weight = np.where(require_geometry(g).in_view, 1.0 / np.asarray(g.sigma_m) ** 2 if weighted else 1.0, 0.0)
    cofactors, observed = _cofactors(g, weight)
    variance = np.diagonal(cofactors, axis1=-2, axis2=-1)
    horizontal = variance[..., EAST] + variance[..., NORTH]
    vertical = variance[..., UP]
    clocks = np.where(observed, variance, 0.0)[..., POSITION_UNKNOWNS:].sum(axis=-1)
    clocks = np.where(np.isnan(vertical), np.nan, clocks)
    return Dops(
        gdop=np.sqrt(horizontal + vertical + clocks),
        pdop=np.sqrt(horizontal + vertical),
        hdop=np.sqrt(horizontal),
        vdop=np.sqrt(vertical),
        tdop=np.sqrt(clocks),
    )


@ordinary_arithmetic
def redundancy_numbers(g: Geometry) -> NDArray[np.float64]:
    """Redundancy number of each observation (..., n): the share of its error that shows in its own residual.

    The diagonal of ``I - A N^-1 A' P`` with ``P = diag(1 / sigma^2)`` (Baarda 1968; Guo et al. 2022, section on
    reliability): between 0 (not checked at all) and 1. Over the satellites in view they sum to the number of
    satellites less the number of unknowns; a clock that no satellite in view observes is no unknown.

    Padding has 0. At an epoch whose satellites do not determine the unknowns the numbers do not exist: NaN for the
    satellites in view.
    """
    design = np.asarray(require_geometry(g).design)
    weight = np.where(g.in_view, 1.0 / np.asarray(g.sigma_m) ** 2, 0.0)
    cofactors, _ = _cofactors(g, weight)
    leverage = np.einsum("...ij,...jk,...ik->...i", design, cofactors, design) * weight
    return np.where(g.in_view, np.clip(1.0 - leverage, 0.0, 1.0), 0.0)


def _cofactors(g: Geometry, weight: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(A'PA)^-1 (..., t, t), NaN where there is none, and which unknowns are observed (..., t).

    Unobserved unknowns keep a place on the diagonal, so that all epochs have matrices of one size; what stands
    there touches no other unknown.
    """
    design = np.asarray(g.design)
    observed = np.asarray(design.any(axis=-2))
    normal = np.einsum("...ij,...i,...ik->...jk", design, weight, design)
    # A position coordinate always is an unknown, so its empty column stays singular.
    idle = ~observed
    idle[..., :POSITION_UNKNOWNS] = False
    unit = np.eye(design.shape[-1])
    # Scaled to a diagonal of ones, the test for singularity does not depend on the size of sigma.
    scale = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = normal / (scale[..., :, None] * scale[..., None, :]) + unit * idle[..., None, :]
    eigenvalues = np.linalg.eigvalsh(scaled)
    sound = eigenvalues[..., 0] > _SINGULAR * eigenvalues[..., -1]
    sound &= np.asarray(g.satellite_count) >= np.asarray(g.unknown_count)
    inverse = np.linalg.inv(np.where(sound[..., None, None], scaled, unit))
    inverse = inverse / (scale[..., :, None] * scale[..., None, :])
    return np.where(sound[..., None, None], inverse, np.nan), observed
