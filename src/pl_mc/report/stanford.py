"""Stanford diagrams: error against protection level, with the regions that they and the alert limit make."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import Judged
from pl_mc.report.figures import DASHED, columns_that_fit, legend_under, method_label, new_figure, note
from pl_mc.report.look import look_now

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Shades of the regions, over which the counts lie, what two of them have in greys, and what they are called.
_SHADES = {
    "nominal": "white",
    "misleading": "#FBE7D3",
    "hazardously misleading": "#F3C6AE",
    "system unavailable": "0.94",
    "system unavailable, error beyond level": "0.87",
}
_HATCHES = {"misleading": "....", "hazardously misleading": "xxxx"}
_HEADINGS = {name: name for name in _SHADES} | {
    "system unavailable, error beyond level": "unavailable and error beyond level"
}
# A panel with its numbers is no narrower [mm].
_PANEL_MM = 75.0
# Cells are coloured from light to dark, so that many is dark in grey too and an empty cell shows its region.
_COLOURS = "viridis_r"


def stanford_figure(
    plane: NDArray[np.int64], regions: pd.DataFrame, edges_m: NDArray[np.float64], *, judged: Judged, title: str,
    columns: int = 99, counted: str = "scenarios", named_by: str | None = None,
) -> Figure:  # fmt: skip
    """One panel per method, all with the same axes and colours.

    Args:
        plane: (methods, cells + 1, cells + 1), counts by cell of error and level; the last of each axis is beyond.
        regions: ``method, region, count, scenarios, rate, low, high``, methods in the order of ``plane``.
        edges_m: (cells + 2,), edges of the cells, the last infinite [m].
        judged: the axis with its limit, which is drawn.
        title: heading.
        columns: panels side by side at the most.
        counted: what is counted.
        named_by: the axis of whose level the names of methods speak; that of the diagram unless given.
    """
    from matplotlib.colors import LogNorm

    methods, (called,), ((_, _, limit_m),) = list(dict.fromkeys(regions.method)), judged.called, judged.levels
    across = columns_that_fit(min(columns, len(methods)), panel_mm=_PANEL_MM)
    down = -(-len(methods) // across)
    options: Any = {
        "width_in": 4.55 * across + 1.0,
        "height_in": (5.75 if down == 1 else 6.2) * down + 0.2,
        "title": title,
        "panel_mm": _PANEL_MM,
    }
    figure, axes = new_figure(down, across, **options, sharey=True)
    engine: Any = figure.get_layout_engine()
    # Planes that fill no more than a square of their place leave what stands below too little.
    engine.set(
        hspace=0.12 if down > 1 and look_now().width_in is None else 0.0,
        rect=(0.0, 0.04 / down, 1.0, 1.0 - 0.04 / down),
    )
    for panel in axes[len(methods) :]:
        panel.remove()
    axes = axes[: len(methods)]
    reach = edges_m[-2]
    # What is beyond the reach has a strip of its own, set off from the plane.
    gap, strip = 0.012 * reach, 0.035 * reach
    norm = LogNorm(1, max(int(plane.max()), 10))
    end = reach + gap + strip
    inner, beyond = edges_m[:-1], np.array([reach + gap, end])
    # Round steps, some six of them; near the end there is no room for a figure.
    steps = np.outer(10.0 ** np.arange(-3, 6), [1.0, 2.0, 5.0]).ravel()
    step = steps[np.searchsorted(steps, reach / 9.0)]
    ticks = [tick for tick in np.arange(0, reach, step) if reach - tick > 0.07 * reach]
    ticks, labels = [*ticks, reach + gap + strip / 2], [*(f"{tick:g}" for tick in ticks), f"> {reach:g}"]
    options = {"norm": norm, "cmap": _COLOURS, "rasterized": True, "zorder": 2}
    for panel, method, counts in zip(axes, methods, plane, strict=True):
        _regions(panel, limit_m, called.limit, reach, end)
        shown = np.ma.masked_equal(counts.T, 0)  # rows are levels
        for x, cells in ((inner, np.s_[:-1]), (beyond, np.s_[-1:])):
            panel.pcolormesh(x, inner, shown[:-1, cells], **options)
            panel.pcolormesh(x, beyond, shown[-1:, cells], **options)
        panel.axhline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        panel.axvline(reach + gap / 2, color="white", linewidth=2.5, zorder=2.5)
        _numbers(panel, regions[regions.method == method].set_index("region"))
        panel.set(xlim=(0, end), ylim=(0, end), xlabel=f"{called.size} [m]", aspect="equal")
        panel.set_xticks(ticks, labels)
        panel.set_yticks(ticks, labels)
        panel.grid(visible=False)
        # What stands below goes by the lower edge.
        panel.set_anchor("S")
        panel.set_title(method_label(method, named_by or judged.axis))
    for panel in axes[::across]:
        panel.set_ylabel(f"{judged.axis} protection level [m]")
    cell = edges_m[1] - edges_m[0]
    bar = figure.colorbar(axes[0].collections[0], ax=axes, pad=0.012, shrink=0.86 / down)
    bar.set_label(f"{counted} in a cell of {cell:g} m by {cell:g} m, or beyond {reach:g} m")
    return figure


def _regions(panel: Axes, limit: float, name: str, reach: float, end: float) -> None:
    """The regions as shades, with the diagonal and the alert limit."""
    from matplotlib.patches import Polygon

    corners = {
        "misleading": [(0, 0), (limit, 0), (limit, limit)],
        "hazardously misleading": [(limit, 0), (end, 0), (end, limit), (limit, limit)],
        "system unavailable": [(0, limit), (limit, limit), (end, end), (0, end)],
        "system unavailable, error beyond level": [(limit, limit), (end, limit), (end, end)],
    }
    for region, places in corners.items():
        panel.add_patch(Polygon(places, closed=True, **_shade(region), linewidth=0, zorder=0.5))
    panel.plot([0, reach], [0, reach], color="0.15", linewidth=1.0, zorder=3)
    for ends in (([0, end], [limit, limit]), ([limit, limit], [0, limit])):
        panel.plot(*ends, **DASHED | {"linewidth": 1.0, "zorder": 3})
    look: Any = {"ha": "right", "va": "top", "color": "0.15", "zorder": 4}
    note(panel, f"{name} {limit:g} m", (reach, limit), shift=(-3, -3), **look)


def _shade(region: str) -> dict[str, Any]:
    """How a region is filled; in greys two of them are hatched."""
    hatch = _HATCHES.get(region) if look_now().style == "grey" else None
    return {"facecolor": _SHADES[region], "edgecolor": "0.72", "hatch": hatch}


def _numbers(panel: Axes, rows: pd.DataFrame) -> None:
    """Count and share of each region, below the panel."""
    from matplotlib.patches import Patch

    keys = []
    for region, heading in _HEADINGS.items():
        row = rows.loc[region]
        count, percent = int(row["count"]), 100.0 * float(row["rate"])
        share = f"{np.format_float_positional(percent, precision=3, fractional=False, trim='-')} %"
        label = f"{heading}: {f'{count:,}, {share}' if count else 'none'}"
        keys.append(Patch(**_shade(region), linewidth=0.4, label=label))
    legend_under(panel, keys, fontsize=8, handlelength=1.4)
