"""Gaussian overbounds of measured errors, with a confidence: what the data show, and how far down they show it.

A Gaussian N(b, sigma) on the right and N(-b, sigma) on the left bound the tails of a distribution F where their tails
hold more: 1 - Phi((x - b) / sigma) >= 1 - F(x) for x >= b, and likewise on the left (DeCleene 2000, Defining
pseudorange integrity - overbounding, ION GPS 2000; paired: Rife, Walter & Blanch 2004; with a bias and a first step by
a symmetric unimodal distribution: Blanch, Walter & Enge 2018, Gaussian bounding improvements, ION ITM 2018).

F is known by its samples. The m-th largest of n independent samples is exceeded with a probability that has the beta
distribution of m and n + 1 - m, whatever F is; upper quantiles of these, at one level for all m chosen such that all of
them hold together with the confidence, bound the tail as far as the largest sample. Between two of them the tail is no
larger than at the lower one. Nothing bounds it beyond the largest: there the Gaussian is extrapolated.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pl_mc.constants import K_VERTICAL

# Fewer independent samples bound no tail.
FEWEST_SAMPLES = 20

# Ranks from the largest on that are all used, and the step to further ones.
_ALL_RANKS, _RANK_FACTOR = 20, 1.05
# Tails from here on are the middle of a distribution, which belongs to the bias.
_MIDDLE = 0.45
# Draws by which the level of a band is found, of numbers that are the same in every run.
_BAND_DRAWS, _BAND_SEED = 5_000, 1934
# Biases that are tried, and how far above the smallest [standard deviations].
_BIASES, _MORE_BIAS = 11, 0.1


@dataclass(frozen=True)
class Bound:
    """An overbound of one set of samples.

    Attributes:
        sigma_m, bias_m: the Gaussians, N(+-b, sigma), of both tails.
        left_m, right_m: sigma that each tail alone needs with that bias (paired).
        shown_to: tail probability at the largest sample as the band has it; beyond that the bound is extrapolated.
        unimodal: whether a distribution that is symmetric and unimodal about the bias can lie between the bound and
            the samples, as sums of several errors need it (first of the two steps).
    """

    sigma_m: float
    bias_m: float
    left_m: float
    right_m: float
    shown_to: float
    unimodal: bool


def overbound(values_m: NDArray[np.float64], independent: int, confidence: float, *, with_bias: bool) -> Bound:
    """The overbound of samples.

    The bias is as small as the middle of the samples admits, and up to a tenth of their standard deviation more where
    that makes b + 5.33 sigma smaller, an error at the vertical multiplier. More would buy a narrow Gaussian, and with
    it an extrapolation that nothing holds.

    Args:
        values_m: (k,), samples [m].
        independent: independent samples that they are worth, at least `FEWEST_SAMPLES`.
        confidence: probability that both tails are bounded as far as the samples go.
        with_bias: whether there is one; without, both tails are taken for alike, about zero.
    """
    # Both sides, each with half of what may fail; alike tails are one side.
    side = confidence if not with_bias else 0.5 * (1.0 + confidence)
    ranks = _ranks(independent)
    tail = band(independent, side)
    if not with_bias:
        size = _at_ranks(np.abs(values_m), ranks, independent)
        sigma = float(np.max(size[:-1] / special.ndtri(1.0 - 0.5 * tail[1:])))
        return Bound(sigma, 0.0, sigma, sigma, 0.5 * float(tail[1]), _unimodal(values_m, 0.0, sigma, independent))
    usable = tail[1:] < _MIDDLE
    z = special.ndtri(1.0 - tail[1:][usable])
    tops = [_at_ranks(sign * values_m, ranks, independent) for sign in (-1.0, 1.0)]
    # Where the band does not tell which side of the median a sample is on, it is within the bias.
    lowest = max(0.0, *(float(top[:-1][~usable].max(initial=-np.inf)) for top in tops))
    best = (np.inf, 0.0, 0.0, 0.0)
    for bias in lowest + _MORE_BIAS * float(values_m.std()) * np.linspace(0.0, 1.0, _BIASES):
        left, right = (float(np.max((top[:-1][usable] - bias) / z, initial=0.0)) for top in tops)
        best = min(best, (bias + K_VERTICAL * max(left, right), float(bias), left, right))
    _, bias, left, right = best
    sigma = max(left, right)
    return Bound(sigma, bias, left, right, float(tail[1]), _unimodal(values_m, bias, sigma, independent))


def _ranks(count: int) -> NDArray[np.int64]:
    """Ranks from the largest sample to the one in the middle."""
    further = _ALL_RANKS * _RANK_FACTOR ** np.arange(1, 400)
    ranks = np.unique(np.concatenate([np.arange(1, _ALL_RANKS + 1), further.astype(np.int64)]))
    return ranks[ranks <= (count + 1) // 2 + 1]


@functools.lru_cache(maxsize=256)
def band(count: int, confidence: float) -> NDArray[np.float64]:
    """(ranks,), what the tail beyond the sample of each rank does not exceed, all together with the confidence.

    The level of each is the same (equal local levels), found from uniform samples, whose order statistics are sums of
    gamma variates.
    """
    ranks = _ranks(count)
    gaps = np.diff(np.concatenate([[0], ranks, [count + 1]]))
    sums = np.cumsum(np.random.default_rng(_BAND_SEED).standard_gamma(gaps, (_BAND_DRAWS, gaps.size)), axis=1)
    tail = sums[:, :-1] / sums[:, -1:]
    # Smallest upper probability of each draw; the band fails where the level is larger. It takes long, and is computed
    # for the few draws that may have it: those that are beyond the band of a level at which more of them fail.
    share = 1.0 - confidence
    few, bound = np.ones(_BAND_DRAWS, dtype=bool), share
    while (beyond := (tail > special.betainccinv(ranks, count + 1 - ranks, bound)).any(axis=1)).sum() > (
        1.1 * share * _BAND_DRAWS + 2
    ):
        few, bound = beyond, bound / 1.5
    least = np.ones(_BAND_DRAWS)
    least[few] = special.betaincc(ranks, count + 1 - ranks, tail[few]).min(axis=1)
    level = float(np.quantile(least, share))
    return special.betainccinv(ranks, count + 1 - ranks, level)


def _at_ranks(values: NDArray[np.float64], ranks: NDArray[np.int64], independent: int) -> NDArray[np.float64]:
    """The samples at ranks of as many as are independent, each the largest of those that count as one."""
    ordered = np.sort(values)[::-1]
    return ordered[np.minimum((ranks - 1) * values.size // independent, values.size - 1)]


def _unimodal(values: NDArray[np.float64], bias: float, sigma: float, independent: int) -> bool:
    """Whether a symmetric unimodal distribution about +bias, and one about -bias, goes between bound and samples.

    On the right of the bias its tail is convex, no larger than the Gaussian's nor than that of the samples on the other
    side, and at least that of the samples there, with what a band of 95 % (DKW) leaves open; such a tail is there where
    the largest convex one below the two upper ones is above the lower one.
    """
    tolerance = np.sqrt(0.5 * np.log(2.0 / 0.05) / independent)
    for sign in (-1.0, 1.0):
        ordered = np.sort(sign * values)
        size = np.linspace(0.0, ordered[-1] - bias, 200) if ordered[-1] > bias else np.zeros(1)
        right = 1.0 - np.searchsorted(ordered, bias + size, side="right") / ordered.size
        left = np.searchsorted(ordered, bias - size, side="left") / ordered.size
        upper = np.minimum(special.ndtr(-size / sigma), left + tolerance) if sigma > 0 else right
        if (_convex_below(size, upper) < right - tolerance).any():
            return False
    return True


def _convex_below(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest convex function below points, at their places (the lower hull)."""
    kept: list[int] = []
    for k in range(x.size):
        while len(kept) > 1 and (y[kept[-1]] - y[kept[-2]]) * (x[k] - x[kept[-2]]) >= (y[k] - y[kept[-2]]) * (
            x[kept[-1]] - x[kept[-2]]
        ):
            kept.pop()
        kept.append(k)
    return np.interp(x, x[kept], y[kept])
