"""Sky plot: the ways of the satellites over one site, seen from below the zenith."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pl_mc.geometry.record import SYSTEM_NAMES, Geometry
from pl_mc.report.figures import in_common_look, series_style


@in_common_look
def sky_figure(g: Geometry, *, mask_deg: float, title: str) -> Figure:
    """Azimuth and elevation of every satellite over the epochs, its name where it is at the first epoch in view.

    Args:
        g: a series over one site.
        mask_deg: elevation mask [deg].
        title: heading.
    """
    series = g.as_series()
    azimuth, zenith = series.azimuth_rad, 90.0 - np.degrees(series.elevation_rad)
    figure = Figure(figsize=(7.2, 7.4), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    panel = figure.add_subplot(projection="polar")
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
            panel.annotate(
                name,
                (azimuth[0, row], zenith[0, row]),
                xytext=(6, 3) if right else (-6, -10),
                textcoords="offset points",
                ha="left" if right else "right",
                fontsize=8,
                color="0.1",
                bbox={"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.6},
            )
    around = np.linspace(0.0, 2 * np.pi, 181)
    panel.plot(around, np.full_like(around, 90.0 - mask_deg), color="0.15", linewidth=1.0, linestyle=(0, (6, 2)))
    panel.set_rlim(0.0, 90.0)  # type: ignore[attr-defined]
    panel.set_rgrids([0, 15, 30, 45, 60, 75], ["90°", "75°", "60°", "45°", "30°", "15°"], angle=22.5, fontsize=7.5)  # type: ignore[attr-defined]
    panel.set_thetagrids(range(0, 360, 45), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])  # type: ignore[attr-defined]
    figure.legend(loc="outside lower center", ncols=max(1, len(letters)))
    return figure
