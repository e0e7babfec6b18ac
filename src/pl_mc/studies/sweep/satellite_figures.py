"""Figures that set the satellites of one epoch side by side, and the paper's single realisation of a ramp."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, limit_line, method_label, new_figure, series_style


@in_common_look
def realisation_figure(outcomes: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """VPL of every method against the bias for one noise draw, as the paper's figure 6 shows it.

    Args:
        outcomes: one draw's rows of `pl_mc.sample`: ``method, bias_m, vpl_m``.
        alert: alert limits.
        title: heading.
    """
    figure, (axes,) = new_figure(1, 1, width_in=7.2, height_in=4.2)
    for k, (name, group) in enumerate(outcomes.groupby("method", sort=False)):
        style = series_style(k)
        axes.plot(
            group.bias_m, group.vpl_m, style.line, marker=style.marker, markersize=4.5, color=style.colour,
            label=method_label(str(name)),
        )  # fmt: skip
    limit_line(axes, alert.vertical_m, f"VAL {alert.vertical_m:g} m")
    axes.set(xlabel="bias [m]", ylabel="vertical protection level [m]", ylim=(0, None))
    axes.set_title(f"{title}; one noise draw")
    axes.legend(loc="upper left")
    return figure


@in_common_look
def satellite_figure(rates: pd.DataFrame, satellites: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Alarm rate and rate of misleading information by satellite and bias, one column of panels per method.

    Args:
        rates: a sweep's table with the column ``satellite``.
        satellites: ``satellite, elevation_deg, redundancy``.
        alert: alert limits.
        title: heading.
    """
    methods = list(dict.fromkeys(rates.method))
    order = satellites.sort_values("redundancy").satellite.tolist()
    facts = satellites.set_index("satellite")
    labels = [f"{s}  r {facts.redundancy[s]:.2f}  {facts.elevation_deg[s]:2.0f}°" for s in order]
    figure, axes = new_figure(
        2,
        len(methods),
        width_in=4.3 * len(methods) + 0.8,
        height_in=1.6 + 0.42 * len(order),
        sharex=True,
        sharey=True,
    )
    figure.suptitle(f"{title}; every satellite, sorted by redundancy number r (elevation)", x=0.01, ha="left")
    floor = 0.5 / rates.draws.max()
    for row, (event, heading, norm) in enumerate(
        (
            ("alarm", f"P(alarm), VAL {alert.vertical_m:g} m", Normalize(0.0, 1.0)),
            ("misleading", "P(|vertical error| > VPL, no alarm)", LogNorm(floor, 1.0)),
        )
    ):
        panels = axes[row * len(methods) : (row + 1) * len(methods)]
        for panel, method in zip(panels, methods, strict=True):
            grid = rates[rates.method == method].pivot(index="satellite", columns="bias_m", values=f"{event}_rate")
            grid = grid.loc[order]
            values = np.ma.masked_less_equal(grid.to_numpy(), 0.0) if event == "misleading" else grid.to_numpy()
            image = panel.pcolormesh(grid.columns, np.arange(len(order)), values, norm=norm, cmap="viridis")
            panel.grid(visible=False)
            panel.set_facecolor("0.93")
            panel.set_title(f"{method_label(method)}: {event}")
        panels[0].set_yticks(np.arange(len(order)), labels, family="monospace", fontsize=7.5)
        figure.colorbar(image, ax=panels, label=heading, pad=0.01)
    for panel in axes[len(methods) :]:
        panel.set_xlabel("bias [m]; grey: none seen" if panel is axes[len(methods)] else "bias [m]")
    return figure
