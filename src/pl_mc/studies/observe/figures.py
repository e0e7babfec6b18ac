"""Figures of observations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import Judged
from pl_mc.report.figures import legend_below, limit_line, method_label, new_figure, shade
from pl_mc.report.look import look_now, styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Lines of so few epochs have points; further apart than so many steps epochs are missing; levels up to so many times
# the limit are drawn on a linear axis.
_FEW_EPOCHS = 60
_STEPS_WITHOUT_GAP = 1.5
_LINEAR_UP_TO = 4.0
# Dates on an axis in print.
_NARROW_TICKS = 5
# Lines that are told apart in grey.
_DASHES: tuple[Any, ...] = ((0, (2, 1)), (0, (6, 2)), (0, (1, 1.5)), (0, (6, 1.5, 1, 1.5)))


def error_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """East, north and up errors and levels against time, method by method, faulted epochs shaded.

    ``table`` has ``epoch, time, method, east_m, north_m, up_m, vpl_m, hpl_m, faulted``. Levels are drawn in
    full; where some are far beyond the limit, on a logarithmic axis.
    """
    panels = 3 + len(judged.levels)
    figure, axes = new_figure(panels, 1, width_in=8.0, height_in=2.25 * panels, title=title, sharex=True)
    windows, step, styles = faulted_windows(table), longest_step(table), styles_of(table.method)
    labels = {"east_m": "east error", "north_m": "north error", "up_m": "up error"}
    labels |= {f"{pl}_m": name for pl, name, _ in judged.levels}
    for panel, (column, label) in zip(axes, labels.items(), strict=True):
        shade(panel, windows, "faulted epochs")
        for k, (method, group) in enumerate(table.groupby("method", sort=False)):
            # Least squares lies below in a lighter line, so that both stay visible where they agree.
            line, width, alpha = ("-", 1.3, 0.55) if k == 0 else (_DASHES[(k - 1) % len(_DASHES)], 0.8, 1.0)
            # A line ends where epochs are missing, and goes on after them.
            parts = (group.time.diff() > step).cumsum()
            for j, (_, part) in enumerate(group.groupby(parts)):
                panel.plot(
                    part.time, part[column], linestyle=line, color=styles[str(method)].colour, linewidth=width,
                    alpha=alpha, label=method_label(str(method), judged.axis) if j == 0 else None,
                    marker="." if len(part) < _FEW_EPOCHS else None,
                )  # fmt: skip
        panel.set_ylabel(f"{label} [m]")
        panel.margins(x=0.01)
    for panel, (pl, _, limit_m), one in zip(axes[3:], judged.levels, judged.called, strict=True):
        level_m = table[f"{pl}_m"]
        _levels(panel, level_m[np.isfinite(level_m)], limit_m, one.limit)
    time_axis(axes[-1], table.time)
    legend_below(figure, axes[:1], columns=4)
    return figure


def time_axis(panel: Axes, times: pd.Series | pd.DatetimeIndex) -> None:
    """The horizontal axis in GPS time, with the days."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    narrow = look_now().width_in is not None
    dates, ends = AutoDateLocator(maxticks=_NARROW_TICKS if narrow else None), pd.DatetimeIndex(times)[[0, -1]]
    panel.xaxis.set_major_locator(dates)
    form = ConciseDateFormatter(dates, show_offset=False)
    form.formats[5] = "%H:%M:%S"
    if ends[1] - ends[0] <= pd.Timedelta(days=1):
        form.zero_formats[3] = "%H:%M"
    panel.xaxis.set_major_formatter(form)
    first, last = (f"{time:%Y-%m-%d}" for time in ends)
    panel.set_xlabel(f"GPS time, {first if first == last else f'{first} to {last}'}")


def _levels(panel: Axes, level_m: pd.Series, limit_m: float, name: str) -> None:
    """The limit, and an axis on which every level is."""
    largest_m = max(float(level_m.max()) if len(level_m) else 0.0, limit_m)
    if largest_m > _LINEAR_UP_TO * limit_m:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_ylim(top=1.3 * largest_m)
    else:
        panel.set_ylim(0.0, 1.12 * largest_m)
    limit_line(panel, limit_m, f"{name} {limit_m:g} m")


def longest_step(table: pd.DataFrame) -> pd.Timedelta:
    """Epochs further apart than this have others between them that are missing."""
    steps = table.time.drop_duplicates().diff().dropna()
    return pd.Timedelta(days=1) if steps.empty else _STEPS_WITHOUT_GAP * steps.median()


def faulted_windows(table: pd.DataFrame) -> list[tuple[pd.Timestamp, pd.Timestamp]]:
    """First and last time of each run of faulted epochs, with half a step on both sides."""
    epochs = table.drop_duplicates("epoch").assign(faulted=table.groupby("epoch").faulted.any().to_numpy())
    half = longest_step(table) / (2 * _STEPS_WITHOUT_GAP)
    runs = (epochs.faulted != epochs.faulted.shift()).cumsum()[epochs.faulted]
    times = epochs.time[epochs.faulted].groupby(runs)
    return [(run.iloc[0] - half, run.iloc[-1] + half) for _, run in times]
