"""The risk of a protection level as it stands, shared among fault modes; for methods of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import EITHER, HORIZONTAL, LPV_200, VERTICAL, AlertLimits, as_axis
from pl_mc.arrays import ordinary_arithmetic
from pl_mc.engine.checks import LARGEST_DRAWS, LARGEST_SEED, require_geometry_and_alert, solved_epochs
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError, require_fraction, require_whole
from pl_mc.integrity_risk.given_residuals.budget import RiskBudget, as_budget
from pl_mc.integrity_risk.given_residuals.contributions import DRAWS, Contributions, LevelRisk, z_of
from pl_mc.methods import Method, as_methods

LEAST_DRAWS = 1024


@ordinary_arithmetic
def level_risk(
    g: Geometry,
    *,
    method: str | Method = "igg3",
    budget: RiskBudget | dict[str, Any] | None = None,
    alert: str | AlertLimits = LPV_200,
    axis: str | None = None,
    confidence: float = 0.95,
    draws: int = DRAWS,
    seed: int = 0,
) -> pd.DataFrame:
    """What an error exceeds a protection level with, without a fault and under the worst fault of each satellite.

    The noise is Gaussian with the sigma of the geometry; nominal biases, if the budget has any, stand at their bound.
    The probability given the residuals is exact, residuals are drawn.

    Args:
        g: the geometry, one epoch or a series; an epoch without redundancy has no row.
        method: name or record of a method with a level on the axis.
        budget: target, priors and nominal biases, or a mapping of them; `pl_mc.RiskBudget` with its defaults.
        alert: whose limit of the axis decides on alarms.
        axis: ``vertical`` or ``horizontal``; the vertical one where the alert has a limit for it.
        confidence: of ``risk_low`` and ``risk_high``, each for itself.
        draws: residuals under the worst fault of each satellite; four times as many without a fault.
        seed: of the draws.

    Returns:
        One row per epoch: ``epoch, method, axis, contribution_fault_free, contribution_single`` (priors times the
        probability of the event of `pl_mc.RiskBudget`, per sample), ``contribution_pairs, contribution_lost`` (priors
        of pairs of satellites and of all that is not analysed besides), ``risk`` (of the analysed modes), ``risk_low,
        risk_high, allowed`` (what the budget leaves them), ``kept`` (whether risk_high is within it; not where there
        is never a solution), ``worst_fault`` (of the largest contribution, the size in metres; infinite at the end of
        the search), ``worst_probability`` (of the event under it), ``alarm_rate`` (without a fault; counted with the
        weights of the draws), ``level_m`` (mean without a fault) and ``unconverged_rate`` (largest share of draws whose
        estimate has not settled).

    Raises:
        InputError: options outside their range, a geometry without redundancy.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> table = pl_mc.level_risk(g, method=pl_mc.ls(level_scale="floored"), draws=1024)
        >>> table[["axis", "worst_fault", "kept"]]
               axis  worst_fault   kept
        0  vertical  G22:+6.183m  False
    """
    alert, level, chosen, budget, seed, draws = checked(g, method, budget, alert, axis, confidence, draws, seed)
    rows = []
    series = g.as_series()
    for k in epochs_to_judge(g, chosen):
        risk = LevelRisk(series[k], chosen, budget, level, draws=draws, seed=seed)
        rows.append(
            {"epoch": int(series.epoch[k]), "method": chosen.name, "axis": level}
            | columns(series[k], risk, risk.at(1.0), confidence)
            | level_columns(risk, 1.0, alert.limit_m[level])
        )
    return pd.DataFrame(rows)


def checked(
    g: Geometry, method: Any, budget: Any, alert: Any, axis: str | None, confidence: float, draws: int, seed: int
) -> tuple[AlertLimits, str, Method, RiskBudget, int, int]:
    """The arguments of `level_risk`, checked: alert, axis, method, budget, seed and draws."""
    alert = require_geometry_and_alert(g, alert, any_axis=True)
    judged = as_axis(axis, alert)
    if judged == EITHER:
        raise InputError(f"axis: a budget belongs to one level; choose {VERTICAL} or {HORIZONTAL}.")
    require_fraction(confidence, field="confidence")
    draws = require_whole(draws, field="draws", low=LEAST_DRAWS, high=LARGEST_DRAWS)
    seed = require_whole(seed, field="seed", low=0, high=LARGEST_SEED)
    (chosen,) = as_methods([method], g)
    return alert, judged, chosen, as_budget(RiskBudget() if budget is None else budget), seed, draws


def epochs_to_judge(g: Geometry, method: Method) -> list[int]:
    """Places of the epochs with redundancy; an `InputError` where there is none."""
    found = np.flatnonzero(solved_epochs(g, method) & np.atleast_1d(g.satellite_count > g.unknown_count))
    if not found.size:
        raise InputError(f"geometry: no epoch has more satellites than unknowns, which {method.name} needs.")
    return [int(k) for k in found]


def columns(g: Geometry, risk: LevelRisk, found: Contributions, confidence: float) -> dict[str, Any]:
    """What `level_risk` says of the contributions at one multiplier."""
    reach = z_of(confidence) * found.error
    worst = f"{g.names[found.worst]}:{found.worst_bias_m:+.4g}m" if found.worst >= 0 else ""
    return {
        "contribution_fault_free": found.fault_free,
        "contribution_single": found.single,
        "contribution_pairs": found.pairs,
        "contribution_lost": found.other,
        "risk": found.analysed,
        "risk_low": max(found.analysed - reach, 0.0),
        "risk_high": found.analysed + reach,
        "allowed": risk.allowed,
        "kept": bool(found.analysed + reach <= risk.allowed and risk.free.silent.any()),
        "worst_fault": worst,
        "worst_probability": found.worst_probability,
    }


def level_columns(risk: LevelRisk, k: float, limit_m: float) -> dict[str, float]:
    """Alarms and mean level without a fault at a multiplier, and how many draws have not settled."""
    free = risk.free
    weight = free.weight / free.weight.sum()
    level = k * free.level_m[0]
    known = free.silent[0] & np.isfinite(level)
    return {
        "alarm_rate": risk.alarm_rate(k, limit_m),
        "level_m": float(weight[known] @ level[known] / weight[known].sum()) if known.any() else np.inf,
        "unconverged_rate": float(free.unsettled.mean()),
    }
