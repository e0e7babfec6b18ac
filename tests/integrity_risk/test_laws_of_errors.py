"""Errors that are Gaussian once something else is drawn: against exact laws, counts, and the laws of noise models."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.faults import Faults
from pl_mc.integrity_risk.given_residuals import RiskBudget
from pl_mc.integrity_risk.given_residuals.contributions import LevelRisk
from pl_mc.integrity_risk.given_residuals.draws import EpochParts, draw
from pl_mc.integrity_risk.given_residuals.truth import Alike, Neighbours, OfNoise, Scaled, Truth
from pl_mc.kernels import linear_model
from pl_mc.methods import Igg3, Ls
from pl_mc.noise_models import GaussianMixture, Multipath, NominalBias, StudentT
from reference.problems import random_series

pytestmark = pytest.mark.counting

G = random_series(np.random.default_rng(5), np.ones((1, 14), bool), "GGGGGGGEEEEEEE", noise=1.0)[0]
N = len(G.names)


def lanes(truth: Truth, draws: int, axis: str = "vertical", seed: int = 3):
    parts = EpochParts.of(G, axis)
    return parts, *truth.lanes(parts, np.random.default_rng(seed), np.ones((draws, 1)))


@pytest.mark.parametrize("truth", [Scaled(1.3), Alike(0.3), Neighbours(25.0)])
@pytest.mark.parametrize("k", [1.0, 3.0, 5.33])
def test_correlated_errors_of_least_squares_are_normal(truth: Truth, k: float) -> None:
    """An a-priori level: P(|e| > K sigma), e normal with g R g' for its variance, to five standard errors."""
    parts, drawn, _ = lanes(truth, 40_000)
    chance = draw(parts, Ls(level_scale="apriori", k_vertical=1.0), np.zeros((1, parts.in_view.size)), drawn).beyond(k)
    correlation = getattr(truth, "factor", 1.0) ** 2 * truth.correlation(parts)
    gain = parts.gain_m[0]
    ratio = np.sqrt(gain @ correlation @ gain / (gain @ gain))
    exact = 2 * stats.norm.sf(k / ratio)
    assert abs(chance.mean() - exact) <= 5 * chance.std() / np.sqrt(chance.size) + 1e-12 * exact
    # The draws are those of the law.
    found = np.cov(drawn.noise[:, :N].T)
    np.testing.assert_allclose(found, correlation[:N, :N], atol=0.05)


def test_correlation_is_one_with_itself_and_falls_with_the_angle() -> None:
    parts = EpochParts.of(G, "vertical")
    found = Neighbours(25.0).correlation(parts)[:N, :N]
    sight = G.design[:2, :3]
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(sight[0], sight[1])), sight[0] @ sight[1]))
    np.testing.assert_allclose(np.diag(found), 1.0, rtol=1e-6)
    assert found[0, 1] == pytest.approx(np.exp(-angle / 25.0), rel=1e-6)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
@pytest.mark.parametrize(
    "noise",
    [
        StudentT(4.0),
        GaussianMixture(0.05, 5.0, "kept"),
        Multipath(0.2, 2.0, "sigma"),
        Multipath(0.3, 4.0, law="uniform"),
    ],
)
def test_noise_models_agree_with_counts(noise, axis: str) -> None:
    """Of a robust estimate with a fault: conditional probabilities against events counted under the model itself."""
    one = Igg3(iterations=6, level_scale="floored")
    parts, drawn, _ = lanes(OfNoise(noise), 16_384, axis)
    bias_m = np.zeros((1, parts.in_view.size))
    bias_m[0, 3] = 6.0
    chance = draw(parts, one, bias_m, drawn).beyond(0.5)[0]
    table = pl_mc.sample(
        G, Faults.from_array(G, bias_m[:, :N]), draws=100_000, seed=3, methods=(one,), noise=noise,
        alert=pl_mc.AlertLimits("none", vertical_m=1e6, horizontal_m=1e6),
    )  # fmt: skip
    error_m = table["up_m"].abs() if axis == "vertical" else np.hypot(table["east_m"], table["north_m"])
    events = int((error_m > 0.5 * table["vpl_m" if axis == "vertical" else "hpl_m"]).sum())
    expected, error = 1e5 * chance.mean(), 1e5 * chance.std() / np.sqrt(chance.size)
    assert events > 50
    assert abs(events - expected) < 4 * np.hypot(error, np.sqrt(expected))


@pytest.mark.parametrize("truth", [Scaled(1.25), Alike(0.2), OfNoise(StudentT(8.0))])
def test_weighted_draws_without_a_fault_are_those_of_the_law(truth: Truth) -> None:
    """Noise of several strengths, weighted: the same mean as that of plain draws, of an event that both meet."""
    risk = LevelRisk(
        G, Igg3(iterations=6, level_scale="floored", k_vertical=1.0), RiskBudget(), "vertical", draws=4096, truth=truth
    )
    weighted = risk.free.beyond(2.0)[0]
    parts, drawn, _ = lanes(truth, 60_000, seed=8)
    plain = draw(parts, risk.method, np.zeros((1, parts.in_view.size)), drawn).beyond(2.0)[0]
    error = np.hypot(*(each.std() / np.sqrt(each.size) for each in (weighted, plain)))
    assert abs(weighted.mean() - plain.mean()) < 4 * error
    assert plain.mean() > 20 * plain.std() / np.sqrt(plain.size)


def test_heavy_tails_are_far_worse_for_a_level_of_known_sigma_than_for_none() -> None:
    """At a multiplier for 1e-7: an a-priori level of least squares under Student errors, a hundredfold and more."""
    options = {"method": Ls(level_scale="apriori", k_vertical=1.0), "budget": RiskBudget(), "axis": "vertical"}
    usual, heavy = (LevelRisk(G, draws=4096, truth=truth, **options) for truth in (Scaled(), OfNoise(StudentT(4.0))))
    assert usual.free.beyond(5.33).mean() == pytest.approx(2 * stats.norm.sf(5.33), rel=0.02)
    found = heavy.free.beyond(5.33)
    assert found.mean() - 3 * found.std() / np.sqrt(found.size) > 100 * 2 * stats.norm.sf(5.33)


@pytest.mark.parametrize("noise", [StudentT(4.0), GaussianMixture(0.01, 5.0), Multipath(0.05, 3.0, decay_deg=30.0)])
def test_weights_of_the_draws_have_mean_one_and_keep_the_moments(noise) -> None:
    _, drawn, _ = lanes(OfNoise(noise), 60_000)
    assert drawn.weight.mean() == pytest.approx(1.0, abs=5 * drawn.weight.std() / np.sqrt(60_000))
    assert drawn.weight.max() <= 2.0
    model = jax.jit(linear_model)(np.asarray(G.design), np.asarray(G.sigma_m))
    units = [np.random.default_rng(k).standard_normal((N, 60_000)) for k in range(noise.inputs_per_row)]
    plain = np.asarray(noise.shape(model, units))
    for size in (1.0, 2.5, 4.0):
        found = drawn.weight @ (np.abs(drawn.noise[:, :N]) > size) / 60_000
        np.testing.assert_allclose(found.mean(), (np.abs(plain) > size).mean(), rtol=0.08)


def test_refusals() -> None:
    with pytest.raises(pl_mc.InputError, match=r"^noises: nominal_bias.*nearest: student_t"):
        OfNoise(NominalBias(0.5))
    for made in (lambda: Alike(1.0), lambda: Neighbours(0.0), lambda: Scaled(-1.0)):
        with pytest.raises(pl_mc.InputError, match=r"^truth: "):
            made()
