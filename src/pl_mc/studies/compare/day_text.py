"""What a comparison of methods says and shows of several geometries: whether orders hold over a day."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, new_figure, series_style
from pl_mc.report.text import event_text, markdown_table, metres, percent, rate_text
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.compare.figures import (
    COLOURS,
    HEADINGS,
    EqualTables,
    event_map,
    share_bars,
    short_name,
)
from pl_mc.studies.compare.orders import mean_rates, orders

_EVENTS = ("alarm", "missed", "misleading")
_ORDERED = {
    "missed": "missed detections",
    "misleading": "misleading information",
    "hazard": "errors beyond VAL, alarm or not",
}

# Pairs of methods that are named one by one.
_NAMED = 6


@dataclass(frozen=True)
class DayTables:
    """Counts of several geometries.

    Attributes:
        reference: name of the experiment's own geometry.
        geometries: a row about each, see `pl_mc.studies.compare.day.describe`.
        rates, overview: of all methods, with a column ``geometry``.
        means: see `pl_mc.studies.compare.orders.mean_rates`.
        epochs: counts of every epoch of the sample: epoch, fault, bias_m, method, draws, counts.
        equal: tests at one false-alarm rate, by geometry.
    """

    reference: str
    geometries: pd.DataFrame
    rates: pd.DataFrame
    overview: pd.DataFrame
    means: pd.DataFrame
    epochs: pd.DataFrame
    equal: Mapping[str, EqualTables] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """The geometries, the experiment's own in front."""
        return [str(name) for name in self.geometries.geometry]

    @property
    def methods(self) -> list[str]:
        """The methods, in order."""
        return list(dict.fromkeys(self.rates.method))

    def with_reference(self, tests: EqualTables | None) -> DayTables:
        """The same with the tests of the experiment's own geometry in front."""
        if tests is None or not self.equal:
            return self
        return replace(self, equal={self.reference: tests, **self.equal})


def day_summary(summary: str, day: DayTables, *, alert: AlertLimits) -> str:
    """The summary of one epoch with the findings of all geometries put in front of its own."""
    head, mark, rest = summary.partition("## Findings\n")
    assert mark
    told = "".join(f"- {sentence}\n" for sentence in day_findings(day))
    cells = [
        [row.geometry, row.epoch if row.epoch >= 0 else f"{row.epochs} epochs",
         _span(row.satellites_min, row.satellites_max), _span(row.redundant_min, row.redundant_max),
         metres(row.vdop_min_m) if row.vdop_min_m == row.vdop_max_m
         else f"{metres(row.vdop_min_m)} to {metres(row.vdop_max_m)}", row.faulted]
        for row in day.geometries.itertuples()
    ]  # fmt: skip
    header = ["geometry", "epoch", "satellites", "redundant", "VDOP [m]", "faulted satellite"]
    parts = [
        "## Over the day\n",
        "Strongest, median and weakest are epochs of the same series by the VDOP of least squares; the day is a "
        "sample of it in equal steps. At each epoch that satellite is faulted whose bias moves least squares most "
        "in the vertical. All methods and all biases see the same noise at an epoch, every epoch its own. Bounds "
        "are about the noise at these epochs.\n",
        markdown_table(header, cells) + "\n",
        told,
        "Alarms without a fault:\n",
        _by_geometry(day, "fault_free_alarm", biased=False) + "\n",
        "VPL <= VAL and HPL <= HAL without a fault:\n",
        _availability(day) + "\n",
        f"Missed detections (error > VAL {alert.vertical_m:g} m, no alarm), at the worst bias of each geometry:\n",
        _by_geometry(day, "missed") + "\n",
        "Misleading information (error > VPL, no alarm), at the worst bias of each geometry:\n",
        _by_geometry(day, "misleading") + "\n",
        "Misleading information averaged over the biases of the ramp, with the smallest and the largest of the "
        "sampled epochs (counts of that epoch alone, no bounds):\n",
        _spread(day) + "\n",
        *_equal_parts(day),
        f"## Findings at {day.reference}\n",
    ]
    return head + "\n".join(parts) + rest


def day_findings(day: DayTables) -> list[str]:
    """Whether the order of methods at the experiment's own epoch holds elsewhere, event by event."""
    told = []
    for event, what in _ORDERED.items():
        parts, turned_over_day = [], []
        for name in day.names[1:]:
            same, turned = orders(day.means, event, day.reference, name)
            parts.append(f"{name} {len(same)} of {len(same) + len(turned)}")
            if name == day.names[-1]:
                turned_over_day = turned
        text = (
            f"Order by {what}, averaged over the biases: of pairs of methods whose bounds lie apart both at "
            f"{day.reference} and elsewhere, these keep their order: {', '.join(parts)}."
        )
        if turned_over_day:
            pairs = [f"{a} before {b}" for a, b in turned_over_day[:_NAMED]]
            more = f" and {len(turned_over_day) - _NAMED} more" if len(turned_over_day) > _NAMED else ""
            text += f" Turned over the {day.names[-1]}, where it is the other way round: {'; '.join(pairs)}{more}."
        told.append(text)
    return [*told, _least_misleading(day), *_equal_orders(day)]


def equal_means(day: DayTables) -> pd.DataFrame:
    """Rates of the comparable tests averaged over the biases, see `mean_rates`; tests by their short names."""
    rates = [
        one.comparable.assign(geometry=name, method=lambda table: table.method.map(short_name))
        for name, one in day.equal.items()
    ]
    return mean_rates(pd.concat(rates, ignore_index=True), ("alarm", "misleading"))


def _equal_orders(day: DayTables) -> list[str]:
    """Whether the order of tests at one false-alarm rate holds elsewhere."""
    if not day.equal:
        return []
    means, told = equal_means(day), []
    p_fa = next(iter(day.equal.values())).p_fa
    for event, what in (("alarm", "alarms"), ("misleading", "misleading information")):
        kept, others = [], []
        for name in list(day.equal)[1:]:
            same, turned = orders(means, event, day.reference, name)
            kept.append(f"{name} {len(same)} of {len(same) + len(turned)}")
            # Tests that share their curves stand in one clause.
            fewer: dict[str, list[str]] = {}
            for a, b in turned:
                fewer.setdefault(b, []).append(a)
            joined: dict[tuple[str, ...], list[str]] = {}
            for b, names in fewer.items():
                joined.setdefault(tuple(names), []).append(b)
            others += [f"{name}, {', '.join(a)} more than {', '.join(b)}" for a, b in joined.items()]
        text = (
            f"Tests at a false-alarm rate of {p_fa:g}, order by {what} averaged over the biases: of pairs whose "
            f"bounds lie apart both at {day.reference} and elsewhere, these keep their order: {', '.join(kept)}."
        )
        if others:
            text += f" Turned: {'; '.join(others)}, the other way round at {day.reference}."
        told.append(text)
    return told


def _least_misleading(day: DayTables) -> str:
    """Methods that mislead under no bias of any geometry."""
    seen = day.rates.groupby("method", sort=False)[["misleading", "draws"]].sum()
    never = [name for name in day.methods if seen.misleading[name] == 0]
    if not never:
        return "Every method misleads under some bias of some geometry."
    last = day.overview[(day.overview.geometry == day.names[-1]) & day.overview.method.isin(never)]
    shares = "; ".join(
        f"{row.method} {rate_text(int(row.within), int(row.draws), row.availability_low, row.availability_high)}"
        for row in last.itertuples()
    )
    draws = int(day.rates.groupby("geometry").draws.min()[day.names[-1]])
    bound = percent(float(clopper_pearson(0, draws)[1]))
    return (
        f"Never misleading under any bias of any geometry (over the {day.names[-1]} < {bound} % at each bias): "
        f"{', '.join(never)}; their levels are within the alert limits without a fault, over the {day.names[-1]}, "
        f"in: {shares}."
    )


def _by_geometry(day: DayTables, event: str, *, biased: bool = True) -> str:
    cells = []
    for name in day.methods:
        row: list[str] = [name]
        for geometry in day.names:
            one = _one(day.overview, name, geometry)
            text = event_text(one, event)
            bias = one[f"{event}_bias_m"] if biased else np.nan
            row.append(text + (f" at {bias:g} m" if bias == bias else ""))
        cells.append(row)
    return markdown_table(["method", *day.names], cells)


def _availability(day: DayTables) -> str:
    cells = []
    for name in day.methods:
        rows = [_one(day.overview, name, geometry) for geometry in day.names]
        cells.append(
            [name, *(rate_text(int(r.within), int(r.draws), r.availability_low, r.availability_high) for r in rows)]
        )
    return markdown_table(["method", *day.names], cells)


def _spread(day: DayTables) -> str:
    faulted = day.epochs[day.epochs.fault != "none"]
    totals = faulted.groupby(["method", "epoch"], observed=True)[["misleading", "draws"]].sum()
    shares = totals.misleading / totals.draws
    cells = []
    for name in day.methods:
        row: list[str] = [name]
        for geometry in day.names:
            found = day.means[
                (day.means.method == name) & (day.means.geometry == geometry) & (day.means.event == "misleading")
            ].iloc[0]
            row.append(
                f"0 (< {percent(found.high)} %)"
                if found.rate == 0
                else f"{percent(found.rate)} % [{percent(found.low)}, {percent(found.high)}]"
            )
        mine = shares.loc[name]
        cells.append([*row, f"{percent(mine.min())} to {percent(mine.max())} %"])
    return markdown_table(["method", *day.names, "epochs of the day"], cells)


def _equal_parts(day: DayTables) -> list[str]:
    if not day.equal:
        return []
    p_fa = next(iter(day.equal.values())).p_fa
    parts = [
        f"## Tests at a false-alarm rate of {p_fa:g}, over the day\n",
        "Thresholds are exact in every geometry, but for the w-test, whose significance is set anew in each (over "
        "the day for all its epochs together) from fault-free draws of another seed. Tests with a setting that one "
        f"epoch alone gave them are at that epoch only. A test whose measured rate does not fit {p_fa:g} is "
        "marked and not compared. At the bias nearest to where the best of them alarms in half of the draws:\n",
    ]
    names = list(dict.fromkeys(short_name(m) for one in day.equal.values() for m in one.tests.method))
    columns, header = [], ["test"]
    best = []
    for geometry, tables in day.equal.items():
        fault = telling_fault(tables)
        rates = {short_name(m): part for m, part in tables.rates.groupby("method", sort=False)}
        fits = {short_name(row.method): bool(row.fits) for row in tables.tests.itertuples()}
        header.append(f"{geometry}, {fault.split(':')[1] if fault else '-'}")
        column, ranked = [], []
        for name in names:
            if name not in rates or not fault:
                column.append("-")
            elif not fits[name]:
                column.append("another rate")
            else:
                row = rates[name][rates[name].fault == fault].iloc[0]
                column.append(event_text(row, "alarm"))
                ranked.append((float(row.alarm_rate), name))
        columns.append(column)
        if ranked:
            top = max(rate for rate, _ in ranked)
            winners = [name for rate, name in ranked if rate == top]
            best.append(f"{geometry} {', '.join(winners)}")
    rows = [[name, *(column[k] for column in columns)] for k, name in enumerate(names)]
    parts += [markdown_table(header, rows) + "\n", f"Most alarms there: {'; '.join(best)}.\n"]
    return parts


def telling_fault(tables: EqualTables) -> str | None:
    """The fault under which the best of the comparable tests is nearest to one half; None without any."""
    faulted = tables.comparable[tables.comparable.fault != "none"]
    if faulted.empty:
        return None
    return str((faulted.groupby("fault", sort=False).alarm_rate.max() - 0.5).abs().idxmin())


@in_common_look
def several_geometries_figure(day: DayTables, *, alert: AlertLimits, title: str) -> Figure:
    """Maps of rates, method by bias: a column for each geometry, a row for each event, and availability below."""
    count, names = len(day.methods), day.names
    # Few methods leave room for what stands beside them too.
    height = max(0.155 * count + 0.35, 2.2)
    figure, axes = new_figure(
        4, len(names), width_in=2.6 + 2.45 * len(names), height_in=1.3 + 4 * height, sharey=True,
    )  # fmt: skip
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    draws = int(day.rates.draws.max())
    norm = LogNorm(1.0 / draws, 1.0)
    for column, name in enumerate(names):
        rates = day.rates[day.rates.geometry == name]
        # Faulted satellites differ from geometry to geometry, their biases do not.
        bias = np.where(rates.fault == "none", 0.0, rates.bias_m)
        for row, event in enumerate(_EVENTS):
            panel = axes[row * len(names) + column]
            table = rates.assign(bias_m=bias).pivot(index="method", columns="bias_m", values=f"{event}_rate")
            event_map(panel, table.loc[day.methods].to_numpy(), norm)
            step = max(1, round((table.shape[1] - 1) / 4))
            panel.set_xticks(range(0, table.shape[1], step), [f"{value:g}" for value in table.columns[::step]])
            panel.tick_params(labelsize=7)
            if column == 0:
                panel.set_ylabel(HEADINGS[event].format(alert=alert), fontsize=8.5)
            if row == 0:
                panel.set_title(_heading(day, name), fontsize=8.5)
            if row == 2:
                panel.set_xlabel("bias [m]", fontsize=8)
        share = axes[3 * len(names) + column]
        share_bars(share, day.overview[day.overview.geometry == name].set_index("method").loc[day.methods])
        share.set_title("")
        share.tick_params(labelsize=7)
        share.set_xlabel("share of draws", fontsize=8)
        if column == 0:
            share.set_ylabel("PL ≤ AL, no fault", fontsize=8.5)
    for row in range(4):
        axes[row * len(names)].set_yticks(range(count), day.methods, fontsize=6.5)
        axes[row * len(names)].set_ylim(count - 0.5, -0.5)
    bar = figure.colorbar(
        ScalarMappable(norm=norm, cmap=COLOURS), ax=axes, location="bottom", shrink=0.5, aspect=60, pad=0.01
    )
    fewest = int(day.rates.draws.min())
    bar.set_label(
        f"share of draws at one bias; white: none (95 % upper bound {clopper_pearson(0, fewest)[1]:.1e} or less)"
    )
    bar.outline.set_visible(False)
    return figure


@in_common_look
def several_equal_figure(day: DayTables, *, title: str) -> Figure:
    """Alarms and misleading information of tests at one false-alarm rate, a column for each geometry."""
    names = list(day.equal)
    figure, axes = new_figure(
        2, len(names), width_in=1.0 + 3.0 * len(names), height_in=7.4, sharex=True, sharey=True
    )  # fmt: skip
    p_fa = day.equal[names[0]].p_fa
    figure.suptitle(f"{title}: tests at a false-alarm rate of {p_fa:g}", x=0.01, ha="left", fontsize=11)
    tests = list(dict.fromkeys(short_name(m) for one in day.equal.values() for m in one.tests.method))
    shown: dict[str, Any] = {}
    fewest = min(int(one.rates.draws.min()) for one in day.equal.values())
    for column, name in enumerate(names):
        tables = day.equal[name]
        for row, event in enumerate(("alarm", "misleading")):
            panel = axes[row * len(names) + column]
            for method, rows in tables.comparable.groupby("method", sort=False):
                place = tests.index(short_name(str(method)))
                style = series_style(place)
                bias = np.where(rows.fault == "none", 0.0, rows.bias_m)
                rate = rows[f"{event}_rate"].where(rows[f"{event}_rate"] > 0)
                spread = np.vstack([rate - rows[f"{event}_low"], rows[f"{event}_high"] - rate])
                # Curves that lie on each other show through: later ones are smaller.
                drawn = panel.errorbar(
                    bias, rate, yerr=np.maximum(spread, 0.0), linestyle=style.line, marker=style.marker,
                    markersize=6.5 - 0.5 * place, color=style.colour, linewidth=2.2 - 0.2 * place,
                    markerfacecolor="white" if place >= 6 else style.colour,
                )  # fmt: skip
                shown[short_name(str(method))] = drawn
            panel.set(yscale="log", ylim=(0.3 * float(clopper_pearson(0, fewest)[1]), 1.6))
        axes[column].axhline(p_fa, color="0.15", linewidth=1.0, linestyle=":")
        axes[column].set_title(_heading(day, name), fontsize=8.5)
        axes[len(names) + column].set_xlabel("bias [m]")
    axes[0].set_ylabel("P(alarm); dotted: the false-alarm rate")
    axes[len(names)].set_ylabel(HEADINGS["misleading"])
    order = [name for name in tests if name in shown]
    figure.legend(
        [shown[name] for name in order], order, loc="outside lower center", ncols=min(4, len(order)), fontsize=8
    )
    return figure


def _heading(day: DayTables, name: str) -> str:
    row = day.geometries[day.geometries.geometry == name].iloc[0]
    seen = _span(row.satellites_min, row.satellites_max)
    if row.epochs > 1:
        return f"{name}: {row.epochs} epochs, {seen} satellites\nworst satellite of each"
    at = "" if name.startswith("epoch ") else f", epoch {row.epoch}"
    return f"{name}{at}: {seen} satellites\n{row.faulted}, VDOP {metres(row.vdop_min_m)} m"


def _span(low: int, high: int) -> str:
    return f"{low}" if low == high else f"{low}-{high}"


def _one(table: pd.DataFrame, method: str, geometry: str) -> pd.Series:
    return table[(table.method == method) & (table.geometry == geometry)].iloc[0]
