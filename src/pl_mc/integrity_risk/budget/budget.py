"""The risk budget: how much each fault mode adds to the probability of a dangerous event on an approach.

Faults come from independent sources: every satellite with the prior probability P_sat, every constellation with
P_const. A mode is the set of sources that have failed. No source, each one alone and each pair of them are
analysed, whatever is left counts with its whole prior probability: an unmonitored fault is taken to be dangerous
always.

A failed satellite has a bias of its own. Of a failed constellation two models are offered: ``independent`` biases
on all of its satellites, which holds every fault of the constellation, and a ``common`` bias. A common bias on all
satellites of a system that has a clock column of its own is a clock error and nothing else: neither the position
nor the residuals move, so that such a mode adds no more than the fault-free case does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special

from pl_mc.alert import LPV_200, VERTICAL, AlertLimits, as_axis
from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_SEED, require_bounded, require_geometry_and_alert, require_single
from pl_mc.faults import Faults, fault_label
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_choice, require_positive, require_whole
from pl_mc.integrity_risk.modes.fault_modes import (
    COMMON,
    FAULT_FREE,
    INDEPENDENT,
    P_CONST,
    P_SAT,
    PAIR,
    Mode,
    Sizes,
    fault_modes,
    not_monitored,
    source_priors,
)
from pl_mc.integrity_risk.worst.ls_exact import (
    LsEpoch,
    event_probability,
    law_with,
    ls_epochs,
    require_event,
    upper_bound,
    worst_direction,
)
from pl_mc.integrity_risk.worst.search import NO_ESTIMATE, Estimator, rare_event_estimator
from pl_mc.integrity_risk.worst.worst_case import exact_worst, worst_case
from pl_mc.ism import as_ism
from pl_mc.methods import Method, as_methods
from pl_mc.statistics.exact import LeastSquaresLaw

NOT_MONITORED, TOTAL = "not_monitored", "total"
EXACT, ESTIMATED, BOUNDED = "exact", "estimated", "bounded by the prior"

_NEGLIGIBLE = 1e-60
# Whitened biases that move neither the position nor a residual by more than this share of them are clock errors.
_CLOCK_ERROR = 1e-9
# Pairs that are searched by estimates unless somebody asks for more.
_FEW_PAIRS = 3
# The search by estimates takes so many satellites at a time.
_MOST_SEARCHED = 2
# A mean over drawn sizes that rests on fewer of them than this has no normal distribution.
_ENOUGH_DRAWS = 30.0


@dataclass(frozen=True)
class Conditional:
    """P(event | mode): value, standard error, bounds (95 %), how it was found, worst fault (if that was asked)."""

    probability: float
    standard_error: float
    low: float
    high: float
    found: str
    fault: str = ""
    warning: str = ""


_NUMBERS = ("probability", "standard_error", "low", "high")

# Nothing is known but that it is a probability; it counts with the most that it can be.
_AT_MOST_ONE = Conditional(1.0, 0.0, 0.0, 1.0, BOUNDED)


@ordinary_arithmetic
def risk_budget(
    g: Geometry,
    *,
    method: str | Method = "ls",
    event: Literal["missed", "misleading"] = "missed",
    alarm: Literal["pl", "chi2"] = "pl",
    p_fa: float = 1e-3,
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    p_sat: float | Mapping[str, float] = P_SAT,
    p_const: float | Mapping[str, float] = P_CONST,
    ism: Any = None,
    bias: Any = "worst",
    weights: ArrayLike | None = None,
    signs: Literal["random", "positive"] = "random",
    constellation: Literal["independent", "common"] = "independent",
    pairs: str | int | None = None,
    samples_per_approach: int = 25,
    target: float = 2e-7,
    draws: int = 1000,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
    seed: int = 0,
    estimator: Estimator | None = None,
) -> pd.DataFrame:
    """Contributions of all fault modes to the integrity risk of an approach.

    For a method with an exact law, such as least squares, every vertical conditional probability is exact, but for
    biases from a distribution on several satellites, whose exact probabilities are averaged over drawn sizes. For other
    methods, and for all of them on another axis, they are estimates of the rare-event estimator; the worst faults of
    more than two satellites at a time, as of a constellation with independent biases, are then beyond the search and
    bounded by their priors.

    Args:
        g: one epoch.
        method: name or record of a method.
        event, alarm, p_fa, alert, axis: as for `pl_mc.worst_case`.
        p_sat: prior probability that a satellite is faulted at a sample, one for all, or by name (or by system
            letter, for what is not named).
        p_const: prior probability that a constellation is faulted, one for all, or by system letter; 0 for none.
        ism: an integrity support message that says p_sat and p_const, or one of them: `pl_mc.araim.Ism`, a table of its
            fields or the path of a CSV file. Of its other fields a budget makes no use: the sigma of ``g`` holds
            sigma_URA where its error model has the ISM.
        bias: ``worst``, for every mode its worst fault; or the distribution of the size of a bias [m], the same for
            every faulted satellite and independent: ``("uniform", 5, 100)`` (or another continuous distribution of
            `scipy.stats` with its parameters; of "uniform" the ends), a frozen `scipy.stats` distribution, or an
            array of sizes.
        weights: (k,), probabilities of an array of sizes, up to a factor; equal unless given.
        signs: of biases from a distribution: ``random``, either with probability 1/2, or ``positive``, as given.
        constellation: ``independent`` biases on all satellites of a failed constellation, or a ``common`` one.
        pairs: ``all``, or how many pairs of satellites are analysed: those of the largest prior times
            least-squares slope. The rest counts with its prior. Unless given all where that is exact, else three,
            since each pair takes 24 estimates.
        samples_per_approach: independent samples in an approach of 150 s, over which the risk adds up.
        target: largest tolerable risk of an approach.
        draws: vectors of sizes drawn for modes with several satellites; not used for worst faults. Where
            probabilities are estimates each draw is a run of the estimator: at most 64 are made.
        target_cov, max_evaluations, estimator: for methods other than least squares, as for `pl_mc.worst_case`.
        seed: of draws and estimates.

    Returns:
        One row per mode, those that were analysed by kind, then ``not_monitored`` (all modes that were not, their
        probability 1) and ``total``: ``mode`` (its kind), ``failed`` (names), ``fault`` (the worst one, where asked
        for), ``prior``, ``probability`` given the mode, ``standard_error, low, high`` of it (95 %; equal where exact),
        ``found`` (``exact``, ``estimated`` or ``bounded by the prior``), ``risk_per_sample`` (prior times probability),
        ``risk_per_approach`` (times the number of samples: by the union bound at most so much), ``risk_low, risk_high``
        of the approach, ``of_target`` (over ``target``) and ``warning``. ``attrs`` holds ``verdict``: ``met``, ``not
        met``, or ``not shown`` where the target lies between the bounds of the total, with ``target``, ``total`` and
        ``axis``. The total's bounds are sums of the rows' bounds: the standard error of a sum is at most the sum of
        standard errors, whatever the estimates have in common.

    Raises:
        InputError: a series, unknown names or options, probabilities outside their range.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.risk_budget(g, method="ls", event="misleading")
        >>> table[["mode", "failed", "fault", "prior", "found"]].iloc[:3]
                 mode failed fault    prior  found
        0  fault_free               0.99982  exact
        1   satellite    G01  none  0.00001  exact
        2   satellite    G03  none  0.00001  exact
    """
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    judged = as_axis(axis, alert)
    require_single(g, "a risk budget")
    require_event(event)
    require_choice(constellation, (INDEPENDENT, COMMON), field="constellation")
    samples = require_whole(samples_per_approach, field="samples_per_approach", low=1)
    require_positive(target, field="target")
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    draws = require_whole(draws, field="draws", low=2)
    sizes = None if isinstance(bias, str) and bias == "worst" else Sizes.of(bias, weights, signs)
    if sizes is None and weights is not None:
        raise InputError("weights: they belong to an array of sizes, which bias='worst' is not.")
    (chosen,) = as_methods([method], g)
    if sizes is None and estimator is None:
        require_bounded(g, chosen)
    law = law_with(alarm, chosen, estimated=estimator is not None, axis=judged)
    # Least squares ranks the pairs for every method.
    epochs = ls_epochs(g, law or LeastSquaresLaw(), judged, alarm=alarm, p_fa=p_fa, alert=alert)
    satellite_priors, constellation_priors = source_priors(g, p_sat, p_const, None if ism is None else as_ism(ism))
    modes = fault_modes(g, satellite_priors, constellation_priors, constellation=constellation)
    modes = _choose_pairs(modes, epochs, ("all" if law else _FEW_PAIRS) if pairs is None else pairs)
    if law:
        found = _exact_conditionals(g, epochs[0], event, modes, sizes, draws=draws, seed=seed)
    else:
        estimate = estimator or rare_event_estimator(
            g, chosen, event, alert, judged, target_cov=target_cov, max_evaluations=max_evaluations
        )
        options = {"method": chosen, "event": event, "alert": alert, "axis": judged, "target_cov": target_cov}
        found = _estimated_conditionals(g, epochs, modes, sizes, estimate, options, draws=min(draws, 64), seed=seed)
    rest = not_monitored(modes, [*satellite_priors, *constellation_priors.values()])
    table = _table(modes, found, rest, samples, target)
    if axis is not None or judged != VERTICAL:
        table.attrs["axis"] = judged
    return table


def _choose_pairs(modes: Sequence[Mode], epochs: Sequence[LsEpoch], pairs: str | int) -> list[Mode]:
    """The modes, with those pairs of satellites set aside that are not to be analysed."""
    if isinstance(pairs, str):
        require_choice(pairs, ("all",), field="pairs")
        return list(modes)
    number = require_whole(pairs, field="pairs", low=0)
    at = [k for k, mode in enumerate(modes) if mode.kind == PAIR]
    if epochs[0].available:

        def weight(mode: Mode) -> float:
            # In metres where several components of the error are compared.
            scales = [1.0] if len(epochs) == 1 else [epoch.vdop_m for epoch in epochs]
            slopes = [worst_direction(epoch, mode.directions).slope for epoch in epochs]
            return mode.prior * max(scale * slope for scale, slope in zip(scales, slopes, strict=True))

        at.sort(key=lambda k: -weight(modes[k]))
    aside = set(at[number:])
    return [replace(mode, analysed=k not in aside) for k, mode in enumerate(modes)]


def _exact_conditionals(
    g: Geometry, epoch: LsEpoch, event: str, modes: Sequence[Mode], sizes: Sizes | None, *, draws: int, seed: int
) -> dict[int, Conditional]:
    """P(event | mode) of every mode that is analysed, under least squares."""
    at = [k for k, mode in enumerate(modes) if mode.analysed]
    if not epoch.available:
        # An alarm always, and so no undetected event.
        return {k: Conditional(0.0, 0.0, 0.0, 0.0, EXACT) for k in at}
    quiet = Conditional(*_same(float(event_probability(epoch, event, 0.0, 0.0))), EXACT)
    found = {k: quiet for k in at if modes[k].kind == FAULT_FREE}
    rest = [k for k in at if k not in found]
    if sizes is None:
        worst = exact_worst(epoch, event, [modes[k].directions for k in rest])
        for k, value, row in zip(rest, worst.probability, worst.bias_m, strict=True):
            found[k] = Conditional(*_same(float(value)), EXACT, fault=_label(g, row))
        return found
    rng = np.random.default_rng(seed)
    for k in rest:
        columns = modes[k].directions
        if columns.shape[1] == 1:
            # Both signs are equally likely to be missed.
            shift, root = epoch.effects(sizes.values_m[:, None] * columns[:, 0])
            found[k] = Conditional(*_same(float(sizes.weights @ _mean_parts(epoch, event, shift, root))), EXACT)
        else:
            shift, root = epoch.effects(sizes.draw((draws, columns.shape[1]), rng) @ columns.T)
            found[k] = _mean(_mean_parts(epoch, event, shift, root), np.zeros(draws))
    return found


def _mean_parts(epoch: LsEpoch, event: str, shift: FloatArray, root: FloatArray) -> FloatArray:
    """The event's probabilities, without the integrals that no mean can notice."""
    values = np.zeros(shift.shape)
    counts = upper_bound(epoch, event, shift, root) > _NEGLIGIBLE
    values[counts] = event_probability(epoch, event, shift[counts], root[counts])
    return values


def _estimated_conditionals(
    g: Geometry, epochs: Sequence[LsEpoch], modes: Sequence[Mode], sizes: Sizes | None, estimate: Estimator,
    options: dict[str, Any], *, draws: int, seed: int,
) -> dict[int, Conditional]:  # fmt: skip
    """P(event | mode) of every mode that is analysed, from an estimator."""
    target_cov = float(options["target_cov"])

    def run(bias_m: FloatArray) -> pd.DataFrame:
        table = estimate(Faults.from_array(g, bias_m), target_cov, seed).reset_index(drop=True)
        unknown = table["probability"].isna()
        # Without an estimate the upper bound counts, which is one where there is none either.
        high = table["high"].fillna(1.0)
        table["warning"] = table["warning"].fillna("").mask(unknown & (table["warning"] == ""), NO_ESTIMATE)
        return table.assign(
            probability=table["probability"].fillna(high),
            standard_error=table["standard_error"].mask(unknown, 0.0),
            low=table["low"].fillna(0.0),
            high=high,
        )

    fault_free = _estimate_of(run(np.zeros((1, len(g.names)))).iloc[0])
    found: dict[int, Conditional] = {}
    searched: dict[int, tuple[str, ...]] = {}
    rng = np.random.default_rng(seed)
    for k, mode in enumerate(modes):
        if not mode.analysed:
            continue
        columns = _moving(epochs, mode.directions)
        faulted = columns.any(axis=1)
        if not faulted.any():
            found[k] = fault_free
        elif sizes is not None and columns.shape[1] == 1:
            found[k] = _weighted(run(sizes.few_m[:, None] * columns[:, 0]), sizes.few_weights)
        elif sizes is not None:
            table = run(sizes.draw((draws, columns.shape[1]), rng) @ columns.T)
            parts, errors = table["probability"].to_numpy(), table["standard_error"].to_numpy()
            found[k] = _mean(parts, errors, _warnings(table))
        elif faulted.sum() == columns.shape[1] <= _MOST_SEARCHED:
            # As many columns as satellites: every fault of one or two satellites.
            searched[k] = tuple(np.array(g.names)[faulted].tolist())
        else:
            found[k] = _AT_MOST_ONE
    if searched:
        # Several modes may come down to the faults of the same satellite.
        groups = list(dict.fromkeys(searched.values()))
        table = worst_case(g, satellites=groups, refine=len(groups), seed=seed, estimator=estimate, **options)
        table = table.set_index("satellites")
        for k, group in searched.items():
            row = table.loc[",".join(group)]
            if np.isnan(row["probability"]):
                found[k] = replace(_AT_MOST_ONE, warning=str(row["warning"]))
            elif row["probability"] < fault_free.probability:
                # The fault-free case is a fault of size zero: no mode's worst is below it.
                found[k] = fault_free
            else:
                found[k] = replace(_estimate_of(row), fault=str(row["fault"]))
    return found


def _moving(epochs: Sequence[LsEpoch], columns: FloatArray) -> FloatArray:
    """The columns without clock errors, which an estimate that starts from least-squares residuals never sees."""
    if not epochs[0].available:
        return columns
    scale = _CLOCK_ERROR * np.sqrt(((columns.T / epochs[0].sigma_m) ** 2).sum(axis=1))
    moves = np.zeros(columns.shape[1], dtype=bool)
    for epoch in epochs:
        shift, root = epoch.effects(columns.T)
        moves |= (np.abs(shift) > scale) | (root > scale)
    return columns[:, moves]


def _estimate_of(row: pd.Series) -> Conditional:
    """What an estimator says of one fault."""
    value, error, low, high = (float(row[name]) for name in _NUMBERS)
    return Conditional(value, error, low, high, ESTIMATED, warning=str(row["warning"]))


def _weighted(table: pd.DataFrame, weights: FloatArray) -> Conditional:
    """A weighted mean of estimates: bounds add up, for all of them may err to one side."""
    value, error, low, high = (float(weights @ table[name].to_numpy(dtype=float)) for name in _NUMBERS)
    return Conditional(value, error, low, high, ESTIMATED, warning=_warnings(table))


def _mean(parts: FloatArray, errors: FloatArray, warning: str = "") -> Conditional:
    """The mean over drawn sizes; bounds from the scatter of the draws, which holds that of the estimates."""
    value = float(parts.mean())
    effective = value**2 * parts.size / max(float((parts**2).mean()), np.finfo(float).tiny)
    if value > 0 and effective < _ENOUGH_DRAWS:
        note = f"{effective:.1f} of {parts.size} drawn sizes decide the mean, so that its bounds are rough"
        warning = "; ".join(filter(None, (warning, note)))
    error = float(max(parts.std(ddof=1), np.sqrt((errors**2).mean())) / np.sqrt(parts.size))
    reach = -float(special.ndtri(0.025)) * error
    return Conditional(value, error, max(value - reach, 0.0), min(value + reach, 1.0), ESTIMATED, warning=warning)


def _warnings(table: pd.DataFrame) -> str:
    doubtful = int((table["warning"].fillna("") != "").sum())
    return f"{doubtful} of {len(table)} faults came with a warning" if doubtful else ""


def _same(value: float) -> tuple[float, float, float, float]:
    return value, 0.0, value, value


def _label(g: Geometry, bias_m: FloatArray) -> str:
    return "" if np.isnan(bias_m).any() else fault_label(dict(zip(g.names, bias_m, strict=True)))


def _table(
    modes: Sequence[Mode], found: Mapping[int, Conditional], rest: float, samples: int, target: float
) -> pd.DataFrame:
    rows = [(mode.kind, mode.label, mode.prior, found[k]) for k, mode in enumerate(modes) if mode.analysed]
    rows.append((NOT_MONITORED, "", rest, _AT_MOST_ONE))
    names = (*_NUMBERS, "found", "warning")
    table = pd.DataFrame(
        [
            {"mode": kind, "failed": label, "fault": each.fault, "prior": prior}
            | {name: getattr(each, name) for name in names}
            for kind, label, prior, each in rows
        ]
    )
    prior = table["prior"]
    approach = samples * prior
    risks = {
        "risk_per_sample": prior * table["probability"],
        "risk_per_approach": approach * table["probability"],
        "risk_low": approach * table["low"],
        "risk_high": approach * table["high"],
    }
    table = table.assign(**risks)
    sums = {name: float(table[name].sum()) for name in risks}
    kinds = set(table["found"][table["prior"] > 0])
    # Given nothing, the probability is the risk of a sample itself.
    whole: dict[str, object] = {"mode": TOTAL, "failed": "", "fault": "", "prior": 1.0, "warning": ""}
    whole |= {"probability": sums["risk_per_sample"], "found": ESTIMATED if ESTIMATED in kinds else EXACT}
    whole |= {"low": sums["risk_low"] / samples, "high": sums["risk_high"] / samples}
    whole["standard_error"] = float((prior * table["standard_error"]).sum())
    table = pd.concat([table, pd.DataFrame([whole | sums])[table.columns]], ignore_index=True)
    table["of_target"] = table["risk_per_approach"] / target
    table = table[[*table.columns.drop("warning"), "warning"]]
    verdict = "met" if sums["risk_high"] <= target else "not met" if sums["risk_low"] > target else "not shown"
    table.attrs |= {"verdict": verdict, "target": target, "total": sums["risk_per_approach"]}
    return table
