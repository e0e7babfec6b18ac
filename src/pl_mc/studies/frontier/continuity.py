"""Continuity in an experiment of the kind ``frontier``: interruptions of an exposure, at each geometry."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pl_mc.geometry import Geometry
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.budget import continuity
from pl_mc.integrity_risk.budget.continuity import FAULT_FREE, TOTAL, has_exposure
from pl_mc.methods import Method
from pl_mc.report.document import Block, TextTable
from pl_mc.studies.frontier.record import FrontierExperiment

_PARTS = ["contribution", "contribution_low", "contribution_high"]
KINDS = ("no fault", "satellites", "constellations", "total")


def require_exposure(experiment: FrontierExperiment) -> None:
    """Raise `InputError` where continuity is asked for and no method has any."""
    if experiment.continuity is not None and not any(map(has_exposure, experiment.method_records())):
        raise InputError(
            "none of the methods has an exposure, so that it has no effect (nearest: leave it out, or araim with "
            "standard = 'v4.2' and a budget such as 'LPV-200 v4.2')."
        )


def continuity_table(
    experiment: FrontierExperiment, places: Sequence[tuple[str, int, Geometry, Sequence[Method]]]
) -> pd.DataFrame:
    """One row for each geometry (sky, number, record, its methods), method and kind of fault."""
    rows = []
    for sky, place, g, methods in places:
        able = [one for one in methods if has_exposure(one)]
        if not able:
            continue
        found = continuity(
            g, able, sizes_m=experiment.sizes_m, seed=experiment.seed, alert=experiment.decides.alert,
            axis=experiment.decides.axis, required=experiment.continuity or 1.0,
        )  # fmt: skip
        kinds = found.fault.map({FAULT_FREE: KINDS[0], TOTAL: KINDS[3]}).fillna(KINDS[2])
        found["faults"] = kinds.where(~found.fault.isin(g.names), KINDS[1])
        sums = found.groupby(["method", "faults"], sort=False)[_PARTS].sum()
        allocation = found.groupby(["method", "faults"], sort=False)["allocation"].first()
        rows.append(sums.join(allocation).reset_index().assign(sky=sky, geometry=place))
    columns = ["sky", "geometry", "method", "faults", *_PARTS, "allocation"]
    return pd.concat(rows)[columns] if rows else pd.DataFrame(columns=columns)


def continuity_blocks(table: pd.DataFrame) -> list[Block | str]:
    """Means over the geometries of each sky."""
    mean = table.groupby(["sky", "method", "faults"], sort=False)[[*_PARTS, "allocation"]].mean().reset_index()
    rows = []
    for (sky, method), own in mean.groupby(["sky", "method"], sort=False):
        by_kind = own.set_index("faults")
        cells = [
            f"{row.contribution:.2g} [{row.contribution_low:.2g}, {row.contribution_high:.2g}]"
            for row in (by_kind.loc[kind] for kind in KINDS)
        ]
        kept = table[(table.sky == sky) & (table.method == method) & (table.faults == KINDS[3])]
        within = int((kept.contribution_high <= kept.allocation).sum())
        rows.append([sky, method, *cells, f"{within} of {len(kept)}"])
    free = table[table.faults == KINDS[0]].allocation.iloc[0]
    total = table[table.faults == KINDS[3]].allocation.iloc[0]
    return [
        "Continuity: probability of an alarm in an exposure of N_es samples, without a fault, by faults of single "
        "satellites that begin in it (each of the size with the most alarms, with its prior), and by faults of "
        "constellations, of which each counts as an alarm. Means over geometries, 95 % bounds. Without a fault "
        f"{free:g} is allocated; {total:g} may be interrupted in all, which the last column counts by the upper "
        "bounds. Noise here is that of the accuracy model.",
        TextTable.of(["sky", "method", *KINDS, f"within {total:g}"], rows),
    ]
