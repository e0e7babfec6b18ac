"""The Stanford diagram: vertical error against vertical protection level, with the regions of an alert limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, method_label, new_figure
from pl_mc.report.text import rate_text

# Shades of the regions in which something is wrong; the counts lie over them.
_MISLEADING, _HAZARDOUS, _UNAVAILABLE = "#FBE7D3", "#F3C6AE", "0.93"
# Cells are coloured from light to dark, so that many is dark in grey too and an empty cell shows its region.
_COLOURS = "viridis_r"


@in_common_look
def stanford_figure(
    plane: NDArray[np.int64], regions: pd.DataFrame, edges_m: NDArray[np.float64], *, alert: AlertLimits, title: str
) -> Figure:
    """One panel per method, all with the same axes and colours.

    Args:
        plane: (methods, cells + 1, cells + 1), counts by cell of error and level; the last of each axis is beyond.
        regions: ``method, region, count, scenarios, rate, low, high``, methods in the order of ``plane``.
        edges_m: (cells + 2,), edges of the cells, the last infinite [m].
        alert: alert limits; the vertical one is drawn.
        title: heading.
    """
    methods = list(dict.fromkeys(regions.method))
    figure, axes = new_figure(1, len(methods), width_in=4.55 * len(methods) + 1.0, height_in=5.1, sharey=True)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    reach = edges_m[-2]
    # What is beyond the reach has a strip of its own, set off from the plane.
    gap, strip = 0.012 * reach, 0.035 * reach
    norm = LogNorm(1, max(int(plane.max()), 10))
    end = reach + gap + strip
    image = None
    for panel, method, counts in zip(axes, methods, plane, strict=True):
        _regions(panel, alert.vertical_m, reach, end)
        shown = np.ma.masked_equal(counts.T, 0)  # rows are levels
        inner, beyond = edges_m[:-1], np.array([reach + gap, end])
        options: Any = {"norm": norm, "cmap": _COLOURS, "rasterized": True, "zorder": 2}
        image = panel.pcolormesh(inner, inner, shown[:-1, :-1], **options)
        panel.pcolormesh(inner, beyond, shown[-1:, :-1], **options)
        panel.pcolormesh(beyond, inner, shown[:-1, -1:], **options)
        panel.pcolormesh(beyond, beyond, shown[-1:, -1:], **options)
        panel.axhline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        panel.axvline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        _numbers(panel, regions[regions.method == method].set_index("region"), alert.vertical_m, reach)
        panel.set(xlim=(0, end), ylim=(0, end), xlabel="|vertical error| [m]", aspect="equal")
        ticks = [tick for tick in np.arange(0, reach, 10.0) if reach - tick > 4]
        labels = [f"{tick:g}" for tick in ticks] + [f"> {reach:g}"]
        panel.set_xticks([*ticks, reach + gap + strip / 2], labels)
        panel.set_yticks([*ticks, reach + gap + strip / 2], labels)
        panel.grid(visible=False)
        panel.set_title(method_label(method))
    axes[0].set_ylabel("vertical protection level [m]")
    assert image is not None
    cell = edges_m[1] - edges_m[0]
    bar = figure.colorbar(image, ax=axes, pad=0.012, shrink=0.86)
    bar.set_label(f"scenarios in a cell of {cell:g} m by {cell:g} m, or beyond {reach:g} m")
    return figure


def _regions(panel: Axes, limit: float, reach: float, end: float) -> None:
    """The regions as shades, with the diagonal and the alert limit."""
    for corners, colour in (
        ([(0, 0), (limit, 0), (limit, limit)], _MISLEADING),
        ([(limit, 0), (end, 0), (end, limit), (limit, limit)], _HAZARDOUS),
        ([(0, limit), (end, limit), (end, end), (0, end)], _UNAVAILABLE),
    ):
        panel.add_patch(Polygon(corners, closed=True, facecolor=colour, edgecolor="none", zorder=0.5))
    panel.plot([0, reach], [0, reach], color="0.15", linewidth=1.0, zorder=3)
    panel.plot([0, end], [limit, limit], color="0.15", linewidth=1.0, linestyle=(0, (6, 2)), zorder=3)
    panel.plot([limit, limit], [0, limit], color="0.15", linewidth=1.0, linestyle=(0, (6, 2)), zorder=3)
    panel.annotate(
        f"VAL {limit:g} m", xy=(reach, limit), xytext=(-3, -3), textcoords="offset points", ha="right", va="top",
        fontsize=8, color="0.15", zorder=4,
    )  # fmt: skip


def _numbers(panel: Axes, rows: pd.DataFrame, limit: float, reach: float) -> None:
    """Name, count and rate of each region, written where it is."""
    high = (limit + reach) / 2
    for region, heading, x, y, side in (
        ("nominal", "nominal", 0.25 * limit, 0.895 * limit, "left"),
        ("misleading", "misleading", 0.985 * limit, 0.17 * limit, "right"),
        ("hazardously misleading", "hazardously\nmisleading", (limit + reach) / 2, 0.5 * limit, "center"),
        ("system unavailable", "system unavailable", 0.26 * limit, high + 0.1 * (reach - limit), "left"),
        ("system unavailable, error beyond level", "unavailable and\nmisleading", 0.99 * reach,
         limit + 0.3 * (reach - limit), "right"),
    ):  # fmt: skip
        row = rows.loc[region]
        rate = rate_text(int(row["count"]), int(row["scenarios"]), row["low"], row["high"])
        number = f"{int(row['count']):,}"
        text = panel.text(
            x, y, f"{heading}\n{number}" + ("" if rate.startswith("all") else f"\n{rate}"), ha=side, va="center",
            fontsize=7.2, linespacing=1.15, color="0.05", zorder=5,
        )  # fmt: skip
        # Readable over cells of any colour.
        text.set_bbox({"facecolor": "white", "alpha": 0.78, "edgecolor": "none", "pad": 1.5})
