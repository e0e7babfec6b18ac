"""What a receiver's epochs say on one screen: accuracy, alarms, and errors beyond the protection level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import pandas as pd

from pl_mc.injection import Injection
from pl_mc.report.accuracy import DIRECTIONS, ERRORS, accuracy_m
from pl_mc.report.document import Block, Paragraph, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import metres, share_of, share_text

if TYPE_CHECKING:
    from pl_mc.studies.observe.run import ObserveExperiment


def summary(
    experiment: ObserveExperiment, table: pd.DataFrame, injections: Sequence[Injection]
) -> tuple[Block, ...]:
    """The blocks of the summary; ``table`` is that of the epochs."""
    alert, first = experiment.alert_limits(), table.drop_duplicates("epoch")
    count = first.satellites
    injected = f" Injected: {'; '.join(map(str, injections))}." if injections else ""
    return (
        Paragraph(
            f"{len(first)} epochs from {first.time.iloc[0]} to {first.time.iloc[-1]} (GPS time), systems "
            f"{', '.join(experiment.systems)}, mask {experiment.mask_deg:g} deg, error model "
            f"{experiment.error_model}, {count.min()}-{count.max()} satellites (mean {count.mean():.1f}). Alert "
            f"limit: {alert.name}, VAL {metres(alert.vertical_m)} m.{injected}"
        ),
        Paragraph("Position errors over all available epochs [m]:"),
        _accuracy(table),
        Paragraph("Alarms and errors beyond the protection level, epochs and rates:"),
        _alarms(table, alert.vertical_m),
        Paragraph(
            "Intervals are 95 % Clopper-Pearson bounds; they take epochs as independent, but the errors of a real "
            "receiver are correlated over minutes, so the true uncertainty is larger."
        ),
        Paragraph("; ".join(f"{name}: {method_label(name)}" for name in table.method.unique()) + "."),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: ObserveExperiment) -> tuple[str, ...]:
    """Errors, alarms, errors beyond the level."""
    table = tables["epochs"]
    errors, alarms, outside = [], [], []
    for name, group in table.groupby("method", sort=False):
        label, known = method_label(str(name)), group[group.available]
        quantile, rms = accuracy_m(table, str(name))[DIRECTIONS.index("U")]
        epochs = f"{len(known):,} of {len(group):,} epochs"
        errors.append(f"{label} {metres(rms)} m rms, {metres(quantile)} m 95 % in {epochs}")
        alarms.append(f"{label} in {share_of(int(group.alarm.sum()), len(group))}")
        unnoticed = (known.up_m.abs() > known.vpl_m) & ~known.alarm
        outside.append(f"{label} in {share_of(int(unnoticed.sum()), len(known))}")
    return (
        f"Vertical errors: {'; '.join(errors)}.",
        f"Alarms: {'; '.join(alarms)} epochs.",
        f"Vertical error beyond the protection level without alarm: {'; '.join(outside)} epochs; epochs of a real "
        "receiver are correlated, so the true uncertainty is larger than these bounds.",
    )


def _accuracy(table: pd.DataFrame) -> TextTable:
    rows = []
    for method, group in table.groupby("method", sort=False):
        largest = group.loc[group.available, ERRORS].abs().max()
        for direction, accuracy, most in zip(DIRECTIONS, accuracy_m(table, str(method)), largest, strict=True):
            rows.append([method, direction, *map(metres, (*accuracy, most))])
    return TextTable.of(["method", "direction", "95 %", "RMS", "largest"], rows)


def _alarms(table: pd.DataFrame, val_m: float) -> TextTable:
    rows = []
    for method, group in table.groupby("method", sort=False):
        for faulted, part in group.groupby("faulted"):
            beyond = part.available & (part.up_m.abs() > part.vpl_m)
            events = (part.alarm, beyond, beyond & ~part.alarm, part.up_m.abs() > val_m)
            label = "with injected fault" if faulted else "as observed"
            cells = [method, label, len(part), (~part.available).sum(), *map(share_text, events)]
            rows.append([*cells, metres(part.vpl_m.median()), metres(part.hpl_m.median())])
    header = [
        "method", "epochs", "number", "unavailable", "alarm", "U beyond VPL", "U beyond VPL, no alarm",
        "U beyond VAL", "median VPL [m]", "median HPL [m]",
    ]  # fmt: skip
    return TextTable.of(header, rows)
