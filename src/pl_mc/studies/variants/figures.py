"""The figure of the variants of a robust estimate: small multiples, a row for each group of variants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import SeriesStyle, in_common_look, new_figure, series_style
from pl_mc.statistics.intervals import clopper_pearson

# Drawn in every panel: what the variants are compared with.
_DEFAULT = SeriesStyle("0.0", "-", "")
_BESIDE = SeriesStyle("0.55", "--", "")
_EVENTS = ("alarm", "misleading")


@in_common_look
def variants_figure(rates: pd.DataFrame, faults: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Alarm and misleading rates against the bias; a row of panels per group, two columns per class of faults.

    Rates of misleading information are on a logarithmic axis, where nothing seen has no place: there a curve stops,
    and a dotted line shows the 95 % upper bound of zero events in so many draws.

    Args:
        rates: of one geometry: ``group, variant, fault_class, bias_m, draws`` and the rates; an empty group is
            drawn in every panel.
        faults: of that geometry: ``epoch, fault_class, satellites``, the classes to draw, in order.
        alert: alert limits.
        title: heading.
    """
    groups = [group for group in dict.fromkeys(rates.group) if group]
    classes = faults.fault_class.tolist()[-2:]
    satellites = dict(zip(faults.fault_class, faults.satellites, strict=True))
    figure, axes = new_figure(
        len(groups), 2 * len(classes), width_in=13.0, height_in=1.2 + 2.25 * len(groups), sharex=True, sharey="col",
    )  # fmt: skip
    figure.suptitle(f"{title}, epoch {int(faults.epoch.iloc[0])}", x=0.01, ha="left", fontsize=11)
    draws = int(rates.draws.min())
    unseen = float(clopper_pearson(0, draws)[1])
    for row, group in enumerate(groups):
        panels = axes[2 * len(classes) * row : 2 * len(classes) * (row + 1)]
        for column, panel in enumerate(panels):
            name, event = classes[column // 2], _EVENTS[column % 2]
            here = rates[(rates.fault_class == name) & rates.group.isin(["", group])]
            _draw(panel, here, event)
            if event == "misleading":
                panel.axhline(unseen, color="0.15", linewidth=1.0, linestyle=":", zorder=1.5)
            if row == 0:
                what = f"P(alarm), VAL {alert.vertical_m:g} m" if event == "alarm" else "P(misleading)"
                panel.set_title(f"{name}, {satellites[name]}\n{what}", fontsize=9.5)
            if row == len(groups) - 1:
                panel.set_xlabel("bias [m]")
        panels[0].set_ylabel(group, fontsize=10.5, fontweight="bold")
        panels[-1].legend(
            *panels[0].get_legend_handles_labels(), loc="center left", bbox_to_anchor=(1.02, 0.5), borderaxespad=0.0
        )
    for column in range(2 * len(classes)):
        if column % 2:
            axes[column].set(yscale="log", ylim=(0.5 / draws, 1.5))
            axes[column].annotate(
                "bound of none seen", xy=(0.995, unseen), xycoords=("axes fraction", "data"), xytext=(0, 2),
                textcoords="offset points", ha="right", va="bottom", fontsize=7.5, color="0.15",
            )  # fmt: skip
        else:
            axes[column].set(ylim=(-0.04, 1.04))
    return figure


def _draw(panel: Axes, rates: pd.DataFrame, event: str) -> None:
    """The curves of one panel with their 95 % intervals."""
    number = 0
    for (group, variant), curve in rates.groupby(["group", "variant"], sort=False):
        options: dict[str, Any] = {"linewidth": 1.4, "zorder": 2.5}
        if group:
            style, label = series_style(number), str(variant)
            number += 1
        elif variant == "default":
            # Broad and pale below the others: to be seen where they coincide.
            style, label, options = _DEFAULT, "default", {"linewidth": 4.5, "alpha": 0.3, "zorder": 2.0}
        else:
            style, label = _BESIDE, {"ls": "least squares"}.get(str(variant), str(variant))
        rate, low, high = (curve[f"{event}_{part}"].to_numpy() for part in ("rate", "low", "high"))
        if event == "misleading":
            seen = rate > 0
            rate, low, high = (np.where(seen, values, np.nan) for values in (rate, low, high))
        panel.fill_between(curve.bias_m, low, high, color=style.colour, alpha=0.15, linewidth=0)
        panel.plot(
            curve.bias_m, rate, style.line, marker=style.marker, markersize=3.2, color=style.colour, label=label,
            **options,
        )  # fmt: skip
