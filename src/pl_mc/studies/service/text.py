"""The summary and the three sentences of a service volume."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pandas as pd

from pl_mc.noise_models import GAUSSIAN
from pl_mc.report.figures import method_label
from pl_mc.report.run_folder import RunFolder
from pl_mc.report.text import markdown_table, percent
from pl_mc.service.counting import COVERED

if TYPE_CHECKING:
    from pl_mc.service.volume import ServiceVolume

# Sites of a list in the summary; the file holds more.
_LISTED = 5


def service_summary(experiment: Any, found: ServiceVolume, worst: pd.DataFrame) -> str:
    """Rates over the world by operation and method, continuity, and the worst sites.

    Args:
        experiment: the experiment's record.
        found: the service volume.
        worst: ``worst_sites`` of it.
    """
    epochs, sites = len(found.time_gps_s), len(found.grid)
    noisy = [name for name in found.methods if name not in found.exact]
    scenarios = f"{epochs * sites * found.draws:,} scenarios for {', '.join(noisy)}" if noisy else ""
    exact = f"one for each geometry for {', '.join(found.exact)}" if found.exact else ""
    law = "" if found.noise == GAUSSIAN.name else f", noise {found.noise}"
    off = f", without {', '.join(experiment.without)}" if experiment.without else ""
    rows = [
        [_limits(found, row.operation), method_label(row.method), _part(row, "availability"), _coverage(row),
         _place(row.worst_latitude_deg, row.worst_longitude_deg) + f": {percent(row.worst_rate)} %"
         if row.worst_rate < 1.0 else "-"]
        for row in found.world.sort_values("operation", key=lambda names: names.map(_order(found)), kind="stable")
        .itertuples()
    ]  # fmt: skip
    labels = durations_of(found.world)
    continuity = [
        [
            row.operation,
            method_label(row.method),
            *(_lost(row, label) for label in labels),
            *(_lost_count(row, label) for label in labels[-1:]),
        ]
        for row in found.world.sort_values(
            "operation", key=lambda names: names.map(_order(found)), kind="stable"
        ).itertuples()
    ]
    bounds = "Bounds are those of the draws (95 %)" if noisy else ""
    if found.exact:
        bounds += "; for " if noisy else "For "
        bounds += (
            f"{', '.join(found.exact)} bounds of the availability are those of the moments within a step at which "
            "service may change, and continuity has none"
        )
    few, mean = found.satellites.satellites_min, found.satellites.satellites_mean
    lines = [
        f"# {experiment.title}",
        "",
        f"{sites:,} users in cells of {found.grid.step_deg:g} deg, {epochs} epochs of {found.step_s:g} s from "
        f"{experiment.start}; {', '.join(experiment.constellations)}{off}, {experiment.mask_deg:g} deg mask, error "
        f"model {experiment.error_model}{law}, seed {found.seed}: {'; '.join(filter(None, (scenarios, exact)))}. "
        f"Satellites in view: {few.min()} at least, {(found.grid.weight * mean).sum():.1f} on average.",
        "",
        "Availability: share of area and time in which VPL and HPL are within the limits, weighted with area; "
        f"coverage: share of the area whose sites have {100 * COVERED:g} % or more. {bounds}; that users stand on "
        "a grid is in none of them.",
        "",
        markdown_table(["operation", "method", "availability", "coverage", "worst site"], rows),
        "",
    ]
    if labels:
        longest = labels[-1].removesuffix("s")
        header = ["operation", "method", *(f"lost within {label.removesuffix('s')} s" for label in labels)]
        lines += [
            "Operations that start available and do not stay so; and the count behind those of "
            f"{longest} s: starts with service without it at a following epoch, {found.step_s:g} s apart. ICAO "
            "Annex 10 asks approaches for 1 - 8e-6 in 15 s: no more than 8e-4 % lost, from all causes.",
            "",
            markdown_table([*header, "count"], continuity),
            "",
        ]
    if len(worst):
        lines += ["Sites with the lowest availability, the worst first:", "", *_worst_lists(found, worst)]
    labelled = "; ".join(f"{m}: {method_label(m)}" for m in found.methods if method_label(m) != m)
    return "\n".join([*lines, f"{labelled}." if labelled else ""]).rstrip() + "\n"


def durations_of(table: pd.DataFrame) -> list[str]:
    """Labels of the durations whose continuity a table holds: ``15s``."""
    found = (re.fullmatch(r"continuity_(.+)_rate", str(column)) for column in table.columns)
    return [match[1] for match in found if match]


def service_answer(run: RunFolder) -> tuple[str, ...]:
    """Of a service volume: availability by method, coverage with the worst place, and continuity."""
    table, name = run.tables["world"], run.alert.name
    rows = list(table[table.operation == name].itertuples())
    available = "; ".join(f"{method_label(row.method)} {_part(row, 'availability')}" for row in rows)
    covered = "; ".join(
        f"{method_label(row.method)} {_coverage(row)}"
        + (
            f", the worst being {_place(row.worst_latitude_deg, row.worst_longitude_deg)} with "
            f"{percent(row.worst_rate)} %"
            if row.worst_rate < 1.0
            else ""
        )
        for row in rows
    )
    sentences = [
        f"{name} (VAL {run.alert.vertical_m:g} m, HAL {run.alert.horizontal_m:g} m) is available in this share of "
        f"area and time: {available}.",
        f"Sites with {100 * COVERED:g} % or more of the day make up this share of the area: {covered}.",
    ]
    labels = durations_of(table)
    if labels:
        lost = "; ".join(f"{method_label(row.method)} {_lost(row, labels[-1])}" for row in rows)
        length = labels[-1].removesuffix("s")
        sentences.append(
            f"Of operations of {length} s that start available, these do not stay so, as far as the epochs of the "
            f"grid tell: {lost}."
        )
    return tuple(sentences)


def _part(row: Any, what: str) -> str:
    """A rate with its bounds in per cent; the bounds alone where it is none or all."""
    rate, low, high = (float(getattr(row, f"{what}_{part}")) for part in ("rate", "low", "high"))
    # Nobody reads eleven nines.
    high = 1.0 if high > 1.0 - 1e-9 else high
    if rate == 0.0:
        return f"none (< {percent(high)} %)"
    if rate >= 1.0 - 1e-12:
        return f"all (> {percent(low)} %)"
    return f"{percent(rate)} % [{percent(low)}, {percent(high)}]"


def _coverage(row: Any) -> str:
    # Shares are sums over cells, which may miss one by rounding.
    rate, low, high = (
        1.0 if value > 1.0 - 1e-9 else value
        for value in (float(getattr(row, f"coverage_{part}")) for part in ("rate", "low", "high"))
    )
    sites = f"{int(row.coverage_sites):,} of {int(row.sites):,} sites"
    return f"{percent(rate)} % [{percent(low)}, {percent(high)}] ({sites})"


def _lost(row: Any, label: str) -> str:
    """Share of operations that are lost, with bounds."""
    started, stayed = (int(getattr(row, f"{word}_{label}")) for word in ("started", "stayed"))
    if started == 0:
        return "none starts"
    rate, low, high = (1.0 - float(getattr(row, f"continuity_{label}_{part}")) for part in ("rate", "high", "low"))
    if low == high:
        # Levels from the geometry alone are counted, not drawn.
        return "none" if started == stayed else f"{percent(rate)} %"
    if started == stayed:
        return f"none (< {percent(high)} %)"
    return f"{percent(rate)} % [{percent(max(low, 0.0))}, {percent(high)}]"


def _lost_count(row: Any, label: str) -> str:
    started, stayed = (int(getattr(row, f"{word}_{label}")) for word in ("started", "stayed"))
    return f"{started - stayed:,} of {started:,}"


def _worst_lists(found: ServiceVolume, worst: pd.DataFrame) -> list[str]:
    lines = []
    for operation in (one.name for one in found.operations):
        for method in found.methods:
            rows = worst[(worst.operation == operation) & (worst.method == method)].head(_LISTED)
            world = found.world[(found.world.operation == operation) & (found.world.method == method)]
            if int(world.available.iloc[0]) == 0:
                lines.append(f"- {operation}, {method_label(method)}: none anywhere.")
            elif len(rows):
                places = "; ".join(
                    f"{_place(row.latitude_deg, row.longitude_deg)} {_part(row, 'availability')}"
                    for row in rows.itertuples()
                )
                lines.append(f"- {operation}, {method_label(method)}: {places}.")
    return [*lines, ""]


def _limits(found: ServiceVolume, operation: str) -> str:
    one = next(limits for limits in found.operations if limits.name == operation)
    vertical = f"{one.vertical_m:g}" if one.has_vertical else "-"
    return f"{operation} ({vertical} / {one.horizontal_m:g} m)"


def _order(found: ServiceVolume) -> dict[str, int]:
    return {one.name: k for k, one in enumerate(found.operations)}


def _place(latitude_deg: float, longitude_deg: float) -> str:
    north = "N" if latitude_deg >= 0 else "S"
    east = "E" if longitude_deg >= 0 else "W"
    return f"{abs(latitude_deg):g} {north} {abs(longitude_deg):g} {east}"
