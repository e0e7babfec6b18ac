"""What an experiment about ramps in time says: its summary, and its answer in three sentences."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import markdown_table, metres, rate_text

# Of passes, the share that may be late where a method counts as alerting in time.
_FEW_LATE = 0.01

_FINDINGS = ("in time, 6 s", "in time, 10 s", "in time, 30 s", "most late by 6 s", "error at the alarm")


def comparable(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of methods that a threshold could bring to the common false-alarm rate."""
    never = set(table.method[~np.isfinite(table.threshold)])
    return table[~table.method.isin(never)]


def same_methods(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """Methods in order, those together whose counts and quantiles are the same in every row."""
    left = [column for column in table.columns if column not in ("method", "threshold")]
    groups: dict[tuple, list[str]] = {}
    for name, rows in table.groupby("method", sort=False):
        # Equal but for rounding.
        key = tuple(f"{value:.9g}" for row in rows[left].itertuples(index=False, name=None) for value in row)
        groups.setdefault(key, []).append(str(name))
    return [tuple(names) for names in groups.values()]


def time_ramps_summary(
    table: pd.DataFrame,
    geometry: pd.DataFrame,
    *,
    title: str,
    satellite: str,
    alert: AlertLimits,
    p_fa: float,
    onset_s: float,
    seed: int,
) -> str:
    """One screen in Markdown for every correlation time.

    Args:
        table: see `pl_mc.time_to_alert`, of one or several correlation times.
        geometry: the faulted satellite through the pass.
        title, satellite, alert, p_fa, onset_s, seed: of the experiment.
    """
    first = table.iloc[0]
    low, high = float(geometry.slope_m.min()), float(geometry.slope_m.max())
    lines = [
        f"# {title}",
        "",
        f"{_range(geometry.satellites)} satellites, {_range(geometry.redundant)} redundant. The error of "
        f"{satellite} grows from {onset_s:g} s on, for {first.monitored_s:g} s; its vertical slope (error per "
        f"unit of test statistic) is {metres(low)} to {metres(high)} m. {alert.name}, VAL {alert.vertical_m:g} m. "
        f"{int(first.passes):,} passes a rate, seed {seed}; every method sees the same errors, of which a share of "
        f"{first['share']:g} of the variance is correlated (tau), the rest white.",
        "",
        f"Thresholds: at most {100 * p_fa:g} % of {int(first.false_alarm_passes):,} fault-free passes with an "
        f"alarm, so that they rest on {int(p_fa * first.false_alarm_passes)} of them; counted again on "
        f"{int(first.false_alarm_passes):,} others. An alarm is late if the vertical error "
        "passed VAL more than 6 s (10 s, 30 s) before it. Rates with 95 % Clopper-Pearson bounds. Methods on one "
        "line have the same numbers throughout.",
    ]
    groups = same_methods(table)
    lines += ["", "## Findings", *time_ramps_findings(table, alert=alert)]
    for tau, rows in table.groupby("tau_s", sort=False):
        lines += ["", f"## {_heading(float(tau))}", "", "False alarms, and alarms too late:", ""]
        lines += [_late(rows, groups), "", _explained(), "", _times(rows, groups)]
    return "\n".join(lines) + "\n"


def time_ramps_findings(table: pd.DataFrame, *, alert: AlertLimits) -> list[str]:
    """What was measured, for each correlation time: who alerts in time at which rates, and the error at the alarm.

    Args:
        table: of methods at one false-alarm rate.
        alert: alert limits.

    Returns:
        Lines of Markdown, a table for each correlation time.
    """
    lines = []
    groups = same_methods(table)
    for tau, rows in table.groupby("tau_s", sort=False):
        rates, head = _dangerous(rows), _heading(float(tau))
        if not rates:
            lines += ["", f"{head}: no ramp took the vertical error beyond {alert.vertical_m:g} m."]
            continue
        cells = [
            _finding(", ".join(group), rows[rows.method == group[0]].set_index("rate_m_per_s").loc[rates])
            for group in groups
        ]
        shown = ", ".join(f"{rate:g}" for rate in rates)
        lines += [
            "",
            f"{head}, rates of {shown} m/s. In time: late in less than {100 * _FEW_LATE:g} % of passes (95 % upper "
            f"bound, {int(rows.passes.min()):,} passes a rate); the largest share of late passes, with its rate; "
            "the smallest and the largest of the median vertical errors at the alarm.",
            "",
            markdown_table(
                [
                    "method",
                    "in time, 6 s",
                    "in time, 10 s",
                    "in time, 30 s",
                    "most late by 6 s",
                    "error at the alarm",
                ],
                cells,
            ),
        ]
    return lines


def _finding(name: str, own: pd.DataFrame) -> list[str]:
    """One line of the findings: a method at one correlation time, its rows by rate."""
    rates = [float(rate) for rate in own.index]
    in_time = [_rates(list(own.index[own[f"late_{limit}_high"] < _FEW_LATE]), rates) for limit in (6, 10, 30)]
    rate = own.late_6_rate.idxmax()
    row = own.loc[rate]
    at = f", {rate:g} m/s" if row.late_6 > 0 else ""
    late = f"{_late_text(row, 6)} ({int(row.late_6):,} of {int(row.passes - row.undecided_6):,}){at}"
    known = own[np.isfinite(own.error_at_alert_50_m)]
    ends = [] if known.empty else [known.error_at_alert_50_m.idxmin(), known.error_at_alert_50_m.idxmax()]
    errors = [f"{_error_text(known.loc[end])} at {end:g} m/s" for end in dict.fromkeys(ends)]
    return [name, *in_time, late, " to ".join(errors) or "no alarm in half of the passes"]


def _rates(kept: list[float], rates: list[float]) -> str:
    """``every rate``, ``from 0.1 m/s on``, ``0.1, 0.5 m/s``, ``no rate``."""
    if not kept:
        return "no rate"
    if kept == rates:
        return "every rate"
    if kept == rates[-len(kept) :]:
        return f"from {kept[0]:g} m/s on" if len(kept) > 1 else f"{kept[0]:g} m/s"
    return f"{', '.join(f'{rate:g}' for rate in kept)} m/s"


def _error_text(row: Any) -> str:
    """The median error at the alarm with its bounds."""
    bounds = [
        metres(float(row[f"error_at_alert_50_{end}_m"])) if np.isfinite(row[f"error_at_alert_50_{end}_m"]) else ">"
        for end in ("low", "high")
    ]
    return f"{metres(float(row.error_at_alert_50_m))} m [{bounds[0]}, {bounds[1]}]"


def time_ramps_answer(run: RunFolder) -> tuple[str, ...]:
    """How slow ramps, fast ramps and false alarms went, at the largest correlation time."""
    table = comparable(run.tables["time_to_alert"])
    tau = float(table.tau_s.max())
    rows = table[(table.tau_s == tau) & (table.hazards > 0)]
    first = table.iloc[0]
    target, passes = float(run.experiment["p_fa"]), int(first.false_alarm_passes)
    sentences = [
        f"Every method got a threshold with {100 * target:g} % false alarms a pass of {first.monitored_s / 60:g} "
        f"min, set on {passes:,} fault-free passes; counted on {passes:,} others there were between "
        f"{100 * table.false_alarm_rate.min():.2f} % and {100 * table.false_alarm_rate.max():.2f} %."
    ]
    if rows.empty:
        return (*sentences, "No ramp took the vertical error beyond the alert limit.")
    groups = same_methods(table)
    for rate, kind in ((rows.rate_m_per_s.min(), "slowest"), (rows.rate_m_per_s.max(), "fastest")):
        chosen = rows[rows.rate_m_per_s == rate].set_index("method")
        chosen = chosen[chosen.index.isin([group[0] for group in groups])]
        late = chosen.late_6_rate
        best = [" = ".join(group) for group in groups if group[0] in late.index[late == late.min()]]
        worst = next(" = ".join(group) for group in groups if group[0] == late.idxmax())
        sentences.append(
            f"In the {kind} ramp that became dangerous, {rate:g} m/s with tau {tau:g} s, the alarm came more "
            f"than 6 s after the alert limit of {run.alert.vertical_m:g} m was passed in "
            f"{_late_text(chosen.loc[late.idxmin()], 6)} of passes with {'; '.join(best)}, the best, and in "
            f"{_late_text(chosen.loc[late.idxmax()], 6)} with {worst}, the worst."
        )
    return tuple(sentences)


def _range(numbers: pd.Series) -> str:
    low, high = int(numbers.min()), int(numbers.max())
    return f"{low}" if low == high else f"{low} to {high}"


def _heading(tau: float) -> str:
    return "White errors" if tau == 0 else f"Correlation time {tau:g} s"


def _explained() -> str:
    return (
        "Median and 95 % point of the time from the first error beyond VAL to the alarm [s] (negative: the alarm "
        "came first; >: later than the end of the pass), then the median error at the alarm [m]:"
    )


def _late(rows: pd.DataFrame, groups: list[tuple[str, ...]]) -> str:
    rates = _dangerous(rows)
    cells = []
    for group in groups:
        own = rows[rows.method == group[0]].set_index("rate_m_per_s")
        one = own.iloc[0]
        false = rate_text(
            int(one.false_alarms), int(one.false_alarm_passes), one.false_alarm_low, one.false_alarm_high
        )
        cells.append([", ".join(group), false, *(_lates(own.loc[rate]) for rate in rates)])
    header = ["method", "false alarms a pass", *(f"{rate:g} m/s: late by 6 / 10 / 30 s" for rate in rates)]
    return markdown_table(header, cells)


def _lates(row: Any) -> str:
    total = int(row.passes - row.undecided_6)
    shares = [
        "0" if row[f"late_{limit}"] == 0 else f"{100 * row[f'late_{limit}_rate']:.3g}" for limit in (6, 10, 30)
    ]
    bounds = rate_text(int(row.late_6), total, row.late_6_low, row.late_6_high)
    if row.late_6 == 0:
        return bounds
    left = "" if row.undecided_30 == 0 else f", {int(row.undecided_30)} cut off by the end"
    return f"{bounds} / {shares[1]} / {shares[2]} %{left}"


def _late_text(row: Any, limit: int) -> str:
    total = int(row.passes - row[f"undecided_{limit}"])
    return rate_text(int(row[f"late_{limit}"]), total, row[f"late_{limit}_low"], row[f"late_{limit}_high"])


def _times(rows: pd.DataFrame, groups: list[tuple[str, ...]]) -> str:
    rates = _dangerous(rows)
    cells = []
    for group in groups:
        own = rows[rows.method == group[0]].set_index("rate_m_per_s")
        line = [", ".join(group)]
        for rate in rates:
            row = own.loc[rate]
            middle, most = (_seconds(row[f"alert_after_hazard_{q}_s"]) for q in (50, 95))
            line.append(f"{middle}, {most}; {metres(float(row.error_at_alert_50_m))}")
        cells.append(line)
    return markdown_table(["method", *(f"{rate:g} m/s" for rate in rates)], cells)


def _dangerous(rows: pd.DataFrame) -> list[float]:
    """Rates under which some pass had an error beyond VAL."""
    return [float(rate) for rate, own in rows.groupby("rate_m_per_s", sort=False) if own.hazards.max() > 0]


def _seconds(value: float) -> str:
    if math.isnan(value):
        return "-"
    return ">" if math.isinf(value) else f"{value:g}"
