"""Table 1 of Guo et al. (2022) beside ours: which reading of which test gives the paper's rates, and which not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize, special

from pl_mc.geometry import Geometry
from pl_mc.report.text import markdown_table, percent, rate_text
from pl_mc.statistics.least_squares import ls_quantities
from pl_mc.statistics.student import chi2_threshold

PAPER_EPOCHS = 2880

# Guo, Xu, Zhang and Gou (2022), Journal of Navigation and Positioning 2022(3): 53-58, section 3 and abstract:
# detection # rates as printed, by test and bias [m].
PRINTED: Mapping[str, Mapping[float, float]] = MappingProxyType(
    {
        "mean_check": MappingProxyType({10.0: 0.480, 20.0: 0.955, 30.0: 0.994}),
        "chi2": MappingProxyType({10.0: 0.0, 20.0: 0.032, 30.0: 0.655}),
    }
)
# Epochs out of 2880: those of T are in the text (2794 of them are 97.0 %, not the printed 95.5 %), those of F
# follow # from the printed rates.
COUNTED: Mapping[str, Mapping[float, int]] = MappingProxyType(
    {
        "mean_check": MappingProxyType({10.0: 1381, 20.0: 2794, 30.0: 2863}),
        "chi2": MappingProxyType({10.0: 0, 20.0: 92, 30.0: 1886}),
    }
)
LINES = {"mean_check": "T", "chi2": "F"}


@dataclass(frozen=True)
class GuoReport:
    """What a run hands to its summary; the tables are those of `pl_mc.studies.guo.run`."""

    title: str
    source: str
    geometry: Geometry
    real: bool
    p_fa: float
    seed: int
    draws: int
    calibration_draws: int
    detection: pd.DataFrame
    drawn: pd.DataFrame
    hypotheses: pd.DataFrame
    factors: pd.DataFrame
    power: pd.DataFrame
    reliable: pd.DataFrame
    power_epoch: int


def paper_rate(test: str, bias_m: float) -> float:
    """The paper's detection rate as printed; NaN where it prints none."""
    return PRINTED.get(test, {}).get(bias_m, np.nan)


def hypothesis_table(drawn: pd.DataFrame) -> pd.DataFrame:
    """Every reading at its nominal threshold beside both lines of the paper's table.

    Args:
        drawn: the table of `pl_mc.studies.guo.series.draws_table`.

    Returns:
        One row per reading, line of the paper (``T`` or ``F``) and bias: ``test, reading, line, bias_m, rate``
        (ours), ``predicted_low, predicted_high`` (95 % range of the rate over the epochs of one draw),
        ``paper_rate`` (epochs counted over 2880), ``difference`` (paper less ours), ``inside`` (whether the paper's
        is in that range).
    """
    rows = []
    for (test, reading), group in drawn[drawn.level == "nominal"].groupby(["test", "reading"], sort=False):
        for line, counted in COUNTED.items():
            for row in group[group.bias_m > 0].itertuples():
                if row.bias_m not in counted:
                    continue
                paper = counted[row.bias_m] / PAPER_EPOCHS
                low, high = row.predicted_low / row.epochs, row.predicted_high / row.epochs
                rows.append(
                    {
                        "test": test,
                        "reading": reading,
                        "line": LINES[line],
                        "bias_m": row.bias_m,
                        "rate": row.detection_rate,
                        "predicted_low": low,
                        "predicted_high": high,
                        "paper_rate": paper,
                        "difference": paper - row.detection_rate,
                        "inside": bool(low <= paper <= high),
                    }
                )
    return pd.DataFrame(rows)


def variance_factors(g: Geometry, faulted_row: NDArray[np.int64], p_fa: float) -> pd.DataFrame:
    """Oversized variance: the factor on all variances at which V'PV detects as often as the paper says, exactly.

    With P made from variances that are ``factor`` times those of the noise, V'PV is a noncentral chi-square divided
    by ``factor``; the rate is its tail beyond the nominal threshold, averaged over the epochs. No simulation.

    Returns:
        One row per line of the paper (``T`` or ``F``) and bias: ``line, bias_m, paper_rate, factor`` that gives it,
        and ``rate_<bias>m``, the rates at all three biases with that factor; of a paper's rate of 0 the factor is
        the smallest at which no detection in 2880 epochs has a probability of at least one half.
    """
    quantities = ls_quantities(g)
    at = np.flatnonzero((faulted_row >= 0) & quantities.available)
    dof = quantities.dof[at].astype(float)
    row = faulted_row[at]
    per_metre = quantities.redundancy[at, row] / g.sigma_m[at, row] ** 2
    threshold = chi2_threshold(dof, p_fa)

    def rate(factor: float, bias_m: float) -> float:
        # The library's tail is good to about 1e-10 absolute: enough for rates that a count can show.
        return float((1.0 - special.chndtr(factor * threshold, dof, bias_m**2 * per_metre)).mean())

    rows = []
    for line, counted in COUNTED.items():
        for bias, count in counted.items():
            wanted = count / PAPER_EPOCHS if count else 1.0 - 0.5 ** (1.0 / PAPER_EPOCHS)

            def excess(log_factor: float, bias: float = bias, wanted: float = wanted) -> float:
                return rate(float(np.exp(log_factor)), bias) - wanted

            factor = float(np.exp(optimize.brentq(excess, np.log(0.1), np.log(50.0), xtol=1e-4)))
            found: dict[str, object] = {
                "line": LINES[line],
                "bias_m": bias,
                "paper_rate": count / PAPER_EPOCHS,
                "factor": factor,
            }
            rows.append(found | {f"rate_{size:g}m": rate(factor, size) for size in counted})
    return pd.DataFrame(rows)


def closest(hypotheses: pd.DataFrame) -> pd.DataFrame:
    """Largest difference of each reading from each line of the paper, and how many of its biases are in range."""
    groups = hypotheses.groupby(["test", "reading", "line"], sort=False)
    return pd.DataFrame(
        {
            "largest": groups.difference.apply(lambda column: column.abs().max()),
            "inside": groups.inside.sum(),
            "biases": groups.inside.size(),
        }
    ).reset_index()


def guo_summary(report: GuoReport) -> str:
    """One screen: false alarms first, then detection at the nominal and at equal false-alarm rates."""
    g, detection = report.geometry, report.detection
    biases = sorted(detection.bias_m.unique())
    letters = np.array(g.systems)[g.satellite]
    counts = {s: (g.in_view & (letters == s)).sum(axis=1) for s in ("G", "C")}
    header = ["test", "reading", "P_FA measured", *(f"{bias:g} m" for bias in biases if bias)]
    tables = []
    for level in ("nominal", "equal_p_fa"):
        rows = []
        for (test, reading), group in detection[detection.level == level].groupby(["test", "reading"], sort=False):
            first = group.iloc[0]
            alarms = round(first.p_fa_measured * first.p_fa_trials)
            cells = [test, reading, rate_text(alarms, int(first.p_fa_trials), first.p_fa_low, first.p_fa_high)]
            cells += [
                rate_text(row.detections, row.epochs, row.low, row.high) for row in group.itertuples() if row.bias_m
            ]
            rows.append([str(cell) for cell in cells])
        if level == "nominal":
            for test, line in LINES.items():
                printed = [f"{100 * paper_rate(test, bias):.1f} %" for bias in biases if bias]
                rows.append([f"paper, {line}", "as printed", "-", *printed])
        tables.append(markdown_table(header, rows))
    whose = "the receiver's own errors, fault-free" if report.real else "drawn noise without a fault"
    near = closest(report.hypotheses)
    lines = [
        f"# {report.title}",
        "",
        f"{report.source}. {len(g)} epochs, {counts['G'].min()}-{counts['G'].max()} GPS and "
        f"{counts['C'].min()}-{counts['C'].max()} BeiDou satellites; the bias on the least detectable BeiDou "
        f"satellite (largest MDB) of each epoch. Nominal P_FA {percent(report.p_fa)} %, seed {report.seed}. Rates "
        "with 95 % Clopper-Pearson bounds; `0 (< x %)` is the upper bound where nothing was seen. P_FA is that of "
        f"{whose}.",
        "",
        "At the nominal thresholds, each with the false-alarm rate that it happens to have (not comparable):",
        "",
        tables[0],
        "",
        "At thresholds of equal false-alarm rate (comparable):",
        "",
        tables[1],
        "",
        "Lines of the paper that a reading comes within 10 points of at every bias: "
        + (
            "; ".join(
                f"{row.test} ({row.reading}) and {row.line}, largest difference {100 * row.largest:.1f} points"
                for row in near[near.largest < 0.10].itertuples()
            )
            or "none"
        )
        + ".",
    ]
    return "\n".join(lines) + "\n"
