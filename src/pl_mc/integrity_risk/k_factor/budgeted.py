"""The multiplier with which all fault modes together keep a risk budget."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import Contributions, LevelRisk, z_of
from pl_mc.integrity_risk.given_residuals.level_risk import columns, epochs_to_judge, level_columns
from pl_mc.integrity_risk.k_factor.calibrated import NO_LIMIT
from pl_mc.integrity_risk.k_factor.error_to_level_ratio import MISLEADING, RatioState
from pl_mc.integrity_risk.k_factor.from_curve import starting_points
from pl_mc.integrity_risk.rare.importance import importance_sampling
from pl_mc.methods import Method
from pl_mc.methods.capabilities import k_of, require_k, with_k
from pl_mc.statistics.intervals import clopper_pearson

# Draws of the count under the worst fault, share of evaluations that finds points in the event, and how improbable a
# difference between two sound estimates has to be for neither to be believed.
_COUNTED = 200_000
_START_SHARE = 0.3
_DISAGREEMENT_Z = 3.3
_NO_LIMITS = AlertLimits("none", vertical_m=NO_LIMIT.val_m, horizontal_m=NO_LIMIT.val_m)


def calibrate_budget(
    g: Geometry, method: Method, budget: RiskBudget, axis: str, limit_m: float, *, confidence: float, draws: int,
    seed: int, target_cov: float, most_evaluations: int,
) -> pd.DataFrame:  # fmt: skip
    """One row per epoch with redundancy; the columns are explained at `pl_mc.calibrate`."""
    require_k(method, axis)
    rows = []
    series = g.as_series()
    for place in epochs_to_judge(g, method):
        one = series[place]
        risk = LevelRisk(one, with_k(method, 1.0, axis), budget, axis, draws=draws, seed=seed)
        found, low, high = risk.multiplier(z_of(confidence))
        before = k_of(method, axis)
        head = {"epoch": int(one.epoch), "method": method.name, "axis": axis, "target": budget.on(axis)}
        warning = ""
        if found is None:
            found, k = risk.at(before), math.inf
            warning = "a fault without bounds exceeds every multiple of the level (contributions at the record's own)"
            if not risk.free.silent.any():
                warning = "there is never a solution"
            checks = dict.fromkeys(_CHECKS, math.nan)
        else:
            k = found.k
            checks, warning = _checks(one, method, risk, found, axis, seed, target_cov, most_evaluations)
            if not risk.settled:
                warning = "; ".join(filter(None, [warning, "the worst sizes and the multiplier did not settle"]))
        trusted = warning == "" or not math.isfinite(k)
        after = level_columns(risk, k, limit_m) if math.isfinite(k) else {"alarm_rate": 1.0, "level_m": math.inf}
        rows.append(
            head
            | {f"k_{axis}": k if trusted else math.nan, "k_low": low if trusted else 0.0}
            | {"k_high": high if trusted else math.inf, "inflation": high / before if trusted else math.inf}
            | columns(one, risk, found, confidence)
            | {
                "alarm_rate_before": risk.alarm_rate(before, limit_m),
                "alarm_rate_after": after["alarm_rate"],
                "level_m": after["level_m"],
                "unconverged_rate": float(risk.free.unsettled.mean()),
            }
            | checks
            | {"warning": warning}
        )
    return pd.DataFrame(rows).drop(columns="kept")


_CHECKS = tuple(
    f"check_{what}{bound}" for what in ("fault_free", "worst") for bound in ("_probability", "_low", "_high")
)


def _checks(
    g: Geometry, method: Method, risk: LevelRisk, found: Contributions, axis: str, seed: int, target_cov: float,
    most_evaluations: int,
) -> tuple[dict[str, float], str]:  # fmt: skip
    """Two estimates that share nothing with the draws: importance sampling without a fault, a count under the worst."""
    notes = []
    n = len(g.names)
    unit = with_k(method, 1.0, axis)
    rng = np.random.default_rng((seed, int(g.epoch), 7))
    series = g.as_series()
    values: list[float] = []
    state = RatioState.of(series, 0, found.nominal_m[:n], unit, MISLEADING, _NO_LIMITS, axis=axis)
    known, spent = starting_points(state.at(found.k), rng, int(_START_SHARE * most_evaluations))
    run = importance_sampling(
        state.at(found.k), rng, target_cov=target_cov, most_evaluations=most_evaluations - spent, known=known
    )
    own = found.fault_free / risk.shares.fault_free
    if np.isnan(run.probability):
        values += [math.nan, 0.0, 1.0]
        notes.append("importance sampling never met the event without a fault")
    else:
        spread = run.standard_error / run.probability
        reach = math.exp(min(1.96 * spread, 300.0))
        values += [run.probability, run.probability / reach, min(run.probability * reach, 1.0)]
        both = math.hypot(spread, found.fault_free_error / max(found.fault_free, 1e-300))
        if own <= 0 or abs(math.log(run.probability / own)) > _DISAGREEMENT_Z * both:
            notes.append(f"without a fault importance sampling finds {run.probability:.3g}, the draws {own:.3g}")
    if found.worst < 0:
        return dict(zip(_CHECKS, [*values, math.nan, math.nan, math.nan], strict=True)), "; ".join(notes)
    state = RatioState.of(series, 0, found.worst_fault_m[:n], unit, MISLEADING, _NO_LIMITS, axis=axis)
    events = sum(
        int((state.ratio(rng.standard_normal((min(20_000, _COUNTED - k), state.dimension))) > found.k).sum())
        for k in range(0, _COUNTED, 20_000)
    )
    low, high = (float(bound) for bound in clopper_pearson(events, _COUNTED, 0.95))
    values += [events / _COUNTED, low, high]
    expected = found.worst_probability * _COUNTED
    error = math.hypot(math.sqrt(max(expected, 1.0)), found.worst_error * _COUNTED)
    if abs(events - expected) > _DISAGREEMENT_Z * error + 1.0:
        notes.append(f"under the worst fault a count finds {events} in {_COUNTED}, the draws {expected:.1f}")
    return dict(zip(_CHECKS, values, strict=True)), "; ".join(notes)


def require_only_budget(given: dict[str, Any], usual: dict[str, Any]) -> None:
    """Raise `InputError` for an argument that a budget leaves without effect."""
    for name, value in given.items():
        if value is not None and value != usual.get(name):
            raise InputError(f"{name}: a budget says the target, the faults and the event; leave one of the two out.")
