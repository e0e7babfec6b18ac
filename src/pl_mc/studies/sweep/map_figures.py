"""Maps of an event's rate over time and satellite, one panel per method."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, method_label, new_figure

_MEANING = {
    "alarm": "P(alarm)",
    "missed": "P(|vertical error| > VAL, no alarm)",
    "misleading": "P(|vertical error| > VPL, no alarm)",
}


@in_common_look
def map_figure(rates: pd.DataFrame, *, event: str, alert: AlertLimits, title: str) -> Figure:
    """The rate of one event by epoch and faulted satellite, averaged over the ramp.

    Args:
        rates: ``epoch, satellite, method, draws``, ``<event>_rate`` and ``<event>_high``.
        event: ``alarm``, ``missed`` or ``misleading``.
        alert: alert limits.
        title: heading.
    """
    methods = list(dict.fromkeys(rates.method))
    satellites = sorted(rates.satellite.unique(), key=lambda name: ("GCER".index(name[0]), name))
    figure, axes = new_figure(
        len(methods), 1, width_in=9.0, height_in=1.0 + (1.0 + 0.115 * len(satellites)) * len(methods), sharex=True
    )
    figure.suptitle(
        f"{title}: {_MEANING[event]}, mean over the biases; VAL {alert.vertical_m:g} m", x=0.01, ha="left"
    )
    column = f"{event}_rate"
    floor = 0.5 / rates.draws.max()
    norm = Normalize(0.0, 1.0) if event == "alarm" else LogNorm(floor, max(float(rates[column].max()), 10 * floor))
    for panel, method in zip(axes, methods, strict=True):
        part = rates[rates.method == method]
        grid = part.pivot(index="satellite", columns="epoch", values=column).reindex(index=satellites)
        values = grid.to_numpy()
        # White is out of view, grey is in view with nothing seen.
        panel.pcolormesh(
            grid.columns, np.arange(len(satellites)), np.where(np.isfinite(values), 0.0, np.nan), cmap="gray",
            vmin=-7.0, vmax=0.5, shading="nearest", rasterized=True,
        )  # fmt: skip
        shown = (
            np.ma.masked_invalid(values) if event == "alarm" else np.ma.masked_less_equal(np.nan_to_num(values), 0)
        )
        image = panel.pcolormesh(
            grid.columns, np.arange(len(satellites)), shown, norm=norm, cmap="viridis", shading="nearest",
            rasterized=True,
        )  # fmt: skip
        panel.grid(visible=False)
        panel.set_yticks(np.arange(len(satellites)), satellites, fontsize=6)
        panel.invert_yaxis()
        bound = f"none seen, below {part[f'{event}_high'].max():.2g} in each cell (95 % bound)"
        panel.set_title(method_label(method) + ("" if np.nanmax(values) > 0 else f": {bound}"))
    axes[-1].set_xlabel("epoch" + ("" if event == "alarm" else "; grey: in view, none seen"))
    if rates[column].max() > 0:
        figure.colorbar(image, ax=axes, label=_MEANING[event], pad=0.01)
    return figure
