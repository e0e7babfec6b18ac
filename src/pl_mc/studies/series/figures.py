"""Figures of a series with faults in windows: satellites in view, position errors, protection levels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import EITHER, Judged
from pl_mc.report.accuracy import DIRECTIONS, ERRORS
from pl_mc.report.figures import legend_in, method_label, new_figure, note, shade, short_label
from pl_mc.report.look import styles_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# First and last epoch of each window with faults.
Windows = Sequence[tuple[int, int]]

_DARK, _LIGHT = "#0B3C5D", "#E69F00"

# Errors beyond the first make the scale logarithmic from the second on.
LARGEST_ON_LINEAR_M, LINEAR_TO_M = 50.0, 10.0
# Legends stand above the panel, where they hide nothing.
_ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}


def satellites_figure(table: pd.DataFrame, windows: Windows, *, title: str) -> Figure:
    """Number of satellites in view against the epoch (figures 1 and 2 of Zhao et al. 2021).

    ``table`` has ``epoch, time, satellites``.
    """
    from matplotlib.ticker import MaxNLocator

    first = table.drop_duplicates("epoch")
    figure, (axes,) = _over_epochs(table, windows, title=f"{title}: satellites in view", height_in=3.2)
    axes.step(first.epoch, first.satellites, where="mid", color=_DARK, linewidth=0.9)
    axes.set(ylabel="visible satellites", ylim=(0, first.satellites.max() + 3))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    legend_in(axes, loc="lower right")
    return figure


def position_errors_figure(table: pd.DataFrame, windows: Windows, *, method: str, title: str) -> Figure:
    """East, north and up errors of one method against the epoch, on one scale (figures 3, 4, 7 and 8).

    Where an error is over 50 m the scale is logarithmic beyond 10 m, so that the others can still be read.
    ``table`` has ``epoch, time, method, east_m, north_m, up_m``.
    """
    own = table[table.method == method]
    heading = f"{title}: position errors, {short_label(method)}"
    figure, panels = _over_epochs(own, windows, panels=3, title=heading, height_in=6.4)
    for axes, column, direction in zip(panels, ERRORS, DIRECTIONS, strict=True):
        axes.axhline(0.0, color="0.4", linewidth=0.6, zorder=1.2)
        axes.plot(own.epoch, own[column], color=styles_of(table.method)[method].colour, linewidth=0.6)
        axes.set_ylabel(f"{direction} error [m]")
    if own[ERRORS].abs().max().max() > LARGEST_ON_LINEAR_M:
        # Shared axes: what one is set to holds for all three.
        panels[0].set_yscale("symlog", linthresh=LINEAR_TO_M, linscale=1.0)
        sizes = (0.0, *(sign * size for size in (5, 10, 30, 100, 300, 1000) for sign in (-1, 1)))
        _label_ticks(panels[0], sizes, *panels[0].get_ylim())
        panels[1].set_ylabel(f"N error [m]\nlogarithmic beyond {LINEAR_TO_M:g} m")
    legend_in(panels[0], **_ABOVE)
    return figure


def level_words(judged: Judged) -> str:
    """``Vertical protection levels``."""
    return "Protection levels" if judged.axis == EITHER else f"{judged.axis.capitalize()} protection levels"


def levels_figure(table: pd.DataFrame, windows: Windows, *, judged: Judged, title: str) -> Figure:
    """Protection levels and their alert limits against the epoch, on a logarithmic scale (figures 5 and 9).

    ``table`` has ``epoch, time, method`` and the levels of the axis, each of which has a panel.
    """
    heading = f"{title}: {level_words(judged).lower()}"
    figure, panels = _over_epochs(
        table, windows, panels=len(judged.levels), title=heading, height_in=1.6 + 2.8 * len(judged.levels)
    )
    # The first method is drawn broad and pale behind, the second thin in front.
    looks: tuple[Any, ...] = ({"linewidth": 2.2, "alpha": 0.45}, {"linewidth": 0.6})
    styles = styles_of(table.method)
    for axes, (pl, name, limit_m), one in zip(panels, judged.levels, judged.called, strict=True):
        for look, (method, group) in zip(looks, table.groupby("method", sort=False), strict=True):
            label = method_label(str(method), judged.axis)
            axes.plot(group.epoch, group[f"{pl}_m"], color=styles[str(method)].colour, label=label, **look)
        axes.axhline(limit_m, color="0.1", linewidth=1.3, linestyle=(0, (6, 2)), label=f"{one.limit} {limit_m:g} m")
        axes.set(yscale="log", ylabel=f"{name} [m]")
        legend_in(axes, ncols=4, **_ABOVE)
    # The panels share one scale.
    level_m, limits = table[[f"{pl}_m" for pl, _, _ in judged.levels]].to_numpy(), [m for _, _, m in judged.levels]
    known = level_m[np.isfinite(level_m) & (level_m > 0)]
    ends = (min(known.min(), *limits) / 1.2, max(known.max(), *limits) * 1.2) if len(known) else (1.0, 2 * max(limits))
    panels[0].set_ylim(*ends)
    _label_ticks(panels[0], (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000), *ends)
    return figure


def flight_figure(flight: pd.DataFrame, *, title: str) -> Figure:
    """The flight seen from above, and its height and bank against the epoch.

    ``flight`` has ``epoch, latitude_deg, longitude_deg, height_m, bank_deg``.
    """
    from matplotlib.ticker import MaxNLocator

    heading = f"{title}: the flight"
    figure, (above, height, bank) = new_figure(1, 3, width_in=11.0, height_in=4.2, title=heading, panel_mm=55.0)
    above.plot(flight.longitude_deg, flight.latitude_deg, color=_DARK, linewidth=0.7)
    start = flight.iloc[:1]
    runway: dict[str, Any] = {"color": _LIGHT, "markeredgecolor": "0.1"}
    above.plot(start.longitude_deg, start.latitude_deg, linestyle="none", marker="o", **runway)
    note(
        above, "runway", (start.longitude_deg.iloc[0], start.latitude_deg.iloc[0]), shift=(0, -5), ha="center", va="top"
    )
    above.set(xlabel="longitude [deg]", ylabel="latitude [deg]")
    above.set_aspect(1 / np.cos(np.radians(flight.latitude_deg.mean())))
    above.ticklabel_format(useOffset=False)
    above.xaxis.set_major_locator(MaxNLocator(4))
    above.margins(y=0.12)
    height.plot(flight.epoch, flight.height_m, color=_DARK, linewidth=1.0)
    height.set(xlabel="epoch", ylabel="height above the ellipsoid [m]", ylim=(0, None))
    bank.plot(flight.epoch, flight.bank_deg, color=_DARK, linewidth=0.6)
    bank.set(ylabel="bank, right wing down [deg]", xlabel="epoch")
    return figure


def _over_epochs(
    table: pd.DataFrame, windows: Windows, *, title: str, height_in: float, panels: int = 1
) -> tuple[Figure, list[Axes]]:
    """Panels on one scale over the epochs of a table with ``epoch, time``; windows are shaded."""
    figure, axes = new_figure(panels, 1, width_in=8.0, height_in=height_in, title=title, sharex=True, sharey=True)
    for panel in axes:
        shade(panel, windows, "faulted epochs")
    first = table.drop_duplicates("epoch")
    step_s = (first.time.iloc[1] - first.time.iloc[0]).total_seconds() if len(first) > 1 else 0.0
    start = first.time.iloc[0].strftime("%Y-%m-%d %H:%M:%S")
    axes[-1].set_xlabel(f"epoch, one every {step_s:g} s from {start} (GPS time)")
    axes[-1].set_xlim(first.epoch.min(), first.epoch.max())
    return figure, axes


def _label_ticks(axes: Axes, values: Sequence[float], low: float, high: float) -> None:
    """Plain numbers on a logarithmic vertical axis, of those values that are within its limits."""
    ticks = [value for value in sorted(values) if low <= value <= high]
    axes.set_yticks(ticks, [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])
    axes.set_yticks([], minor=True)
