"""Figures of a series of epochs: position errors and vertical protection levels over time."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, limit_line, method_label, new_figure, series_style, shade


@in_common_look
def error_figure(table: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """East, north and up errors and VPL against the epoch, method by method, faulted epochs shaded.

    Args:
        table: ``epoch, method, east_m, north_m, up_m, vpl_m, faulted``.
        alert: alert limits.
        title: heading.
    """
    figure, axes = new_figure(4, 1, width_in=8.0, height_in=9.0, sharex=True)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    windows = faulted_windows(table)
    for panel, (column, name) in zip(
        axes, (("east_m", "east"), ("north_m", "north"), ("up_m", "up"), ("vpl_m", "VPL")), strict=True
    ):
        shade(panel, windows, "faulted epochs")
        for k, (method, group) in enumerate(table.groupby("method", sort=False)):
            style = series_style(k)
            # Least squares lies below in a lighter line, so that both stay visible where they agree.
            panel.plot(
                group.epoch, group[column], linestyle="-" if k == 0 else (0, (2, 1)), color=style.colour,
                linewidth=1.3 if k == 0 else 0.8, alpha=0.55 if k == 0 else 1.0, label=method_label(str(method)),
            )  # fmt: skip
        panel.set_ylabel("VPL [m]" if column == "vpl_m" else f"{name} error [m]")
    limit_line(axes[3], alert.vertical_m, f"VAL {alert.vertical_m:g} m")
    top = float(np.nanmax([alert.vertical_m * 1.15, min(np.nanmax(table.vpl_m), 4 * alert.vertical_m)]))
    axes[3].set(xlabel="epoch", ylim=(0, top))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    return figure


def faulted_windows(table: pd.DataFrame) -> list[tuple[float, float]]:
    """First and last epoch of each run of faulted epochs."""
    per_epoch = table.groupby("epoch").faulted.any()
    epochs = per_epoch.index[per_epoch.to_numpy()].to_numpy()
    if epochs.size == 0:
        return []
    breaks = np.flatnonzero(np.diff(epochs) > 1)
    starts, stops = np.r_[0, breaks + 1], np.r_[breaks, epochs.size - 1]
    return [(float(epochs[a]), float(epochs[b])) for a, b in zip(starts, stops, strict=True)]
