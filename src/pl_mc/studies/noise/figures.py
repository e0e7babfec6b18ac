"""Figures of an experiment about noise models: rates model by model, and exposures against the correlation time."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.report.figures import DASHED, bar_lengths, legend_below, legend_key, method_label, new_figure, widest_in
from pl_mc.report.look import SeriesStyle, styles_of
from pl_mc.studies.spec import ByOneAxis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEADINGS = {"alarm": "P(alarm), {limits}", "misleading": "P(misleading)"}
_MOST_COLUMNS = 3
_DOTS = (0, (1, 1.5))


def fault_words(fault: str) -> str:
    """A fault's label, in words where there is none."""
    return "no fault" if fault == "none" else fault


def assumed_share(rows: pd.DataFrame, assumed: int) -> float:
    """What a budget makes of the rate per sample: the share of exposures of so many independent samples.

    The rate is pooled over all exposures of the rows, whose marginals are the same.
    """
    rate = rows.samples_with.sum() / (rows.exposures * rows.samples).sum()
    return -float(np.expm1(assumed * np.log1p(-rate))) if rate < 1.0 else 1.0


def noise_figure(factors: pd.DataFrame, experiment: ByOneAxis) -> Figure:
    """Rates of alarms and misleading information, a line per noise model, panels per event and first three faults.

    An open triangle is the 95 % upper bound of what was never seen. A thin vertical line is the rate under Gaussian
    noise, for each method in its colour.
    """
    from matplotlib.ticker import NullFormatter

    faults = list(dict.fromkeys(factors.fault))[:_MOST_COLUMNS]
    noises, methods = (list(dict.fromkeys(factors[column])) for column in ("noise", "method"))
    figure, axes = new_figure(
        len(_HEADINGS), len(faults), width_in=3.2 * len(faults) + 3.4,
        height_in=len(_HEADINGS) * (0.9 + 0.42 * len(noises)) + 0.9, title=experiment.title, sharex="row",
        sharey=True, lines_in=0.42 * len(noises), labels_in=widest_in(map(_spaced, noises), 8.0), panel_mm=22.0,
    )  # fmt: skip
    judged, styles = experiment.decides, styles_of(methods)
    for row, (event, heading) in enumerate(_HEADINGS.items()):
        for panel, fault in zip(axes[row * len(faults) :], faults, strict=False):
            here = factors[(factors.event == event) & (factors.fault == fault)]
            for number, (method, style) in enumerate(styles.items()):
                _draw(panel, here[here.method == method], style, (number - (len(methods) - 1) / 2.0) * 0.22)
            panel.set_title(fault_words(fault), fontsize=9.0)
            panel.set_xlabel(heading.format(limits=judged.limits()))
            panel.set(xscale="log", ylim=(len(noises) - 0.5, -0.5))
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_yticks(range(len(noises)), [_spaced(name) for name in noises], fontsize=8.0)
            panel.grid(axis="y", visible=False)
            for edge in range(1, len(noises)):
                panel.axhline(edge - 0.5, color="0.9", linewidth=0.8, zorder=0.5)
        low, high = axes[row * len(faults)].get_xlim()
        # At least two powers of ten, which then carry the only labels.
        axes[row * len(faults)].set_xlim(min(low, 0.01 * high), min(high, 1.5))
    keys = {method_label(method, judged.axis): style for method, style in styles.items()}
    handles = [
        *(legend_key(label, color=style.colour, marker=style.marker, markersize=5) for label, style in keys.items()),
        legend_key("none seen: upper bound", color="0.3", marker="<", markerfacecolor="none", linestyle=""),
        legend_key("gaussian (lines)", color="0.3", linewidth=0.9),
    ]
    legend_below(figure, columns=len(handles), side="center", keys=handles)
    return figure


def _draw(panel: Axes, rows: pd.DataFrame, style: SeriesStyle, shift: float) -> None:
    """One method in one panel."""
    place = np.arange(len(rows)) + shift
    rate, low, high = (rows[column].to_numpy() for column in ("rate", "low", "high"))
    seen = rate > 0
    reference = float(rows["gaussian_rate"].iloc[0])
    if reference > 1e-9:
        panel.axvline(reference, color=style.colour, linewidth=0.9, linestyle=style.line, alpha=0.55, zorder=1.0)
    look: Any = {"color": style.colour, "zorder": 2.5}
    bars = bar_lengths(rate, low, high)[:, seen]
    panel.errorbar(rate[seen], place[seen], xerr=bars, fmt=style.marker, markersize=4.2, linewidth=1.2, **look)
    panel.plot(high[~seen], place[~seen], "<", markersize=5.0, markerfacecolor="none", **look)


def _spaced(name: str) -> str:
    """A noise model's name on several lines."""
    base, _, options = name.partition("(")
    lines = textwrap.wrap(options.removesuffix(")").replace(",", ", "), 32)
    return "\n".join([base.replace("_", " "), *lines])


def exposure_figure(exposures: pd.DataFrame, *, event: str, assumed: int, axis: str, title: str) -> Figure:
    """The share of exposures with an event, and the independent samples that would give it, against tau.

    A correlation time of zero is drawn at a third of the smallest other.
    """
    chosen = exposures[exposures.event == event]
    faults, methods = (list(dict.fromkeys(chosen[column])) for column in ("fault", "method"))
    samples = int(chosen.samples.iloc[0])
    figure, axes = new_figure(
        2, len(faults), width_in=4.4 * len(faults) + 0.8, height_in=7.2,
        title=f"{title}: {event} in exposures of {samples} samples", sharex=True,
    )  # fmt: skip
    least = float(chosen.tau_s[chosen.tau_s > 0].min())
    for column, fault in enumerate(faults):
        upper, lower = axes[column :: len(faults)]
        of_fault = chosen[chosen.fault == fault]
        for method, style in styles_of(methods).items():
            _draw_exposures(upper, lower, of_fault[of_fault.method == method], style, least, assumed, axis)
        # The limits are given, since a panel in which nothing was seen has no points to take them from.
        upper.set(xscale="log", xlim=(least / 4.0, 1.5 * max(float(chosen.tau_s.max()), least)))
        # Where the event was never seen there is nothing that a logarithmic axis could show.
        if (of_fault.exposures_with > 0).any():
            upper.set(yscale="log")
        upper.set_title(f"{fault_words(fault)}: P(at least one in an exposure)")
        lower.set(yscale="log", ylim=(0.7, 1.6 * samples), xlabel="correlation time [s] (leftmost: independent)")
        lower.set_title("independent samples that would do the same")
        lower.axhline(assumed, **DASHED)
    dotted = legend_key(f"{assumed} independent samples", color="0.3", linewidth=1.0, linestyle=_DOTS)
    dashed = legend_key(f"assumed in a budget: {assumed}", **DASHED)
    handles = [*axes[0].get_legend_handles_labels()[0], dotted, dashed]
    legend_below(figure, columns=len(methods) + 2, side="center", keys=handles)
    return figure


def _draw_exposures(
    upper: Axes, lower: Axes, rows: pd.DataFrame, style: SeriesStyle, least: float, assumed: int, axis: str
) -> None:
    """One method under one fault: shares above, numbers of independent samples below."""
    tau = np.where(rows.tau_s > 0, rows.tau_s, least / 3.0)
    seen = (rows.exposures_with > 0).to_numpy()
    label = method_label(str(rows.method.iloc[0]), axis)
    for panel, of, rate in ((upper, "any", "any_rate"), (lower, "effective", "effective_samples")):
        value, low, high = (np.where(seen, rows[name], np.nan) for name in (rate, f"{of}_low", f"{of}_high"))
        panel.fill_between(tau, low, high, color=style.colour, alpha=0.15, linewidth=0)
        panel.plot(tau, value, **style.look, markersize=3.8, label=label)
    share = assumed_share(rows, assumed)
    if share > 0:
        upper.axhline(share, color=style.colour, linewidth=1.0, linestyle=_DOTS)
