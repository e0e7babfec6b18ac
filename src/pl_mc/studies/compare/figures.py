"""Figures of a comparison of many methods: maps of rates, method by bias, and tests at one false-alarm rate.

Each comes for the experiment's own geometry, and with a column for each of several geometries.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.report.figures import bar_lengths, legend_below, legend_in, new_figure, note, widest_in
from pl_mc.report.look import SeriesStyle, styles_of
from pl_mc.report.text import metres, span
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.studies.compare.tables import Comparison, EqualTables, same_curves, short_name, short_names
from pl_mc.studies.spec import ByOneAxis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

_EVENTS = ("alarm", "missed", "misleading")
_TESTED = ("alarm", "misleading")
_AVAILABILITY = "availability"
# From here on a share is shown as all.
_NEARLY_ALL = 0.9995
# What the dilutions of a weighted solution are: standard deviations.
_SIGMAS = {"VDOP": "vertical sigma", "HDOP": "horizontal sigma", "PDOP": "sigma in space"}
_COLOURS = "viridis_r"


def comparison_figure(counted: Comparison, experiment: ByOneAxis) -> Figure:
    """Rates of alarms, missed detections and misleading information, method by bias, and availability.

    One logarithmic scale of colours for all, which begins at one event; white is none at all.
    """
    from matplotlib.colors import LogNorm

    methods, draws, title = counted.methods, int(counted.rates.draws.min()), experiment.title
    figure, axes = new_figure(
        1, 4, width_in=13.0, height_in=2.1 + 0.26 * len(methods), title=title, sharey=True,
        lines_in=0.26 * len(methods), labels_in=widest_in(methods, 8.5),
        gridspec_kw={"width_ratios": [1.0, 1.0, 1.0, 0.36]},
    )  # fmt: skip
    norm = LogNorm(1.0 / draws, 1.0)
    for panel, event in zip(axes, _EVENTS, strict=False):
        _rate_map(panel, counted.own_rates, event, methods, norm, ticks=5)
    _bars(axes[3], counted.overview, methods)
    for panel, heading in zip(axes, _headings(experiment), strict=True):
        panel.set_title(heading, fontsize=9.5)
        panel.set(xlabel="bias [m]")
    label = f"share of {draws:,} draws; white: none (95 % upper bound {_bound_of_none(draws):.1e})"
    _colour_bar(figure, axes[:3], norm, label, aspect=50, pad=0.02)
    axes[0].set_yticks(range(len(methods)), methods, fontsize=8.5)
    axes[0].set_ylim(len(methods) - 0.5, -0.5)
    axes[3].set_xlabel("share of draws")
    return figure


def several_geometries_figure(day: Comparison, experiment: ByOneAxis) -> Figure:
    """Maps of rates, method by bias, a column for each geometry and a row for each event; availability below.

    In a row stand the methods that differ from nothing: with which the event was seen at some geometry, or which are
    not always available.
    """
    from matplotlib.colors import LogNorm

    names, headings = day.names, _headings(experiment)
    seen = {event: set(day.rates.method[day.rates[f"{event}_rate"] > 0]) for event in _EVENTS}
    seen[_AVAILABILITY] = set(day.overview.method[day.overview.availability < _NEARLY_ALL])
    rows = {what: shown for what in seen if (shown := [name for name in day.methods if name in seen[what]])}
    # A row has room for its name too.
    heights = [0.19 * max(len(shown), 5) for shown in rows.values()]
    figure, axes = new_figure(
        len(rows), len(names), width_in=2.6 + 2.45 * len(names), height_in=1.6 + sum(heights) + 0.4 * len(rows),
        title=experiment.title, sharey="row", gridspec_kw={"height_ratios": heights}, lines_in=float(np.mean(heights)),
        labels_in=widest_in(day.methods, 8.0), panel_mm=22.0,
    )  # fmt: skip
    norm = LogNorm(1.0 / int(day.rates.draws.max()), 1.0)
    for row, (what, shown) in enumerate(rows.items()):
        panels = axes[row * len(names) : (row + 1) * len(names)]
        for panel, name in zip(panels, names, strict=True):
            # Faulted satellites differ from geometry to geometry, their biases do not.
            if what == _AVAILABILITY:
                _bars(panel, day.overview[day.overview.geometry == name], shown)
            else:
                _rate_map(panel, day.rates[day.rates.geometry == name], what, shown, norm, ticks=4)
            panel.set_xlabel("share of draws" if what == _AVAILABILITY else "bias [m]", fontsize=8)
            panel.tick_params(labelsize=8)
        # Some fourteen letters an inch.
        heading = textwrap.fill(headings[list(seen).index(what)], max(12, int(14.0 * heights[row])))
        panels[0].set_ylabel(heading, fontsize=8.5)
        panels[0].set_yticks(range(len(shown)), shown, fontsize=8.0)
        panels[0].set_ylim(len(shown) - 0.5, -0.5)
    for panel, name in zip(axes, names, strict=False):
        panel.set_title(_heading(day, name), fontsize=8.5)
    unseen = _bound_of_none(int(day.rates.draws.min()))
    label = (
        f"share of draws at one bias; white, and methods that are not listed: none (95 % bound {unseen:.1e} or less)"
    )
    _colour_bar(figure, axes, norm, label, aspect=60, pad=0.01)
    return figure


def equal_figure(counted: Comparison, equal: Mapping[str, EqualTables], experiment: ByOneAxis) -> Figure:
    """Alarms and misleading information of tests at one false-alarm rate, against the bias, with 95 % intervals.

    Methods with the same counts everywhere share one curve. Tests whose measured rate is another one are left out.
    """
    tables = equal[counted.reference]
    title = f"{experiment.title}: tests at a false-alarm rate of {tables.p_fa:g}"
    figure, panels = new_figure(2, 1, width_in=9.0, height_in=8.0, title=title, sharex=True)
    unseen, styles = _bound_of_none(int(tables.rates.draws.min())), styles_of(short_names(equal))
    for panel, event in zip(panels, _TESTED, strict=True):
        for names, rows in same_curves(tables.comparable, event).items():
            label, style = ",\n".join(map(short_name, names)), styles[short_name(names[0])]
            _rate_curve(panel, rows, event, style, markersize=4.5, linewidth=1.2, capsize=2, label=label)
        panel.axhline(unseen, color="0.55", linewidth=0.8, linestyle=(0, (5, 3)))
        look: Any = {"shift": (0, 2), "ha": "right", "color": "0.35", "xycoords": ("axes fraction", "data")}
        note(panel, "95 % upper bound of none seen", (0.995, unseen), **look)
        panel.set(yscale="log", ylim=(0.3 * unseen, 1.6))
        legend_in(panel, loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8.0)
    panels[1].set(xlabel="bias [m]")
    panels[0].axhline(tables.p_fa, color="0.15", linewidth=1.0, linestyle=":")
    panels[0].set_title("P(alarm); dotted: the false-alarm rate")
    panels[1].set_title(experiment.decides.probability("misleading"))
    return figure


def several_equal_figure(day: Comparison, equal: Mapping[str, EqualTables], experiment: ByOneAxis) -> Figure:
    """Alarms and misleading information of tests at one false-alarm rate, a column for each geometry."""
    count, tests, p_fa = len(equal), short_names(equal), equal[day.reference].p_fa
    title = f"{experiment.title}: tests at a false-alarm rate of {p_fa:g}"
    figure, axes = new_figure(
        2, count, width_in=1.0 + 3.0 * count, height_in=7.4, title=title, sharex=True, sharey=True
    )
    styles = styles_of(tests)
    unseen = _bound_of_none(min(int(tables.rates.draws.min()) for tables in equal.values()))
    for column, (name, tables) in enumerate(equal.items()):
        panels = axes[column::count]
        for panel, event in zip(panels, _TESTED, strict=True):
            for method, rows in tables.comparable.groupby("method", sort=False):
                place = tests.index(short_name(str(method)))
                # Curves that lie on each other show through: later ones are smaller.
                size, width = 6.5 - 0.5 * place, 2.2 - 0.2 * place
                look = {"markersize": size, "linewidth": width, "label": tests[place]}
                _rate_curve(panel, rows, event, styles[tests[place]], **look)
            panel.set(yscale="log", ylim=(0.3 * unseen, 1.6))
        panels[0].axhline(p_fa, color="0.15", linewidth=1.0, linestyle=":")
        panels[0].set_title(_heading(day, name), fontsize=8.5)
        panels[1].set_xlabel("bias [m]")
    axes[0].set_ylabel("P(alarm); dotted: the false-alarm rate")
    axes[count].set_ylabel(experiment.decides.probability("misleading"))
    legend_below(figure, axes, columns=min(4, len(tests)), side="center", fontsize=8)
    return figure


def _headings(experiment: ByOneAxis) -> list[str]:
    judged = experiment.decides
    alarm, *others = (judged.probability(event) for event in _EVENTS)
    return [f"{alarm}, {judged.limits()}", *others, "PL ≤ AL, no fault"]


def _bars(panel: Axes, overview: pd.DataFrame, methods: Sequence[str]) -> None:
    """The availability of each method; bounds would be narrower than a line."""
    shares = overview.set_index("method").loc[methods].availability
    panel.barh(range(len(shares)), shares, height=0.62, color="0.78")
    for y, share in enumerate(shares):
        text = "100 %" if share == 1 else f"{100 * share:.2f} %" if share > 0.99 else f"{100 * share:.1f} %"
        note(panel, text, (0.0, y), shift=(4, 0), va="center", ha="left")
    panel.set(xlim=(0, 1), xticks=(0.0, 0.5, 1.0))
    panel.grid(visible=False)
    panel.tick_params(axis="y", length=0)


def _rate_map(panel: Axes, rates: pd.DataFrame, event: str, methods: Sequence[str], norm: LogNorm, ticks: int) -> None:
    """Rates by method and bias as colours."""
    faults = list(dict.fromkeys(rates.fault))
    values = rates.pivot(index="method", columns="fault", values=f"{event}_rate").loc[methods, faults].to_numpy()
    panel.imshow(np.ma.masked_less_equal(values, 0.0), aspect="auto", norm=norm, cmap=_COLOURS, interpolation="nearest")
    panel.grid(visible=False)
    panel.set_xticks(np.arange(-0.5, values.shape[1]), minor=True)
    panel.set_yticks(np.arange(-0.5, values.shape[0]), minor=True)
    panel.grid(which="minor", color="0.9", linewidth=0.4)
    panel.tick_params(which="minor", length=0)
    for edge in ("left", "bottom"):
        panel.spines[edge].set_visible(False)
    sizes = _drawn_bias(rates.drop_duplicates("fault"))
    step = max(1, round((len(faults) - 1) / ticks))
    panel.set_xticks(range(0, len(faults), step), [f"{size:g}" for size in sizes[::step]])


def _rate_curve(panel: Axes, rows: pd.DataFrame, event: str, style: SeriesStyle, **look: Any) -> Any:
    """Rates of one test with their intervals, where there are any."""
    rate = rows[f"{event}_rate"].where(rows[f"{event}_rate"] > 0)
    bars = bar_lengths(rate, rows[f"{event}_low"], rows[f"{event}_high"])
    look |= style.look
    return panel.errorbar(_drawn_bias(rows), rate, yerr=bars, **look)


def _colour_bar(figure: Figure, axes: Sequence[Axes], norm: LogNorm, label: str, **layout: Any) -> None:
    from matplotlib.cm import ScalarMappable

    colours = ScalarMappable(norm=norm, cmap=_COLOURS)
    bar = figure.colorbar(colours, ax=axes, location="bottom", shrink=0.5, **layout)
    bar.set_label(label)
    bar.outline.set_visible(False)


def _drawn_bias(rows: pd.DataFrame) -> np.ndarray:
    """Biases [m], zero without a fault."""
    return np.where(rows.fault == "none", 0.0, rows.bias_m)


def _bound_of_none(draws: int) -> float:
    """The 95 % upper bound of what no draw has shown."""
    return float(clopper_pearson(0, draws)[1])


def _heading(day: Comparison, name: str) -> str:
    row = day.geometries[day.geometries.geometry == name].iloc[0]
    seen = span(row.satellites_min, row.satellites_max)
    if row.epochs > 1:
        return f"{name}: {row.epochs} epochs, {seen} satellites\nworst satellite of each"
    at = "" if name.startswith("epoch ") else f", epoch {row.epoch}"
    return f"{name}{at}: {seen} satellites\n{row.faulted}, {_SIGMAS[day.dilution]} {metres(day.dilution_m(row)[0])} m"
