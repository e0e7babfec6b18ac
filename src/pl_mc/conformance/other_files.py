"""Reference numbers of augmentation systems and of classical RAIM."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from pl_mc.conformance.row_set import Folder, RowSet, Tolerance

_ROW = ["case", "satellite", "system", "e", "n", "u", "sigma_m"]
# Ways in which DO-229's error terms are asked for at some elevations.
_TERM = r"(?P<term>.+)_at_(?P<elevation_deg>\d+)_deg"


def sbas(folder: Folder) -> Iterator[RowSet]:
    """Levels of WAAS users, single and dual frequency."""
    file, rows = "sbas_levels.csv", "sbas_geometry.csv"
    if not folder.has(file, rows):
        return
    keys = ["service", "t_gps_s", "user"]
    geometry = folder.read(rows, *keys, "prn", "e", "n", "u", "variance_m2")
    levels = folder.reference(file, *keys, "vpl_m", "hpl_m")
    geometry, levels = (table.assign(case=_case(table, keys)) for table in (geometry, levels))
    geometry = geometry.assign(
        system="G", satellite="G" + geometry["prn"].astype(str), sigma_m=geometry["variance_m2"] ** 0.5
    )
    for service, own in levels.groupby("service"):
        task = {"kind": "sbas", "k_horizontal": 6.0, "k_vertical": 5.33, "ask": ["levels"]}
        given = {"geometry": geometry[geometry["case"].isin(own["case"])][_ROW]}
        tolerances = {"vpl_m": Tolerance(1e-6), "hpl_m": Tolerance(1e-6)}
        source = "MAAST (stanford-gps-lab/maast) on recorded WAAS messages, as kshana has them"
        yield RowSet(f"SBAS {service}", file, source, task, given, own, ("case",), tolerances)


def five_satellites(folder: Folder) -> Iterator[RowSet]:
    """Levels of five satellites, and the error terms of DO-229 at three elevations."""
    file, rows = "sbas_five_satellites_expected.csv", "sbas_five_satellites.csv"
    if not folder.has(file, rows):
        return
    table = folder.read(rows, "satellite", "azimuth_deg", "elevation_deg", "sigma_m")
    expected = folder.reference(file, "quantity", "value")
    source, close = "sidereon (neilberkman/sidereon, MIT)", {"value": Tolerance(1e-11)}
    given = {"geometry": table.assign(case=1, system="G", satellite="G" + table["satellite"].astype(str))}
    terms = expected["quantity"].str.extract(_TERM)
    own = expected[terms["term"].isna()].assign(case=1)
    task = {"kind": "sbas", "k_horizontal": 6.0, "k_vertical": 5.33, "ask": ["quantities"]}
    yield RowSet("SBAS five satellites", file, source, task, given, own, ("case", "quantity"), close)
    asked = expected[terms["term"].notna()]
    at = terms.loc[asked.index].assign(elevation_deg=lambda t: t["elevation_deg"].astype(float))
    task = {"kind": "sbas_terms", "earth_radius_m": 6371e3, "ask": ["quantities"]}
    wanted = asked.assign(term=at["term"], elevation_deg=at["elevation_deg"])
    keys = ("term", "elevation_deg")
    yield RowSet("DO-229 error terms", file, source, task, {"terms": at.reset_index(drop=True)}, wanted, keys, close)


def rtklib(folder: Folder) -> Iterator[RowSet]:
    """Levels of the slope method, and RTKLIB's chi-square decisions."""
    rows = "rtklib_raim_geometry.csv"
    if folder.has("rtklib_raim_levels.csv", rows):
        geometry = rtklib_geometry(folder)
        levels = folder.reference("rtklib_raim_levels.csv", "epoch", "hpl_m", "vpl_m").rename(columns={"epoch": "case"})
        task = {"kind": "slope", "p_fa": 1e-3, "p_md": 1e-3, "ask": ["levels"]}
        given = {"geometry": geometry[geometry["case"].isin(levels["case"])]}
        tolerances = {"hpl_m": Tolerance(5e-5), "vpl_m": Tolerance(5e-5)}
        source = "SciPy and RTKLIB's geometry, as kshana has them"
        yield RowSet("RAIM slope levels", "rtklib_raim_levels.csv", source, task, given, levels, ("case",), tolerances)
    file, residuals = "rtklib_raim_injections.csv", "rtklib_raim_residuals.csv"
    if folder.has(file, rows, residuals):
        geometry = rtklib_geometry(folder)
        columns = ("epoch", "bias_prn", "bias_m", "test_statistic", "table_threshold", "alarm", "excluded_prn")
        table = folder.reference(file, *columns)
        table = table.assign(injection=range(1, len(table) + 1)).rename(columns={"epoch": "case"})
        errors = folder.read(residuals, "epoch", "prn", "residual_m")
        errors = errors.assign(case=errors["epoch"], satellite=_satellite(errors["prn"]))
        given = {
            "geometry": geometry[geometry["case"].isin(table["case"])],
            "errors": errors[["case", "satellite", "residual_m"]],
            "injections": table[["injection", "case", "bias_m"]].assign(
                satellite=_satellite(table["bias_prn"]), threshold=table["table_threshold"]
            ),
        }
        task = {"kind": "chi_square", "ask": ["decisions"]}
        # RTKLIB iterates from the Earth's centre, which its statistic shows.
        tolerances = {
            "test_statistic": Tolerance(2e-4, 5e-6), "alarm": Tolerance(0.5), "excluded_prn": Tolerance(0.5),
        }  # fmt: skip
        yield RowSet("RAIM decisions", file, "RTKLIB 2.4.2-p13 (BSD-2)", task, given, table, ("injection",), tolerances)


def rtklib_geometry(folder: Folder) -> pd.DataFrame:
    """The rows of `rtklib_raim_geometry.csv` as a subject gets them."""
    table = folder.read("rtklib_raim_geometry.csv", "epoch", "prn", "e", "n", "u", "variance_m2")
    satellite = _satellite(table["prn"])
    return table.assign(case=table["epoch"], satellite=satellite, system="G", sigma_m=table["variance_m2"] ** 0.5)[_ROW]


def _satellite(number: pd.Series) -> pd.Series:
    return "G" + number.astype(int).astype(str)


def _case(table: pd.DataFrame, keys: list[str]) -> pd.Series:
    parts = [table[key].astype(str) for key in keys]
    return parts[0].str.cat(parts[1:], sep="/")
