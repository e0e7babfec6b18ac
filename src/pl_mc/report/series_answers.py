"""What series of epochs say in three sentences: alarms and integrity, accuracy, and how much a draw matters."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pl_mc.report.figures import method_label
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import metres, share_text


def series_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a series with faults in windows, after its ``redraws.csv`` and the paper's table."""
    redraws = run.tables["redraws"]
    first = redraws[redraws.redraw == 0]
    alarms = "; ".join(
        f"{_label(row.method)} in {_share(row.alarms, row.faulted_epochs)}" for row in first.itertuples()
    )
    missed = "; ".join(
        f"{_label(row.method)} {_share(row.unalerted, row.faulted_epochs)}" for row in first.itertuples()
    )
    accuracy = "; ".join(
        f"{_label(r.method)} {metres(r.up_rms_m)} m rms, {metres(r.up_95_m)} m 95 %" for r in first.itertuples()
    )
    paper = next((table for name, table in run.tables.items() if name.startswith("table")), None)
    beside = ""
    if paper is not None and "paper_before_m" in paper:
        up = paper[(paper.direction == "U") & (paper.statistic == "rms")].iloc[0]
        beside = f" (the paper: {metres(up.paper_before_m)} and {metres(up.paper_after_m)} m rms)"
    spread = "; ".join(
        f"{_label(name)} {metres(group.up_rms_m.min())} to {metres(group.up_rms_m.max())} m"
        for name, group in redraws.groupby("method", sort=False)
    )
    draws = redraws.redraw.nunique()
    last = (
        f"Over {draws} draws of satellites, sizes and noise the vertical error ranges from (rms) {spread}."
        if draws > 1
        else "One draw of satellites, sizes and noise was made, so that its chance is in every number."
    )
    return (
        f"Alarms under the injected faults: {alarms} epochs; vertical error beyond the alert limit without "
        f"alarm: {missed}.",
        f"Vertical errors over all epochs: {accuracy}{beside}.",
        last,
    )


def readings_answer(run: RunFolder) -> tuple[str, ...]:
    """Of readings of a paper: how near the base comes, which reading comes nearest, which one stays farthest."""
    table = run.tables["distances"]
    base, near, far = table.iloc[0], table.loc[table.after_factor.idxmin()], table.loc[table.after_factor.idxmax()]
    return (
        f"The base reading ({base.reading}) meets the paper's robust column within a typical factor of "
        f"{_factor(base, 'after')} and its least-squares column within {_factor(base, 'before')}; 1 would be every "
        "value met.",
        f"Nearest of {len(table)} readings in the robust column is {near.varies}: {near.reading}, at "
        f"{_factor(near, 'after')}.",
        f"Farthest is {far.varies}: {far.reading}, at {_factor(far, 'after')}.",
    )


def observe_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a receiver's epochs: errors, alarms, errors beyond the level."""
    table = run.tables["epochs"]
    errors, alarms, beyond = [], [], []
    for name, group in table.groupby("method", sort=False):
        known = group[group.available]
        up = known.up_m.to_numpy(dtype=float)
        rms = float(np.sqrt(np.mean(up**2))) if up.size else float("nan")
        most = float(np.quantile(np.abs(up), 0.95)) if up.size else float("nan")
        errors.append(
            f"{_label(name)} {metres(rms)} m rms, {metres(most)} m 95 % in {len(known):,} of {len(group):,} epochs"
        )
        alarms.append(f"{_label(name)} in {_share(int(group.alarm.sum()), len(group))}")
        outside = known.up_m.abs() > known.vpl_m
        beyond.append(f"{_label(name)} in {_share(int((outside & ~known.alarm).sum()), len(known))}")
    return (
        f"Vertical errors: {'; '.join(errors)}.",
        f"Alarms: {'; '.join(alarms)} epochs.",
        f"Vertical error beyond the protection level without alarm: {'; '.join(beyond)} epochs; epochs of a real "
        "receiver are correlated, so the true uncertainty is larger than these bounds.",
    )


def _share(count: int, total: int) -> str:
    if total == 0:
        return "0 of 0"
    flags = np.arange(total) < count
    number, text = share_text(flags).split(": ", 1)
    return f"{number} of {total:,} ({text})"


def _factor(row: pd.Series, role: str) -> str:
    return f"{row[f'{role}_factor']:.3g} ({row[f'{role}_factor_low']:.3g} to {row[f'{role}_factor_high']:.3g})"


def _label(name: object) -> str:
    return method_label(str(name))
