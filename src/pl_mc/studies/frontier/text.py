"""What a frontier says: its summary, and its answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.report.document import Block, Summary, TextTable
from pl_mc.report.text import percent
from pl_mc.studies.frontier.record import WORLD, FrontierExperiment

# Orders of magnitude in words of a table.
_DIGITS = 3

EXCLUSION, WRONG_EXCLUSION = "exclusion", "wrong_exclusion"


def of_sizes(experiment: FrontierExperiment, event: str) -> tuple[str, ...]:
    """The columns of the rate of an event under each size."""
    return tuple(f"{event}_rate_{size:g}m" for size in experiment.sizes_m)


def number(value: float) -> str:
    """Three digits, and words for what is none."""
    if np.isnan(value):
        return "own"
    return f"{value:.{_DIGITS}g}" if np.isfinite(value) else "none"


def summary(
    experiment: FrontierExperiment, frontier: pd.DataFrame, multipliers: pd.DataFrame, formula: pd.DataFrame,
    stress: pd.DataFrame, besides: pd.DataFrame,
) -> Summary:  # fmt: skip
    """What was judged; for each sky the methods, the smallest mean level first; one multiplier; wrong assumptions."""
    budget, judged = experiment.risk_budget(), experiment.decides
    ((_, _, limit_m),) = judged.levels
    axis = judged.axis
    bias = f", nominal biases of {budget.b_nom_m:g} m" if budget.b_nom_m else ""
    blocks: list[Block | str] = [
        f"Event: {axis} error beyond the level and no rejection by the method's own test, per sample. Target "
        f"{budget.on(axis):g}, prior of a satellite fault {_prior(budget.p_sat)}, of a constellation fault "
        f"{_prior(budget.p_const)}{bias}; single faults of the worst size of each satellite, pairs and all else "
        f"counted as lost and charged in proportion to {budget.p_hmi:g}. A method with a multiplier has, at each "
        "geometry, the one with which it takes what it may; `own` marks levels that are taken as they are. "
        f"{experiment.draws:,} residuals a fault, seed {experiment.seed}."
    ]
    for sky in experiment.skies:
        rows = frontier[frontier.sky == sky.name]
        if rows.empty:
            continue
        where = "random users of the Earth" if sky.site == WORLD else f"epochs at {sky.site}"
        blocks += [
            f"{sky.name}: {rows.geometries.max():,} {where}, {', '.join(sky.constellations)}, {sky.mask_deg:g} deg "
            f"mask, error model {sky.error_model}.",
            TextTable.of(
                [
                    "method", "K (median with bounds, 99 %)", "mean level, 95 %, 99 % [m]",
                    f"alarms fault-free, {limit_m:g} m",
                    *(f"alarms at {size:g} m" for size in experiment.sizes_m), "discontinuity",
                    *(f"level within {limit:g} m" for limit in experiment.limits_m), "risk (mean)", "budget kept",
                ],
                [_row(row, experiment) for row in rows.to_dict("records")],
            ),
        ]  # fmt: skip
    excluding = [name for name in of_sizes(experiment, EXCLUSION) if name in frontier]
    if excluding:
        rows = frontier[frontier[excluding].gt(0.0).any(axis=1)]
        blocks += [
            "Exclusions that go on without an alarm: of the faulted satellite / of another one. The rest alarms, or "
            "passes unnoticed.",
            TextTable.of(
                ["sky", "method", *(f"{size:g} m" for size in experiment.sizes_m)],
                [
                    [row["sky"], row["method"]]
                    + [
                        f"{percent(row[right])} / {percent(row[wrong])} %"
                        for right, wrong in zip(excluding, of_sizes(experiment, WRONG_EXCLUSION), strict=True)
                    ]
                    for row in rows.to_dict("records")
                ],
            ),
        ]
    # A grid of epochs is no random sample.
    random = [sky.name for sky in experiment.skies if sky.site == WORLD]
    if len(multipliers):
        blocks += [
            "One multiplier for a receiver: the largest upper bound of all geometries, and the share of further random "
            "ones whose own bound is no larger, with 95 % confidence; chosen from every other geometry, of how many of "
            "the rest the upper bound is beyond it.",
            TextTable.of(
                ["sky", "method", "K", "geometries", "share served", "K of half", "of the rest beyond it"],
                [
                    [row.sky, row.method, number(row.k), f"{row.geometries}",
                     f"{percent(row.share_kept)} %" if row.sky in random else "-", number(row.k_of_even),
                     f"{row.odd_beyond} of {row.odd}"]
                    for row in multipliers.itertuples()
                ],
            ),
        ]  # fmt: skip
    if len(formula):
        blocks += [
            "A multiplier by what a receiver knows, log K = constant + of_slope s + of_square s^2 + of_dof / (n - t), "
            "s the largest error of a fault per unit of its trace in the residuals, in sigma of the error. Fitted to "
            "every other geometry and raised by the margin (a factor), with which it is enough at each of these; at "
            "the rest, the share of the variance of log K that it explains, and where it is not enough; its mean, and "
            "the one number of the same half. It is no proof for geometries unlike these.",
            TextTable.of(
                ["sky", "method", "constant", "of_slope", "of_square", "of_dof", "margin", "explained", "not enough",
                 "mean K", "one number"],
                [
                    [row.sky, row.method, f"{row.constant:.4f}", f"{row.of_slope:.4f}", f"{row.of_square:.4f}",
                     f"{row.of_dof:.4f}", f"{row.margin:.3f}", f"{percent(max(row.explained, 0.0))} %",
                     f"{row.odd_beyond} of {row.odd}", number(row.k_mean), number(row.k_of_even)]
                    for row in formula.itertuples()
                ],
            ),
        ]  # fmt: skip
    if len(besides):
        blocks += [
            "Faults that the budget counts as lost, and what they do all the same, along the direction that residuals "
            "show least and at the worst size of it: the largest probability of the event over all sets and "
            "geometries, and of pairs the sum over all of them with their priors.",
            TextTable.of(
                ["sky", "method", "faults", "sets", "unseen", "probability (largest)", "sum with priors (mean)"],
                [
                    [row.sky, row.method, row.faults, f"{row.sets:,}", f"{row.unseen:,}",
                     f"{number(row.probability)} +- {row.error:.1g}",
                     number(row.contribution) if np.isfinite(row.contribution) else "-"]
                    for row in besides.itertuples()
                ],
            ),
        ]  # fmt: skip
    if len(stress):
        blocks += [
            "What breaks it: the risk of the analysed modes at the same multiplier where an assumption is wrong, over "
            "that where it holds (median and largest of the geometries).",
            TextTable.of(
                ["sky", "method", "assumption", "risk", "times (median)", "times (largest)"],
                [
                    [
                        row.sky,
                        row.method,
                        row.assumption,
                        f"{number(row.risk)} +- {row.error:.1g}",
                        number(row.times),
                        number(row.times_most),
                    ]
                    for row in stress.itertuples()
                ],
            ),
        ]
    return tuple(blocks)


def _prior(given: float | Mapping[str, float]) -> str:
    if isinstance(given, Mapping):
        return ", ".join(f"{value:g} ({key})" for key, value in given.items())
    return f"{given:g}"


def _row(row: dict[str, Any], experiment: FrontierExperiment) -> list[str]:
    levels = ", ".join(number(row[name]) for name in ("level_mean_m", "level_95_m", "level_99_m"))
    median = f"{number(row['k_50'])} [{number(row['k_50_low'])}, {number(row['k_50_high'])}]"
    k = "own" if np.isnan(row["k_50"]) else f"{median}, {number(row['k_99'])}"
    return [
        row["method"], k, levels, f"{percent(row['alarm_rate'])} %",
        *(f"{percent(row[f'alarm_rate_{size:g}m'])} %" for size in experiment.sizes_m),
        f"{row['discontinuity']:.2g}",
        *(f"{percent(row[f'available_{limit:g}m'])} %" for limit in experiment.limits_m),
        number(row["risk_mean"]), f"{row['kept']} of {row['geometries']}",
    ]  # fmt: skip


def answer(tables: Mapping[str, pd.DataFrame], experiment: FrontierExperiment) -> tuple[str, ...]:
    """Who has the smallest level at each sky, with its alarms under the largest fault, and who has no alarm there."""
    table, size = tables["frontier"], experiment.sizes_m[-1]
    alarms = f"alarm_rate_{size:g}m"
    smallest, silent, none = [], [], []
    for sky, rows in table.groupby("sky", sort=False):
        kept = rows[rows.kept == rows.geometries]
        if kept.empty:
            none.append(str(sky))
            continue
        best, araim = kept.iloc[0], kept[kept.method.str.startswith("araim")]
        against = ""
        if len(araim) and araim.index[0] != best.name:
            least = float(araim.level_mean_m.iloc[0])
            against = f", {best.level_mean_m / least:.2f} of ARAIM's {least:.3g} m"
        alarmed = f"alarms in {percent(best[alarms])} % of draws with {size:g} m on a satellite"
        smallest.append(f"{best.method} with {best.level_mean_m:.3g} m{against} ({sky}; {alarmed})")
        for row in kept[kept[alarms] == 0.0].head(1).to_dict("records"):
            silent.append(f"{row['method']} with {row['level_mean_m']:.3g} m ({sky})")
    nobody = f"; none at {', '.join(none)}" if none else ""
    skies, counts = len(experiment.skies), ", ".join(f"{sky.count}" for sky in experiment.skies)
    return (
        f"The smallest mean level that keeps the budget at every geometry: {'; '.join(smallest) or 'none'}{nobody}.",
        f"The smallest of those without an alarm under {size:g} m on one satellite, in 256 draws of each satellite: "
        f"{'; '.join(silent) or 'none'}.",
        f"Judged at {skies} {'sky' if skies == 1 else 'skies'} of {counts} geometries, each method with a multiplier "
        f"at the one that takes the risk of {experiment.risk_budget().on(experiment.level_axis):g} less its share of "
        "what is lost.",
    )
