"""What a service volume says: its summary, and its answer in three sentences."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Any

import pandas as pd

from pl_mc.alert import AlertLimits
from pl_mc.report.document import Block, Bullets, Summary, TextTable
from pl_mc.report.figures import method_label
from pl_mc.report.text import by_method, method_key, percent
from pl_mc.service.counting import COVERED
from pl_mc.service.volume import ServiceVolume
from pl_mc.studies.spec import Experiment

# Sites of a list in the summary; the file holds more.
_LISTED = 5


def summary(setting: str, volume: ServiceVolume, worst: pd.DataFrame) -> Summary:
    """What was run (``setting``), rates over the world by operation and method, continuity, the ``worst`` sites."""
    noisy, exact = [name for name in volume.methods if name not in volume.exact], ", ".join(volume.exact)
    # Operations in their order, methods within them in theirs.
    world = [
        (limits, row)
        for limits in volume.operations
        for row in volume.world[volume.world.operation == limits.name].itertuples()
    ]
    bounds = "Bounds are those of the draws (95 %)" if noisy else ""
    if exact:
        bounds += (
            f"{'; for' if noisy else 'For'} {exact} bounds of the availability are those of the moments within a "
            "step at which service may change, and continuity has none"
        )
    blocks: list[Block | str] = [
        setting,
        "Availability: share of area and time in which VPL and HPL are within the limits, weighted with area; "
        f"coverage: share of the area whose sites have {100 * COVERED:g} % or more. {bounds}; that users stand "
        "on a grid is in none of them.",
        TextTable.of(
            ["operation", "method", "availability", "coverage", "worst site"],
            [
                [_limits(limits), method_label(row.method), _part(row, "availability"), _coverage(row),
                 f"{_worst_place(row)}: {percent(row.worst_rate)} %" if row.worst_rate < 1.0 else "-"]
                for limits, row in world
            ],
        ),
    ]  # fmt: skip
    labels = durations_of(volume.world)
    if labels:
        seconds = [label.removesuffix("s") for label in labels]
        rows = []
        for limits, row in world:
            started, stayed = _started_and_stayed(row, labels[-1])
            lost = [*(_lost(row, label) for label in labels), f"{started - stayed:,} of {started:,}"]
            rows.append([limits.name, method_label(row.method), *lost])
        blocks += [
            f"Operations that start available and do not stay so; and the count behind those of {seconds[-1]} s: "
            f"starts with service without it at a following epoch, {volume.step_s:g} s apart. ICAO Annex 10 asks "
            "approaches for 1 - 8e-6 in 15 s: no more than 8e-4 % lost, from all causes.",
            TextTable.of(["operation", "method", *(f"lost within {s} s" for s in seconds), "count"], rows),
        ]
    if len(worst):
        lists = (_worst_list(limits, row, worst) for limits, row in world)
        blocks += ["Sites with the lowest availability, the worst first:", Bullets(tuple(filter(None, lists)))]
    labelled = [name for name in volume.methods if method_label(name) != name]
    return (*blocks, method_key(labelled)) if labelled else tuple(blocks)


def answer(tables: Mapping[str, pd.DataFrame], experiment: Experiment) -> tuple[str, ...]:
    """Availability by method, coverage with the worst place, and continuity."""
    table, alert = tables["world"], experiment.alert_limits()
    rows = list(table[table.operation == alert.name].itertuples())
    available = by_method(rows, partial(_part, what="availability"))

    def covered(row: Any) -> str:
        worst = f", the worst being {_worst_place(row)} with {percent(row.worst_rate)} %"
        return _coverage(row) + (worst if row.worst_rate < 1.0 else "")

    sentences = [
        f"{alert.name} ({alert.words}) is available in this share of area and time: {available}.",
        f"Sites with {100 * COVERED:g} % or more of the day make up this share of the area: "
        f"{by_method(rows, covered)}.",
    ]
    for label in durations_of(table)[-1:]:
        lost = by_method(rows, partial(_lost, label=label))
        sentences.append(
            f"Of operations of {label.removesuffix('s')} s that start available, these do not stay so, as far as "
            f"the epochs of the grid tell: {lost}."
        )
    return tuple(sentences)


def durations_of(table: pd.DataFrame) -> list[str]:
    """Labels of the durations whose continuity a table holds: ``15s``."""
    matches = (re.fullmatch(r"continuity_(.+)_rate", str(column)) for column in table.columns)
    return [match[1] for match in matches if match]


def rows_of(table: pd.DataFrame, method: str, operation: str) -> pd.DataFrame:
    """The rows of one method and operation."""
    return table[(table.method == method) & (table.operation == operation)]


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
    started, stayed = _started_and_stayed(row, label)
    if started == 0:
        return "none starts"
    rate, low, high = (1.0 - float(getattr(row, f"continuity_{label}_{part}")) for part in ("rate", "high", "low"))
    if low == high:
        # Levels from the geometry alone are counted, not drawn.
        return "none" if started == stayed else f"{percent(rate)} %"
    if started == stayed:
        return f"none (< {percent(high)} %)"
    return f"{percent(rate)} % [{percent(max(low, 0.0))}, {percent(high)}]"


def _started_and_stayed(row: Any, label: str) -> tuple[int, int]:
    return int(getattr(row, f"started_{label}")), int(getattr(row, f"stayed_{label}"))


def _worst_list(limits: AlertLimits, row: Any, worst: pd.DataFrame) -> str:
    """The worst sites of a method and an operation, whose row of the world it is; nothing where all serve."""
    name = f"{limits.name}, {method_label(row.method)}"
    if int(row.available) == 0:
        return f"{name}: none anywhere."
    places = "; ".join(
        f"{_place(site.latitude_deg, site.longitude_deg)} {_part(site, 'availability')}"
        for site in rows_of(worst, row.method, limits.name).head(_LISTED).itertuples()
    )
    return f"{name}: {places}." if places else ""


def _limits(limits: AlertLimits) -> str:
    both = (limits.vertical_m, limits.horizontal_m)
    return f"{limits.name} ({' / '.join('-' if limit is None else f'{limit:g}' for limit in both)} m)"


def _worst_place(row: Any) -> str:
    return _place(row.worst_latitude_deg, row.worst_longitude_deg)


def _place(latitude_deg: float, longitude_deg: float) -> str:
    north = "N" if latitude_deg >= 0 else "S"
    east = "E" if longitude_deg >= 0 else "W"
    return f"{abs(latitude_deg):g} {north} {abs(longitude_deg):g} {east}"
