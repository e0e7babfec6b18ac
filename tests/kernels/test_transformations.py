"""The kernels are pure functions of arrays: jit, vmap, lanes and grad agree, and compile once per shape."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pl_mc import InputError, kernels
from pl_mc.kernels import IrlsOptions
from reference.problems import appendix_d, random_sky

OPTIONS = {
    "default": IrlsOptions(),
    "apriori": IrlsOptions(scale="apriori"),
    "posterior": IrlsOptions(scale="posterior", cofactor="reweighted"),
    "mad": IrlsOptions(scale="mad", redundancy="weights"),
    "mad_floored": IrlsOptions(scale="mad_floored", cofactor="none", redundancy="kept"),
}


def levels_of(design, sigma_m, observed_m, in_view=None, *, options=IrlsOptions()):  # noqa: B008 (a frozen record)
    estimate = kernels.igg3(design, sigma_m, observed_m, in_view, options=options)
    return estimate, kernels.protection_levels(estimate)


@functools.cache
def compiled(name: str):
    """One function for each choice: where shapes are the same, tests share its program."""
    return jax.jit(functools.partial(levels_of, options=OPTIONS[name]))


def scenario(lanes: int = 12, *, bias_m: float = 40.0, seed: int = 0):
    """The sky of Appendix D with noise of its sigma and a bias on its third satellite."""
    g = appendix_d()
    observed = g.sigma_m[:, None] * np.random.default_rng(seed).standard_normal((10, lanes))
    observed[2] += bias_m
    return g.design, g.sigma_m, observed


@pytest.mark.parametrize("name", ["mad_floored"])
def test_lanes_are_vmap_are_one_by_one(name):
    design, sigma, observed = scenario()
    function = compiled(name)
    batch = function(design, sigma, observed)
    mapped = jax.jit(jax.vmap(function, in_axes=(None, None, 1), out_axes=-1))(design, sigma, observed)
    single = [function(design, sigma, observed[:, k]) for k in range(12)]
    stacked = jax.tree.map(lambda *parts: np.stack(parts, axis=-1), *single)
    for found in (mapped, stacked):
        # The same operations in another order; see the tolerance of the comparison with the reference.
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10), found, batch)


@pytest.mark.optimised
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_lane_knows_nothing_of_its_neighbours(dtype):
    """What has not settled goes on in quarters of a batch, in whatever place: to the last bit the same."""
    design, sigma, observed = (one.astype(dtype) for one in scenario(256, bias_m=6.0))
    own = np.random.default_rng(3).permutation(256)
    far = np.where(np.arange(256)[None] % 3 == 1, dtype(0), observed)
    function = jax.jit(levels_of)
    known, moved, beside = (
        jax.tree.map(np.asarray, function(design, sigma, one)) for one in (observed, observed[:, own], far)
    )
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[..., own], b), known, moved)
    kept = np.arange(256) % 3 != 1
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[..., kept], b[..., kept]), known, beside)
    # Some of the first quarter alone, some of every one: with the neighbours' zeros fewer go on.
    assert known[0].available.all()


def test_without_jit_nothing_changes():
    design, sigma, observed = scenario()
    with jax.disable_jit():
        plain = levels_of(design, sigma, observed[:, :3])
    found = compiled("default")(design, sigma, observed)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b[..., :3], rtol=1e-10, atol=1e-10), plain, found)


def test_a_single_scenario_promotes_no_rank():
    design, sigma, observed = scenario(1)
    with jax.numpy_rank_promotion("raise"):
        # Ranks are known before anything is compiled.
        jax.eval_shape(kernels.ls, design, sigma, observed[:, 0])
        jax.eval_shape(kernels.igg3, design, sigma, observed[:, 0])


@functools.cache
def value_and_gradients(name: str, by: tuple[int, ...]):
    """A level, or the sum of all that an estimate says, by some of its arrays: one program for both."""

    def total(design, sigma_m, observed_m, in_view, level_alone):
        estimate, levels = levels_of(design, sigma_m, observed_m, in_view, options=OPTIONS[name])
        everything = jnp.where(estimate.available, levels.vpl_m + levels.hpl_m + jnp.sum(estimate.state), 0.0)
        return jnp.where(level_alone, levels.vpl_m, everything)

    return jax.jit(jax.value_and_grad(total, argnums=by))


@pytest.mark.parametrize("name", ["default"])
def test_gradients_are_those_of_differences(name):
    """VPL_R as a function of design, sigma and observations, along a random direction, where it is smooth."""
    design, sigma, observed = scenario(1, bias_m=6.0, seed=4)
    point = (design, sigma, observed[:, 0])
    rng = np.random.default_rng(5)
    direction = tuple(rng.standard_normal(x.shape) * scale for x, scale in zip(point, (0.1, 0.1, 1.0), strict=True))

    # A row out of view has no part in it.
    for in_view in (np.ones(10, bool), np.arange(10) != 7):

        def vpl(step, in_view=in_view):
            at = tuple(x + step * d for x, d in zip(point, direction, strict=True))
            return jax.tree.map(np.asarray, value_and_gradients(name, (0, 1, 2))(*at, in_view, True))

        gradient = vpl(0.0)[1]
        assert all(np.isfinite(part).all() for part in gradient)
        assert all((part[~in_view] == 0).all() for part in gradient)
        slope = sum(np.sum(part * d) for part, d in zip(gradient, direction, strict=True))
        step = 1e-5
        # Central differences: truncation of the order of the square of the step, rounding 1e-16 / 1e-5 times the level.
        np.testing.assert_allclose(slope, (vpl(step)[0] - vpl(-step)[0]) / (2 * step), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(("name", "by"), [("default", (0, 1, 2)), ("mad", (2,))])
def test_gradients_are_finite_where_nothing_is_smooth(name, by):
    """Those by observations: a perfect fit, residuals of zero, an undetermined scenario, padding of NaN."""
    design, sigma, observed = scenario(1)
    rows = np.arange(10)
    for observed_m, in_view in (
        (np.zeros(10), rows >= 0),
        (design @ np.array([1.0, -2, 3, 4, 5]), rows >= 0),
        (np.full(10, 1e6), rows >= 0),
        (1e3 * (-1.0) ** rows, rows >= 0),
        (observed[:, 0], np.isin(rows, [0, 1, 5, 6])),
        (np.where(rows < 8, observed[:, 0], np.nan), rows < 8),
    ):
        _, gradients = value_and_gradients(name, by)(design, sigma, observed_m, in_view, False)
        assert np.isfinite(gradients[-1]).all()


def test_one_trace_per_shape():
    traces = []

    @jax.jit
    def counted(design, sigma_m, observed_m):
        traces.append(observed_m.shape)
        return kernels.igg3(design, sigma_m, observed_m)

    for seed in range(3):
        design, sigma, observed = scenario(4, seed=seed)
        # A call traces where this does, and compiles what it has traced.
        counted.eval_shape(design, sigma, observed)
        counted.eval_shape(jnp.asarray(design), jnp.asarray(2 * sigma), jnp.asarray(observed))
        counted.eval_shape(design, sigma, observed[:, 0])
    assert traces == [(10, 4), (10,)]


@pytest.mark.parametrize("name", ["default", "posterior", "mad_floored"])
def test_no_library_routine_is_called(name):
    """A batch of LAPACK calls deadlocks in some releases of jaxlib: the program must hold none."""
    lowered = compiled(name).lower(*scenario())
    text = lowered.as_text()
    assert "custom_call" not in text
    assert "lapack" not in text.lower()
    assert "lapack" not in lowered.compile().as_text().lower()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_types_are_kept(dtype):
    arrays = [x.astype(dtype) for x in scenario()]
    for solver in (kernels.ls, kernels.igg3):
        # Types are known before anything is compiled.
        estimate = jax.eval_shape(solver, *arrays)
        for name in ("state", "residuals_m", "weights", "unit_error", "cofactor_m2", "kept", "change_m"):
            assert getattr(estimate, name).dtype == dtype, name
        assert estimate.available.dtype == bool


@pytest.mark.optimised
def test_single_precision_is_close_to_double():
    # The lanes of the test of neighbours, so that the programs are those.
    design, sigma, observed = scenario(256)
    double = jax.jit(levels_of)(design, sigma, observed)[1]
    single = jax.jit(levels_of)(*(x.astype(np.float32) for x in (design, sigma, observed)))[1]
    # Rounding 6e-8 over residuals of up to 40 sigma, amplified by a normal matrix of condition 1e2: below 1e-3.
    np.testing.assert_allclose(single.vpl_m, double.vpl_m, rtol=1e-3)


@pytest.mark.parametrize("bad", ["design", "sigma_m", "observed_m"])
def test_shapes_that_do_not_fit(bad):
    arrays = {"design": np.ones((6, 4)), "sigma_m": np.ones(6), "observed_m": np.ones((6, 2))}
    arrays[bad] = np.ones(5)
    for solver in (kernels.ls, kernels.igg3):
        with pytest.raises(InputError, match=r"kernel: design \(n, t\)"):
            solver(**arrays)


def test_a_wider_sky_has_no_limit():
    """Nothing is written out over satellites: forty of them compile and solve as six do."""
    rng = np.random.default_rng(11)
    design, sigma, _ = random_sky(rng, counts=(15, 13, 12))
    estimate = jax.jit(kernels.igg3)(design, sigma, sigma * rng.standard_normal(40))
    assert estimate.available
