"""Figures of a comparison of many methods: a map of rates, method by bias, and tests at one false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import in_common_look, new_figure, series_style
from pl_mc.statistics.intervals import clopper_pearson

HEADINGS = {
    "alarm": "P(alarm), VAL {alert.vertical_m:g} m",
    "missed": "P(|vertical error| > VAL, no alarm)",
    "misleading": "P(|vertical error| > VPL, no alarm)",
}
COLOURS = "viridis_r"

# Curves beyond this number have open markers.
_STYLES = 6


@dataclass(frozen=True)
class EqualTables:
    """Tests at one false-alarm rate.

    Attributes:
        rates: of their sweep, fault-free case included.
        tests: see `pl_mc.studies.compare.run.equal_table`.
        p_fa: the rate.
    """

    rates: pd.DataFrame
    tests: pd.DataFrame
    p_fa: float

    @property
    def comparable(self) -> pd.DataFrame:
        """The rates of the tests whose measured false-alarm rate fits."""
        return self.rates[self.rates.method.isin(self.tests.method[self.tests.fits])]


@in_common_look
def comparison_figure(rates: pd.DataFrame, overview: pd.DataFrame, *, alert: AlertLimits, title: str) -> Figure:
    """Rates of alarms, missed detections and misleading information, method by bias, and availability.

    One logarithmic scale of colours for all, which begins at one event; white is none at all.

    Args:
        rates: of a sweep over a ramp, fault-free case included, one row per method and fault.
        overview: see `pl_mc.studies.compare.run.overview_table`.
        alert: alert limits.
        title: heading.
    """
    methods, faults = list(dict.fromkeys(rates.method)), list(dict.fromkeys(rates.fault))
    bias = [0.0 if fault == "none" else float(rates[rates.fault == fault].bias_m.iloc[0]) for fault in faults]
    figure, axes = new_figure(
        1, 4, width_in=13.0, height_in=2.1 + 0.26 * len(methods), sharey=True,
        gridspec_kw={"width_ratios": [1.0, 1.0, 1.0, 0.36]},
    )  # fmt: skip
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    draws = int(rates.draws.min())
    norm = LogNorm(1.0 / draws, 1.0)
    for panel, (event, heading) in zip(axes[:3], HEADINGS.items(), strict=True):
        table = rates.pivot(index="method", columns="fault", values=f"{event}_rate").loc[methods, faults]
        event_map(panel, table.to_numpy(), norm)
        step = max(1, round((len(faults) - 1) / 5))
        panel.set_xticks(range(0, len(faults), step), [f"{value:g}" for value in bias[::step]])
        panel.set(xlabel="bias [m]")
        panel.set_title(heading.format(alert=alert), fontsize=9.5)
    bar = figure.colorbar(
        ScalarMappable(norm=norm, cmap=COLOURS), ax=axes[:3], location="bottom", shrink=0.5, aspect=50, pad=0.02
    )
    bar.set_label(f"share of {draws:,} draws; white: none (95 % upper bound {clopper_pearson(0, draws)[1]:.1e})")
    bar.outline.set_visible(False)
    axes[0].set_yticks(range(len(methods)), methods, fontsize=8.5)
    axes[0].set_ylim(len(methods) - 0.5, -0.5)
    share_bars(axes[3], overview.set_index("method").loc[methods])
    return figure


def event_map(panel: Axes, values: np.ndarray, norm: LogNorm) -> None:
    shown = np.ma.masked_less_equal(values, 0.0)
    panel.imshow(shown, aspect="auto", norm=norm, cmap=COLOURS, interpolation="nearest")
    panel.grid(visible=False)
    panel.set_xticks(np.arange(-0.5, values.shape[1]), minor=True)
    panel.set_yticks(np.arange(-0.5, values.shape[0]), minor=True)
    panel.grid(which="minor", color="0.9", linewidth=0.4)
    panel.tick_params(which="minor", length=0)
    for edge in ("left", "bottom"):
        panel.spines[edge].set_visible(False)


def share_bars(panel: Axes, rows: pd.DataFrame) -> None:
    """Availability as bars with its number; bounds would be narrower than a line."""
    place = np.arange(len(rows))
    panel.barh(place, rows.availability, height=0.62, color="0.78")
    for y, share in zip(place, rows.availability, strict=True):
        text = "100 %" if share == 1 else f"{100 * share:.2f} %" if share > 0.99 else f"{100 * share:.1f} %"
        panel.annotate(
            text, xy=(0.0, y), xytext=(4, 0), textcoords="offset points", va="center", ha="left", fontsize=8.0
        )
    panel.set(xlim=(0, 1), xlabel="share of draws", xticks=(0.0, 0.5, 1.0))
    panel.grid(visible=False)
    panel.tick_params(axis="y", length=0)
    panel.set_title("PL ≤ AL, no fault", fontsize=9.5)


@in_common_look
def equal_figure(tables: EqualTables, *, alert: AlertLimits, title: str) -> Figure:
    """Alarms and misleading information of tests at one false-alarm rate, against the bias, with 95 % intervals.

    Methods with the same counts everywhere share one curve. Tests whose measured rate is another one are left out.
    """
    figure, panels = new_figure(2, 1, width_in=9.0, height_in=8.0, sharex=True)
    figure.suptitle(f"{title}: tests at a false-alarm rate of {tables.p_fa:g}", x=0.01, ha="left", fontsize=11)
    draws = int(tables.rates.draws.min())
    lowest = 0.3 * float(clopper_pearson(0, draws)[1])
    for panel, event in zip(panels, ("alarm", "misleading"), strict=True):
        for number, (joined, rows) in enumerate(same_curves(tables.comparable, event).items()):
            style = series_style(number)
            rows = rows.assign(bias_m=rows.bias_m.where(rows.fault != "none", 0.0))
            rate = rows[f"{event}_rate"].where(rows[f"{event}_rate"] > 0)
            spread = np.vstack([rate - rows[f"{event}_low"], rows[f"{event}_high"] - rate])
            panel.errorbar(
                rows.bias_m, rate, yerr=np.maximum(spread, 0.0), linestyle=style.line, marker=style.marker,
                markersize=4.5, color=style.colour, markerfacecolor="white" if number >= _STYLES else style.colour,
                linewidth=1.2, capsize=2, label=",\n".join(short_name(name) for name in joined.split(",\n")),
            )  # fmt: skip
        unseen = float(clopper_pearson(0, draws)[1])
        panel.axhline(unseen, color="0.55", linewidth=0.8, linestyle=(0, (5, 3)))
        panel.annotate(
            "95 % upper bound of none seen", xy=(0.995, unseen), xycoords=("axes fraction", "data"),
            xytext=(0, 2), textcoords="offset points", ha="right", fontsize=8.0, color="0.35",
        )  # fmt: skip
        panel.set(yscale="log", ylim=(lowest, 1.6))
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8.0)
    panels[1].set(xlabel="bias [m]")
    panels[0].axhline(tables.p_fa, color="0.15", linewidth=1.0, linestyle=":")
    panels[0].set_title("P(alarm); dotted: the false-alarm rate")
    panels[1].set_title(HEADINGS["misleading"])
    return figure


def short_name(name: str) -> str:
    """A name without the settings that give it its false-alarm rate, which the table has."""
    base, _, options = name.partition("(")
    kept = [one for one in options.removesuffix(")").split(",") if one and not one.startswith(("p_fa=", "alpha="))]
    return f"{base}({', '.join(kept)})" if kept else base


def same_curves(rates: pd.DataFrame, event: str) -> dict[str, pd.DataFrame]:
    """The rows of one method for each set of methods that share all counts of an event, by their joined names."""
    groups: dict[tuple[float, ...], list[str]] = {}
    for name, rows in rates.groupby("method", sort=False):
        groups.setdefault(tuple(rows[f"{event}_rate"]), []).append(str(name))
    return {",\n".join(names): rates[rates.method == names[0]] for names in groups.values()}
