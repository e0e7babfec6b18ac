"""Subset simulation on events whose probability is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pl_mc.integrity_risk.rare.subset import climb, rejuvenate, subset_simulation
from reference.known_events import CORNERS, HALF_SPACE, NEVER, PLATEAU, SHELL, Known


@pytest.mark.parametrize("known", [HALF_SPACE, CORNERS, SHELL], ids=["half-space", "four regions", "shell"])
def test_the_mean_of_populations_is_the_probability(known: Known) -> None:
    """Within what the scatter between populations allows, at a level of 1e-4 each; and that scatter is small."""
    run = subset_simulation(
        known, np.random.default_rng(7), target_cov=0.2, most_evaluations=4_000_000, size=2048, fewest=9
    )
    assert run.standard_error < 0.2 * run.probability
    deviation = abs(run.probability - known.probability) / run.standard_error
    assert deviation < stats.t.isf(0.5e-4, run.populations - 1)


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_a_population_ends_distributed_as_the_noise_in_the_event(noise: float) -> None:
    """In the coordinate that makes the event an exponential tail, in the others the normal distribution."""
    run = climb(HALF_SPACE, np.random.default_rng(8), size=4096, noise=noise)
    assert run.reached
    assert (run.points[:, 0] > 5.0).all()
    # E[z | z > 5] = phi(5) / Q(5). Points of one population depend on each other: a tenth of them is a safe number
    # of independent ones.
    mean = stats.norm.pdf(5.0) / stats.norm.sf(5.0)
    assert abs(run.points[:, 0].mean() - mean) < 4.0 * 0.19 / np.sqrt(410)
    assert np.abs(run.points[:, 1:].mean(axis=0)).max() < 4.5 / np.sqrt(410)
    assert np.abs(run.points[:, 1:].std(axis=0) - 1.0).max() < 4.5 / np.sqrt(820)


def test_stronger_noise_finds_an_event_that_nothing_points_to() -> None:
    """From the nominal noise few points see the event at the start; the estimates agree all the same."""
    found = [np.exp(climb(PLATEAU, np.random.default_rng(k), size=4096, noise=2.0).log_probability) for k in range(8)]
    error = np.std(found, ddof=1) / np.sqrt(8)
    assert abs(np.mean(found) - PLATEAU.probability) < stats.t.isf(0.5e-4, 7) * error
    assert error < 0.1 * PLATEAU.probability


def test_what_cannot_be_reached_is_said_to_be_so() -> None:
    run = subset_simulation(
        NEVER, np.random.default_rng(9), target_cov=0.2, most_evaluations=400_000, size=256, fewest=3
    )
    assert run.probability == 0.0
    assert run.evaluations <= 400_000
    flat = climb(Known(lambda z: np.full(len(z), -1.0), 0.0, 2), np.random.default_rng(9), size=64)
    assert not flat.reached
    assert flat.points.shape == (0, 2)
    assert flat.evaluations == 64


def test_a_budget_is_kept() -> None:
    run = climb(HALF_SPACE, np.random.default_rng(10), size=512, most_evaluations=10_000)
    assert not run.reached
    assert run.evaluations <= 10_000


def test_rejuvenated_points_stay_in_the_event() -> None:
    rng = np.random.default_rng(11)
    points = rng.standard_normal((500, 6))
    points[:, 0] = 5.0 + rng.random(500)
    moved, spent = rejuvenate(HALF_SPACE, rng, points)
    assert (moved[:, 0] > 5.0).all()
    assert spent == 500 * 9
    assert (moved[:, 1] != points[:, 1]).mean() > 0.9
