"""Figures of an experiment about risk: curves with intervals, the worst faults, the sky, multipliers.

Tables are explained where they are made, in `pl_mc.studies.risk.tables`.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import VERTICAL, Judged
from pl_mc.constants import K_HORIZONTAL, K_VERTICAL
from pl_mc.geometry import Geometry
from pl_mc.report.figures import (
    DOTTED,
    bar_lengths,
    columns_that_fit,
    legend_below,
    legend_in,
    method_label,
    new_figure,
    note,
)
from pl_mc.report.look import SeriesStyle, series_style, styles_of
from pl_mc.studies.risk.tables import EXACT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Below this a probability is nothing to anyone, and no axis goes there.
_SMALLEST = 1e-20

# Satellites this near to each other on the sky map would share a name's place [deg].
_NEAR_DEG = 14.0
# Panels with a name on their own axes are no narrower [mm].
_PANEL_MM = 60.0
# Multipliers are shown up to so many times the smallest.
_FARTHEST = 20.0


def _heading(event: str, judged: Judged) -> str:
    """An event as a probability on an axis."""
    (called,) = judged.called
    limit = {"misleading": "PL", "missed": judged.limits()}[event]
    return f"P({called.size} > {limit}, no alarm)"


def risk_curve_figure(curves: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """Risk against bias, one row of panels per event and one column per satellite."""
    events, satellites, methods = (list(dict.fromkeys(curves[name])) for name in ("event", "satellite", "method"))
    (called,) = judged.called
    figure, axes = new_figure(
        len(events), len(satellites), width_in=4.4 * len(satellites) + 0.6, height_in=3.4 * len(events) + 0.8,
        title=title, sharex=True, sharey="row", panel_mm=_PANEL_MM,
    )  # fmt: skip
    for row, event in enumerate(events):
        panels = axes[row * len(satellites) : (row + 1) * len(satellites)]
        shown = curves[curves.event == event]
        for panel, satellite in zip(panels, satellites, strict=True):
            panel.set_yscale("log")
            for method, style in styles_of(methods).items():
                _curve(panel, shown[(shown.satellite == satellite) & (shown.method == method)], style, judged.axis)
            panel.set_title(f"{satellite}: {event}")
            if event == "misleading":
                panel.axhline(called.promise, **DOTTED)
                note(
                    panel, f"{called.promised}, what {called.multiplier} stands for", (0.995, called.promise),
                    shift=(0, 2), xycoords=("axes fraction", "data"), ha="right", va="bottom", color="0.15",
                )  # fmt: skip
        most = min(float(shown[["probability", "high"]].max().max()), 1.0)
        least = min(_least(shown), called.promise if event == "misleading" else 1.0)
        panels[0].set_ylim(least / 5, max(12.0 * most, 1e4 * _SMALLEST))
        panels[0].set_ylabel(_heading(event, judged))
    for panel in axes[-len(satellites) :]:
        # Small biases, where the risk has its peak, get more room; with this share the slope has no step at 10 m.
        panel.set_xscale("symlog", linthresh=10.0, linscale=0.9 / np.log(10.0))
        ticks = [tick for tick in (0, 5, 10, 20, 50, 100) if tick <= curves.bias_m.max()]
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlim(-0.4, 1.1 * curves.bias_m.max())
        panel.set_xlabel("bias [m]; linear up to 10 m, logarithmic beyond")
    legend_below(figure, axes, columns=2)
    return figure


def _least(rows: pd.DataFrame) -> float:
    """The smallest probability or bound worth an axis."""
    exact = rows.estimator == EXACT
    values = np.concatenate([rows.probability[~exact], rows.low[~exact]])
    values = values[np.isfinite(values) & (values > _SMALLEST)]
    top = rows.probability[exact].max() if exact.any() else np.nan
    # Of an exact curve five decades below its top say how it falls.
    candidates = [*values.tolist(), 1e-5 * top if np.isfinite(top) and top > 0 else 1e-6]
    return max(min(candidates), _SMALLEST)


def _curve(panel: Axes, rows: pd.DataFrame, style: SeriesStyle, axis: str) -> None:
    """One method: a line where it is exact, else estimates with intervals, hollow where there is a warning."""
    if rows.empty:
        return
    label = method_label(rows.method.iloc[0], axis)
    marks: Any = {"linestyle": "none", "marker": style.marker, "markersize": 4, "color": style.colour}
    exact = rows[rows.estimator == EXACT]
    if len(exact):
        panel.plot(
            exact.bias_m, exact.probability.where(exact.probability > 0), style.line, color=style.colour,
            linewidth=1.6, label=f"{label}, exact",
        )  # fmt: skip
        if exact.probability.max() <= _SMALLEST:
            note(
                panel, f"{label}: below {_SMALLEST:g}", (0.98, 0.02), shift=(0, 0), xycoords="axes fraction",
                ha="right", va="bottom", color=style.colour,
            )  # fmt: skip
    rows = rows[rows.estimator != EXACT]
    known = rows.probability.fillna(np.sqrt(rows.low * rows.high))
    for doubtful, fill, about in ((False, style.colour, "95 % interval"), (True, "white", "with a warning")):
        part = rows[((rows.warning != "") == doubtful) & (known > 0)]
        if len(part):
            middle = known[part.index]
            panel.errorbar(
                part.bias_m, middle, yerr=bar_lengths(middle, part.low, part.high), markerfacecolor=fill,
                linewidth=1.2, capsize=3, zorder=3, label=f"{label}, {about}", **marks,
            )  # fmt: skip
    bounded = rows[~(known > 0) & (rows.high > 0) & (rows.high < 1)]
    if len(bounded):
        panel.errorbar(
            bounded.bias_m, bounded.high, yerr=0.6 * bounded.high, uplims=True, markerfacecolor="white",
            label=f"{label}, upper bound", **marks,
        )  # fmt: skip
    checked = rows[rows.subset_probability > 0]
    if len(checked):
        # Two standard errors of the logarithm; without one the point stands alone.
        factor = np.exp(2.0 * (checked.subset_standard_error / checked.subset_probability).fillna(0.0))
        middle = checked.subset_probability
        panel.errorbar(
            checked.bias_m, middle, yerr=bar_lengths(middle, middle / factor, middle * factor), linestyle="none",
            marker="x", markersize=6.5, color="0.25", markeredgewidth=1.2, elinewidth=0.9, zorder=4,
            label=f"{label}, subset simulation, two standard errors",
        )  # fmt: skip


def worst_figure(worst: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """The worst case of every satellite beside the largest on a ramp of 5, 10, ..., 100 m, a panel per event."""
    events, methods = (list(dict.fromkeys(worst[name])) for name in ("event", "method"))
    names = list(dict.fromkeys(worst.sort_values("probability", ascending=False).satellites))
    place = {name: k for k, name in enumerate(names)}
    figure, axes = new_figure(
        1, len(events), width_in=4.4 * len(events) + 0.6, height_in=1.8 + 0.3 * len(names),
        lines_in=0.3 * len(names), panel_mm=70.0,
        title=f"{title}: the worst bias on each satellite", sharey=True,
    )  # fmt: skip
    for panel, event in zip(axes, events, strict=True):
        panel.set_xscale("log")
        rows = worst[worst.event == event]
        for k, (method, style) in enumerate(styles_of(methods).items()):
            shown = rows[(rows.method == method) & (rows.probability > _SMALLEST)]
            places = shown.satellites.map(place).to_numpy() + (0.16 if len(methods) > 1 else 0.0) * (2 * k - 1)
            _worst_of_method(panel, shown, places, style, method_label(method, judged.axis))
        seen = rows.probability > _SMALLEST
        drawn = rows.loc[seen, ["probability", "grid_probability"]].to_numpy()
        drawn = drawn[drawn > _SMALLEST]
        floor = _SMALLEST if (rows.probability <= _SMALLEST).any() or not drawn.size else drawn.min()
        top = rows.high.max()
        panel.set_xlim(floor / 3, min(max(top, 10 * floor) * max((top / floor) ** 0.3, 5.0), 1e3))
        panel.set(yticks=range(len(names)), yticklabels=names, xlabel=_heading(event, judged))
        panel.set_title(event)
        if not seen.all():
            lost = rows[~seen].groupby("method", sort=False).size()
            counts = ", ".join(f"{count} of {method_label(str(method), judged.axis)}" for method, count in lost.items())
            panel.set_xlabel(
                "\n".join([panel.get_xlabel(), *textwrap.wrap(f"not drawn, below {_SMALLEST:g}: {counts}", 52)])
            )
    axes[0].invert_yaxis()
    legend_below(figure, axes, columns=2)
    return figure


def _worst_of_method(panel: Axes, rows: pd.DataFrame, places: np.ndarray, style: SeriesStyle, label: str) -> None:
    """The worst biases of one method with their intervals and sizes, joined to the largest of the ramp."""
    grid = rows.grid_probability
    panel.hlines(places, grid.clip(lower=_SMALLEST), rows.probability, color=style.colour, linewidth=1.0, alpha=0.6)
    panel.plot(
        grid.where(grid > _SMALLEST), places, linestyle="none", marker="|", markersize=7, color=style.colour,
        label=f"{label}, largest of 5, 10, ..., 100 m",
    )  # fmt: skip
    # Open marks: with a warning, or the largest that a search saw without an estimate of its own.
    estimated = rows.refined if "refined" in rows else pd.Series(True, index=rows.index)
    rough = (rows.warning != "") | estimated.eq(False)
    for doubtful, fill in ((False, style.colour), (True, "white")):
        at = (rough == doubtful).to_numpy()
        if at.any():
            part = rows[at]
            panel.errorbar(
                part.probability, places[at], xerr=bar_lengths(part.probability, part.low, part.high),
                linestyle="none", marker=style.marker, markersize=5.5, markerfacecolor=fill, color=style.colour,
                linewidth=1.2, label=f"{label}, worst bias" + (", rough or with a warning" if doubtful else ""),
            )  # fmt: skip
    for (_, row), height in zip(rows.iterrows(), places, strict=True):
        size = "any" if not np.isfinite(row.bias_m) else f"{row.bias_m:.1f} m" if row.bias_m else "no bias"
        end = max(row.high, row.probability)
        note(panel, size, (end, height), shift=(6, 0), fontsize=7, va="center", color=style.colour)


def step_figure(steps: pd.DataFrame, worst: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """How a ramp of 5, 10, ... m steps over the peak of the risk: exact least squares near the worst bias."""
    events = list(dict.fromkeys(steps.event))
    count = max(len(events), 1)
    figure, axes = new_figure(
        1,
        count,
        width_in=4.4 * count + 0.4,
        height_in=3.9,
        title=f"{title}: what a ramp in steps of 5 m sees",
        panel_mm=70.0,
    )
    peak_colour = series_style(1).colour
    for panel, event in zip(axes, events, strict=False):
        rows = steps[steps.event == event]
        panel.plot(
            rows.bias_m, rows.probability, color=styles_of(rows.method)[rows.method.iloc[0]].colour, linewidth=1.6
        )
        ramp = rows[(rows.bias_m > 0) & (np.abs(rows.bias_m / 5 - np.round(rows.bias_m / 5)) < 1e-9)]
        panel.plot(ramp.bias_m, ramp.probability, linestyle="none", marker="s", markersize=5, color="0.2")
        method, satellite = rows.method.iloc[0], rows.satellite.iloc[0]
        same = (worst.event == event) & (worst.method == method) & (worst.satellites == satellite)
        top = worst[same].iloc[0]
        panel.plot(
            top.bias_m, top.probability, marker="o", markersize=8, markeredgewidth=1.6, markerfacecolor="none",
            color=peak_colour,
        )  # fmt: skip
        ratio = top.probability / ramp.probability.max()
        note(
            panel, f"worst: {top.bias_m:.2f} m, {top.probability:.2g}\n{ratio:.2f} times the largest\nof the ramp",
            (top.bias_m, top.probability), shift=(11, 8), va="bottom", color=peak_colour,
        )  # fmt: skip
        first = ramp.iloc[int(np.argmax(ramp.probability))]
        note(
            panel, f"largest of the\nramp: {first.bias_m:g} m", (first.bias_m, first.probability), shift=(26, -4),
            va="center", ha="left", color="0.2",
            arrowprops={"arrowstyle": "-", "color": "0.5", "linewidth": 0.8, "shrinkB": 4},
        )  # fmt: skip
        panel.set_yscale("log")
        least = rows.probability[rows.probability > 1e-6 * top.probability].min()
        panel.set_ylim(max(least / 8, 1e-300), top.probability * 200)
        panel.set(xlabel=f"bias on {satellite} [m]", ylabel=_heading(event, judged))
        panel.set_title(f"least squares, exact: {event}")
    return figure


def sky_figure(worst: pd.DataFrame, g: Geometry, *, axis: str, title: str) -> Figure:
    """The sky of the epoch, each satellite coloured by its worst case of the first event, one panel per method."""
    from matplotlib import patheffects
    from matplotlib.colors import LogNorm
    from matplotlib.projections.polar import PolarAxes

    event = worst.event.iloc[0]
    chosen = worst[worst.event == event]
    methods = list(dict.fromkeys(chosen.method))
    figure, axes = new_figure(
        1, len(methods), width_in=4.1 * len(methods) + 0.8, height_in=4.4,
        title=f"{title}: worst case of each satellite, {event}", panel_mm=70.0, subplot_kw={"projection": "polar"},
    )  # fmt: skip
    known = chosen.probability[chosen.probability > _SMALLEST]
    low, high = (known.min(), known.max()) if len(known) else (_SMALLEST, 1.0)
    # Whole decades, so that the colour bar has numbers at its ends.
    top = 10.0 ** np.ceil(np.log10(high))
    norm = LogNorm(min(max(10.0 ** np.floor(np.log10(low)), top * 1e-12), top / 10), top)
    angle, zenith = g.azimuth_rad, 90.0 - np.degrees(g.elevation_rad)
    image = None
    for panel, method in zip(axes, methods, strict=True):
        assert isinstance(panel, PolarAxes)
        rows = chosen[chosen.method == method].set_index("satellites").reindex(list(g.names))
        image = panel.scatter(
            angle, zenith, c=rows.probability.clip(lower=norm.vmin), norm=norm, cmap="viridis_r", s=100,
            edgecolors="0.2", linewidths=0.8, zorder=3, plotnonfinite=False,
        )  # fmt: skip
        unknown = rows.probability.isna().to_numpy()
        panel.scatter(
            angle[unknown], zenith[unknown], s=100, facecolors="white", edgecolors="0.5", linestyle=":", zorder=2
        )
        for name, *at, right, up in zip(g.names, angle, zenith, *_label_sides(angle, zenith), strict=True):
            note(
                panel, name, tuple(at), shift=(17 * right, 12 * up), ha="center", va="center", fontsize=7.5,
                zorder=4, path_effects=[patheffects.withStroke(linewidth=2, foreground="white")],
            )  # fmt: skip
        panel.set_theta_zero_location("N")
        panel.set_theta_direction(-1)
        panel.set_ylim(0, 90)
        panel.set_yticks([30, 60, 90], ["60°", "30°", ""], fontsize=7.5, color="0.4")
        panel.set_xticks(np.radians([0, 90, 180, 270]), ["N", "E", "S", "W"])
        panel.spines["polar"].set_visible(True)
        panel.spines["polar"].set_color("0.6")
        panel.set_title(method_label(method, axis) + (" (dotted: not searched)" if unknown.any() else ""))
    assert image is not None
    figure.colorbar(image, ax=axes, label=f"P({event}) under the worst bias", shrink=0.8, pad=0.03)
    return figure


def _label_sides(angle: np.ndarray, zenith: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each satellite's name goes, right and up as -1, 0 or 1: below, unless a neighbour is near."""
    at = np.array([zenith * np.sin(angle), zenith * np.cos(angle)])
    apart = np.hypot(*(at[:, :, None] - at[:, None, :]))
    np.fill_diagonal(apart, np.inf)
    right, up = at - at[:, apart.argmin(axis=1)]
    alone, aside = apart.min(axis=1) > _NEAR_DEG, np.abs(right) > np.abs(up)
    return (
        np.where(alone | ~aside, 0, np.where(right > 0, 1, -1)),
        np.where(alone, -1, np.where(aside, 0, np.where(up > 0, 1, -1))),
    )


def calibration_figure(
    calibration: pd.DataFrame, curves: pd.DataFrame, equal_risk: pd.DataFrame, *, judged: Judged, title: str
) -> Figure:
    """P(event) against the multiplier, a panel per fault, and alarms against the bias at equal risk."""
    calibration, curves, equal_risk = (
        table.rename(columns={f"k_{judged.axis}": "k"}) for table in (calibration, curves, equal_risk)
    )
    usual_k = K_VERTICAL if judged.axis == VERTICAL else K_HORIZONTAL
    asked, methods = (list(dict.fromkeys(calibration[name])) for name in ("asked", "method"))
    columns = columns_that_fit(2 if len(asked) > 1 else len(asked) + 1, panel_mm=_PANEL_MM)
    rows = -(-(len(asked) + 1) // columns)
    figure, axes = new_figure(
        rows, columns, width_in=4.9 * columns + 0.3, height_in=3.7 * rows + 1.1, title=title, panel_mm=_PANEL_MM
    )
    # A method whose multipliers have no end would leave nothing to see of the others.
    usual = calibration.k_high[calibration.k_high < _FARTHEST * calibration.k_low[calibration.k_low > 0].min()]
    smallest = calibration.target.min()
    for panel, fault in zip(axes, asked, strict=False):
        sought, shown = calibration[calibration.asked == fault], curves[curves.asked == fault]
        for method, style in styles_of(methods).items():
            _multipliers(panel, sought[sought.method == method], shown[shown.method == method], style, judged.axis)
        panel.axhline(smallest, **DOTTED)
        panel.axvline(usual_k, **DOTTED)
        note(
            panel, f"K {usual_k:g}", (usual_k, 0.02), shift=(-3, 0), xycoords=("data", "axes fraction"),
            ha="right", va="bottom", color="0.15",
        )  # fmt: skip
        panel.set_yscale("log")
        panel.set(xlabel=f"multiplier K of the {judged.axis} level", ylabel=f"P({calibration.event.iloc[0]})")
        panel.set(xlim=(0, 1.1 * usual.max()), ylim=(0.2 * smallest, 1.0))
        # Where every method has a fault of its own these stand in the heading.
        faults = list(dict.fromkeys(sought.fault))
        own = "" if faults == [fault] else f": {', '.join(faults)}"
        panel.set_title("fault-free" if fault == "none" else f"{fault}{own}", fontsize=9.5)
    _equal_risk(axes[len(asked)], equal_risk, judged)
    for spare in axes[len(asked) + 1 :]:
        spare.set_visible(False)
    legend_below(figure, axes[:1], columns=3)
    return figure


def _multipliers(panel: Axes, rows: pd.DataFrame, curve: pd.DataFrame, style: SeriesStyle, axis: str) -> None:
    """One method: its curve with the band of its bounds, counted multipliers, and the check of estimated ones."""
    if rows.empty:
        return
    label = method_label(rows.method.iloc[0], axis)
    exact = bool((rows.found == EXACT).all())
    if len(curve):
        line = f"{label}, exact" if exact else f"{label}, subset simulation"
        panel.plot(curve.k, curve.probability, style.line, color=style.colour, linewidth=1.5, label=line)
        if not exact:
            panel.fill_between(curve.k, curve.low, curve.high, color=style.colour, alpha=0.25, linewidth=0)
    if exact:
        return
    known = rows[rows.k.notna()]
    for rare, about, fill in ((False, "counted", "white"), (True, "calibrated", style.colour)):
        part = known[(known.found != "counting") == rare]
        if len(part):
            upper = part.k_high.where(np.isfinite(part.k_high), part.k)
            panel.errorbar(
                part.k, part.target, xerr=bar_lengths(part.k, part.k_low, upper),
                linestyle="none", marker=style.marker, markersize=4.5, markerfacecolor=fill, color=style.colour,
                capsize=2.5, zorder=3, label=f"{label}, {about}",
            )  # fmt: skip
    checked = known[known.check_probability > 0]
    if len(checked):
        panel.errorbar(
            checked.k, checked.check_probability,
            yerr=bar_lengths(checked.check_probability, checked.check_low, checked.check_high), linestyle="none",
            marker="x", markersize=6.5, color="0.25", capsize=2.5, zorder=4,
            label="importance sampling",
        )  # fmt: skip


def _equal_risk(panel: Axes, rows: pd.DataFrame, judged: Judged) -> None:
    """Alarm rate against bias, with the multipliers of the largest and the smallest target."""
    methods = list(dict.fromkeys(rows.method))
    shared = rows.groupby("target")["method"].nunique() >= min(len(methods), 2)
    targets = sorted(shared.index[shared], reverse=True) or sorted(rows.target.unique(), reverse=True)
    for target, width in {targets[0]: 0.8, targets[-1]: 2.0}.items():
        for method, style in styles_of(methods).items():
            part = rows[(rows.method == method) & (rows.target == target)].sort_values("bias_m")
            if len(part):
                panel.errorbar(
                    part.bias_m, part.alarm_rate,
                    yerr=bar_lengths(part.alarm_rate, part.alarm_low, part.alarm_high), linestyle=style.line,
                    marker=style.marker, markersize=3.5, color=style.colour, linewidth=width, elinewidth=1.0,
                    label=f"{method}, {target:g}: K {part.k.iloc[0]:.3g}",
                )  # fmt: skip
    satellite = next((label.split(":")[0] for label in rows.fault if label != "none"), "")
    panel.set(xlabel=f"bias on {satellite} [m]", ylabel=f"P(alarm), {judged.limits()}", ylim=(-0.03, 1.05))
    panel.set_title("Alarms at equal risk")
    legend_in(panel, loc="center right", bbox_to_anchor=(1.0, 0.3), fontsize=7.5)
