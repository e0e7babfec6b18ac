"""Noise models one by one: what their errors are distributed as, and what every model promises."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import special, stats

import pl_mc
from pl_mc.input_errors import InputError
from pl_mc.kernels import LinearModel, linear_model
from pl_mc.noise_models import (
    GAUSSIAN,
    NOISE_MODELS,
    GaussianMixture,
    GaussMarkov,
    Multipath,
    NoiseModel,
    NominalBias,
    StudentT,
    as_noise_model,
)
from pl_mc.noise_models.gauss_markov import step
from reference.problems import random_geometry

FloatArray = NDArray[np.float64]

G = random_geometry(np.random.default_rng(60), counts=(4, 3))
DRAWS = 100_000
# A sound model fails a Kolmogorov-Smirnov test this seldom.
LEVEL = 1e-6

MODELS = (
    GAUSSIAN,
    StudentT(4.0),
    StudentT(1.0, "core"),
    GaussianMixture(0.02, 4.0, "kept"),
    Multipath(0.1, 4.0),
    Multipath(0.3, 2.0, "sigma", "uniform", decay_deg=40.0),
    NominalBias(0.7),
    NominalBias((0.1, -0.2, 0.3, 0.0, 0.5, -0.6, 0.7), "given"),
    NominalBias(0.7, "random"),
)


@pytest.fixture(autouse=True)
def strict_types():
    with jax.numpy_dtype_promotion("strict"):
        yield


prepare = jax.jit(linear_model)


@functools.cache
def shape_of(noise: NoiseModel) -> Callable[..., jax.Array]:
    return jax.jit(noise.shape)


@functools.cache
def model_of(dtype: type = np.float64) -> LinearModel:
    g = G
    return prepare(jnp.asarray(g.design, dtype), jnp.asarray(g.sigma_m, dtype), jnp.asarray(g.in_view))


def drawn(noise: NoiseModel, size: int = DRAWS) -> FloatArray:
    """(n, size), errors in sigma."""
    units = np.random.default_rng(61).standard_normal((noise.inputs_per_row, len(G.names), size))
    return np.asarray(shape_of(noise)(model_of(), [jnp.asarray(unit) for unit in units]))


def one_row(noise: NoiseModel, z: FloatArray) -> FloatArray:
    """Errors of the first satellite at given numbers, for models that take one."""
    return np.asarray(shape_of(noise)(model_of(), [jnp.broadcast_to(jnp.asarray(z), (len(G.names), z.size))]))[0]


def moment(noise: NoiseModel, power: int) -> float:
    """E x^power by quadrature over the normal number, without a draw."""
    z = np.linspace(-36.0, 36.0, 2**14 + 1)
    x = one_row(noise, z)
    return float((x**power * np.exp(-0.5 * z**2)).sum() * (z[1] - z[0]) / np.sqrt(2 * np.pi))


@pytest.mark.parametrize("noise", MODELS, ids=lambda noise: noise.name)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_model_keeps_the_protocol(noise: NoiseModel, dtype: type) -> None:
    assert isinstance(noise, NoiseModel)
    assert hash(noise) == hash(dataclasses.replace(noise))
    noise.require_geometry(G)
    extreme = np.array([-1e3, -40.0, -8.0, -1.0, 0.0, 1e-3, 2.0, 8.0, 40.0, 1e3])
    units = [jnp.asarray(np.tile(extreme, (7, 1)), dtype)] + [
        jnp.asarray(np.tile(extreme[::-1], (7, 1)), dtype) for _ in range(noise.inputs_per_row - 1)
    ]
    errors = shape_of(noise)(model_of(dtype), units)
    assert errors.dtype == dtype
    assert errors.shape == (7, 10)
    assert np.isfinite(errors).all()
    # The first number is noise: more of it is no smaller an error.
    same = [units[0], *(jnp.zeros_like(unit) for unit in units[1:])]
    assert (np.diff(shape_of(noise)(model_of(dtype), same), axis=1) >= 0).all()


@pytest.mark.parametrize("noise", [one for one in MODELS if not isinstance(getattr(one, "bias_m", 0), tuple)])
def test_padding_is_finite_and_changes_nothing(noise: NoiseModel) -> None:
    rows = np.array([0, 1, 2, 4, 5, 6, 8])
    design, sigma = np.full((9, G.design.shape[1]), np.nan), np.full(9, np.nan)
    design[rows], sigma[rows] = G.design, G.sigma_m
    seen = np.isin(np.arange(9), rows)
    units = np.random.default_rng(62).standard_normal((noise.inputs_per_row, 9, 50))
    padded = prepare(jnp.asarray(design), jnp.asarray(sigma), jnp.asarray(seen))
    wide = np.asarray(shape_of(noise)(padded, list(jnp.asarray(units))))
    narrow = shape_of(noise)(model_of(), list(jnp.asarray(units[:, rows])))
    assert np.isfinite(wide).all()
    np.testing.assert_allclose(wide[rows], narrow, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("nu", "match"), [(4.0, "sigma"), (2.5, "sigma"), (3.0, "core"), (60.0, "sigma")])
def test_student_t_has_its_quantiles(nu: float, match: str) -> None:
    noise = StudentT(nu, match)
    z = np.array([-7.3, -3.111, -0.5, 0.25, 1.0, 2.71, 5.5, 8.0])
    unit = np.sqrt((nu - 2) / nu) if match == "sigma" else 1.0 / stats.t.ppf(stats.norm.cdf(1.0), nu)
    expected = -np.sign(z) * special.stdtrit(nu, special.ndtr(-np.abs(z))) * unit
    # Cubics over steps of 1/512: (1/512)^4 / 384 times the fourth derivative, about (z / nu + 1)^4 of x.
    np.testing.assert_allclose(one_row(noise, z), expected, rtol=1e-11 * (8.0 / nu + 2.0) ** 4)
    if match == "core":
        assert one_row(noise, np.array([1.0]))[0] == pytest.approx(1.0, rel=1e-10)


def test_student_t_of_many_degrees_of_freedom_is_normal() -> None:
    nu, z = 1e6, np.linspace(-6.0, 6.0, 101)
    # Cornish and Fisher: t = z + (z^3 + z) / (4 nu) + O(nu^-2), and the unit is 1 - 1 / nu.
    first_order = z + (z**3 + z) / (4 * nu) - z / nu
    np.testing.assert_allclose(one_row(StudentT(nu), z), first_order, atol=200.0 / nu**2 + 1e-9)


def test_moments_are_exact() -> None:
    assert moment(StudentT(9.0), 2) == pytest.approx(1.0, rel=1e-8)
    # Excess kurtosis 6 / (nu - 4).
    assert moment(StudentT(12.0), 4) == pytest.approx(3.0 + 6.0 / 8.0, rel=1e-7)
    for chance, scale in ((0.01, 3.0), (0.2, 6.0)):
        kept, inflated = GaussianMixture(chance, scale, "kept"), GaussianMixture(chance, scale, "inflated")
        second = 1 - chance + chance * scale**2
        fourth = 3 * (1 - chance + chance * scale**4)
        assert moment(kept, 2) == pytest.approx(1.0, rel=1e-8)
        assert moment(kept, 4) == pytest.approx(fourth / second**2, rel=1e-7)
        assert moment(inflated, 2) == pytest.approx(second, rel=1e-8)
        assert moment(inflated, 4) == pytest.approx(fourth, rel=1e-7)
    bias, sigma = 0.7, float(G.sigma_m[0])
    b = bias / sigma
    assert moment(NominalBias(bias, "random"), 2) == pytest.approx(1 + b**2, rel=1e-8)
    assert moment(NominalBias(bias, "random"), 4) == pytest.approx(3 + 6 * b**2 + b**4, rel=1e-8)
    assert moment(NominalBias(bias), 1) == pytest.approx(b * np.sign(gains()[0]), rel=1e-8)


def gains() -> FloatArray:
    """(n,), vertical least-squares error per metre."""
    design = G.design / G.sigma_m[:, None]
    return np.linalg.pinv(design)[2] / G.sigma_m


def test_the_worst_signs_push_least_squares_up() -> None:
    shift = drawn(NominalBias(0.5), 1) - drawn(GAUSSIAN, 1)
    assert gains() @ (shift[:, 0] * G.sigma_m) == pytest.approx(0.5 * np.abs(gains()).sum(), rel=1e-9)
    np.testing.assert_allclose(drawn(NominalBias(0.5, "down"), 1) - drawn(GAUSSIAN, 1), -shift, atol=1e-12)


def delay_distribution(noise: Multipath, row: int) -> stats.rv_continuous:
    """Distribution function of noise and delay of one satellite, in sigma."""
    size = noise.size / G.sigma_m[row] if noise.unit == "m" else noise.size
    chance = noise.chance
    if noise.decay_deg is not None:
        chance *= np.exp(-np.degrees(G.elevation_rad[row]) / noise.decay_deg)

    def cdf(x: FloatArray) -> FloatArray:
        # The mean of the normal function over the interval, from its integral x ndtr(x) + phi(x).
        uniform = (integral(x) - integral(x - size)) / size
        late = stats.exponnorm.cdf(x, size) if noise.law == "exponential" else uniform
        return (1 - chance) * special.ndtr(x) + chance * late

    return cdf


def integral(x: FloatArray) -> FloatArray:
    return x * special.ndtr(x) + stats.norm.pdf(x)


@pytest.mark.parametrize(
    "noise",
    [
        Multipath(0.1, 4.0),
        Multipath(1.0, 2.0, "sigma"),
        Multipath(0.5, 3.0, "sigma", "uniform"),
        Multipath(0.9, 4.0, decay_deg=30.0),
    ],
    ids=lambda noise: noise.name,
)
def test_multipath_has_its_distribution(noise: Multipath) -> None:
    errors = drawn(noise)
    for row in (0, 5):
        assert stats.kstest(errors[row], delay_distribution(noise, row)).pvalue > LEVEL
    # The test has power: without the delay it is refused.
    assert stats.kstest(errors[0], "norm").pvalue < LEVEL


def test_marginals_of_drawn_errors() -> None:
    unit = float(np.sqrt(0.5))
    b = 0.7 / G.sigma_m
    mixed = GaussianMixture(0.1, 4.0)
    for row in (0, 3):
        assert stats.kstest(drawn(StudentT(4.0))[row], stats.t(4, scale=unit).cdf).pvalue > LEVEL
        wide = lambda x: 0.9 * special.ndtr(x) + 0.1 * special.ndtr(x / 4.0)  # noqa: E731
        assert stats.kstest(drawn(mixed)[row], wide).pvalue > LEVEL
        either = lambda x, b=b[row]: 0.5 * (special.ndtr(x - b) + special.ndtr(x + b))  # noqa: E731
        assert stats.kstest(drawn(NominalBias(0.7, "random"))[row], either).pvalue > LEVEL


@given(chance=st.floats(1e-6, 0.5), scale=st.floats(1.01, 100.0), variance=st.sampled_from(["kept", "inflated"]))
@settings(max_examples=5)
def test_a_mixture_keeps_every_probability(chance: float, scale: float, variance: str) -> None:
    noise = GaussianMixture(chance, scale, variance)
    half = np.linspace(0.01, 9.0, 900)
    z = np.concatenate([-half[::-1], half])
    x = one_row(noise, z)
    np.testing.assert_array_equal(x, -x[::-1])
    assert (np.diff(x) > 0).all()
    core = noise.core
    back = (1 - chance) * special.ndtr(-np.abs(x) / core) + chance * special.ndtr(-np.abs(x) / (core * noise.scale))
    np.testing.assert_allclose(back, special.ndtr(-np.abs(z)), rtol=1e-3)


def test_gauss_markov_has_its_autocorrelation() -> None:
    process, rng, length = GaussMarkov(7.0), np.random.default_rng(63), 40
    correlation = process.correlation(2.0)
    assert correlation == pytest.approx(np.exp(-2.0 / 7.0), rel=1e-12)
    series = [rng.standard_normal(DRAWS)]
    for _ in range(length - 1):
        series.append(
            np.asarray(step(jnp.asarray(series[-1]), jnp.asarray(rng.standard_normal(DRAWS)), jnp.asarray(correlation)))
        )
    assert stats.kstest(series[-1], "norm").pvalue > LEVEL
    for lag in (1, 5, 20):
        found = np.mean(series[-1] * series[-1 - lag])
        expected = correlation**lag
        # The variance of a product of standard normals with correlation r is 1 + r^2; 4.9 errors are 1e-6.
        assert abs(found - expected) < 4.9 * np.sqrt((1 + expected**2) / DRAWS)
    assert GaussMarkov(0.0).correlation(1.0) == 0.0
    assert GaussMarkov(np.inf).correlation(1.0) == 1.0


def test_names_tell_all_and_whole_numbers_are_the_same_record() -> None:
    assert StudentT(4).name == "student_t(nu=4,match=sigma)"
    assert repr(StudentT(4)) == repr(StudentT(4.0))
    assert Multipath().name == "multipath(chance=0.01,size=5,unit=m,law=exponential)"
    assert NominalBias((1, -2), "given").name == "nominal_bias(bias_m=[1 -2],sign=given)"
    for name in set(NOISE_MODELS) - {"empirical"}:
        assert as_noise_model(name).name.startswith(name)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StudentT(2.0), "nu: above 2 is needed .* not 2.0; with match 'core'"),
        (lambda: StudentT(0.5, "core"), "nu: at least 1 is needed, not 0.5"),
        (lambda: StudentT(4.0, "sigmas"), "match: 'sigmas' is unknown .nearest: sigma"),
        (lambda: GaussianMixture(0.0), "chance: it lies between 0 and 1, both excluded, not 0.0"),
        (lambda: GaussianMixture(0.1, 1.0), "scale: a number above 1 .* not 1.0"),
        (lambda: Multipath(0.1, -1.0), "size: a positive number is needed, not -1.0"),
        (lambda: Multipath(1.5), "chance: .* at most 1 is needed, not 1.5"),
        (lambda: NominalBias(-1.0), "a size of at least 0 is needed, not -1.0; with sign 'given'"),
        (lambda: NominalBias(()), "one number, or one for each satellite"),
        (lambda: NominalBias((1.0, 2.0)).require_geometry(G), "there are 2 numbers, and the geometry has 7"),
        (lambda: NominalBias(50.0, "random").require_geometry(G), "at most 3 sigma of every satellite"),
        (lambda: GaussMarkov(-1.0), "tau_s: a correlation time of at least 0 s is needed, not -1.0"),
        (lambda: as_noise_model("students"), "noise: 'students' is unknown .nearest: student_t"),
        (lambda: as_noise_model(GaussMarkov(1.0)), "pl_mc.exposure counts what does"),
        (lambda: as_noise_model(StudentT), "is no noise model"),
        (lambda: pl_mc.noise_model("student_t", mu=4), "the option 'mu' is unknown .nearest: nu"),
    ],
)
def test_what_cannot_be_used_says_why(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
