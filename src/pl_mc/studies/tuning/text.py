"""What an experiment about tuned limits says: what they save at a given risk, and against what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import HORIZONTAL
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.text import percent, rate_text
from pl_mc.studies.tuning.record import TuningExperiment

PRICES = {"vpl": "mean level", "hpl": "mean level", "alarms": "fault-free alarms"}
# Columns that are called by their axis, under one name.
_EITHER = {"k_vertical": "k", "k_horizontal": "k", "vpl_m": "level_m", "hpl_m": "level_m"}
# Changes within so many standard errors are none.
_CLEAR = 2.0


def summary(
    table: pd.DataFrame, worst: pd.DataFrame | None, experiment: TuningExperiment, g: Geometry, faults: Faults
) -> tuple[Block, ...]:
    """The blocks of the summary.

    Args:
        table: rows of `pl_mc.tune` with ``target, tuned_for, method``, and those of least squares (``exact``).
        worst: the worst faults that were found with these limits and multipliers, where they were sought.
        experiment: the record.
        g: the epoch.
        faults: under which the targets are kept.
    """
    judged, bound = experiment.decides, f"{100 * experiment.confidence:g} %"
    (level,) = (one.level for one in judged.called)
    beyond = f"misleading: {judged.beyond_level} and no alarm. " if judged.axis == HORIZONTAL else ""
    table = table.rename(columns=_EITHER)
    return (
        Paragraph(
            f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns; Gaussian errors, "
            f"independent of each other. {judged.alert.name}, {judged.limits()}, seed {experiment.seed}. {beyond}"
            f"P({experiment.event}) per sample is kept at the target under each of these faults, by itself: "
            f"{', '.join(faults.labels)}. Nothing here holds for another geometry, noise or other faults."
        ),
        Bullets(tuple(_gains(table, level))),
        _limits(table, level),
        Paragraph(
            f"K: the best value [bounds, each at {bound}]: the upper one keeps the target, and mean {level} and alarms "
            f"are those with it, fault-free, on fresh draws (alarms with two-sided bounds at {bound}; of least "
            "squares all is exact). A target with 20 events in the draws is counted; of a rarer one K comes from "
            "the curve of the risk against K that subset simulation gives, and check is the risk at the best value "
            "by importance sampling with other random numbers. Gains are those at the upper bounds, with one "
            "standard error."
        ),
        *_doubts(f"{row.target:g}, {_name(row)}: {row.warning}." for row in table.itertuples() if _doubtful(row)),
        *(_other_faults(worst) if worst is not None else ()),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: TuningExperiment) -> tuple[str, ...]:
    """What tuning gains, in a sentence for each target, and one about least squares."""
    (called,) = experiment.decides.called
    return tuple(_gains(tables["tuned"].rename(columns=_EITHER), called.level))


def _gains(table: pd.DataFrame, level: str) -> Iterator[str]:
    exact = table[table.limits == "exact"]
    for target, group in table.drop(exact.index).groupby("target", sort=False):
        parts = [_gain(rows, str(aim)) for aim, rows in group.groupby("tuned_for", sort=False)]
        yield f"At {target:g}: {'; '.join(parts)}."
    if len(exact):
        parts = [f"{row.level_m:.3g} m and {percent(row.alarm_rate)} % at {row.target:g}" for row in exact.itertuples()]
        yield f"Least squares: a mean {level} and fault-free alarms of {', '.join(parts)} (exact)."


def _gain(rows: pd.DataFrame, aim: str) -> str:
    """What tuning for one price does to it."""
    start, tuned = (rows[rows.limits == name].iloc[0] for name in ("start", "tuned"))
    what, limits = PRICES[aim], f"k0 {tuned.k0:.2f}, k1 {tuned.k1:.2f}"
    if np.isnan(tuned.objective):
        return f"{what}: no number ({tuned.warning})"
    if np.isnan(start.objective):
        return f"{what}: {limits}, but no number for the default ({start.warning})"
    if abs(tuned.change) <= _CLEAR * tuned.change_error:
        return f"{what}: {limits}, whose gain is within its error"
    if aim != "alarms":
        gain = f"from {start.objective:.3g} m to {tuned.objective:.3g} m"
        change, error = (100.0 * length / start.objective for length in (tuned.change, tuned.change_error))
        return f"{what} {gain} with {limits} ({change:+.1f} % +- {error:.1f})"
    gain = f"from {_alarms(start)} to {_alarms(tuned)}"
    return f"{what} {gain} with {limits} (change {100 * tuned.change:+.3g} % +- {100 * tuned.change_error:.2g})"


def _alarms(row: Any) -> str:
    """The rate with its bounds; where nothing was counted the upper one."""
    return rate_text(int(row.alarms), int(row.draws), row.alarm_low, row.alarm_high)


def each_once(group: pd.DataFrame) -> pd.DataFrame:
    """Of the rows of a target: least squares, the default once, and what was tuned."""
    start = group[group.limits == "start"].iloc[:1]
    return pd.concat([group[group.limits == "exact"], start, group[group.limits == "tuned"]])


def _limits(table: pd.DataFrame, level: str) -> TextTable:
    header = ["target", "limits", "k0", "k1", "K", "found", f"mean {level} [m]", "alarms, fault-free", "check"]
    rows = []
    for target, group in table.groupby("target", sort=False):
        for row in each_once(group).itertuples():
            k0, k1, k, alarms = "", "", f"{row.k_best:.4g}", f"{percent(row.alarm_rate)} %"
            if row.limits != "exact":
                k0, k1, k = f"{row.k0:.2f}", f"{row.k1:.2f}", f"{k} [{row.k_low:.4g}, {row.k:.4g}]"
                alarms = f"{_alarms(row)}, {int(row.alarms):,} of {int(row.draws):,}"
            mean = f"{row.level_m:.4g}"
            if np.isnan(row.k):
                k, mean, alarms = "no number", "", ""
            check = f"{row.check_probability:.2g} [{row.check_low:.2g}, {row.check_high:.2g}]"
            check = check if row.check_probability > 0 else ""
            name = _name(row) + (" (!)" if _doubtful(row) else "")
            rows.append([f"{target:g}", name, k0, k1, k, row.found, mean, alarms, check])
    return TextTable.of(header, rows)


def _name(row: Any) -> str:
    """Limits in words."""
    return {"exact": "least squares", "start": "default"}.get(row.limits) or f"tuned, {PRICES[row.tuned_for]}"


def _other_faults(worst: pd.DataFrame) -> tuple[Block, ...]:
    """Other faults than those under which the target is kept."""
    rows = []
    for row in worst.itertuples():
        bounds = "exact" if row.limits == "exact" else f"[{row.low:.3g}, {row.high:.3g}]"
        failed = "one satellite" if row.failed == 1 else "two satellites"
        risk = f"{row.probability:.3g} {bounds}" + (" (!)" if _doubtful(row) else "")
        rows.append([_name(row), failed, row.fault, risk])
    return (
        Heading("Other faults"),
        Paragraph(
            f"With the limits and multipliers for {worst.target.iloc[0]:g}, the fault of all satellites (pairs) "
            "that a search found worst, and P(misleading) under it, estimated with noise of its own; a worse fault "
            "may have been passed over."
        ),
        TextTable.of(["limits", "faulted", "worst fault found", "P(misleading)"], rows),
        *_doubts(f"{_name(row)}, {row.fault}: {row.warning}." for row in worst.itertuples() if _doubtful(row)),
    )


def _doubtful(row: Any) -> bool:
    # Of exact rows the warning may be no text but a gap.
    return isinstance(row.warning, str) and row.warning != ""


def _doubts(sentences: Iterator[str]) -> tuple[Block, ...]:
    """What the mark (!) stands for, each once; nothing where it is not used."""
    items = tuple(dict.fromkeys(sentences))
    return (Paragraph("(!):"), Bullets(items)) if items else ()
