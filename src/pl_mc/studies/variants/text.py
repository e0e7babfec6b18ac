"""What the variants of a robust estimate say: what each is at its worst, and what its weights did."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from pl_mc.kernels.events import EVENTS
from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.text import event_text
from pl_mc.studies.variants.record import DEFAULT, VariantsExperiment

NONE, DOUBLE = "none", "double"
_KNOWN = {"ls": "least squares", DEFAULT: "default IGG-III"}

# What the table of the worst rates has, and what of it the summary shows.
_WORST = ("alarm", "missed", "misleading", "exceeded", "unavailable")
_SHOWN = ("alarm", "missed", "misleading", "unavailable")


def worst_table(variants: pd.DataFrame) -> pd.DataFrame:
    """The largest rate of each event over the biases of a class, for each variant and geometry.

    The bounds are those of that bias alone: the largest of many rates is more often above its true value than
    below.

    Args:
        variants: ``group, variant, method, geometry, fault_class, bias_m, draws``, counts and rates.
    """
    keys = ["group", "variant", "method", "geometry", "fault_class"]
    counts = {event.name: event.count for event in EVENTS}
    rows = []
    for values, ramp in variants.groupby(keys, sort=False):
        for event in _WORST:
            at = _worst(ramp, event)
            row = dict(zip(keys, values, strict=True))
            row |= {"event": event, "bias_m": at.bias_m, "draws": at.draws, "count": at[counts[event]]}
            rows.append(row | {part: at[f"{event}_{part}"] for part in ("rate", "low", "high")})
    return pd.DataFrame(rows)


def answer(tables: Mapping[str, pd.DataFrame], experiment: VariantsExperiment) -> tuple[str, ...]:
    """The default, least squares and the extremes at the worst bias of one or two satellites."""
    table = tables["variants"]
    faulted = table[table.fault_class != NONE]
    sentences = []
    for event in ("misleading", "missed", "alarm"):
        rate = f"{event}_rate"
        worst = faulted.loc[faulted.groupby("variant", sort=False)[rate].idxmax()].set_index("variant")
        known = {name: words for name, words in _KNOWN.items() if name in worst.index}
        parts = [f"{words} {_at(worst.loc[name], event)}" for name, words in known.items()]
        others = worst.drop(index=list(known))
        if len(others):
            most, least = others[rate].idxmax(), others[rate].idxmin()
            parts.append(f"most of the others {most} with {_at(others.loc[most], event)}")
            parts.append(f"least {least} with {_at(others.loc[least], event)}")
        means = experiment.decides.means(event)
        sentences.append(f"{means}, at the worst bias of any fault: {'; '.join(parts)}.")
    return tuple(sentences)


def summary(
    experiment: VariantsExperiment,
    variants: pd.DataFrame,
    swamping: pd.DataFrame,
    faults: pd.DataFrame,
    *,
    default: str,
) -> tuple[Block, ...]:
    """The blocks of the summary.

    Args:
        experiment: the record.
        variants, swamping, faults: the tables of the experiment.
        default: the options of the variant that is called so.
    """
    judged = experiment.decides
    blocks: list[Block] = [
        Paragraph(
            f"{int(variants.draws.iloc[0]):,} noise draws a bias, the same for every variant, seed "
            f"{experiment.seed}; {int(swamping.draws.iloc[0]):,} of them for the weights. {judged.alert.name}, "
            f"{judged.limits()}. 95 % Clopper-Pearson bounds. The default: {default}."
        ),
        Bullets(tuple(_fault_line(part) for _, part in faults.groupby("geometry", sort=False))),
        Heading("What is found"),
        Bullets((*_failures(variants, swamping), _against_default(variants))),
    ]
    gated = list(dict.fromkeys(variants.variant[variants.method.str.startswith("igg3_gated")]))
    if gated:
        blocks += [
            Heading(f"A chi-square gate on top of {judged.called[0].level}_R"),
            _gate_table(variants, gated),
            Paragraph(
                "The gate rejects where its square sum exceeds the chi-square threshold of n - t degrees of "
                "freedom. That of the robust-weighted residuals, V_bar' P_bar V_bar, leaves out what is thrown "
                "out: where the estimate separates the fault it goes silent as the fault grows."
            ),
        ]
    own = variants[variants.variant == DEFAULT]
    for name in list(dict.fromkeys(faults.fault_class))[-2:]:
        geometry = _worst(own[own.fault_class == name], "misleading").geometry
        here = (table[(table.geometry == geometry) & (table.fault_class == name)] for table in (variants, swamping))
        blocks += [
            Heading(f"{name.capitalize()}, {geometry} geometry: the worst bias of the ramp"),
            _worst_cells(*here),
        ]
    blocks.append(
        Paragraph(
            "An entry is the largest rate on the ramp, its interval and the bias it stands at; 0 (< x) is an upper "
            "bound. Of each class that geometry is shown in which the default misleads more; all biases, the other "
            "classes and the fault-free rates are in `variants.csv`, `worst.csv` and `swamping.csv`."
        )
    )
    return tuple(blocks)


def _worst(ramp: pd.DataFrame, event: str) -> pd.Series:
    """The first row with the largest rate."""
    return ramp.loc[ramp[f"{event}_rate"].idxmax()]


def _place(row: pd.Series) -> str:
    return f"({row.geometry} geometry, {row.fault_class}, {row.bias_m:g} m)"


def _at(row: pd.Series, event: str) -> str:
    return f"{event_text(row, event)} {_place(row) if row[f'{event}_rate'] else 'at any'}"


def _fault_line(faults: pd.DataFrame) -> str:
    parts = [
        f"{row.fault_class}: {row.satellites.replace(' ', ' and ')} (r {row.redundancy.replace(' ', ' and ')}, "
        f"{_per_metre(row)} per metre)"
        for row in faults.itertuples()
    ]
    geometry, epoch = str(faults.geometry.iloc[0]), int(faults.epoch.iloc[0])
    return f"{geometry.capitalize()} geometry, epoch {epoch}: {'; '.join(parts)}."


def _per_metre(row: Any) -> str:
    sideways = getattr(row, "horizontal_metres_per_metre", None)
    return f"{row.vertical_metres_per_metre:+.2f} m vertical" if sideways is None else f"{sideways:.2f} m horizontal"


def _failures(variants: pd.DataFrame, swamping: pd.DataFrame) -> list[str]:
    """Where each kind of failure is most frequent, for one faulted satellite and for two, the default beside."""
    lines = []
    for table, event, words in (
        (swamping, "undetermined", "Collapse to nothing (no determined solution)"),
        (swamping, "few_left", "Collapse to a perfect fit (at most t + 2 satellites with a weight above zero)"),
        (swamping, "swamped", "Swamping (a good satellite thrown out, a faulted one at full weight)"),
        (variants, "misleading", "Misleading information"),
    ):
        rate = f"{event}_rate"
        for several, satellites in ((False, "one satellite"), (True, "two satellites")):
            here = table[(table.fault_class != NONE) & ((table.fault_class == DOUBLE) == several)]
            top = here.loc[here.groupby(["group", "variant"], sort=False)[rate].idxmax()]
            own = top[top.variant == DEFAULT].iloc[0]
            others = top[(top.group != "") & (top[rate] > 0)].sort_values(rate, ascending=False, kind="stable")
            named = [f"{row.variant} {_at(row, event)}" for _, row in others.head(4).iterrows()]
            lines.append(
                f"{words}, {satellites}: default {_at(own, event)}{'' if own[rate] else ' bias'}; most with "
                f"{'; '.join(named) or 'no variant, none seen'}."
            )
    return lines


def _against_default(variants: pd.DataFrame) -> str:
    """Variants whose alarm and misleading rates cannot be told from the default's anywhere."""
    keys = ["geometry", "fault_class", "bias_m"]
    own = variants[variants.variant == DEFAULT].set_index(keys)
    alike = []
    for variant, rows in variants[variants.group != ""].groupby("variant", sort=False):
        rows = rows.set_index(keys).loc[own.index]
        if not any(
            ((rows[f"{event}_low"] > own[f"{event}_high"]) | (rows[f"{event}_high"] < own[f"{event}_low"])).any()
            for event in ("alarm", "misleading", "unavailable")
        ):
            alike.append(str(variant))
    if not alike:
        return "Every variant differs from the default at some bias by more than the intervals."
    return f"Not to be told from the default at any bias (intervals overlap): {', '.join(alike)}."


def _gate_table(variants: pd.DataFrame, gated: list[str]) -> TextTable:
    """Alarms of the gated variants, ramp by ramp: the largest rate, and the biases without any."""
    rows = []
    for (geometry, name), here in variants.groupby(["geometry", "fault_class"], sort=False):
        cells = [f"{geometry}, {name}" if name != NONE else f"{geometry}, no fault"]
        for variant in (DEFAULT, *gated):
            ramp = here[here.variant == variant]
            at = _worst(ramp, "alarm")
            cell = event_text(at, "alarm")
            if at.alarms and len(ramp) > 1:
                quiet = ramp.alarms == 0
                cell += f" at {at.bias_m:g} m"
                cell += f"; none at {_ranges(ramp.bias_m, quiet)} m" if quiet.any() else "; nowhere none"
            cells.append(cell)
        rows.append(cells)
    return TextTable.of(["most alarms on the ramp", DEFAULT, *gated], rows)


def _ranges(biases_m: pd.Series, chosen: pd.Series) -> str:
    """``5, 25-100`` for the chosen biases of a ramp."""
    run = (chosen != chosen.shift()).cumsum()
    spans = [(part.iloc[0], part.iloc[-1]) for _, part in biases_m[chosen].groupby(run[chosen])]
    return ", ".join(f"{first:g}" if first == last else f"{first:g}-{last:g}" for first, last in spans)


def _worst_cells(variants: pd.DataFrame, swamping: pd.DataFrame) -> TextTable:
    """Each variant at its worst bias of one class of faults at one geometry, event by event."""
    rows = []
    for (group, variant), ramp in variants.groupby(["group", "variant"], sort=False):
        weights = swamping[(swamping.group == group) & (swamping.variant == variant)]
        worst = [(event, _worst(ramp, event)) for event in _SHOWN]
        worst += [("swamped", _worst(weights, "swamped"))] if len(weights) else []
        cells = [
            event_text(row, event) + (f" at {row.bias_m:g} m" if row[f"{event}_rate"] else "") for event, row in worst
        ]
        rows.append([group, variant, *cells, *([] if len(weights) else ["-"])])
    return TextTable.of(["group", "variant", *_SHOWN, "swamped"], rows)
