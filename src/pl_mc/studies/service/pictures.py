"""The figures of a service volume: maps of the world, the day, and the sky over one site."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import legend_below, method_label, new_figure
from pl_mc.report.findings import Picture
from pl_mc.report.look import styles_of
from pl_mc.report.maps import sky_figure, world_figure
from pl_mc.report.text import percent
from pl_mc.service.sky import world_grid
from pl_mc.studies.service.run import ServiceExperiment
from pl_mc.studies.service.text import rows_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Mapping[str, pd.DataFrame]


def pictures(stored: Tables, experiment: ServiceExperiment) -> tuple[Picture, ...]:
    """All figures of a run."""
    title, limits = experiment.title, experiment.alert_limits()
    grid = world_grid(experiment.step_deg)
    methods = [method.name for method in experiment.method_records()]

    def world(maps: Callable[[], dict[str, NDArray[np.float64]]], what: str, **options: Any) -> Callable[[], Figure]:
        return lambda: world_figure(grid, maps(), title=f"{title}: {what}", **options)

    def share(method: str, operation: str) -> NDArray[np.float64]:
        return rows_of(stored["sites"], method, operation).availability_rate.to_numpy()

    def mean(method: str, operation: str) -> str:
        return f"{percent(float(rows_of(stored['world'], method, operation).availability_rate.iloc[0]))} %"

    def availability() -> dict[str, NDArray[np.float64]]:
        name = limits.name
        return {f"{method_label(m)}: {mean(m, name)} of area and time": share(m, name) for m in methods}

    def operations() -> dict[str, NDArray[np.float64]]:
        # Where every method serves everywhere an operation has nothing to show.
        least = stored["world"].groupby("operation", sort=False).worst_rate.min()
        named = [one.name for one in experiment.limits()]
        shown = [name for name in named if least[name] < 1.0] or named[:1]
        every = {f"{o}, {m}: {mean(m, o)}": share(m, o) for o in shown for m in methods}
        # A map on which all is the same says no more than its mean.
        return {name: values for name, values in every.items() if np.ptp(values) > 0} or every

    def levels() -> Figure:
        table = stored["levels"]
        maps = {method_label(m): table[table.method == m].vpl_99_m.to_numpy() for m in methods}
        # Few sites with very large levels would take all colours.
        finite = np.concatenate([values[np.isfinite(values)] for values in maps.values()])
        low, high = (float(finite.min()), float(np.quantile(finite, 0.98))) if finite.size else (0.0, 1.0)
        return world_figure(
            grid, maps, title=f"{title}: vertical protection levels", limits=(low, high), logarithmic=True,
            label=f"VPL not exceeded in 99 % of the scenarios [m]; white: none; colours end at {high:.3g} m",
        )  # fmt: skip

    def satellites() -> dict[str, NDArray[np.float64]]:
        table = stored["satellites"]
        return {
            "smallest number over the epochs": table.satellites_min.to_numpy(dtype=float),
            "mean": table.satellites_mean.to_numpy(),
        }

    def sky() -> Figure:
        heading = f"Satellites over {experiment.site}, {experiment.mask_deg:g} deg mask; names at the first epoch"
        return sky_figure(experiment.sky(), mask_deg=experiment.mask_deg, title=heading)

    shares: dict[str, Any] = {"label": "availability", "shares": True}
    of_operations = "availability, and its mean over area and time"
    return (
        Picture(
            "world_availability", "Share of the day with service, by method.",
            world(availability, limits_text(limits), **shares),
        ),
        Picture(
            "world_operations", "The same for every operation; maps that are the same everywhere are left out.",
            world(operations, of_operations, columns=min(len(methods), 3), **shares),
        ),
        Picture("world_levels", "Vertical protection levels not exceeded in 99 % of the scenarios.", levels),
        Picture(
            "world_satellites", "Satellites in view.",
            world(satellites, "satellites in view", label="satellites in view"),
        ),
        Picture(
            "world_day", "Share of the Earth's area without service over the day.",
            lambda: day_figure(stored["by_epoch"], experiment.limits(), title=title),
        ),
        Picture("sky", "Ways of the satellites over one site.", sky),
    )  # fmt: skip


def day_figure(by_epoch: pd.DataFrame, operations: tuple[AlertLimits, ...], *, title: str) -> Figure:
    """The share of the Earth's area without service, epoch by epoch, a panel for each operation that has any."""
    since_s = by_epoch.time_gps_s - by_epoch.time_gps_s.min()
    table = by_epoch.assign(hours=since_s / 3600.0, lost=1.0 - by_epoch.area_share)
    lost = table.groupby("operation", sort=False).lost.max()
    styles = styles_of(table.method)
    # Shares are sums of many cells, so that full service may miss one by rounding.
    shown = [limits for limits in operations if lost[limits.name] > 1e-9] or operations[:1]
    figure, axes = new_figure(
        len(shown), 1, width_in=8.5, height_in=0.9 + 1.75 * len(shown), sharex=True,
        title=f"{title}: share of the Earth's area without service",
    )  # fmt: skip
    for panel, limits in zip(axes, shown, strict=True):
        for method, style in styles.items():
            rows, look = rows_of(table, method, limits.name), style.look | {"marker": ""}
            lost_percent = 100.0 * np.maximum(rows.lost, 0.0)
            panel.plot(rows.hours, lost_percent, **look, linewidth=1.2, label=method_label(method))
        panel.set_title(limits_text(limits))
        panel.set(ylabel="area [%]", ylim=(0.0, None))
    axes[-1].set(xlabel="time from the start [h]", xlim=(0.0, float(table.hours.max()) or 1.0))
    legend_below(figure, axes[:1], columns=len(styles), side="center")
    return figure


def limits_text(alert: AlertLimits) -> str:
    """``LPV-200, VAL 35 m, HAL 40 m``."""
    return f"{alert.name}, {alert.words}"
