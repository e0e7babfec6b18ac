"""The summary of an experiment about noise models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.geometry import Geometry
from pl_mc.report.figures import method_label
from pl_mc.report.text import markdown_table, metres, percent, rate_text
from pl_mc.statistics.least_squares import ls_quantities


@dataclass
class NoiseTables:
    """The tables of an experiment about noise models.

    Attributes:
        rates: of the sweeps, with a column ``noise``.
        factors: rates beside those under Gaussian noise.
        risks: `pl_mc.risk` where little was counted, with a column ``noise``.
        exposures: `pl_mc.exposure`.
    """

    rates: pd.DataFrame
    factors: pd.DataFrame
    risks: pd.DataFrame
    exposures: pd.DataFrame


def noise_summary(
    tables: NoiseTables,
    g: Geometry,
    *,
    satellite: str,
    alert: AlertLimits,
    title: str,
    seed: int,
    rare: Mapping[str, Any],
    event: str,
    assumed: int,
) -> str:
    """One screen in Markdown for every part.

    Args:
        tables: the tables.
        g: the epoch; satellite: the faulted one.
        alert, title, seed: of the experiment.
        rare: what was left to the rare-event estimator.
        event, assumed: of the exposures, and the samples that a budget assumes.
    """
    quantities = ls_quantities(g)
    gain = float(quantities.gain[g.names.index(satellite)])
    factors = tables.factors
    lines = [
        f"# {title}",
        "",
        f"{len(g.names)} satellites, {int(quantities.dof)} redundant, VDOP {metres(float(quantities.vdop_m))} m of "
        f"least squares; alert limit {alert.name}, VAL {metres(alert.vertical_m)} m. "
        f"{int(factors.draws.iloc[0]):,} "
        f"draws for each fault and noise model, seed {seed}, all models made from the same numbers. Whatever the "
        f"noise, methods believe in Gaussian errors with the satellites' sigma. A metre on {satellite} moves least "
        f"squares {'up' if gain > 0 else 'down'} by {abs(gain):.2f} m.",
        "",
        "Rates with 95 % Clopper-Pearson bounds; in brackets the factor against Gaussian noise with the "
        "quotients of "
        "opposite bounds (least squares under Gaussian noise: the exact rate). `0 (< x %)` is the upper bound "
        "where "
        "nothing was seen.",
    ]
    for name, heading in (("alarm", "Alarms"), ("misleading", "Misleading: |vertical error| > VPL and no alarm")):
        lines += ["", f"## {heading}", "", _rates(factors[factors.event == name])]
    lines += [
        "",
        f"## P({rare['event']}) where the sweep counted fewer than {rare['fewest_events']}",
        "",
        "By `pl_mc.risk`: importance sampling checked by subset simulation, or plain counts; no number where "
        "they do "
        "not bear each other out.",
        "",
        _risks(tables.risks),
        "",
        f"## {event} at least once in an exposure, Gauss-Markov errors",
        "",
        _exposures(tables.exposures[tables.exposures.event == event], assumed),
    ]
    return "\n".join(lines) + "\n"


def _rates(rows: pd.DataFrame) -> str:
    faults, methods = list(dict.fromkeys(rows.fault)), list(dict.fromkeys(rows.method))
    cells = []
    for noise, group in rows.groupby("noise", sort=False):
        for method in methods:
            chosen = group[group.method == method].set_index("fault")
            cells.append([noise, method, *(_rate(chosen.loc[fault]) for fault in faults)])
    return markdown_table(["noise", "method", *("no fault" if f == "none" else f for f in faults)], cells)


def _rate(row: pd.Series) -> str:
    text = rate_text(int(row["count"]), int(row["draws"]), row["low"], row["high"])
    if row["noise"] == "gaussian":
        return text
    if np.isfinite(row["factor"]):
        if abs(row["factor"] - 1.0) < 5e-4 and row["rate"] > 0.99:
            return text
        return f"{text} (x{_short(row['factor'])} [{_short(row['factor_low'])}, {_short(row['factor_high'])}])"
    if np.isfinite(row["factor_low"]):
        return f"{text} (> x{_short(row['factor_low'])})"
    return text


def _short(value: float) -> str:
    if not np.isfinite(value):
        return "?"
    return f"{value:.3g}" if value < 1e4 else f"{value:.1e}"


def _risks(risks: pd.DataFrame) -> str:
    if risks.empty:
        return "None."
    cells = []
    for row in risks.itertuples():
        known = np.isfinite(row.probability)
        number = (
            f"{row.probability:.2e} [{row.low:.2e}, {row.high:.2e}]"
            if known
            else f"[{row.low:.1e}, {row.high:.1e}]"
        )
        cells.append([row.noise, row.method, row.fault, number, row.estimator, row.warning or "-"])
    return markdown_table(["noise", "method", "fault", "probability [95 %]", "by", "warning"], cells)


def _exposures(rows: pd.DataFrame, assumed: int) -> str:
    methods, faults = list(dict.fromkeys(rows.method)), list(dict.fromkeys(rows.fault))
    first = rows.iloc[0]
    cells = []
    for tau in dict.fromkeys(rows.tau_s):
        line = [f"{tau:g}"]
        for fault in faults:
            for method in methods:
                row = rows[(rows.tau_s == tau) & (rows.fault == fault) & (rows.method == method)].iloc[0]
                share = rate_text(int(row.exposures_with), int(row.exposures), row.any_low, row.any_high)
                if np.isfinite(row.effective_low):
                    bounds = f"[{row.effective_low:.3g}, {row.effective_high:.3g}]"
                    share += f"; m = {row.effective_samples:.3g} {bounds}"
                line.append(share)
        cells.append(line)
    header = [f"{'no fault' if fault == 'none' else fault}, {method}" for fault in faults for method in methods]
    budget = []
    for fault in faults:
        for method in methods:
            own = rows[(rows.fault == fault) & (rows.method == method)]
            rate = own.samples_with.sum() / (own.exposures * own.samples).sum()
            budget.append(f"{percent(-float(np.expm1(assumed * np.log1p(-rate))))} %")
    cells.append([f"{assumed} independent", *budget])
    text = (
        f"{int(first.samples)} samples an exposure, {int(first.exposures):,} exposures a cell; m is the number of "
        "independent samples that would have the same share (95 %; from ten exposures with the event "
        "on). "
        f"Last line: what the rate per sample, pooled over all lines, gives with {assumed} independent samples."
    )
    told = "; ".join(f"{name}: {method_label(name)}" for name in methods if method_label(name) != name)
    return f"{text} {told}.\n\n" + markdown_table(["tau [s]", *header], cells)
