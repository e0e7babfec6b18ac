"""Figures of an experiment about risk: curves with intervals, worst cases, calibrated multipliers."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from pl_mc.alert import AlertLimits
from pl_mc.geometry import Geometry
from pl_mc.report.figures import in_common_look, method_label, new_figure, series_style

# Below this a probability is nothing to anyone, and no axis goes there.
SMALLEST = 1e-20

# The risk that the usual multiplier of a vertical level stands for.
_MEANT = 1e-7

_EXACT = "exact"
_GREY = "0.25"
# Satellites this near to each other on the sky map would share a name's place [deg].
_NEAR_DEG = 14.0
_HEADINGS = {
    "misleading": "P(|vertical error| > {level}, no alarm)",
    "missed": "P(|vertical error| > VAL {limit:g} m, no alarm)",
}


def event_heading(event: str, alert: AlertLimits) -> str:
    """An event as a probability on an axis."""
    return _HEADINGS[event].format(level="PL", limit=alert.vertical_m)


@in_common_look
def risk_curve_figure(curves: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Risk against bias, one row of panels per event and one column per satellite.

    Args:
        curves: ``satellite, method, event, bias_m, probability, low, high, estimator, subset_probability,
            subset_standard_error, warning``.
        alert: alert limits.
        title: heading.
    """
    events = list(dict.fromkeys(curves.event))
    satellites = list(dict.fromkeys(curves.satellite))
    figure, axes = new_figure(
        len(events), len(satellites), width_in=4.4 * len(satellites) + 0.6, height_in=3.4 * len(events) + 0.8,
        sharex=True, sharey="row",
    )  # fmt: skip
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    methods = list(dict.fromkeys(curves.method))
    for row, event in enumerate(events):
        panels = axes[row * len(satellites) : (row + 1) * len(satellites)]
        for panel, satellite in zip(panels, satellites, strict=True):
            chosen = curves[(curves.event == event) & (curves.satellite == satellite)]
            panel.set_yscale("log")
            for k, method in enumerate(methods):
                _curve(panel, chosen[chosen.method == method], k, method_label(method))
            panel.set_title(f"{satellite}: {event}")
            if event == "misleading":
                panel.axhline(_MEANT, color="0.15", linewidth=1.0, linestyle=":", zorder=1.5)
                panel.annotate(
                    "1e-7, what K_V = 5.33 stands for", (0.995, _MEANT), xycoords=("axes fraction", "data"),
                    xytext=(0, 2), textcoords="offset points", ha="right", va="bottom", fontsize=8, color="0.15",
                )  # fmt: skip
        shown = curves[curves.event == event]
        most = min(float(shown[["probability", "high"]].max().max()), 1.0)
        panels[0].set_ylim(_least(shown) / 5, max(12.0 * most, 1e4 * SMALLEST))
        panels[0].set_ylabel(event_heading(event, alert))
    for panel in axes[-len(satellites) :]:
        # Small biases, where the risk has its peak, get more room; with this share the slope has no step at 10 m.
        panel.set_xscale("symlog", linthresh=10.0, linscale=0.9 / np.log(10.0))
        ticks = [tick for tick in (0, 5, 10, 20, 50, 100) if tick <= curves.bias_m.max()]
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlim(-0.4, 1.1 * curves.bias_m.max())
        panel.set_xlabel("bias [m]; linear up to 10 m, logarithmic beyond")
    handles, labels = axes[0].get_legend_handles_labels()
    for panel in axes[1:]:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    figure.legend(handles, labels, loc="outside lower left", ncols=2)
    return figure


def _least(rows: pd.DataFrame) -> float:
    """The smallest probability or bound worth an axis."""
    exact = rows.estimator == _EXACT
    values = np.concatenate([rows.probability[~exact], rows.low[~exact]])
    values = values[np.isfinite(values) & (values > SMALLEST)]
    top = rows.probability[exact].max() if exact.any() else np.nan
    # Of an exact curve five decades below its top say how it falls.
    candidates = [*values.tolist(), 1e-5 * top if np.isfinite(top) and top > 0 else 1e-6]
    return max(min(candidates), SMALLEST)


def _curve(panel: Axes, rows: pd.DataFrame, index: int, label: str) -> None:
    """One method: a line where it is exact, else estimates with intervals, hollow where there is a warning."""
    style = series_style(index)
    if rows.empty:
        return
    exact = rows[rows.estimator == _EXACT]
    if len(exact):
        panel.plot(
            exact.bias_m, exact.probability.where(exact.probability > 0), style.line, color=style.colour,
            linewidth=1.6, label=f"{label}, exact",
        )  # fmt: skip
        if exact.probability.max() <= SMALLEST:
            panel.annotate(
                f"{label}: below {SMALLEST:g}", (0.98, 0.02), xycoords="axes fraction", ha="right", va="bottom",
                fontsize=8, color=style.colour,
            )  # fmt: skip
    rows = rows[rows.estimator != _EXACT]
    known = rows.probability.fillna(np.sqrt(rows.low * rows.high))
    for doubtful, fill, note in ((False, style.colour, "95 % interval"), (True, "white", "with a warning")):
        part = rows[((rows.warning != "") == doubtful) & (known > 0)]
        if len(part):
            middle = known[part.index]
            spread = np.maximum([middle - part.low, part.high - middle], 0.0)
            panel.errorbar(
                part.bias_m, middle, yerr=spread, linestyle="none", marker=style.marker, markersize=4,
                markerfacecolor=fill, color=style.colour, linewidth=1.2, capsize=3, zorder=3,
                label=f"{label}, {note}",
            )  # fmt: skip
    bounded = rows[~(known > 0) & (rows.high > 0) & (rows.high < 1)]
    if len(bounded):
        panel.errorbar(
            bounded.bias_m, bounded.high, yerr=0.6 * bounded.high, uplims=True, linestyle="none",
            marker=style.marker, markersize=4, markerfacecolor="white", color=style.colour,
            label=f"{label}, upper bound",
        )  # fmt: skip
    checked = rows[rows.subset_probability > 0]
    if len(checked):
        # Two standard errors of the logarithm; without one the point stands alone.
        factor = np.exp(2.0 * (checked.subset_standard_error / checked.subset_probability).fillna(0.0))
        middle = checked.subset_probability
        spread = [middle - middle / factor, middle * factor - middle]
        panel.errorbar(
            checked.bias_m, middle, yerr=spread, linestyle="none", marker="x", markersize=6.5,
            color=_GREY, markeredgewidth=1.2, elinewidth=0.9, zorder=4,
            label=f"{label}, subset simulation, two standard errors",
        )  # fmt: skip


@in_common_look
def worst_figure(worst: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """The worst case of every satellite beside the largest value on a ramp of 5, 10, ..., 100 m, a panel per event.

    Args:
        worst: ``satellites, method, event, bias_m, probability, low, high, grid_probability, warning``.
        alert: alert limits.
        title: heading.
    """
    events = list(dict.fromkeys(worst.event))
    methods = list(dict.fromkeys(worst.method))
    names = list(dict.fromkeys(worst.sort_values("probability", ascending=False).satellites))
    place = {name: k for k, name in enumerate(names)}
    figure, axes = new_figure(
        1, len(events), width_in=4.4 * len(events) + 0.6, height_in=1.8 + 0.3 * len(names), sharey=True
    )
    figure.suptitle(f"{title}: the worst bias on each satellite", x=0.01, ha="left", fontsize=11)
    for panel, event in zip(axes, events, strict=True):
        panel.set_xscale("log")
        floor = np.inf
        lost: list[str] = []
        for k, method in enumerate(methods):
            rows = worst[(worst.event == event) & (worst.method == method)]
            style = series_style(k)
            shown = rows[rows.probability > SMALLEST]
            floor = min([floor, *shown.probability, *shown.grid_probability[shown.grid_probability > SMALLEST]])
            y = shown.satellites.map(place).to_numpy() + (0.16 if len(methods) > 1 else 0.0) * (2 * k - 1)
            panel.hlines(y, shown.grid_probability.clip(lower=SMALLEST), shown.probability, color=style.colour,
                         linewidth=1.0, alpha=0.6)  # fmt: skip
            panel.plot(
                shown.grid_probability.where(shown.grid_probability > SMALLEST), y, linestyle="none", marker="|",
                markersize=7, color=style.colour, label=f"{method_label(method)}, largest of 5, 10, ..., 100 m",
            )  # fmt: skip
            # Open marks: with a warning, or the largest that a search saw without an estimate of its own.
            estimated = shown.refined if "refined" in shown else pd.Series(True, index=shown.index)
            rough = (shown.warning != "") | estimated.eq(False)
            for doubtful, fill in ((False, style.colour), (True, "white")):
                at = (rough == doubtful).to_numpy()
                if not at.any():
                    continue
                part = shown[at]
                spread = np.maximum([part.probability - part.low, part.high - part.probability], 0.0)
                panel.errorbar(
                    part.probability, y[at], xerr=spread, linestyle="none", marker=style.marker, markersize=5.5,
                    markerfacecolor=fill, color=style.colour, linewidth=1.2,
                    label=f"{method_label(method)}, worst bias" + (", rough or with a warning" if doubtful else ""),
                )  # fmt: skip
            for (_, row), height in zip(shown.iterrows(), y, strict=True):
                size = "any" if not np.isfinite(row.bias_m) else f"{row.bias_m:.1f} m" if row.bias_m else "no bias"
                panel.annotate(
                    size, (max(row.high, row.probability), height), xytext=(6, 0), textcoords="offset points",
                    va="center", fontsize=7, color=style.colour,
                )  # fmt: skip
            if len(rows) > len(shown):
                lost.append(f"{len(rows) - len(shown)} of {method_label(method)}")
        top = worst[worst.event == event].high.max()
        unshown = (worst.event == event) & (worst.probability <= SMALLEST)
        floor = SMALLEST if unshown.any() or not np.isfinite(floor) else floor
        panel.set_xlim(floor / 3, min(max(top, 10 * floor) * max((top / floor) ** 0.3, 5.0), 1e3))
        panel.set(yticks=range(len(names)), yticklabels=names, xlabel=event_heading(event, alert))
        panel.set_title(event)
        if lost:
            panel.annotate(
                f"below {SMALLEST:g}: {', '.join(lost)}", (1.0, 1.01), xycoords="axes fraction", ha="right",
                va="bottom", fontsize=7,
            )  # fmt: skip
    axes[0].invert_yaxis()
    found = [axes[k].get_legend_handles_labels() for k in range(len(events))]
    marks = {label: handle for handles, labels in found for handle, label in zip(handles, labels, strict=True)}
    figure.legend(list(marks.values()), list(marks), loc="outside lower left", ncols=2)
    return figure


@in_common_look
def step_figure(steps: pd.DataFrame, worst: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """How a ramp of 5, 10, ... m steps over the peak of the risk: exact least squares near the worst bias.

    Args:
        steps: ``event, satellite, method, bias_m, probability`` in fine steps that hold those of the ramp.
        worst: as for `worst_figure`.
        alert: alert limits.
        title: heading.
    """
    events = list(dict.fromkeys(steps.event))
    count = max(len(events), 1)
    figure, axes = new_figure(1, count, width_in=4.4 * count + 0.4, height_in=3.9)
    figure.suptitle(f"{title}: what a ramp in steps of 5 m sees", x=0.01, ha="left", fontsize=11)
    for panel, event in zip(axes, events, strict=False):
        rows = steps[steps.event == event]
        style = series_style(0)
        panel.plot(rows.bias_m, rows.probability, color=style.colour, linewidth=1.6)
        ramp = rows[(rows.bias_m > 0) & (np.abs(rows.bias_m / 5 - np.round(rows.bias_m / 5)) < 1e-9)]
        panel.plot(ramp.bias_m, ramp.probability, linestyle="none", marker="s", markersize=5, color="0.2")
        method, satellite = rows.method.iloc[0], rows.satellite.iloc[0]
        same = (worst.event == event) & (worst.method == method) & (worst.satellites == satellite)
        top = worst[same].iloc[0]
        panel.plot(
            top.bias_m, top.probability, marker="o", markersize=8, markeredgewidth=1.6, markerfacecolor="none",
            color=series_style(1).colour,
        )  # fmt: skip
        ratio = top.probability / ramp.probability.max()
        panel.annotate(
            f"worst: {top.bias_m:.2f} m, {top.probability:.2g}\n{ratio:.2f} times the largest\nof the ramp",
            (top.bias_m, top.probability), xytext=(11, 8), textcoords="offset points", fontsize=8, va="bottom",
            color=series_style(1).colour,
        )  # fmt: skip
        first = ramp.iloc[int(np.argmax(ramp.probability))]
        panel.annotate(
            f"largest of the\nramp: {first.bias_m:g} m", (first.bias_m, first.probability), xytext=(26, -4),
            textcoords="offset points", fontsize=8, va="center", ha="left", color="0.2",
            arrowprops={"arrowstyle": "-", "color": "0.5", "linewidth": 0.8, "shrinkB": 4},
        )  # fmt: skip
        panel.set_yscale("log")
        least = rows.probability[rows.probability > 1e-6 * top.probability].min()
        panel.set_ylim(max(least / 8, 1e-300), top.probability * 200)
        panel.set(xlabel=f"bias on {rows.satellite.iloc[0]} [m]", ylabel=event_heading(event, alert))
        panel.set_title(f"least squares, exact: {event}")
    return figure


@in_common_look
def sky_figure(worst: pd.DataFrame, g: Geometry, *, title: str) -> Figure:
    """The sky of the epoch, each satellite coloured by its worst case of the first event, one panel per method.

    Args:
        worst: as for `worst_figure`.
        g: one epoch.
        title: heading.
    """
    event = worst.event.iloc[0]
    chosen = worst[worst.event == event]
    methods = list(dict.fromkeys(chosen.method))
    figure, axes = new_figure(
        1, len(methods), width_in=4.1 * len(methods) + 0.8, height_in=4.4, subplot_kw={"projection": "polar"}
    )
    figure.suptitle(f"{title}: worst case of each satellite, {event}", x=0.01, ha="left", fontsize=11)
    known = chosen.probability[chosen.probability > SMALLEST]
    low, high = (known.min(), known.max()) if len(known) else (SMALLEST, 1.0)
    # Whole decades, so that the colour bar has numbers at its ends.
    top = 10.0 ** np.ceil(np.log10(high))
    norm = LogNorm(min(max(10.0 ** np.floor(np.log10(low)), top * 1e-12), top / 10), top)
    where = {name: (g.azimuth_rad[k], 90.0 - np.degrees(g.elevation_rad[k])) for k, name in enumerate(g.names)}
    image = None
    for panel, method in zip(axes, methods, strict=True):
        rows = chosen[chosen.method == method].set_index("satellites").reindex(list(g.names))
        angle, zenith = np.array([where[name] for name in g.names]).T
        image = panel.scatter(
            angle, zenith, c=rows.probability.clip(lower=norm.vmin), norm=norm, cmap="viridis_r", s=100,
            edgecolors="0.2", linewidths=0.8, zorder=3, plotnonfinite=False,
        )  # fmt: skip
        unknown = rows.probability.isna().to_numpy()
        panel.scatter(
            angle[unknown], zenith[unknown], s=100, facecolors="white", edgecolors="0.5", linestyle=":", zorder=2
        )
        for name, a, r, (right, up) in zip(g.names, angle, zenith, _label_sides(angle, zenith), strict=True):
            panel.annotate(
                name, (a, r), xytext=(17 * right, 12 * up), textcoords="offset points", ha="center",
                va="center", fontsize=7.5, zorder=4,
                path_effects=[patheffects.withStroke(linewidth=2, foreground="white")],
            )  # fmt: skip
        assert isinstance(panel, PolarAxes)
        panel.set_theta_zero_location("N")
        panel.set_theta_direction(-1)
        panel.set_ylim(0, 90)
        panel.set_yticks([30, 60, 90], ["60°", "30°", ""], fontsize=7.5, color="0.4")
        panel.set_xticks(np.radians([0, 90, 180, 270]), ["N", "E", "S", "W"])
        panel.spines["polar"].set_visible(True)
        panel.spines["polar"].set_color("0.6")
        panel.set_title(method_label(method) + (" (dotted: not searched)" if unknown.any() else ""))
    assert image is not None
    figure.colorbar(image, ax=axes, label=f"P({event}) under the worst bias", shrink=0.8, pad=0.03)
    return figure


def _label_sides(angle: np.ndarray, zenith: np.ndarray) -> list[tuple[int, int]]:
    """Where each satellite's name goes, right and up as -1, 0 or 1: below, unless a neighbour is near."""
    east, north = zenith * np.sin(angle), zenith * np.cos(angle)
    sides = []
    for k in range(len(angle)):
        apart = np.hypot(east - east[k], north - north[k])
        apart[k] = np.inf
        near = int(apart.argmin())
        if apart[near] > _NEAR_DEG:
            sides.append((0, -1))
        elif abs(east[near] - east[k]) > abs(north[near] - north[k]):
            sides.append((1 if east[k] > east[near] else -1, 0))
        else:
            sides.append((0, 1 if north[k] > north[near] else -1))
    return sides
