"""What a comparison of many methods says: the findings, the tables that they come from, the answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.geometry import Geometry
from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import EVENT_MEANS, event_text, listed, metres, percent
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.compare.day_text import availability_text, blocks_over_the_day, worst_text
from pl_mc.studies.compare.tables import Comparison, EqualTables, same_curves, worst
from pl_mc.studies.spec import Experiment

_SHOWN_BIASES = 7


def summary(counted: Comparison, g: Geometry, experiment: Experiment) -> tuple[Block, ...]:
    """Findings in sentences, then the tables, of the experiment's own geometry ``g``; over several in front."""
    quantities, several, alert = ls_quantities(g), len(counted.names) > 1, experiment.alert_limits()
    rates, overview = counted.own_rates, counted.own(counted.overview)
    tests = counted.equal.get(counted.reference)
    blocks: list[Block] = [
        Paragraph(
            f"{len(g.names)} satellites, {int(quantities.dof)} redundant, VDOP {metres(float(quantities.vdop_m))} "
            f"m of least squares; alert limits {alert.name}, VAL {alert.vertical_m:g} m, HAL "
            f"{alert.horizontal_m:g} m. {int(rates.draws.min()):,} draws for each fault, the same for all "
            f"methods, seed {experiment.seed}. Rates with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper "
            "bound where nothing was seen."
        ),
        *(blocks_over_the_day(counted, alert) if several else ()),
        Heading(f"Findings at {counted.reference}" if several else "Findings"),
        Bullets(tuple(findings(overview, tests, alert))),
        Heading("As they are by default"),
        Paragraph(
            "Their false-alarm rates differ: alarm rates of one line must not be held against those of another. "
            "Missed, misleading and error > VAL: at the bias at which each is most frequent."
        ),
        _overview(overview),
        Paragraph("P(alarm) by bias:"),
        _by_bias(rates, "alarm"),
        Paragraph("P(misleading) by bias:"),
        _by_bias(rates, "misleading"),
    ]
    if tests is not None:
        blocks += [
            Heading(f"Tests at a false-alarm rate of {tests.p_fa:g}"),
            Paragraph(
                f"{int(tests.rates.draws.min()):,} draws for each fault. Only tests whose measured rate fits "
                f"{tests.p_fa:g} are compared (exact binomial test, 5 % for all together)."
            ),
            _equal(tests),
        ]
    meaning = (
        "alarm: VPL > VAL, or the method's test rejects, or no solution. missed: |vertical error| > VAL and no "
        "alarm. misleading: |vertical error| > VPL and no alarm. PL <= AL: VPL <= VAL and HPL <= HAL without a "
        "fault."
    )
    return (*blocks, Paragraph(meaning))


def answer(tables: Mapping[str, pd.DataFrame], experiment: Experiment) -> tuple[str, ...]:
    """Least squares and IGG-III, the worst of the others, and how many have no event at any bias."""
    sentences = []
    for event, means in EVENT_MEANS.items():
        most = worst(tables["rates"], event).set_index("method")
        rate = most[f"{event}_rate"]
        known = [name for name in ("ls", "igg3") if name in most.index]
        parts = [f"{method_label(name)} {event_text(most.loc[name], event)}" for name in known]
        others = rate[rate > 0].drop(known, errors="ignore")
        if len(others):
            name = str(others.idxmax())
            parts.append(f"the most of the others {method_label(name)}, {event_text(most.loc[name], event)}")
        parts.append(f"none with {int((rate == 0).sum())} of {len(most)} methods")
        what = means.format(val=experiment.alert_limits().vertical_m)
        sentences.append(f"{what}, at each one's worst bias: {'; '.join(parts)}.")
    return tuple(sentences)


def findings(overview: pd.DataFrame, tests: EqualTables | None, alert: AlertLimits) -> list[str]:
    """What the tables say, a sentence or two for each question."""
    val = f"{alert.vertical_m:g} m"
    rates = {
        "fault_free_misleading": "Misleading information without a fault (vertical error beyond VPL)",
        "missed": f"Missed detections (vertical error beyond {val} without an alarm), at the worst bias",
        "misleading": "Misleading information (vertical error beyond VPL without an alarm), at the worst bias",
        "hazard": f"The position itself, alarm or not, is beyond {val} vertically, at the worst bias",
    }
    return [
        f"Alarms without a fault: {_by_rate(overview, 'fault_free_alarm')}.",
        _availability(overview),
        _levels(overview),
        *(f"{what}: {_by_rate(overview, event)}." for event, what in rates.items()),
        *(_at_equal_rates(tests) if tests is not None else ()),
    ]


def _by_rate(overview: pd.DataFrame, event: str) -> str:
    """``all at 45 m with ls; 0.2 % [..] at 5 m with igg3; none (each < ..) with ...``, highest rate first."""
    rate = f"{event}_rate"
    never, seen = overview[overview[rate] == 0], overview[overview[rate] > 0].sort_values(rate, ascending=False)
    parts = _shared((worst_text(row, event), row.method) for row in seen.itertuples())
    if len(never):
        bound = percent(float(never[f"{event}_high"].max()))
        parts.append(f"none (each < {bound} %) with {listed(list(never.method))}")
    return "; ".join(parts)


def _shared(texts: Iterable[tuple[str, str]]) -> list[str]:
    """``text with a and b``, for texts with the method of each; methods of the same text share one clause."""
    names: dict[str, list[str]] = {}
    for text, method in texts:
        names.setdefault(text, []).append(method)
    return [f"{text} with {listed(methods)}" for text, methods in names.items()]


def _availability(overview: pd.DataFrame) -> str:
    always = overview[overview.within == overview.draws]
    rest = overview[overview.within < overview.draws].sort_values("availability")
    parts = [f"{availability_text(row)} with {row.method}" for row in rest.itertuples()]
    if len(always):
        bound = percent(always.availability_low.min())
        methods = listed(list(always.method)) if len(rest) else "every method"
        parts.append(f"all draws (> {bound} %) with {methods}")
    return f"Both protection levels are within their alert limits without a fault in {'; '.join(parts)}."


def _levels(overview: pd.DataFrame) -> str:
    ranked = overview.dropna(subset="vpl_50_m").sort_values("vpl_50_m")
    if ranked.empty:
        return "No method has a protection level."
    levels = [f"{metres(row.vpl_50_m)} m with {row.method}" for row in ranked.itertuples()]
    return f"The median VPL without a fault, from the smallest: {', '.join(levels)}."


def _at_equal_rates(tables: EqualTables) -> list[str]:
    sentences = []
    other = tables.tests[~tables.tests.fits]
    if len(other):
        measured = "; ".join(f"{row.method} ({event_text(row, 'alarm')})" for row in other.itertuples())
        sentences.append(
            f"Set for a false-alarm rate of {tables.p_fa:g}, these have another one and are left out of what "
            f"follows: {measured}."
        )
    fault = tables.telling_fault()
    if fault is None:
        return sentences
    chosen = tables.comparable
    curves = same_curves(chosen, "alarm")
    sentences += [
        f"At a false-alarm rate of {tables.p_fa:g}, {listed(names)} alarm equally often under every fault, to the "
        "last draw."
        for names in curves
        if len(names) > 1
    ]
    if len(curves) > 1:
        at_fault = [(names, rows[rows.fault == fault].iloc[0]) for names, rows in curves.items()]
        at_fault.sort(key=lambda curve: -curve[1].alarm_rate)
        alarms = "; ".join(f"{event_text(row, 'alarm')} with {listed(names)}" for names, row in at_fault)
        sentences.append(f"At that rate, alarms at {fault}: {alarms}.")
    most = worst(chosen[chosen.fault != "none"], "misleading").sort_values("misleading_rate", ascending=False)
    parts = _shared(
        (
            event_text(row, "misleading") + (f" at {row.fault}" if row.misleading_rate > 0 else " at any"),
            row.method,
        )
        for row in most.itertuples()
    )
    sentences.append(f"At that rate, misleading information at the worst of these biases: {'; '.join(parts)}.")
    return sentences


def _overview(overview: pd.DataFrame) -> TextTable:
    header = [
        "method", "alarms, no fault", "PL <= AL, no fault", "VPL 50 / 95 % [m]", "missed", "misleading",
        "error > VAL",
    ]  # fmt: skip
    rows = []
    for row in overview.itertuples():
        levels = f"{metres(row.vpl_50_m)} / {metres(row.vpl_95_m)}"
        events = [worst_text(row, event) for event in ("missed", "misleading", "hazard")]
        rows.append([row.method, event_text(row, "fault_free_alarm"), availability_text(row), levels, *events])
    return TextTable.of(header, rows)


def _by_bias(rates: pd.DataFrame, event: str) -> TextTable:
    faults = _some_faults(rates)
    rows = [[name, *_rates_at(group, faults, event)] for name, group in rates.groupby("method", sort=False)]
    return TextTable.of(["method", *faults], rows)


def _equal(tables: EqualTables) -> TextTable:
    faults = _some_faults(tables.rates)
    rows = []
    for test in tables.tests.itertuples():
        if not test.fits:
            rows.append([test.method, f"{event_text(test, 'alarm')}: another rate", *("-" for _ in faults), "-"])
            continue
        group = tables.rates[tables.rates.method == test.method]
        most = worst(group[group.fault != "none"], "misleading").iloc[0]
        text = event_text(most, "misleading") + (f" at {most.fault}" if most.misleading_rate > 0 else "")
        rows.append([test.method, event_text(test, "alarm"), *_rates_at(group, faults, "alarm"), text])
    header = ["method", "alarms, no fault", *(f"alarms, {fault}" for fault in faults), "misleading, worst bias"]
    return TextTable.of(header, rows)


def _rates_at(group: pd.DataFrame, faults: Sequence[str], event: str) -> list[str]:
    by_fault = group.set_index("fault")
    return [event_text(by_fault.loc[fault], event) for fault in faults]


def _some_faults(rates: pd.DataFrame) -> list[str]:
    """Faults of a ramp, more of them at its beginning, where rates change; the first and the last included."""
    faults = list(dict.fromkeys(rates.fault[rates.fault != "none"]))
    if len(faults) <= _SHOWN_BIASES:
        return faults
    place = (len(faults) - 1) * (np.arange(_SHOWN_BIASES) / (_SHOWN_BIASES - 1)) ** 1.5
    return [faults[round(k)] for k in place]
