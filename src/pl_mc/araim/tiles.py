"""Levels of many positions on all cores: tiles of them side by side, in few shapes of one compiled function."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from pl_mc.araim.adjusted import adjusted
from pl_mc.araim.batch import Batch
from pl_mc.araim.budget import Budget
from pl_mc.araim.modes import FaultModes
from pl_mc.araim.risk_equations import Figures, Levels, Priors, figures, solve_levels
from pl_mc.araim.solving import fit_subsets
from pl_mc.arrays import FloatArray
from pl_mc.runtime.precision import precision_scope
from pl_mc.runtime.threads import cores, in_order

# Positions side by side: few enough for the caches, many enough for the vector units.
TILE = 64

# Tiles of one call of the compiled function.
TILES_PER_CALL = 16

LEAST_SQUARES, ADJUSTED = "least_squares", "adjusted"
ESTIMATORS = (LEAST_SQUARES, ADJUSTED)


@dataclass(frozen=True)
class Positions:
    """Which positions are to be solved, of the geometries of a batch.

    Attributes:
        geometry: (p,), the place of each in the batch.
        excluded: (p, n), rows that it leaves out.
        modes: fault modes; place: (p,), which of them belong to each.
        share: (p,), its part of the integrity risk; None for all of it.
    """

    geometry: NDArray[np.intp]
    excluded: NDArray[np.bool_] | None
    modes: Sequence[FaultModes]
    place: NDArray[np.intp]
    share: FloatArray | None = None


@dataclass(frozen=True)
class Solved:
    """As `pl_mc.araim.risk_equations.Levels`, with arrays of NumPy; thresholds are (p, modes, 3)."""

    level_m: FloatArray
    threshold_m: FloatArray
    emt_m: FloatArray
    sigma_v_acc_m: FloatArray
    p_not_monitored: FloatArray
    available: NDArray[np.bool_]
    horizontal_m: FloatArray | None


def stacked(lists: Sequence[FaultModes]) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Satellites of the modes (lists, width, n), priors and priors over the exposure, zero beyond the last of each."""
    width = max(1, *(len(modes.probability) for modes in lists))
    excluded = np.zeros((len(lists), width, lists[0].excluded.shape[1]), dtype=bool)
    prior, exposure = np.zeros(excluded.shape[:2]), np.zeros(excluded.shape[:2])
    for k, modes in enumerate(lists):
        own = len(modes.probability)
        excluded[k, :own], prior[k, :own], exposure[k, :own] = modes.excluded, modes.probability, modes.over_exposure
    return excluded, prior, exposure


def solve(batch: Batch, positions: Positions, budget: Budget, estimator: str, *, whole: bool = True) -> Solved:
    """The levels of positions, which run along the last axis; if not ``whole`` no thresholds and one HPL."""
    number = len(positions.geometry)
    numbers = np.array([len(modes.probability) for modes in positions.modes])
    most, widths = max(1, int(numbers.max())), _widths(numbers)
    excluded, prior, exposure = (
        np.pad(array, [(0, 0), (0, int(widths.max()) - most)] + [(0, 0)] * (array.ndim - 2))
        for array in stacked(positions.modes)
    )
    unknown = np.array([modes.p_not_monitored for modes in positions.modes])
    timed = positions.modes[0].exposure is not None
    scalars = {field: np.empty(number) for field in ("emt_m", "sigma_v_acc_m", "p_not_monitored")}
    level, available = np.empty((3, number)), np.empty(number, dtype=bool)
    horizontal = np.empty((3, number)) if timed and whole else None
    threshold = np.full((number if whole else 0, most, 3), np.inf)
    with_bias = bool(batch.b_acc.any())

    def run(part: tuple[int, NDArray[np.intp]]) -> Levels:
        width, places = part
        tiles = 1 if len(places) <= TILE else TILES_PER_CALL
        fill = places[np.minimum(np.arange(tiles * TILE), len(places) - 1)]
        lists = positions.place[fill]
        rows = _rows(batch, positions, fill, with_bias)
        modes = (
            excluded[lists, :width].swapaxes(1, 2), prior[lists, :width], unknown[lists],
            exposure[lists, :width] if timed else None, None if positions.share is None else positions.share[fill],
        )  # fmt: skip
        arrays = tuple(None if array is None else _tiled(array, tiles) for array in (*rows, *modes))
        with precision_scope("float64"):
            levels = _solve(figures(budget, width), np.bool_(whole), *arrays, estimator=estimator)
            return jax.tree.map(np.asarray, levels)

    for (width, places), levels in in_order(run, _parts(widths[positions.place]), cores()):
        kept = slice(0, len(places))
        for field, values in scalars.items():
            values[places] = _flat(getattr(levels, field))[kept]
        available[places] = _flat(levels.available)[kept]
        level[:, places] = _flat(levels.level_m)[:, kept]
        if horizontal is not None and levels.horizontal_m is not None:
            horizontal[:, places] = _flat(levels.horizontal_m)[:, kept]
        if whole:
            shared = min(width, most)
            threshold[places, :shared] = _flat(levels.threshold_m)[:, :shared, kept].transpose(2, 1, 0)
    return Solved(level_m=level, threshold_m=threshold, available=available, horizontal_m=horizontal, **scalars)


def _widths(modes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of modes rounded up to few shapes of the compiled function: the largest, its quarter, ..."""
    most = int(modes.max(initial=1))
    step = 8 if most <= 32 else 32
    largest = step * -(-most // step)
    widths = np.full(modes.shape, largest)
    while largest > 32:
        largest = 8 * -(-largest // 32)
        widths = np.where(modes <= largest, largest, widths)
    return widths


def _parts(widths: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Positions of one width of fault modes, as many as a call takes."""
    for width in np.unique(widths).tolist():
        places = np.flatnonzero(widths == width)
        for first in range(0, len(places), TILE * TILES_PER_CALL):
            yield width, places[first : first + TILE * TILES_PER_CALL]


def _rows(batch: Batch, positions: Positions, fill: NDArray[np.intp], with_bias: bool) -> tuple[NDArray | None, ...]:
    """The rows of positions as `_solve` takes them, positions first."""
    index = positions.geometry[fill]
    seen = batch.in_view[index]
    if positions.excluded is not None:
        seen = seen & ~positions.excluded[fill]
    root = np.where(seen, 1.0 / np.sqrt(batch.c_int[index]), 0.0)
    return (
        batch.design[index] * root[..., None],
        seen,
        batch.b_nom[index] * root,
        batch.c_acc[index] / batch.c_int[index],
        batch.b_acc[index] * root if with_bias else None,
    )


def _tiled(array: NDArray, tiles: int) -> NDArray:
    """(tiles, ..., TILE) from (positions, ...)."""
    return np.ascontiguousarray(np.moveaxis(array.reshape(tiles, TILE, *array.shape[1:]), 1, -1))


def _flat(given: Array) -> NDArray:
    """(tiles, ..., TILE) as (..., positions)."""
    values = np.asarray(given)
    return np.moveaxis(values, 0, -2).reshape(*values.shape[1:-1], -1)


@functools.partial(jax.jit, static_argnames="estimator")
def _solve(
    given: Figures, horizontal: Array, design: Array, in_view: Array, bias_ratio: Array, accuracy_ratio: Array,
    bias_ratio_continuity: Array | None, excluded: Array, prior: Array, unknown: Array, exposure: Array | None,
    share: Array | None, *, estimator: str,
) -> Levels:  # fmt: skip
    """The levels of tiles of positions, which run along the last axis.

    Args:
        given: figures of the budget.
        horizontal: (), whether further horizontal levels are wanted.
        design: (tiles, n, t, g), whitened; in_view: (tiles, n, g).
        bias_ratio, accuracy_ratio: (tiles, n, g), nominal bias over sigma, accuracy over integrity variance.
        bias_ratio_continuity: (tiles, n, g), b_acc over sigma, or None.
        excluded: (tiles, n, m, g); prior: (tiles, m, g); unknown: (tiles, g), what no mode covers.
        exposure: (tiles, m, g); share: (tiles, g); or None, see `pl_mc.araim.risk_equations.Priors`.
    """

    def one_tile(tile: tuple[Array, ...]) -> Levels:
        rows, seen, bias, accuracy, bias_continuity, out, p, p_not_monitored, p_exposure, part = tile
        whole, modes = fit_subsets(rows, seen, out, bias, accuracy)
        if estimator == ADJUSTED:
            whole, modes = adjusted(whole, modes, p, bias, accuracy, jnp.asarray(given.sigma_acc_m))
        priors = Priors(p, p_not_monitored, p_exposure, part)
        return solve_levels(whole, modes, priors, given, bias_continuity, horizontal)

    tiles = (
        design, in_view, bias_ratio, accuracy_ratio, bias_ratio_continuity, excluded, prior, unknown, exposure, share,
    )  # fmt: skip
    return jax.lax.map(one_tile, tiles)
