"""Maps of the world: one value for each cell of a grid, with coastlines where their package is installed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter
from numpy.typing import NDArray

from pl_mc.report.coastlines import coastlines
from pl_mc.report.figures import in_common_look, new_figure
from pl_mc.service.sky import WorldGrid

# Edges of the colours of an availability; the last colour is for all of the time.
_SHARES = (0.0, 0.5, 0.9, 0.95, 0.99, 0.995, 0.999)
_SHARE_LABELS = ("< 50 %", "50-90 %", "90-95 %", "95-99 %", "99-99.5 %", "99.5-99.9 %", "99.9-100 %", "always")


def share_scale() -> tuple[Colormap, BoundaryNorm, tuple[float, ...], tuple[str, ...]]:
    """Colours of an availability in steps that grow finer towards one: map, norm, places and labels of the bar."""
    # Anything below one is not "always": the last edge is the next number below it.
    edges = (*_SHARES, float(np.nextafter(1.0, 0.0)), 1.5)
    colours = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.0, 1.0, len(edges) - 1)))
    places = tuple((low + high) / 2 for low, high in itertools.pairwise(edges))
    return colours, BoundaryNorm(edges, len(edges) - 1), places, _SHARE_LABELS


@in_common_look
def world_figure(
    grid: WorldGrid,
    panels: Mapping[str, NDArray[np.float64]],
    *,
    title: str,
    label: str,
    shares: bool = False,
    columns: int = 1,
    limits: tuple[float, float] | None = None,
    logarithmic: bool = False,
) -> Figure:
    """Maps side by side or below each other, on one scale of colours.

    Args:
        grid: the cells.
        panels: a value for each site (sites,), by the panel's title; what is not finite is left white.
        title: heading.
        label: of the bar of colours.
        shares: whether values are availabilities, with colours of `share_scale`.
        columns: panels in a row.
        limits: ends of the scale; the smallest and the largest value unless given.
        logarithmic: whether the scale is, for values over zero.
    """
    rows = -(-len(panels) // columns)
    width_in = 6.3 if columns == 1 else 4.2
    figure, axes = new_figure(
        rows, columns, width_in=0.9 + width_in * columns, height_in=0.55 + width_in * rows / 2, title=title,
        sharex=True, sharey=True,
    )  # fmt: skip
    known = [values[np.isfinite(values)] for values in panels.values()]
    every = np.concatenate(known) if any(part.size for part in known) else np.zeros(1)
    low, high = limits or (float(every.min()), float(every.max()))
    ends = (low, high if high > low else low + 1.0)
    scale: dict[str, Any] = {"cmap": "viridis", "norm": LogNorm(*ends) if logarithmic else Normalize(*ends)}
    if shares:
        colours, norm, places, labels = share_scale()
        scale = {"cmap": colours, "norm": norm}
    image = None
    edges = [np.linspace(-end, end, count + 1) for end, count in zip((90, 180), grid.shape, strict=True)]
    for panel, (name, values) in zip(axes, panels.items(), strict=False):
        image = panel.pcolormesh(
            edges[1], edges[0], np.ma.masked_invalid(grid.as_map(values)), rasterized=True, **scale
        )
        panel.set_title(name)
        draw_world(panel)
    for panel in axes[len(panels) :]:
        panel.set_visible(False)
    assert image is not None
    bar = figure.colorbar(image, ax=axes, pad=0.012, shrink=0.9, aspect=18 * rows)
    bar.set_label(label)
    if logarithmic:
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        bar.ax.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    if shares:
        bar.set_ticks(list(places), labels=list(labels))
        bar.ax.minorticks_off()
    return figure


def draw_world(panel: Axes, *, ticks: Sequence[float] = (-180, -120, -60, 0, 60, 120, 180)) -> None:
    """Axes of longitude and latitude, with coastlines in white on black so that they show on every colour."""
    lines = coastlines()
    for colour, width, order in (("white", 1.1, 2.5), ("0.1", 0.45, 2.6)):
        panel.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, zorder=order, rasterized=True), autolim=False
        )
    panel.set(xlim=(-180, 180), ylim=(-90, 90), aspect="equal")
    panel.set_xticks(list(ticks), [_degrees(tick, "WE") for tick in ticks])
    panel.set_yticks([-90, -45, 0, 45, 90], [_degrees(tick, "SN") for tick in (-90, -45, 0, 45, 90)])
    panel.tick_params(labelsize=8)
    panel.grid(visible=False)


def _degrees(value: float, letters: str) -> str:
    return f"{abs(value):g}°" + ("" if value in (0, -180, 180) else letters[int(value > 0)])
