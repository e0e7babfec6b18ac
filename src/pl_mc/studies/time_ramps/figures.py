"""Figures of an experiment about ramps in time: errors and delays at the alarm, and shares of late alarms."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import Judged
from pl_mc.report.figures import bar_lengths, legend_below, legend_key, limit_line, new_figure
from pl_mc.report.look import SeriesStyle, styles_of
from pl_mc.report.text import grouped
from pl_mc.time_ramps.timing import LIMITS_S

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_UNSEEN: Any = {"color": "0.45", "linestyle": "", "marker": "v", "markerfacecolor": "none"}


def same_methods(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """Methods in order, those together whose counts and quantiles are the same in every row."""
    left = [column for column in table.columns if column not in ("method", "axis", "threshold")]
    # Equal but for rounding.
    counted = (
        (tuple(f"{value:.9g}" for value in rows[left].to_numpy().flat), str(name))
        for name, rows in table.groupby("method", sort=False)
    )
    return [tuple(names) for names in grouped(counted).values()]


def alert_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """The median error at the alarm, and the delay of the alarm that 95 % of passes keep, against the rate.

    Where a curve of the table of `pl_mc.time_to_alert` stops 5 % (half, in the upper panels) of the passes or more
    had no alarm before the end.
    """
    ramps, (called,), ((_, _, limit_m),) = table[table.rate_m_per_s > 0], judged.called, judged.levels
    taus, groups = list(dict.fromkeys(ramps.tau_s)), same_methods(table)
    figure, axes = new_figure(
        2, len(taus), width_in=4.7 * len(taus) + 0.6, height_in=8.4, title=title, sharex=True, sharey="row"
    )
    for tau, upper, lower in zip(taus, axes, axes[len(taus) :], strict=False):
        for method, style in _styles(groups).items():
            rows = ramps[(ramps.tau_s == tau) & (ramps.method == method)]
            heard = rows[rows.detected_rate >= 0.5]
            line(upper, heard.rate_m_per_s, heard.error_at_alert_50_m, style)
            kept = rows[np.isfinite(rows.alert_after_hazard_95_s)]
            line(lower, kept.rate_m_per_s, kept.alert_after_hazard_95_s, style)
        upper.set(xscale="log", yscale="log")
        upper.set_title(f"{_heading(tau)}: median error at the alarm [m]")
        limit_line(upper, limit_m, judged.limits())
        lower.set_yscale("symlog", linthresh=10.0, linscale=0.8)
        plain_ticks(lower.yaxis, (-1000, -100, -10, 0, 10, 100, 1000))
        lower.set_title(f"{_heading(tau)}: alarm after the error passed {called.limit} [s], 95 %")
        lower.set_xlabel("rate of the ramp [m/s]")
        # Room for the names of the limits.
        lower.set_xlim(0.75 * float(ramps.rate_m_per_s.min()), 2.6 * float(ramps.rate_m_per_s.max()))
        for limit in LIMITS_S:
            limit_line(lower, limit, f"{limit} s", width=0.9, shift=(0, 0), fontsize=7.5)
    plain_ticks(axes[0].yaxis, (2, 5, 10, 20, 50, 100, 200, 500))
    _legend(figure, groups)
    return figure


def late_figure(table: pd.DataFrame, *, title: str) -> Figure:
    """The share of passes whose alarm is later than each limit after the error passed its limit, against the rate.

    Open triangles are 95 % upper bounds where no alarm was late; the table is that of `pl_mc.time_to_alert`.
    """
    ramps = table[(table.rate_m_per_s > 0) & (table.hazards > 0)]
    taus, groups = list(dict.fromkeys(ramps.tau_s)), same_methods(table)
    figure, axes = new_figure(
        len(taus), len(LIMITS_S), width_in=12.6, height_in=3.5 * len(taus) + 1.5, title=title, sharex=True,
        sharey=True,
    )  # fmt: skip
    for panel, (tau, limit) in zip(axes, ((tau, limit) for tau in taus for limit in LIMITS_S), strict=True):
        for method, style in _styles(groups).items():
            rows = ramps[(ramps.tau_s == tau) & (ramps.method == method)]
            seen = rows[f"late_{limit}"] > 0
            # A line ends where nothing was seen.
            value = rows[f"late_{limit}_rate"].where(seen)
            bars = bar_lengths(value, rows[f"late_{limit}_low"], rows[f"late_{limit}_high"])
            look: Any = {"fmt": "none", "ecolor": style.colour, "elinewidth": 0.9, "zorder": 2.0}
            panel.errorbar(rows.rate_m_per_s, value, yerr=bars, **look)
            line(panel, rows.rate_m_per_s, value, style)
            # Every method has as many passes, and so the same bound.
            none = rows[~seen]
            panel.plot(none.rate_m_per_s, none[f"late_{limit}_high"], **_UNSEEN, markersize=5.0, zorder=1.8)
        panel.set(xscale="log", yscale="log", ylim=(0.3 / float(ramps.passes.max()), 1.5))
        panel.set_title(f"{_heading(tau)}: P(alarm later than {limit} s)")
        if tau == taus[-1]:
            panel.set_xlabel("rate of the ramp [m/s]")
    _legend(figure, groups, legend_key("none seen: upper bound", markersize=5, **_UNSEEN))
    return figure


def line(panel: Axes, x: pd.Series, y: pd.Series, style: SeriesStyle) -> None:
    """A curve of one method."""
    panel.plot(x, y, **style.look, markersize=4.2, linewidth=1.3, zorder=2.5)


def plain_ticks(axis: Axis, places: Sequence[float]) -> None:
    """Ticks at these places and no others, as plain numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    axis.set_major_locator(FixedLocator(places))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _heading(tau: float) -> str:
    return "white errors" if tau == 0 else f"tau {tau:g} s"


def _styles(groups: list[tuple[str, ...]]) -> dict[str, SeriesStyle]:
    """The style of the first method of each group."""
    return styles_of(group[0] for group in groups)


def _legend(figure: Figure, groups: list[tuple[str, ...]], *more: Line2D) -> None:
    names = ["\n".join(textwrap.wrap(" = ".join(group), 44)) for group in groups]
    styles = _styles(groups).values()
    keys = [legend_key(name, markersize=5, **style.look) for name, style in zip(names, styles, strict=True)]
    legend_below(figure, columns=3, side="center", keys=[*keys, *more])
