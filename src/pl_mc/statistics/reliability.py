"""Reliability after Baarda: which fault a test can find, and what one that it just misses does to the height.

Baarda (1968); Guo et al. (2022), equations 3-13 and 22-23. The text of the latter has the redundancy numbers the
wrong way round (it calls r = 1 a necessary observation and r = 0 a redundant one): r_i near 0 is an observation
that the others hardly check.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from pl_mc.arrays import FloatArray, ordinary_arithmetic
from pl_mc.geometry.record import SYSTEM_NAMES, Geometry, require_geometry
from pl_mc.input_errors import InputError, require_choice, require_fraction, shown
from pl_mc.kernels.linear_model import REDUNDANCY_FLOOR
from pl_mc.statistics.least_squares import ls_quantities

# A satellite that moves the height by less than this share of its error does not move it: the rest is rounding.
_NO_EFFECT = 1e-12


@ordinary_arithmetic
def reliability(g: Geometry, p_fa: float = 1e-3, power: float = 0.8) -> pd.DataFrame:
    """Internal and external reliability of every satellite in view, for one alternative hypothesis at a time.

    Args:
        g: the geometry, one epoch or a series; weights are P = diag(1 / sigma^2).
        p_fa: false-alarm probability of the two-sided test of one satellite's residual.
        power: probability with which that test finds a bias of the size ``mdb_m``.

    Returns:
        One row per epoch and satellite in view: ``epoch`` (for a series alone), ``name``,
        ``redundancy``: r_i, diagonal of I - A N^-1 A'P; over the satellites they sum to n - t.
        ``mdb_m``: minimal detectable bias, delta0 sigma_i / sqrt(r_i) (Guo et al. eq 23) [m]; infinite where
        nothing checks the satellite.
        ``vertical_effect_m``: external reliability, |s_U,i| MDB, the vertical error that such a bias causes, with
        s_U the vertical row of N^-1 A'P [m]; infinite where the bias is and moves the height.
        ``slope``: |s_U,i| sigma_i / sqrt(r_i), the vertical error [m] that a bias causes per unit of the square
        root of the noncentrality of V'PV (the slope of classical RAIM, for a statistic without unit); infinite
        likewise. All are missing at an epoch whose satellites do not determine the unknowns.

    Raises:
        InputError: a probability outside (0, 1), or a power that is not above ``p_fa``.

    Example:
        >>> import pl_mc
        >>> g = pl_mc.simulate(site="CUT0", constellations="GPS", epochs=1)[0]
        >>> pl_mc.reliability(g).head(2).round(2)
          name  redundancy  mdb_m  vertical_effect_m  slope
        0  G01        0.55   5.60               2.01   0.49
        1  G03        0.65   7.64               3.03   0.73
    """
    shift = noncentral_shift(p_fa, power)
    series = require_geometry(g).as_series()
    quantities = ls_quantities(series)
    determined = ~np.isnan(quantities.vdop_m)[:, None]
    redundancy = np.where(determined, np.clip(quantities.redundancy, 0.0, 1.0), np.nan)
    checked = redundancy >= REDUNDANCY_FLOOR
    per_unit_m = np.where(checked, series.sigma_m / np.sqrt(np.where(checked, redundancy, 1.0)), np.inf)
    per_unit_m = np.where(determined, per_unit_m, np.nan)
    gain = np.abs(quantities.gain)
    # A satellite alone in its system moves its own clock and nothing else, however large its error.
    moves = ~(gain < _NO_EFFECT)
    slope = np.where(moves, gain * np.where(moves, per_unit_m, 0.0), 0.0)
    place, row = np.nonzero(series.in_view)
    columns: dict[str, object] = {"epoch": series.epoch[place]} if g.is_series else {}
    return pd.DataFrame(
        columns
        | {
            "name": np.array(g.names, dtype=object)[series.satellite[place, row]],
            "redundancy": redundancy[place, row],
            "mdb_m": shift * per_unit_m[place, row],
            "vertical_effect_m": shift * slope[place, row],
            "slope": slope[place, row],
        }
    )


@ordinary_arithmetic
def reliability_matrix(g: Geometry) -> FloatArray:
    """R = Qvv P = I - A N^-1 A'P, (..., n, n), with which V = A dX - L = -R e (Guo et al. 2022, eqs 7-8).

    Column j is what one metre of error on satellite j does to all residuals, with the sign turned; the diagonal
    holds the redundancy numbers. Rows and columns of padding are zero; NaN where the unknowns are not determined.

    Args:
        g: the geometry, one epoch or a series.
    """
    quantities = ls_quantities(g)
    seen = np.asarray(g.in_view)
    sigma = np.where(seen, np.asarray(g.sigma_m), 1.0)
    hat = np.einsum("...ik,...jk->...ij", quantities.basis, quantities.basis)
    whitened = np.eye(hat.shape[-1]) * seen[..., None] - hat
    matrix = whitened * sigma[..., :, None] / sigma[..., None, :]
    return np.where(np.isnan(quantities.vdop_m)[..., None, None], np.nan, matrix)


@ordinary_arithmetic
def noncentral_shift(p_fa: float = 1e-3, power: float = 0.8) -> float:
    """delta0: the mean at which a two-sided test of a normal variable of unit variance has that power.

    Both tails count. 4.132147965 for (0.001, 0.80); lambda0 = delta0^2 = 17.0746468 (Baarda).

    Raises:
        InputError: a probability outside (0, 1), or a power that is not above ``p_fa``, which every mean has.
    """
    from scipy import optimize

    if require_fraction(power, field="power") <= require_fraction(p_fa, field="p_fa"):
        raise InputError(f"power: it lies above p_fa ({p_fa:g}), which a test has without a bias, not {shown(power)}.")
    limit = -special.ndtri(p_fa / 2.0)
    if not np.isfinite(limit):
        raise InputError(f"p_fa: {shown(p_fa)} is too small to compute with.")

    def excess(shift: float) -> float:
        return float(special.ndtr(shift - limit) + special.ndtr(-shift - limit) - power)

    return float(optimize.brentq(excess, 0.0, limit + 40.0, xtol=1e-14, rtol=1e-14))


@ordinary_arithmetic
def least_detectable(g: Geometry, *, system: str | None = None) -> NDArray[np.int64]:
    """(...), row of the satellite with the largest MDB at each epoch, of one system where ``system`` names it.

    The order of the satellites by MDB is that of sigma_i / sqrt(r_i): it depends on no probability. Satellites that
    nothing checks do not count: no test of residuals can find their fault. -1 where no satellite is left.
    """
    series = require_geometry(g).as_series()
    quantities = ls_quantities(series)
    letters = np.array(series.systems)[series.satellite]
    counted = series.in_view & (quantities.redundancy >= REDUNDANCY_FLOOR) & ~np.isnan(quantities.vdop_m)[:, None]
    if system is not None:
        require_choice(system, SYSTEM_NAMES, field="system")
        counted &= letters == system
    size = np.where(counted, series.sigma_m / np.sqrt(np.where(counted, quantities.redundancy, 1.0)), -np.inf)
    row = np.where(counted.any(axis=1), size.argmax(axis=1), -1)
    return row if g.is_series else np.asarray(row[0])
