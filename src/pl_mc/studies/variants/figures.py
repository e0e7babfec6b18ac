"""The figure of the variants of a robust estimate: small multiples, a row for each group of variants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from pl_mc.alert import Judged
from pl_mc.report.figures import DOTTED, legend_below, new_figure, note
from pl_mc.report.look import SeriesStyle, look_now, styles_of
from pl_mc.statistics.intervals import clopper_pearson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of the default, which is drawn in every panel with least squares: broad and pale below the others, to be seen where
# they coincide.
_DEFAULT: dict[str, Any] = {"linewidth": 4.5, "alpha": 0.3, "zorder": 2.0, "marker": ""}
_EVENTS = ("alarm", "misleading")


def variants_figure(rates: pd.DataFrame, faults: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """Alarm and misleading rates against the bias; a row of panels per group, two columns per class of faults.

    Rates of misleading information are on a logarithmic axis, where nothing seen has no place: there a curve stops,
    and a dotted line shows the 95 % upper bound of zero events in so many draws.

    Args:
        rates: of one geometry: ``group, variant, fault_class, bias_m, draws`` and the rates; an empty group is
            drawn in every panel.
        faults: of that geometry: ``epoch, fault_class, satellites``, the classes to draw, in order.
        judged: the axis with its limit.
        title: heading.
    """
    groups = [group for group in dict.fromkeys(rates.group) if group]
    satellites = dict(zip(faults.fault_class, faults.satellites, strict=True))
    columns = [(name, event) for name in faults.fault_class.tolist()[-2:] for event in _EVENTS]
    figure, axes = new_figure(
        len(groups), len(columns), width_in=13.0, height_in=1.2 + 2.25 * len(groups), sharex=True, sharey="col",
        title=f"{title}, epoch {int(faults.epoch.iloc[0])}",
    )  # fmt: skip
    draws, in_print = int(rates.draws.min()), look_now().width_in is not None
    unseen = float(clopper_pearson(0, draws)[1])
    for row, group in enumerate(groups):
        panels = axes[len(columns) * row : len(columns) * (row + 1)]
        # Beside each row its own legend; in print one of all rows, in which no two are alike.
        named = rates if in_print else rates[rates.group.isin(["", group])]
        styles = styles_of({"default": "igg3"}.get(name, name) for name in map(str, named.variant))
        for panel, (name, event) in zip(panels, columns, strict=True):
            _draw(panel, rates[(rates.fault_class == name) & rates.group.isin(["", group])], event, styles)
            if event == "misleading":
                panel.axhline(unseen, **DOTTED)
        panels[0].set_ylabel(group, fontsize=10.5, fontweight="bold")
        if not in_print:
            keys = panels[0].get_legend_handles_labels()[0]
            panels[-1].legend(handles=keys, loc="center left", bbox_to_anchor=(1.02, 0.5), borderaxespad=0.0)
    if in_print:
        legend_below(figure, axes, columns=2)
    for first, last, (name, event) in zip(axes, axes[-len(columns) :], columns, strict=False):
        what = f"P(alarm), {judged.limits()}" if event == "alarm" else "P(misleading)"
        first.set_title(f"{name}, {satellites[name]}\n{what}", fontsize=9.5)
        last.set_xlabel("bias [m]")
        if event == "alarm":
            first.set(ylim=(-0.04, 1.04))
            continue
        first.set(yscale="log", ylim=(0.5 / draws, 1.5))
        note(
            first, "bound of none seen", (0.995, unseen), shift=(0, 2), xycoords=("axes fraction", "data"),
            ha="right", va="bottom", fontsize=7.5, color="0.15",
        )  # fmt: skip
    return figure


def _draw(panel: Axes, rates: pd.DataFrame, event: str, styles: Mapping[str, SeriesStyle]) -> None:
    """The curves of one panel with their 95 % intervals."""
    for (group, variant), curve in rates.groupby(["group", "variant"], sort=False):
        is_default = variant == "default" and not group
        # The default is the IGG-III of other figures.
        style, options = styles["igg3" if variant == "default" else str(variant)], _DEFAULT if is_default else {}
        label = {"ls": "least squares"}.get(str(variant), str(variant))
        rate, low, high = (curve[f"{event}_{part}"] for part in ("rate", "low", "high"))
        if event == "misleading":
            rate, low, high = (values.where(curve.misleading_rate > 0) for values in (rate, low, high))
        panel.fill_between(curve.bias_m, low, high, color=style.colour, alpha=0.15, linewidth=0)
        panel.plot(
            curve.bias_m, rate, **{**style.look, "markersize": 3.2, "label": label, "linewidth": 1.4, "zorder": 2.5}
            | options,
        )  # fmt: skip
