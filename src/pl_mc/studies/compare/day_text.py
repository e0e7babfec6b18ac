"""What a comparison of methods says of several geometries: whether orders hold over a day."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.text import event_text, metres, percent, rate_text, span
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.compare.tables import Comparison, orders, short_name

_ORDERED = {
    "missed": "missed detections",
    "misleading": "misleading information",
    "hazard": "errors beyond VAL, alarm or not",
}

# Pairs of methods that are named one by one.
_NAMED = 6


def blocks_over_the_day(day: Comparison, alert: AlertLimits) -> tuple[Block, ...]:
    """The findings of all geometries, and the tables behind them."""
    return (
        Heading("Over the day"),
        Paragraph(
            "Strongest, median and weakest are epochs of the same series by the VDOP of least squares; the day is "
            "a sample of it in equal steps. At each epoch that satellite is faulted whose bias moves least squares "
            "most in the vertical. All methods and all biases see the same noise at an epoch, every epoch its own. "
            "Bounds are about the noise at these epochs."
        ),
        _geometries(day),
        Bullets((*_orders_of_methods(day), _never_misleading(day), *_orders_of_tests(day))),
        Paragraph("Alarms without a fault:"),
        _by_geometry(day, day.overview, lambda row: event_text(row, "fault_free_alarm")),
        Paragraph("VPL <= VAL and HPL <= HAL without a fault:"),
        _by_geometry(day, day.overview, availability_text),
        Paragraph(
            f"Missed detections (error > VAL {alert.vertical_m:g} m, no alarm), at the worst bias of each geometry:"
        ),
        _by_geometry(day, day.overview, lambda row: worst_text(row, "missed")),
        Paragraph("Misleading information (error > VPL, no alarm), at the worst bias of each geometry:"),
        _by_geometry(day, day.overview, lambda row: worst_text(row, "misleading")),
        Paragraph(
            "Misleading information averaged over the biases of the ramp, with the smallest and the largest of the "
            "sampled epochs (counts of that epoch alone, no bounds):"
        ),
        _mean_misleading(day),
        *_tests(day),
    )


def availability_text(row: Any) -> str:
    """In how many draws without a fault both levels were within their alert limits, of a row of an overview."""
    return rate_text(int(row.within), int(row.draws), row.availability_low, row.availability_high)


def worst_text(row: Any, event: str) -> str:
    """The rate of an event in a row of an overview, and the bias at which it is the worst, where there is one."""
    bias = getattr(row, f"{event}_bias_m", float("nan"))
    return event_text(row, event) + (f" at {bias:g} m" if bias == bias else "")


def _geometries(day: Comparison) -> TextTable:
    rows = []
    for row in day.geometries.itertuples():
        low, high = metres(row.vdop_min_m), metres(row.vdop_max_m)
        epoch = row.epoch if row.epoch >= 0 else f"{row.epochs} epochs"
        seen, redundant = span(row.satellites_min, row.satellites_max), span(row.redundant_min, row.redundant_max)
        vdop = low if row.vdop_min_m == row.vdop_max_m else f"{low} to {high}"
        rows.append([row.geometry, epoch, seen, redundant, vdop, row.faulted])
    return TextTable.of(["geometry", "epoch", "satellites", "redundant", "VDOP [m]", "faulted satellite"], rows)


def _orders_of_methods(day: Comparison) -> list[str]:
    """Whether the order of methods at the experiment's own epoch holds elsewhere, event by event."""
    sentences, means, last = [], day.means(), day.names[-1]
    for event, what in _ORDERED.items():
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
            fewer: dict[str, list[str]] = {}
            for a, b in pairs:
                fewer.setdefault(b, []).append(a)
            joined: dict[tuple[str, ...], list[str]] = {}
            for b, more in fewer.items():
                joined.setdefault(tuple(more), []).append(b)
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


def _tests(day: Comparison) -> tuple[Block, ...]:
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
        Paragraph(
            "Thresholds are exact in every geometry, but for the w-test, whose significance is set anew in each "
            "(over the day for all its epochs together) from fault-free draws of another seed. Tests with a "
            "setting that one epoch alone gave them are at that epoch only. A test whose measured rate does not "
            f"fit {p_fa:g} is marked and not compared. At the bias nearest to where the best of them alarms in "
            "half of the draws:"
        ),
        TextTable.of(header, [[name, *cells] for name, *cells in zip(names, *columns, strict=True)]),
        Paragraph(f"Most alarms there: {'; '.join(best)}."),
    )
