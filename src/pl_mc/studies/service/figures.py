"""Figures of a service volume: maps of availability, levels and satellites, and the day as a whole."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, method_label, new_figure, series_style
from pl_mc.report.text import percent
from pl_mc.report.world_map import world_figure
from pl_mc.service.volume import ServiceVolume


def availability_maps(found: ServiceVolume, alert: AlertLimits, *, title: str) -> Figure:
    """Share of the scenarios in which each method serves one operation, site by site."""
    panels = {_heading(found, m, alert.name): _availability(found, m, alert.name) for m in found.methods}
    return world_figure(
        found.grid, panels, title=f"{title}: {limits_text(alert)}", label="availability", shares=True
    )


def operation_maps(found: ServiceVolume, *, title: str) -> Figure:
    """A map for every method and operation, methods side by side; not of operations that all serve everywhere."""
    least = found.world.groupby("operation", sort=False).worst_rate.min()
    shown = [one for one in found.operations if least[one.name] < 1.0] or found.operations[:1]
    panels = {
        f"{one.name}, {m}: {_world_text(found, m, one.name)}": _availability(found, m, one.name)
        for one in shown
        for m in found.methods
    }
    return world_figure(
        found.grid,
        panels,
        title=f"{title}: availability, and its mean over area and time",
        label="availability",
        shares=True,
        columns=len(found.methods),
    )


def vertical_level_maps(found: ServiceVolume, *, title: str) -> Figure:
    """The vertical protection level that each method does not exceed in 99 % of the scenarios."""
    panels = {}
    for method in found.methods:
        rows = found.levels[found.levels.method == method]
        panels[method_label(method)] = rows.vpl_99_m.to_numpy()
    # Few sites with very large levels would take all colours.
    finite = np.concatenate([values[np.isfinite(values)] for values in panels.values()])
    high = float(np.quantile(finite, 0.98)) if finite.size else 1.0
    low = float(finite.min()) if finite.size else 0.0
    return world_figure(
        found.grid, panels, title=f"{title}: vertical protection levels",
        label=f"VPL not exceeded in 99 % of the scenarios [m]; white: none; colours end at {high:.3g} m",
        limits=(low, high),
        logarithmic=True,
    )  # fmt: skip


def satellite_maps(found: ServiceVolume, *, title: str) -> Figure:
    """Smallest and mean number of satellites in view."""
    table = found.satellites
    panels = {
        "smallest number over the epochs": table.satellites_min.to_numpy(dtype=float),
        "mean": table.satellites_mean.to_numpy(),
    }
    return world_figure(found.grid, panels, title=f"{title}: satellites in view", label="satellites in view")


@in_common_look
def day_figure(found: ServiceVolume, *, title: str) -> Figure:
    """The share of the Earth's area without service, epoch by epoch, a panel for each operation that has any."""
    table = found.by_epoch.assign(
        hours=(found.by_epoch.time_gps_s - found.time_gps_s[0]) / 3600.0, lost=1.0 - found.by_epoch.area_share
    )
    lost = table.groupby("operation", sort=False).lost.max()
    # Shares are sums of many cells, so that full service may miss one by rounding.
    shown = [name for name in lost.index if lost[name] > 1e-9] or [found.operations[0].name]
    figure, axes = new_figure(len(shown), 1, width_in=8.5, height_in=0.9 + 1.75 * len(shown), sharex=True)
    figure.suptitle(f"{title}: share of the Earth's area without service", x=0.01, ha="left", fontsize=11)
    for panel, name in zip(axes, shown, strict=True):
        for k, (method, group) in enumerate(table[table.operation == name].groupby("method", sort=False)):
            style = series_style(k)
            panel.plot(
                group.hours, 100.0 * np.maximum(group.lost, 0.0), color=style.colour, linestyle=style.line,
                linewidth=1.2, label=method_label(str(method)),
            )  # fmt: skip
        limits = next(one for one in found.operations if one.name == name)
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


def _availability(found: ServiceVolume, method: str, operation: str) -> NDArray[np.float64]:
    rows = found.sites[(found.sites.method == method) & (found.sites.operation == operation)]
    return rows.availability_rate.to_numpy()


def _heading(found: ServiceVolume, method: str, operation: str) -> str:
    return f"{method_label(method)}: {_world_text(found, method, operation)} of area and time"


def _world_text(found: ServiceVolume, method: str, operation: str) -> str:
    rows = found.world[(found.world.method == method) & (found.world.operation == operation)]
    return f"{percent(float(rows.availability_rate.iloc[0]))} %"
