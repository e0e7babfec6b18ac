"""What is said of observations: the blocks of the summary, and the answer."""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from pl_mc.alert import Judged
from pl_mc.engine.stanford import HAZARDOUS, MISLEADING
from pl_mc.faults import Faults
from pl_mc.report.accuracy import DIRECTIONS, ERRORS, accuracy_m
from pl_mc.report.document import Block, Summary, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import method_key, metres, percent, rate_text
from pl_mc.studies.observe.claims import Claims, bounded, independent_epochs, multipliers
from pl_mc.studies.observe.record import ObserveExperiment
from pl_mc.studies.observe.stanford import sizes_m


def summary(
    experiment: ObserveExperiment, table: pd.DataFrame, faults: Faults, signals: Sequence[str],
    claims: Sequence[Claims], stanford: pd.DataFrame, coverage: pd.DataFrame,
) -> Summary:  # fmt: skip
    """The blocks of the summary; ``table`` is that of the epochs."""
    (judged,), first = experiment.judged(), table.drop_duplicates("epoch")
    count = first.satellites
    accuracy = []
    for method, group in table.groupby("method", sort=False):
        largest = group.loc[group.available, ERRORS].abs().max()
        for direction, lengths, most in zip(DIRECTIONS, accuracy_m(table, str(method)), largest, strict=True):
            accuracy.append([method, direction, *map(metres, (*lengths, most))])
    source = "by maps" if experiment.ionex else experiment.ionosphere
    strength = "" if experiment.snr_dbhz is None else f"at least {experiment.snr_dbhz:g} dB-Hz, "
    injected = f" Injected: {'; '.join(faults.labels[1:])}." if len(faults) > 1 else ""
    return (
        f"{len(first)} epochs from {first.time.iloc[0]} to {first.time.iloc[-1]} (GPS time), "
        f"{', '.join(signals)}, ionosphere {source}, mask {experiment.mask_deg:g} deg, {strength}"
        f"error model {experiment.error_model}, {count.min()}-{count.max()} satellites (mean {count.mean():.1f}). "
        f"Alert limit: {judged.alert.name}, {judged.limits(metres)}.{injected}",
        "Position errors over all available epochs [m]:",
        TextTable.of(["method", "direction", "95 %", "RMS", "largest"], accuracy),
        "Alarms and errors beyond the protection level, epochs and rates:",
        _alarms(table, judged),
        "Intervals are 95 % Clopper-Pearson bounds of the independent epochs that each row is worth by the "
        "autocorrelation of its errors over its levels, not of all its epochs; what lasts all day does not show in it.",
        *_claimed(experiment, claims, stanford, coverage),
        method_key(table.method.unique(), judged.axis),
    )


def answer(tables: Mapping[str, pd.DataFrame], experiment: ObserveExperiment) -> tuple[str, ...]:
    """Errors, alarms, errors beyond the level."""
    table, (judged,) = tables["epochs"], experiment.judged()
    alarms, outside = [], []
    errors: dict[str, list[str]] = {one.error: [] for one in judged.called}
    for name, group in table.groupby("method", sort=False):
        label, known = method_label(str(name), judged.axis), group[group.available]
        epochs = f"{len(known):,} of {len(group):,} epochs"
        for said, size_m in zip(errors.values(), sizes_m(known, judged), strict=True):
            rms, quantile = (np.sqrt((size_m**2).mean()), size_m.quantile(0.95)) if len(size_m) else (np.nan, np.nan)
            said.append(f"{label} {metres(rms)} m rms, {metres(quantile)} m 95 % in {epochs}")
        alarms.append(f"{label} in {_share(group.alarm, independent_epochs(group, judged))}")
        unnoticed = _beyond_level(known, judged) & ~known.alarm
        outside.append(f"{label} in {_share(unnoticed, independent_epochs(known, judged))}")
    beyond = " or ".join(errors)
    return (
        ". ".join(f"{error.capitalize()}s: {'; '.join(said)}" for error, said in errors.items()) + ".",
        f"Alarms: {'; '.join(alarms)} epochs.",
        f"{beyond.capitalize()} beyond the protection level without alarm: {'; '.join(outside)} epochs; "
        "bounds are those of the independent epochs that these are worth.",
    )


def _beyond_level(table: pd.DataFrame, judged: Judged) -> pd.Series:
    """Whether an error is beyond its level; of what is not available it is not."""
    levels = [table[f"{pl}_m"] for pl, _, _ in judged.levels]
    return _any(size_m > level for size_m, level in zip(sizes_m(table, judged), levels, strict=True))


def _beyond_limit(table: pd.DataFrame, judged: Judged) -> pd.Series:
    limits = [limit for _, _, limit in judged.levels]
    return _any(size_m > limit for size_m, limit in zip(sizes_m(table, judged), limits, strict=True))


def _any(flags: Iterable[pd.Series]) -> pd.Series:
    return functools.reduce(operator.or_, flags)


def _alarms(table: pd.DataFrame, judged: Judged) -> TextTable:
    rows = []
    for method, group in table.groupby("method", sort=False):
        for faulted, part in group.groupby("faulted"):
            beyond = _beyond_level(part, judged)
            events = (part.alarm, beyond, beyond & ~part.alarm, _beyond_limit(part, judged))
            label = "with injected fault" if faulted else "as observed"
            independent = independent_epochs(part, judged)
            shares = (f"{int(seen.sum())}: {_rate(seen, independent)}" for seen in events)
            cells = [method, label, len(part), f"{independent:.0f}", (~part.available).sum(), *shares]
            rows.append([*cells, metres(part.vpl_m.median()), metres(part.hpl_m.median())])
    letters = [name[0].replace("V", "U") for _, name, _ in judged.levels]
    level, limit = (
        " or ".join(f"{letter} beyond {words}" for letter, words in zip(letters, names, strict=True))
        for names in ([one.level for one in judged.called], [one.limit for one in judged.called])
    )
    header = [
        "method", "epochs", "number", "independent", "unavailable", "alarm", level, f"{level}, no alarm", limit,
        "median VPL [m]", "median HPL [m]",
    ]  # fmt: skip
    return TextTable.of(header, rows)


def _rate(seen: pd.Series, independent: float) -> str:
    """The rate of an event with bounds of so many independent epochs."""
    count, total = int(seen.sum()), len(seen)
    bounds = bounded(count, total, independent, "seen")
    return rate_text(count, total, bounds["seen_low"], bounds["seen_high"])


def _share(seen: pd.Series, independent: float) -> str:
    """``3 of 200 (1.5 % [0.2, 5.3])``, ``0 of 200 (< 1.5 %)``."""
    bounded_rate = _rate(seen, independent).removeprefix("0 (").removeprefix("all (").removesuffix(")")
    return f"{int(seen.sum())} of {len(seen):,} ({bounded_rate})" if len(seen) else "0 of 0"


def _claimed(
    experiment: ObserveExperiment, claims: Sequence[Claims], stanford: pd.DataFrame, coverage: pd.DataFrame
) -> list[Block | str]:
    """What is said of files with claims: whether their levels and their standard deviations hold."""
    if not claims:
        return []
    horizontal, vertical = multipliers(experiment.claim_multiplier)
    of_sigma = {one.fixes.of_sigma for one in claims if one.fixes.of_sigma}
    said: list[Block | str] = [
        "Claims beside the methods, epochs with an error beyond the level and no alarm, by axis:"
    ]
    counted = stanford[stanford.region.isin([MISLEADING, HAZARDOUS])]
    rows = []
    for (method, axis), part in counted.groupby(["method", "axis"], sort=False):
        count, epochs, independent = int(part["count"].sum()), int(part.epochs.iloc[0]), part.independent.iloc[0]
        bounds = bounded(count, epochs, independent, "seen")
        hazardous = int(part[part.region == HAZARDOUS]["count"].sum())
        rate = rate_text(count, epochs, bounds["seen_low"], bounds["seen_high"])
        rows.append([method, axis, epochs, f"{independent:.0f}", f"{count}: {rate}", hazardous])
    header = ["method", "axis", "epochs", "independent", "misleading", "of these beyond the limit"]
    said.append(TextTable.of(header, rows))
    if len(coverage):
        said.append(
            f"Standard deviations are no protection levels: here they are made such with {horizontal:g} horizontally "
            f"(times that along the longer axis of the ellipse) and {vertical:g} vertically. As what they say they "
            f"are, {'; '.join(sorted(of_sigma))}, they are judged by how many errors lie within the multiple that "
            "holds 68.3 % and 95 % of Gaussian ones (of two directions by Rayleigh, of one by the normal distribution):"
        )
        said.append(
            TextTable.of(
                ["method", "axis", "within", "expected", "epochs", "independent", "found"],
                [
                    [
                        row.method,
                        row.axis,
                        f"{row.multiplier:.3f} sigma",
                        f"{percent(row.expected)} %",
                        row.epochs,
                        f"{row.independent:.0f}",
                        rate_text(row.within, row.epochs, row.within_low, row.within_high),
                    ]
                    for row in coverage.itertuples()
                ],
            )
        )
    if experiment.faults:
        said.append("Injected faults are in the errors that the methods solve; claims are judged as they were made.")
    return said
