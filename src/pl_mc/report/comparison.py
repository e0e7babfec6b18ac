"""Two runs side by side: which fields differ, and the difference of every rate that both counted, with an interval.

Differences are second minus first. Where both runs saw the same noise and stored their counts epoch by epoch, the
interval is that of the differences of the epochs; else only two counts are known, and it is Newcombe's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype
from scipy import special

from pl_mc.alert import VERTICAL
from pl_mc.engine.checkpoint_store import BadPart, read_rows
from pl_mc.input_errors import InputError
from pl_mc.kernels.events import EVENTS, EXCLUSIONS
from pl_mc.report.document import Block, Bullets, Paragraph, TextTable
from pl_mc.report.files import to_markdown
from pl_mc.report.run_folder import RunFolder, changed_fields
from pl_mc.report.text import percent
from pl_mc.statistics.intervals import difference_bounds

CONFIDENCE = 0.95

# Below this number of epochs the mean of their differences is not taken as normal.
FEWEST_EPOCHS = 30

PAIRED, NEWCOMBE = "paired by epoch", "two proportions"

_KEYS = (
    "method", "axis", "test", "reading", "level", "noise", "variant", "geometry", "fault_class", "event", "region",
    "satellite", "fault", "epoch", "bias_m",
)  # fmt: skip
_EVENTS = (*EVENTS, *EXCLUSIONS)
_COUNTS = {event.count: event.name for event in _EVENTS} | {"detections": "detection", "count": ""}
_TOTALS = ("draws", "scenarios", "epochs")
_SHOWN = 12


@dataclass(frozen=True)
class Comparison:
    """What two runs have in common and what not.

    Attributes:
        names: what the two are called, different from each other.
        fields: ``field, first, second`` of every field that differs, as text.
        rates: one row for each rate that both counted: ``table``, keys of the row, ``event``, counts, draws and
            rates of both, ``difference, low, high``, ``interval`` (how it was found) and ``differs``.
        same_noise: whether both runs drew the same noise for the same satellites.
        notes: sentences about what could not be compared, and about the intervals.
    """

    names: tuple[str, str]
    fields: pd.DataFrame
    rates: pd.DataFrame
    same_noise: bool
    notes: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """How many rates differ, in a sentence or two."""
        number, differ = len(self.rates), int(self.rates.differs.sum()) if len(self.rates) else 0
        if number == 0:
            return "The two runs have no counted rate in common."
        chance = (1 - CONFIDENCE) * number
        return (
            f"{differ:,} of {number:,} rates differ: their {100 * CONFIDENCE:.0f} % interval leaves 0 out. By "
            f"chance alone, were they equal and independent, at most about {chance:.0f} would."
        )

    @property
    def text(self) -> str:
        """A screen of text in Markdown: what was asked differently, the verdict, the largest differences."""
        first, second = self.names
        asked: Block = Paragraph("The two experiments are the same in every field.")
        if len(self.fields):
            asked = TextTable.of(["field", first, second], self.fields.itertuples(index=False))
        blocks = [asked, Paragraph(self.verdict)]
        if len(self.rates) and self.rates.differs.any():
            largest = self.rates[self.rates.differs]
            largest = largest.loc[largest.difference.abs().sort_values(ascending=False, kind="stable").index]
            rows = [
                (row_name(row), row["event"], f"{percent(row['first_rate'])} %", f"{percent(row['second_rate'])} %",
                 difference_text(row))
                for row in largest.head(_SHOWN).to_dict("records")
            ]  # fmt: skip
            all_rows = f"all: {len(self.rates):,} rows of compare.csv"
            blocks += [
                Paragraph(f"The largest of them, in points of per cent ({all_rows}):"),
                TextTable.of(["row", "event", first, second, "difference"], rows),
            ]
        return to_markdown(f"{second} against {first}", [*blocks, Bullets(self.notes)]).rstrip()


def compare_runs(first: RunFolder, second: RunFolder) -> Comparison:
    """Compare two runs.

    Raises:
        InputError: runs of different kinds, which count different things.
    """
    if first.kind != second.kind:
        raise InputError(
            f"{second.folder}: it is of the kind {second.kind} and {first.folder} of the kind {first.kind}; only "
            "runs of one kind can be compared."
        )
    names = _names(first, second)
    same = _same_noise(first, second)
    notes: list[str] = []
    both = [name for name in first.tables if name in second.tables]
    parts = [_rates(name, first.tables[name], second.tables[name], notes) for name in both]
    counted = [part for part in parts if part is not None]
    rates = pd.concat(counted, ignore_index=True) if counted else pd.DataFrame()
    if same and len(rates):
        try:
            by_epoch = _by_epoch(first.folder, second.folder)
        except BadPart as bad:
            notes.append(f"{bad}; the counts of epochs are left out.")
        else:
            rates = rates if by_epoch is None else _with_paired_bounds(rates, by_epoch)
        notes.append(_noise_note(int((rates["interval"] == PAIRED).sum()), len(rates)))
    elif len(rates):
        notes.append(
            "The noise of the two runs is not the same draw for draw; intervals are those of the difference of two "
            "independent proportions (Newcombe's hybrid score)."
        )
    if len(rates):
        rates["differs"] = (rates["low"] > 0) | (rates["high"] < 0)
    return Comparison(names, _fields(first, second), rates, same, tuple(notes))


def row_name(row: Mapping[str, Any]) -> str:
    """The keys of a row in one text."""
    parts = [row[key] for key in _KEYS if key not in ("bias_m", "event", "epoch") and _given(row.get(key))]
    if _given(row.get("epoch")):
        parts.append(f"epoch {int(row['epoch'])}")
    # A fault's label says its size.
    if not _given(row.get("fault")) and _given(row.get("bias_m")):
        parts.append(f"{row['bias_m']:g} m")
    return ", ".join(str(part) for part in parts)


def difference_text(row: Mapping[str, Any]) -> str:
    """``+12.3 [11.9, 12.7]``, in points of per cent."""
    value, low, high = (100.0 * row[column] for column in ("difference", "low", "high"))
    return f"{value:+.3g} [{low:+.3g}, {high:+.3g}]"


def _given(value: Any) -> bool:
    return value is not None and value == value and value != ""


def _names(first: RunFolder, second: RunFolder) -> tuple[str, str]:
    """What the two are called: the first of their names that are not the same."""
    old, new = (
        (run.name, run.folder.absolute().name, run.folder.as_posix(), f"{run.name}, {place}")
        for run, place in ((first, "first"), (second, "second"))
    )
    return next(names for names in zip(old, new, strict=True) if names[0] != names[1])


def _fields(first: RunFolder, second: RunFolder) -> pd.DataFrame:
    old, new = (dict(run.manifest.get("versions", {})) for run in (first, second))
    rows = changed_fields(first.experiment, second.experiment)
    rows += [
        (f"version of {name}", str(old.get(name, "none")), str(new.get(name, "none")))
        for name in old | new
        if old.get(name) != new.get(name)
    ]
    return pd.DataFrame(rows, columns=["field", "first", "second"])


def _same_noise(first: RunFolder, second: RunFolder) -> bool:
    """Whether everything that decides the noise of a scenario is the same; methods, faults and limits do not."""
    old, new = first.experiment, second.experiment
    parts = ("seed", "precision", "draws", "geometry", "source", "noise", "noises", "noise_scale")
    manifests = first.manifest.get("noise") == second.manifest.get("noise")
    return manifests and "seed" in old and all(old.get(part) == new.get(part) for part in parts)


def _rates(name: str, first: pd.DataFrame, second: pd.DataFrame, notes: list[str]) -> pd.DataFrame | None:
    """The rates of one table, in rows that both runs have; None where it holds no counts."""
    total = next((column for column in _TOTALS if column in first and column in second), None)
    counts = [column for column in _COUNTS if column in first and column in second]
    if "axis" in first or "axis" in second:
        first, second = _with_axis(first), _with_axis(second)
    keys = [key for key in _KEYS if key in first and key in second]
    if total is None or not counts or not keys or ("detections" in counts and "test" not in keys):
        return None
    for column in (total, *counts, *keys):
        if is_numeric_dtype(first[column]) != is_numeric_dtype(second[column]):
            raise InputError(f"{name}.csv: {column}: it holds numbers in one of the runs and words in the other.")
    for side, table in (("first", first), ("second", second)):
        _require_counts(f"{name}.csv of the {side} run", table, total, counts)
    # Sizes may be whole numbers in one of them alone.
    mixed = {key: float for key in keys if first[key].dtype != second[key].dtype and is_numeric_dtype(first[key])}
    first, second = first.astype(mixed), second.astype(mixed)
    second = _renamed(first, second, notes)
    if first.duplicated(keys).any() or second.duplicated(keys).any():
        return None
    both = first.merge(second, on=keys, suffixes=(" first", " second"))
    for side, table in (("first", first), ("second", second)):
        if len(table) > len(both):
            notes.append(f"{name}: {len(table) - len(both):,} rows of the {side} run have no counterpart in the other.")
    if both.empty:
        return None
    parts = []
    for count in counts:
        part = both[keys].copy()
        part.insert(0, "table", name)
        if "event" not in part:
            part["event"] = _COUNTS[count]
        independent = []
        for side in ("first", "second"):
            events, draws = both[f"{count} {side}"].astype(float), both[f"{total} {side}"].astype(float)
            rate = events / draws
            part[f"{side}_count"], part[f"{side}_draws"] = events.round().astype(int), draws.astype(int)
            part[f"{side}_rate"] = rate
            # Faults that shared their noise count each draw once.
            if f"independent_draws {side}" in both:
                draws = both[f"independent_draws {side}"].astype(float)
                events = rate * draws
            independent.append((events, draws))
        (old, old_draws), (new, new_draws) = independent
        low, high = difference_bounds(old, old_draws, new, new_draws, CONFIDENCE)
        part["difference"] = part.second_rate - part.first_rate
        parts.append(part.assign(low=low, high=high, interval=NEWCOMBE))
    return pd.concat(parts, ignore_index=True)


def _require_counts(where: str, table: pd.DataFrame, total: str, counts: Sequence[str]) -> None:
    """Raise `InputError` for a row whose counts are no whole numbers of its total, as somebody may have made them."""
    total_of_row = pd.to_numeric(table[total], errors="coerce").to_numpy(float)
    most = np.where(total_of_row < 2.0**53, total_of_row, np.nan)
    for column in (total, *counts, *({"independent_draws"} & set(table))):
        values = pd.to_numeric(table[column], errors="coerce").to_numpy(float)
        for row in np.flatnonzero(~((values >= 0) & (values <= most) & (values == np.floor(values)))):
            raise InputError(
                f"{where}: row {row + 1}: {column} {str(table[column].iloc[row])[:40]} is no count, which is a whole "
                f"number from 0 to the {total} of the row."
            )


def _renamed(first: pd.DataFrame, second: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Methods with other options are laid beside the method of the same name, one for one, in their order."""
    if "method" not in first or "variant" in first:
        return second
    old, new = list(dict.fromkeys(first["method"])), list(dict.fromkeys(second["method"]))
    alone = [name for name in new if name not in old]
    left = [name for name in old if name not in new]
    pairs: dict[str, str] = {}
    for name in alone:
        partner = next((other for other in left if other.split("(")[0] == name.split("(")[0]), None)
        if partner is not None:
            left.remove(partner)
            pairs[name] = partner
            note = f"{name} of the second run stands beside {partner} of the first."
            notes += [note] if note not in notes else []
    return second.assign(method=second["method"].replace(pairs))


def _by_epoch(first: Path, second: Path) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Counts of every epoch, method and fault of both runs, where both stored them."""
    tables = []
    for folder in (first / "epochs", second / "epochs"):
        if not folder.is_dir():
            return None
        keys = ["epoch", "method", "axis", "fault"]
        parts = list(read_rows(folder))
        rows = _with_axis(pd.concat(parts)) if parts else pd.DataFrame()
        if not {*keys, "draws"} <= set(rows):
            return None
        rows = rows.astype({"method": str, "axis": str, "fault": str})
        counts = [event.count for event in _EVENTS if event.count in rows]
        tables.append(rows.groupby(keys, sort=False)[["draws", *counts]].sum().reset_index())
    return tables[0], tables[1]


def _with_axis(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its axis; where it names none that is the vertical."""
    return table if "axis" in table else table.assign(axis=VERTICAL)


def _with_paired_bounds(rates: pd.DataFrame, by_epoch: tuple[pd.DataFrame, pd.DataFrame]) -> pd.DataFrame:
    """Rates with the bounds of the mean difference of the epochs, where there are enough of them.

    The differences of epochs are independent, since epochs have noise of their own, but their means differ; their
    scatter is therefore no smaller than that of the mean, and the bounds are wide enough.
    """
    first, second = by_epoch
    second = _renamed(first, second, [])
    both = first.merge(second, on=["epoch", "method", "axis", "fault"], suffixes=(" first", " second"))
    bounds: dict[int, tuple[float, float, str]] = {}
    count_of = {event.name: event.count for event in _EVENTS}
    groups = dict(list(both.groupby(["method", "axis", "fault"], sort=False)))
    for k, row in enumerate(rates.to_dict("records")):
        key = (row.get("method"), row.get("axis", VERTICAL), row.get("fault"))
        group, count = groups.get(key), count_of.get(row["event"])
        if row["table"] != "rates" or group is None or count is None or len(group) < FEWEST_EPOCHS:
            continue
        old, new = (group[f"{count} {side}"] / group[f"draws {side}"] for side in ("first", "second"))
        difference = new - old
        scatter = float(difference.std(ddof=1))
        # Epochs that all agree say nothing about how rarely they would not.
        if not scatter > 0 or not np.isclose(difference.mean(), row["difference"], atol=1e-12):
            continue
        half = float(special.stdtrit(len(group) - 1, 0.5 + CONFIDENCE / 2)) * scatter / np.sqrt(len(group))
        bounds[k] = row["difference"] - half, row["difference"] + half, PAIRED
    found = pd.DataFrame.from_dict(bounds, orient="index", columns=["low", "high", "interval"])
    return rates.assign(**{column: found[column].reindex(rates.index).fillna(rates[column]) for column in found})


def _noise_note(paired: int, number: int) -> str:
    rest = (
        "two counts are known and not which draws agree, so that a paired interval is not to be had: theirs is "
        "that of the difference of two independent proportions (Newcombe's hybrid score), which is too wide where "
        "the runs' events go together, as they mostly do"
    )
    same = "Both runs saw the same noise"
    if paired == 0:
        return f"{same}, but of each rate only {rest}."
    start = f"{same}: {paired:,} of {number:,} intervals are those of the paired differences of epochs"
    return f"{start}." if paired == number else f"{start}; of the others only {rest}."


def combined_tables(first: RunFolder, second: RunFolder, names: Sequence[str]) -> dict[str, pd.DataFrame]:
    """Tables of both runs under each other, the run's name in that of the method or test, to be drawn together."""
    tables = {}
    for name, old in first.tables.items():
        column = next((column for column in ("variant", "method", "test") if column in old), None)
        if column is None or name not in second.tables or list(second.tables[name]) != list(old):
            continue
        parts = [
            table.assign(**{column: table[column].astype(str) + f" ({label})"})
            for table, label in zip((old, second.tables[name]), names, strict=True)
        ]
        tables[name] = pd.concat(parts, ignore_index=True)
    return tables
