"""Figures of observations by place: on the ground, in the sky, in Stanford diagrams; alarms and satellites in time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import EITHER, Judged, judged_by
from pl_mc.engine.stanford import MISLEADING, REGIONS
from pl_mc.geometry import Geometry
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.report.figures import columns_that_fit, legend_below, legend_in, new_figure, shade, short_label
from pl_mc.report.findings import Picture
from pl_mc.report.look import series_style, styles_of
from pl_mc.report.stanford import stanford_figure
from pl_mc.studies.observe.figures import error_figure, faulted_windows, longest_step, time_axis
from pl_mc.studies.observe.record import ObserveExperiment
from pl_mc.studies.observe.stanford import regions_of, sizes_m

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Cells of a diagram along an axis at the most, and how far beyond the limit it goes.
_MOST_CELLS, _BEYOND_LIMIT = 150, 1.7
# The regions that are parts of the plane.
_IN_PLANE = 5
# Points of a scatter; more only darken it.
_MOST_POINTS = 4000
# A receiver that goes further than this has a track.
_MOVES_M = 10.0


def stanford_axis_figure(table: pd.DataFrame, stanford: pd.DataFrame, judged: Judged, title: str) -> Figure:
    """The diagram of an axis, a panel for each method with levels; ``table`` has ``rejected``."""
    ((_, _, limit_m),) = judged.levels
    counted = stanford[stanford.axis == judged.axis].rename(columns={"epochs": "scenarios"})
    # Round cells, tens of them.
    lengths = np.outer(10.0 ** np.arange(-6, 9), [1.0, 2.0, 5.0]).ravel()
    cell_m = lengths[np.searchsorted(lengths, _BEYOND_LIMIT * limit_m / _MOST_CELLS)]
    cells = 10 * int(np.ceil(_BEYOND_LIMIT * limit_m / cell_m / 10.0))
    edges_m = np.append(cell_m * np.arange(cells + 1), np.inf)
    methods = dict.fromkeys(counted.method)
    plane = np.stack([_plane(table[table.method == name], judged, edges_m) for name in methods])
    return stanford_figure(
        plane, counted, edges_m, judged=judged, title=title, columns=2, counted="epochs", named_by=EITHER
    )


def _plane(part: pd.DataFrame, judged: Judged, edges_m: np.ndarray) -> np.ndarray:
    ((pl, _, _),), (size_m,) = judged.levels, sizes_m(part, judged)
    inside = (regions_of(part, judged) < _IN_PLANE) & part[f"{pl}_m"].notna()
    size, level = (np.searchsorted(edges_m, one[inside], side="right") - 1 for one in (size_m, part[f"{pl}_m"]))
    side = edges_m.size - 1
    places = size.clip(0, side - 1) * side + level.clip(0, side - 1)
    return np.bincount(places, minlength=side * side).reshape(side, side)


def ground_figure(table: pd.DataFrame, *, title: str) -> Figure:
    """A panel for each method, all with the same axes; what lies far off is marked at the edge."""
    methods = list(dict.fromkeys(table.method))
    across = columns_that_fit(min(2 if len(methods) in (2, 4) else 3, len(methods)))
    down = -(-len(methods) // across)
    figure, axes = new_figure(
        down, across, width_in=3.1 * across + 0.6, height_in=3.1 * down + 0.8, title=title, sharex=True, sharey=True
    )
    radius_m = np.hypot(table.east_m, table.north_m)
    reach_m = 1.15 * max(float(radius_m[table.method == name].quantile(0.99)) for name in methods)
    for panel, (name, style) in zip(axes, styles_of(methods).items(), strict=False):
        part = table[(table.method == name) & table.available]
        shown = part.iloc[:: -(-max(len(part), 1) // _MOST_POINTS)]
        place = np.clip(shown[["east_m", "north_m"]].to_numpy(), -reach_m, reach_m)
        panel.scatter(
            place[:, 0],
            place[:, 1],
            s=5,
            marker=style.marker,
            color=style.colour,
            alpha=0.25,
            linewidths=0,
            rasterized=True,
            zorder=2,
        )
        sizes = np.hypot(part.east_m, part.north_m)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        for share, line in ((0.5, "-"), (0.95, "--")):
            size_m = float(sizes.quantile(share)) if len(sizes) else np.nan
            panel.plot(
                size_m * np.cos(angle), size_m * np.sin(angle), color="0.1", linestyle=line, linewidth=1.0, zorder=3,
                label=f"{share:.0%}",
            )  # fmt: skip
        panel.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), aspect="equal", title=short_label(str(name)))
        panel.title.set_fontsize(9.0)
    for panel in axes[len(methods) :]:
        panel.remove()
    for panel in axes[: len(methods)]:
        panel.set_xlabel("east error [m]")
        panel.xaxis.set_tick_params(labelbottom=True)
    for panel in axes[::across]:
        panel.set_ylabel("north error [m]")
    legend_below(figure, axes[:1], columns=2)
    return figure


def track_figure(table: pd.DataFrame, truth_m: np.ndarray, *, title: str) -> Figure:
    """East and north of a receiver that moves, from its first position, with a mark where that is."""
    latitude, longitude, _ = geodetic(truth_m[0])
    east_m, north_m, _ = enu_rotation(latitude, longitude) @ (truth_m - truth_m[0]).T
    first = table[table.method == table.method.iloc[0]]
    size_m = np.hypot(first.east_m, first.north_m).to_numpy()
    figure, (panel,) = new_figure(1, 1, width_in=6.4, height_in=5.4, title=title)
    panel.plot(east_m, north_m, color="0.75", linewidth=0.8, zorder=1.5)
    points = panel.scatter(
        east_m, north_m, c=size_m, s=9, cmap="viridis_r", vmin=0.0, vmax=float(np.nanquantile(size_m, 0.98)),
        linewidths=0, rasterized=True, zorder=2,
    )  # fmt: skip
    panel.plot(0.0, 0.0, marker="*", markersize=11, color="0.1", linestyle="none", label="start", zorder=3)
    label = f"horizontal error, {short_label(str(first.method.iloc[0]))} [m]"
    figure.colorbar(points, ax=panel, label=label, extend="max")
    panel.set(xlabel="east of the start [m]", ylabel="north of the start [m]")
    panel.set_aspect("equal", adjustable="datalim")
    legend_in(panel, loc="best")
    return figure


def sky_figure(residuals: pd.DataFrame, azimuth_deg: np.ndarray, *, title: str) -> Figure:
    """A sky plot coloured by the error, and the error over elevation beside it."""
    figure, (empty, panel) = new_figure(1, 2, width_in=9.0, height_in=4.6, title=title)
    empty.remove()
    sky: Any = figure.add_subplot(1, 2, 1, projection="polar")
    sky.set_theta_zero_location("N")
    sky.set_theta_direction(-1)
    every = max(1, len(residuals) // (2 * _MOST_POINTS))
    rows = np.arange(len(residuals))[::every]
    shown = residuals.iloc[rows]
    most_m = float(shown.error_m.abs().quantile(0.98))
    points = sky.scatter(
        np.radians(azimuth_deg[rows]), 90.0 - shown.elevation_deg, c=shown.error_m, s=4, cmap="viridis", vmin=-most_m,
        vmax=most_m, linewidths=0, rasterized=True, zorder=2,
    )  # fmt: skip
    sky.set_rlim(0, 90)
    sky.set_rgrids([30, 60, 90], ["60°", "30°", ""], fontsize=7.5)
    sky.set_thetagrids([0, 90, 180, 270], ["N", "E", "S", "W"])
    figure.colorbar(points, ax=sky, shrink=0.7, pad=0.1, label="error [m]", extend="both")
    panel.scatter(
        shown.elevation_deg, shown.error_m, s=3, color=series_style(0).colour, alpha=0.25, linewidths=0,
        rasterized=True,
    )  # fmt: skip
    cell = (residuals.elevation_deg // 5.0).astype(int)
    for factor in (-2.0, 2.0):
        sigma = residuals.sigma_m.groupby(cell).mean()
        rms = np.sqrt((residuals.error_m**2).groupby(cell).mean())
        label = factor > 0
        panel.plot(
            5.0 * sigma.index + 2.5, factor * sigma, color="0.1", linewidth=1.4, label="2 sigma" if label else None
        )
        panel.plot(
            5.0 * rms.index + 2.5, factor * rms, color=series_style(1).colour, linestyle="--", linewidth=1.6,
            label="2 RMS of the errors" if label else None,
        )  # fmt: skip
    panel.set(xlabel="elevation [deg]", ylabel="error without clock [m]", xlim=(0, 90))
    panel.set_ylim(-1.15 * _reach(residuals), 1.15 * _reach(residuals))
    legend_in(panel, loc="upper right")
    return figure


def _reach(residuals: pd.DataFrame) -> float:
    return max(float(residuals.error_m.abs().quantile(0.999)), 2.0 * float(residuals.sigma_m.max()))


def satellites_figure(g: Geometry, *, title: str) -> Figure:
    """Numbers of satellites and DOPs over time."""
    figure, (count, dop) = new_figure(2, 1, width_in=8.0, height_in=4.6, title=title, sharex=True)
    time = gps_dates(g.time_gps_s)
    letters = np.array(g.systems)[g.satellite]
    for k, system in enumerate(dict.fromkeys(g.systems)):
        seen = ((letters == system) & g.in_view).sum(axis=1)
        style = series_style(k)
        count.step(
            time, seen, where="mid", color=style.colour, linestyle=style.line, linewidth=1.3, label=SYSTEM_NAMES[system]
        )
    if len(set(g.systems)) > 1:
        count.step(time, g.satellite_count, where="mid", color="0.1", linewidth=1.0, label="all")
    count.set_ylabel("satellites")
    count.set_ylim(0, 1.3 * int(g.satellite_count.max()))
    legend_in(count, loc="upper right", ncols=5)
    design = np.where(g.in_view[..., None], g.design, 0.0)
    used = np.abs(design).sum(axis=1) > 0
    normal = np.einsum("eni,enj->eij", design, design) + np.where(used, 0.0, 1.0)[:, None, :] * np.eye(used.shape[1])
    solved = g.in_view.sum(axis=1) >= used.sum(axis=1)
    inverse = np.full(normal.shape, np.nan)
    inverse[solved] = np.linalg.pinv(normal[solved])
    squared = inverse[:, [0, 1, 2], [0, 1, 2]]
    for k, (name, value) in enumerate((("HDOP", squared[:, :2].sum(axis=1)), ("VDOP", squared[:, 2]))):
        style = series_style(k)
        dop.plot(time, np.sqrt(value), color=style.colour, linestyle=style.line, linewidth=1.2, label=name)
    dop.set_ylabel("DOP")
    dop.set_ylim(0.0, 1.2 * float(np.nanquantile(np.sqrt(squared[:, 2]), 0.999)))
    legend_in(dop, loc="upper right", ncols=2)
    time_axis(dop, time)
    return figure


def alarm_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """A row for each method: bands where it alarms, marks where its level is misleading; ``table`` has ``rejected``."""
    methods = list(dict.fromkeys(table.method))
    figure, (panel,) = new_figure(
        1, 1, width_in=8.0, height_in=0.42 * len(methods) + 1.5, title=title, lines_in=0.42 * len(methods)
    )
    half = longest_step(table) / 3.0
    shade(panel, faulted_windows(table), "faulted epochs")
    for k, name in enumerate(methods):
        part = table[table.method == name]
        runs = (part.alarm != part.alarm.shift()).cumsum()[part.alarm]
        for _, times in part.time[part.alarm].groupby(runs):
            start, stop = times.iloc[0] - half, times.iloc[-1] + half
            panel.fill_between([start, stop], k - 0.32, k + 0.32, color="0.25", linewidth=0.4)
        misleading = np.zeros(len(part), bool)
        for axis in judged_by(judged.axis):
            regions = regions_of(part, Judged(judged.alert, axis))
            misleading |= (regions == REGIONS.index(MISLEADING)) | (regions == REGIONS.index(MISLEADING) + 1)
        misleading &= ~part.alarm.to_numpy()
        panel.plot(
            part.time[misleading], np.full(misleading.sum(), k), linestyle="none", marker="v", markersize=6,
            color=series_style(1).colour, markeredgecolor="white", markeredgewidth=0.5,
            label="beyond the level, no alarm" if k == 0 else None,
        )  # fmt: skip
    panel.set_yticks(range(len(methods)), [short_label(str(name)) for name in methods])
    panel.set_ylim(len(methods) - 0.4, -0.6)
    panel.fill_between([], 0, 0, color="0.25", label="alarm")
    panel.set_xlim(table.time.min() - half, table.time.max() + half)
    panel.grid(visible=False, axis="y")
    time_axis(panel, table.time)
    legend_below(figure, [panel], columns=3)
    return figure


def azimuths_deg(g: Geometry, residuals: pd.DataFrame) -> np.ndarray:
    """(k,), azimuths of the rows of residuals of a series [deg]."""
    east, north = -g.design[..., 0], -g.design[..., 1]
    azimuth = np.degrees(np.arctan2(east, north)) % 360.0
    by_name = np.full((len(g.epoch), len(g.names)), np.nan)
    row, column = np.nonzero(g.in_view)
    by_name[row, g.satellite[row, column]] = azimuth[row, column]
    epoch = np.searchsorted(g.epoch, residuals.epoch)
    return by_name[epoch, pd.Index(g.names).get_indexer(residuals.satellite)]


def pictures(stored: Mapping[str, pd.DataFrame], experiment: ObserveExperiment) -> tuple[Picture, ...]:
    """The figures that the table of the epochs holds all of."""
    judged, title = experiment.decides, experiment.title

    def epochs() -> pd.DataFrame:
        table = stored["epochs"]
        # No method has a test of its own, or none of them rejected anything.
        rejected = table.rejected if "rejected" in table else False
        return table.assign(time=pd.to_datetime(table.time), rejected=rejected)

    def stanford(axis: str) -> Figure:
        return stanford_axis_figure(epochs(), stored["stanford"], Judged(judged.alert, axis), title)

    counted = stored["stanford"] if "stanford" in stored else pd.DataFrame({"axis": []})
    return (
        Picture(
            "epochs", "Position errors and protection levels over time.",
            lambda: error_figure(epochs(), judged=judged, title=title),
        ),
        *(
            Picture(
                f"stanford_{axis}",
                f"{axis.capitalize()} error against {axis} protection level, number of epochs in each cell; those that "
                "a method's own test rejects are not in it.",
                partial(stanford, axis),
            )
            for axis in judged.alert.limit_m
            if (counted["axis"] == axis).any()
        ),
        Picture(
            "alarms", "Alarms of each method in time, and epochs with an error beyond the level and no alarm.",
            lambda: alarm_figure(epochs(), judged=judged, title=title),
        ),
        Picture(
            "ground", "Horizontal errors, epoch by epoch; circles hold 50 % and 95 % of each method's.",
            lambda: ground_figure(epochs(), title=title),
        ),
    )  # fmt: skip


def pictures_of_files(
    g: Geometry, table: pd.DataFrame, residuals: pd.DataFrame, truth_m: np.ndarray, title: str
) -> tuple[Picture, ...]:
    """The figures for which the receiver's files are needed: of the satellites, and of a track where there is one."""
    moves = bool(np.linalg.norm(truth_m - truth_m[0], axis=1).max() > _MOVES_M)
    track = Picture(
        "track", "The true track, coloured by the horizontal error of the first method.",
        lambda: track_figure(table, truth_m, title=title),
    )  # fmt: skip
    return (
        *([track] if moves else []),
        Picture(
            "sky", "Where the satellites were, and the error of each without its system's clock; of many points every "
            "nth.",
            lambda: sky_figure(residuals, azimuths_deg(g, residuals), title=title),
        ),
        Picture(
            "satellites", "Satellites in view by system, and dilutions of precision.",
            lambda: satellites_figure(g, title=title),
        ),
    )  # fmt: skip
