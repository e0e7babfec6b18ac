"""pl_mc as a subject: a folder with a task in, ``answers.csv`` out; also an example for other tools.

``python -m pl_mc.conformance.subject FOLDER`` answers the task in a folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd

import pl_mc.araim
from pl_mc.araim.solving import fit_subsets
from pl_mc.conformance.araim_files import ALL_IN_VIEW, WORST
from pl_mc.engine import solve
from pl_mc.error_models.airborne import aad_a_sigma_m, multipath_sigma_m
from pl_mc.error_models.atmosphere import obliquity, troposphere_sigma_m
from pl_mc.faults import biases, no_fault
from pl_mc.geometry import Geometry
from pl_mc.methods import method
from pl_mc.runtime.precision import precision_scope
from pl_mc.statistics import exact, reliability
from pl_mc.statistics.reliability import reliability_matrix

Tables = Mapping[str, pd.DataFrame]
# A level on one line of the answers.
_LEVELS = ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m")


def answer(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    """The answers to a task, a row each."""
    return _KINDS[task["kind"]](task, tables)


def geometries(rows: pd.DataFrame) -> dict[Any, Geometry]:
    """A geometry for each case; sigma is that of the rows or 1 m."""
    found = {}
    for case, own in rows.groupby("case"):
        letters = list(dict.fromkeys(own["system"]))
        clocks = np.stack([own["system"].to_numpy() == letter for letter in letters], axis=1)
        design = np.column_stack([own[["e", "n", "u"]].to_numpy(float), clocks])
        sigma = own["sigma_m"].to_numpy(float) if "sigma_m" in own else np.ones(len(own))
        found[case] = Geometry.from_arrays(design, sigma, own["system"].tolist(), own["satellite"].tolist())
    return found


def _araim(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    """Levels or modes of a batch of geometries, padded to one shape."""
    rows = tables["geometry"]
    cases, place = np.unique(rows["case"], return_inverse=True)
    row = rows.groupby("case").cumcount().to_numpy()
    letters = sorted(rows["system"].unique(), reverse=True)
    shape = (len(cases), int(row.max()) + 1)

    def spread(values: Any, other: Any) -> Any:
        found = np.full((*shape, *np.shape(values)[1:]), other)
        found[place, row] = values
        return found

    clocks = np.stack([rows["system"].to_numpy() == letter for letter in letters], axis=1)
    names = spread(rows["satellite"].to_numpy(str), np.zeros((), "U8"))
    priors: dict[str, Any] = {field: task[field] for field in ("p_sat", "p_const") if field in task}
    faults = {field: task[field] for field in task if field.endswith("_per_h") or field.startswith("mfd_")}
    options = {field: task[field] for field in ("unmonitored", "exclusion", "estimator") if field in task}
    ism = pl_mc.araim.Ism(**faults) if faults else None
    modes = _listed(tables, cases, names) if "modes" in tables else None
    levels = pl_mc.araim.protection_levels(
        spread(np.column_stack([rows[["e", "n", "u"]].to_numpy(float), clocks]), 0.0),
        spread(rows["c_int_m2"].to_numpy(float), 1.0), spread(rows["c_acc_m2"].to_numpy(float), 1.0),
        spread(rows["system"].to_numpy(str), np.array(letters[0])).tolist(), task["b_nom_m"],
        budget=pl_mc.araim.Budget("task", **task["budget"]), in_view=spread(np.ones(len(rows), bool), False),
        names=names.tolist(), standard=task["standard"], modes=modes, ism=ism, **priors, **options,
    )  # fmt: skip
    if "modes" in task["ask"]:
        return levels.modes().assign(case=lambda table: cases[table["geometry"]])
    if "quantities" in task["ask"]:
        return _quantities(task, rows, levels)
    table = pd.DataFrame({"case": cases, **{field: getattr(levels, field) for field in _LEVELS}})
    table = table.assign(p_not_monitored=levels.p_not_monitored, modes=(levels.probability > 0).sum(axis=1))
    for field in ("hpl_norm_m", "hpl_plane_m", "hpl_plane_coded_m"):
        if getattr(levels, field) is not None:
            table[field] = getattr(levels, field)
    if (positions := levels.positions) is None:
        return table
    parts = [table.assign(position=WORST)]
    for k in range(positions.there.shape[1]):
        own = table.assign(**{field: getattr(positions, field)[:, k] for field in _LEVELS})
        words = np.full(len(cases), ALL_IN_VIEW) if k == 0 else names[:, k - 1]
        parts.append(own.assign(position=words)[positions.there[:, k]])
    return pd.concat(parts)


def _listed(tables: Tables, cases: Any, names: Any) -> list[pl_mc.araim.FaultModes]:
    """The fault modes that a task gives."""
    lost = tables["cases"].set_index("case")["p_not_monitored"]
    by_case, found = dict(tuple(tables["modes"].groupby("case"))), []
    for case, words in zip(cases, names, strict=True):
        own = by_case[case]
        spoiled = np.array([np.isin(words, text.split()) for text in own["satellites_out"]])
        exposure = own["p_exposure"].to_numpy(float)
        found.append(
            pl_mc.araim.FaultModes(spoiled, own["p_instant"].to_numpy(float), 0.0, float(lost[case]), exposure)
        )
    return found


def _quantities(task: Mapping[str, Any], rows: pd.DataFrame, levels: pl_mc.araim.AraimLevels) -> pd.DataFrame:
    """What the example of a document prints of its first case, name by name."""
    own = rows.reset_index(drop=True)
    excluded, threshold = levels.excluded[0], levels.threshold_m[0]
    (g,) = geometries(own).values()
    root = 1.0 / np.sqrt(own["c_int_m2"].to_numpy(float))
    ratio = own["c_acc_m2"].to_numpy(float) * root**2
    with precision_scope("float64"):
        rows_of = (g.design * root[:, None], np.ones(len(own), bool), excluded.T, task["b_nom_m"] * root, ratio)
        _, subsets = jax.jit(fit_subsets)(*(array[..., None] for array in rows_of))
    separation = np.asarray(subsets.sigma_separation_m)[2, :, 0]
    found = {field: float(getattr(levels, field)[0]) for field in _LEVELS}
    found |= {"modes": float(len(excluded)), "k_fa_vertical": float(np.median(threshold[:, 2] / separation))}
    # Constellations by their numbers.
    for number, letter in enumerate("GE", start=1):
        k = int(np.flatnonzero((excluded == (own["system"].to_numpy() == letter)).all(axis=1))[0])
        found[f"sigma_up_without_{number}_m"] = float(subsets.sigma_m[2, k, 0])
        found[f"sigma_separation_up_{number}_m"] = float(separation[k])
        found[f"bias_up_{number}_m"] = float(subsets.bias_m[2, k, 0])
    return pd.DataFrame({"case": own["case"].iloc[0], "quantity": list(found), "value": list(found.values())})


def _by_method(one: Any, rows: pd.DataFrame) -> pd.DataFrame:
    """The levels of a method that knows the geometry alone."""
    parts = []
    for case, g in geometries(rows).items():
        parts.append(solve(g, np.zeros(len(g.names)), methods=[one]).assign(case=case))
    return pd.concat(parts)


def _sbas(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    rows = tables["geometry"]
    if "e" not in rows:
        azimuth, elevation = np.radians(rows["azimuth_deg"]), np.radians(rows["elevation_deg"])
        rows = rows.assign(
            e=-np.sin(azimuth) * np.cos(elevation), n=-np.cos(azimuth) * np.cos(elevation), u=-np.sin(elevation)
        )
    table = _by_method(method("sbas", k_horizontal=task["k_horizontal"], k_vertical=task["k_vertical"]), rows)
    if "quantities" not in task["ask"]:
        return table
    found = {}
    for case, g in geometries(rows).items():
        covariance = np.linalg.inv((g.design / g.sigma_m[:, None] ** 2).T @ g.design)
        own = table[table["case"] == case].iloc[0]
        found[case] = {
            **dict(zip(("d_east_m", "d_north_m", "d_up_m"), np.sqrt(np.diag(covariance)[:3]), strict=True)),
            "d_east_north_m2": covariance[0, 1], "d_major_m": own["hpl_m"] / task["k_horizontal"],
            "hpl_m": own["hpl_m"], "vpl_m": own["vpl_m"],
        }  # fmt: skip
    return pd.DataFrame(
        [
            {"case": case, "quantity": name, "value": value}
            for case, values in found.items()
            for name, value in values.items()
        ]
    )


def _sbas_terms(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    terms: dict[str, Callable[[Any], Any]] = {
        "sigma_tropo_m": troposphere_sigma_m,
        "iono_obliquity": lambda elevation: obliquity(elevation, task["earth_radius_m"]),
        "sigma_air_multipath_m": multipath_sigma_m,
        "sigma_air_aad_a_m": aad_a_sigma_m,
    }
    rows = tables["terms"]
    known = rows[rows["term"].isin(list(terms))]
    values = [
        float(terms[term](np.radians(at))) for term, at in zip(known["term"], known["elevation_deg"], strict=True)
    ]
    return known.assign(value=values)


def _slope(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    return _by_method(method("slope", p_fa=task["p_fa"], p_md=task["p_md"]), tables["geometry"])


def _chi_square(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    """V'PV under each injection, and the satellite without which it is least."""
    whole, found = geometries(tables["geometry"]), []
    errors = {case: own.set_index("satellite")["residual_m"] for case, own in tables["errors"].groupby("case")}
    for row in tables["injections"].itertuples():
        g = whole[row.case]
        observed = errors[row.case].reindex(list(g.names)).to_numpy(float)
        observed = observed + row.bias_m * (np.array(g.names) == row.satellite)
        statistic = _statistic(g, observed)
        alarm, excluded = statistic > row.threshold, 0
        if alarm:
            without = []
            for k in range(len(g.names)):
                kept = np.arange(len(g.names)) != k
                names = [name for name in g.names if name != g.names[k]]
                part = Geometry.from_arrays(g.design[kept], g.sigma_m[kept], g.systems[:-1], names)
                without.append(_statistic(part, observed[kept]))
            excluded = int(g.names[int(np.argmin(without))][1:])
        found.append((row.injection, statistic, int(alarm), excluded))
    return pd.DataFrame(found, columns=["injection", "test_statistic", "alarm", "excluded_prn"])


def _statistic(g: Geometry, errors_m: Any) -> float:
    return float((((reliability_matrix(g) @ errors_m) / g.sigma_m) ** 2).sum())


def _reliability(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    parts = []
    for case, g in geometries(tables["geometry"]).items():
        table = reliability(g, p_fa=task["p_fa"], power=task["power"])
        parts.append(table.rename(columns={"name": "satellite"}).assign(case=case))
    return pd.concat(parts)


def _least_squares(task: Mapping[str, Any], tables: Tables) -> pd.DataFrame:
    alert = pl_mc.AlertLimits("task", vertical_m=task["vertical_limit_m"])
    whole, parts = geometries(tables["geometry"]), []
    for case, own in tables["injections"].groupby("case"):
        g = whole[case]
        for bias_m, rows in own.groupby("bias_m"):
            faults = [biases(g, {name: bias_m}) if bias_m else no_fault(g) for name in rows["satellite"]]
            for name, fault in zip(rows["satellite"], faults, strict=True):
                rates = exact.ls_rates(g, fault, alert=alert, k_vertical=task["k_vertical"])
                parts.append(rates[["alarm_rate", "hazard_rate"]].assign(case=case, satellite=name, bias_m=bias_m))
    return pd.concat(parts)


_KINDS: dict[str, Callable[[Mapping[str, Any], Tables], pd.DataFrame]] = {
    "araim": _araim, "sbas": _sbas, "sbas_terms": _sbas_terms, "slope": _slope, "chi_square": _chi_square,
    "reliability": _reliability, "least_squares": _least_squares,
}  # fmt: skip


def main(folder: str) -> None:
    """Answer the task of a folder."""
    place = Path(folder)
    task = json.loads((place / "task.json").read_text(encoding="utf-8"))
    tables = {path.stem: pd.read_csv(path) for path in place.glob("*.csv") if path.stem != "answers"}
    answer(task, tables).to_csv(place / "answers.csv", index=False)


if __name__ == "__main__":
    main(sys.argv[1])
