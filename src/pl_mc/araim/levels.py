"""ARAIM protection levels of one geometry or of a batch (multiple-hypothesis solution separation).

Source: ARAIM Algorithm Description Document v3.0, Working Group C, 2017; detection only.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from pl_mc.araim.batch import Batch, as_batch
from pl_mc.araim.budget import LPV_200, Budget
from pl_mc.araim.modes import CONTAINED, FaultModes, fault_modes
from pl_mc.araim.solving import Levels, fit_subsets, solve_levels
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.geometry.record import EAST, NORTH, POSITION_UNKNOWNS, UP
from pl_mc.runtime.precision import precision_scope
from pl_mc.runtime.threads import cores, in_order

# Geometries side by side: few enough for the caches, many enough for the vector units.
TILE = 64

# Tiles of one call of the compiled function.
TILES_PER_CALL = 16


@dataclass(frozen=True)
class AraimLevels:
    """Protection levels; ``...`` is nothing for one geometry, one axis for a batch. Never NaN.

    Where there are no levels (too few satellites, or faults without a test more probable than the integrity risk)
    they are infinite and ``available`` is False.

    Attributes:
        vpl_m, hpl_m: (...), vertical and horizontal protection levels [m]; HPL^2 = HPL_east^2 + HPL_north^2.
        hpl_east_m, hpl_north_m: (...), the latter two [m].
        emt_m: (...), effective monitor threshold: the largest vertical threshold of the modes with a prior of at
            least P_EMT [m]; zero where none is so probable.
        sigma_v_acc_m: (...), standard deviation of the vertical error under the accuracy model [m].
        p_not_monitored: (...), prior of the faults that no test looks for, those that leave no position included.
        available: (...), whether there are levels.
        excluded: (..., modes, n), satellites that each fault mode spoils; modes beyond a geometry's own are empty.
        probability: (..., modes), their priors; zero beyond a geometry's own.
        threshold_m: (..., modes, 3), thresholds of the separations east, north, up [m]; infinite for a mode that
            leaves no position.
    """

    vpl_m: FloatArray
    hpl_m: FloatArray
    hpl_east_m: FloatArray
    hpl_north_m: FloatArray
    emt_m: FloatArray
    sigma_v_acc_m: FloatArray
    p_not_monitored: FloatArray
    available: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    probability: FloatArray
    threshold_m: FloatArray


@ordinary_arithmetic
def protection_levels(
    design: ArrayLike,
    c_int: ArrayLike | None = None,
    c_acc: ArrayLike | None = None,
    systems: Sequence[str] | Sequence[Sequence[str]] = (),
    b_nom: ArrayLike | None = None,
    p_sat: ArrayLike | None = None,
    p_const: Mapping[str, float] | None = None,
    budget: Budget = LPV_200,
    unmonitored: str = CONTAINED,
    *,
    in_view: ArrayLike | None = None,
    ism: Any = None,
    names: Sequence[str] | Sequence[Sequence[str]] | None = None,
    noise_m2: ArrayLike | None = None,
) -> AraimLevels:
    """Protection levels, thresholds and fault modes of one geometry (n, t) or of a batch (g, n, t).

    Computed in double precision on all cores, whatever the configuration of JAX. A satellite that is the only one
    of its clock moves no position: neither its fault nor, if it is alone, that of its constellation counts.

    Args:
        design: (n, t) or (g, n, t), minus line of sight east, north, up, then clock columns [m/m].
        c_int: variances of the pseudorange errors under the integrity model, which also weight the solution [m^2]:
            (n,), (g, n), or diagonal matrices (n, n) for one geometry, (g, n, n) for a batch.
        c_acc: the same under the accuracy model [m^2].
        systems: n RINEX letters, or a list of g lists of n.
        b_nom: largest nominal bias [m], one number, (n,) or (g, n).
        p_sat: prior probability of a fault of each satellite, one number, (n,) or (g, n).
        p_const: prior probability of a fault of each constellation, by letter.
        budget: the operation's risks.
        unmonitored: what counts as not monitored. ``plain``: every combination of faults without a test of its
            own. ``contained``: of these only the combinations whose satellites no monitored mode holds together;
            the others add to the prior of the mode that holds them.
        in_view: which rows count, (n,) or (g, n); all unless given. Other rows may hold anything.
        ism: an integrity support message (`pl_mc.araim.Ism`, a table of its fields or the path of a CSV file), which
            says b_nom, p_sat and p_const, as far as it has them, and with sigma_URA and sigma_URE c_acc: c_int less
            sigma_URA^2, plus sigma_URE^2. What it says is not given beside it.
        names: with an ism, names of the satellites, (n,) or (g, n), where it tells them apart.
        noise_m2: with an ism, instead of c_int, the variances of all other errors (receiver, troposphere), in its
            shapes [m^2].

    Raises:
        InputError: an argument that is missing or said twice, shapes that do not fit, numbers that are not finite,
            variances that are not positive, probabilities outside [0, 1), a letter without a probability, an ISM
            that lacks a satellite, or faults so probable that too many combinations would have to be monitored.
    """
    batch = as_batch(
        design, c_int, c_acc, systems, b_nom, p_sat, p_const, budget, unmonitored, in_view, ism, names, noise_m2
    )
    found, pattern = _patterns(batch, budget, unmonitored)
    g, n = batch.in_view.shape
    numbers = np.array([len(modes.probability) for modes in found])
    most, widths = max(1, int(numbers.max())), _widths(numbers)
    # Satellites of the modes (patterns, width, n) and their priors (patterns, width), zero beyond the last.
    excluded, prior = np.zeros((len(found), widths.max(), n), dtype=bool), np.zeros((len(found), widths.max()))
    for k, modes in enumerate(found):
        excluded[k, : numbers[k]], prior[k, : numbers[k]] = modes.excluded, modes.probability
    scalars = {field: np.empty(g) for field in ("emt_m", "sigma_v_acc_m", "p_not_monitored")}
    level, available = np.empty((3, g)), np.empty(g, dtype=bool)
    threshold = np.full((g, most, 3), np.inf)
    unknown = np.array([modes.p_not_monitored for modes in found])

    def run(part: tuple[int, NDArray[np.intp]]) -> Levels:
        width, places = part
        with precision_scope("float64"):
            modes = (excluded[pattern[places], :width], prior[pattern[places], :width], unknown[pattern[places]])
            return jax.tree.map(np.asarray, _solve(*_tiles(batch, places, *modes), budget=budget))

    for (width, places), levels in in_order(run, _parts(widths[pattern]), cores()):
        kept = slice(0, len(places))
        for field, values in scalars.items():
            values[places] = _flat(getattr(levels, field))[kept]
        available[places] = _flat(levels.available)[kept]
        level[:, places] = _flat(levels.level_m)[:, kept]
        shared = min(width, most)
        threshold[places, :shared] = _flat(levels.threshold_m)[:, :shared, kept].transpose(2, 1, 0)

    one = (lambda values: values[0]) if batch.single else (lambda values: values)
    return AraimLevels(
        vpl_m=one(level[UP]),
        hpl_m=one(np.hypot(level[EAST], level[NORTH])),
        hpl_east_m=one(level[EAST]),
        hpl_north_m=one(level[NORTH]),
        available=one(available),
        excluded=one(excluded[:, :most][pattern]),
        probability=one(prior[:, :most][pattern]),
        threshold_m=one(threshold),
        **{field: one(values) for field, values in scalars.items()},
    )


def _patterns(batch: Batch, budget: Budget, unmonitored: str) -> tuple[list[FaultModes], NDArray[np.intp]]:
    """The fault modes of each distinct pattern of satellites, and the pattern of each geometry (g,)."""
    clocks = batch.design[:, :, POSITION_UNKNOWNS:] != 0
    codes = np.unique(batch.systems, return_inverse=True)[1].reshape(batch.systems.shape)
    parts = [codes.astype(np.int8), clocks.reshape(len(clocks), -1).astype(np.int8)]
    if (batch.p_sat[batch.in_view] != batch.p_sat.max()).any():
        parts.append(np.ascontiguousarray(batch.p_sat).view(np.int8))
    keys = np.ascontiguousarray(np.concatenate(parts, axis=1))
    words = keys.view(np.dtype((np.void, keys.shape[1])))[:, 0]
    _, first, pattern = np.unique(words, return_index=True, return_inverse=True)
    found = [
        fault_modes(batch.systems[k].tolist(), clocks[k], batch.p_sat[k], batch.p_const, budget, unmonitored)
        for k in first
    ]
    return found, pattern.reshape(-1)


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
    """Geometries of one width of fault modes, as many as a call takes."""
    for width in np.unique(widths).tolist():
        places = np.flatnonzero(widths == width)
        for first in range(0, len(places), TILE * TILES_PER_CALL):
            yield width, places[first : first + TILE * TILES_PER_CALL]


def _tiles(
    batch: Batch, places: NDArray[np.intp], excluded: NDArray[np.bool_], prior: FloatArray, unknown: FloatArray
) -> tuple[NDArray, ...]:
    """The arguments of `_solve`; the last geometry fills up what is left of a call."""
    tiles = 1 if len(places) <= TILE else TILES_PER_CALL
    fill = np.minimum(np.arange(tiles * TILE), len(places) - 1)
    index = places[fill]
    root = np.where(batch.in_view[index], 1.0 / np.sqrt(batch.c_int[index]), 0.0)
    arrays = (
        batch.design[index] * root[..., None],
        batch.in_view[index],
        batch.b_nom[index] * root,
        batch.c_acc[index] / batch.c_int[index],
        excluded[fill].swapaxes(1, 2),
        prior[fill],
        unknown[fill],
    )
    return tuple(
        np.ascontiguousarray(np.moveaxis(array.reshape(tiles, TILE, *array.shape[1:]), 1, -1)) for array in arrays
    )


def _flat(given: Array) -> NDArray:
    """(tiles, ..., TILE) as (..., geometries)."""
    values = np.asarray(given)
    return np.moveaxis(values, 0, -2).reshape(*values.shape[1:-1], -1)


@functools.partial(jax.jit, static_argnames="budget")
def _solve(
    design: Array, in_view: Array, bias_ratio: Array, accuracy_ratio: Array, excluded: Array, prior: Array,
    unknown: Array, *, budget: Budget,
) -> Levels:  # fmt: skip
    """The levels of tiles of geometries, which run along the last axis.

    Args:
        design: (tiles, n, t, g), whitened; in_view: (tiles, n, g).
        bias_ratio, accuracy_ratio: (tiles, n, g), nominal bias over sigma, accuracy over integrity variance.
        excluded: (tiles, n, m, g); prior: (tiles, m, g); unknown: (tiles, g), what no mode covers.
    """

    def one_tile(tile: tuple[Array, ...]) -> Levels:
        rows, seen, bias, accuracy, out, p, p_not_monitored = tile
        whole, modes = fit_subsets(rows, seen, out, bias, accuracy)
        return solve_levels(whole, modes, p, p_not_monitored, budget)

    return jax.lax.map(one_tile, (design, in_view, bias_ratio, accuracy_ratio, excluded, prior, unknown))
