"""Figures of a frontier: level against proven risk, and multipliers over geometries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.report.figures import legend_below, new_figure
from pl_mc.report.look import styles_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Risks below this, zero among them, stand here.
_LEAST = 1e-40


# Columns of the legend: names of methods are as wide as a panel.
_MOST_COLUMNS = 3


# From where on multipliers are drawn by their logarithm, with names at these.
_WIDE, _TICKS = 2.5, (3, 4, 5, 6, 7, 8, 10, 12, 15, 20, 30, 50, 100)


def _panels(skies: list[str], methods: list[str], title: str) -> tuple[Figure, Any]:
    """A panel for each sky, with the height that the legend below takes."""
    rows = -(-(len(methods) + 1) // min(len(skies), _MOST_COLUMNS))
    height = 4.2 + 0.16 * max(len(methods), 1.6 * rows)
    return new_figure(1, len(skies), width_in=3.6 * len(skies) + 1.0, height_in=height, title=title, sharey=True)


def frontier_figure(curves: pd.DataFrame, frontier: pd.DataFrame, *, axis: str, title: str) -> Figure:
    """A panel for each sky; ``curves`` has level and risk by sky, method and factor of the multiplier."""
    skies = list(dict.fromkeys(frontier.sky))
    methods = list(dict.fromkeys(frontier.method))
    figure, axes = _panels(skies, methods, title)
    for panel, sky in zip(axes, skies, strict=True):
        here = frontier[frontier.sky == sky]
        for method, style in styles_of(methods).items():
            rows = curves[(curves.sky == sky) & (curves.method == method)].sort_values("level_m")
            if rows.empty:
                continue
            look = style.look | ({"linestyle": "none"} if len(rows) == 1 else {})
            panel.plot(rows.level_m, np.maximum(rows.risk, _LEAST), **look, linewidth=1.2, markersize=4.5, label=method)
        allowed = float(here.allowed.mean())
        panel.axhline(allowed, color="0.3", linewidth=1.0, linestyle=(0, (4, 2)), label="allowed")
        panel.set(yscale="log", xlabel=f"mean {axis} level [m]", title=sky)
        widest = here.level_mean_m[np.isfinite(here.level_mean_m)]
        if len(widest):
            panel.set_xlim(0.6 * widest.min(), min(1.6 * float(widest.median()), 1.1 * float(widest.max())) + 1.0)
        panel.set_ylim(max(min([1e-10, *(0.5 * curves.risk)]), 0.5 * _LEAST), 1e-4)
    axes[0].set_ylabel("risk of the analysed modes, per sample")
    legend_below(figure, axes[:1], columns=min(len(skies), _MOST_COLUMNS), side="center")
    return figure


def multiplier_figure(
    geometries: pd.DataFrame, multipliers: pd.DataFrame, frontier: pd.DataFrame, *, axis: str, title: str
) -> Figure:
    """Distribution of the multiplier of each method over the geometries of each sky, methods as in the other figure."""
    skies = list(dict.fromkeys(multipliers.sky))
    methods, styles = list(dict.fromkeys(multipliers.method)), styles_of(frontier.method)
    figure, axes = _panels(skies, methods, title)
    for panel, sky in zip(axes, skies, strict=True):
        for method in methods:
            found = np.sort(geometries[(geometries.sky == sky) & (geometries.method == method)].k.to_numpy())
            if not found.size:
                continue
            share = np.arange(1, found.size + 1) / found.size
            finite = np.isfinite(found)
            look = styles[method].look
            every = max(found.size // 8, 1)
            panel.step(
                found[finite], share[finite], where="post", **look, linewidth=1.2, markersize=4.5, markevery=every,
                label=method,
            )  # fmt: skip
        panel.set(xlabel=f"K of the {axis} level", title=sky, ylim=(0.0, 1.02))
        if panel.get_xlim()[1] > _WIDE * panel.get_xlim()[0] > 0:
            panel.set_xscale("log")
            panel.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
            panel.minorticks_off()
            panel.set_xlim(*np.array(panel.dataLim.intervalx) * (0.97, 1.03))
    axes[0].set_ylabel("share of geometries whose K is at most this")
    legend_below(figure, axes[:1], columns=min(len(skies), _MOST_COLUMNS), side="center")
    return figure
