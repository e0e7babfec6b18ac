"""Curves of the probability against the size, from one sample, on an event whose probabilities are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from pl_mc.alert import AlertLimits
from pl_mc.integrity_risk.rare.limit_state import LimitState, rotation
from pl_mc.integrity_risk.worst.bias_curve import (
    LEAST_ESS,
    SIZES_M,
    BiasCurve,
    Region,
    Shared,
    coarse_curve,
    explore,
    finer_curve,
)
from pl_mc.methods import Ls
from reference.problems import appendix_d

# One in a million, over all sizes that are looked at.
SIGMAS = 4.9


@dataclass(frozen=True)
class _Beyond:
    """The event that the first coordinate is beyond a limit, and the second within another; six coordinates."""

    limit: float = 7.0
    width: float = 3.0
    active: int = 6
    dimension: int = 8

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return np.minimum(points[:, 0] - self.limit, self.width - np.abs(points[:, 1]))

    def probability(self, trace: np.ndarray, size_m: np.ndarray) -> np.ndarray:
        first, second = size_m * trace[0], size_m * trace[1]
        inside = stats.norm.cdf(self.width - second) - stats.norm.cdf(-self.width - second)
        return stats.norm.sf(self.limit - first) * inside


@pytest.fixture(scope="module")
def curve() -> tuple[Region, np.ndarray, list, BiasCurve]:
    """Risk that grows with the first coordinate, and falls again as the second leaves: largest between."""
    region = Region(_Beyond(), np.array([[0.12, 0.16, 0.05, 0.0, 0.0, 0.0]]))  # type: ignore[arg-type]
    trace = region.traces[0]
    rng = np.random.default_rng(4)
    found = [explore(region, size * trace, rng) for size in SIZES_M]
    shared = Shared.of(found, SIZES_M[:, None] * trace)
    return region, trace, found, coarse_curve(region, found, shared, trace, rng)


def test_one_sample_tells_every_size(curve: tuple) -> None:
    region, trace, found, coarse = curve
    sizes = np.union1d(SIZES_M, [3.3, 9.0, 22.0, 33.0])
    value, error, ess = coarse.at(sizes)
    truth = region.limit.probability(trace, sizes)
    known = ess >= LEAST_ESS
    # Down to 1e-10, without having sampled for the sizes between those of the grid.
    assert known[sizes <= 40.0].all()
    assert (np.abs(value - truth)[known] < SIGMAS * error[known]).all()
    np.testing.assert_array_equal(np.isnan(coarse.known(sizes)), ~known)
    # Those that cannot be told are out of question.
    assert (truth[~known] < truth.max()).all()
    assert np.isin(coarse.open_sizes(found), sizes[~known]).all()


def test_the_finer_curve_finds_the_top(curve: tuple) -> None:
    region, trace, _, coarse = curve
    fine = finer_curve(region, coarse, 15.0, 25.0, np.random.default_rng(5))
    sizes = np.linspace(15.0, 25.0, 41)
    value, error, _ = fine.at(sizes)
    truth = region.limit.probability(trace, sizes)
    assert (np.abs(value - truth) < SIGMAS * error).all()
    assert (error < 0.03 * value).all()
    assert truth[value.argmax()] > 0.95 * truth.max()
    assert fine.evaluations > coarse.samples[0].draws


def test_a_fault_shifts_the_limit_state() -> None:
    """Of a fault and noise the limit state is that of no fault at the shifted point."""
    g = appendix_d(noise=3.0)
    region = Region.of(g, Ls(), "misleading", AlertLimits("test", vertical_m=35.0, horizontal_m=40.0))
    bias = np.zeros(len(g.names))
    bias[2] = 7.0
    design, sigma, seen = np.asarray(g.design), np.asarray(g.sigma_m), np.ones(len(g.names), dtype=bool)
    plain = rotation(design, sigma, seen, np.zeros(len(g.names)))
    faulted = LimitState(design, sigma, seen, bias, Ls(), "misleading", 35.0, plain)
    points = np.random.default_rng(6).standard_normal((200, plain.matrix.shape[1]))
    shifted = region.shifted(7.0 * region.traces[2])
    np.testing.assert_allclose(shifted(points), faulted(points), rtol=0, atol=1e-9)
