"""The summary of an experiment about tuned limits: what they save at a given risk, and against what."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.faults import Faults
from pl_mc.geometry import Geometry
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import markdown_table, percent, rate_text

PRICES = {"vpl": "mean level", "alarms": "fault-free alarms"}
# Changes within so many standard errors are none.
_CLEAR = 2.0


def tuning_summary(
    table: pd.DataFrame,
    g: Geometry,
    *,
    faults: Faults,
    alert: AlertLimits,
    title: str,
    seed: int,
    event: str,
    confidence: float,
    worst: pd.DataFrame | None = None,
) -> str:
    """The summary in Markdown.

    Args:
        table: rows of `pl_mc.tune` with ``target, tuned_for, method``, and those of least squares (``exact``).
        g: the epoch.
        faults: under which the targets are kept.
        alert, title, seed, event, confidence: of the experiment.
        worst: the worst faults that were found with these limits and multipliers, where they were sought.
    """
    bound = f"{100 * confidence:g} %"
    lines = [
        f"# {title}",
        "",
        f"Epoch {int(g.epoch)}: {g.satellite_count} satellites, {g.unknown_count} unknowns; Gaussian errors, "
        f"independent of each other. {alert.name}, VAL {alert.vertical_m:g} m, seed {seed}. P({event}) per sample "
        f"is kept at the target under each of these faults, by itself: {', '.join(faults.labels)}. Nothing here "
        "holds for another geometry, noise or other faults.",
        "",
        *(f"- {sentence}" for sentence in tuning_answers(table)),
        "",
        _table_text(table),
        "",
        f"K: the best value [bounds, each at {bound}]: the upper one keeps the target, and mean VPL and alarms are "
        f"those with it, fault-free, on fresh draws (alarms with two-sided bounds at {bound}; of least squares all "
        "is exact). A target with 20 events in the draws is counted; of a rarer one K comes from the curve of the "
        "risk against K that subset simulation gives, and check is the risk at the best value by importance "
        "sampling with other random numbers. Gains are those at the upper bounds, with one standard error.",
        *_warnings(table),
        *(_worst_text(worst) if worst is not None else ()),
    ]
    return "\n".join(lines) + "\n"


def tuning_answers(table: pd.DataFrame) -> tuple[str, ...]:
    """What tuning gains, in a sentence for each target, and one about least squares."""
    said = []
    estimated = table[table.limits != "exact"]
    for target, group in estimated.groupby("target", sort=False):
        parts = [_gain(group[group.tuned_for == aim], str(aim)) for aim in dict.fromkeys(group.tuned_for)]
        said.append(f"At {target:g}: {'; '.join(parts)}.")
    exact = table[table.limits == "exact"]
    if len(exact):
        parts = [
            f"{row.vpl_m:.3g} m and {percent(row.alarm_rate)} % at {row.target:g}" for row in exact.itertuples()
        ]
        said.append(f"Least squares: a mean VPL and fault-free alarms of {', '.join(parts)} (exact).")
    return tuple(said)


def tuning_answer(run: RunFolder) -> tuple[str, ...]:
    """The same for the page of a run."""
    return tuning_answers(run.tables["tuned"])


def _gain(rows: pd.DataFrame, aim: str) -> str:
    """What tuning for one price does to it."""
    start, tuned = (rows[rows.limits == name].iloc[0] for name in ("start", "tuned"))
    what = PRICES[aim]
    if np.isnan(tuned.objective):
        return f"{what}: no number ({tuned.warning})"
    limits = f"k0 {tuned.k0:.2f}, k1 {tuned.k1:.2f}"
    if np.isnan(start.objective):
        return f"{what}: {limits}, but no number for the default ({start.warning})"
    if abs(tuned.change) <= _CLEAR * tuned.change_error:
        return f"{what}: {limits}, whose gain is within its error"
    if aim == "vpl":
        gain = f"from {start.objective:.3g} m to {tuned.objective:.3g} m"
        share = 100.0 * tuned.change / start.objective
        return f"{what} {gain} with {limits} ({share:+.1f} % +- {100.0 * tuned.change_error / start.objective:.1f})"
    gain = f"from {_alarms(start)} to {_alarms(tuned)}"
    return f"{what} {gain} with {limits} (change {100 * tuned.change:+.3g} % +- {100 * tuned.change_error:.2g})"


def _alarms(row: Any) -> str:
    """The rate with its bounds; where nothing was counted the upper one."""
    return rate_text(int(row.alarms), int(row.draws), row.alarm_low, row.alarm_high)


def _table_text(table: pd.DataFrame) -> str:
    header = ["target", "limits", "k0", "k1", "K", "found", "mean VPL [m]", "alarms, fault-free", "check"]
    rows = []
    for target in dict.fromkeys(table.target):
        group = table[table.target == target]
        for row in judged(group).itertuples():
            exact = row.limits == "exact"
            name = _name(row.limits, row.tuned_for)
            k = f"{row.k_best:.4g}" + ("" if exact else f" [{row.k_low:.4g}, {row.k_vertical:.4g}]")
            known = not np.isnan(row.k_vertical)
            alarms = (
                f"{percent(row.alarm_rate)} %"
                if exact
                else f"{_alarms(row)}, {int(row.alarms):,} of {int(row.draws):,}"
            )
            check = f"{row.check_probability:.2g} [{row.check_low:.2g}, {row.check_high:.2g}]"
            rows.append(
                [
                    f"{target:g}",
                    name + (" (!)" if row.warning else ""),
                    "" if exact else f"{row.k0:.2f}",
                    "" if exact else f"{row.k1:.2f}",
                    k if known else "no number",
                    row.found,
                    f"{row.vpl_m:.4g}" if known else "",
                    alarms if known else "",
                    check if row.check_probability > 0 else "",
                ]
            )
    return markdown_table(header, rows)


def _name(limits: str, tuned_for: str) -> str:
    """Limits in words."""
    return {"exact": "least squares", "start": "default"}.get(limits) or f"tuned, {PRICES[tuned_for]}"


def judged(group: pd.DataFrame) -> pd.DataFrame:
    """Of the rows of a target: least squares, the default once, and what was tuned."""
    start = group[group.limits == "start"].iloc[:1]
    return pd.concat([group[group.limits == "exact"], start, group[group.limits == "tuned"]])


def _worst_text(worst: pd.DataFrame) -> list[str]:
    """Other faults than those under which the target is kept, in Markdown."""
    rows = []
    for row in worst.itertuples():
        exact = row.limits == "exact"
        bounds = "exact" if exact else f"[{row.low:.3g}, {row.high:.3g}]"
        doubt = row.warning if isinstance(row.warning, str) else ""
        rows.append(
            [
                _name(row.limits, row.tuned_for),
                "one satellite" if row.failed == 1 else "two satellites",
                row.fault,
                f"{row.probability:.3g} {bounds}" + (" (!)" if doubt else ""),
            ]
        )
    doubts = [
        f"- {_name(row.limits, row.tuned_for)}, {row.fault}: {row.warning}."
        for row in worst.itertuples()
        if isinstance(row.warning, str) and row.warning
    ]
    return [
        "",
        "## Other faults",
        "",
        f"With the limits and multipliers for {worst.target.iloc[0]:g}, the fault of all satellites (pairs) that a "
        "search found worst, and P(misleading) under it, estimated with noise of its own; a worse fault may have "
        "been passed over.",
        "",
        markdown_table(["limits", "faulted", "worst fault found", "P(misleading)"], rows),
        *(["", "(!):", "", *doubts] if doubts else []),
    ]


def _warnings(table: pd.DataFrame) -> Iterable[str]:
    known = table[table.warning.fillna("") != ""]
    lines = [f"- {row.target:g}, {_name(row.limits, row.tuned_for)}: {row.warning}." for row in known.itertuples()]
    return ["", "(!):", "", *dict.fromkeys(lines)] if lines else []
