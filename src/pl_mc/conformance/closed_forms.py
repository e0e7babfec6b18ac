"""Reference numbers by closed form, from SciPy's distributions and plain linear algebra, and from nothing of pl_mc."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy import optimize, stats

from pl_mc.conformance.other_files import rtklib_geometry
from pl_mc.conformance.row_set import Folder, RowSet, Tolerance

_SOURCE = "closed form"
_P_FA, _P_MD, _POWER = 1e-3, 1e-3, 0.95
_K_VERTICAL, _VAL_M = 5.33, 35.0
_BIASES_M = (0.0, 10.0, 30.0, 60.0)


def closed_forms(folder: Folder) -> Iterator[RowSet]:
    """Slope levels, redundancy numbers, detectable biases, and what least squares does under a fault."""
    if not folder.has("rtklib_raim_geometry.csv"):
        return
    geometry = rtklib_geometry(folder)
    cases = dict(tuple(geometry.groupby("case")))
    few = dict(list(cases.items())[::12])
    levels = pd.DataFrame([{"case": case, **_slope_levels(rows)} for case, rows in cases.items()])
    task = {"kind": "slope", "p_fa": _P_FA, "p_md": _P_MD, "ask": ["levels"]}
    close = Tolerance(1e-7)
    yield RowSet(
        "RAIM slope levels, recomputed", "closed form", _SOURCE, task, {"geometry": geometry}, levels, ("case",),
        {"hpl_m": close, "vpl_m": close},
    )  # fmt: skip
    rows = pd.concat(few.values())
    reliable = pd.concat([_reliability(own) for own in few.values()], ignore_index=True)
    task = {"kind": "reliability", "p_fa": _P_FA, "power": _POWER, "ask": ["satellites"]}
    yield RowSet(
        "redundancy and detectable biases", "closed form", _SOURCE, task, {"geometry": rows}, reliable,
        ("case", "satellite"), {"redundancy": Tolerance(1e-12), "mdb_m": Tolerance(0.0, 1e-9)},
    )  # fmt: skip
    laws = pd.concat([_laws(own) for own in few.values()], ignore_index=True)
    task = {"kind": "least_squares", "k_vertical": _K_VERTICAL, "vertical_limit_m": _VAL_M, "ask": ["rates"]}
    yield RowSet(
        "least squares under a fault", "closed form", _SOURCE, task,
        {"geometry": rows, "injections": laws[["case", "satellite", "bias_m"]]}, laws, ("case", "satellite", "bias_m"),
        {"alarm_rate": Tolerance(0.0, 1e-9), "hazard_rate": Tolerance(0.0, 1e-9)},
    )  # fmt: skip


def _solved(rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gains (3, n) of whitened observations, redundancy numbers (n,), sigmas (n,) of one geometry with one clock."""
    sigma = rows["sigma_m"].to_numpy()
    whitened = np.column_stack([rows[["e", "n", "u"]].to_numpy(), np.ones(len(rows))]) / sigma[:, None]
    inverse = np.linalg.pinv(whitened)
    return inverse[:3], 1.0 - np.einsum("ij,ji->i", whitened, inverse), sigma


def _slope_levels(rows: pd.DataFrame) -> dict[str, float]:
    """Largest slope times the bias that V'PV misses with P_MD (Brown and Chin 1994)."""
    gain, redundancy, _ = _solved(rows)
    dof = len(rows) - 4
    threshold = stats.chi2.isf(_P_FA, dof)
    parity = float(
        np.sqrt(optimize.brentq(lambda x: stats.ncx2.cdf(threshold, dof, x) - _P_MD, 1e-3, 500.0, xtol=1e-12))
    )
    slopes = np.abs(gain) / np.sqrt(redundancy)
    return {"hpl_m": float(np.hypot(*slopes[:2]).max()) * parity, "vpl_m": float(slopes[2].max()) * parity}


def _reliability(rows: pd.DataFrame) -> pd.DataFrame:
    """Minimal detectable bias of the two-sided test of a satellite's own residual (Baarda 1968)."""
    _, redundancy, sigma = _solved(rows)
    limit = stats.norm.isf(_P_FA / 2)
    shift = optimize.brentq(
        lambda x: stats.norm.sf(limit - x) + stats.norm.cdf(-limit - x) - _POWER, 0.0, 20.0, xtol=1e-14
    )
    return rows[["case", "satellite"]].assign(redundancy=redundancy, mdb_m=shift * sigma / np.sqrt(redundancy))


def _laws(rows: pd.DataFrame) -> pd.DataFrame:
    """Alarms of VPL = K_V sqrt(V'PV / dof) VDOP above the limit, and errors beyond it, of a bias on each satellite."""
    gain, redundancy, sigma = _solved(rows)
    dof, sigma_up = len(rows) - 4, float(np.sqrt((gain[2] ** 2).sum()))
    threshold = dof * (_VAL_M / (_K_VERTICAL * sigma_up)) ** 2
    found = []
    for i, satellite in enumerate(rows["satellite"]):
        for bias in _BIASES_M:
            noncentrality, shift = redundancy[i] * (bias / sigma[i]) ** 2, gain[2, i] * bias / sigma[i]
            alarm = stats.ncx2.sf(threshold, dof, noncentrality) if noncentrality else stats.chi2.sf(threshold, dof)
            hazard = stats.norm.sf((_VAL_M - shift) / sigma_up) + stats.norm.cdf((-_VAL_M - shift) / sigma_up)
            found.append(
                {
                    "case": rows["case"].iloc[0], "satellite": satellite, "bias_m": bias,
                    "alarm_rate": alarm, "hazard_rate": hazard,
                }
            )  # fmt: skip
    return pd.DataFrame(found)
