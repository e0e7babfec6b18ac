"""What an experiment about ramps in time says: its summary, and its answer in three sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.document import Block, Heading, Paragraph, TextTable
from pl_mc.report.text import metres, rate_text

if TYPE_CHECKING:
    from pl_mc.studies.time_ramps.run import TimeRampsExperiment

# Delays of an alarm that count as late [s], see `pl_mc.time_to_alert`.
LIMITS_S = (6, 10, 30)

# Of passes, the share that may be late where a method counts as alerting in time.
_FEW_LATE = 0.01


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


def summary(table: pd.DataFrame, geometry: pd.DataFrame, experiment: TimeRampsExperiment) -> tuple[Block, ...]:
    """The findings, and for every correlation time how late alarms were.

    Args:
        table: see `pl_mc.time_to_alert`, of one or several correlation times.
        geometry: the faulted satellite through the pass.
        experiment: the record.
    """
    first, alert, p_fa = table.iloc[0], experiment.alert_limits(), experiment.p_fa
    low, high, passes = geometry.slope_m.min(), geometry.slope_m.max(), int(first.false_alarm_passes)
    blocks: list[Block] = [
        Paragraph(
            f"{_range(geometry.satellites)} satellites, {_range(geometry.redundant)} redundant. The error of "
            f"{experiment.satellite} grows from {experiment.onset_s:g} s on, for {first.monitored_s:g} s; its "
            f"vertical slope (error per unit of test statistic) is {metres(low)} to {metres(high)} m. "
            f"{alert.name}, VAL {alert.vertical_m:g} m. {int(first.passes):,} passes a rate, seed "
            f"{experiment.seed}; every method sees the same errors, of which a share of {first['share']:g} of the "
            "variance is correlated (tau), the rest white."
        ),
        Paragraph(
            f"Thresholds: at most {100 * p_fa:g} % of {passes:,} fault-free passes with an alarm, so that they "
            f"rest on {int(p_fa * first.false_alarm_passes)} of them; counted again on {passes:,} others. An alarm "
            "is late if the vertical error passed VAL more than 6 s (10 s, 30 s) before it. Rates with 95 % "
            "Clopper-Pearson bounds. Methods on one line have the same numbers throughout."
        ),
        Heading("Findings"),
        *findings(table, alert=alert),
    ]
    for tau, rows in table.groupby("tau_s", sort=False):
        rates, groups = _dangerous(rows), _by_rate(rows, same_methods(table))
        named = [f"{rate:g} m/s" for rate in rates]
        blocks += [
            Heading(_heading(float(tau))),
            Paragraph("False alarms, and alarms too late:"),
            TextTable.of(
                ["method", "false alarms a pass", *(f"{name}: late by 6 / 10 / 30 s" for name in named)],
                [[name, _false_alarms(own.iloc[0]), *(_lates(own.loc[r]) for r in rates)] for name, own in groups],
            ),
            Paragraph(
                "Median and 95 % point of the time from the first error beyond VAL to the alarm [s] (negative: the "
                "alarm came first; >: later than the end of the pass), then the median error at the alarm [m]:"
            ),
            TextTable.of(
                ["method", *named], [[name, *(_times(own.loc[rate]) for rate in rates)] for name, own in groups]
            ),
        ]
    return tuple(blocks)


def findings(table: pd.DataFrame, *, alert: AlertLimits) -> list[Block]:
    """What was measured, for each correlation time: who alerts in time at which rates, and the error at the alarm.

    Args:
        table: of methods at one false-alarm rate.
        alert: alert limits.
    """
    blocks: list[Block] = []
    groups = same_methods(table)
    header = ["method", *(f"in time, {limit} s" for limit in LIMITS_S), "most late by 6 s", "error at the alarm"]
    for tau, rows in table.groupby("tau_s", sort=False):
        rates, head = _dangerous(rows), _heading(float(tau))
        if not rates:
            blocks.append(Paragraph(f"{head}: no ramp took the vertical error beyond {alert.vertical_m:g} m."))
            continue
        shown = ", ".join(f"{rate:g}" for rate in rates)
        blocks += [
            Paragraph(
                f"{head}, rates of {shown} m/s. In time: late in less than {100 * _FEW_LATE:g} % of passes (95 % "
                f"upper bound, {int(rows.passes.min()):,} passes a rate); the largest share of late passes, with "
                "its rate; the smallest and the largest of the median vertical errors at the alarm."
            ),
            TextTable.of(header, [_finding(name, own.loc[rates]) for name, own in _by_rate(rows, groups)]),
        ]
    return blocks


def answer(tables: Mapping[str, pd.DataFrame], experiment: TimeRampsExperiment) -> tuple[str, ...]:
    """How slow ramps, fast ramps and false alarms went, at the largest correlation time."""
    table = comparable(tables["time_to_alert"])
    tau = float(table.tau_s.max())
    rows = table[(table.tau_s == tau) & (table.hazards > 0)]
    first, limit = table.iloc[0], experiment.alert_limits().vertical_m
    passes = f"{int(first.false_alarm_passes):,}"
    sentences = [
        f"Every method got a threshold with {100 * experiment.p_fa:g} % false alarms a pass of "
        f"{first.monitored_s / 60:g} min, set on {passes} fault-free passes; counted on {passes} others there were "
        f"between {100 * table.false_alarm_rate.min():.2f} % and {100 * table.false_alarm_rate.max():.2f} %."
    ]
    if rows.empty:
        return (*sentences, "No ramp took the vertical error beyond the alert limit.")
    groups = {group[0]: " = ".join(group) for group in same_methods(table)}
    for rate, kind in ((rows.rate_m_per_s.min(), "slowest"), (rows.rate_m_per_s.max(), "fastest")):
        chosen = rows[(rows.rate_m_per_s == rate) & rows.method.isin(list(groups))].set_index("method")
        late = chosen.late_6_rate
        best = [text for name, text in groups.items() if name in late.index[late == late.min()]]
        sentences.append(
            f"In the {kind} ramp that became dangerous, {rate:g} m/s with tau {tau:g} s, the alarm came more "
            f"than 6 s after the alert limit of {limit:g} m was passed in {_late_text(chosen.loc[late.idxmin()])} "
            f"of passes with {'; '.join(best)}, the best, and in {_late_text(chosen.loc[late.idxmax()])} with "
            f"{groups[late.idxmax()]}, the worst."
        )
    return tuple(sentences)


def _by_rate(rows: pd.DataFrame, groups: list[tuple[str, ...]]) -> list[tuple[str, pd.DataFrame]]:
    """Groups of `same_methods` with their rows by the rate of the ramp."""
    return [(", ".join(group), rows[rows.method == group[0]].set_index("rate_m_per_s")) for group in groups]


def _dangerous(rows: pd.DataFrame) -> list[float]:
    """Rates under which some pass had an error beyond VAL."""
    return [float(rate) for rate, own in rows.groupby("rate_m_per_s", sort=False) if own.hazards.max() > 0]


def _finding(name: str, own: pd.DataFrame) -> list[str]:
    """One line of the findings: a method at one correlation time, its rows by rate."""
    rates = [float(rate) for rate in own.index]
    in_time = [_rates(list(own.index[own[f"late_{limit}_high"] < _FEW_LATE]), rates) for limit in LIMITS_S]
    rate = own.late_6_rate.idxmax()
    row = own.loc[rate]
    at = f", {rate:g} m/s" if row.late_6 > 0 else ""
    late = f"{_late_text(row)} ({int(row.late_6):,} of {int(row.passes - row.undecided_6):,}){at}"
    known = own.error_at_alert_50_m[np.isfinite(own.error_at_alert_50_m)]
    ends = [] if known.empty else [known.idxmin(), known.idxmax()]
    errors = [f"{_error_text(own.loc[end])} at {end:g} m/s" for end in dict.fromkeys(ends)]
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
    bounds = (float(row[f"error_at_alert_50_{end}_m"]) for end in ("low", "high"))
    low, high = (metres(bound) if np.isfinite(bound) else ">" for bound in bounds)
    return f"{metres(float(row.error_at_alert_50_m))} m [{low}, {high}]"


def _false_alarms(row: Any) -> str:
    counts = int(row.false_alarms), int(row.false_alarm_passes)
    return rate_text(*counts, row.false_alarm_low, row.false_alarm_high)


def _late_text(row: Any) -> str:
    """The rate of alarms later than 6 s."""
    return rate_text(int(row.late_6), int(row.passes - row.undecided_6), row.late_6_low, row.late_6_high)


def _lates(row: Any) -> str:
    """The rates of alarms later than 6, 10 and 30 s, the first with its bounds."""
    if row.late_6 == 0:
        return _late_text(row)
    later = ["0" if row[f"late_{k}"] == 0 else f"{100 * row[f'late_{k}_rate']:.3g}" for k in LIMITS_S[1:]]
    left = "" if row.undecided_30 == 0 else f", {int(row.undecided_30)} cut off by the end"
    return f"{' / '.join([_late_text(row), *later])} %{left}"


def _times(row: Any) -> str:
    """Median and 95 % point of the delay, and the error at the alarm."""
    middle, most = (_seconds(row[f"alert_after_hazard_{q}_s"]) for q in (50, 95))
    return f"{middle}, {most}; {metres(float(row.error_at_alert_50_m))}"


def _seconds(value: float) -> str:
    if math.isnan(value):
        return "-"
    return ">" if math.isinf(value) else f"{value:g}"


def _range(numbers: pd.Series) -> str:
    low, high = int(numbers.min()), int(numbers.max())
    return f"{low}" if low == high else f"{low} to {high}"


def _heading(tau: float) -> str:
    return "White errors" if tau == 0 else f"Correlation time {tau:g} s"
