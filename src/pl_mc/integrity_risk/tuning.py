"""The limits k0, k1 of IGG-III that cost least at a given risk, found by gradients and judged on fresh noise.

For every pair of limits the multiplier is the one that keeps the target, so that only the price is left to be made
small: the mean protection level, or the share of alarms, without a fault. The search sees a smoothed price over
noise that stays the same (`pl_mc.integrity_risk.tuning_objective`); it starts from the record's limits and from two
pairs besides, since the price has more than one valley. What it finds is judged with noise of its own, without
smoothing, beside where it started and beside the best of a plain grid over the noise of the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize

from pl_mc.alert import LPV_200, AlertLimits
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_geometry_and_alert, require_inputs
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_positive, require_whole
from pl_mc.integrity_risk.ls_exact import require_single
from pl_mc.integrity_risk.multiplier_counts import fewest_draws, order_bounds
from pl_mc.integrity_risk.ratio import EVENTS, MISLEADING
from pl_mc.integrity_risk.tuning_objective import OBJECTIVES, Draws, TuningProblem, cost
from pl_mc.methods import Igg3, Method, as_methods
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities

FloatArray = NDArray[np.float64]

PARAMETERS = ("k0", "k1", "k_vertical")
START, TUNED, GRID = "start", "tuned", "grid"

# Where k0 and k1 - k0 may go, in the search and on the grid.
_LOWEST, _HIGHEST = np.array([0.5, 0.5]), np.array([6.0, 20.0])
# k0 and k1 from which the search starts besides those of the record.
_STARTS = ((0.8, 10.0), (3.0, 6.0))
# Events that the noise of the search has to have at the target, or its quantile says nothing.
_FEWEST_EVENTS = 20
_SAMPLES = 200
# Ratios that may come into a resampled quantile, for each rank.
_TAIL_FACTOR, _TAIL_LEAST = 4, 200


@dataclass(frozen=True)
class _Judged:
    """One pair of limits on fresh noise.

    Attributes:
        limits: (2,), k0 and k1.
        k: the multiplier that keeps the target with the confidence.
        objective: the price at that multiplier.
        resampled: (samples,), the same of resampled draws, the same for every pair of limits.
    """

    limits: FloatArray
    k: float
    objective: float
    resampled: FloatArray


def tune(
    g: Geometry,
    *,
    method: str | Method = "igg3",
    parameters: Sequence[str] = PARAMETERS,
    target: float = 1e-4,
    objective: Literal["vpl", "alarms"] = "vpl",
    event: Literal["exceeded", "misleading"] = "misleading",
    faults: Faults | None = None,
    alert: AlertLimits = LPV_200,
    draws: int = 400_000,
    confidence: float = 0.95,
    seed: int = 0,
    steps: int = 30,
    grid: int = 5,
    smoothing: float = 0.05,
) -> pd.DataFrame:
    """Limits of IGG-III that make the price of a given risk small, beside the start and a plain grid.

    Gaussian noise, double precision. A target has to be common enough for its quantile to be drawn; what is found
    can be taken to rarer ones with `pl_mc.calibrate`.

    Args:
        g: one epoch.
        method: IGG-III by name or record; its limits are where the search starts, its other options stay.
        parameters: what may change, of ``k0``, ``k1`` and ``k_vertical``. The multiplier follows from the target
            whether it is named or not.
        target: probability of the event per sample that is kept under each fault.
        objective: ``vpl``, mean VPL_R [m] where there is a solution, or ``alarms``, share of alarms; fault-free.
        event: ``misleading``, |vertical error| > VPL and no alarm, or ``exceeded``, alarm or not.
        faults: the faults; the fault-free case unless given.
        alert: alert limits; the vertical one decides on alarms.
        draws: of the search, and of either fresh set, for each fault.
        confidence: with which the multiplier keeps the target, and of the interval of the risk.
        seed: chooses the noise, 0 to 2^32 - 1.
        steps: most steps of the search (L-BFGS-B).
        grid: values of each of k0 and k1 - k0 on the grid.
        smoothing: width of the steps that take the place of jumps in the search, in the logarithm of the ratio.

    Returns:
        Rows ``start``, ``tuned`` and ``grid`` (column ``limits``) with ``k0, k1``; ``k_vertical``, the multiplier
        that keeps the target with the confidence on fresh noise; ``objective`` there and ``objective_error``, its
        standard error, the multiplier's among it; ``change`` from the start and ``change_error``, of the same
        draws; ``risk, risk_low, risk_high``: share of the event at that multiplier in a third set of draws, under
        the fault with the largest (``risk_fault``), with its interval (two-sided, for that fault alone);
        ``evaluations``, scenarios that finding the limits took, a derivative counted as another; ``warning``.
        ``table.attrs["method"]`` is the tuned record with its multiplier.

    Raises:
        InputError: a series of epochs, an epoch without redundancy, a method that is not IGG-III, options outside
            their range, too few draws for the target.
    """
    require_geometry_and_alert(g, alert)
    require_single(g, "tuning")
    faults = no_fault(g) if faults is None else faults
    require_inputs(g, faults, alert)
    require_choice(objective, OBJECTIVES, field="objective")
    require_choice(event, EVENTS, field="event")
    named = [parameters] if isinstance(parameters, str) else list(parameters)
    for name in named:
        require_choice(name, PARAMETERS, field="parameters")
    for field, value in (("target", target), ("confidence", confidence)):
        if not require_positive(value, field=field) < 1.0:
            raise InputError(f"{field}: it lies between 0 and 1, both excluded, not {value!r}.")
    require_positive(smoothing, field="smoothing")
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    needed = max(int(np.ceil(_FEWEST_EVENTS / target)), fewest_draws(target, confidence))
    if draws < needed:
        raise InputError(f"draws: a target of {target:g} needs at least {needed}, not {draws}, or a larger target.")
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    steps, grid = require_whole(steps, field="steps", low=1), require_whole(grid, field="grid", low=1)
    (record,) = as_methods([method])
    # A gate would change what counts as misleading, and the search knows none.
    if type(record) is not Igg3:
        raise InputError(f"method: IGG-III is tuned, by name or record, not {record.name}.")
    if not bool(ls_quantities(g).available):
        raise InputError("geometry: this epoch has no redundancy, and always alarms; nothing can be tuned there.")

    problem = TuningProblem(
        design=np.asarray(g.design),
        sigma_m=np.asarray(g.sigma_m),
        bias_m=np.asarray(faults.bias_m, dtype=float),
        options=replace(record, k0=1.0, k1=2.0).options,
        target=target,
        misleading=event == MISLEADING,
        objective=objective,
        vertical_m=alert.vertical_m,
        step=smoothing,
    )
    noises = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    search, fresh, last = (rng.standard_normal((draws, len(g.names))) for rng in noises[:3])
    start = np.array([record.k0, record.k1])
    free = np.array(["k0" in named, "k1" in named])
    tuned, evaluations, note = _descend(problem, start, free, search, steps)
    best, looked = _best_of_grid(problem, start, free, search, grid, confidence)
    weights = np.stack([noises[3].poisson(1.0, draws).astype(np.uint8) for _ in range(_SAMPLES)])
    found = [_judge(problem, limits, fresh, weights, confidence) for limits in (start, tuned, best)]
    rows: list[dict[str, Any]] = []
    for name, one, cost_of, doubt in zip(
        (START, TUNED, GRID), found, (0, evaluations, looked), ("", note, ""), strict=True
    ):
        change = one.resampled - found[0].resampled
        rows.append(
            {
                "limits": name,
                "k0": one.limits[0],
                "k1": one.limits[1],
                "k_vertical": one.k,
                "objective": one.objective,
                "objective_error": float(one.resampled.std(ddof=1)),
                "change": one.objective - found[0].objective,
                "change_error": float(change.std(ddof=1)),
                **_risk(problem, one, last, faults, confidence),
                "evaluations": cost_of,
                "warning": doubt,
            }
        )
    table = pd.DataFrame(rows)
    k0, k1 = (float(value) for value in tuned)
    table.attrs["method"] = replace(record, k0=k0, k1=k1, k_vertical=found[1].k)
    return table


def _descend(
    problem: TuningProblem, start: FloatArray, free: NDArray[np.bool_], noise: FloatArray, steps: int
) -> tuple[FloatArray, int, str]:
    """Limits at which the smoothed objective is least near the start, what that cost, and a note."""
    if not free.any():
        return start, 0, ""
    calls = 0

    def value(coordinates: FloatArray) -> tuple[float, FloatArray]:
        nonlocal calls
        calls += 1
        limits = _limits(coordinates, start, free)
        price, slope, _ = problem.smooth(limits, noise)
        return price, _chain(limits, slope, free)

    low, high = _bounds(start, free)
    runs = [
        optimize.minimize(
            value, np.clip(_coordinates(np.array(first), free), low, high), jac=True, method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)), options={"maxiter": steps, "ftol": 1e-7},
        )
        for first in (start, *_STARTS)
    ]  # fmt: skip
    found = min(runs, key=lambda run: run.fun)
    at_bound = bool((np.isclose(found.x, low) | np.isclose(found.x, high)).any())
    notes = ["at a bound of the search"] if at_bound else []
    notes += [] if found.success else ["the steps ran out"]
    # Two derivatives, each with a value of its own, for every fault and the fault-free case.
    rows = len(problem.bias_m) + int(problem.bias_m.any(axis=1).all())
    return _limits(found.x, start, free), 4 * calls * rows * len(noise), "; ".join(notes)


def _best_of_grid(
    problem: TuningProblem,
    start: FloatArray,
    free: NDArray[np.bool_],
    noise: FloatArray,
    grid: int,
    confidence: float,
) -> tuple[FloatArray, int]:
    """The best limits of a grid, judged as they are on the noise of the search, and what that cost."""
    if not free.any():
        return start, 0
    low, high = _bounds(start, free)
    axes = [np.linspace(a, b, grid) for a, b in zip(low, high, strict=True)]
    points = [
        _limits(np.array(point), start, free) for point in np.stack(np.meshgrid(*axes), -1).reshape(-1, len(axes))
    ]
    prices: list[float] = []
    for limits in points:
        drawn = problem.draws(limits, noise)
        prices.append(_price(problem, _multiplier(drawn, problem.target, confidence), drawn))
    rows = len(problem.bias_m) + int(problem.bias_m.any(axis=1).all())
    return points[int(np.argmin(prices))], len(points) * rows * len(noise)


def _judge(
    problem: TuningProblem, limits: FloatArray, noise: FloatArray, weights: NDArray[np.uint8], confidence: float
) -> _Judged:
    """The price of limits at the multiplier that keeps the target, with resampled draws for its error."""
    drawn = problem.draws(limits, noise)
    rank, _ = order_bounds(len(noise), problem.target, confidence)
    tail = min(_TAIL_FACTOR * rank + _TAIL_LEAST, len(noise))
    largest = [np.argsort(-row, kind="stable")[:tail] for row in drawn.log_ratio]
    resampled = np.empty(len(weights))
    for sample, weight in enumerate(weights):
        ranks = [int(np.searchsorted(weight[order].cumsum(dtype=np.int64), rank)) for order in largest]
        again = max(
            float(np.exp(row[order[min(at, tail - 1)]]))
            for row, order, at in zip(drawn.log_ratio, largest, ranks, strict=True)
        )
        resampled[sample] = _price(problem, again, drawn, weight)
    k = _multiplier(drawn, problem.target, confidence)
    return _Judged(limits, k, _price(problem, k, drawn), resampled)


def _multiplier(drawn: Draws, target: float, confidence: float) -> float:
    """The order statistic that keeps the target with the confidence under each fault."""
    rank, _ = order_bounds(drawn.log_ratio.shape[1], target, confidence)
    place = drawn.log_ratio.shape[1] - rank
    return float(np.exp(max(np.partition(row, place)[place] for row in drawn.log_ratio)))


def _price(problem: TuningProblem, k: float, drawn: Draws, weight: NDArray[np.uint8] | None = None) -> float:
    each = cost(problem.objective, k, drawn.log_unit_m, problem.vertical_m)
    known = ~np.isnan(each)
    return float(np.average(each[known], weights=None if weight is None else weight[known]))


def _risk(
    problem: TuningProblem, judged: _Judged, noise: FloatArray, faults: Faults, confidence: float
) -> dict[str, Any]:
    """The event's share in draws that neither limits nor multiplier have seen."""
    ratios = problem.draws(judged.limits, noise).log_ratio
    events = (ratios > np.log(judged.k)).sum(axis=1)
    worst = int(events.argmax())
    low, high = clopper_pearson(int(events[worst]), len(noise), confidence)
    return {
        "risk": events[worst] / len(noise),
        "risk_low": float(low),
        "risk_high": float(high),
        "risk_fault": faults.labels[worst],
    }


def _coordinates(limits: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """Logarithms of what is free: k0, and k1 or its distance from a free k0."""
    k0, k1 = limits
    return np.log(np.array([k0, k1 - k0]))[free]


def _limits(coordinates: FloatArray, start: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """k0 and k1 of coordinates; a k1 that is not free stays where it is."""
    values = iter(np.exp(coordinates))
    k0 = float(next(values)) if free[0] else float(start[0])
    k1 = k0 + float(next(values)) if free[1] else float(start[1])
    return np.array([k0, k1])


def _chain(limits: FloatArray, slope: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """The gradient by the coordinates."""
    k0, k1 = limits
    by_k0 = k0 * (slope[0] + (slope[1] if free[1] else 0.0))
    return np.array([by_k0, (k1 - k0) * slope[1]])[free]


def _bounds(start: FloatArray, free: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Of the coordinates; k0 stays below a k1 that does not move."""
    low, high = _LOWEST.copy(), _HIGHEST.copy()
    if not free[1]:
        high[0] = min(high[0], 0.95 * start[1])
        low[0] = min(low[0], 0.5 * high[0])
    return np.log(low)[free], np.log(high)[free]
