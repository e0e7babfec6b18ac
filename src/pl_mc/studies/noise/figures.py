"""Figures of an experiment about noise models: rates model by model, and exposures against the correlation time."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, method_label, new_figure, series_style

_HEADINGS = {
    "alarm": "P(alarm), VAL {limit:g} m",
    "misleading": "P(misleading)",
}
_EVENTS = ("alarm", "misleading")
_MOST_COLUMNS = 3


@in_common_look
def noise_figure(factors: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Rates of alarms and misleading information, a line per noise model, a panel per event and fault.

    An open triangle is the 95 % upper bound of what was never seen. A thin vertical line is the rate under Gaussian
    noise, for each method in its colour.

    Args:
        factors: see `pl_mc.studies.noise.run.factor_table`; its first three faults are drawn.
        alert: alert limits.
        title: heading.
    """
    faults = list(dict.fromkeys(factors.fault))[:_MOST_COLUMNS]
    noises, methods = (list(dict.fromkeys(factors[column])) for column in ("noise", "method"))
    figure, axes = new_figure(
        len(_EVENTS), len(faults), width_in=3.2 * len(faults) + 3.4,
        height_in=len(_EVENTS) * (0.9 + 0.42 * len(noises)) + 0.9, sharey=True,
    )  # fmt: skip
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    for row, event in enumerate(_EVENTS):
        for column, fault in enumerate(faults):
            panel = axes[row * len(faults) + column]
            here = factors[(factors.event == event) & (factors.fault == fault)]
            for number, method in enumerate(methods):
                _draw(panel, here[here.method == method], number, len(methods))
            heading = _HEADINGS[event].format(limit=alert.vertical_m)
            panel.set_title(f"{'no fault' if fault == 'none' else fault}: {heading}", fontsize=9.0)
            panel.set(xscale="log", ylim=(len(noises) - 0.5, -0.5))
            low, high = panel.get_xlim()
            # At least two powers of ten, which then carry the only labels.
            panel.set_xlim(min(low, 0.01 * high), min(high, 1.5))
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_yticks(range(len(noises)), [_spaced(name) for name in noises], fontsize=8.0)
            panel.grid(axis="y", visible=False)
            for edge in range(1, len(noises)):
                panel.axhline(edge - 0.5, color="0.9", linewidth=0.8, zorder=0.5)
    handles = []
    for number, method in enumerate(methods):
        style = series_style(number)
        handles.append(
            Line2D([], [], color=style.colour, marker=style.marker, markersize=5, label=method_label(method))
        )
    handles.append(
        Line2D(
            [], [], color="0.3", marker="<", markerfacecolor="none", linestyle="", label="none seen: upper bound"
        )
    )
    handles.append(Line2D([], [], color="0.3", linewidth=0.9, label="gaussian (lines)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw(panel: Axes, rows: pd.DataFrame, number: int, methods: int) -> None:
    """One method in one panel."""
    style = series_style(number)
    place = np.arange(len(rows)) + (number - (methods - 1) / 2.0) * 0.22
    rate, low, high = (rows[column].to_numpy() for column in ("rate", "low", "high"))
    seen = rate > 0
    reference = float(rows["gaussian_rate"].iloc[0])
    if reference > 1e-9:
        panel.axvline(reference, color=style.colour, linewidth=0.9, linestyle=style.line, alpha=0.55, zorder=1.0)
    panel.errorbar(
        rate[seen], place[seen], xerr=[rate[seen] - low[seen], high[seen] - rate[seen]], fmt=style.marker,
        markersize=4.2, color=style.colour, linewidth=1.2, zorder=2.5,
    )  # fmt: skip
    panel.plot(
        high[~seen], place[~seen], "<", markersize=5.0, markerfacecolor="none", color=style.colour, zorder=2.5
    )


def _spaced(name: str) -> str:
    """A noise model's name on several lines."""
    base, _, options = name.partition("(")
    told = "\n".join(textwrap.wrap(options.removesuffix(")").replace(",", ", "), 32))
    return f"{base.replace('_', ' ')}\n{told}" if told else base


@in_common_look
def exposure_figure(exposures: pd.DataFrame, *, event: str, assumed: int, title: str) -> Figure:
    """The share of exposures with an event, and the independent samples that would give it, against tau.

    Args:
        exposures: see `pl_mc.exposure`; a correlation time of zero is drawn at a third of the smallest other.
        event: which event.
        assumed: the number of independent samples that a budget assumes.
        title: heading.
    """
    chosen = exposures[exposures.event == event]
    faults, methods = (list(dict.fromkeys(chosen[column])) for column in ("fault", "method"))
    figure, axes = new_figure(2, len(faults), width_in=4.4 * len(faults) + 0.8, height_in=7.2, sharex=True)
    samples = int(chosen.samples.iloc[0])
    figure.suptitle(f"{title}: {event} in exposures of {samples} samples", x=0.01, ha="left", fontsize=11)
    least = float(chosen.tau_s[chosen.tau_s > 0].min())
    for column, fault in enumerate(faults):
        upper, lower = axes[column], axes[len(faults) + column]
        for number, method in enumerate(methods):
            style = series_style(number)
            rows = chosen[(chosen.fault == fault) & (chosen.method == method)]
            tau = np.where(rows.tau_s > 0, rows.tau_s, least / 3.0)
            seen = (rows.exposures_with > 0).to_numpy()
            options: dict[str, Any] = {
                "marker": style.marker,
                "markersize": 3.8,
                "color": style.colour,
                "label": method_label(method),
            }
            for panel, columns in ((upper, ("any_rate", "any_low", "any_high")), (lower, _EFFECTIVE)):
                value, low, high = (np.where(seen, rows[name], np.nan) for name in columns)
                panel.fill_between(tau, low, high, color=style.colour, alpha=0.15, linewidth=0)
                panel.plot(tau, value, style.line, **options)
            # What a budget makes of the rate per sample: pooled over all exposures, whose marginals are the same.
            rate = rows.samples_with.sum() / (rows.exposures * rows.samples).sum()
            if rate > 0:
                upper.axhline(
                    -np.expm1(assumed * np.log1p(-rate)), color=style.colour, linewidth=1.0, linestyle=(0, (1, 1.5))
                )
        # The limits are given, since a panel in which nothing was seen has no points to take them from.
        upper.set(xscale="log", xlim=(least / 4.0, 1.5 * max(float(chosen.tau_s.max()), least)))
        # Where the event was never seen there is nothing that a logarithmic axis could show.
        if (chosen[chosen.fault == fault].exposures_with > 0).any():
            upper.set(yscale="log")
        upper.set_title(f"{'no fault' if fault == 'none' else fault}: P(at least one in an exposure)")
        lower.set(yscale="log", ylim=(0.7, 1.6 * samples), xlabel="correlation time [s] (leftmost: independent)")
        lower.set_title("independent samples that would do the same")
        lower.axhline(assumed, color="0.15", linewidth=1.2, linestyle=(0, (6, 2)), zorder=1.5)
        lower.annotate(
            f"assumed in a budget: {assumed}", xy=(0.01, assumed), xycoords=("axes fraction", "data"),
            xytext=(0, -3), textcoords="offset points", ha="left", va="top", fontsize=8.5,
        )  # fmt: skip
    upper_handles = [*axes[0].get_legend_handles_labels()[0]]
    dotted = Line2D(
        [], [], color="0.3", linewidth=1.0, linestyle=(0, (1, 1.5)), label=f"{assumed} independent samples"
    )
    figure.legend(handles=[*upper_handles, dotted], loc="outside lower center", ncols=len(methods) + 1)
    return figure


_EFFECTIVE = ("effective_samples", "effective_low", "effective_high")
