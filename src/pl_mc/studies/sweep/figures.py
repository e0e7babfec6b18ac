"""Figures of a sweep: levels and rates against the bias or fault by fault, satellites in rows, maps over time.

All take the axis that decides, with its limits, and a title.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import EITHER, Judged
from pl_mc.report.figures import bar_lengths, legend_in, limit_line, method_label, new_figure, note, widest_in
from pl_mc.report.look import SeriesStyle, look_now, styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _level_words(judged: Judged) -> str:
    return "protection level" if judged.axis == EITHER else f"{judged.axis} protection level"


# Height of an entry of a legend in a third of a page, as a share of the axes.
_ENTRY_HEIGHT = 0.08


def ramp_figure(
    rates: pd.DataFrame, levels: pd.DataFrame, exact: pd.DataFrame, *, judged: Judged, title: str
) -> Figure:
    """Protection levels, alarm rates and rates of misleading information against a bias.

    Args:
        rates: a sweep's table for one epoch, or summed over epochs, with one row per method and bias.
        levels: quantiles of the levels by method and bias: ``method, bias_m, vpl_05_m, vpl_50_m, vpl_95_m``, and
            of ``hpl`` likewise.
        exact: rates of least squares in closed form, on a finer grid: ``bias_m, alarm_rate, misleading_rate``; none
            where there is no closed form.
    """
    figure, (top, middle, bottom) = new_figure(3, 1, width_in=7.2, height_in=9.0, title=title, sharex=True)
    for label, style, group in _by_method(levels, judged):
        for k, (pl, name, _) in enumerate(judged.levels):
            low, middle_m, high = (group[f"{pl}_{part}_m"] for part in ("05", "50", "95"))
            top.fill_between(group.bias_m, low, high, color=style.colour, alpha=0.2, linewidth=0)
            top.plot(
                group.bias_m, middle_m, style.line if k == 0 else ":", marker=style.marker, markersize=4,
                color=style.colour, markerfacecolor="none" if k else None,
                label=f"{label}{_of(judged, name)}, median and 5-95 %",
            )  # fmt: skip
    _limit_lines(top, judged)
    top.set(ylabel=f"{_level_words(judged)} [m]", ylim=(0, None))
    top.set_title("Protection level")
    # The legend stands above every line of a limit.
    entries = len(top.get_legend_handles_labels()[1])
    below = 0.96 - _ENTRY_HEIGHT * entries
    top.set_ylim(0, max(top.get_ylim()[1], *(limit / below for _, _, limit in judged.levels)))
    legend_in(top, loc="upper left")

    for axes, event, curve in (
        (middle, "alarm", exact), (bottom, "misleading", exact[exact.misleading_rate > 1e-12]),
    ):  # fmt: skip
        for label, style, group in _by_method(rates, judged):
            _rate_points(axes, group, event, style, label)
        rate = curve[f"{event}_rate"]
        if len(curve):
            axes.plot(curve.bias_m, rate, color="0.25", linewidth=0.9, label="least squares, exact")
    middle.set(ylabel=f"P(alarm), {judged.limits()}", ylim=(-0.03, 1.05))
    middle.set_title("Alarms, with 95 % intervals")
    legend_in(middle, loc="center right")
    for one in judged.called:
        bottom.axhline(one.promise, color="0.15", linewidth=1.0, linestyle=":")
        note(
            bottom, f"{one.promised}, what {one.multiplier} stands for", (0.995, one.promise), shift=(0, 2),
            xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8.5, color="0.15",
        )  # fmt: skip
    bottom.set(yscale="log", ylabel=judged.probability("misleading"), xlabel="bias [m]")
    bottom.set_ylim(0.01 * min(one.promise for one in judged.called), 2.0)
    bottom.set_title("Misleading information (arrow: 95 % upper bound where nothing was seen)")
    legend_in(bottom, loc="best", ncols=2)
    return figure


def rates_by_fault_figure(rates: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """Alarm rates and rates of misleading information fault by fault, for faults that are no ramp.

    Args:
        rates: a table with one row per method and fault.
    """
    place = {fault: k for k, fault in enumerate(dict.fromkeys(rates.fault))}
    count = rates.method.nunique()
    height_in = 1.6 + 0.32 * len(place) * count
    figure, (left, right) = new_figure(
        1, 2, width_in=9.0, height_in=height_in, title=title, sharey=True, lines_in=height_in - 1.6,
        labels_in=widest_in(place),
    )  # fmt: skip
    for k, (label, style, group) in enumerate(_by_method(rates, judged)):
        y = group.fault.map(place) + 0.6 * ((k + 0.5) / count - 0.5)
        for axes, event in ((left, "alarm"), (right, "misleading")):
            axes.hlines(y, group[f"{event}_low"], group[f"{event}_high"], color=style.colour, linewidth=1.5)
            axes.plot(
                group[f"{event}_rate"], y, linestyle="none", marker=style.marker, markersize=5, color=style.colour,
                label=label,
            )  # fmt: skip
    left.set(yticks=range(len(place)), yticklabels=place, xlabel=f"P(alarm), {judged.limits()}")
    left.invert_yaxis()
    right.set(xlabel=judged.probability("misleading"))
    left.set_title("Alarms, with 95 % intervals")
    right.set_title("Misleading information")
    legend_in(right, loc="best")
    return figure


def realisation_figure(outcomes: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """The level of every method against the bias for one noise draw, as figure 6 of Zhao et al. 2021 shows it.

    Args:
        outcomes: one draw's rows of `pl_mc.sample`: ``method, bias_m, vpl_m, hpl_m``.
    """
    figure, (axes,) = new_figure(1, 1, width_in=7.2, height_in=4.2)
    for label, style, group in _by_method(outcomes, judged):
        for k, (pl, name, _) in enumerate(judged.levels):
            axes.plot(
                group.bias_m, group[f"{pl}_m"], style.line if k == 0 else ":", marker=style.marker, markersize=4.5,
                color=style.colour, label=f"{label}{_of(judged, name)}",
            )  # fmt: skip
    _limit_lines(axes, judged)
    axes.set(xlabel="bias [m]", ylabel=f"{_level_words(judged)} [m]", ylim=(0, None))
    axes.set_title(f"{title}; one noise draw")
    legend_in(axes, loc="upper left")
    return figure


def satellite_figure(rates: pd.DataFrame, satellites: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """Alarm rate and rate of misleading information by satellite and bias, one column of panels per method.

    Args:
        rates: a sweep's table with the column ``satellite``.
        satellites: ``satellite, elevation_deg, redundancy``.
    """
    from matplotlib.colors import LogNorm, Normalize

    methods = list(dict.fromkeys(rates.method))
    facts = satellites.sort_values("redundancy").set_index("satellite")
    labels = [f"{row.Index}  r {row.redundancy:.2f}  {row.elevation_deg:2.0f}°" for row in facts.itertuples()]
    height_in = 1.6 + 0.42 * len(labels)
    figure, axes = new_figure(
        2, len(methods), width_in=4.3 * len(methods) + 0.8, height_in=height_in, sharex=True, sharey=True,
        lines_in=0.19 * len(labels), labels_in=widest_in(labels, 7.5),
        title=f"{title}; every satellite, sorted by redundancy number r (elevation)",
    )  # fmt: skip
    floor = 0.5 / rates.draws.max()
    for row, (event, heading, norm) in enumerate(
        (
            ("alarm", f"P(alarm), {judged.limits()}", Normalize(0.0, 1.0)),
            ("misleading", judged.probability("misleading"), LogNorm(floor, 1.0)),
        )
    ):
        panels = axes[row * len(methods) : (row + 1) * len(methods)]
        for panel, method in zip(panels, methods, strict=True):
            grid = rates[rates.method == method].pivot(index="satellite", columns="bias_m", values=f"{event}_rate")
            values = grid.loc[facts.index].to_numpy()
            # What was never seen is grey whatever the event.
            seen = np.ma.masked_less_equal(values, 0.0)
            image = panel.pcolormesh(grid.columns, np.arange(len(labels)), seen, norm=norm, cmap="viridis")
            panel.grid(visible=False)
            panel.set_facecolor("0.93")
            panel.set_title(f"{method_label(method, judged.axis)}: {event}")
        panels[0].set_yticks(np.arange(len(labels)), labels, family="monospace", fontsize=7.5)
        if look_now().width_in is None:
            figure.colorbar(image, ax=panels, label=heading, pad=0.01)
        else:
            # Methods may stand below each other.
            figure.colorbar(image, ax=axes, label=heading, location="bottom", aspect=30, pad=0.01)
    for panel in panels:
        panel.set_xlabel("bias [m]; grey: none seen" if panel is panels[0] else "bias [m]")
    return figure


def map_figure(rates: pd.DataFrame, *, event: str, judged: Judged, title: str) -> Figure:
    """The rate of one event by epoch and faulted satellite, averaged over the ramp; one panel per method.

    Args:
        rates: ``epoch, satellite, method, draws``, ``<event>_rate`` and ``<event>_high``.
        event: ``alarm``, ``missed`` or ``misleading``.
    """
    from matplotlib.colors import LogNorm, Normalize

    methods = list(dict.fromkeys(rates.method))
    satellites = sorted(rates.satellite.unique(), key=lambda name: ("GCER".index(name[0]), name))
    places = np.arange(len(satellites))
    height_in = 1.0 + (1.0 + 0.115 * len(satellites)) * len(methods)
    meaning = judged.probability(event)
    figure, axes = new_figure(
        len(methods), 1, width_in=9.0, height_in=height_in, sharex=True, lines_in=0.145 * len(satellites),
        title=f"{title}: {meaning}, mean over the biases; {judged.limits()}",
    )  # fmt: skip
    column = f"{event}_rate"
    floor = 0.5 / rates.draws.max()
    norm = Normalize(0.0, 1.0) if event == "alarm" else LogNorm(floor, max(float(rates[column].max()), 10 * floor))
    for panel, method in zip(axes, methods, strict=True):
        part = rates[rates.method == method]
        grid = part.pivot(index="satellite", columns="epoch", values=column).reindex(index=satellites)
        values = grid.to_numpy()
        # White is out of view, grey is in view with nothing seen.
        panel.pcolormesh(
            grid.columns, places, np.where(np.isfinite(values), 0.0, np.nan), cmap="gray", vmin=-7.0, vmax=0.5,
            shading="nearest", rasterized=True,
        )  # fmt: skip
        shown = np.ma.masked_less_equal(np.nan_to_num(values), 0)
        image = panel.pcolormesh(
            grid.columns, places, shown, norm=norm, cmap="viridis", shading="nearest", rasterized=True
        )
        panel.grid(visible=False)
        panel.set_yticks(places, satellites, fontsize=6)
        panel.invert_yaxis()
        bound = f"none seen, below {part[f'{event}_high'].max():.2g} in each cell (95 % bound)"
        panel.set_title(method_label(method, judged.axis) + ("" if np.nanmax(values) > 0 else f": {bound}"))
    axes[-1].set_xlabel("epoch; grey: in view, none seen")
    if rates[column].max() > 0:
        figure.colorbar(image, ax=axes, label=meaning, pad=0.01)
    return figure


def _of(judged: Judged, level: str) -> str:
    """Which level a curve is of, where both are drawn."""
    return f", {level}" if judged.axis == EITHER else ""


def _limit_lines(axes: Axes, judged: Judged) -> None:
    lowest_m = min(limit_m for _, _, limit_m in judged.levels)
    for (_, _, limit_m), words in zip(judged.levels, judged.limits().split(", "), strict=True):
        # The name of the lower of two stands below its line.
        below: dict[str, Any] = {"va": "top", "shift": (0, -2)} if judged.axis == EITHER and limit_m == lowest_m else {}
        limit_line(axes, limit_m, words, **below)


def _by_method(table: pd.DataFrame, judged: Judged) -> Iterator[tuple[str, SeriesStyle, pd.DataFrame]]:
    """Label, style and rows of each method, in order."""
    styles = styles_of(table.method)
    for name, group in table.groupby("method", sort=False):
        yield method_label(str(name), judged.axis), styles[str(name)], group


def _rate_points(axes: Axes, group: pd.DataFrame, event: str, style: SeriesStyle, label: str) -> None:
    """Rates with their bounds; where the count of a rare event is zero, an arrow down from the upper bound."""
    rate, low, high = (group[f"{event}_{part}"] for part in ("rate", "low", "high"))
    seen = (rate > 0) | (event != "misleading")
    if seen.any():
        axes.errorbar(
            group.bias_m[seen], rate[seen], yerr=bar_lengths(rate[seen], low[seen], high[seen]), linestyle="none",
            marker=style.marker, markersize=4, color=style.colour, linewidth=1.2, capsize=2, label=label,
        )  # fmt: skip
    if not seen.all():
        bound = high[~seen]
        axes.errorbar(
            group.bias_m[~seen], bound, yerr=0.5 * bound, uplims=True, linestyle="none", marker=style.marker,
            markersize=4, markerfacecolor="none", color=style.colour, label=f"{label}, upper bound",
        )  # fmt: skip
