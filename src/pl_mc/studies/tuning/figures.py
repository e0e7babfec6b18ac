"""The figure of an experiment about tuned limits: what each pair of limits costs at every target."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, new_figure, series_style
from pl_mc.studies.tuning.text import PRICES

_KINDS = ("exact", "start", "vpl", "alarms")
_LABELS = {
    "exact": "least squares, exact",
    "start": "IGG-III, default limits",
    "vpl": f"IGG-III, tuned for the {PRICES['vpl']}",
    "alarms": f"IGG-III, tuned for {PRICES['alarms']}",
}
# Alarm rates below this are not drawn.
_SMALLEST = 1e-7


@in_common_look
def tuning_figure(table: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Mean level and fault-free alarms of least squares, the default and the tuned limits, target by target.

    Args:
        table: ``target, tuned_for, limits, k0, k1, k_vertical, vpl_m, draws, alarm_rate, alarm_low, alarm_high``.
        alert: alert limits.
        title: heading.
    """
    targets = list(dict.fromkeys(table.target))
    figure, (left, right) = new_figure(1, 2, width_in=9.6, height_in=1.6 + 1.35 * len(targets), sharey=True)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    shown: set[str] = set()
    for k, target in enumerate(targets):
        group = table[table.target == target]
        for j, kind in enumerate(_KINDS):
            part = group[group.limits == kind] if kind in ("exact", "start") else _tuned(group, kind)
            if part.empty or np.isnan(part.k_vertical.iloc[0]):
                continue
            row, style, place = part.iloc[0], series_style(j), k + 0.19 * (j - 1.5)
            label = None if kind in shown else _LABELS[kind]
            shown.add(kind)
            left.plot(row.vpl_m, place, style.marker, color=style.colour, linestyle="none", label=label)
            limits = "" if kind == "exact" else f", k0 {row.k0:.2f}, k1 {row.k1:.1f}"
            left.annotate(
                f"K {row.k_vertical:.3g}{limits}", (row.vpl_m, place), xytext=(7, 0), textcoords="offset points",
                va="center", fontsize=8, color=style.colour,
            )  # fmt: skip
            _alarm(right, row, place, style.marker, style.colour)
    left.axvline(alert.vertical_m, color="0.15", linewidth=1.0, linestyle=":", zorder=1.5)
    left.annotate(
        f"VAL {alert.vertical_m:g} m", (alert.vertical_m, 1.0), xycoords=("data", "axes fraction"), xytext=(-3, -2),
        textcoords="offset points", ha="right", va="top", fontsize=8, color="0.15",
    )  # fmt: skip
    left.set_yticks(range(len(targets)), [f"{target:g}" for target in targets])
    left.set(ylabel="risk that is kept", xlabel="mean VPL, fault-free [m]", ylim=(len(targets) - 0.45, -0.55))
    left.set_xlim(0.0, 1.6 * float(np.nanmax(table.vpl_m)))
    right.set_xscale("log")
    right.set(xlabel=f"P(alarm), fault-free, VAL {alert.vertical_m:g} m", xlim=(_SMALLEST, 1.5))
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=2)
    return figure


def _alarm(axes: Axes, row: pd.Series, place: float, marker: str, colour: str) -> None:
    """A rate with its interval; where none was counted an arrow from its upper bound, where it is small a note."""
    if row.alarm_high < _SMALLEST:
        axes.annotate(
            f"below {_SMALLEST:.0e}", (_SMALLEST, place), xytext=(4, 0), textcoords="offset points", va="center",
            fontsize=8, color=colour,
        )  # fmt: skip
        return
    if row.alarm_rate == 0:
        axes.plot(row.alarm_high, place, marker="<", color=colour, markerfacecolor="white")
        return
    spread = [[row.alarm_rate - row.alarm_low], [row.alarm_high - row.alarm_rate]]
    axes.errorbar(row.alarm_rate, place, xerr=np.maximum(spread, 0.0), marker=marker, color=colour, capsize=2.5)


def _tuned(group: pd.DataFrame, aim: str) -> pd.DataFrame:
    return group[(group.limits == "tuned") & (group.tuned_for == aim)]
