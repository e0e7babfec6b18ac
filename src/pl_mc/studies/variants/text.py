"""The summary of the variants of a robust estimate: what each is at its worst, and what its weights did."""

from __future__ import annotations

import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.text import markdown_table, rate_text

EVENTS = ("alarm", "missed", "misleading", "exceeded", "unavailable")
# Columns of counts that are not named as their event.
_COUNTS = {"alarm": "alarms"}


def worst_table(variants: pd.DataFrame) -> pd.DataFrame:
    """The largest rate of each event over the biases of a class, for each variant and geometry.

    The bounds are those of that bias alone: the largest of many rates is more often above its true value than
    below.

    Args:
        variants: ``group, variant, method, geometry, fault_class, bias_m, draws``, counts and rates.
    """
    rows = []
    keys = ["group", "variant", "method", "geometry", "fault_class"]
    for values, ramp in variants.groupby(keys, sort=False):
        for event in EVENTS:
            at = ramp.loc[ramp[f"{event}_rate"].idxmax()]
            row = dict(zip(keys, values, strict=True))
            row |= {"event": event, "bias_m": at.bias_m, "draws": at.draws, "count": at[_COUNTS.get(event, event)]}
            rows.append(row | {part: at[f"{event}_{part}"] for part in ("rate", "low", "high")})
    return pd.DataFrame(rows)


def variants_summary(
    title: str,
    *,
    variants: pd.DataFrame,
    worst: pd.DataFrame,
    swamping: pd.DataFrame,
    faults: pd.DataFrame,
    default: str,
    alert: AlertLimits,
    seed: int,
) -> str:
    """The summary in Markdown.

    Args:
        title: heading.
        variants, worst, swamping, faults: the tables of the experiment.
        default: the options of the variant that is called so.
        alert, seed: of the sweep.
    """
    lines = [
        f"# {title}",
        "",
        f"{int(variants.draws.iloc[0]):,} noise draws a bias, the same for every variant, seed {seed}; "
        f"{int(swamping.draws.iloc[0]):,} of them for the weights. {alert.name}, VAL {alert.vertical_m:g} m. 95 % "
        f"Clopper-Pearson bounds. The default: {default}.",
        "",
        *[_fault_line(faults[faults.geometry == geometry]) for geometry in dict.fromkeys(faults.geometry)],
        "",
        "## What is found",
        "",
        *_failures(worst, swamping),
        *_against_default(variants),
        "",
    ]
    if gates := _gate_table(variants):
        lines += [
            "## A chi-square gate on top of VPL_R",
            "",
            gates,
            "",
            "The gate rejects where its square sum exceeds the chi-square threshold of n - t degrees of freedom. "
            "That of the robust-weighted residuals, V_bar' P_bar V_bar, leaves out what is thrown out: where the "
            "estimate separates the fault it goes silent as the fault grows.",
            "",
        ]
    own = worst[(worst.variant == "default") & (worst.event == "misleading")].set_index("geometry")
    for name in list(dict.fromkeys(faults.fault_class))[-2:]:
        geometry = str(own.rate[own.fault_class == name].idxmax())
        lines += [f"## {name.capitalize()}, {geometry} geometry: the worst bias of the ramp", ""]
        lines += [_worst_cells(worst, swamping, geometry, name), ""]
    lines += [
        "An entry is the largest rate on the ramp, its interval and the bias it stands at; 0 (< x) is an upper "
        "bound. Of each class that geometry is shown in which the default misleads more; all biases, the other "
        "classes and the fault-free rates are in `variants.csv`, `worst.csv` and `swamping.csv`.",
    ]
    return "\n".join(lines) + "\n"


def _fault_line(faults: pd.DataFrame) -> str:
    parts = [
        f"{row.fault_class}: {row.satellites.replace(' ', ' and ')} (r {row.redundancy.replace(' ', ' and ')}, "
        f"{row.vertical_metres_per_metre:+.2f} m vertical per metre)"
        for row in faults.itertuples()
    ]
    geometry, epoch = str(faults.geometry.iloc[0]), int(faults.epoch.iloc[0])
    return f"- {geometry.capitalize()} geometry, epoch {epoch}: {'; '.join(parts)}."


def _place(row: pd.Series) -> str:
    return f"{row.geometry} geometry, {row.fault_class}, {row.bias_m:g} m"


def _failures(worst: pd.DataFrame, swamping: pd.DataFrame) -> list[str]:
    """Where each kind of failure is most frequent, for one faulted satellite and for two, the default beside."""
    misleading = worst[worst.event == "misleading"].rename(columns={"count": "misleading_count"})
    misleading = misleading.rename(columns={part: f"misleading_{part}" for part in ("rate", "low", "high")})
    lines = []
    for table, event, words in (
        (swamping, "undetermined", "Collapse to nothing (no determined solution)"),
        (swamping, "few_left", "Collapse to a perfect fit (at most t + 2 satellites with a weight above zero)"),
        (swamping, "swamped", "Swamping (a good satellite thrown out, a faulted one at full weight)"),
        (misleading, "misleading", "Misleading information"),
    ):
        for several, satellites in ((False, "one satellite"), (True, "two satellites")):
            here = table[(table.fault_class != "none") & ((table.fault_class == "double") == several)]
            top = here.loc[here.groupby(["group", "variant"], sort=False)[f"{event}_rate"].idxmax()]
            own = top[top.variant == "default"].iloc[0]
            others = top[(top.group != "") & (top[f"{event}_count"] > 0)]
            others = others.sort_values(f"{event}_rate", ascending=False, kind="stable").head(4)
            named = [f"{row.variant} {_cell(row, event)} ({_place(row)})" for _, row in others.iterrows()]
            where = f" ({_place(own)})" if own[f"{event}_count"] else " at any bias"
            lines.append(
                f"- {words}, {satellites}: default {_cell(own, event)}{where}; most with "
                f"{'; '.join(named) or 'no variant, none seen'}."
            )
    return lines


def _gate_table(variants: pd.DataFrame) -> str:
    """Alarms of the gated variants, ramp by ramp: the largest rate, and the biases without any."""
    gated = list(dict.fromkeys(variants.variant[variants.method.str.startswith("igg3_gated")]))
    if not gated:
        return ""
    rows = []
    for (geometry, name), here in variants.groupby(["geometry", "fault_class"], sort=False):
        cells = [f"{geometry}, {name}" if name != "none" else f"{geometry}, no fault"]
        for variant in ("default", *gated):
            ramp = here[here.variant == variant]
            at = ramp.loc[ramp.alarm_rate.idxmax()]
            told = rate_text(int(at.alarms), int(at.draws), at.alarm_low, at.alarm_high)
            quiet = ramp[ramp.alarms == 0]
            if at.alarms and len(ramp) > 1:
                told += f" at {at.bias_m:g} m"
                told += f"; none at {_ranges(ramp.bias_m, quiet.bias_m)} m" if len(quiet) else "; nowhere none"
            cells.append(told)
        rows.append(cells)
    return markdown_table(["most alarms on the ramp", "default", *gated], rows)


def _against_default(variants: pd.DataFrame) -> list[str]:
    """Variants whose alarm and misleading rates cannot be told from the default's anywhere."""
    keys = ["geometry", "fault_class", "bias_m"]
    own = variants[variants.variant == "default"].set_index(keys)
    alike = []
    for variant, rows in variants[variants.group != ""].groupby("variant", sort=False):
        mine = rows.set_index(keys).loc[own.index]
        apart = False
        for event in ("alarm", "misleading", "unavailable"):
            apart |= bool(
                (
                    (mine[f"{event}_low"] > own[f"{event}_high"]) | (mine[f"{event}_high"] < own[f"{event}_low"])
                ).any()
            )
        if not apart:
            alike.append(str(variant))
    if not alike:
        return ["- Every variant differs from the default at some bias by more than the intervals."]
    return [f"- Not to be told from the default at any bias (intervals overlap): {', '.join(alike)}."]


def _ranges(every: pd.Series, chosen: pd.Series) -> str:
    """``5, 25-100`` for biases that follow each other in a ramp."""
    order = list(every)
    places = [order.index(value) for value in chosen]
    spans: list[list[int]] = []
    for place in places:
        if spans and place == spans[-1][1] + 1:
            spans[-1][1] = place
        else:
            spans.append([place, place])
    return ", ".join(f"{order[a]:g}" if a == b else f"{order[a]:g}-{order[b]:g}" for a, b in spans)


def _cell(row: pd.Series, event: str) -> str:
    return rate_text(int(row[f"{event}_count"]), int(row.draws), row[f"{event}_low"], row[f"{event}_high"])


def _worst_cell(row: pd.Series) -> str:
    return rate_text(int(row["count"]), int(row.draws), row.low, row.high)


def _worst_cells(worst: pd.DataFrame, swamping: pd.DataFrame, geometry: str, name: str) -> str:
    shown = ("alarm", "missed", "misleading", "unavailable")
    here = worst[(worst.geometry == geometry) & (worst.fault_class == name)]
    weights = swamping[(swamping.geometry == geometry) & (swamping.fault_class == name)]
    rows = []
    for (group, variant), events in here.groupby(["group", "variant"], sort=False):
        by_event = events.set_index("event")
        cells = [str(group), str(variant)]
        for event in shown:
            row = by_event.loc[event]
            cells.append(_worst_cell(row) + (f" at {row.bias_m:g} m" if row["count"] else ""))
        mine = weights[(weights.group == group) & (weights.variant == variant)]
        if len(mine):
            at = mine.loc[mine.swamped_rate.idxmax()]
            cells.append(_cell(at, "swamped") + (f" at {at.bias_m:g} m" if at.swamped_count else ""))
        else:
            cells.append("-")
        rows.append(cells)
    return markdown_table(["group", "variant", *shown, "swamped"], rows)
