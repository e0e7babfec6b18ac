"""The limits k0, k1 of IGG-III that cost least at a given risk, found by descents and judged on fresh noise.

For every pair of limits the multiplier is the one that keeps the target, so that only the price is left to be made
small: the mean protection level, or the share of alarms, without a fault. The search sees a smoothed price over
noise that stays the same (`pl_mc.integrity_risk.tuning.objective`); it starts from the record's limits and from two
pairs besides, since the price has more than one valley. What it finds is judged with noise of its own, without
smoothing, beside where it started and beside the best of a plain grid over the noise of the search
(`pl_mc.integrity_risk.tuning.judge`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import EITHER, HORIZONTAL, LPV_200, VERTICAL, AlertLimits, as_axis, unjudged_note
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_geometry_and_alert, require_inputs, require_single
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import (
    InputError,
    require_choice,
    require_fraction,
    require_list,
    require_positive,
    require_whole,
    require_within,
)
from pl_mc.integrity_risk.k_factor.calibrated import fewest_draws
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import EVENTS, MISLEADING
from pl_mc.integrity_risk.rare.risk import FEWEST_EVALUATIONS, MOST_EVALUATIONS
from pl_mc.integrity_risk.tuning.draws import weighted_noise
from pl_mc.integrity_risk.tuning.judge import (
    SAMPLES,
    Judged,
    counted_limits,
    estimated_limits,
    k_factor,
    price,
    unknown_limits,
)
from pl_mc.integrity_risk.tuning.objective import ALARMS, LEVEL, TuningProblem, WeightedNoise
from pl_mc.methods import Igg3, Method, as_methods
from pl_mc.methods.capabilities import with_k
from pl_mc.statistics.least_squares import ls_quantities

PARAMETERS = ("k0", "k1")
START, TUNED, GRID = "start", "tuned", "grid"

# Where k0 and k1 - k0 may go, in the search and on the grid.
_LOWEST, _HIGHEST = np.array([0.5, 0.5]), np.array([6.0, 20.0])
# k0 and k1 from which the search starts besides those of the record.
_STARTS = ((0.8, 10.0), (3.0, 6.0))
# Differences of the search reach so far to either side, in the logarithms of k0 and k1 - k0; they may pass the bounds.
_SPAN = 0.05
# Events that the noise of the search has to have at the target, or its quantile says nothing.
_FEWEST_EVENTS = 20
# Weighted draws of the search, and fewer effective ones behind a multiplier of it than these say nothing.
_WEIGHTED_DRAWS, _LEAST_EFFECTIVE = 16_384, 30.0


@ordinary_arithmetic
def tune(
    g: Geometry,
    *,
    method: str | Method = "igg3",
    parameters: Sequence[str] | None = None,
    target: float = 1e-4,
    objective: Literal["vpl", "hpl", "alarms"] | None = None,
    event: Literal["exceeded", "misleading"] = "misleading",
    faults: Faults | None = None,
    alert: str | AlertLimits = LPV_200,
    axis: Literal["vertical", "horizontal"] | None = None,
    draws: int = 400_000,
    confidence: float = 0.95,
    seed: int = 0,
    steps: int = 30,
    grid: int = 5,
    smoothing: float = 0.05,
    search_draws: int | None = None,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
) -> pd.DataFrame:
    """Limits of IGG-III that make the price of a given risk small, beside the start and a plain grid.

    Gaussian noise, double precision. A target of which ``draws`` have 20 events is counted, in the search and in
    the judgement. A rarer one is searched for over weighted draws of importance sampling, and judged by the curve
    of the risk against the multiplier, with its check, as in `pl_mc.calibrate`.

    Args:
        g: one epoch.
        method: IGG-III by name or record; its limits are where the search starts, its other options stay.
        parameters: what may change, of ``k0``, ``k1`` and ``k_vertical`` (``k_horizontal``); all of them unless given.
            The multiplier follows from the target whether it is named or not.
        target: probability of the event per sample that is kept under each fault.
        objective: ``vpl``, mean VPL_R [m] where there is a solution (horizontally ``hpl``, mean HPL_R), or ``alarms``,
            share of alarms; fault-free. The mean level unless given.
        event: ``misleading``, |vertical error| > VPL and no alarm, or ``exceeded``, alarm or not.
        faults: the faults; the fault-free case unless given.
        alert: alert limits; that of the axis decides on alarms.
        axis: whose error and level it is, ``vertical``, or ``horizontal`` for HPL, HAL and the length of the horizontal
            error; the vertical one unless given, the horizontal one where the alert has no other limit.
        draws: of the search, and of either fresh set, for each fault; of a rare target those that judge the price.
        confidence: with which the multiplier keeps the target, and of the interval of the risk.
        seed: chooses the noise, 0 to 2^32 - 1.
        steps: most steps of the search (L-BFGS-B).
        grid: values of each of k0 and k1 - k0 on the grid; 0 for no grid.
        smoothing: width of the steps that take the place of jumps in the search, in the logarithm of the ratio.
        search_draws: weighted draws of the search for each fault, and plain ones for the price; 16,384 for a rare
            target unless given. Where given, a target that is counted is searched for in this way as well.
        target_cov, max_evaluations: of the curves that judge a rare target, see `pl_mc.calibrate`.

    Returns:
        Rows ``start``, ``tuned`` and ``grid`` (column ``limits``) with ``k0, k1``; ``k_vertical`` or ``k_horizontal``,
        the multiplier that keeps the target with the confidence on fresh noise, and ``k_best, k_low``, the best value
        and one that with the confidence does not; ``objective`` there and ``objective_error``, its standard error, the
        multiplier's among it; ``change`` from the start and ``change_error``, of the same draws; ``found``
        (``counting`` or ``rare events``); ``vpl_m`` (or ``hpl_m``), mean level [m], and ``alarms`` of ``draws`` with
        ``alarm_rate, alarm_low, alarm_high``, all fault-free at that multiplier; ``risk, risk_low, risk_high``: share
        of the event there in a third set of draws, under the fault with the largest (``risk_fault``), with its interval
        (two-sided, for that fault alone), of a rare target the curve's; ``check_probability, check_low,
        check_high``: of a rare target what importance sampling finds at that fault's best multiplier;
        ``evaluations``, scenarios that finding the limits took; ``warning``. Where
        two estimates of a rare target disagree, or the weights of the search degenerate, there is a warning and no
        number. Where an axis was given or the horizontal limit decides it stands in a column ``axis`` behind
        ``limits``. ``table.attrs["method"]`` is the tuned record with its multiplier, or None without one.

    Raises:
        InputError: a series of epochs, an epoch without redundancy, a method that is not IGG-III, options outside
            their range.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> robust, few = pl_mc.igg3(iterations=2), {"draws": 1024, "search_draws": 1024, "grid": 2, "steps": 1}
        >>> table = pl_mc.tune(g, method=robust, parameters=["k0"], target=0.05, max_evaluations=500_000, **few)
        >>> table[["limits", "k1"]]
          limits   k1
        0  start  5.0
        1  tuned  5.0
        2   grid  5.0
    """
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    decides = as_axis(axis, alert)
    if decides == EITHER:
        raise InputError(f"axis: one error and one level are tuned; choose {VERTICAL} or {HORIZONTAL}.")
    multiplier = f"k_{decides}"
    require_single(g, "tuning")
    faults = no_fault(g) if faults is None else faults
    require_inputs(g, faults, alert, any_axis=True)
    level = LEVEL[decides]
    aim = require_choice(level if objective is None else objective, (level, ALARMS), field="objective")
    require_choice(event, EVENTS, field="event")
    known = (*PARAMETERS, multiplier)
    parameters = known if parameters is None else parameters
    named = [parameters] if isinstance(parameters, str) else require_list(parameters, field="parameters", of="names")
    for name in named:
        require_choice(name, known, field="parameters")
    require_within(target, field="target", low=1e-15, high=0.999)
    require_fraction(confidence, field="confidence")
    require_positive(smoothing, field="smoothing")
    draws = require_whole(draws, field="draws", low=100, high=LARGEST_DRAWS)
    counts = draws >= max(int(np.ceil(_FEWEST_EVENTS / target)), fewest_draws(target, confidence))
    if search_draws is not None:
        search_draws = require_whole(search_draws, field="search_draws", low=1024, high=LARGEST_DRAWS)
    require_within(target_cov, field="target_cov", low=1e-3, high=1.0)
    max_evaluations = require_whole(
        max_evaluations, field="max_evaluations", low=FEWEST_EVALUATIONS, high=MOST_EVALUATIONS
    )
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    steps, grid = require_whole(steps, field="steps", low=1), require_whole(grid, field="grid", low=0)
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
        method=record,
        target=target,
        misleading=event == MISLEADING,
        objective=aim,
        limit_m=alert.limit_m[decides],
        step=smoothing,
        axis=decides,
    )
    noises = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    search, fresh, last = (rng.standard_normal((draws, len(g.names))) for rng in noises[:3])
    start = np.array([record.k0, record.k1])
    room = _Room(start, np.array(["k0" in named, "k1" in named]))
    if (counts and search_draws is None) or not room.free.any():
        tuned, evaluations, note = _descend(problem, room, search, steps, (start, *map(np.array, _STARTS)))
        seen: FloatArray | WeightedNoise = search
        effective = np.inf
    else:
        tuned, evaluations, note, seen, effective = _descend_weighted(
            problem, room, noises[0], steps, search_draws or _WEIGHTED_DRAWS
        )
    weights = np.stack([noises[3].poisson(1.0, draws).astype(np.uint8) for _ in range(SAMPLES)])

    def judged(limits: FloatArray) -> Judged:
        if counts:
            return counted_limits(problem, limits, fresh, last, weights, faults, confidence)
        return estimated_limits(
            g, problem, limits, fresh, weights, faults, confidence, record=record, alert=alert, seed=seed,
            target_cov=target_cov, max_evaluations=max_evaluations,
        )  # fmt: skip

    first = judged(start)

    def beside(limits: FloatArray) -> Judged:
        return first if (limits == start).all() else judged(limits)

    rows = [_row(START, start, first, 0, "", first=first, multiplier=multiplier)]
    doubt = f"the weighted draws of the search degenerate: {effective:.0f} effective ones are behind the risk"
    found = unknown_limits(problem, doubt) if effective < _LEAST_EFFECTIVE else beside(tuned)
    rows.append(_row(TUNED, tuned, found, evaluations, note, first=first, multiplier=multiplier))
    if grid:
        best, looked = _best_of_grid(problem, room, seen, grid, confidence)
        rows.append(_row(GRID, best, beside(best), looked, "", first=first, multiplier=multiplier))
    table = pd.DataFrame(rows)
    k0, k1 = (float(value) for value in tuned)
    k = float(table[multiplier].iloc[1])
    table.attrs["method"] = with_k(replace(record, k0=k0, k1=k1), k, decides) if k > 0 else None
    table.attrs["unjudged"] = unjudged_note(alert, (decides,))
    if axis is not None or decides != VERTICAL:
        table.insert(1, "axis", decides)
    return table


def _row(
    name: str, limits: FloatArray, judged: Judged, evaluations: int, note: str, *, first: Judged, multiplier: str
) -> dict[str, Any]:
    change = judged.resampled - first.resampled
    return {
        "limits": name,
        "k0": limits[0],
        "k1": limits[1],
        multiplier: judged.columns[multiplier],
        "objective": judged.objective,
        "objective_error": float(judged.resampled.std(ddof=1)),
        "change": judged.objective - first.objective,
        "change_error": float(change.std(ddof=1)),
        **judged.columns,
        "evaluations": evaluations,
        "warning": "; ".join(filter(None, (note, judged.warning))),
    }


@dataclass(frozen=True)
class _Room:
    """Which limits may move, and the logarithms that they move in: of k0, and of k1 or its distance from a free k0.

    Attributes:
        start: (2,), limits, where what is not free stays.
        free: (2,), whether k0 and k1 may move.
    """

    start: FloatArray
    free: NDArray[np.bool_]

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Of the coordinates; k0 stays below a k1 that does not move."""
        low, high = _LOWEST.copy(), _HIGHEST.copy()
        if not self.free[1]:
            high[0] = min(high[0], 0.95 * self.start[1])
            low[0] = min(low[0], 0.5 * high[0])
        return np.log(low)[self.free], np.log(high)[self.free]

    def inside(self, limits: FloatArray) -> FloatArray:
        """Coordinates of limits, the nearest within the bounds."""
        k0, k1 = limits
        return np.clip(np.log(np.array([k0, k1 - k0]))[self.free], *self.bounds)

    def limits(self, coordinates: FloatArray) -> FloatArray:
        """k0 and k1 of coordinates."""
        values = iter(np.exp(coordinates))
        k0 = float(next(values)) if self.free[0] else float(self.start[0])
        return np.array([k0, k0 + float(next(values)) if self.free[1] else float(self.start[1])])


def _descend_weighted(
    problem: TuningProblem, room: _Room, rng: np.random.Generator, steps: int, draws: int
) -> tuple[FloatArray, int, str, WeightedNoise, float]:
    """The descent over weighted draws, once from every start and once more from where it ended.

    Returns:
        Limits, scenarios, a note, the last draws, and how many of them are effective behind the multiplier there.
    """
    starts = [room.start, *(room.limits(room.inside(np.array(first))) for first in _STARTS)]
    noise, proposals, spent = weighted_noise(problem, starts, rng, draws)
    tuned, evaluations, _ = _descend(problem, room, noise, steps, starts)
    # Where the search ended nothing was adapted yet.
    noise, _, more = weighted_noise(problem, [tuned], rng, draws, proposals)
    tuned, again, note = _descend(problem, room, noise, steps, [tuned])
    effective = problem.effective(tuned, noise)
    return tuned, spent + evaluations + more + again, note, noise, effective


def _descend(
    problem: TuningProblem, room: _Room, noise: FloatArray | WeightedNoise, steps: int, starts: Sequence[FloatArray]
) -> tuple[FloatArray, int, str]:
    """Limits at which the smoothed objective is least, of descents from ``starts``; what that cost, and a note."""
    from scipy import optimize

    if not room.free.any():
        return room.start, 0, ""
    calls = 0

    def price_at(coordinates: FloatArray) -> float:
        nonlocal calls
        calls += 1
        return problem.smooth(room.limits(coordinates), noise)[0]

    def value(coordinates: FloatArray) -> tuple[float, FloatArray]:
        steps = _SPAN * np.eye(len(coordinates))
        slope = [(price_at(coordinates + one) - price_at(coordinates - one)) / (2.0 * _SPAN) for one in steps]
        return price_at(coordinates), np.array(slope)

    low, high = room.bounds
    # A ten thousandth of the price is far below its error.
    bounds, options = list(zip(low, high, strict=True)), {"maxiter": steps, "ftol": 1e-4}
    runs = [
        optimize.minimize(value, room.inside(one), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        for one in starts
    ]
    found = min(runs, key=lambda run: run.fun)
    at_bound = bool((np.isclose(found.x, low) | np.isclose(found.x, high)).any())
    notes = ["at a bound of the search"] if at_bound else []
    notes += [] if found.success else ["the steps ran out"]
    return room.limits(found.x), calls * _scenarios(problem, noise), "; ".join(notes)


def _scenarios(problem: TuningProblem, noise: FloatArray | WeightedNoise) -> int:
    """Scenarios behind one look at the objective."""
    if isinstance(noise, WeightedNoise):
        return len(noise.plain) + noise.weight.size
    return (len(problem.bias_m) + int(problem.bias_m.any(axis=1).all())) * len(noise)


def _best_of_grid(
    problem: TuningProblem, room: _Room, noise: FloatArray | WeightedNoise, grid: int, confidence: float
) -> tuple[FloatArray, int]:
    """The best limits of a grid, judged as they are on the noise of the search, and what that cost."""
    if not room.free.any():
        return room.start, 0
    axes = [np.linspace(a, b, grid) for a, b in zip(*room.bounds, strict=True)]
    points = [room.limits(point) for point in np.stack(np.meshgrid(*axes), -1).reshape(-1, len(axes))]
    prices: list[float] = []
    for limits in points:
        drawn = problem.draws(limits, noise)
        prices.append(price(problem, k_factor(drawn, problem.target, confidence), drawn.log_unit_m))
    return points[int(np.argmin(prices))], len(points) * _scenarios(problem, noise)
