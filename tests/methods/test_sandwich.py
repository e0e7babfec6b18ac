"""The M-estimate's own covariance in the levels: from its influence function, not from weights known before."""

from __future__ import annotations

import functools
from dataclasses import replace

import jax
import numpy as np
import pytest
import statsmodels.api as sm
from scipy import stats

import pl_mc
from pl_mc.kernels import HuberWeight, IrlsOptions, TukeyWeight, irls, linear_model, start_from
from pl_mc.kernels.sandwich import _expected_square
from pl_mc.kernels.weights import DanishWeight, HampelWeight, Igg3Weight
from pl_mc.methods import MM, Danish, GatedIgg3, Hampel, Huber, Igg3, Ls, Tukey
from pl_mc.methods.base import outcome_of
from reference.problems import appendix_d, random_sky

G = appendix_d()
PSI_SLOPE = {
    Igg3: lambda u: np.where(u <= 1.5, 1.0, np.where(u <= 5.0, -2 * 1.5 * (5.0 - u) / 3.5**2, 0.0)),
    Huber: lambda u: np.where(u <= 1.345, 1.0, 0.0),
}
PSI = {
    Igg3: lambda u: np.where(u <= 1.5, u, 1.5 * (np.clip(5.0 - u, 0, None) / 3.5) ** 2),
    Huber: lambda u: np.minimum(u, 1.345),
}


@functools.partial(jax.jit, static_argnames="options")
def compiled(options: tuple[IrlsOptions, ...], design, sigma_m, observed_m):
    model = linear_model(design, sigma_m)
    start = start_from(model, observed_m)
    return [irls(model, start, one) for one in options]


def estimated(options: tuple[IrlsOptions, ...], design, sigma_m, observed_m):
    """An estimate for each of the options, in one program."""
    return jax.tree.map(np.asarray, compiled(options, design, sigma_m, observed_m))


@functools.partial(jax.jit, static_argnames="methods")
def solved(methods, design, sigma_m, observed_m, in_view=None):
    model = linear_model(design, sigma_m, in_view)
    start = start_from(model, observed_m)
    return [one.solve(model, one.prepare(model), start) for one in methods]


@jax.jit
def solved_by_scale(design, sigma_m, observed_m, in_view):
    """Outcomes by scale: one estimate of each method has levels of every scale."""
    model = linear_model(design, sigma_m, in_view)
    start = start_from(model, observed_m)
    estimates = [(one, one._estimate(model, start)) for one in UNBENT]
    return {
        scale: [outcome_of(found, replace(one, level_scale=scale)._levels(found)) for one, found in estimates]
        for scale in SCALES
    }


SCALES = ("posterior", "floored", "apriori")
STRAIGHT = (Huber(k=60.0), Tukey(c=1e9), Hampel(a=50.0, b=60.0, c=70.0), Igg3(k0=50.0, k1=60.0), Danish(c=50.0))
# Least squares, and estimates that do not bend anywhere.
UNBENT = (Ls(), *(replace(of, iterations=2, covariance="sandwich") for of in STRAIGHT))


@functools.cache
def solved_unbent(counts, sky: int, noise: int, share: float):
    """Outcomes of all of them by scale, of a sky that is padded to one shape."""
    design, sigma, _ = random_sky(np.random.default_rng(sky), counts=counts)
    observed = share * sigma[:, None] * np.random.default_rng(noise).standard_normal((sum(counts), 20))
    rows, clocks = 14 - len(sigma), 5 - design.shape[1]
    design, observed = np.pad(design, ((0, rows), (0, clocks))), np.pad(observed, ((0, rows), (0, 0)))
    sigma, seen = np.pad(sigma, (0, rows), constant_values=1.0), np.arange(14) < sum(counts)
    twins = bool(jax.jit(linear_model)(design, sigma, seen).twins.there)
    return solved_by_scale(design, sigma, observed, seen), twins


def variance_m2(estimate) -> np.ndarray:
    """(3, lanes), of east, north and up [m^2]."""
    return estimate.unit_error**2 * estimate.cofactor_m2


@pytest.mark.parametrize("of", range(4), ids=lambda of: STRAIGHT[of].name)
def test_without_a_bend_it_is_the_covariance_of_least_squares(of) -> None:
    """psi' is one everywhere, and so are W = N and kappa = 1."""
    by_scale, _ = solved_unbent((8, 6), 2, 3, 1.0)
    for least, *bent in by_scale.values():
        np.testing.assert_allclose(bent[of].vpl_m, least.vpl_m, rtol=1e-9)
        np.testing.assert_allclose(bent[of].hpl_m, least.hpl_m, rtol=1e-9)


@pytest.mark.parametrize("counts", [(5,), (6, 2), (8, 2)])
def test_satellites_that_no_residual_tells_apart_change_nothing(counts) -> None:
    """Five of one system, two of another: twins, whose residuals are made of means."""
    by_scale, twins = solved_unbent(counts, 6, 7, 0.2)
    assert twins
    least, *bent = by_scale["posterior"]
    for of, found in zip(STRAIGHT, bent, strict=True):
        np.testing.assert_allclose(found.vpl_m, least.vpl_m, rtol=1e-7, err_msg=of.name)
        np.testing.assert_allclose(found.hpl_m, least.hpl_m, rtol=1e-7, err_msg=of.name)


@pytest.mark.parametrize(
    ("weight", "norm"),
    [(HuberWeight(), sm.robust.norms.HuberT(1.345)), (TukeyWeight(), sm.robust.norms.TukeyBiweight(4.685))],
)
def test_it_is_the_third_of_huber_s_covariances(weight, norm) -> None:
    """As statsmodels has it (``cov="H3"``), of regressions with some observations far off, at convergence."""
    rng = np.random.default_rng(5)
    design, observed = rng.standard_normal((30, 4)), rng.standard_normal((30, 12))
    observed[:3] += 6.0 * rng.standard_normal((3, 12))
    options = IrlsOptions(weight, iterations=400, scale="mad", cofactor="none", covariance="sandwich")
    (found,) = estimated((options,), design, np.ones(30), observed)
    lanes = np.flatnonzero(found.change_m < 1e-11)
    assert lanes.size >= 8
    for lane in lanes:
        fit = sm.RLM(observed[:, lane], design, M=norm).fit(maxiter=4000, tol=1e-14, scale_est="mad", cov="H3")
        np.testing.assert_allclose(variance_m2(found)[:, lane], np.diag(fit.bcov_scaled)[:3], rtol=1e-6)


@pytest.mark.parametrize("of", [Igg3, Huber])
@pytest.mark.parametrize("bias_m", [0.0, 25.0])
def test_it_is_a_plain_computation_and_unavailable_where_it_is_no_minimum(of, bias_m: float) -> None:
    design, sigma, _ = random_sky(np.random.default_rng(8), counts=(9, 7))
    observed = sigma[:, None] * np.random.default_rng(9).standard_normal((16, 400))
    observed[4] += bias_m
    one = of(covariance="sandwich")
    found, plain = estimated((one.options, of().options), design, sigma, observed)
    a = design / sigma[:, None]
    n, t = a.shape
    normal = a.T @ a
    c = np.sqrt(1 - np.einsum("ij,jk,ik->i", a, np.linalg.inv(normal), a))
    z = plain.residuals_m / sigma[:, None]
    size = np.linspace(0, 12, 200_001)
    expected = 2 * np.trapezoid(PSI[of](size) ** 2 * stats.norm.pdf(size), size)
    indefinite = 0
    for lane in np.flatnonzero(plain.available):
        # The scale of the iterate: its own weighted square sum, never below one.
        scale = max(1.0, np.sqrt(np.sum(plain.weights[:, lane] * z[:, lane] ** 2) / (n - t)))
        u = np.abs(z[:, lane]) / c / scale
        slope = PSI_SLOPE[of](u)
        w = a.T @ np.diag(slope) @ a
        if np.linalg.eigvalsh(w)[0] <= 1e-6 * np.linalg.eigvalsh(normal)[0]:
            indefinite += 1
            assert not found.available[lane] or np.linalg.eigvalsh(w)[0] > 0
            continue
        kappa = 1 + t / n * np.var(slope) / np.mean(slope) ** 2
        square = np.sum((c * scale * PSI[of](u)) ** 2) / (n - t)
        covariance = square / kappa * np.linalg.inv(w) @ normal @ np.linalg.inv(w)
        assert found.available[lane]
        np.testing.assert_allclose(variance_m2(found)[:, lane], np.diag(covariance)[:3], rtol=1e-6)
        np.testing.assert_allclose(found.unit_error[lane], np.sqrt(square / expected), rtol=1e-6)
        np.testing.assert_array_equal(found.state[:, lane], plain.state[:, lane])
    # Huber's sum is convex; what IGG-III falls to need not be its minimum in so few iterations.
    assert indefinite < 20 if of is Igg3 else indefinite == 0


@pytest.mark.parametrize("law", ["normal", "student"])
def test_many_satellites_have_the_variance_and_the_quantiles_that_it_says(law: str) -> None:
    """Huber's estimate of 120 satellites: its simulated variance, and how often 1.96 of its sigma are exceeded."""
    lanes, n = 20_000, 120
    rng = np.random.default_rng(11)
    # Equal leverages, for which kappa is made.
    design = np.concatenate([rng.choice([-1.0, 1.0], (n, 3)), np.ones((n, 1))], axis=1)
    errors = rng.standard_normal((n, lanes)) if law == "normal" else rng.standard_t(3, (n, lanes))
    options = IrlsOptions(HuberWeight(), 30, covariance="sandwich"), IrlsOptions(HuberWeight(), 30)
    found, plain = estimated(options, design, np.ones(n), errors)
    true = np.mean(found.state[:3] ** 2, axis=1)
    # A variance of 20,000 has a standard error of 1 %; what is left of order (t / n)^2 is less.
    np.testing.assert_allclose(np.mean(variance_m2(found), axis=1), true, rtol=0.04)
    if law == "normal":
        # Weights that are taken as known before say E(u psi) / E w, a fifth less than E psi^2 / (E psi')^2.
        u = np.linspace(-9, 9, 20_001)
        psi, density = np.clip(u, -1.345, 1.345), stats.norm.pdf(u) * (u[1] - u[0])
        weight, slope = np.where(u == 0, 1.0, psi / np.where(u == 0, 1.0, u)), np.abs(u) < 1.345
        ratio = (u * psi @ density) / (weight @ density) / (psi**2 @ density) * (slope @ density) ** 2
        np.testing.assert_allclose(ratio, 0.81, atol=0.005)
        np.testing.assert_allclose(np.mean(variance_m2(plain), axis=1), ratio * true, rtol=0.03)
    beyond = np.mean(np.abs(found.state[:3]) > 1.96 * np.sqrt(variance_m2(found)), axis=1)
    np.testing.assert_allclose(beyond, 0.05, atol=0.006)


def test_the_mean_square_of_psi_is_huber_s_closed_form() -> None:
    for k in (0.5, 1.345, 3.0):
        inner = 2 * stats.norm.cdf(k) - 1 - 2 * k * stats.norm.pdf(k)
        expected = inner + 2 * k**2 * stats.norm.sf(k)
        assert float(_expected_square(HuberWeight(k), np.dtype("float64"))) == pytest.approx(expected, rel=1e-6)
    for weight in (Igg3Weight(), HampelWeight(), DanishWeight(), TukeyWeight()):
        u = np.linspace(0, 12, 100_001)
        expected = 2 * np.trapezoid((u * np.asarray(weight(u))) ** 2 * stats.norm.pdf(u), u)
        assert float(_expected_square(weight, np.dtype("float64"))) == pytest.approx(expected, rel=1e-6)


@functools.cache
def outcomes(order: tuple[int, ...], scale: float, shift_m: float):
    design, sigma, _ = random_sky(np.random.default_rng(8), counts=(7, 6))
    observed = sigma[:, None] * np.random.default_rng(10).standard_normal((13, 30))
    observed[2] += 12.0 * sigma[2]
    rows = list(order)
    seen = scale * observed[rows] + shift_m * design[rows, 3:].sum(axis=1)[:, None]
    methods = (Huber(covariance="sandwich"), MM(covariance="sandwich"), GatedIgg3(covariance="sandwich"))
    return solved(methods, design[rows], scale * sigma[rows], seen)


@pytest.mark.parametrize("change", [((12, *range(12)), 1.0, 0.0), (tuple(range(13)), 40.0, 0.0)])
def test_order_and_unit_of_length_do_not_matter(change) -> None:
    usual = outcomes(tuple(range(13)), 1.0, 0.0)
    for one, other in zip(usual, outcomes(*change), strict=True):
        np.testing.assert_array_equal(one.available, other.available)
        for level in ("vpl_m", "hpl_m"):
            a, b = (np.asarray(getattr(each, level)) for each in (one, other))
            np.testing.assert_allclose(b, change[1] * a, rtol=1e-7)


def test_one_clock_for_all_moves_no_level() -> None:
    usual, shifted = (outcomes(tuple(range(13)), 1.0, shift_m) for shift_m in (0.0, 1e4))
    for one, other in zip(usual, shifted, strict=True):
        np.testing.assert_allclose(other.vpl_m, one.vpl_m, rtol=1e-6)


def test_it_sweeps_and_solves() -> None:
    methods = [Huber(level_scale="floored"), Huber(level_scale="floored", covariance="sandwich")]
    assert methods[1].name == "huber(level_scale=floored,covariance=sandwich)"
    # Few solutions, which are compiled soon.
    methods = [replace(one, iterations=10) for one in methods]
    table = pl_mc.sweep(G, pl_mc.no_fault(G), draws=2000, seed=1, methods=methods, progress=False)
    assert (table.exceeded_rate < 1e-3).all()
    one = pl_mc.solve(G, G.sigma_m * np.linspace(-1, 1, len(G.names)), methods=methods)
    assert np.isfinite(one.vpl_m).all()
    assert len(table) == 2


@pytest.mark.counting
def test_it_is_calibrated() -> None:
    # Few solutions: the multiplier is found by ratios, whatever gives them.
    one = Huber(level_scale="floored", covariance="sandwich", iterations=10)
    found = pl_mc.calibrate(G, method=one, budget={"p_sat": 1e-6}, axis="vertical", draws=1024).iloc[0]
    assert found.k_low <= found.k_vertical <= found.k_high
    assert found.risk == pytest.approx(found.allowed, rel=1e-2)


@pytest.mark.parametrize("of", [Danish, MM])
def test_other_words_are_refused(of) -> None:
    with pytest.raises(pl_mc.InputError, match=r"covariance: 'sandwhich' is unknown \(nearest: sandwich\)"):
        of(covariance="sandwhich")
