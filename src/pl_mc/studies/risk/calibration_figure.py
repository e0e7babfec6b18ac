"""Figures of calibrated multipliers: P(event) against the multiplier, and alarms at equal risk."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.constants import K_VERTICAL
from pl_mc.report.figures import in_common_look, method_label, new_figure, series_style

_EXACT = "exact"
# Multipliers are shown up to so many times the smallest.
_FARTHEST = 20.0
_GREY = "0.25"


@in_common_look
def calibration_figure(
    calibration: pd.DataFrame, curves: pd.DataFrame, equal_risk: pd.DataFrame, *, alert: AlertLimits, title: str
) -> Figure:
    """P(event) against the multiplier, a panel per fault, and alarms against the bias at equal risk.

    Args:
        calibration: ``method, asked, fault, event, target, found, k_vertical, k_low, k_high, check_probability,
            check_low, check_high, warning``.
        curves: ``method, asked, k_vertical, probability, low, high``.
        equal_risk: ``method, target, k_vertical, fault, bias_m, alarm_rate, alarm_low, alarm_high``.
        alert: alert limits.
        title: heading.
    """
    asked = list(dict.fromkeys(calibration.asked))
    methods = list(dict.fromkeys(calibration.method))
    columns = 2 if len(asked) > 1 else len(asked) + 1
    rows = -(-(len(asked) + 1) // columns)
    figure, axes = new_figure(rows, columns, width_in=4.9 * columns + 0.3, height_in=3.7 * rows + 1.1)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    event = calibration.event.iloc[0]
    # A method whose multipliers have no end would leave nothing to see of the others.
    usual = calibration.k_high[calibration.k_high < _FARTHEST * calibration.k_low[calibration.k_low > 0].min()]
    least = 0.2 * calibration.target.min()
    for panel, fault in zip(axes, asked, strict=False):
        for k, method in enumerate(methods):
            own = (calibration.asked == fault) & (calibration.method == method)
            curve = curves[(curves.asked == fault) & (curves.method == method)]
            _multiplier_panel(panel, calibration[own], curve, k)
        panel.axhline(calibration.target.min(), color="0.15", linewidth=1.0, linestyle=":", zorder=1.5)
        panel.axvline(K_VERTICAL, color="0.15", linewidth=1.0, linestyle=":", zorder=1.5)
        panel.annotate(
            f"K {K_VERTICAL:g}", (K_VERTICAL, 0.02), xycoords=("data", "axes fraction"), xytext=(-3, 0),
            textcoords="offset points", fontsize=8, ha="right", va="bottom", color="0.15",
        )  # fmt: skip
        panel.set_yscale("log")
        panel.set(xlabel="multiplier K of the vertical level", ylabel=f"P({event})")
        panel.set(xlim=(0, 1.1 * usual.max()), ylim=(least, 1.0))
        panel.set_title(_heading(str(fault), calibration[calibration.asked == fault]), fontsize=9.5)
    _equal_risk_panel(axes[len(asked)], equal_risk, alert)
    for spare in axes[len(asked) + 1 :]:
        spare.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=3)
    return figure


def _heading(asked: str, rows: pd.DataFrame) -> str:
    """Name of a panel; where every method has a fault of its own these stand in it."""
    if asked == "none":
        return "fault-free"
    faults = list(dict.fromkeys(rows.fault))
    return asked if faults == [asked] else f"{asked}: {', '.join(faults)}"


def _multiplier_panel(panel: Axes, rows: pd.DataFrame, curve: pd.DataFrame, index: int) -> None:
    """One method: its curve with the band of its bounds, counted multipliers, and the check of estimated ones."""
    if rows.empty:
        return
    style, label = series_style(index), method_label(rows.method.iloc[0])
    exact = bool((rows.found == _EXACT).all())
    if len(curve):
        line = f"{label}, exact" if exact else f"{label}, subset simulation"
        panel.plot(curve.k_vertical, curve.probability, style.line, color=style.colour, linewidth=1.5, label=line)
        if not exact:
            panel.fill_between(curve.k_vertical, curve.low, curve.high, color=style.colour, alpha=0.25, linewidth=0)
    if exact:
        return
    found = rows[rows.k_vertical.notna()]
    for rare, note in ((False, "counted"), (True, "calibrated")):
        part = found[(found.found != "counting") == rare]
        if part.empty:
            continue
        upper = part.k_high.where(np.isfinite(part.k_high), part.k_vertical)
        spread = np.maximum([part.k_vertical - part.k_low, upper - part.k_vertical], 0.0)
        panel.errorbar(
            part.k_vertical, part.target, xerr=spread, linestyle="none", marker=style.marker, markersize=4.5,
            markerfacecolor=style.colour if rare else "white", color=style.colour, capsize=2.5, zorder=3,
            label=f"{label}, {note}",
        )  # fmt: skip
    checked = found[found.check_probability > 0]
    if len(checked):
        spread = np.maximum(
            [checked.check_probability - checked.check_low, checked.check_high - checked.check_probability], 0.0
        )
        panel.errorbar(
            checked.k_vertical, checked.check_probability, yerr=spread, linestyle="none", marker="x",
            markersize=6.5, color=_GREY, capsize=2.5, zorder=4, label="importance sampling" if index == 1 else None,
        )  # fmt: skip


def _equal_risk_panel(panel: Axes, rows: pd.DataFrame, alert: AlertLimits) -> None:
    """Alarm rate against bias, with the multipliers of the largest and the smallest target."""
    methods = list(dict.fromkeys(rows.method))
    shared = rows.groupby("target")["method"].nunique() >= min(len(methods), 2)
    targets = sorted(shared.index[shared], reverse=True) or sorted(rows.target.unique(), reverse=True)
    for target, width in {targets[0]: 0.8, targets[-1]: 2.0}.items():
        for k, method in enumerate(methods):
            part = rows[(rows.method == method) & (rows.target == target)].sort_values("bias_m")
            if part.empty:
                continue
            style = series_style(k)
            spread = np.maximum([part.alarm_rate - part.alarm_low, part.alarm_high - part.alarm_rate], 0.0)
            label = f"{method}, {target:g}: K {part.k_vertical.iloc[0]:.3g}"
            panel.errorbar(
                part.bias_m, part.alarm_rate, yerr=spread, linestyle=style.line, marker=style.marker,
                markersize=3.5, color=style.colour, linewidth=width, elinewidth=1.0, label=label,
            )  # fmt: skip
    satellite = next((label.split(":")[0] for label in rows.fault if label != "none"), "")
    panel.set(xlabel=f"bias on {satellite} [m]", ylabel=f"P(alarm), VAL {alert.vertical_m:g} m", ylim=(-0.03, 1.05))
    panel.set_title("Alarms at equal risk")
    panel.legend(loc="center right", bbox_to_anchor=(1.0, 0.3), fontsize=7.5)
