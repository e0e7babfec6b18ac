"""Counts of the error against the protection level of one axis, in bounded memory.

Every scenario of a sweep is put into a cell of a fixed grid and into one region; only the counts are kept.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jax import Array
from numpy.typing import NDArray

from pl_mc.alert import VERTICAL, AlertLimits
from pl_mc.engine.calls import Chunk, run_calls
from pl_mc.engine.core import EpochBatch, block_noise, block_sizes, prepare_epoch
from pl_mc.engine.plan import make_plan
from pl_mc.faults import Faults
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_positive
from pl_mc.kernels.events import sizes_and_levels, tied, unconverged
from pl_mc.kernels.noise import LANES
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.kernels.scenarios import each_outcome
from pl_mc.methods import Method, Outcome
from pl_mc.runtime.precision import dtype_of, on_device
from pl_mc.runtime.threads import cores
from pl_mc.statistics.intervals import shared_noise_bounds

NOMINAL, MISLEADING, HAZARDOUS = "nominal", "misleading", "hazardously misleading"
UNAVAILABLE, BEYOND = "system unavailable", "system unavailable, error beyond level"
REJECTED, NO_SOLUTION = "rejected by the method's own test", "no solution"

# The first five are parts of the plane; the others have no place in it.
REGIONS = (NOMINAL, MISLEADING, HAZARDOUS, UNAVAILABLE, BEYOND, REJECTED, NO_SOLUTION)


@dataclass(frozen=True)
class Grid:
    """Square cells of the plane of error and level, and one more beyond the reach of each axis.

    Attributes:
        reach_m: where the cells end [m].
        cell_m: width of a cell [m].
    """

    reach_m: float = 60.0
    cell_m: float = 0.5

    def __post_init__(self) -> None:
        require_positive(self.cell_m, field="cell_m")
        cells = require_positive(self.reach_m, field="reach_m") / self.cell_m
        if not 1.0 <= cells <= 1000.0 or abs(cells - round(cells)) > 1e-9:
            raise InputError(
                f"reach_m: 1 to 1000 whole cells of {self.cell_m:g} m are needed, not {cells:g} "
                f"(nearest: {self.cell_m * min(max(round(cells), 1), 1000):g})."
            )

    def require_limit(self, limit_m: float) -> None:
        """An `InputError` unless an alert limit lies on the diagram."""
        if self.reach_m <= limit_m:
            raise InputError(
                f"reach_m: more than the alert limit of {limit_m:g} m is needed, so that it is on the diagram, "
                f"not {self.reach_m:g}."
            )

    @property
    def cells(self) -> int:
        """Cells along an axis, without the one beyond."""
        return round(self.reach_m / self.cell_m)

    @property
    def edges_m(self) -> NDArray[np.float64]:
        """(cells + 2,), edges of the cells; the last is infinite [m]."""
        return np.append(self.cell_m * np.arange(self.cells + 1), np.inf)


@dataclass(frozen=True)
class StanfordCounts:
    """What the scenarios did.

    Attributes:
        counts: (methods, regions, cells + 1, cells + 1), by `REGIONS`, cell of the error, cell of the level.
        methods: names.
        grid: the cells.
        scenarios: scenarios of each method.
        independent_draws: noise draws with each epoch counted once; all faults of an epoch share its noise.
        unconverged, tied: (methods, regions), scenarios of each region that are that, see `pl_mc.kernels.events`.
    """

    counts: NDArray[np.int64]
    methods: tuple[str, ...]
    grid: Grid
    scenarios: int
    independent_draws: int
    unconverged: NDArray[np.int64]
    tied: NDArray[np.int64]

    def regions(self) -> pd.DataFrame:
        """One row per method and region: ``count, scenarios, independent_draws, rate, low, high`` (95 %).

        ``unconverged`` and ``tied`` are how many of the ``count`` are that.
        """
        count = self.counts.sum(axis=(2, 3))
        rate = count / self.scenarios
        low, high = shared_noise_bounds(rate, self.independent_draws)
        return pd.DataFrame(
            {
                "method": np.repeat(np.array(self.methods, dtype=object), len(REGIONS)),
                "region": np.array(REGIONS * len(self.methods), dtype=object),
                "count": count.ravel(),
                "scenarios": self.scenarios,
                "independent_draws": self.independent_draws,
                "rate": rate.ravel(),
                "low": low.ravel(),
                "high": high.ravel(),
                "unconverged": self.unconverged.ravel(),
                "tied": self.tied.ravel(),
            }
        )

    def cells(self) -> pd.DataFrame:
        """One row per method, region and cell that is not empty; no cell where there is no solution."""
        method, region, error, level = np.nonzero(self.counts)
        edges = self.grid.edges_m
        solved = np.array(REGIONS, dtype=object)[region] != NO_SOLUTION

        def known(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.where(solved, values, np.nan)

        return pd.DataFrame(
            {
                "method": np.array(self.methods, dtype=object)[method],
                "region": np.array(REGIONS, dtype=object)[region],
                "error_from_m": known(edges[error]),
                "error_to_m": known(edges[error + 1]),
                "level_from_m": known(edges[level]),
                "level_to_m": known(edges[level + 1]),
                "count": self.counts[method, region, error, level],
            }
        )


def stanford_counts(
    g: Geometry,
    faults: Faults,
    *,
    draws: int,
    seed: int,
    methods: Sequence[Method],
    alert: AlertLimits,
    grid: Grid,
    axis: str = VERTICAL,
    precision: str = "float64",
    workers: int | None = None,
    progress: bool | None = None,
) -> StanfordCounts:
    """Count the scenarios that `pl_mc.sweep` counts with the same seed, by region and by cell.

    A scenario without a solution, or one that the method's own test rejects, has a region of its own. For the
    others the level and the alert limit decide whether there is an alarm (VPL > VAL, "system unavailable"), and the
    error beyond the level is misleading information where there is none, hazardous where it is beyond VAL too;
    horizontally HPL, HAL and the length of the error.

    Args:
        g, faults, draws, seed, methods, alert, precision, workers, progress: as for `pl_mc.sweep`.
        grid: the cells.
        axis: ``vertical`` or ``horizontal``.

    Returns:
        The counts: misleading and hazardous together are the sweep's ``misleading``, hazardous alone its
        ``missed``.
    """
    chosen = tuple(methods)
    plan = make_plan(g, faults, draws)
    side = grid.cells + 1
    size = 4 * len(REGIONS) * side * side
    dtype = dtype_of(precision)

    def count(chunk: Chunk, first_block: np.int32, *others: np.int32) -> NDArray[np.int64]:
        codes = _block_cells(
            plan.batch(chunk, dtype), np.uint32(seed), first_block, on_device(alert.limit_m[axis], dtype),
            on_device(grid.cell_m, dtype), on_device(grid.cells, jnp.int32), as_trees(chosen),
            blocks=plan.blocks_per_call, axis=axis,
        )  # fmt: skip
        counted = np.asarray(codes)[: chunk.size][plan.scenarios(chunk)]
        return np.stack([np.bincount(counted[:, k], minlength=size) for k in range(len(chosen))])

    total = np.zeros((len(chosen), size), dtype=np.int64)
    threads = cores() if workers is None else workers
    for _, counts in run_calls(plan, count, precision=precision, threads=threads, what="Cells", show=progress):
        total += counts
    # Axes: method, unconverged or not, tied or not, region, error, level.
    full = total.reshape(len(chosen), 2, 2, len(REGIONS), side, side)
    counted = full.sum(axis=(1, 2))
    names, scenarios = tuple(method.name for method in chosen), int((plan.fault_index >= 0).sum()) * draws
    return StanfordCounts(
        counted, names, grid, scenarios, independent_draws=len(plan.epochs) * draws,
        unconverged=full[:, 1].sum(axis=(1, 3, 4)), tied=full[:, :, 1].sum(axis=(1, 3, 4)),
    )  # fmt: skip


@functools.partial(jax.jit, static_argnames=("blocks", "axis"))
def _block_cells(
    batch: EpochBatch, seed: Array, first_block: Array, limit_m: Array, cell_m: Array, cells: Array,
    methods: Trees, *, blocks: int, axis: str,
) -> Array:  # fmt: skip
    """(epochs, blocks, faults, lanes, methods), region and cell of each scenario as one whole number."""
    chosen = of_trees(methods)

    def one_epoch(one: EpochBatch) -> Array:
        model, prepared = prepare_epoch(one, chosen)

        def codes(outcomes: list[Outcome]) -> Array:
            named = zip(chosen, outcomes, strict=True)
            return jnp.stack([_codes(one, method.name, axis, limit_m, cell_m, cells) for method, one in named], axis=-1)

        def one_block(block: Array) -> Array:
            noise = block_noise(model, one, seed, block)
            nothing = jnp.zeros((LANES, len(chosen)), jnp.int32)
            sizes = block_sizes(one, seed, block)
            return each_outcome(model, prepared, chosen, one, noise, codes, sizes=sizes, skipped=nothing)

        return jax.lax.map(one_block, first_block + jnp.arange(blocks, dtype=jnp.int32))

    return jax.lax.map(one_epoch, batch)


def _codes(outcome: Outcome, method: str, axis: str, limit_m: Array, cell_m: Array, cells: Array) -> Array:
    """(lanes,), ((unconverged * 2 + tied) * regions + region, cell of the error, cell of the level) in one number."""
    ((error_m, level_m),) = sizes_and_levels(outcome, axis, method)
    beyond = error_m > level_m
    silent = jnp.where(beyond, jnp.where(error_m > limit_m, 2, 1), 0)
    region = jnp.where(level_m > limit_m, jnp.where(beyond, 4, 3), silent)
    region = jnp.where(outcome.available, jnp.where(outcome.rejects, 5, region), 6)

    def cell(value_m: Array) -> Array:
        # Bounded as numbers of metres: a level may be beyond every whole number.
        within = jnp.minimum(jnp.floor(value_m / cell_m), cells.astype(value_m.dtype))
        return jnp.where(outcome.available, within, 0.0).astype(jnp.int32)

    side = cells + 1
    state = unconverged(outcome).astype(jnp.int32) * 2 + tied(outcome).astype(jnp.int32)
    region = state * len(REGIONS) + region.astype(jnp.int32)
    return (region * side + cell(error_m)) * side + cell(level_m)
