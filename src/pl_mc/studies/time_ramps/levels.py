"""Levels of banks of filters in an experiment about ramps in time: their table, its text and its figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pl_mc.alert import Judged
from pl_mc.geometry import Geometry
from pl_mc.report.document import Block, Heading, TextTable
from pl_mc.report.figures import legend_below, legend_key, limit_line, new_figure
from pl_mc.report.look import styles_of
from pl_mc.report.text import metres, probability_text
from pl_mc.studies.time_ramps.figures import line, plain_ticks
from pl_mc.time_ramps import FilterBank, sequential_levels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Below, a probability is of no interest to any budget.
_LEAST = 1e-12


def levels_of_banks(
    g: Geometry, satellite: str, rates: Sequence[float], tests: Sequence[Any], taus_s: Sequence[float], **options: Any
) -> pd.DataFrame | None:
    """The table of `pl_mc.sequential_levels` of all banks among the tests, at every correlation time; None of none."""
    banks = tuple(test for test in tests if isinstance(test, FilterBank))
    if not banks:
        return None
    parts = [sequential_levels(g, satellite, rates, banks, tau_s=tau_s, **options) for tau_s in taus_s]
    return pd.concat(parts, ignore_index=True)


def level_blocks(table: pd.DataFrame, judged: Judged) -> list[Block | str]:
    """What the levels claim and what they give, method by method and correlation time by correlation time."""
    rows = []
    for (tau, name), own in table.groupby(["tau_s", "method"], sort=False):
        first, worst, missed = own.iloc[0], own.loc[own.misleading.idxmax()], own.loc[own.missed.idxmax()]
        level = f"{_metres(first.vpl_mean_m)}, {_metres(first.vpl_max_m)}"
        rows.append(
            [
                f"{tau:g} s", name, _metres(first.sigma_mean_m), level,
                f"{100 * first.available / first.epochs:.3g} %", f"{first.sigma_ratio:.3g}",
                _at(worst, "misleading"),
                probability_text(worst.misleading_bound), _at(missed, "missed"),
            ]
        )  # fmt: skip
    ramps = table[table.rate_m_per_s > 0]
    times = [
        [f"{tau:g} s", name, *(_time(row) for row in own.itertuples())]
        for (tau, name), own in ramps.groupby(["tau_s", "method"], sort=False)
    ]
    named = [f"{rate:g} m/s" for rate in dict.fromkeys(ramps.rate_m_per_s)]
    return [
        Heading("Levels, exactly"),
        "Vertical levels by solution separation: of snapshots, and of banks of Kalman filters, one without each "
        f"satellite, at the thresholds of their budgets; {judged.alert.name}, {judged.limits()}. Sigma ratio: the "
        "largest true standard deviation over the believed one; where it is above 1 the level proves nothing. "
        "Misleading: the largest probability, of a single epoch under any of the ramps, that the error is beyond the "
        "level and the faulted satellite's test passes, and the largest that the level equation allows for; missed: "
        "beyond the limit, with a level within it. Nothing is drawn.",
        TextTable.of(
            ["tau", "method", "sigma [m]", "level: mean, largest [m]", "level within the limit", "sigma ratio",
             "misleading", "allowed", "missed"], rows,
        ),
        "Time from the onset until a single epoch's test alarms with a probability of one half, and the mean error "
        "then (-: not before the end):",
        TextTable.of(["tau", "method", *named], times),
    ]  # fmt: skip


def level_sentence(table: pd.DataFrame) -> str:
    """How the levels of banks stand to those of snapshots, and whether all of them hold."""
    rows = table[table.tau_s == table.tau_s.max()].drop_duplicates("method").set_index("method")
    levels = "; ".join(f"{_metres(row.vpl_mean_m)} m with {name}" for name, row in rows.iterrows())
    broken = table[table.sigma_ratio > 1.0 + 1e-6]
    worst = table.loc[table.misleading.idxmax()]
    holds = (
        "all of them rest on standard deviations that bound the true ones"
        if broken.empty
        else f"those of {', '.join(dict.fromkeys(broken.method))} rest on standard deviations that are exceeded, by "
        f"up to {100 * (broken.sigma_ratio.max() - 1.0):.3g} %"
    )
    return (
        f"With tau {table.tau_s.max():g} s vertical levels are {levels} on average; {holds}, and what misleads at one "
        f"epoch under a ramp has a probability of at most {probability_text(worst.misleading)} ({worst.method}, "
        f"{worst.rate_m_per_s:g} m/s)."
    )


def levels_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """The largest probability of misleading information, and the mean error at a likely alarm, against the rate."""
    ramps, ((_, _, limit_m),) = table[table.rate_m_per_s > 0], judged.levels
    taus, styles = list(dict.fromkeys(ramps.tau_s)), styles_of(ramps.method)
    figure, axes = new_figure(
        2, len(taus), width_in=4.7 * len(taus) + 0.6, height_in=8.0, title=title, sharex=True, sharey="row"
    )
    for tau, upper, lower in zip(taus, axes, axes[len(taus) :], strict=False):
        for name, look in styles.items():
            rows = ramps[(ramps.tau_s == tau) & (ramps.method == name)]
            line(upper, rows.rate_m_per_s, rows.misleading.where(rows.misleading >= _LEAST), look)
            line(lower, rows.rate_m_per_s, rows.error_at_alarm_50_m, look)
        upper.set(xscale="log", yscale="log")
        upper.set_title(f"tau {tau:g} s")
        lower.set_yscale("log")
        lower.set_xlabel("rate of the ramp [m/s]")
        limit_line(lower, limit_m, judged.limits())
    plain_ticks(axes[len(taus)].yaxis, (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 300, 500))
    axes[0].set_ylabel("P(misleading at an epoch), largest")
    axes[len(taus)].set_ylabel("mean error when half alarm [m]")
    keys = [legend_key(name, markersize=5, **style.look) for name, style in styles.items()]
    legend_below(figure, columns=3, side="center", keys=keys)
    return figure


def _metres(value: float) -> str:
    return metres(float(value)) if np.isfinite(value) else "none"


def _at(row: Any, column: str) -> str:
    """A probability and the rate at which it is the largest."""
    value = float(row[column])
    return f"below {_LEAST:g}" if value < _LEAST else f"{probability_text(value)} at {row.rate_m_per_s:g} m/s"


def _time(row: Any) -> str:
    return f"{row.alarm_50_s:g} s, {metres(row.error_at_alarm_50_m)} m" if np.isfinite(row.alarm_50_s) else "-"
