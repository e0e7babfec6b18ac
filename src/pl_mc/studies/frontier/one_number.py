"""One multiplier for all geometries of a sky, and one that goes by what a receiver knows of its own geometry."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pl_mc.arrays import FloatArray
from pl_mc.integrity_risk.given_residuals.draws import EpochParts

CONFIDENCE = 0.95
# Fewer say nothing of four numbers and a largest residual.
FEWEST = 40


def largest_slope(parts: EpochParts) -> float:
    """The largest error of a fault per unit of its trace in sqrt(V'PV), in standard deviations of the error.

    Of a satellite it is |s_i| sigma_i / sqrt(r_i) over the standard deviation of the error (horizontally its larger
    one), s_i the row of the gain and r_i the redundancy number; infinite where a satellite in view is not checked.
    """
    if not parts.checked[parts.in_view].all():
        return float("inf")
    gain_m, redundancy = parts.gain_m[:, parts.in_view], parts.redundancy[parts.in_view]
    sigma_m = np.sqrt(np.linalg.eigvalsh(parts.covariance_m2)[-1])
    return float((np.linalg.norm(gain_m, axis=0) / np.sqrt(redundancy)).max() / sigma_m)


def one_number(geometries: pd.DataFrame) -> pd.DataFrame:
    """The multiplier that serves all geometries of a sky, and the share that it serves with 95 % confidence.

    The upper bounds of N geometries that were drawn alike have a largest one; with confidence 1 - a another such
    geometry needs no more with a probability of at least a^(1/N) (Wilks 1941). It is chosen from the even places; how
    many of the odd ones need more stands beside it.
    """
    rows = []
    for (sky, method), part in _with_multipliers(geometries):
        even, odd = part[part.geometry % 2 == 0], part[part.geometry % 2 == 1]
        chosen = float(even.k_high.max())
        rows.append(
            {
                "sky": sky,
                "method": method,
                "geometries": len(part),
                "k": float(part.k_high.max()),
                "share_kept": (1.0 - CONFIDENCE) ** (1.0 / len(part)),
                "k_of_even": chosen,
                "odd": len(odd),
                "odd_beyond": int((odd.k_high > chosen).sum()),
            }
        )
    return pd.DataFrame(rows)


def by_slope(geometries: pd.DataFrame) -> pd.DataFrame:
    """A multiplier by a formula, log K = c_0 + c_1 s + c_2 s^2 + c_3 / (n - t), s of `largest_slope`.

    Its numbers are fitted to the upper bounds of the even places by least squares, and raised by ``margin``, so that it
    is enough at each of them. How much of the variance of log K it explains at the odd places, and how many of those
    need more than it says, stands beside it, and its mean over all beside the one number of the even places.
    """
    rows = []
    for (sky, method), whole in _with_multipliers(geometries):
        part = whole[np.isfinite(whole.slope) & np.isfinite(whole.k_high)]
        if len(part) < FEWEST or len(part) < len(whole):
            continue
        terms, needed = _terms(part), np.log(part.k_high.to_numpy(float))
        even = part.geometry.to_numpy() % 2 == 0
        numbers = np.linalg.lstsq(terms[even], needed[even], rcond=None)[0]
        rest = needed - terms @ numbers
        margin = float(rest[even].max())
        scatter = float(needed[~even].var())
        rows.append(
            {"sky": sky, "method": method, "geometries": len(part)}
            | dict(zip(("constant", "of_slope", "of_square", "of_dof"), map(float, numbers), strict=True))
            | {
                "margin": float(np.exp(margin)),
                "explained": 1.0 - float(np.mean((rest - rest[even].mean())[~even] ** 2)) / scatter if scatter else 0.0,
                "odd": int((~even).sum()),
                "odd_beyond": int((rest[~even] > margin).sum()),
                "k_mean": float(np.exp(terms @ numbers + margin).mean()),
                "k_of_even": float(part.k_high[even].max()),
            }
        )
    return pd.DataFrame(rows)


def _with_multipliers(geometries: pd.DataFrame) -> list[tuple[tuple[str, str], pd.DataFrame]]:
    """The geometries of each sky and method that has a multiplier."""
    groups = geometries[geometries.k.notna()].groupby(["sky", "method"], sort=False)
    return [((str(key[0]), str(key[1])), part) for key, part in groups]


def _terms(part: pd.DataFrame) -> FloatArray:
    slope, dof = part.slope.to_numpy(float), part.dof.to_numpy(float)
    return np.column_stack([np.ones(len(part)), slope, slope**2, 1.0 / dof])
