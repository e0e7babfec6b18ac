"""What an integrity-risk run says in three sentences: the worst fault, the budgets, the multiplier."""

from __future__ import annotations

import pandas as pd

from pl_mc.report.figures import method_label
from pl_mc.report.run_folder import RunFolder

_EVENTS = {"misleading": "misleading information", "missed": "missed detection", "alarm": "alarm"}


def risk_answer(run: RunFolder) -> tuple[str, ...]:
    """The likeliest fault of each method, the totals of the budgets against their target, the multipliers."""
    return (_worst(run.tables["worst"]), _budgets(run.tables["budgets"]), _multipliers(run.tables["calibration"]))


def _worst(table: pd.DataFrame) -> str:
    parts = []
    known = table[table.probability.notna()]
    for (event, method), group in known.groupby(["event", "method"], sort=False):
        row = group.loc[group.probability.idxmax()]
        parts.append(f"{method_label(str(method))}, {_EVENTS[str(event)]}: {_bounded(row)} at {row.fault}")
    return f"The worst fault of one satellite ({'; '.join(parts)})." if parts else "No worst fault was found."


def _budgets(table: pd.DataFrame) -> str:
    total = table[table["mode"] == "total"] if "mode" in table else table.iloc[:0]
    parts = [
        f"{method_label(str(row.method))}, {_EVENTS[str(row.event)]}, {_number(row.risk_per_approach)} "
        f"[{_number(row.risk_low)}, {_number(row.risk_high)}] against {row.target:g}, {row.verdict}"
        for row in total.itertuples()
    ]
    return f"Risk per approach over the fault modes: {'; '.join(parts)}." if parts else "No budget was asked for."


def _multipliers(table: pd.DataFrame) -> str:
    # Infinite bounds are those of a multiplier that two estimates disagree about.
    known = table[table.k_vertical.notna()]
    parts = []
    for method, group in known.groupby("method", sort=False):
        rarest = group[group.target == group.target.min()]
        row = rarest.loc[rarest.k_vertical.idxmax()]
        event, target, k = _EVENTS.get(str(row.event), str(row.event)), row.target, row.k_vertical
        bounds = "" if row.k_low == row.k_high else f" [{row.k_low:.4g}, {row.k_high:.4g}]"
        under = "without a fault" if row.fault == "none" else f"under {row.fault}"
        parts.append(f"{method_label(str(method))} needs K = {k:.4g}{bounds} to keep {event} at {target:g} {under}")
    return f"The multiplier of the protection level: {'; '.join(parts)}." if parts else "No multiplier was found."


def _bounded(row: pd.Series) -> str:
    if row.low == row.high:
        return f"{_number(row.probability)} (exact)"
    return f"{_number(row.probability)} [{_number(row.low)}, {_number(row.high)}]"


def _number(value: float) -> str:
    return f"{value:.3g}" if value > 1e-30 or value == 0 else "below 1e-30"
