"""Importance sampling on events whose probability is known, and the mixtures that it draws from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pl_mc.integrity_risk.rare.importance import Tally, importance_sampling
from pl_mc.integrity_risk.rare.mixture import Mixture, fit, join, normal
from reference.known_events import CORNERS, FAR_HALF_SPACE, HALF_SPACE, NEVER, SHELL, Known


def two_components() -> Mixture:
    root = np.array([[[1.0, 0.0], [0.5, 0.8]], [[2.0, 0.0], [-0.3, 0.6]]])
    return Mixture(np.array([0.3, 0.7]), np.array([[0.0, 1.0], [6.0, -2.0]]), root, np.array([8.0, np.inf]))


def test_the_density_is_that_of_the_distributions() -> None:
    mixture = two_components()
    points = np.random.default_rng(1).normal(2.0, 4.0, (50, 2))
    scale = mixture.root @ np.swapaxes(mixture.root, 1, 2)
    expected = 0.3 * stats.multivariate_t(mixture.mean[0], scale[0], df=8.0).pdf(points)
    expected = expected + 0.7 * stats.multivariate_normal(mixture.mean[1], scale[1]).pdf(points)
    np.testing.assert_allclose(mixture.log_density(points), np.log(expected), rtol=1e-10)


def test_draws_have_the_density() -> None:
    """Weighted by another density over their own, they give that one's mass (1) and mean within 5 errors."""
    mixture = join([(0.5, two_components()), (0.5, normal(6.0, 2))])
    points = mixture.draw(np.random.default_rng(2), 200_000)
    target = stats.multivariate_normal([3.0, -1.0], np.eye(2))
    weight = np.exp(target.logpdf(points) - mixture.log_density(points))
    for values, expected in ((weight, 1.0), (weight * points[:, 0], 3.0), (weight * points[:, 1], -1.0)):
        assert abs(values.mean() - expected) < 5.0 * values.std() / np.sqrt(len(values))


def test_a_fit_keeps_a_small_region() -> None:
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.normal(0.0, 1.0, (2000, 4)), rng.normal(12.0, 1.0, (20, 4))])
    mixture = fit(points, rng, 8)
    near = np.linalg.norm(mixture.mean - 12.0, axis=1) < 3.0
    assert near.any()
    assert mixture.share[near].sum() >= 0.9 * 0.1 / 8
    assert mixture.share.sum() == pytest.approx(1.0)


def test_sums_of_weights_of_any_size() -> None:
    """In parts, far below the smallest double and with a part that holds nothing, as all at once."""
    log_weight = -2000.0 + np.random.default_rng(4).normal(0.0, 3.0, 300)
    parts, whole = Tally(), Tally()
    for part in np.split(np.sort(log_weight), [7, 150]):
        parts.add(part, 1000)
    parts.add(np.empty(0), 500)
    whole.add(log_weight, 3500)
    weight = np.exp(log_weight + 2000.0)
    assert parts.first * np.exp(parts.log_scale + 2000.0) == pytest.approx(weight.sum())
    assert parts.relative_error == pytest.approx(whole.relative_error)
    # The standard error of a mean of 3500 numbers, 3200 of them zero.
    everything = np.concatenate([weight, np.zeros(3200)])
    assert whole.relative_error == pytest.approx(everything.std() / np.sqrt(3500) / everything.mean())
    assert Tally().relative_error == np.inf
    assert Tally().probability == 0.0
    parts.merge(whole)
    assert parts.draws == 7000
    assert parts.probability == pytest.approx(whole.probability)


@pytest.mark.parametrize(
    "known", [HALF_SPACE, CORNERS, SHELL, FAR_HALF_SPACE], ids=["half-space", "four regions", "shell", "8e-24"]
)
def test_known_probabilities(known: Known) -> None:
    run = importance_sampling(known, np.random.default_rng(5), target_cov=0.05, most_evaluations=2_000_000)
    assert run.standard_error <= 0.05 * run.probability
    assert run.evaluations <= 2_000_000
    # 4.9 standard errors: 1e-6, two-sided.
    assert abs(run.probability - known.probability) < 4.9 * run.standard_error
    assert run.ess >= 1.0 / 0.05**2 * 0.9


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Errors over their standard errors, over seeds: about standard normal."""
    deviations = []
    for seed in range(4):
        run = importance_sampling(
            HALF_SPACE, np.random.default_rng(100 + seed), target_cov=0.1, most_evaluations=1_000_000
        )
        deviations.append((run.probability - HALF_SPACE.probability) / run.standard_error)
    # Their sum of squares is chi-square with 4 degrees of freedom: both tails at 1e-4.
    total = float(np.sum(np.square(deviations)))
    assert stats.chi2.ppf(1e-4, 4) < total < stats.chi2.isf(1e-4, 4)


def test_nothing_found_is_no_number() -> None:
    run = importance_sampling(NEVER, np.random.default_rng(6), target_cov=0.1, most_evaluations=300_000)
    assert np.isnan(run.probability)
    assert run.evaluations <= 300_000
