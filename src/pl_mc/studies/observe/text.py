"""The one-screen summary of a receiver's epochs: accuracy, alarms, and errors beyond the protection level."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.figures import method_label
from pl_mc.report.text import markdown_table, metres, share_text
from pl_mc.studies.series.zhao2021 import DIRECTIONS, accuracy_m


def observe_summary(
    table: pd.DataFrame, *, title: str, source: str, injections: Sequence[str], alert: AlertLimits
) -> str:
    """The summary in Markdown.

    Args:
        table: ``epoch, time, method, satellites, east_m, north_m, up_m, hpl_m, vpl_m, available, alarm, faulted``.
        title: heading.
        source: systems, mask and error model in words.
        injections: injected faults.
        alert: alert limits.
    """
    first = table.drop_duplicates("epoch")
    count = first.satellites
    methods = list(dict.fromkeys(table.method))
    injected = f" Injected: {'; '.join(injections)}." if injections else ""
    lines = [
        f"# {title}",
        "",
        f"{len(first)} epochs from {first.time.iloc[0]} to {first.time.iloc[-1]} (GPS time), {source}, "
        f"{count.min()}-{count.max()} satellites (mean {count.mean():.1f}). Alert limit: {alert.name}, VAL "
        f"{metres(alert.vertical_m)} m.{injected}",
        "",
        "Position errors over all available epochs [m]:",
        "",
        _accuracy(table, methods),
        "",
        "Alarms and errors beyond the protection level, epochs and rates:",
        "",
        _alarms(table, methods, alert),
        "",
        "Intervals are 95 % Clopper-Pearson bounds; they take epochs as independent, but the errors of a real "
        "receiver are correlated over minutes, so the true uncertainty is larger.",
        "",
        "; ".join(f"{name}: {method_label(name)}" for name in methods) + ".",
    ]
    return "\n".join(lines) + "\n"


def _accuracy(table: pd.DataFrame, methods: Sequence[str]) -> str:
    rows = []
    for method in methods:
        known = table[(table.method == method) & table.available]
        largest = known[["east_m", "north_m", "up_m"]].abs().max()
        for direction, (quantile, rms), most in zip(DIRECTIONS, accuracy_m(table, method), largest, strict=True):
            rows.append([method, direction, metres(quantile), metres(rms), metres(most)])
    return markdown_table(["method", "direction", "95 %", "RMS", "largest"], rows)


def _alarms(table: pd.DataFrame, methods: Sequence[str], alert: AlertLimits) -> str:
    rows = []
    for method in methods:
        for faulted, label in ((False, "as observed"), (True, "with injected fault")):
            part = table[(table.method == method) & (table.faulted == faulted)]
            if len(part):
                beyond = part.available & (part.up_m.abs() > part.vpl_m)
                events = (part.alarm, beyond, beyond & ~part.alarm, part.up_m.abs() > alert.vertical_m)
                cells = [method, label, len(part), int((~part.available).sum()), *map(share_text, events)]
                rows.append([*cells, metres(part.vpl_m.median()), metres(part.hpl_m.median())])
    header = [
        "method", "epochs", "number", "unavailable", "alarm", "U beyond VPL", "U beyond VPL, no alarm",
        "U beyond VAL", "median VPL [m]", "median HPL [m]",
    ]  # fmt: skip
    return markdown_table(header, rows)
