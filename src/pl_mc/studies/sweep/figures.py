"""Figures of a sweep: protection levels and event rates against the bias."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, limit_line, method_label, new_figure, series_style


@in_common_look
def ramp_figure(
    rates: pd.DataFrame, levels: pd.DataFrame, exact: pd.DataFrame, *, alert: AlertLimits, title: str
) -> Figure:
    """Vertical protection levels, alarm rates and rates of misleading information against a bias.

    Args:
        rates: a sweep's table for one epoch, or summed over epochs, with one row per method and bias.
        levels: quantiles of the levels by method and bias: ``method, bias_m, vpl_05_m, vpl_50_m, vpl_95_m``.
        exact: rates of least squares in closed form, on a finer grid: ``bias_m, alarm_rate, misleading_rate``.
        alert: alert limits.
        title: heading.
    """
    figure, (top, middle, bottom) = new_figure(3, 1, width_in=7.2, height_in=9.0, sharex=True)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    for k, (name, group) in enumerate(levels.groupby("method", sort=False)):
        style = series_style(k)
        top.fill_between(group.bias_m, group.vpl_05_m, group.vpl_95_m, color=style.colour, alpha=0.2, linewidth=0)
        top.plot(
            group.bias_m, group.vpl_50_m, style.line, marker=style.marker, markersize=4, color=style.colour,
            label=f"{method_label(str(name))}, median and 5-95 %",
        )  # fmt: skip
    limit_line(top, alert.vertical_m, f"VAL {alert.vertical_m:g} m")
    top.set(ylabel="vertical protection level [m]", ylim=(0, None))
    top.set_title("Protection level")
    top.legend(loc="upper left")

    for axes, event in ((middle, "alarm"), (bottom, "misleading")):
        for k, (name, group) in enumerate(rates.groupby("method", sort=False)):
            _rate_points(axes, group, event, k, method_label(str(name)))
    middle.plot(exact.bias_m, exact.alarm_rate, color="0.25", linewidth=0.9, label="least squares, exact")
    middle.set(ylabel=f"P(alarm), VAL {alert.vertical_m:g} m", ylim=(-0.03, 1.05))
    middle.set_title("Alarms, with 95 % intervals")
    middle.legend(loc="center right")

    positive = exact[exact.misleading_rate > 1e-12]
    bottom.plot(
        positive.bias_m, positive.misleading_rate, color="0.25", linewidth=0.9, label="least squares, exact"
    )
    bottom.axhline(1e-7, color="0.15", linewidth=1.0, linestyle=":")
    bottom.annotate(
        "1e-7, what K_V = 5.33 stands for", xy=(0.995, 1e-7), xycoords=("axes fraction", "data"), xytext=(0, 2),
        textcoords="offset points", ha="right", va="bottom", fontsize=8.5, color="0.15",
    )  # fmt: skip
    bottom.set(yscale="log", ylabel="P(|vertical error| > VPL, no alarm)", xlabel="bias [m]", ylim=(1e-9, 2.0))
    bottom.set_title("Misleading information (arrow: 95 % upper bound where nothing was seen)")
    bottom.legend(loc="lower right", ncols=2)
    return figure


@in_common_look
def rates_by_fault_figure(rates: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Alarm rates and rates of misleading information fault by fault, for faults that are no ramp.

    Args:
        rates: a table with one row per method and fault.
        alert: alert limits.
        title: heading.
    """
    faults = list(dict.fromkeys(rates.fault))
    figure, (left, right) = new_figure(
        1, 2, width_in=9.0, height_in=1.6 + 0.32 * len(faults) * rates.method.nunique(), sharey=True
    )
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    methods = list(dict.fromkeys(rates.method))
    place = {fault: k for k, fault in enumerate(faults)}
    for k, name in enumerate(methods):
        group, style = rates[rates.method == name], series_style(k)
        y = group.fault.map(place) + 0.6 * ((k + 0.5) / len(methods) - 0.5)
        for axes, event in ((left, "alarm"), (right, "misleading")):
            low, high = group[f"{event}_low"], group[f"{event}_high"]
            axes.hlines(y, low, high, color=style.colour, linewidth=1.5)
            axes.plot(
                group[f"{event}_rate"], y, linestyle="none", marker=style.marker, markersize=5, color=style.colour,
                label=method_label(str(name)),
            )  # fmt: skip
    left.set(yticks=range(len(faults)), yticklabels=faults, xlabel=f"P(alarm), VAL {alert.vertical_m:g} m")
    left.invert_yaxis()
    right.set(xlabel="P(|vertical error| > VPL, no alarm)")
    left.set_title("Alarms, with 95 % intervals")
    right.set_title("Misleading information")
    right.legend(loc="best")
    return figure


def _rate_points(axes: Axes, group: pd.DataFrame, event: str, index: int, label: str) -> None:
    """Rates with their bounds; an arrow down from the upper bound where the count is zero."""
    style = series_style(index)
    seen = group[group[f"{event}_rate"] > 0] if axes.get_yscale() == "log" or event == "misleading" else group
    rate = seen[f"{event}_rate"]
    spread = np.vstack([rate - seen[f"{event}_low"], seen[f"{event}_high"] - rate])
    if len(seen):
        axes.errorbar(
        seen.bias_m, rate, yerr=np.maximum(spread, 0.0), linestyle="none",
        marker=style.marker, markersize=4, color=style.colour, linewidth=1.2, capsize=2, label=label,
    )  # fmt: skip
    unseen = group.drop(seen.index)
    if len(unseen):
        axes.errorbar(
            unseen.bias_m, unseen[f"{event}_high"], yerr=0.5 * unseen[f"{event}_high"], uplims=True,
            linestyle="none", marker=style.marker, markersize=4, markerfacecolor="none", color=style.colour,
            label=f"{label}, upper bound",
        )  # fmt: skip
