"""Reference numbers of ARAIM: the kernel of MAAST (v3 and v4.2), real orbits, and the examples of the documents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from pl_mc.conformance.row_set import Folder, RowSet, Tolerance

LEVELS = ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m")
LENGTH = Tolerance(1e-6)
# Nine digits after the first are printed; what sums of a hundred priors leave of one loses some bits of a double.
PRIOR, LEFT = Tolerance(0.0, 1e-9), Tolerance(1e-14, 1e-9)
COUNT = Tolerance(0.5)

_MAAST = "MAAST for ARAIM v4.2 (stanford-gps-lab/maast_for_araim_2, BSD-3, (c) 2024 Stanford)"

# ADD v3.0, table of constants for LPV-200.
_LPV_200 = {
    "p_hmi_vertical": 9.8e-8, "p_hmi_horizontal": 2e-9, "p_fa_vertical": 3.9e-6, "p_fa_horizontal": 9e-8,
    "p_threshold": 8e-8, "p_emt": 1e-5,
}  # fmt: skip
_VERTICAL = _LPV_200 | {
    "p_threshold": 6e-8, "exposure_h": 1 / 24, "samples_integrity": 25.0, "samples_continuity": 25.0,
    "consolidation": 0.01, "p_exclusion": 9e-7, "capped": True, "sigma_acc_vertical_m": 1.86,
    "sigma_acc_horizontal_m": 3.0,
}  # fmt: skip
_HORIZONTAL = {
    "p_hmi_vertical": 1e-9, "p_hmi_horizontal": 9.9e-8, "p_fa_vertical": 1e-9, "p_fa_horizontal": 5e-7,
    "p_threshold": 9e-8, "p_emt": 1e-5, "exposure_h": 1.0, "samples_integrity": 450.0, "samples_continuity": 450.0,
    "consolidation": 0.05, "p_exclusion": 9e-7, "capped": False, "sigma_acc_vertical_m": 10.0,
    "sigma_acc_horizontal_m": 60.0,
}  # fmt: skip
_FAULTS = {
    "r_sat_per_h": {"G": 1e-5, "E": 2e-5}, "mfd_sat_h": {"G": 1.0, "E": 1.5},
    "r_const_per_h": {"G": 1e-8, "E": 1e-4}, "mfd_const_h": {"G": 1.0, "E": 2.0},
}  # fmt: skip
_V3 = {
    "kind": "araim", "standard": "v3", "budget": _LPV_200, "b_nom_m": 0.75, "p_sat": 1e-5,
    "p_const": {"G": 1e-8, "E": 1e-4}, "unmonitored": "contained", "ask": ["levels"],
}  # fmt: skip
_V = {"budget": _VERTICAL, "ura_m": {"G": 1.0, "E": 1.0}, "ure_m": {"G": 2 / 3, "E": 2 / 3}, "b_nom_m": 0.75}
_H = {"budget": _HORIZONTAL, "ura_m": {"G": 2.4, "E": 6.0}, "ure_m": {"G": 2.4, "E": 4.0}, "b_nom_m": 0.0}

# Settings of MAAST's v4.2, what differs in each, and the setting whose list of fault modes it has.
_SETTINGS: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "v_fd": (_V, {}, "v_fd"),
    "v_fd_adjusted": (_V, {"estimator": "adjusted"}, "v_fd"),
    "v_fde": (_V, {"exclusion": "satellites"}, "v_fd"),
    "h_fd": (_H, {}, "h_fd"),
    "h_fd_capped": (_H | {"budget": _HORIZONTAL | {"capped": True}}, {}, "h_fd"),
    "h_fd_gps": (_H, {}, "h_fd_gps"),
    "h_fd_adjusted": (_H, {"estimator": "adjusted"}, "h_fd"),
    "h_fde": (_H, {"exclusion": "satellites"}, "h_fde"),
}
# Where levels with exclusion stand in the tables of an answer.
ALL_IN_VIEW, WORST = "all in view", "worst"

GEOMETRY, LEVELS_FILE = "maast_v42_geometry.csv", "maast_v42_levels.csv"
MODES_FILE, EXCLUSIONS_FILE = "maast_v42_modes.csv", "maast_v42_exclusions.csv"


def maast_v42(folder: Folder) -> Iterator[RowSet]:
    """Levels in ten settings, with the fault modes that are listed and with those that the subject finds itself."""
    levels = modes = exclusions = None
    if folder.has(LEVELS_FILE, GEOMETRY):
        levels = folder.reference(LEVELS_FILE, "setting", "case", "p_not_monitored", "modes", *LEVELS)
        levels = levels.rename(columns={"hpl_plane_m": "hpl_plane_coded_m"})
    if folder.has(MODES_FILE, GEOMETRY):
        modes = folder.reference(MODES_FILE, "setting", "case", "p_instant", "p_exposure", "satellites_out")
    if folder.has(EXCLUSIONS_FILE, GEOMETRY):
        exclusions = folder.reference(EXCLUSIONS_FILE, "setting", "case", "satellite_out", *LEVELS)
    if levels is None and modes is None and exclusions is None:
        return
    geometry = folder.read(GEOMETRY, "case", "system", "prn", "e", "n", "u", "noise_m2")
    for setting, (figures, options, listed_as) in _SETTINGS.items():
        rows = _with_variances(geometry if setting != "h_fd_gps" else geometry[geometry["system"] == "G"], figures)
        task = {"kind": "araim", "standard": "v4.2", "budget": figures["budget"], "b_nom_m": figures["b_nom_m"]}
        task |= _FAULTS | options
        listed = None if modes is None or levels is None else _listed(modes, levels, setting, listed_as)
        expected = [] if levels is None else [(LEVELS_FILE, _levels_of(levels, setting))]
        if exclusions is not None and "exclusion" in options:
            own = exclusions[exclusions["setting"] == setting]
            expected.append((EXCLUSIONS_FILE, own.rename(columns={"satellite_out": "position"})))
        for file, wanted in expected:
            yield from _both(setting, file, task, rows, wanted, listed)
        if modes is not None and (modes["setting"] == setting).any():
            own = modes[modes["setting"] == setting].rename(columns={"satellites_out": "satellites"})
            rows = rows[rows["case"].isin(own["case"])]
            yield RowSet(
                f"v4.2 {setting}: fault modes", MODES_FILE, _MAAST, task | {"ask": ["modes"]}, {"geometry": rows}, own,
                ("case", "satellites"), {"p_instant": PRIOR, "p_exposure": PRIOR},
            )  # fmt: skip


def _both(
    setting: str, file: str, task: Mapping[str, Any], rows: pd.DataFrame, wanted: pd.DataFrame,
    listed: dict[str, pd.DataFrame] | None,
) -> Iterator[RowSet]:  # fmt: skip
    """The same rows with modes found by the subject, and with those that are listed."""
    if wanted.empty:
        return
    rows = rows[rows["case"].isin(wanted["case"])]
    lengths = [column for column in wanted if column.endswith("_m") and wanted[column].notna().any()]
    tolerances = dict.fromkeys(lengths, LENGTH)
    keys = ("case", "position") if "position" in wanted else ("case",)
    own = tolerances if "p_not_monitored" not in wanted else tolerances | {"p_not_monitored": LEFT, "modes": COUNT}
    what = "candidates" if file == EXCLUSIONS_FILE else "levels"
    name, task = f"v4.2 {setting}: {what}", {**task, "ask": ["levels"]}
    yield RowSet(f"{name}, own modes", file, _MAAST, task, {"geometry": rows}, wanted, keys, own)
    if listed is not None:
        given = {"geometry": rows} | {name: table[table["case"].isin(wanted["case"])] for name, table in listed.items()}
        yield RowSet(f"{name}, listed modes", file, _MAAST, task, given, wanted, keys, tolerances)


def _levels_of(levels: pd.DataFrame, setting: str) -> pd.DataFrame:
    """The rows of a setting; with exclusion, those of all in view and of the worst position."""
    if not setting.endswith("fde"):
        return levels[levels["setting"] == setting]
    position = levels["setting"].map({f"{setting}_all_in_view": ALL_IN_VIEW, f"{setting}_worst": WORST})
    return levels.assign(position=position)[position.notna()]


def _listed(modes: pd.DataFrame, levels: pd.DataFrame, setting: str, listed_as: str) -> dict[str, pd.DataFrame] | None:
    """The fault modes of each case of a setting, and what they leave without a test; None where a list is missing."""
    wanted = _levels_of(levels, setting).drop_duplicates("case")[["case", "p_not_monitored"]]
    parts = []
    for case in wanted["case"]:
        own = modes[(modes["case"] == case) & (modes["setting"] == listed_as)]
        if own.empty and listed_as == "h_fde":
            own = modes[(modes["case"] == case) & (modes["setting"] == "h_fd")]
        if own.empty:
            return None
        parts.append(own[["case", "p_instant", "p_exposure", "satellites_out"]])
    return {"cases": wanted, "modes": pd.concat(parts)} if parts else None


def _with_variances(geometry: pd.DataFrame, figures: Mapping[str, Any]) -> pd.DataFrame:
    """Rows as a subject gets them."""
    ura, ure = (geometry["system"].map(figures[field]) ** 2 for field in ("ura_m", "ure_m"))
    return _rows(geometry, geometry["prn"], geometry["noise_m2"] + ura, geometry["noise_m2"] + ure)


def _rows(table: pd.DataFrame, number: Any, c_int_m2: Any, c_acc_m2: Any) -> pd.DataFrame:
    system = table["system"]
    return pd.DataFrame(
        {
            "case": table["case"], "satellite": system + number.astype(str), "system": system,
            "e": table["e"], "n": table["n"], "u": table["u"], "c_int_m2": c_int_m2, "c_acc_m2": c_acc_m2,
        }
    )  # fmt: skip


def orbits(folder: Folder) -> Iterator[RowSet]:
    """Users under real orbits, v3-like settings."""
    file, rows = "araim_orbits_levels.csv", "araim_orbits_geometry.csv"
    if not folder.has(file, rows):
        return
    geometry, levels = (
        folder.read(rows, "case", "system", "sat", "e", "n", "u"),
        folder.reference(file, "case", *LEVELS),
    )
    given = {"geometry": _rows(geometry, geometry["sat"], 1.0, 0.25)}
    yield RowSet(
        "v3 real orbits", file, f"{_MAAST} on public orbits", _V3, given, levels, ("case",),
        dict.fromkeys(LEVELS, LENGTH) | {"p_not_monitored": LEFT, "modes": COUNT},
    )  # fmt: skip
    peers = {f"peer_{column}": column for column in LEVELS if f"peer_{column}" in levels}
    if peers:
        # Another program's ten steps of bisection end above the root.
        tolerances = dict.fromkeys(LEVELS, LENGTH) | {"vpl_m": Tolerance(2.5e-3), "hpl_m": Tolerance(1e-3)}
        theirs = levels[["case", *peers]].rename(columns=peers).dropna()
        yield RowSet(
            "v3 real orbits, another program", file, "kshana (numbers alone)", _V3, given, theirs, ("case",),
            {column: tolerances[column] for column in peers.values()},
        )  # fmt: skip


def maast_v3(folder: Folder) -> Iterator[RowSet]:
    """96 users of 24 GPS and 24 Galileo satellites, v3."""
    file, rows = "araim_maast_cases.csv", "araim_maast_geometry.csv"
    if not folder.has(file, rows):
        return
    geometry = folder.read(rows, "case", "galileo", "prn", "e", "n", "u", "c_int_m2", "c_acc_m2")
    levels = folder.reference(file, "case", "vpl", "hpl", "emt", "sig_acc_v", "p_not_monitored").rename(
        columns={"vpl": "vpl_m", "hpl": "hpl_m", "emt": "emt_m", "sig_acc_v": "sigma_v_acc_m"}
    )
    geometry = geometry.assign(system=geometry["galileo"].map({0: "G", 1: "E"}))
    # Its levels follow v3.0's account of combinations, another one than `contained`, to a few millimetres.
    tolerances = {
        "vpl_m": Tolerance(5e-3), "hpl_m": Tolerance(5e-3), "emt_m": Tolerance(1e-5),
        "sigma_v_acc_m": Tolerance(1e-5), "p_not_monitored": Tolerance(5.1e-15),
    }  # fmt: skip
    yield RowSet(
        "v3 MAAST", file, "MAAST for ARAIM, baseline v5 kernel", _V3,
        {"geometry": _rows(geometry, geometry["prn"], geometry["c_int_m2"], geometry["c_acc_m2"])}, levels, ("case",),
        tolerances,
    )  # fmt: skip


def documents(folder: Folder) -> Iterator[RowSet]:
    """Appendix D of the ARAIM Algorithm Description Documents v3.0 and v3.1."""
    figures = {"standard": "v3", "budget": _LPV_200, "b_nom_m": 0.5, "p_sat": 1e-5, "unmonitored": "plain"}
    task = {"kind": "araim", **figures, "p_const": {"G": 1e-4, "E": 1e-4}, "ask": ["levels"]}
    # The tolerance of the document is one of the level equation, in each axis of the horizontal one.
    if folder.has("add_v3_appendix_d.csv"):
        table = folder.read("add_v3_appendix_d.csv", "sat", "system", "e", "n", "u", "c_int_m2", "c_acc_m2")
        rows = table.assign(case=1, system=table["system"].map({"GPS": "G", "GAL": "E"}))
        given = {"geometry": _rows(rows, rows["sat"], rows["c_int_m2"], rows["c_acc_m2"])}
        expected = pd.DataFrame({"case": [1], "vpl_m": 19.2, "hpl_m": 14.5, "emt_m": 7.8, "sigma_v_acc_m": 1.47})
        tolerances = {
            "vpl_m": Tolerance(0.05), "hpl_m": Tolerance(0.1), "emt_m": Tolerance(0.05),
            "sigma_v_acc_m": Tolerance(5e-3),
        }  # fmt: skip
        source = "ARAIM Algorithm Description Document v3.0"
        yield RowSet("v3.0 appendix D", "add_v3_appendix_d.csv", source, task, given, expected, ("case",), tolerances)
    file, rows_file = "add_v31_expected.csv", "add_v31_geometry.csv"
    if folder.has(file, rows_file):
        table = folder.read(rows_file, "satellite", "constellation", "e", "n", "u", "c_int_m2", "c_acc_m2")
        rows = table.assign(case=1, system=table["constellation"].map({1: "G", 2: "E"}))
        given = {"geometry": _rows(rows, rows["satellite"], rows["c_int_m2"], rows["c_acc_m2"])}
        expected = folder.reference(file, "quantity", "value").assign(case=1)
        # Other figures hold to their last digit, the fourth.
        level = expected["quantity"].isin(["vpl_m", "hpl_m"])
        for what, own, tolerance in (("levels", expected[level], 0.05), ("in its parts", expected[~level], 1.01e-4)):
            if len(own):
                yield RowSet(
                    f"v3.1 appendix D, {what}", file, "ARAIM Algorithm Description Document v3.1",
                    task | {"ask": ["quantities"]}, given, own, ("case", "quantity"), {"value": Tolerance(tolerance)},
                )  # fmt: skip
