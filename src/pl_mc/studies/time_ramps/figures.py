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
from pl_mc.statistics.intervals import clopper_pearson
from pl_mc.time_ramps.timing import LIMITS_S

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# So few rates are named one by one.
_FEW_RATES = 3
# From method to method, as a factor of the rate.
_ASIDE = 1.05


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
            _bars(upper, heard, "error_at_alert_50{}_m", style)
            kept = rows[np.isfinite(rows.alert_after_hazard_95_s)]
            _bars(lower, kept, "alert_after_hazard_95{}_s", style)
        upper.set(xscale="log", yscale="log")
        upper.set_title(_heading(tau))
        limit_line(upper, limit_m, judged.limits())
        lower.set_yscale("symlog", linthresh=10.0, linscale=0.8)
        plain_ticks(lower.yaxis, (-1000, -100, -10, 0, 10, 100, 1000))
        lower.set_xlabel("rate of the ramp [m/s]")
        # Room for the names of the limits.
        lower.set_xlim(0.75 * float(ramps.rate_m_per_s.min()), 2.6 * float(ramps.rate_m_per_s.max()))
        for limit in LIMITS_S:
            limit_line(lower, limit, f"{limit} s", width=0.9, shift=(0, 0), fontsize=7.5)
    plain_ticks(axes[0].yaxis, (2, 5, 10, 20, 50, 100, 200, 500))
    axes[0].set_ylabel("median error at the alarm [m]")
    axes[len(taus)].set_ylabel(f"from error = {called.limit} to 95 % of alarms [s]")
    _legend(figure, groups)
    return figure


def late_figure(table: pd.DataFrame, *, title: str) -> Figure:
    """The share of passes whose alarm is later than each limit after the error passed its limit, against the rate.

    Rates beyond the last one with a late alarm but one are left out; methods stand a little beside each other, so that
    all bars are seen. The table is that of `pl_mc.time_to_alert`.
    """
    ramps = table[(table.rate_m_per_s > 0) & (table.hazards > 0)]
    rates = np.unique(ramps.rate_m_per_s)
    late = ramps.rate_m_per_s[ramps[[f"late_{limit}" for limit in LIMITS_S]].gt(0).any(axis=1)]
    ramps = ramps[ramps.rate_m_per_s <= rates[rates > late.max()].min(initial=rates[-1])]
    taus, groups = list(dict.fromkeys(ramps.tau_s)), same_methods(table)
    figure, axes = new_figure(
        len(taus), len(LIMITS_S), width_in=12.6, height_in=3.5 * len(taus) + 1.5, title=title, sharex=True,
        sharey=True, panel_mm=27.0,
    )  # fmt: skip
    # Every method has as many passes, and so nearly the same bound where nothing was seen.
    unseen = float(clopper_pearson(0, int(ramps.hazards.max()))[1])
    bound: Any = {"color": "0.45", "linewidth": 0.8, "linestyle": ":"}
    for panel, (tau, limit) in zip(axes, ((tau, limit) for tau in taus for limit in LIMITS_S), strict=True):
        for k, (method, style) in enumerate(_styles(groups).items()):
            rows = ramps[(ramps.tau_s == tau) & (ramps.method == method)]
            # A line ends where nothing was seen.
            rows = rows[rows[f"late_{limit}"] > 0]
            aside = rows.assign(
                rate_m_per_s=rows.rate_m_per_s * _ASIDE ** (k - (len(groups) - 1) / 2.0),
                late=rows[f"late_{limit}_rate"], late_low=rows[f"late_{limit}_low"],
                late_high=rows[f"late_{limit}_high"],
            )  # fmt: skip
            _bars(panel, aside, "late{}", style)
        panel.axhline(unseen, **bound)
        panel.set(xscale="log", yscale="log", ylim=(0.3 / float(ramps.passes.max()), 1.5))
        if ramps.rate_m_per_s.nunique() <= _FEW_RATES:
            plain_ticks(panel.xaxis, list(np.unique(ramps.rate_m_per_s)))
        panel.set_xlim(0.7 * ramps.rate_m_per_s.min(), 1.4 * ramps.rate_m_per_s.max())
        panel.set_title(f"{_heading(tau)}: later than {limit} s")
        if tau == taus[-1]:
            panel.set_xlabel("rate of the ramp [m/s]")
    for panel in axes[:: len(LIMITS_S)]:
        panel.set_ylabel("share of passes")
    _legend(figure, groups, legend_key("95 % upper bound of none seen", **bound))
    return figure


def _bars(panel: Axes, rows: pd.DataFrame, column: str, style: SeriesStyle) -> None:
    """A curve with its intervals; ``column`` has a place for ``_low`` and ``_high``."""
    value, low, high = (rows[column.format(end)] for end in ("", "_low", "_high"))
    bars = np.where(np.isfinite(bar_lengths(value, low, high)), bar_lengths(value, low, high), 0.0)
    look: Any = {"fmt": "none", "ecolor": style.colour, "elinewidth": 0.9, "zorder": 2.0}
    panel.errorbar(rows.rate_m_per_s, value, yerr=bars, **look)
    line(panel, rows.rate_m_per_s, value, style)


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
