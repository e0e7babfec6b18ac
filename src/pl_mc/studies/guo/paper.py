"""Table 1 of Guo et al. (2022) beside ours: which reading of which test gives the paper's rates, and which not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special

from pl_mc.engine.detect_runs import NOMINAL
from pl_mc.geometry import Geometry
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.noncentral import split_at_threshold
from pl_mc.statistics.student import chi2_threshold

PAPER_EPOCHS = 2880

# Guo, Xu, Zhang and Gou (2022), Journal of Navigation and Positioning 2022(3): 53-58, section 3 and abstract:
# detection rates as printed, by test and bias [m].
PRINTED: Mapping[str, Mapping[float, float]] = {
    "mean_check": {10.0: 0.480, 20.0: 0.955, 30.0: 0.994},
    "chi2": {10.0: 0.0, 20.0: 0.032, 30.0: 0.655},
}
# Epochs out of 2880: those of T are in the text (2794 of them are 97.0 %, not the printed 95.5 %), those of F
# follow from the printed rates.
COUNTED: Mapping[str, Mapping[float, int]] = {
    "mean_check": {10.0: 1381, 20.0: 2794, 30.0: 2863},
    "chi2": {10.0: 0, 20.0: 92, 30.0: 1886},
}
# What the paper calls the statistics.
LETTERS = {"mean_check": "T", "chi2": "F"}


def paper_rate(test: str, bias_m: float) -> float:
    """The paper's detection rate as printed; NaN where it prints none."""
    return PRINTED.get(test, {}).get(bias_m, np.nan)


def per_square_metre(g: Geometry, at: Any) -> NDArray[np.float64]:
    """Noncentrality of V'PV for each square metre of a bias on rows, which are given by their places in arrays."""
    return np.asarray(ls_quantities(g).redundancy[at] / g.sigma_m[at] ** 2)


def chi2_detection(dof: ArrayLike, p_fa: float, noncentrality: ArrayLike) -> NDArray[np.float64]:
    """Exact detection rate of V'PV at its nominal threshold."""
    return split_at_threshold(chi2_threshold(dof, p_fa), dof, noncentrality)[1]


def hypothesis_table(drawn: pd.DataFrame) -> pd.DataFrame:
    """Every reading at its nominal threshold beside both lines of the paper's table.

    Args:
        drawn: the table ``drawn`` of `pl_mc.studies.guo.series.Day`.

    Returns:
        One row per reading, line of the paper (``T`` or ``F``) and bias: ``test, reading, line, bias_m, rate``
        (ours), ``predicted_low, predicted_high`` (95 % range of the rate over the epochs of one draw),
        ``paper_rate`` (epochs counted over 2880), ``difference`` (paper less ours), ``inside`` (whether the paper's
        is in that range).
    """
    paper = pd.DataFrame(
        [(LETTERS[test], bias, n / PAPER_EPOCHS) for test, line in COUNTED.items() for bias, n in line.items()],
        columns=["line", "bias_m", "paper_rate"],
    )
    ours = drawn[drawn.level == NOMINAL].rename(columns={"detection_rate": "rate"})
    ours[["predicted_low", "predicted_high"]] = ours[["predicted_low", "predicted_high"]].div(ours.epochs, axis=0)
    table = ours.assign(order=ours.groupby(["test", "reading"], sort=False).ngroup()).merge(paper, on="bias_m")
    # Reading by reading, and of each the lines as the paper has them.
    table = table.sort_values(["order", "line", "bias_m"], ascending=[True, False, True], ignore_index=True)
    table["difference"] = table.paper_rate - table.rate
    table["inside"] = table.paper_rate.between(table.predicted_low, table.predicted_high)
    columns = ["test", "reading", "line", "bias_m", "rate", "predicted_low", "predicted_high"]
    return table[[*columns, "paper_rate", "difference", "inside"]]


def closest(hypotheses: pd.DataFrame) -> pd.DataFrame:
    """Largest difference of each reading from each line of the paper: ``test, reading, line, largest``."""
    size = hypotheses.assign(largest=hypotheses.difference.abs())
    return size.groupby(["test", "reading", "line"], sort=False).largest.max().reset_index()


def variance_factors(g: Geometry, faulted_row: NDArray[np.int64], p_fa: float) -> pd.DataFrame:
    """Oversized variance: the factor on all variances at which V'PV detects as often as the paper says, exactly.

    With P made from variances that are ``factor`` times those of the noise, V'PV is a noncentral chi-square divided
    by ``factor``; the rate is its tail beyond the nominal threshold, averaged over the epochs. No simulation.

    Returns:
        One row per line of the paper (``T`` or ``F``) and bias: ``line, bias_m, paper_rate, factor`` that gives it,
        and ``rate_<bias>m``, the rates at all three biases with that factor; of a paper's rate of 0 the factor is
        the smallest at which no detection in 2880 epochs has a probability of at least one half.
    """
    from scipy import optimize

    quantities = ls_quantities(g)
    at = np.flatnonzero((faulted_row >= 0) & quantities.available)
    dof = quantities.dof[at].astype(float)
    per_metre = per_square_metre(g, (at, faulted_row[at]))
    threshold = chi2_threshold(dof, p_fa)

    def rate(factor: float, bias_m: float) -> float:
        # The library's tail is good to about 1e-10 absolute: enough for rates that a count can show.
        return float((1.0 - special.chndtr(factor * threshold, dof, bias_m**2 * per_metre)).mean())

    def excess(log_factor: float, bias_m: float, wanted: float) -> float:
        return rate(float(np.exp(log_factor)), bias_m) - wanted

    rows = []
    for line, counted in COUNTED.items():
        for bias, count in counted.items():
            wanted = count / PAPER_EPOCHS if count else 1.0 - 0.5 ** (1.0 / PAPER_EPOCHS)
            bounds = np.log(0.1), np.log(50.0)
            factor = float(np.exp(optimize.brentq(excess, *bounds, args=(bias, wanted), xtol=1e-4)))
            row = {"line": LETTERS[line], "bias_m": bias, "paper_rate": count / PAPER_EPOCHS, "factor": factor}
            rows.append(row | {f"rate_{size:g}m": rate(factor, size) for size in counted})
    return pd.DataFrame(rows)
