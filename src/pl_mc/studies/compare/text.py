"""The summary of a comparison of many methods: the findings, and the tables that they come from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.geometry import Geometry
from pl_mc.report.text import event_text, markdown_table, metres, percent, rate_text
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.compare.figures import EqualTables, same_curves

_SHOWN_BIASES = 7


def compare_summary(
    rates: pd.DataFrame,
    overview: pd.DataFrame,
    tests: EqualTables | None,
    g: Geometry,
    *,
    title: str,
    alert: AlertLimits,
    seed: int,
) -> str:
    """Findings in sentences, then the tables.

    Args:
        rates, overview: of the methods as they are by default, see `pl_mc.studies.compare.run`.
        tests: of the tests at one false-alarm rate, if any.
        g: the epoch.
        title, alert, seed: of the experiment.
    """
    quantities = ls_quantities(g)
    lines = [
        f"# {title}",
        "",
        f"{len(g.names)} satellites, {int(quantities.dof)} redundant, VDOP {metres(float(quantities.vdop_m))} m of "
        f"least squares; alert limits {alert.name}, VAL {alert.vertical_m:g} m, HAL {alert.horizontal_m:g} m. "
        f"{int(rates.draws.min()):,} draws for each fault, the same for all methods, seed {seed}. Rates with 95 % "
        "Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen.",
        "",
        "## Findings",
        "",
        *(f"- {sentence}" for sentence in findings(overview, tests, alert)),
        "",
        "## As they are by default",
        "",
        "Their false-alarm rates differ: alarm rates of one line must not be held against those of another. "
        "Missed, misleading and error > VAL: at the bias at which each is most frequent.",
        "",
        _overview(overview),
        "",
        "P(alarm) by bias:",
        "",
        _by_bias(rates, "alarm"),
        "",
        "P(misleading) by bias:",
        "",
        _by_bias(rates, "misleading"),
    ]
    if tests is not None:
        lines += [
            "",
            f"## Tests at a false-alarm rate of {tests.p_fa:g}",
            "",
            f"{int(tests.rates.draws.min()):,} draws for each fault. Only tests whose measured rate fits "
            f"{tests.p_fa:g} are compared (exact binomial test, 5 % for all together).",
            "",
            _equal(tests),
        ]
    lines += [
        "",
        "alarm: VPL > VAL, or the method's test rejects, or no solution. missed: |vertical error| > VAL and no "
        "alarm. misleading: |vertical error| > VPL and no alarm. PL <= AL: VPL <= VAL and HPL <= HAL without a "
        "fault.",
    ]
    return "\n".join(lines) + "\n"


def findings(overview: pd.DataFrame, tests: EqualTables | None, alert: AlertLimits) -> list[str]:
    """What the tables say, a sentence or two for each question."""
    val = f"{alert.vertical_m:g} m"
    told = [
        f"Alarms without a fault: {_by_rate(overview, 'fault_free_alarm')}.",
        _availability(overview),
        _levels(overview),
        "Misleading information without a fault (vertical error beyond VPL): "
        f"{_by_rate(overview, 'fault_free_misleading')}.",
        f"Missed detections (vertical error beyond {val} without an alarm), at the worst bias: "
        f"{_by_rate(overview, 'missed')}.",
        "Misleading information (vertical error beyond VPL without an alarm), at the worst bias: "
        f"{_by_rate(overview, 'misleading')}.",
        f"The position itself, alarm or not, is beyond {val} vertically, at the worst bias: "
        f"{_by_rate(overview, 'hazard')}.",
    ]
    return told + (_at_equal_rates(tests) if tests is not None else [])


def _by_rate(overview: pd.DataFrame, event: str) -> str:
    """``all at 45 m with ls; 0.2 % [..] at 5 m with igg3; none (each < ..) with ...``, highest rate first."""
    rate = f"{event}_rate"
    never, seen = overview[overview[rate] == 0], overview[overview[rate] > 0].sort_values(rate, ascending=False)
    said: dict[str, list[str]] = {}
    for row in seen.itertuples():
        bias = getattr(row, f"{event}_bias_m", None)
        text = event_text(row, event) + (f" at {bias:g} m" if bias is not None else "")
        said.setdefault(text, []).append(str(row.method))
    parts = [f"{text} with {_listed(names)}" for text, names in said.items()]
    if len(never):
        bound = percent(float(never[f"{event}_high"].max()))
        parts.append(f"none (each < {bound} %) with {_listed(never.method)}")
    return "; ".join(parts)


def _availability(overview: pd.DataFrame) -> str:
    always = overview[overview.within == overview.draws]
    rest = overview[overview.within < overview.draws].sort_values("availability")
    parts = [f"{_availability_text(row)} with {row.method}" for row in rest.itertuples()]
    if len(always):
        bound = percent(always.availability_low.min())
        parts.append(f"all draws (> {bound} %) with {_listed(always.method) if len(rest) else 'every method'}")
    return f"Both protection levels are within their alert limits without a fault in {'; '.join(parts)}."


def _levels(overview: pd.DataFrame) -> str:
    ranked = overview.dropna(subset="vpl_50_m").sort_values("vpl_50_m")
    if ranked.empty:
        return "No method has a protection level."
    told = [f"{metres(row.vpl_50_m)} m with {row.method}" for row in ranked.itertuples()]
    return f"The median VPL without a fault, from the smallest: {', '.join(told)}."


def _at_equal_rates(tables: EqualTables) -> list[str]:
    told = []
    fits, other = tables.tests[tables.tests.fits], tables.tests[~tables.tests.fits]
    if len(other):
        parts = [f"{row.method} ({_measured(row)})" for row in other.itertuples()]
        told.append(
            f"Set for a false-alarm rate of {tables.p_fa:g}, these have another one and are left out of what "
            f"follows: {'; '.join(parts)}."
        )
    if fits.empty:
        return told
    chosen = tables.comparable
    curves = same_curves(chosen, "alarm")
    for joined in curves:
        names = joined.split(",\n")
        if len(names) > 1:
            told.append(
                f"At a false-alarm rate of {tables.p_fa:g}, {_listed(names)} alarm equally often under every "
                "fault, to the last draw."
            )
    faulted = chosen[chosen.fault != "none"]
    if len(curves) > 1:
        # Where the best is nearest to one half: that tells detectors apart.
        table = faulted.pivot(index="fault", columns="method", values="alarm_rate")
        fault = (table.max(axis=1) - 0.5).abs().idxmin()
        parts = []
        for joined, rows in sorted(
            curves.items(), key=lambda item: -item[1][item[1].fault == fault].alarm_rate.iloc[0]
        ):
            row = rows[rows.fault == fault].iloc[0]
            parts.append(f"{event_text(row, 'alarm')} with {_listed(joined.split(',' + chr(10)))}")
        told.append(f"At that rate, alarms at {fault}: {'; '.join(parts)}.")
    worst = faulted.loc[faulted.groupby("method", sort=False).misleading_rate.idxmax()]
    said: dict[str, list[str]] = {}
    for row in worst.sort_values("misleading_rate", ascending=False).itertuples():
        at = f" at {row.fault}" if row.misleading_rate > 0 else " at any"
        said.setdefault(event_text(row, "misleading") + at, []).append(str(row.method))
    parts = [f"{text} with {_listed(names)}" for text, names in said.items()]
    told.append(f"At that rate, misleading information at the worst of these biases: {'; '.join(parts)}.")
    return told


def _overview(overview: pd.DataFrame) -> str:
    header = [
        "method", "alarms, no fault", "PL <= AL, no fault", "VPL 50 / 95 % [m]", "missed", "misleading",
        "error > VAL",
    ]  # fmt: skip
    cells = []
    for row in overview.itertuples():
        worst = []
        for event in ("missed", "misleading", "hazard"):
            bias = getattr(row, f"{event}_bias_m")
            worst.append(event_text(row, event) + (f" at {bias:g} m" if bias == bias else ""))
        levels = f"{metres(row.vpl_50_m)} / {metres(row.vpl_95_m)}"
        cells.append([row.method, event_text(row, "fault_free_alarm"), _availability_text(row), levels, *worst])
    return markdown_table(header, cells)


def _by_bias(rates: pd.DataFrame, event: str) -> str:
    faults = _some(list(dict.fromkeys(rates.fault[rates.fault != "none"])))
    cells = []
    for name, group in rates.groupby("method", sort=False):
        rows = {row.fault: row for row in group.itertuples()}
        cells.append([name, *(event_text(rows[fault], event) for fault in faults)])
    return markdown_table(["method", *faults], cells)


def _equal(tables: EqualTables) -> str:
    faults = _some(list(dict.fromkeys(tables.rates.fault[tables.rates.fault != "none"])))
    cells = []
    for one in tables.tests.itertuples():
        group = tables.rates[tables.rates.method == one.method]
        rows = {row.fault: row for row in group.itertuples()}
        if one.fits:
            worst = group[group.fault != "none"]
            row = worst.loc[worst.misleading_rate.idxmax()]
            text = event_text(row, "misleading") + (f" at {row.fault}" if row.misleading_rate > 0 else "")
            cells.append([one.method, _measured(one), *(event_text(rows[f], "alarm") for f in faults), text])
        else:
            cells.append([one.method, f"{_measured(one)}: another rate", *("-" for _ in faults), "-"])
    header = ["method", "alarms, no fault", *(f"alarms, {fault}" for fault in faults), "misleading, worst bias"]
    return markdown_table(header, cells)


def _measured(row: Any) -> str:
    return rate_text(int(row.alarms), int(row.draws), row.alarm_low, row.alarm_high)


def _availability_text(row: Any) -> str:
    return rate_text(int(row.within), int(row.draws), row.availability_low, row.availability_high)


def _some(faults: Sequence[str]) -> list[str]:
    """Faults of a ramp, more of them at its beginning, where rates change; the first and the last included."""
    if len(faults) <= _SHOWN_BIASES:
        return list(faults)
    place = (len(faults) - 1) * (np.arange(_SHOWN_BIASES) / (_SHOWN_BIASES - 1)) ** 1.5
    return [faults[round(k)] for k in place]


def _listed(names: Iterable[str]) -> str:
    made = list(names)
    return made[0] if len(made) == 1 else f"{', '.join(made[:-1])} and {made[-1]}"
