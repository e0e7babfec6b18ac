"""The figure of an experiment about tuned limits: what each pair of limits costs at every target."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pl_mc.alert import Judged
from pl_mc.report.figures import DOTTED, bar_lengths, legend_below, new_figure, note, power_text
from pl_mc.report.look import SeriesStyle, look_now, series_style
from pl_mc.studies.tuning.text import PRICES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LABELS = {
    "exact": "least squares, exact",
    "start": "IGG-III, default limits",
    "vpl": f"IGG-III, tuned for the {PRICES['vpl']}",
    "hpl": f"IGG-III, tuned for the {PRICES['hpl']}",
    "alarms": f"IGG-III, tuned for {PRICES['alarms']}",
}
# Alarm rates below this are not drawn.
_SMALLEST = 1e-7


def tuning_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """Mean level and fault-free alarms of least squares, the default and the tuned limits, target by target."""
    targets, limit, ((pl, level, limit_m),) = list(dict.fromkeys(table.target)), judged.limits(), judged.levels
    labels = {name: label for name, label in _LABELS.items() if name not in ("vpl", "hpl") or name == pl}
    figure, (left, right) = new_figure(
        1,
        2,
        width_in=9.6,
        height_in=1.6 + 1.35 * len(targets),
        lines_in=1.35 * len(targets),
        title=title,
        sharey=True,
        panel_mm=70.0,
    )
    kind = table.limits.where(table.limits != "tuned", table.tuned_for)
    for k, target in enumerate(targets):
        for j, (name, label) in enumerate(labels.items()):
            rows = table[(table.target == target) & (kind == name)]
            if rows.empty or np.isnan(rows[f"k_{judged.axis}"].iloc[0]):
                continue
            row, style, place = rows.iloc[0], series_style(j), k + 0.19 * (j - 1.5)
            left.plot(row[f"{pl}_m"], place, style.marker, color=style.colour, linestyle="none", label=label)
            limits = "" if name == "exact" else f", k0 {row.k0:.2f}, k1 {row.k1:.1f}"
            text = f"K {row[f'k_{judged.axis}']:.3g}{limits}"
            note(left, text, (row[f"{pl}_m"], place), shift=(7, 0), va="center", color=style.colour)
            _alarm(right, row, place, style)
    left.axvline(limit_m, **DOTTED)
    note(
        left, limit, (limit_m, 1.0), shift=(-3, -2), xycoords=("data", "axes fraction"), ha="right",
        va="top", color="0.15",
    )  # fmt: skip
    left.set_yticks(range(len(targets)), [power_text(target) for target in targets])
    left.set(ylabel="risk that is kept", xlabel=f"mean {level}, fault-free [m]", ylim=(len(targets) - 0.45, -0.55))
    # Room for the notes.
    left.set_xlim(0.0, (1.6 if look_now().width_in is None else 2.2) * float(np.nanmax(table[f"{pl}_m"])))
    right.set_xscale("log")
    right.set(xlabel=f"P(alarm), fault-free, {limit}", xlim=(_SMALLEST, 1.5))
    legend_below(figure, [left], columns=2)
    return figure


def _alarm(axes: Axes, row: pd.Series, place: float, style: SeriesStyle) -> None:
    """A rate with its interval; where none was counted an arrow from its upper bound, where it is small a note."""
    if row.alarm_high < _SMALLEST:
        small = f"below {power_text(_SMALLEST)}"
        note(axes, small, (_SMALLEST, place), shift=(4, 0), va="center", color=style.colour)
    elif row.alarm_rate == 0:
        axes.plot(row.alarm_high, place, marker="<", color=style.colour, markerfacecolor="white")
    else:
        lengths = bar_lengths(row.alarm_rate, row.alarm_low, row.alarm_high)
        axes.errorbar(row.alarm_rate, place, xerr=lengths, marker=style.marker, color=style.colour, capsize=2.5)
