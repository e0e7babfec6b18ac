"""What a comparison of many methods says: findings, whether they hold at other geometries, the answer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits, Judged, judged_by
from pl_mc.geometry import Geometry
from pl_mc.report.document import Block, Bullets, Heading, Summary, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import ANSWERED, event_text, grouped, listed, metres, percent, rate_text, span
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.studies.compare.day import DIRECTION, dilution_and_reach
from pl_mc.studies.compare.tables import Comparison, EqualTables, orders, same_curves, short_name, worst
from pl_mc.studies.spec import ByOneAxis

_SHOWN_BIASES = 7

# Events at the worst bias, of which the overview has columns.
_WORST = ("missed", "misleading", "hazard")

# Pairs of methods that are named one by one.
_NAMED = 6


def summary(counted: Comparison, g: Geometry, experiment: ByOneAxis) -> Summary:
    """Findings in sentences, then the tables, of the experiment's own geometry ``g``; over several in front."""
    quantities, several, judged = ls_quantities(g), len(counted.names) > 1, experiment.decides
    alert, (dilution_m, _) = judged.alert, dilution_and_reach(quantities, judged.axis)
    rates, overview = counted.own_rates, counted.own(counted.overview)
    tests = counted.equal.get(counted.reference)
    blocks: list[Block | str] = [
        f"{len(g.names)} satellites, {int(quantities.dof)} redundant, {counted.dilution} "
        f"{metres(float(dilution_m))} m of least squares; alert limits {alert.name}, {alert.words}. "
        f"{int(rates.draws.min()):,} draws for each fault, the same for all methods, seed {experiment.seed}. Rates "
        "with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen.",
        *(_over_the_day(counted, judged) if several else ()),
        Heading(f"Findings at {counted.reference}" if several else "Findings"),
        Bullets(tuple(findings(overview, tests, judged))),
        Heading("As they are by default"),
        "Their false-alarm rates differ: alarm rates of one line must not be held against those of another. "
        f"Missed, misleading and {_beyond(judged, limits=True)}: at the bias at which each is most frequent.",
        _overview(overview, judged),
    ]
    for event in ("alarm", "misleading"):
        blocks += [f"P({event}) by bias:", _by_bias(rates, event)]
    if tests is not None:
        blocks += [
            Heading(f"Tests at a false-alarm rate of {tests.p_fa:g}"),
            f"{int(tests.rates.draws.min()):,} draws for each fault. Only tests whose measured rate fits "
            f"{tests.p_fa:g} are compared (exact binomial test, 5 % for all together).",
            _equal(tests),
        ]
    return (
        *blocks,
        f"alarm: {judged.alarm}, or the method's test rejects, or no solution. missed: {judged.beyond_limit} and no "
        f"alarm. misleading: {judged.beyond_level} and no alarm. PL <= AL: {_within(alert)} without a fault.",
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: ByOneAxis) -> tuple[str, ...]:
    """Least squares and IGG-III, the worst of the others, and how many have no event at any bias."""
    sentences = []
    judged = experiment.decides
    for event in ANSWERED:
        most = worst(tables["rates"], event).set_index("method")
        rate = most[f"{event}_rate"]
        known = [name for name in ("ls", "igg3") if name in most.index]
        parts = [f"{method_label(name, judged.axis)} {event_text(most.loc[name], event)}" for name in known]
        others = rate[rate > 0].drop(known, errors="ignore")
        if len(others):
            name = str(others.idxmax())
            parts.append(
                f"the most of the others {method_label(name, judged.axis)}, {event_text(most.loc[name], event)}"
            )
        parts.append(f"none with {int((rate == 0).sum())} of {len(most)} methods")
        sentences.append(f"{judged.means(event)}, at each one's worst bias: {'; '.join(parts)}.")
    return tuple(sentences)


def _within(alert: AlertLimits) -> str:
    """``VPL <= VAL and HPL <= HAL``, of the limits that there are."""
    return " and ".join(f"{one.level} <= {one.limit}" for axis in alert.limit_m for one in Judged(alert, axis).called)


def _beyond(judged: Judged, *, limits: bool) -> str:
    """``error > VAL``, or with its level."""
    return "error " + " or ".join(f"> {one.limit if limits else one.level}" for one in judged.called)


def findings(overview: pd.DataFrame, tests: EqualTables | None, judged: Judged) -> list[str]:
    """What the tables say, a sentence or two for each question."""
    limits = [f"{limit_m:g} m" for _, _, limit_m in judged.levels]
    level = " or ".join(f"{one.error} beyond {one.level}" for one in judged.called)
    limit = " or ".join(f"{one.error} beyond {m}" for one, m in zip(judged.called, limits, strict=True))
    where = " or ".join(f"{m} {axis}ly" for m, axis in zip(limits, judged_by(judged.axis), strict=True))
    rates = {
        "fault_free_misleading": f"Misleading information without a fault ({level})",
        "missed": f"Missed detections ({limit} without an alarm), at the worst bias",
        "misleading": f"Misleading information ({level} without an alarm), at the worst bias",
        "hazard": f"The position itself, alarm or not, is beyond {where}, at the worst bias",
    }
    return [
        f"Alarms without a fault: {_by_rate(overview, 'fault_free_alarm')}.",
        _availability(overview, judged.alert),
        *(_median_levels(overview, pl, name) for pl, name, _ in judged.levels),
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
    return [f"{text} with {listed(methods)}" for text, methods in grouped(texts).items()]


def _availability(overview: pd.DataFrame, alert: AlertLimits) -> str:
    always = overview[overview.within == overview.draws]
    rest = overview[overview.within < overview.draws].sort_values("availability")
    parts = [f"{availability_text(row)} with {row.method}" for row in rest.itertuples()]
    if len(always):
        bound = percent(always.availability_low.min())
        methods = listed(list(always.method)) if len(rest) else "every method"
        parts.append(f"all draws (> {bound} %) with {methods}")
    both = len(alert.limit_m) > 1
    what = "Both protection levels are within their alert limits" if both else f"{_within(alert)}"
    return f"{what} without a fault in {'; '.join(parts)}."


def _median_levels(overview: pd.DataFrame, pl: str, name: str) -> str:
    ranked = overview.dropna(subset=f"{pl}_50_m").sort_values(f"{pl}_50_m")
    if ranked.empty:
        return f"No method has a {'protection level' if name == 'VPL' else name}."
    levels = [f"{metres(getattr(row, f'{pl}_50_m'))} m with {row.method}" for row in ranked.itertuples()]
    return f"The median {name} without a fault, from the smallest: {', '.join(levels)}."


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
    places = most.fault.where(most.misleading_rate > 0, "any")
    parts = _shared(
        (f"{event_text(row, 'misleading')} at {place}", row.method)
        for row, place in zip(most.itertuples(), places, strict=True)
    )
    sentences.append(f"At that rate, misleading information at the worst of these biases: {'; '.join(parts)}.")
    return sentences


def _overview(overview: pd.DataFrame, judged: Judged) -> TextTable:
    header = [
        "method", "alarms, no fault", "PL <= AL, no fault", *(f"{name} 50 / 95 % [m]" for _, name, _ in judged.levels),
        *_WORST[:-1], _beyond(judged, limits=True),
    ]  # fmt: skip

    def median(row: Any, pl: str) -> str:
        return " / ".join(metres(getattr(row, f"{pl}_{percent}_m")) for percent in (50, 95))

    rows = [
        [row.method, event_text(row, "fault_free_alarm"), availability_text(row),
         *(median(row, pl) for pl, _, _ in judged.levels), *(worst_text(row, event) for event in _WORST)]
        for row in overview.itertuples()
    ]  # fmt: skip
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


def _over_the_day(day: Comparison, judged: Judged) -> Summary:
    """The findings of all geometries, and the tables behind them."""
    limits = " or ".join(
        f"> {one.limit} {limit_m:g} m" for one, (_, _, limit_m) in zip(judged.called, judged.levels, strict=True)
    )
    cells: dict[str, Callable[[pd.Series], str]] = {
        "Alarms without a fault": partial(event_text, event="fault_free_alarm"),
        f"{_within(judged.alert)} without a fault": availability_text,
    }
    for what, event in (
        (f"Missed detections (error {limits}, no alarm)", "missed"),
        (f"Misleading information ({_beyond(judged, limits=False)}, no alarm)", "misleading"),
    ):
        cells[f"{what}, at the worst bias of each geometry"] = partial(worst_text, event=event)
    tables: list[Block | str] = []
    for what, cell in cells.items():
        tables += [f"{what}:", _by_geometry(day, day.overview, cell)]
    return (
        Heading("Over the day"),
        f"Strongest, median and weakest are epochs of the same series by the {day.dilution} of least squares; the day "
        "is a sample of it in equal steps. At each epoch that satellite is faulted whose bias moves least squares most "
        f"{DIRECTION[judged.axis]}. All methods and all biases see the same noise at an epoch, every epoch its own. "
        "Bounds are about the noise at these epochs.",
        _geometries(day),
        Bullets((*_orders_of_methods(day, judged), _never_misleading(day), *_orders_of_tests(day))),
        *tables,
        "Misleading information averaged over the biases of the ramp, with the smallest and the largest of the "
        "sampled epochs (counts of that epoch alone, no bounds):",
        _mean_misleading(day),
        *_tests(day),
    )


def availability_text(row: Any) -> str:
    """In how many draws without a fault levels were within their alert limits, of a row of an overview."""
    return rate_text(int(row.within), int(row.draws), row.availability_low, row.availability_high)


def worst_text(row: Any, event: str) -> str:
    """The rate of an event in a row of an overview, and the bias at which it is the worst, where there is one."""
    bias = getattr(row, f"{event}_bias_m", float("nan"))
    return event_text(row, event) + (f" at {bias:g} m" if bias == bias else "")


def _geometries(day: Comparison) -> TextTable:
    rows = []
    for row in day.geometries.itertuples():
        least_m, most_m = day.dilution_m(row)
        low, high = metres(least_m), metres(most_m)
        epoch = row.epoch if row.epoch >= 0 else f"{row.epochs} epochs"
        seen, redundant = span(row.satellites_min, row.satellites_max), span(row.redundant_min, row.redundant_max)
        dilution = low if least_m == most_m else f"{low} to {high}"
        rows.append([row.geometry, epoch, seen, redundant, dilution, row.faulted])
    return TextTable.of(
        ["geometry", "epoch", "satellites", "redundant", f"{day.dilution} [m]", "faulted satellite"], rows
    )


def _orders_of_methods(day: Comparison, judged: Judged) -> list[str]:
    """Whether the order of methods at the experiment's own epoch holds elsewhere, event by event."""
    sentences, means, last = [], day.means(), day.names[-1]
    limits = " or ".join(one.limit for one in judged.called)
    ordered = {
        "missed": "missed detections", "misleading": "misleading information",
        "hazard": f"errors beyond {limits}, alarm or not",
    }  # fmt: skip
    for event, what in ordered.items():
        kept, turned = _orders(means, event, day.names)
        text = (
            f"Order by {what}, averaged over the biases: of pairs of methods whose bounds lie apart both at "
            f"{day.reference} and elsewhere, these keep their order: {kept}."
        )
        pairs = [f"{a} before {b}" for a, b in turned[last]]
        if pairs:
            more = f" and {len(pairs) - _NAMED} more" if len(pairs) > _NAMED else ""
            text += f" Turned over the {last}, where it is the other way round: {'; '.join(pairs[:_NAMED])}{more}."
        sentences.append(text)
    return sentences


def _orders_of_tests(day: Comparison) -> list[str]:
    """Whether the order of tests at one false-alarm rate holds elsewhere."""
    if len(day.equal) < 2:
        return []
    sentences, means, p_fa = [], day.equal_means(), day.equal[day.reference].p_fa
    for event, what in (("alarm", "alarms"), ("misleading", "misleading information")):
        kept, turned = _orders(means, event, list(day.equal))
        text = (
            f"Tests at a false-alarm rate of {p_fa:g}, order by {what} averaged over the biases: of pairs whose "
            f"bounds lie apart both at {day.reference} and elsewhere, these keep their order: {kept}."
        )
        others = []
        for name, pairs in turned.items():
            # Tests that share their curves stand in one clause.
            more_than = grouped((b, a) for a, b in pairs)
            joined = grouped((tuple(more), b) for b, more in more_than.items())
            others += [f"{name}, {', '.join(a)} more than {', '.join(b)}" for a, b in joined.items()]
        if others:
            text += f" Turned: {'; '.join(others)}, the other way round at {day.reference}."
        sentences.append(text)
    return sentences


def _orders(means: pd.DataFrame, event: str, names: list[str]) -> tuple[str, dict[str, list[tuple[str, str]]]]:
    """How many pairs keep the order of the first geometry in each other one, in words, and those that turn."""
    pairs = {name: orders(means, event, names[0], name) for name in names[1:]}
    kept = [f"{name} {len(same)} of {len(same) + len(turned)}" for name, (same, turned) in pairs.items()]
    return ", ".join(kept), {name: turned for name, (_, turned) in pairs.items()}


def _never_misleading(day: Comparison) -> str:
    """Methods that mislead under no bias of any geometry."""
    seen, last = day.rates.groupby("method", sort=False).misleading.sum(), day.names[-1]
    never = [name for name in day.methods if seen[name] == 0]
    if not never:
        return "Every method misleads under some bias of some geometry."
    rows = day.overview[(day.overview.geometry == last) & day.overview.method.isin(never)]
    shares = "; ".join(f"{row.method} {availability_text(row)}" for row in rows.itertuples())
    draws = int(day.rates.groupby("geometry").draws.min()[last])
    return (
        f"Never misleading under any bias of any geometry (over the {last} < "
        f"{percent(float(clopper_pearson(0, draws)[1]))} % at each bias): {', '.join(never)}; their levels are "
        f"within the alert limits without a fault, over the {last}, in: {shares}."
    )


def _by_geometry(day: Comparison, table: pd.DataFrame, cell: Callable[[pd.Series], str]) -> TextTable:
    """A line for each method, a column for each geometry; ``cell`` makes a text of a row of the table."""
    by_place = table.set_index(["method", "geometry"])
    rows = [[name, *(cell(by_place.loc[name, place]) for place in day.names)] for name in day.methods]
    return TextTable.of(["method", *day.names], rows)


def _mean_misleading(day: Comparison) -> TextTable:
    faulted, means = day.epochs[day.epochs.fault != "none"], day.means()
    totals = faulted.groupby(["method", "epoch"], observed=True)[["misleading", "draws"]].sum()
    shares = (totals.misleading / totals.draws).groupby(level="method", observed=True).agg(["min", "max"])
    table = _by_geometry(day, means[means.event == "misleading"], _mean_text)
    extremes = {row.Index: f"{percent(row.min)} to {percent(row.max)} %" for row in shares.itertuples()}
    return TextTable((*table.header, "epochs of the day"), tuple((*row, extremes[row[0]]) for row in table.rows))


def _mean_text(row: pd.Series) -> str:
    if row.rate == 0:
        return f"0 (< {percent(row.high)} %)"
    return f"{percent(row.rate)} % [{percent(row.low)}, {percent(row.high)}]"


def _tests(day: Comparison) -> Summary:
    """Alarms of tests at one false-alarm rate, a column for each geometry, at the bias that tells them apart."""
    if len(day.equal) < 2:
        return ()
    names, p_fa = day.tests, day.equal[day.reference].p_fa
    header, columns, best = ["test"], [], []
    for geometry, tables in day.equal.items():
        fault = tables.telling_fault()
        header.append(f"{geometry}, {fault.split(':')[1] if fault else '-'}")
        rows = tables.rates[tables.rates.fault == fault].merge(tables.tests[["method", "fits"]], on="method")
        at_fault = {short_name(row.method): row for row in rows.itertuples()}
        alarms = {name: row.alarm_rate for name, row in at_fault.items() if row.fits}
        texts = {name: event_text(row, "alarm") if row.fits else "another rate" for name, row in at_fault.items()}
        columns.append([texts.get(name, "-") for name in names])
        if alarms:
            most = max(alarms.values())
            best.append(f"{geometry} {', '.join(name for name in names if alarms.get(name) == most)}")
    return (
        Heading(f"Tests at a false-alarm rate of {p_fa:g}, over the day"),
        "Thresholds are exact in every geometry, but for the w-test, whose significance is set anew in each (over "
        "the day for all its epochs together) from fault-free draws of another seed. Tests with a setting that one "
        "epoch alone gave them are at that epoch only. A test whose measured rate does not fit "
        f"{p_fa:g} is marked and not compared. At the bias nearest to where the best of them alarms in half of the "
        "draws:",
        TextTable.of(header, [[name, *cells] for name, *cells in zip(names, *columns, strict=True)]),
        f"Most alarms there: {'; '.join(best)}.",
    )
