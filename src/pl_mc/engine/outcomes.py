"""Outcomes one by one, where a count is not enough: single draws of a sweep, and errors observed by a receiver."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pandas as pd
from jax import Array
from numpy.typing import NDArray

from pl_mc.alert import LPV_200, AlertLimits, as_axis
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.engine.calls import Chunk, run_calls
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_errors, require_geometry_and_alert, require_inputs
from pl_mc.engine.core import EpochBatch, block_outcomes
from pl_mc.engine.plan import make_plan
from pl_mc.faults import Faults
from pl_mc.geometry.record import EAST, NORTH, UP, Geometry
from pl_mc.input_errors import require_whole
from pl_mc.ism import satellite_codes
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.events import alarms, limits_of, tied, unconverged
from pl_mc.kernels.noise import LANES
from pl_mc.kernels.parameters import Trees, as_trees, of_trees
from pl_mc.methods import Method, Outcome, as_methods
from pl_mc.noise_models import GAUSSIAN, NoiseModel, as_noise_model
from pl_mc.runtime.precision import dtype_of, precision_scope

# Epochs that are solved together; blocks of draws whose outcomes are made one table.
_EPOCHS_AT_ONCE = 512
_BLOCKS_AT_ONCE = 64

OUTCOME_COLUMNS = ("east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available", "alarm", "unconverged", "tied")
EXCLUDED = "excluded"

_block_outcomes = jax.jit(block_outcomes, static_argnames=("noise_model",))


@ordinary_arithmetic
def sample(
    g: Geometry,
    faults: Faults,
    *,
    draws: int,
    seed: int,
    methods: Sequence[str | Method] = ("ls", "igg3"),
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    precision: str = "float64",
    noise: str | NoiseModel = GAUSSIAN,
) -> pd.DataFrame:
    """The first draws of the sweep with the same seed, one by one: errors, protection levels and alarms.

    Args:
        g, faults, draws, seed, methods, alert, precision, noise: as for `pl_mc.sweep`.
        axis: whose alarm is told, one of those of `pl_mc.sweep`.

    Returns:
        One row per epoch, fault, method and draw: ``epoch, fault, bias_m, method, draw, east_m, north_m, up_m,
        hpl_m, vpl_m, available, alarm, unconverged, tied``. Numbers are missing where a method is not available.
        Where a method says which satellite it has excluded there is a column ``excluded`` too, empty for none.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.sample(g, pl_mc.no_fault(g), draws=2, seed=7, methods="ls")
        >>> table[["method", "draw", "up_m", "vpl_m", "alarm"]].round(2)
          method  draw  up_m  vpl_m  alarm
        0     ls     0  0.96   5.11  False
        1     ls     1  2.05   6.88  False
    """
    alert = require_inputs(g, faults, alert, any_axis=True, drawn=True)
    axis = as_axis(axis, alert)
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    chosen, shaped = as_methods(methods, g), as_noise_model(noise, g)
    plan, dtype = make_plan(g, faults, draws).block_by_block(), dtype_of(precision)

    @functools.lru_cache(maxsize=1)
    def batch_from(first_epoch: int) -> EpochBatch:
        return plan.batch(Chunk(first_epoch, min(first_epoch + plan.epochs_per_call, plan.epoch_count), 0), dtype)

    def solved(chunk: Chunk, block: np.int32, *others: np.int32) -> list[Outcome]:
        return _block_outcomes(
            batch_from(chunk.first_epoch), np.uint32(seed), block, as_trees(chosen), noise_model=shaped
        )

    parts = []
    for chunks, found in _groups(run_calls(plan, solved, precision=precision)):
        outcomes = jax.tree.map(lambda *blocks: np.stack(blocks), *found)
        first = np.array([chunk.first_block for chunk in chunks])
        block, place, slot, lane = scenario = np.nonzero([plan.scenarios(chunk)[:, 0] for chunk in chunks])
        row = chunks[0].first_epoch + place
        fault = plan.fault_index[row, slot]
        group = []
        for method, outcome in zip(chosen, outcomes, strict=True):
            keys: dict[str, Any] = {
                "epoch": plan.geometry.epoch[plan.epochs[row]],
                "fault": np.array(faults.labels, dtype=object)[fault],
                "bias_m": faults.scalar_bias_m[fault],
                "method": method.name,
                "draw": first[block] * LANES + lane,
            }
            # Components of the error stand between the fault axis and the lanes.
            moved = replace(outcome, error_m=np.moveaxis(outcome.error_m, 3, 0))
            columns = _columns(moved, method.name, alert, axis, (..., *scenario))
            group.append(pd.DataFrame(keys | columns | _excluded(plan.geometry, plan.epochs[row], outcome, scenario)))
        # Block by block, and in a block method by method.
        order = np.argsort(np.tile(block, len(group)), kind="stable")
        parts.append(group[0] if len(group) == 1 else pd.concat(group, ignore_index=True).iloc[order])
    if not parts:
        return pd.DataFrame(columns=["epoch", "fault", "bias_m", "method", "draw", *OUTCOME_COLUMNS])
    return _together(parts)


def _groups(calls: Iterable[tuple[Chunk, list[Outcome]]]) -> Iterator[tuple[list[Chunk], list[list[Outcome]]]]:
    """Some blocks of the same epochs together: a table for each of them would cost more than its draws."""
    for _, of_epochs in itertools.groupby(calls, key=lambda call: call[0].first_epoch):
        while some := list(itertools.islice(of_epochs, _BLOCKS_AT_ONCE)):
            yield [chunk for chunk, _ in some], [outcomes for _, outcomes in some]


@ordinary_arithmetic
def solve(
    g: Geometry,
    errors_m: NDArray[np.float64],
    *,
    methods: Sequence[str | Method] = ("ls", "igg3"),
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    precision: str = "float64",
    tests: bool = False,
) -> pd.DataFrame:
    """What each method says of given pseudorange errors, epoch by epoch, such as those of a real receiver.

    Args:
        g: one epoch or a series.
        errors_m: (n,) or (epochs, n), observed minus true pseudoranges in the rows of ``g`` [m]. An error that all
            satellites of a system share changes the clock alone.
        methods, alert, precision: as for `pl_mc.sweep`.
        axis: whose alarm is told, one of those of `pl_mc.sweep`.
        tests: whether a column ``rejected`` tells the verdict of the method's own test, where it has one.

    Returns:
        One row per epoch and method: ``epoch, time_gps_s, method, satellites, east_m, north_m, up_m, hpl_m, vpl_m,
        available, alarm, unconverged, tied``. Numbers are missing where a method is not available; ``unconverged``
        and ``tied`` are those of `pl_mc.kernels.events`; ``excluded`` is that of `pl_mc.sample`.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.solve(g, 0.1 * g.sigma_m, methods="ls")
        >>> table[["method", "satellites", "up_m", "vpl_m", "alarm"]].round(2)
          method  satellites  up_m  vpl_m  alarm
        0     ls           8  0.12   0.09  False
    """
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    axis = as_axis(axis, alert)
    series, errors = g.as_series(), require_errors(g, errors_m)
    chosen = as_methods(methods, g)
    dtype, count, trees = dtype_of(precision), len(series.epoch), as_trees(chosen)
    rows = [
        series.design.astype(dtype), series.sigma_m.astype(dtype), series.in_view, errors.astype(dtype),
        satellite_codes(series),
    ]  # fmt: skip
    # Cut where many epochs at once would fill the memory, into calls of one shape, the last one full of its last epoch.
    size = min(count, _EPOCHS_AT_ONCE)
    solved = []
    with precision_scope(precision):
        for start in range(0, count, size):
            places = np.minimum(np.arange(start, start + size), count - 1)
            solved.append(jax.tree.map(np.asarray, _solve_series(*(one[places] for one in rows), trees)))
    found = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *solved)
    parts = []
    for method, outcome in zip(chosen, found, strict=True):
        keys = {
            "epoch": series.epoch,
            "time_gps_s": series.time_gps_s,
            "method": method.name,
            "satellites": series.satellite_count,
        }
        moved = replace(outcome, error_m=outcome.error_m.T)
        verdict = {"rejected": outcome.available & outcome.rejects} if tests else {}
        out = _excluded(series, np.arange(count), outcome)
        parts.append(pd.DataFrame(keys | _columns(moved, method.name, alert, axis) | verdict | out))
    return _together(parts).sort_values("epoch", kind="stable").reset_index(drop=True)


@jax.jit
def _solve_series(
    design: Array, sigma_m: Array, in_view: Array, errors_m: Array, satellite: Array, methods: Trees
) -> list[Outcome]:
    chosen = of_trees(methods)

    def one_epoch(rows: Array, sigma: Array, seen: Array, errors: Array, codes: Array) -> list[Outcome]:
        model = linear_model(rows, sigma, seen, satellite=codes)
        start = start_from(model, errors)
        return [method.solve(model, method.prepare(model), start) for method in chosen]

    return jax.vmap(one_epoch)(design, sigma_m, in_view, errors_m, satellite)


def _columns(
    outcome: Outcome, method: str, alert: AlertLimits, axis: str, chosen: tuple = (...,)
) -> dict[str, NDArray]:
    """The columns of the scenarios that are chosen by this index, lanes last."""
    outcome = jax.tree.map(lambda values: values[chosen], outcome)
    available = np.asarray(outcome.available)

    def known(values: Array | None) -> NDArray:
        return np.where(available, np.nan if values is None else values, np.nan)

    error = outcome.error_m
    values = [known(v) for v in (error[EAST], error[NORTH], error[UP], outcome.hpl_m, outcome.vpl_m)]
    limits = limits_of(alert, np.float64)
    flags = (alarms(outcome, limits, axis, method), unconverged(outcome), tied(outcome))
    values += [available, *map(np.asarray, flags)]
    return dict(zip(OUTCOME_COLUMNS, values, strict=True))


def _excluded(series: Geometry, place: NDArray, outcome: Outcome, chosen: tuple = (...,)) -> dict[str, NDArray]:
    """Names of the satellites that were left out at epochs of these places; nothing of a method that does not say."""
    if outcome.excluded is None:
        return {}
    row = np.asarray(outcome.excluded)[chosen]
    name = np.array(series.names, dtype=object)[series.satellite[place, np.maximum(row, 0)]]
    return {EXCLUDED: np.where(row >= 0, name, "")}


def _together(parts: list[pd.DataFrame]) -> pd.DataFrame:
    table = pd.concat(parts, ignore_index=True)
    return table.fillna({EXCLUDED: ""}) if EXCLUDED in table else table
