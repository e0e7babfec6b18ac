"""What runs that count events say in three sentences: one about alarms, one about misleading, one about missed."""

from __future__ import annotations

from typing import Any

import pandas as pd

from pl_mc.report.figures import method_label
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import event_text, percent, rate_text

_MEANS = {
    "alarm": "Alarms",
    "misleading": "Misleading information (vertical error beyond the protection level, no alarm)",
    "missed": "Missed detections (vertical error beyond the alert limit of {val:g} m, no alarm)",
}


def sweep_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a sweep: at which fault each event is most frequent, method by method."""
    return event_sentences(run, run.tables["rates"])


def satellite_ramps_answer(run: RunFolder) -> tuple[str, ...]:
    """Of ramps on every satellite: the faults at which each event is most frequent."""
    return event_sentences(run, run.tables["ramp_satellites"])


def map_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a map: the bias at which each event is most frequent, over all satellites and epochs."""
    table = run.tables["by_bias"].assign(fault=lambda t: t.bias_m.map("{:g} m on any satellite".format))
    return event_sentences(run, table)


def event_sentences(run: RunFolder, table: pd.DataFrame) -> tuple[str, ...]:
    """A sentence for each event of a table with one row per method and fault."""
    sentences = []
    for event, means in _MEANS.items():
        # Methods of which the same is to be said share one clause.
        said: dict[str, list[str]] = {}
        for name, group in table.groupby("method", sort=False):
            said.setdefault(_most(group, event), []).append(method_label(str(name)))
        clauses = "; ".join(f"{_listed(names)} {what}" for what, names in said.items())
        sentences.append(f"{means.format(val=run.alert.vertical_m)}: {clauses}.")
    return tuple(sentences)


def variants_answer(run: RunFolder) -> tuple[str, ...]:
    """Of variants: the default, least squares and the extremes at the worst bias of one or two satellites."""
    table = run.tables["variants"]
    faulted = table[table.fault_class != "none"]
    sentences = []
    for event in ("misleading", "missed", "alarm"):
        worst = faulted.loc[faulted.groupby("variant", sort=False)[f"{event}_rate"].idxmax()].set_index("variant")
        known = [name for name in ("ls", "default") if name in worst.index]
        parts = [f"{_variant(name)} {_at(worst.loc[name], event)}" for name in known]
        others = worst.drop(index=known)
        if len(others):
            for what, name in (
                ("most of the others", others[f"{event}_rate"].idxmax()),
                ("least", others[f"{event}_rate"].idxmin()),
            ):
                parts.append(f"{what} {name} with {_at(others.loc[name], event)}")
        means = _MEANS[event].format(val=run.alert.vertical_m)
        sentences.append(f"{means}, at the worst bias of any fault: {'; '.join(parts)}.")
    return tuple(sentences)


def noise_answer(run: RunFolder) -> tuple[str, ...]:
    """Of noise models: each event under Gaussian noise and under the model that makes it most frequent."""
    table = run.tables["rates"]
    sentences = []
    for event, means in _MEANS.items():
        clauses = []
        for name, group in table.groupby("method", sort=False):
            parts = []
            for what, part in (
                ("gaussian", group[group.noise == "gaussian"]),
                ("", group[group.noise != "gaussian"]),
            ):
                if part.empty:
                    continue
                row = part.loc[part[f"{event}_rate"].idxmax()]
                under = what or (f"{row.noise}, the most" if row[f"{event}_rate"] > 0 else "any other model")
                at = f" at {row.fault}" if row[f"{event}_rate"] > 0 else ""
                parts.append(f"{event_text(row, event)}{at} with {under}")
            clauses.append(f"{method_label(str(name))} {', '.join(parts)}")
        sentences.append(f"{means.format(val=run.alert.vertical_m)}, at the worst fault: {'; '.join(clauses)}.")
    return tuple(sentences)


def compare_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a comparison of methods: the two of the first paper, the worst, and those with no event at any bias."""
    table = run.tables["rates"]
    sentences = []
    for event, means in _MEANS.items():
        worst = table.loc[table.groupby("method", sort=False)[f"{event}_rate"].idxmax()].set_index("method")
        never = worst.index[worst[f"{event}_rate"] == 0]
        told = [name for name in ("ls", "igg3") if name in worst.index]
        seen = worst.drop(index=[*told, *never])
        parts = [f"{method_label(name)} {event_text(worst.loc[name], event)}" for name in told]
        if len(seen):
            name = str(seen[f"{event}_rate"].idxmax())
            parts.append(f"the most of the others {method_label(name)}, {event_text(seen.loc[name], event)}")
        parts.append(f"none with {len(never)} of {len(worst)} methods")
        sentences.append(f"{means.format(val=run.alert.vertical_m)}, at each one's worst bias: {'; '.join(parts)}.")
    return tuple(sentences)


def stanford_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a Stanford diagram: how often misleading, hazardously misleading and unavailable."""
    regions = run.tables["regions"]
    sentences = []
    for region, means in (
        (
            "misleading",
            "The vertical error is beyond the protection level but within the alert limit, without alarm",
        ),
        ("hazardously misleading", "It is beyond the alert limit without alarm (hazardously misleading)"),
        ("system unavailable", "The protection level is above the alert limit (an alarm)"),
    ):
        parts = [
            f"{method_label(str(row.method))} in {_region_rate(row)}"
            for row in regions[regions.region == region].itertuples()
        ]
        sentences.append(f"{means}: {'; '.join(parts)} of all scenarios.")
    return tuple(sentences)


def _most(group: pd.DataFrame, event: str) -> str:
    rate = group[f"{event}_rate"]
    if not rate.max() > 0:
        # Faults that share their noise have fewer independent draws than draws.
        draws = group["independent_draws" if "independent_draws" in group else "draws"]
        faults = f"any of {len(group)} faults" if len(group) > 1 else "the one fault"
        return (
            f"never, under {faults}, with at least {int(draws.min()):,} draws of noise each "
            f"(below {percent(group[f'{event}_high'].max())} %)"
        )
    return f"most often at {group.loc[rate.idxmax(), 'fault']}, {event_text(group.loc[rate.idxmax()], event)}"


def _at(row: pd.Series, event: str) -> str:
    text = event_text(row, event)
    if row[f"{event}_rate"] == 0:
        return f"{text} at any"
    return f"{text} ({row.geometry} geometry, {row.fault_class}, {row.bias_m:g} m)"


def _variant(name: str) -> str:
    return {"ls": "least squares", "default": "default IGG-III"}[name]


def _region_rate(row: Any) -> str:
    # itertuples gives "count" as a method of the tuple.
    return rate_text(int(row[3]), int(row.scenarios), row.low, row.high)


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
