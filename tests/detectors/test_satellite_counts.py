"""The stored rates of Guo's tests against the number of BeiDou satellites, held to their laws for every part of BeiDou.

Each T_i of `shift_kept` is the size of a Gaussian: the largest of the probabilities that one of them passes the
threshold is a lower bound of the detection rate, their sum an upper one. V'PV is noncentral chi-square. Nothing here
uses a kernel or a detector.
"""

from __future__ import annotations

import functools
import importlib.util
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import special, stats

from pl_mc.studies.guo.series import GuoSeries

ROOT = Path(__file__).parents[2]
VARIANCES_M2 = np.array([2.5, 4.5])
P_FA = 0.01
BIASES_M = (10.0, 20.0, 30.0)
TABLE = pd.read_csv(ROOT / "results" / "guo2022-satellites" / "rates.csv")
PARTS = list(dict.fromkeys(TABLE.part))
ONE_SIDED = "shift_kept, one-sided"
# Stored rates are means of 64 draws at each of 288 epochs: at most a binomial's spread. 90 rates are compared.
DRAWS, SPREADS = 18_432, 4.5

spec = importlib.util.spec_from_file_location("guo_satellites", ROOT / "benchmarks" / "guo_satellites.py")
assert spec is not None
assert spec.loader is not None
guo_satellites = importlib.util.module_from_spec(spec)
spec.loader.exec_module(guo_satellites)


def stored(part: str, reading: str, bias_m: float) -> pd.Series:
    rows = TABLE[(TABLE.part == part) & (TABLE.reading == reading) & (TABLE.bias_m == bias_m)]
    (row,) = (one for _, one in rows[rows.level == "nominal"].iterrows())
    assert row.draws == DRAWS
    return row


@functools.cache
def thresholds(gps: int, bds: int) -> tuple[float, float]:
    """Of T, two-sided and one-sided, by Welch's degrees of freedom."""
    sizes = np.array([gps, bds])
    parts = VARIANCES_M2 / sizes
    two_sided, one_sided = stats.t.isf([P_FA / 2, P_FA], parts.sum() ** 2 / (parts**2 / (sizes - 1)).sum())
    return float(two_sided), float(one_sided)


@functools.cache
def chi2_threshold(dof: int) -> float:
    return float(stats.chi2.isf(P_FA, dof))


def laws_at(series: GuoSeries, epoch: int) -> dict[tuple[str, float], tuple[float, float]]:
    """(reading, bias): bounds of the probability of detection at one epoch, equal for V'PV."""
    g = series.geometry
    seen = np.flatnonzero(g.in_view[epoch])
    design, sigma = np.asarray(g.design[epoch])[seen], np.asarray(g.sigma_m[epoch])[seen]
    gps = np.array([g.names[k][0] == "G" for k in g.satellite[epoch][seen]])
    faulted = int(np.flatnonzero(seen == series.faulted_row[epoch])[0])
    n, t = design.shape
    sizes = np.array([gps.sum(), n - gps.sum()])
    parts = VARIANCES_M2 / sizes
    limits = thresholds(*sizes.tolist())
    # A shift of its own for satellite i is a fit without it. K_i is row i times the errors.
    weights = (1.0 - np.eye(n)) / sigma**2
    gains = np.linalg.solve(np.einsum("ij,jt,ju->itu", weights, design, design), design.T * weights[:, None])
    mean = np.where(gps, -1.0 / sizes[0], 1.0 / sizes[1])
    rows = np.einsum("j,jt,itk->ik", mean, design, gains) - mean
    spread = np.sqrt(((rows * sigma) ** 2).sum(axis=1))
    whole = np.linalg.solve(design.T / sigma**2 @ design, design.T / sigma**2)
    redundancy = 1.0 - design[faulted] @ whole[:, faulted]
    found = {}
    powers = stats.ncx2.sf(chi2_threshold(n - t), n - t, (np.array(BIASES_M) / sigma[faulted]) ** 2 * redundancy)
    for bias, power in zip(BIASES_M, powers, strict=True):
        found["apriori", bias] = power, power
        for reading, limit in zip(("shift_kept", ONE_SIDED), limits, strict=True):
            ends = limit * np.sqrt(parts.sum()) * np.array([[1.0], [-1.0]]) - bias * rows[:, faulted]
            passes = special.ndtr(-ends[0] / spread) + special.ndtr(ends[1] / spread)
            found[reading, bias] = passes.max(), min(passes.sum(), 1.0)
    return found


@pytest.mark.parametrize("part", PARTS)
def test_stored_rates_follow_their_laws(part: str) -> None:
    series = guo_satellites.series_of(part)
    first = TABLE[TABLE.part == part].iloc[0]
    assert guo_satellites.satellites_of(series.geometry) == {"G": first.gps, "C": first.bds}
    epochs = [laws_at(series, epoch) for epoch in range(len(series.geometry))]
    assert len(epochs) == 288
    for key in epochs[0]:
        low, high = np.mean([one[key] for one in epochs], axis=0)
        rate = stored(part, *key).detection_rate
        for bound, sign in ((low, 1.0), (high, -1.0)):
            room = SPREADS * np.sqrt(bound * (1.0 - bound) / DRAWS) + SPREADS / DRAWS
            assert sign * (rate - bound) > -room, (key, rate, low, high)
        # The bounds are close enough to say something.
        assert high < 1.3 * low + 0.005, (key, low, high)


def test_the_verdict_hangs_on_the_number_of_satellites() -> None:
    """What the page says of T at 30 m, and of F; its table is that of the stored rates."""
    two_sided, one_sided = (
        [stored(part, one, 30.0).detection_rate for part in PARTS] for one in ("shift_kept", ONE_SIDED)
    )
    assert [round(100 * min(two_sided), 1), round(100 * max(two_sided), 1)] == [0.5, 99.6]
    assert min(stored(part, "apriori", 30.0).detection_rate for part in PARTS) > 0.99
    assert min(one_sided) < 0.655 < max(one_sided)
    page = (ROOT / "results" / "guo2022.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| .* \| (\d+) \| (\S+ / .*) \| (\S+ / .*) \| (\S+ / .*) \|$", page, flags=re.M)
    assert len(lines) == len(PARTS)
    for part, (bds, *cells) in zip(PARTS, lines, strict=True):
        for reading, cell in zip(("apriori", "shift_kept", ONE_SIDED), cells, strict=True):
            for bias, text in zip(BIASES_M, cell.split(" / "), strict=True):
                row = stored(part, reading, bias)
                decimals = len(text.partition(".")[2])
                assert abs(100 * row.detection_rate - float(text)) <= 0.5 * 10**-decimals + 1e-9, (part, reading, bias)
                assert row.bds == int(bds)
