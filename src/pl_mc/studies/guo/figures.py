"""Figures after Guo et al. (2022): residuals, satellites, the statistics T and F, detection against the bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pl_mc.engine.detect_runs import EQUAL_P_FA, LEVELS, NOMINAL
from pl_mc.geometry.record import SYSTEM_NAMES
from pl_mc.report.figures import columns_that_fit, legend_below, legend_in, new_figure
from pl_mc.report.look import series_style, styles_of
from pl_mc.report.text import percent
from pl_mc.studies.guo.paper import LETTERS, paper_rate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

# Figure 1 of the paper [m^2].
_PAPER_VARIANCES_M2 = {"G": 2.41, "C": 4.44}
# Between the rates of two biases of one reading.
_STEP = 0.22


def test_label(test: str, reading: str) -> str:
    """``F (apriori)`` or ``T (shift_kept)``."""
    return f"{LETTERS[test]} ({reading})"


def residual_figure(by_system: Mapping[str, tuple[FloatArray, FloatArray]], *, title: str) -> Figure:
    """Figure 1: residuals without a fault, with the normal density of the a-priori variance.

    ``by_system`` has by system letter the least-squares residuals V = A dX - L of all epochs, and the standard
    deviations that go with them [m].
    """
    from scipy import stats

    heading = f"{title}: residuals without a fault"
    figure, axes = new_figure(1, 2, width_in=9.0, height_in=3.6, title=heading, sharey=True)
    span = 4.0 * max(float(np.std(residuals_m)) for residuals_m, _ in by_system.values())
    grid = np.linspace(-span, span, 400)
    for k, (panel, (letter, (residuals_m, sigma_m))) in enumerate(zip(axes, by_system.items(), strict=True)):
        inside = np.abs(residuals_m) <= span
        panel.hist(
            residuals_m[inside], bins=80, range=(-span, span), density=True, color=series_style(k).colour,
            alpha=0.6, label=f"residuals, variance {residuals_m.var():.2f} m²",
        )  # fmt: skip
        variances, count = np.unique(np.round(sigma_m**2, 3), return_counts=True)
        density = stats.norm.pdf(grid[:, None], scale=np.sqrt(variances)) @ (count / count.sum())
        apriori = f"variance {variances[0]:.2f} m²" if variances.size == 1 else "by elevation"
        panel.plot(grid, density, color="0.15", label=f"a-priori, {apriori}")
        beyond = "" if inside.all() else f"; {np.mean(~inside):.2g} of all are beyond"
        panel.set_title(f"{SYSTEM_NAMES[letter]} (paper: {_PAPER_VARIANCES_M2[letter]} m²)")
        panel.set_xlabel(f"residual [m]{beyond}")
        legend_in(panel, loc="upper left")
    # Room for the legends above the densities of both.
    axes[0].set(ylabel="density [1/m]", ylim=(0, 1.3 * axes[0].get_ylim()[1]))
    return figure


def satellites_figure(
    epoch: NDArray[np.int64], counts: Mapping[str, NDArray[np.int64]], pdop: FloatArray, *, title: str
) -> Figure:
    """Figure 2: satellites in view of each system, by its letter, and PDOP without weights, all (e,)."""
    from matplotlib.ticker import MaxNLocator

    heading = f"{title}: satellites and PDOP"
    figure, (top, bottom) = new_figure(2, 1, width_in=8.0, height_in=5.0, title=heading, sharex=True)
    for k, (letter, count) in enumerate(counts.items()):
        label = f"{SYSTEM_NAMES[letter]}, {count.min()}-{count.max()}"
        top.step(epoch, count, where="mid", color=series_style(k).colour, linewidth=1.1, label=label)
    top.yaxis.set_major_locator(MaxNLocator(integer=True))
    top.set(ylabel="satellites in view", ylim=(0, max(int(c.max()) for c in counts.values()) * 1.3))
    legend_in(top, loc="upper right", ncols=2)
    bottom.plot(epoch, pdop, color="0.25", linewidth=1.0)
    bottom.set(ylabel="PDOP", xlabel="epoch", ylim=(0, None))
    return figure


def statistic_figure(epochs: pd.DataFrame, *, biases_m: Sequence[float], time: str, title: str) -> Figure:
    """Figures 3, 4 and 5: a statistic over the epochs, one panel per bias, with both thresholds.

    ``epochs`` is the table of `pl_mc.studies.guo.series.Day`, of one reading; ``time`` says when epochs are.
    """
    test, reading = epochs.test.iloc[0], epochs.reading.iloc[0]
    what = "no error" if list(biases_m) == [0.0] else "a bias on the least detectable satellite"
    figure, axes = new_figure(
        len(biases_m), 1, width_in=8.0, height_in=1.2 + 2.0 * len(biases_m), sharex=True,
        title=f"{title}: {test_label(test, reading)}, {what}",
    )  # fmt: skip
    points: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 2, "rasterized": True}
    colour = series_style(1 if test == "mean_check" else 0).colour
    for panel, bias in zip(axes, biases_m, strict=True):
        group = epochs[epochs.bias_m == bias].sort_values("epoch")
        panel.plot(group.epoch, group.statistic, color=colour, label=f"{LETTERS[test]} of an epoch", **points)
        panel.plot(group.epoch, group.threshold, color="0.1", linewidth=1.6, label="nominal threshold")
        label = "threshold of measured P_FA"
        panel.plot(group.epoch, group.threshold_equal, color="0.45", linewidth=0.9, label=label)
        top = max(group.statistic.max(), group.threshold.max())
        panel.set_ylim(0, 1.3 * top if panel is axes[0] else 1.08 * top)
        panel.set_title(
            f"{bias:g} m: {group.detected.sum()} of {len(group)} epochs above the nominal threshold "
            f"({percent(group.detected.mean())} %)"
        )
        panel.set_ylabel(LETTERS[test])
    legend_in(axes[0], loc="upper right", ncols=3, markerscale=4)
    axes[-1].set_xlabel(time)
    return figure


# How wide names of tests and readings are [in].
_LABELS_IN = 1.5


def detection_figure(detection: pd.DataFrame, *, title: str) -> Figure:
    """Table 1 as points: detection rates by reading and bias, at both levels, with the paper's marks.

    ``detection`` has ``test, reading, level, bias_m, detection_rate, low, high, p_fa_measured``.
    """
    keys = list(dict.fromkeys(zip(detection.test, detection.reading, strict=True)))
    heading = f"{title}: detection rates with 95 % intervals"
    figure, axes = new_figure(
        1,
        2,
        width_in=10.0,
        height_in=1.8 + 0.5 * len(keys),
        title=heading,
        lines_in=0.5 * len(keys),
        labels_in=_LABELS_IN,
    )
    # Below each other both have names.
    stacked = columns_that_fit(2, labels_in=_LABELS_IN) == 1
    biases = [bias for bias in detection.bias_m.unique() if bias]
    points: dict[str, Any] = {"linestyle": "none", "markersize": 5, "clip_on": False}
    for panel, level in zip(axes, LEVELS, strict=True):
        of_level = detection[detection.level == level]
        for b, bias in enumerate(biases):
            group, style = of_level[of_level.bias_m == bias], series_style(b)
            shift = _STEP * (b - (len(biases) - 1) / 2)
            y = shift + np.array([keys.index(key) for key in zip(group.test, group.reading, strict=True)], float)
            panel.hlines(y, group.low, group.high, color=style.colour, linewidth=1.6)
            own: dict[str, Any] = {"marker": style.marker, "color": style.colour, "label": f"{bias:g} m"}
            panel.plot(group.detection_rate, y, **points, **own)
            paper = [paper_rate(test, bias) if level == NOMINAL else np.nan for test, _ in keys]
            label = "paper, same bias" if bias == biases[-1] else None
            panel.plot(paper, np.arange(len(keys)) + shift, marker="x", color="0.1", label=label, **points)
        alarms = of_level[of_level.bias_m == 0]
        ticks = [f"P_FA {100 * rate:.2g} %" if rate else "P_FA: none seen" for rate in alarms.p_fa_measured]
        if level == NOMINAL or stacked:
            ticks = [f"{test_label(*key)}\n{tick}" for key, tick in zip(keys, ticks, strict=True)]
        else:
            panel.yaxis.tick_right()
        panel.set_yticks(range(len(keys)), ticks)
        panel.set(xlabel="detection rate", xlim=(-0.02, 1.02), ylim=(len(keys) - 0.5, -0.5))
        panel.set_title("nominal thresholds, unequal P_FA" if level == NOMINAL else "equal P_FA")
    # A legend of the figure: one of a panel would widen that panel's share of it.
    legend_below(figure, axes[:1], columns=4, side="center")
    return figure


def power_figure(power: pd.DataFrame, reliable: pd.DataFrame, *, title: str) -> Figure:
    """Detection of the least detectable BeiDou satellite of one epoch against the bias, nominal and at equal P_FA.

    Args:
        power: ``satellite, test, reading, level, bias_m, detection_rate, low, high``; no satellite without a bias.
        reliable: `pl_mc.reliability` of that epoch.
        title: heading.
    """
    checked = reliable[reliable.name.str.startswith("C") & np.isfinite(reliable.mdb_m)]
    name = str(checked.name.loc[checked.mdb_m.idxmax()])
    heading = f"{title}: one epoch, bias on {name} (largest MDB)"
    figure, axes = new_figure(1, 2, width_in=10.5, height_in=5.2, title=heading, sharey=True)
    chosen = power[power.satellite.isin(["", name])].sort_values("bias_m", kind="stable")
    equal = f"equal false-alarm rates ({100 * chosen.p_fa_nominal.iloc[0]:g} %)"
    keys = chosen[["test", "reading"]].drop_duplicates().itertuples(index=False)
    styles = styles_of(test_label(*key) for key in keys)
    for panel, level in zip(axes, LEVELS, strict=True):
        groups = chosen[chosen.level == level].groupby(["test", "reading"], sort=False)
        for (test, reading), group in groups:
            label = test_label(str(test), str(reading))
            style = styles[label]
            if group.detections.sum():
                rate, look = group.detection_rate, style.look | {"markersize": 3.5, "linewidth": 1.1}
                panel.fill_between(group.bias_m, group.low, group.high, color=style.colour, alpha=0.25, linewidth=0)
                panel.plot(group.bias_m, rate, **look, label=label)
            else:
                panel.plot([], [], linestyle="none", label=f"{label}: never")
            if group.exact_rate.notna().any():
                panel.plot(group.bias_m, group.exact_rate, color="0.1", linewidth=0.8, label="F (apriori), exact")
        panel.set(xlabel="bias [m]", ylim=(-0.02, 1.02))
        panel.set_title("nominal thresholds (false-alarm rates differ)" if level == NOMINAL else equal)
    axes[0].set_ylabel("detection rate, with 95 % bounds")
    legend_below(figure, axes, columns=3)
    return figure


def satellite_power_figure(power: pd.DataFrame, reliable: pd.DataFrame, *, title: str) -> Figure:
    """Every satellite of one epoch at equal false-alarm rates: a map for each reading of satellite against bias.

    Tables are those of `power_figure`; satellites are ordered by MDB.
    """
    equal = power[(power.level == EQUAL_P_FA) & (power.satellite != "")]
    order = reliable.sort_values("mdb_m").name.tolist()
    groups = equal.groupby(["test", "reading"], sort=False)
    columns = columns_that_fit(min(4, len(groups)))
    rows = -(-len(groups) // columns)
    figure, axes = new_figure(
        rows, columns, width_in=2.8 * columns + 1.2, height_in=1.0 + (0.8 + 0.125 * len(order)) * rows,
        lines_in=0.145 * len(order),
        title=f"{title}: detection of every satellite at equal false-alarm rates", sharex=True, sharey=True,
    )  # fmt: skip
    look: dict[str, Any] = {"vmin": 0, "vmax": 1, "cmap": "viridis", "shading": "nearest", "rasterized": True}
    for panel, ((test, reading), group) in zip(axes, groups, strict=False):
        grid = group.pivot(index="satellite", columns="bias_m", values="detection_rate").reindex(index=order)
        image = panel.pcolormesh(grid.columns, np.arange(len(order)), grid.to_numpy(), **look)
        panel.grid(visible=False)
        panel.set_title(test_label(str(test), str(reading)), fontsize=9)
        panel.set_yticks(np.arange(len(order)), order, fontsize=6)
    axes[0].invert_yaxis()
    for panel in axes[len(groups) :]:
        panel.set_visible(False)
    for panel in axes[len(groups) - columns : len(groups)]:
        panel.tick_params(labelbottom=True)
        panel.set_xlabel("bias [m]")
    figure.colorbar(image, ax=axes, label="detection rate", pad=0.01)
    return figure
