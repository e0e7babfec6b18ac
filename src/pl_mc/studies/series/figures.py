"""Figures of a series with faults in windows: satellites in view, position errors, protection levels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, method_label, new_figure, shade

Windows = Sequence[tuple[int, int]]

# Dark on light, so that a series in front of another stays apart from it in grey too.
_FRONT, _BACK = "#0B3C5D", "#E69F00"

# Errors beyond the first make the scale logarithmic from the second on.
LARGEST_ON_LINEAR_M, LINEAR_TO_M = 50.0, 10.0


@in_common_look
def satellites_figure(table: pd.DataFrame, *, windows: Windows, title: str) -> Figure:
    """Number of satellites in view against the epoch (figures 1 and 2 of Zhao et al. 2021).

    Args:
        table: ``epoch, time, method, satellites``.
        windows: first and last epoch of each window with faults.
        title: heading.
    """
    first = table.drop_duplicates("epoch")
    figure, (axes,) = new_figure(1, 1, width_in=8.0, height_in=3.2)
    figure.suptitle(f"{title}: satellites in view", x=0.01, ha="left", fontsize=11)
    _shade_windows(axes, windows)
    axes.step(first.epoch, first.satellites, where="mid", color=_FRONT, linewidth=0.9)
    axes.set(ylabel="visible satellites", ylim=(0, first.satellites.max() + 3))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    _epoch_axis(axes, first)
    axes.legend(loc="lower right")
    return figure


@in_common_look
def position_errors_figure(table: pd.DataFrame, *, method: str, windows: Windows, title: str) -> Figure:
    """East, north and up errors of one method against the epoch, on one scale (figures 3, 4, 7 and 8).

    Where an error is over 50 m the scale is logarithmic beyond 10 m, so that the others can still be read.

    Args:
        table: ``epoch, time, method, east_m, north_m, up_m``.
        method: the method.
        windows: first and last epoch of each window with faults.
        title: heading.
    """
    mine = table[table.method == method]
    figure, panels = new_figure(3, 1, width_in=8.0, height_in=6.4, sharex=True, sharey=True)
    name = method_label(method).split(" (")[0]
    figure.suptitle(f"{title}: position errors, {name}", x=0.01, ha="left", fontsize=11)
    for axes, column, direction in zip(panels, ("east_m", "north_m", "up_m"), ("E", "N", "U"), strict=True):
        _shade_windows(axes, windows)
        axes.axhline(0.0, color="0.4", linewidth=0.6, zorder=1.2)
        axes.plot(mine.epoch, mine[column], color=_FRONT, linewidth=0.6)
        axes.set_ylabel(f"{direction} error [m]")
    if mine[["east_m", "north_m", "up_m"]].abs().max().max() > LARGEST_ON_LINEAR_M:
        # Shared axes: what one is set to holds for all three.
        panels[0].set_yscale("symlog", linthresh=LINEAR_TO_M, linscale=1.0)
        ticks = [0.0, *(sign * size for size in (5, 10, 30, 100, 300, 1000) for sign in (-1, 1))]
        low, high = panels[0].get_ylim()
        ticks = [tick for tick in sorted(ticks) if low <= tick <= high]
        panels[0].set_yticks(ticks, [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])
        panels[0].set_yticks([], minor=True)
        panels[1].set_ylabel(f"N error [m]\nlogarithmic beyond {LINEAR_TO_M:g} m")
    _epoch_axis(panels[-1], mine)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return figure


@in_common_look
def levels_figure(table: pd.DataFrame, *, windows: Windows, alert: AlertLimits, title: str) -> Figure:
    """Vertical protection levels and VAL against the epoch, on a logarithmic scale (figures 5 and 9).

    Args:
        table: ``epoch, time, method, vpl_m``.
        windows: first and last epoch of each window with faults.
        alert: alert limits.
        title: heading.
    """
    figure, (axes,) = new_figure(1, 1, width_in=8.0, height_in=4.4)
    figure.suptitle(f"{title}: vertical protection levels", x=0.01, ha="left", fontsize=11)
    _shade_windows(axes, windows)
    # The first method is drawn broad and light behind, the second thin and dark in front.
    looks = ((_BACK, 2.2), (_FRONT, 0.6))
    for k, (method, group) in enumerate(table.groupby("method", sort=False)):
        colour, width = looks[min(k, 1)]
        axes.plot(group.epoch, group.vpl_m, color=colour, linewidth=width, label=method_label(str(method)))
    axes.axhline(
        alert.vertical_m, color="0.1", linewidth=1.3, linestyle=(0, (6, 2)), label=f"VAL {alert.vertical_m:g} m"
    )
    known = table.vpl_m[np.isfinite(table.vpl_m) & (table.vpl_m > 0)]
    low, high = 1.0, 2 * alert.vertical_m
    if len(known):
        low, high = min(known.min(), alert.vertical_m) / 1.2, max(known.max(), alert.vertical_m) * 1.2
    axes.set(yscale="log", ylabel="VPL [m]", ylim=(low, high))
    ticks = np.array([0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000])
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    _epoch_axis(axes, table)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
    return figure


@in_common_look
def flight_figure(flight: pd.DataFrame, *, title: str) -> Figure:
    """The flight seen from above, and its height and bank against the epoch.

    Args:
        flight: ``epoch, latitude_deg, longitude_deg, height_m, bank_deg``.
        title: heading.
    """
    figure, (above, height, bank) = new_figure(1, 3, width_in=11.0, height_in=4.2)
    figure.suptitle(f"{title}: the flight", x=0.01, ha="left", fontsize=11)
    above.plot(flight.longitude_deg, flight.latitude_deg, color=_FRONT, linewidth=0.7)
    above.plot(
        flight.longitude_deg.iloc[0], flight.latitude_deg.iloc[0], linestyle="none", marker="o", color=_BACK,
        markeredgecolor="0.1", label="runway",
    )  # fmt: skip
    above.set(xlabel="longitude [deg]", ylabel="latitude [deg]")
    above.set_aspect(1 / np.cos(np.radians(flight.latitude_deg.mean())))
    above.ticklabel_format(useOffset=False)
    above.xaxis.set_major_locator(MaxNLocator(4))
    above.legend(loc="lower right")
    height.plot(flight.epoch, flight.height_m, color=_FRONT, linewidth=1.0)
    height.set(xlabel="epoch", ylabel="height above the ellipsoid [m]", ylim=(0, None))
    bank.plot(flight.epoch, flight.bank_deg, color=_FRONT, linewidth=0.6)
    bank.set(ylabel="bank, right wing down [deg]", xlabel="epoch")
    return figure


def _shade_windows(axes: Axes, windows: Windows) -> None:
    shade(axes, windows, "faulted epochs")


def _epoch_axis(axes: Axes, table: pd.DataFrame) -> None:
    """The horizontal axis: epochs, and what they are in time."""
    first = table.drop_duplicates("epoch")
    step_s = (first.time.iloc[1] - first.time.iloc[0]).total_seconds() if len(first) > 1 else 0.0
    start = first.time.iloc[0].strftime("%Y-%m-%d %H:%M:%S")
    axes.set_xlabel(f"epoch, one every {step_s:g} s from {start} (GPS time)")
    axes.set_xlim(first.epoch.min(), first.epoch.max())
