"""The worst fault: which satellites, of what size and direction, make a dangerous event likeliest.

For least squares this is exact: the worst direction has a closed form and its size is found in one dimension
(`pl_mc.integrity_risk.worst.ls_exact`). For any other method the event's probability is itself an estimate. Of one
satellite curves of it against the size are searched (`pl_mc.integrity_risk.worst.single`); of pairs, which are
many, the limit state of a thousand draws for each fault, and then the best few
(`pl_mc.integrity_risk.worst.pairs`). A caller's own estimator is asked fault by fault, first coarsely and then
near the top (`pl_mc.integrity_risk.worst.search`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np
import pandas as pd

from pl_mc.alert import LPV_200, VERTICAL, AlertLimits, as_axis, unjudged_note
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_SEED, require_bounded, require_geometry_and_alert
from pl_mc.faults import require_satellite
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_list, require_whole, require_within, shown
from pl_mc.integrity_risk.worst.bias_curve import Region
from pl_mc.integrity_risk.worst.ls_exact import (
    LsEpoch,
    alarm_probability,
    event_probability,
    law_with,
    ls_epochs,
    peaks,
    require_event,
    upper_bound,
    worst_direction,
)
from pl_mc.integrity_risk.worst.ls_horizontal import horizontal_table
from pl_mc.integrity_risk.worst.pairs import Screen, screened_table
from pl_mc.integrity_risk.worst.search import (
    GRID_M,
    MOST_SATELLITES,
    Estimator,
    Search,
    bias_columns,
    estimated_table,
    fault_columns,
    no_events,
    rare_event_estimator,
)
from pl_mc.integrity_risk.worst.single import single_table
from pl_mc.methods import Method, as_methods
from pl_mc.statistics.exact import LeastSquaresLaw

_NEGLIGIBLE = 1e-9


@ordinary_arithmetic
def worst_case(
    g: Geometry,
    *,
    method: str | Method = "ls",
    satellites: int | Sequence[str | Sequence[str]] = 1,
    alarm: Literal["pl", "chi2"] = "pl",
    event: Literal["missed", "misleading"] = "missed",
    p_fa: float = 1e-3,
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
    refine: int = 3,
    seed: int = 0,
    estimator: Estimator | None = None,
) -> pd.DataFrame:
    """The fault of each satellite (or pair) that makes a missed or misleading event likeliest, the worst first.

    For a method with an exact law, such as least squares, all vertical numbers are exact, and horizontally those of
    one satellite at a time. The noise has the sigma of the geometry. A fault and its negative are equally bad; the one
    with a positive bias on the first satellite is given.

    For other methods, and for all of them where either limit decides or pairs fail horizontally, numbers are estimates;
    the noise is Gaussian too. One satellite at a time: populations of subset simulation at 18 sizes from 1 to 150 m on
    every satellite find the event, and importance sampling from what all of them found gives, from one sample, the
    curve of its probability over all sizes on a satellite, whether it is 1e-2 or 1e-20. Sizes that a sample cannot tell
    are sampled again. About the best size of the ``refine`` worst satellites a finer curve follows, and there a last
    estimate by `pl_mc.risk` with ``target_cov`` and noise of its own, so that choosing the largest does not bias it.
    Nothing bounds what was passed over: parts of the event that no population met, narrow peaks between the sizes,
    sizes beyond 150 m. All satellites take about two minutes of one core; a list in ``satellites`` shortens it, but
    fewer populations find less.

    Pairs of such a method are screened first: 42 faults of each pair (seven sizes, both relative signs, three
    ratios, and the direction that is worst for least squares) by the limit state of 1024 draws, the same for all;
    then the best faults of the best pairs by a small population of subset simulation each; the ``refine`` best of
    these are refined and estimated as above. Nothing bounds what the screening may have passed over.

    Args:
        g: the geometry, one epoch or a series; each epoch is searched on its own.
        method: name or record of a method; the multiplier of the protection level is the record's.
        satellites: how many fail together, 1 or 2, or which: names and tuples of names, such as
            ``["G03", ("G05", "E08")]``.
        alarm: ``pl``, alarm when VPL > VAL; ``chi2`` (exact laws alone), alarm when V'PV exceeds its fault-free
            quantile at ``p_fa``, with VAL as the limit of the error.
        event: ``missed``, |vertical error| > VAL and no alarm, or ``misleading``, |vertical error| > VPL and no
            alarm.
        p_fa: fault-free alarm probability of ``chi2``.
        alert: alert limits.
        axis: which of them decide, ``vertical``, ``horizontal`` (the length of the horizontal error, HPL and HAL) or
            ``either``; the vertical one unless given, the horizontal one where there is no other.
        target_cov, max_evaluations, seed: of the last estimates: coefficient of variation, largest number of
            evaluations for each fault, seed; not used by least squares.
        refine: how many of the worst satellites or pairs per epoch are refined; not used by least squares.
        estimator: a function of faults, coefficient of variation and seed that gives a table with the columns
            ``probability, standard_error, low, high, warning``, one row per fault; it takes the place of the
            rare-event estimator (and of the exact probability of least squares). The search is then a scan of 12
            sizes with a coefficient of variation of 0.5, three rounds around the best one, and a last estimate.

    Returns:
        One row per epoch and satellite or pair, within an epoch the largest probability first: ``epoch, method`` (and
        ``axis`` where one was given or the horizontal limit decides), ``satellites`` (``G03`` or ``G03,E08``),
        ``fault`` (label), ``bias_m`` [m] (missing for pairs), for pairs ``bias_1_m, bias_2_m`` [m], ``probability,
        standard_error, low, high`` (95 %), and for comparison the largest probability on the usual grid of 5, 10, ...,
        100 m (for pairs both sizes on the grid, with either relative sign): ``grid_bias_m`` (or ``grid_bias_1_m,
        grid_bias_2_m``) and ``grid_probability``. For least squares also ``vertical_m``, mean vertical error under the
        fault [m] (or ``horizontal_m``, the length of the horizontal one), ``noncentrality`` of V'PV, and
        ``alarm_rate``. For other methods also ``refined`` and ``warning``; the grid is what the search has of it, at
        the search's accuracy, and so are the numbers of satellites that are not refined. Of single satellites also
        ``subset_probability, subset_standard_error``, what the second estimator of `pl_mc.risk` found. A bias is
        infinite where no residual shows the fault, and missing where the probability is zero: at an epoch without
        redundancy, which always alarms, or below about 1e-290. Of screened pairs there is no grid; ``stage`` says how
        far each came (``screened, shortlisted, refined``), ``rough`` is what the screening makes of its probability,
        without an error, and only a refined pair has a ``probability``. The interval of the others is that of the
        event's count among the draws of the screening, for their worst fault there. ``table.attrs["evaluations"]`` is
        the number of scenarios at each stage, summed over the epochs.

    Raises:
        InputError: unknown names, options outside their range, ``chi2`` for a method without an exact law.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.worst_case(g, method="ls", event="misleading")
        >>> table[["fault", "bias_m", "probability"]].head(2).round(3)
                       fault  bias_m  probability
        0  G22:+4.859127942m   4.859        0.106
        1  G20:+2.467385682m   2.467        0.007
    """
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    judged = as_axis(axis, alert)
    require_event(event)
    (chosen,) = as_methods([method], g)
    groups_of = [satellite_groups(one, satellites, g.names) for one in g.as_series()]
    single = all(len(group) == 1 for groups in groups_of for group in groups)
    law = law_with(alarm, chosen, estimated=estimator is not None, axis=judged, single=single)
    refine = require_whole(refine, field="refine", low=1)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    require_within(target_cov, field="target_cov", low=1e-3, high=1.0)
    if estimator is not None and not callable(estimator):
        raise InputError(f"estimator: a function of faults, target_cov and seed is needed, not {shown(estimator)}.")
    if estimator is None:
        require_bounded(g, chosen)
    parts: list[pd.DataFrame] = []
    spent: dict[str, int] = {}
    for one, groups in zip(g.as_series(), groups_of, strict=True):
        epochs = ls_epochs(one, law or LeastSquaresLaw(), judged, alarm=alarm, p_fa=p_fa, alert=alert)
        epoch = epochs[0]
        if law and judged != VERTICAL:
            table = horizontal_table(one, law, alert, event, groups)
        elif law:
            table = _exact_table(one, epoch, event, groups)
        else:
            estimate: Estimator = no_events
            if epoch.available:
                estimate = estimator or rare_event_estimator(
                    one, chosen, event, alert, judged, target_cov=target_cov, max_evaluations=max_evaluations
                )
            search = Search(estimate, target_cov, refine, seed)
            if estimator is not None or not epoch.available:
                table = estimated_table(one, groups, search)
            elif any(len(group) > 1 for group in groups):
                screen = Screen.of(one, chosen, event, alert, np.random.default_rng((seed, int(one.epoch))), judged)
                table = screened_table(one, groups, _guesses(epochs, event, groups), screen, search)
            else:
                region = Region.of(one, chosen, event, alert, judged)
                table = single_table(one, [group[0] for group in groups], region, search)
        table.insert(0, "epoch", int(one.epoch))
        table.insert(1, "method", chosen.name)
        if axis is not None or judged != VERTICAL:
            table.insert(2, "axis", judged)
        for stage, number in table.attrs.pop("evaluations", {}).items():
            spent[stage] = spent.get(stage, 0) + number
        parts.append(table.sort_values("probability", ascending=False, kind="stable"))
    whole = pd.concat([part for part in parts if len(part)] or parts[:1], ignore_index=True)
    whole.attrs["unjudged"] = unjudged_note(alert, (judged,))
    if spent:
        whole.attrs["evaluations"] = spent
    return whole


@dataclass(frozen=True)
class Worst:
    """The worst fault of each of several kinds.

    Attributes:
        bias_m: (m, n), biases [m]; infinite where no residual shows the fault, NaN where the probability is zero.
        root: (m,), root of the noncentrality.
        shift: (m,), mean vertical error in its standard deviations.
        probability: (m,).
    """

    bias_m: FloatArray
    root: FloatArray
    shift: FloatArray
    probability: FloatArray


def satellite_groups(
    g: Geometry, satellites: int | Sequence[str | Sequence[str]], names: Sequence[str]
) -> list[tuple[int, ...]]:
    """Rows of the satellites that fail together; at an epoch of a series those groups that are all in view.

    ``satellites`` are as for `worst_case`, ``names`` all of the series.
    """
    if not isinstance(satellites, Iterable):
        number = require_whole(satellites, field="satellites", low=1, high=2)
        return list(combinations(range(len(g.names)), number))
    if isinstance(satellites, str):
        raise InputError(f"satellites: 1, 2 or a list of names is needed, such as [{shown(satellites)}], not a word.")
    satellites = require_list(satellites, field="satellites", of="names, or 1 or 2,")
    groups = []
    for item in satellites:
        group = (item,) if isinstance(item, str) else tuple(require_list(item, field="satellites", of="names"))
        for name in group:
            if not isinstance(name, str) or name not in names:
                require_satellite(g, name)
        if not group or len(set(group)) < len(group):
            raise InputError(f"satellites: different names that fail together are needed, not {shown(group)}.")
        if all(name in g.names for name in group):
            groups.append(tuple(g.names.index(name) for name in group))
    if not satellites:
        raise InputError("satellites: at least one name is needed.")
    return groups


def exact_worst(epoch: LsEpoch, event: str, kinds: Sequence[tuple[int, ...]] | Sequence[FloatArray]) -> Worst:
    """The worst fault of each kind under least squares.

    A kind is the rows of the satellites that fail, or columns (n, k) that span its faults [m].
    """
    n = epoch.sigma_m.size
    if not epoch.available:
        nothing = np.full(len(kinds), np.nan)
        return Worst(np.full((len(kinds), n), np.nan), nothing, nothing, np.zeros(len(kinds)))
    columns = [np.eye(n)[:, list(kind)] if isinstance(kind, tuple) else kind for kind in kinds]
    directions = [worst_direction(epoch, each) for each in columns]
    slopes = np.array([direction.slope for direction in directions])
    root, probability = peaks(epoch, event, slopes)
    bias = np.array([direction.bias_m for direction in directions]).reshape(-1, n)
    bias = np.where(np.abs(bias) > _NEGLIGIBLE * np.abs(bias).max(axis=1, keepdims=True), bias, 0.0)
    first = np.take_along_axis(bias, (bias != 0).argmax(axis=1)[:, None], axis=1)
    bias = bias * np.where(first < 0, -1.0, 1.0)
    sign = np.where(bias @ (epoch.sensitivity / epoch.sigma_m) < 0, -1.0, 1.0)
    finite = np.isfinite(root)
    size = np.where(finite, root, 0.0)[:, None] * bias
    hidden = np.where(bias != 0, np.copysign(np.inf, bias), 0.0)
    size = np.where(finite[:, None], size, hidden)
    steep = np.where(finite, slopes, 1.0)
    # With a zero added, so that no fault does not give minus zero.
    shift = np.where(finite, sign * steep * np.where(finite, root, 0.0), sign * np.inf) + 0.0
    zero = probability <= 0.0
    return Worst(
        bias_m=np.where(zero[:, None], np.nan, size),
        # A fault that no residual shows leaves V'PV as it is.
        root=np.where(zero, np.nan, np.where(finite, root, 0.0)),
        shift=np.where(zero, np.nan, shift),
        probability=probability,
    )


def _guesses(epochs: Sequence[LsEpoch], event: str, groups: Sequence[tuple[int, ...]]) -> FloatArray:
    """(groups, n), the worst fault of each group for least squares, of the component that it makes likeliest [m]."""
    found = [exact_worst(epoch, event, groups) for epoch in epochs]
    best = np.argmax([one.probability for one in found], axis=0)
    return np.array([found[k].bias_m[j] for j, k in enumerate(best)]).reshape(len(groups), -1)


def _exact_table(g: Geometry, epoch: LsEpoch, event: str, groups: Sequence[tuple[int, ...]]) -> pd.DataFrame:
    worst = exact_worst(epoch, event, groups)
    alarm = np.ones(len(groups))
    grid_bias, grid_probability = np.full_like(worst.bias_m, np.nan), np.zeros(len(groups))
    if epoch.available:
        seen = np.isfinite(worst.root)
        alarm = np.full(len(groups), np.nan)
        alarm[seen] = alarm_probability(epoch, worst.root[seen])
        grid_bias, grid_probability = _largest_on_grid(epoch, event, groups)
    return pd.DataFrame(
        {
            **fault_columns(g, groups, worst.bias_m),
            "probability": worst.probability,
            "standard_error": 0.0,
            "low": worst.probability,
            "high": worst.probability,
            "vertical_m": worst.shift * epoch.vdop_m,
            "noncentrality": worst.root**2,
            "alarm_rate": alarm,
            **bias_columns(groups, grid_bias, "grid_"),
            "grid_probability": grid_probability,
        }
    )


def _largest_on_grid(epoch: LsEpoch, event: str, groups: Sequence[tuple[int, ...]]) -> tuple[FloatArray, FloatArray]:
    """Biases (m, n) [m] and probability (m,) of the worst fault on `GRID_M`; NaN for three satellites and more."""
    bias = np.full((len(groups), epoch.sigma_m.size), np.nan)
    best = np.full(len(groups), np.nan)
    for k, group in enumerate(groups):
        if len(group) > MOST_SATELLITES:
            continue
        faults = np.zeros((GRID_M.size ** len(group) * 2 ** (len(group) - 1), epoch.sigma_m.size))
        faults[:, list(group)] = list(product(GRID_M, *[np.concatenate([GRID_M, -GRID_M])] * (len(group) - 1)))
        shift, root = epoch.effects(faults)
        bound = upper_bound(epoch, event, shift, root)
        # Where the bound is largest first; after it only faults that could be worse.
        first = int(bound.argmax())
        found = float(event_probability(epoch, event, shift[first], root[first]))
        others = np.flatnonzero(bound > found)
        values = event_probability(epoch, event, shift[others], root[others])
        if others.size and values.max() > found:
            first, found = int(others[values.argmax()]), float(values.max())
        best[k] = found
        bias[k] = faults[first] if found > 0 else np.nan
    return bias, best
