"""The multiplier that a protection level should have, so that an event has the probability that is asked for.

With VPL = K u, u what the method makes of a scenario, every event here ends at one value of K, the scenario's ratio
(`pl_mc.integrity_risk.k_factor.error_to_level_ratio`). P(event) at K is the probability that the ratio is above K,
and the multiplier is a quantile of the ratio. For least squares it is computed; for other methods it is an order
statistic of drawn ratios, or, where no count reaches, it is read off a curve of P(event) against K that one run of
a rare-event estimator gives and another one checks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pandas as pd

from pl_mc.alert import EITHER, HORIZONTAL, LPV_200, VERTICAL, AlertLimits, as_axis
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_geometry_and_alert, require_inputs, solved_epochs
from pl_mc.faults import Faults, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.injection import at_epoch
from pl_mc.input_errors import (
    InputError,
    require_choice,
    require_fraction,
    require_truth,
    require_whole,
    require_within,
)
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import DRAWS
from pl_mc.integrity_risk.given_residuals.level_risk import checked
from pl_mc.integrity_risk.k_factor.budgeted import calibrate_budget, require_only_budget
from pl_mc.integrity_risk.k_factor.calibrated import (
    ALWAYS_ALARMS,
    KFactor,
    LevelAxis,
    alarm_columns,
    alarm_rate,
    bounds_of,
    counted,
    drawn_ratios,
    exact_k_factor,
    fewest_draws,
    first_guess,
    order_bounds,
    searched,
)
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import EVENTS, ratio_state
from pl_mc.integrity_risk.k_factor.from_curve import ExceedanceCurve, from_curve
from pl_mc.integrity_risk.worst.search import Estimator
from pl_mc.methods import Method, as_methods
from pl_mc.methods.capabilities import exact_law, k_of, require_k, with_k

# Ratios of an epoch and fault.
_DRAWS = 200_000


@ordinary_arithmetic
def calibrate(
    g: Geometry,
    *,
    method: str | Method = "ls",
    target: float | None = None,
    budget: RiskBudget | dict[str, Any] | None = None,
    faults: Faults | None = None,
    event: Literal["exceeded", "misleading"] = "exceeded",
    alert: str | AlertLimits = LPV_200,
    axis: Literal["vertical", "horizontal"] | None = None,
    confidence: float = 0.95,
    pooled: bool = False,
    draws: int | None = None,
    seed: int = 0,
    target_cov: float = 0.1,
    max_evaluations: int = 10_000_000,
    estimator: Callable[[Method], Estimator] | None = None,
) -> pd.DataFrame:
    """The multiplier of a protection level with which P(event) is ``target``, and its cost in alarms.

    A method with an exact law, such as least squares, gets an exact multiplier: fault-free, ``exceeded`` needs
    Student's quantile for n - t degrees of freedom, both signs together, and everything else the root of an exact
    probability. For other methods the multiplier comes from ``draws`` ratios where that many can tell, draws >=
    log(1 - confidence) / log(1 - target), about 3 / target for 95 %; else, one epoch at a time, from the curve of
    P(event) against K, which subset simulation on the ratio gives at one go, inverted together with its bounds.
    Importance sampling with random numbers of its own checks P(event) at the multiplier that is found: where the
    two disagree there is a warning and no number.

    Args:
        g: the geometry, one epoch or a series.
        method: name or record of a method whose level scales with K (`pl_mc.methods.capabilities.ScalesWithK`),
            with the multiplier that is compared.
        target: probability of the event per sample; 1e-7 unless given.
        budget: instead of a target, `pl_mc.RiskBudget` or a mapping of its fields: the multiplier with which the
            fault-free case and every single satellite under its worst fault, weighted by their priors, together keep
            it. It says the event too; ``target``, ``faults``, ``event``, ``pooled`` and ``estimator`` have no part.
        faults: the faults under which the target shall hold, each for itself; the fault-free case unless given.
        event: ``exceeded``, |vertical error| > VPL, alarm or not; ``misleading``, the same and no alarm.
        alert: alert limits; that of the axis decides on alarms.
        axis: whose level it is, ``vertical``, or ``horizontal`` for HPL, HAL and the length of the horizontal error;
            the vertical one unless given, the horizontal one where the alert has no other limit.
        confidence: with which ``k_high`` keeps the target, and ``k_low`` does not: each for itself.
        pooled: for a series: one multiplier for all epochs, with which the mean risk over them is the target,
            instead of one for each.
        draws, seed: of the ratios, 200,000 unless given, per epoch and fault; not used where the law is exact.
        target_cov, max_evaluations: of the rare-event estimators: relative standard error of P(event) that is aimed
            at, and scenarios that an epoch and fault may cost.
        estimator: a function of a method that gives the function of faults, coefficient of variation and seed
            described at `pl_mc.worst_case`; it takes the place of the rare-event estimators, and the multiplier is
            searched for, one estimate for each that is tried.

    Returns:
        One row per epoch (or one for all where ``pooled``) and fault: ``epoch`` (missing where pooled), ``method,
        fault, bias_m, event, target, found`` (``exact``, ``counting`` or ``rare events``), ``draws`` (scenarios
        computed), ``k_vertical`` or ``k_horizontal`` (best estimate; missing where two disagree), ``k_low, k_high``,
        ``inflation`` (k_high over the multiplier of the record), ``probability, probability_low,
        probability_high`` of the event at ``k_high`` (bounds at the confidence, two-sided where counted, each for
        itself where estimated, equal where exact), and ``alarm_rate_before, alarm_rate_after`` (with ``_low`` and
        ``_high``, two-sided) at the record's multiplier and at ``k_high``; an unavailable solution counts as an
        alarm. ``decides`` marks the fault that needs the largest ``k_high`` at its epoch. Zero means that any
        multiplier keeps the target. ``check_probability, check_low, check_high`` is what importance sampling finds
        at ``k_vertical``, with a 95 % interval, where it ran. ``warning`` is empty, or says what is in doubt.

        The curves, where there are any, are in ``table.attrs["curves"]``, each a dictionary of ``epoch, method,
        fault`` and lists ``k_vertical`` (or ``k_horizontal``), ``probability, low, high`` (either bound with the
        confidence).

        With a budget, one row per epoch with redundancy: ``epoch, method, axis, target``, ``k_vertical`` or
        ``k_horizontal`` (infinite where a fault without bounds exceeds every multiple of the level), ``k_low, k_high,
        inflation``, the columns of `pl_mc.level_risk` from ``contribution_fault_free`` to ``worst_probability`` at
        that multiplier, ``alarm_rate_before, alarm_rate_after`` and ``level_m`` without a fault, ``unconverged_rate``,
        and two checks by estimates that share nothing with the draws, with 95 % intervals:
        ``check_fault_free_probability, _low, _high`` by importance sampling and ``check_worst_probability, _low,
        _high`` by a count of 200,000 draws under ``worst_fault``. Where one of them disagrees there is a warning and
        no multiplier. ``draws`` are residuals then, 16,384 unless given.

    Raises:
        InputError: a budget beside what it says, a method without a multiplier, options outside their range, faults of
            another geometry, a pooled multiplier whose target is too rare to count.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.calibrate(g, method="ls", target=1e-7)
        >>> table[["method", "event", "found", "k_vertical"]].round(2)
          method     event  found  k_vertical
        0     ls  exceeded  exact       87.99
    """
    if budget is not None:
        given = {"target": target, "faults": faults, "event": event, "pooled": pooled, "estimator": estimator}
        require_only_budget(given, {"event": "exceeded", "pooled": False})
        alert, judged, chosen, shares, seed, draws = checked(
            g, method, budget, alert, axis, confidence, DRAWS if draws is None else draws, seed
        )
        return calibrate_budget(
            g, chosen, shares, judged, alert.limit_m[judged], confidence=confidence, draws=draws, seed=seed,
            target_cov=target_cov, most_evaluations=max_evaluations,
        )  # fmt: skip
    target, draws = 1e-7 if target is None else target, _DRAWS if draws is None else draws
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    faults = no_fault(g) if faults is None else faults
    alert = require_inputs(g, faults, alert, any_axis=True)
    judged = as_axis(axis, alert)
    if judged == EITHER:
        raise InputError(f"axis: a multiplier belongs to one level; choose {VERTICAL} or {HORIZONTAL}.")
    level: LevelAxis = "vertical" if judged == VERTICAL else "horizontal"
    limit_m = alert.limit_m[level]
    require_choice(event, EVENTS, field="event")
    require_truth(pooled, field="pooled")
    require_within(target, field="target", low=1e-15, high=0.999)
    require_fraction(confidence, field="confidence")
    draws = require_whole(draws, field="draws", low=1, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    (chosen,) = as_methods([method], g)
    require_k(chosen, level)
    k_before = k_of(chosen, level)
    series = g.as_series()

    def estimated(part: Geometry, fault: Faults) -> tuple[KFactor, dict[str, float], ExceedanceCurve | None]:
        unit_m, ratio = drawn_ratios(part, fault, chosen, event, alert, draws=draws, seed=seed, axis=level)
        high, low = order_bounds(ratio.size, target, confidence)
        curve = None
        if estimator is None and high >= 1:
            found = counted(ratio, target, confidence, high, low)
        elif not solved_epochs(part, chosen).any():
            found = ALWAYS_ALARMS
        elif len(part) > 1:
            needed = math.ceil(fewest_draws(target, confidence) / int(fault.applies(part).sum()))
            raise InputError(
                f"draws: a pooled multiplier is counted, which at {target:g} with confidence {confidence:g} needs "
                f"at least {needed} draws per epoch, not {draws} (or a larger target, or one multiplier per epoch)."
            )
        elif estimator is None:
            state = ratio_state(part, fault, chosen, event, alert, level)
            # The vertical is not named: it has had these random numbers all along.
            name = "/".join((chosen.name, event, fault.labels[0], *([] if level == VERTICAL else [level])))
            made = from_curve(
                state, target=target, confidence=confidence, key=(seed, int(part.epoch[0])), name=name,
                target_cov=target_cov, most_evaluations=max_evaluations,
            )  # fmt: skip
            found, curve = made.found, made.curve
        else:
            asked, one = estimator, part[0]
            local = Faults.from_array(one, at_epoch(part, fault, 0)[:, [part.names.index(name) for name in one.names]])

            def trial(k: float) -> tuple[float, float, float, str]:
                row = asked(with_k(chosen, k, level))(local, target_cov, seed).iloc[0]
                return *bounds_of(row, confidence), str(row["warning"])

            found = searched(trial, first_guess(ratio, target), target)
        alarm = [alarm_rate(unit_m, k, limit_m, confidence) for k in (k_before, found.high)]
        return found, alarm_columns(*alarm), curve

    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    for part in [series] if pooled else [series[k : k + 1] for k in range(len(series))]:
        for k in range(len(faults)):
            fault = faults.only(k)
            if not fault.applies(part).any():
                continue
            keys = {
                "epoch": np.nan if pooled else int(part.epoch[0]),
                "method": chosen.name,
                "fault": fault.labels[0],
                "bias_m": float(fault.scalar_bias_m[0]),
                "event": event,
                "target": float(target),
            }
            if exact_law(chosen) is not None and estimator is None:
                found, alarm = exact_k_factor(part, fault, chosen, event, alert, target, level)
            else:
                found, alarm, curve = estimated(part, fault)
                if curve is not None:
                    curves.append(_curve_columns(keys, curve, confidence, level))
            rows.append(keys | _columns(found, k_before, alarm, level))
    if not rows:
        raise InputError("faults: none of them has all of its satellites in view at any epoch of this geometry.")
    table = pd.DataFrame(rows)
    if not pooled:
        table["epoch"] = table["epoch"].astype(np.int64)
    largest = table.groupby("epoch", dropna=False)["k_high"].transform("max")
    table.insert(table.columns.get_loc("check_probability"), "decides", table["k_high"] == largest)
    table.attrs["curves"] = curves
    return table


def _columns(found: KFactor, k_before: float, alarm: dict[str, float], axis: str) -> dict[str, object]:
    names = ("probability", "probability_low", "probability_high")
    first = {"found": found.found, "draws": found.draws, f"k_{axis}": found.k, "k_low": found.low}
    first |= {"k_high": found.high, "inflation": found.high / k_before}
    return first | {name: getattr(found, name) for name in names} | alarm | found.check | {"warning": found.warning}


def _curve_columns(keys: dict[str, Any], curve: ExceedanceCurve, confidence: float, axis: str) -> dict[str, Any]:
    low, high = curve.bounds(confidence)
    columns = {f"k_{axis}": curve.k, "probability": curve.probability, "low": low, "high": high}
    return {name: keys[name] for name in ("epoch", "method", "fault")} | {
        name: values.tolist() for name, values in columns.items()
    }
