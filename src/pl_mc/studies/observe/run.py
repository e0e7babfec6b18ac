"""Experiments of the kind ``observe``: real receiver files, every method at every epoch, with injected faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from pl_mc.alert import Judged
from pl_mc.engine import Execution, solve
from pl_mc.engine.drawn_biases import numbers_of_draw
from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry import Geometry
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.injection import inject
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_receiver_series, read_truth
from pl_mc.report.accuracy import DIRECTIONS, ERRORS, accuracy_m, beyond_level, beyond_limit, beyond_words, sizes_m
from pl_mc.report.document import Summary, TextTable
from pl_mc.report.figures import legend_below, limit_line, method_label, new_figure, series_style, shade
from pl_mc.report.findings import Findings, Table, picture
from pl_mc.report.text import metres, share_of, share_text
from pl_mc.studies.fault_fields import FaultText
from pl_mc.studies.spec import ByOneAxis, ReceiverFiles
from pl_mc.studies.study import Check, Work, refuse

# Lines of so few epochs have points; further apart than so many steps epochs are missing; levels up to so many times
# the limit are drawn on a linear axis.
_FEW_EPOCHS = 60
_STEPS_WITHOUT_GAP = 1.5
_LINEAR_UP_TO = 4.0

# A day with an epoch every 30 s takes less than a series of it, which is solved 42 times [s].
_SECONDS_A_DAY = 1.2


class ObserveExperiment(ByOneAxis, ReceiverFiles):
    """Receiver files and a true position or track; see `pl_mc.receiver.read_receiver_series`.

    ``faults`` holds texts such as ``G02:+30m:545-645``, see `pl_mc.biases`; all of them are added to the errors, those
    that are drawn as the seed has them, anew at each epoch.
    """

    kind: Literal["observe"] = "observe"
    faults: tuple[FaultText, ...] = ()

    def input_files(self) -> Mapping[str, Path]:
        """The RINEX files, and the track where the truth is one."""
        return self.receiver_files()


def run(experiment: ObserveExperiment, execution: Execution) -> Findings:
    """Every epoch by every method, and the errors over the epochs."""
    series = read_receiver_series(
        experiment.observations, experiment.navigation, read_truth(experiment.truth), systems=experiment.systems,
        signals=experiment.signals, mask_deg=experiment.mask_deg, error_model=experiment.model(),
        ionosphere=experiment.ionosphere,
    )  # fmt: skip
    g = series.geometry
    _require_solution(experiment, g, series.notes)
    injected = Faults.joined([no_fault(g), *(biases(g, text) for text in experiment.faults)])
    errors_m, faulted, notes = inject(g, series.errors_m, injected, numbers_of_draw(g, seed=experiment.seed))
    judged = experiment.decides
    table = solve(
        g, errors_m, methods=experiment.method_records(), alert=judged.alert, axis=judged.axis,
        precision=experiment.precision,
    )  # fmt: skip
    experiment.with_axis(table)["faulted"] = table.epoch.map(pd.Series(faulted, index=g.epoch))
    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    return Findings(
        summary=summary(experiment, table, injected, series.signals),
        tables=(Table("epochs", table, stored="both"),),
        pictures=(error_figure(table, judged=judged, title=experiment.title),),
        notes=(*series.notes, *notes),
    )


def work(experiment: ObserveExperiment) -> Work:
    """What a run costs; how long the files are shows only when they are read."""
    return Work(None, _SECONDS_A_DAY, "for files of a day with an epoch every 30 s")


def checks(experiment: ObserveExperiment, g: Geometry | None) -> Iterator[Check]:
    """Every file is there."""
    for field, path in experiment.input_files().items():
        if not path.is_file():
            yield field, partial(refuse, f"{field}: {path}: there is no such file.")


def _require_solution(experiment: ObserveExperiment, g: Geometry, notes: Sequence[str]) -> None:
    """Raise `InputError` where no epoch has as many satellites as there are unknowns."""
    seen, unknown = g.in_view.sum(axis=1), g.unknown_count
    if (seen >= unknown).any():
        return
    best = int(np.argmax(seen - unknown))
    because = f" Notes: {' '.join(notes)}" if notes else ""
    raise InputError(
        f"{experiment.observations}: no epoch has a solution; at best {seen[best]} of the {unknown[best]} satellites "
        f"that are needed are in view (epoch {g.epoch[best]}), three for the position and one for the clock of each "
        f"system.{because}"
    )


def summary(experiment: ObserveExperiment, table: pd.DataFrame, faults: Faults, signals: Sequence[str]) -> Summary:
    """The blocks of the summary; ``table`` is that of the epochs."""
    judged, first = experiment.decides, table.drop_duplicates("epoch")
    count = first.satellites
    accuracy = []
    for method, group in table.groupby("method", sort=False):
        largest = group.loc[group.available, ERRORS].abs().max()
        for direction, lengths, most in zip(DIRECTIONS, accuracy_m(table, str(method)), largest, strict=True):
            accuracy.append([method, direction, *map(metres, (*lengths, most))])
    injected = f" Injected: {'; '.join(faults.labels[1:])}." if len(faults) > 1 else ""
    return (
        f"{len(first)} epochs from {first.time.iloc[0]} to {first.time.iloc[-1]} (GPS time), "
        f"{', '.join(signals)}, ionosphere {experiment.ionosphere}, mask {experiment.mask_deg:g} deg, error model "
        f"{experiment.error_model}, {count.min()}-{count.max()} satellites (mean {count.mean():.1f}). Alert "
        f"limit: {judged.alert.name}, {judged.limits(metres)}.{injected}",
        "Position errors over all available epochs [m]:",
        TextTable.of(["method", "direction", "95 %", "RMS", "largest"], accuracy),
        "Alarms and errors beyond the protection level, epochs and rates:",
        _alarms(table, judged),
        "Intervals are 95 % Clopper-Pearson bounds; they take epochs as independent, but the errors of a real "
        "receiver are correlated over minutes, so the true uncertainty is larger.",
        "; ".join(f"{name}: {method_label(name, judged.axis)}" for name in table.method.unique()) + ".",
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: ObserveExperiment) -> tuple[str, ...]:
    """Errors, alarms, errors beyond the level."""
    table, judged = tables["epochs"], experiment.decides
    alarms, outside = [], []
    errors: dict[str, list[str]] = {one.error: [] for one in judged.called}
    for name, group in table.groupby("method", sort=False):
        label, known = method_label(str(name), judged.axis), group[group.available]
        epochs = f"{len(known):,} of {len(group):,} epochs"
        for said, size_m in zip(errors.values(), sizes_m(known, judged), strict=True):
            rms, quantile = (np.sqrt((size_m**2).mean()), size_m.quantile(0.95)) if len(size_m) else (np.nan, np.nan)
            said.append(f"{label} {metres(rms)} m rms, {metres(quantile)} m 95 % in {epochs}")
        alarms.append(f"{label} in {share_of(int(group.alarm.sum()), len(group))}")
        unnoticed = beyond_level(known, judged) & ~known.alarm
        outside.append(f"{label} in {share_of(int(unnoticed.sum()), len(known))}")
    beyond = " or ".join(errors)
    return (
        *(f"{error.capitalize()}s: {'; '.join(said)}." for error, said in errors.items()),
        f"Alarms: {'; '.join(alarms)} epochs.",
        f"{beyond.capitalize()} beyond the protection level without alarm: {'; '.join(outside)} epochs; epochs of a "
        "real receiver are correlated, so the true uncertainty is larger than these bounds.",
    )


def _alarms(table: pd.DataFrame, judged: Judged) -> TextTable:
    rows = []
    for method, group in table.groupby("method", sort=False):
        for faulted, part in group.groupby("faulted"):
            beyond = beyond_level(part, judged)
            events = (part.alarm, beyond, beyond & ~part.alarm, beyond_limit(part, judged))
            label = "with injected fault" if faulted else "as observed"
            cells = [method, label, len(part), (~part.available).sum(), *map(share_text, events)]
            rows.append([*cells, metres(part.vpl_m.median()), metres(part.hpl_m.median())])
    level, limit = beyond_words(judged)
    header = [
        "method", "epochs", "number", "unavailable", "alarm", level, f"{level}, no alarm", limit, "median VPL [m]",
        "median HPL [m]",
    ]  # fmt: skip
    return TextTable.of(header, rows)


@picture("epochs", "Position errors and protection levels over time.")
def error_figure(table: pd.DataFrame, *, judged: Judged, title: str) -> Figure:
    """East, north and up errors and levels against time, method by method, faulted epochs shaded.

    ``table`` has ``epoch, time, method, east_m, north_m, up_m, vpl_m, hpl_m, faulted``. Levels are drawn in
    full; where some are far beyond the limit, on a logarithmic axis.
    """
    panels = 3 + len(judged.levels)
    figure, axes = new_figure(panels, 1, width_in=8.0, height_in=2.25 * panels, title=title, sharex=True)
    windows, step = faulted_windows(table), _longest_step(table)
    labels = {"east_m": "east error", "north_m": "north error", "up_m": "up error"}
    labels |= {f"{pl}_m": name for pl, name, _ in judged.levels}
    for panel, (column, label) in zip(axes, labels.items(), strict=True):
        shade(panel, windows, "faulted epochs")
        for k, (method, group) in enumerate(table.groupby("method", sort=False)):
            # Least squares lies below in a lighter line, so that both stay visible where they agree.
            line, width, alpha = ("-", 1.3, 0.55) if k == 0 else ((0, (2, 1)), 0.8, 1.0)
            # A line ends where epochs are missing, and goes on after them.
            parts = (group.time.diff() > step).cumsum()
            for j, (_, part) in enumerate(group.groupby(parts)):
                panel.plot(
                    part.time, part[column], linestyle=line, color=series_style(k).colour, linewidth=width,
                    alpha=alpha, label=method_label(str(method), judged.axis) if j == 0 else None,
                    marker="." if len(part) < _FEW_EPOCHS else None,
                )  # fmt: skip
        panel.set_ylabel(f"{label} [m]")
        panel.margins(x=0.01)
    for panel, (pl, _, limit_m), one in zip(axes[3:], judged.levels, judged.called, strict=True):
        level_m = table[f"{pl}_m"]
        _levels(panel, level_m[np.isfinite(level_m)], limit_m, one.limit)
    dates = AutoDateLocator()
    axes[-1].xaxis.set_major_locator(dates)
    form = ConciseDateFormatter(dates, show_offset=False)
    form.formats[5] = "%H:%M:%S"
    if table.time.iloc[-1] - table.time.iloc[0] <= pd.Timedelta(days=1):
        form.zero_formats[3] = "%H:%M"
    axes[-1].xaxis.set_major_formatter(form)
    first, last = (f"{time:%Y-%m-%d}" for time in (table.time.iloc[0], table.time.iloc[-1]))
    axes[-1].set_xlabel(f"GPS time, {first if first == last else f'{first} to {last}'}")
    legend_below(figure, axes[:1], columns=4)
    return figure


def _levels(panel: Axes, level_m: pd.Series, limit_m: float, name: str) -> None:
    """The limit, and an axis on which every level is."""
    largest_m = max(float(level_m.max()) if len(level_m) else 0.0, limit_m)
    if largest_m > _LINEAR_UP_TO * limit_m:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_ylim(top=1.3 * largest_m)
    else:
        panel.set_ylim(0.0, 1.12 * largest_m)
    limit_line(panel, limit_m, f"{name} {limit_m:g} m")


def _longest_step(table: pd.DataFrame) -> pd.Timedelta:
    """Epochs further apart than this have others between them that are missing."""
    steps = table.time.drop_duplicates().diff().dropna()
    return pd.Timedelta(days=1) if steps.empty else _STEPS_WITHOUT_GAP * steps.median()


def faulted_windows(table: pd.DataFrame) -> list[tuple[pd.Timestamp, pd.Timestamp]]:
    """First and last time of each run of faulted epochs, with half a step on both sides."""
    epochs = table.drop_duplicates("epoch").assign(faulted=table.groupby("epoch").faulted.any().to_numpy())
    half = _longest_step(table) / (2 * _STEPS_WITHOUT_GAP)
    runs = (epochs.faulted != epochs.faulted.shift()).cumsum()[epochs.faulted]
    times = epochs.time[epochs.faulted].groupby(runs)
    return [(run.iloc[0] - half, run.iloc[-1] + half) for _, run in times]
