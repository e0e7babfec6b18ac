"""Figures of a service volume: maps of availability, levels and satellites, the day as a whole, the sky."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.geometry import Geometry
from pl_mc.report.figures import in_common_look, method_label, new_figure, series_style
from pl_mc.report.findings import Picture
from pl_mc.report.sky_plot import sky_figure
from pl_mc.report.text import percent
from pl_mc.report.world_map import world_figure
from pl_mc.service.volume import ServiceVolume
from pl_mc.studies.service.text import rows_of

if TYPE_CHECKING:
    from pl_mc.studies.service.run import ServiceExperiment


def pictures(experiment: ServiceExperiment, volume: ServiceVolume, sky: Geometry) -> tuple[Picture, ...]:
    """All figures of a run; ``sky`` is the series over the site of the sky plot."""
    title, methods, limits = experiment.title, volume.methods, experiment.alert_limits()
    site = f"Satellites over {experiment.site}, {experiment.mask_deg:g} deg mask; names at the first epoch"
    # Where every method serves everywhere an operation has nothing to show.
    least = volume.world.groupby("operation", sort=False).worst_rate.min()
    shown = [one.name for one in volume.operations if least[one.name] < 1.0] or [volume.operations[0].name]
    availability = {
        f"{method_label(m)}: {_mean_text(volume, m, limits.name)} of area and time": _share(volume, m, limits.name)
        for m in methods
    }
    operations = {f"{o}, {m}: {_mean_text(volume, m, o)}": _share(volume, m, o) for o in shown for m in methods}
    levels = {method_label(m): volume.levels[volume.levels.method == m].vpl_99_m.to_numpy() for m in methods}
    # Few sites with very large levels would take all colours.
    finite = np.concatenate([values[np.isfinite(values)] for values in levels.values()])
    low, high = (float(finite.min()), float(np.quantile(finite, 0.98))) if finite.size else (0.0, 1.0)
    satellites = {
        "smallest number over the epochs": volume.satellites.satellites_min.to_numpy(dtype=float),
        "mean": volume.satellites.satellites_mean.to_numpy(),
    }
    world = partial(world_figure, volume.grid)
    return (
        Picture(
            "world_availability",
            world(availability, title=f"{title}: {limits_text(limits)}", label="availability", shares=True),
            "Share of the day with service, by method.",
        ),
        Picture(
            "world_operations",
            world(
                operations, title=f"{title}: availability, and its mean over area and time", label="availability",
                shares=True, columns=len(methods),
            ),
            "The same for every operation.",
        ),
        Picture(
            "world_levels",
            world(
                levels, title=f"{title}: vertical protection levels",
                label=f"VPL not exceeded in 99 % of the scenarios [m]; white: none; colours end at {high:.3g} m",
                limits=(low, high), logarithmic=True,
            ),
            "Vertical protection levels not exceeded in 99 % of the scenarios.",
        ),
        Picture(
            "world_satellites",
            world(satellites, title=f"{title}: satellites in view", label="satellites in view"),
            "Satellites in view.",
        ),
        Picture(
            "world_day", day_figure(volume, title=title), "Share of the Earth's area without service over the day."
        ),
        Picture(
            "sky",
            sky_figure(sky, mask_deg=experiment.mask_deg, title=site),
            "Ways of the satellites over one site.",
        ),
    )  # fmt: skip


@in_common_look
def day_figure(volume: ServiceVolume, *, title: str) -> Figure:
    """The share of the Earth's area without service, epoch by epoch, a panel for each operation that has any."""
    table = volume.by_epoch
    table = table.assign(hours=(table.time_gps_s - volume.time_gps_s[0]) / 3600.0, lost=1.0 - table.area_share)
    lost = table.groupby("operation", sort=False).lost.max()
    # Shares are sums of many cells, so that full service may miss one by rounding.
    shown = [limits for limits in volume.operations if lost[limits.name] > 1e-9] or volume.operations[:1]
    figure, axes = new_figure(
        len(shown), 1, width_in=8.5, height_in=0.9 + 1.75 * len(shown), sharex=True,
        title=f"{title}: share of the Earth's area without service",
    )  # fmt: skip
    for panel, limits in zip(axes, shown, strict=True):
        for k, method in enumerate(volume.methods):
            rows, style = rows_of(table, method, limits.name), series_style(k)
            panel.plot(
                rows.hours, 100.0 * np.maximum(rows.lost, 0.0), color=style.colour, linestyle=style.line,
                linewidth=1.2, label=method_label(method),
            )  # fmt: skip
        panel.set_title(limits_text(limits))
        panel.set(ylabel="area [%]")
        panel.set_ylim(bottom=0.0)
    axes[-1].set_xlabel("time from the start [h]")
    axes[-1].set_xlim(0.0, float(table.hours.max()) or 1.0)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def limits_text(alert: AlertLimits) -> str:
    """``LPV-200, VAL 35 m, HAL 40 m``."""
    vertical = f"VAL {alert.vertical_m:g} m, " if alert.has_vertical else ""
    return f"{alert.name}, {vertical}HAL {alert.horizontal_m:g} m"


def _share(volume: ServiceVolume, method: str, operation: str) -> NDArray[np.float64]:
    return rows_of(volume.sites, method, operation).availability_rate.to_numpy()


def _mean_text(volume: ServiceVolume, method: str, operation: str) -> str:
    return f"{percent(float(rows_of(volume.world, method, operation).availability_rate.iloc[0]))} %"
