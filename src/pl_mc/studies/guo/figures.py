"""Figures after Guo et al. (2022): residuals, satellites, the statistics T and F, detection against the bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy import stats

from pl_mc.report.figures import SeriesStyle, in_common_look, new_figure, series_style
from pl_mc.report.text import percent
from pl_mc.studies.guo.text import PRINTED

FloatArray = NDArray[np.float64]

_NAMES = {"G": "GPS", "C": "BeiDou"}
# Figure 1 of the paper [m^2].
_PAPER_VARIANCES_M2 = {"G": 2.41, "C": 4.44}
# Where the six common styles do not suffice.
_MORE = (SeriesStyle("#000000", ":", "X"), SeriesStyle("0.5", "-.", "*"))


def test_label(test: str, reading: str) -> str:
    """``F (apriori)`` or ``T (shift_kept)``."""
    return f"{'T' if test == 'mean_check' else 'F'} ({reading})"


@in_common_look
def residual_figure(
    residuals_m: Mapping[str, FloatArray], sigma_m: Mapping[str, FloatArray], *, title: str
) -> Figure:
    """Figure 1: residuals without a fault, with the normal density of the a-priori variance.

    Args:
        residuals_m: by system letter, least-squares residuals V = A dX - L of all epochs [m].
        sigma_m: by system letter, the standard deviations that go with them [m].
        title: heading.
    """
    figure, axes = new_figure(1, 2, width_in=9.0, height_in=3.6, sharey=True)
    figure.suptitle(f"{title}: residuals without a fault", x=0.01, ha="left", fontsize=11)
    span = 4.0 * max(float(np.std(values)) for values in residuals_m.values())
    for k, (panel, (letter, values)) in enumerate(zip(axes, residuals_m.items(), strict=True)):
        style = series_style(k)
        inside = np.abs(values) <= span
        panel.hist(
            values[inside], bins=80, range=(-span, span), density=True, color=style.colour, alpha=0.6,
            label=f"residuals, variance {values.var():.2f} m$^2$",
        )  # fmt: skip
        grid = np.linspace(-span, span, 400)
        variances, weight = np.unique(np.round(sigma_m[letter] ** 2, 3), return_counts=True)
        if variances.size == 1:
            density = stats.norm.pdf(grid, scale=np.sqrt(variances[0]))
            panel.plot(grid, density, color="0.15", label=f"a-priori, variance {variances[0]:.2f} m$^2$")
        else:
            parts = stats.norm.pdf(grid[:, None], scale=np.sqrt(variances))
            panel.plot(grid, parts @ (weight / weight.sum()), color="0.15", label="a-priori, by elevation")
        beyond = "" if inside.all() else f"; {np.mean(~inside):.2g} of all are beyond"
        panel.set_title(f"{_NAMES[letter]} (paper: {_PAPER_VARIANCES_M2[letter]} m$^2$)")
        panel.set_xlabel(f"residual [m]{beyond}")
        panel.legend(loc="upper left")
    # Room for the legends above the densities of both.
    axes[0].set(ylabel="density [1/m]", ylim=(0, 1.3 * axes[0].get_ylim()[1]))
    return figure


@in_common_look
def satellites_figure(
    epoch: NDArray[np.int64], counts: Mapping[str, NDArray[np.int64]], pdop: FloatArray, *, title: str
) -> Figure:
    """Figure 2: satellites in view of each system, and PDOP.

    Args:
        epoch: (e,), epoch numbers.
        counts: by system letter, (e,) satellites in view.
        pdop: (e,), without weights.
        title: heading.
    """
    figure, (top, bottom) = new_figure(2, 1, width_in=8.0, height_in=5.0, sharex=True)
    figure.suptitle(f"{title}: satellites and PDOP", x=0.01, ha="left", fontsize=11)
    for k, (letter, count) in enumerate(counts.items()):
        label = f"{_NAMES[letter]}, {count.min()}-{count.max()}"
        top.step(epoch, count, where="mid", color=series_style(k).colour, linewidth=1.1, label=label)
    top.yaxis.set_major_locator(MaxNLocator(integer=True))
    top.set(ylabel="satellites in view", ylim=(0, max(int(c.max()) for c in counts.values()) * 1.3))
    top.legend(loc="upper right", ncols=2)
    bottom.plot(epoch, pdop, color="0.25", linewidth=1.0)
    bottom.set(ylabel="PDOP", xlabel="epoch", ylim=(0, None))
    return figure


@in_common_look
def statistic_figure(
    epochs: pd.DataFrame, *, test: str, reading: str, biases_m: Sequence[float], title: str
) -> Figure:
    """Figures 3, 4 and 5: a statistic over the epochs, one panel per bias, with both thresholds.

    Args:
        epochs: ``epoch, bias_m, test, reading, statistic, threshold, threshold_equal, detected``.
        test, reading: which of them.
        biases_m: the biases to show [m].
        title: heading.
    """
    figure, axes = new_figure(len(biases_m), 1, width_in=8.0, height_in=1.2 + 2.0 * len(biases_m), sharex=True)
    what = "no error" if list(biases_m) == [0.0] else "a bias on the least detectable satellite"
    figure.suptitle(f"{title}: {test_label(test, reading)}, {what}", x=0.01, ha="left", fontsize=11)
    mine = epochs[(epochs.test == test) & (epochs.reading == reading)]
    style = series_style(1 if test == "mean_check" else 0)
    for panel, bias in zip(axes, biases_m, strict=True):
        group = mine[mine.bias_m == bias].sort_values("epoch")
        panel.plot(
            group.epoch, group.statistic, linestyle="none", marker=".", markersize=2, color=style.colour,
            rasterized=True,
        )  # fmt: skip
        panel.plot(group.epoch, group.threshold, color="0.1", linewidth=1.6, label="nominal threshold")
        panel.plot(
            group.epoch, group.threshold_equal, color="0.45", linewidth=0.9, label="threshold of measured P_FA"
        )
        top = max(group.statistic.max(), group.threshold.max())
        panel.set_ylim(0, 1.3 * top if panel is axes[0] else 1.08 * top)
        panel.set_title(
            f"{bias:g} m: {group.detected.sum()} of {len(group)} epochs above the nominal threshold "
            f"({percent(group.detected.mean())} %)"
        )
        panel.set_ylabel("T" if test == "mean_check" else "F")
    axes[0].legend(loc="upper right", ncols=2)
    axes[-1].set_xlabel("epoch")
    return figure


@in_common_look
def detection_figure(detection: pd.DataFrame, *, title: str) -> Figure:
    """Table 1 as points: detection rates by reading and bias, at both levels, with the paper's marks.

    Args:
        detection: ``test, reading, level, bias_m, detection_rate, low, high, p_fa_measured``.
        title: heading.
    """
    labels = list(dict.fromkeys(zip(detection.test, detection.reading, strict=True)))
    figure, axes = new_figure(1, 2, width_in=10.0, height_in=1.8 + 0.5 * len(labels))
    figure.suptitle(f"{title}: detection rates with 95 % intervals", x=0.01, ha="left", fontsize=11)
    biases = [bias for bias in detection.bias_m.unique() if bias]
    for panel, level in zip(axes, ("nominal", "equal_p_fa"), strict=True):
        for b, bias in enumerate(biases):
            group = detection[(detection.level == level) & (detection.bias_m == bias)]
            y = np.array([labels.index(key) for key in zip(group.test, group.reading, strict=True)], dtype=float)
            y += 0.22 * (b - (len(biases) - 1) / 2)
            style = series_style(b)
            panel.hlines(y, group.low, group.high, color=style.colour, linewidth=1.6)
            panel.plot(
                group.detection_rate, y, linestyle="none", marker=style.marker, markersize=5, color=style.colour,
                label=f"{bias:g} m", clip_on=False,
            )  # fmt: skip
            paper = [PRINTED[key[0]].get(bias, np.nan) if level == "nominal" else np.nan for key in labels]
            place = np.arange(len(labels)) + 0.22 * (b - (len(biases) - 1) / 2)
            panel.plot(
                paper, place, linestyle="none", marker="x", markersize=5, color="0.1", clip_on=False,
                label="paper, same bias" if b == len(biases) - 1 else None,
            )  # fmt: skip
        alarms = detection[(detection.level == level) & (detection.bias_m == 0)]
        ticks = [f"P_FA {100 * rate:.2g} %" if rate else "P_FA: none seen" for rate in alarms.p_fa_measured]
        if level == "nominal":
            ticks = [
                f"{test_label(row.test, row.reading)}\n{tick}"
                for row, tick in zip(alarms.itertuples(), ticks, strict=True)
            ]
        panel.set_yticks(range(len(labels)), ticks)
        if level == "equal_p_fa":
            panel.yaxis.tick_right()
        panel.set(xlabel="detection rate", xlim=(-0.02, 1.02), ylim=(len(labels) - 0.5, -0.5))
        panel.set_title("nominal thresholds, unequal P_FA" if level == "nominal" else "equal P_FA")
    # A legend of the figure: one of a panel would widen that panel's share of it.
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@in_common_look
def power_figure(power: pd.DataFrame, reliable: pd.DataFrame, *, title: str) -> Figure:
    """Detection of the least detectable BeiDou satellite of one epoch against the bias, nominal and at equal P_FA.

    Args:
        power: ``satellite, test, reading, level, bias_m, detection_rate, low, high``; no satellite without a bias.
        reliable: `pl_mc.reliability` of that epoch.
        title: heading.
    """
    figure, axes = new_figure(1, 2, width_in=10.5, height_in=5.2, sharey=True)
    mine = reliable[reliable.name.str.startswith("C") & np.isfinite(reliable.mdb_m)]
    name = str(mine.name.loc[mine.mdb_m.idxmax()])
    figure.suptitle(f"{title}: one epoch, bias on {name} (largest MDB)", x=0.01, ha="left", fontsize=11)
    chosen = power[power.satellite.isin(["", name])]
    for panel, level in zip(axes, ("nominal", "equal_p_fa"), strict=True):
        groups = chosen[chosen.level == level].groupby(["test", "reading"], sort=False)
        for k, ((test, reading), group) in enumerate(groups):
            if group.detections.sum():
                _curve(panel, group, k, test_label(str(test), str(reading)))
            else:
                panel.plot([], [], linestyle="none", label=f"{test_label(str(test), str(reading))}: never")
            if "exact_rate" in group and group.exact_rate.notna().any():
                exact = group.sort_values("bias_m")
                panel.plot(exact.bias_m, exact.exact_rate, color="0.1", linewidth=0.8, label="F (apriori), exact")
        panel.set(xlabel="bias [m]", ylim=(-0.02, 1.02))
        panel.set_title("nominal thresholds (false-alarm rates differ)" if level == "nominal" else
                        f"equal false-alarm rates ({100 * chosen.p_fa_nominal.iloc[0]:g} %)")  # fmt: skip
    axes[0].set_ylabel("detection rate, with 95 % bounds")
    for panel in axes:
        panel.legend(loc="lower right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=8)
    return figure


@in_common_look
def satellite_power_figure(power: pd.DataFrame, reliable: pd.DataFrame, *, title: str) -> Figure:
    """Every satellite of one epoch at equal false-alarm rates: a map for each reading of satellite against bias.

    Args:
        power: as for `power_figure`.
        reliable: `pl_mc.reliability` of that epoch; satellites are ordered by MDB.
        title: heading.
    """
    equal = power[(power.level == "equal_p_fa") & (power.satellite != "")]
    order = reliable.sort_values("mdb_m").name.tolist()
    labels = list(dict.fromkeys(zip(equal.test, equal.reading, strict=True)))
    columns = min(4, len(labels))
    rows = -(-len(labels) // columns)
    figure, axes = new_figure(
        rows, columns, width_in=2.8 * columns + 1.2, height_in=1.0 + (0.8 + 0.125 * len(order)) * rows,
        sharex=True, sharey=True,
    )  # fmt: skip
    figure.suptitle(
        f"{title}: detection of every satellite at equal false-alarm rates", x=0.01, ha="left", fontsize=11
    )
    for panel, (test, reading) in zip(axes, labels, strict=False):
        group = equal[(equal.test == test) & (equal.reading == reading)]
        grid = group.pivot(index="satellite", columns="bias_m", values="detection_rate").reindex(index=order)
        image = panel.pcolormesh(
            grid.columns, np.arange(len(order)), grid.to_numpy(), vmin=0, vmax=1, cmap="viridis",
            shading="nearest", rasterized=True,
        )  # fmt: skip
        panel.grid(visible=False)
        panel.set_title(test_label(test, reading), fontsize=9)
        panel.set_yticks(np.arange(len(order)), order, fontsize=6)
    axes[0].invert_yaxis()
    for panel in axes[len(labels) :]:
        panel.set_visible(False)
    for panel in axes[len(labels) - columns : len(labels)]:
        panel.tick_params(labelbottom=True)
        panel.set_xlabel("bias [m]")
    figure.colorbar(image, ax=axes, label="detection rate", pad=0.01)
    return figure


def _curve(panel: Axes, group: pd.DataFrame, index: int, label: str) -> None:
    """A rate against the bias with its bounds as a band."""
    style = series_style(index) if index < 6 else _MORE[(index - 6) % len(_MORE)]
    group = group.sort_values("bias_m")
    panel.fill_between(group.bias_m, group.low, group.high, color=style.colour, alpha=0.25, linewidth=0)
    panel.plot(
        group.bias_m, group.detection_rate, style.line, marker=style.marker, markersize=3.5, color=style.colour,
        linewidth=1.1, label=label,
    )  # fmt: skip
