"""Numbers of methods and weight functions are leaves: another one compiles nothing, and JAX goes through them."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pl_mc
from pl_mc.engine.compiling import compiled_count
from pl_mc.ism import satellite_codes
from pl_mc.kernels import (
    DanishWeight,
    HampelWeight,
    HuberWeight,
    Igg3Weight,
    IrlsOptions,
    L1Weight,
    TukeyWeight,
    igg3,
    linear_model,
    protection_levels,
    start_from,
)
from pl_mc.kernels.parameters import as_trees, of_trees, traced
from pl_mc.methods import METHODS, Igg3, Ls, method
from pl_mc.methods.capabilities import scales_with_k
from reference.problems import appendix_d, random_sky

G = appendix_d()
FAULTS = pl_mc.no_fault(G) + pl_mc.biases(G, {G.names[2]: 30.0})

# What is no number of a method that JAX sees: it decides at which quantile a threshold stands, or which modes are
# monitored, on the host.
ON_THE_HOST = {"slope", "range_comparison", "nioraim", "araim", "separated", "ibpl"}
NAMES = sorted(set(METHODS) - ON_THE_HOST)


def with_few_solutions(name: str) -> Any:
    """A method whose program is small: numbers go into it alike, however many solutions there are."""
    one = method(name)
    return replace(one, iterations=3) if hasattr(one, "iterations") else one


def leaves(name: str) -> dict[str, float]:
    """The leaves of a method and what they are."""
    paths = jax.tree_util.tree_flatten_with_path(with_few_solutions(name))[0]
    return {path[-1].name: value for path, value in paths}


def counts(methods, **options: Any) -> np.ndarray:
    """(methods, faults, 3), alarms, exceeded and unavailable."""
    table = pl_mc.sweep(G, FAULTS, draws=100, seed=3, methods=methods, progress=False, **options)
    return table[["alarms", "exceeded", "unavailable"]].to_numpy().reshape(len(methods), len(FAULTS), 3)


def test_another_number_compiles_nothing() -> None:
    """Of every leaf of every method; and the counts are those of that number, not of the first one."""
    first = [with_few_solutions(name) for name in NAMES]
    # The leaves are those of the method as it comes.
    assert all(jax.tree.leaves(one) == jax.tree.leaves(method(name)) for one, name in zip(first, NAMES, strict=True))
    assert all({"k_horizontal", "k_vertical"} <= set(leaves(name)) for name in NAMES)
    usual = counts(first)
    compiled = compiled_count(1)._cache_size()
    for k in range(max(len(leaves(name)) for name in NAMES)):
        # The k-th leaf of each, while there is one.
        known = [list(leaves(name).items())[min(k, len(leaves(name)) - 1)] for name in NAMES]
        counts([replace(one, **{leaf: 1.1 * value}) for one, (leaf, value) in zip(first, known, strict=True)])
    nothing = counts([replace(one, k_vertical=1e-9) for one in first])
    # Limits of another operation neither; every level is beyond a limit of a millimetre.
    closest = counts(first, alert=pl_mc.AlertLimits("own", vertical_m=1e-3, horizontal_m=1.0))
    assert (closest[:, :, 0] == 100).all()
    assert compiled_count(1)._cache_size() == compiled
    # Every error is beyond a level of nothing, where K is what makes the level.
    by_k = [scales_with_k(one) is not None for one in first]
    assert sum(by_k) >= 10
    assert (nothing[by_k, :, 1] == 100).all()
    assert (usual[by_k, 0, 1] < 100).all()


def test_limits_compile_nothing_where_numbers_stay_on_the_host() -> None:
    methods = [method(name) for name in sorted(ON_THE_HOST)]
    usual, compiled = counts(methods), compiled_count(1)._cache_size()
    closest = counts(methods, alert=pl_mc.AlertLimits("own", vertical_m=1e-3, horizontal_m=1.0))
    assert compiled_count(1)._cache_size() == compiled
    assert (closest[:, :, 0] == 100).all()
    assert (usual[:, 0, 0] < 100).any()


def test_structure_compiles_anew() -> None:
    trees = [as_trees((one,)) for one in (Igg3(), Igg3(k0=2.0), Igg3(iterations=5), Igg3(weight_floor=0.1))]
    structures = [jax.tree.structure(tree) for tree in trees]
    assert structures[0] == structures[1]
    assert structures[0] not in structures[2:]
    # A floor that is there is a number like any other.
    assert structures[3] == jax.tree.structure(as_trees((Igg3(weight_floor=0.2),)))


@pytest.mark.parametrize(
    ("given", "other"),
    [
        (Igg3Weight(1.5, 5.0), Igg3Weight(2.0, 6.0)),
        (HuberWeight(), HuberWeight(2.0)),
        (TukeyWeight(), TukeyWeight(6.0)),
        (HampelWeight(), HampelWeight(1.7, 3.4, 8.5)),
        (DanishWeight(), DanishWeight(3.0)),
        (L1Weight(), L1Weight(0.5)),
    ],
)
def test_weights_with_traced_constants_are_those_of_numbers(given, other) -> None:
    size = jnp.linspace(0.0, 12.0, 97)
    compiled = jax.jit(lambda weight, size: weight(size))
    for weight in (given, other):
        np.testing.assert_allclose(compiled(weight, size), weight(size), rtol=1e-14, atol=1e-30)
    assert compiled._cache_size() == 1
    # Derivatives by each constant, against central differences, away from the corners of the function.
    u = jnp.asarray([0.3, 2.9, 4.9])
    slope = jax.jacobian(lambda weight: weight(u))(other)
    for name in (field.name for field in dataclasses.fields(other)):
        step, at = 1e-6, getattr(other, name)
        low, high = (dataclasses.replace(other, **{name: at + sign * step})(u) for sign in (-1, 1))
        np.testing.assert_allclose(getattr(slope, name), (high - low) / (2 * step), atol=1e-8)


def methods_in(content: Any) -> Iterator[dict[str, Any]]:
    """Name and options of every method in an experiment file."""
    if isinstance(content, dict):
        if content.get("name") in METHODS:
            yield content
        content = list(content.values())
    if isinstance(content, list):
        for part in content:
            yield from methods_in(part)


def test_only_numbers_are_leaves() -> None:
    """Of every method of the experiments that come along, whatever its options: words and switches shape programs."""
    files = sorted((Path(__file__).parents[2] / "experiments").glob("*.toml"))
    wanted = [one for file in files for one in methods_in(tomllib.loads(file.read_text(encoding="utf-8")))]
    methods = tuple(dict.fromkeys(method(**one) for one in wanted))
    assert len(methods) > 20
    assert any(getattr(of, "exclude", False) for of in methods)
    trees = as_trees(methods)
    assert {type(leaf) for leaf in jax.tree.leaves(trees)} == {float}
    codes = satellite_codes(G.as_series(), G.as_series().satellite[0])
    model = jax.jit(linear_model)(G.design, G.sigma_m, G.in_view, satellite=codes)

    def levels(trees, observed_m):
        start = start_from(model, observed_m)
        return [of.solve(model, of.prepare(model), start).vpl_m for of in of_trees(trees)]

    # Traced, and not compiled: a switch that is traced cannot be asked.
    found = jax.eval_shape(levels, trees, np.zeros((len(G.sigma_m), 3)))
    assert [one.shape for one in found] == [(3,)] * len(methods)


def test_words_and_switches_of_ones_own_records_are_structure() -> None:
    @traced
    @dataclass(frozen=True)
    class Own:
        k: float = 2.0
        form: str = "line"
        doubled: bool = True

    @jax.jit
    def value(own: Own) -> jax.Array:
        return own.k * (2.0 if own.doubled else 1.0) * (10.0 if own.form == "line" else 1.0)

    assert jax.tree.leaves(Own()) == [2.0]
    assert [float(value(own)) for own in (Own(), Own(doubled=False), Own(3.0, "other"))] == [40.0, 20.0, 6.0]


def vpl(k0, k1, design, sigma_m, noise):
    weight = Igg3Weight(k0, k1)
    estimate = igg3(design, sigma_m, noise, options=IrlsOptions(weight=weight, iterations=10))
    return protection_levels(estimate).vpl_m


of_grid = jax.jit(jax.vmap(vpl, in_axes=(0, 0, None, None, None)))
slope_by_k0 = jax.jit(jax.grad(lambda k0, *given: vpl(k0, 5.0, *given).sum()))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_kernel_takes_traced_limits(seed: int) -> None:
    """One compiled function for a grid of k0 and k1, a row of which is what a call with those numbers gives."""
    design, sigma_m, _ = random_sky(np.random.default_rng(seed), counts=(5, 4))
    noise = np.random.default_rng(seed).standard_normal((9, 6)) * sigma_m[:, None]
    noise[3] += 12.0
    given = design, sigma_m, noise
    k0, k1 = (axis.ravel() for axis in np.meshgrid([1.2, 1.5, 2.5], [3.0, 5.0]))
    for row, a, b in zip(of_grid(k0, k1, *given), k0, k1, strict=True):
        np.testing.assert_allclose(row, vpl(float(a), float(b), *given), rtol=1e-12)
    slope, step = slope_by_k0(1.5, *given), 1e-6
    difference = (vpl(1.5 + step, 5.0, *given).sum() - vpl(1.5 - step, 5.0, *given).sum()) / (2 * step)
    assert slope == pytest.approx(float(difference), rel=1e-5)


def test_a_method_goes_through_grad_and_vmap() -> None:
    model = jax.jit(linear_model)(*random_sky(np.random.default_rng(5), counts=(8,))[:2])
    start = jax.jit(start_from)(model, np.random.default_rng(5).standard_normal((8, 4)))

    def mean_vpl(one):
        return one.solve(model, one.prepare(model), start).vpl_m.mean()

    # Compiled as a whole: operations by themselves are three hundred programs.
    level, slope = jax.jit(jax.value_and_grad(mean_vpl))(Ls())
    # The level is a multiple of K_V, and knows nothing of K_H.
    assert slope.k_vertical == pytest.approx(float(level) / Ls().k_vertical)
    assert slope.k_horizontal == 0.0
    grid = Igg3(
        k0=jnp.asarray([1.5, 2.0]), k1=jnp.asarray([5.0, 6.0]), k_horizontal=jnp.ones(2), k_vertical=jnp.full(2, 5.33),
        iterations=4,
    )  # fmt: skip
    many = jax.jit(jax.vmap(mean_vpl))(grid)
    one = jax.jit(mean_vpl)
    alone = [one(Igg3(k0=k0, k1=k1, iterations=4)) for k0, k1 in ((1.5, 5.0), (2.0, 6.0))]
    np.testing.assert_allclose(many, alone, rtol=1e-12)


def test_a_weight_function_of_ones_own_is_a_pytree() -> None:
    """A small network with arrays for parameters, under jit and grad; a record that is none counts as structure."""

    @traced
    @dataclass(frozen=True)
    class Network:
        inner: jax.Array
        outer: jax.Array

        def __call__(self, size):
            hidden = jnp.tanh(size[..., None] * self.inner)
            return jax.nn.sigmoid(4.0 - jnp.abs(hidden @ self.outer))

    @dataclass(frozen=True)
    class Cauchy:
        c: float = 2.385

        def __call__(self, size):
            return 1.0 / (1.0 + (size / self.c) ** 2)

    design, sigma_m, _ = random_sky(np.random.default_rng(2), counts=(8,))
    noise = np.random.default_rng(2).standard_normal(8) * sigma_m
    network = Network(jnp.asarray([0.5, 1.0, 2.0]), jnp.asarray([1.0, 2.0, 3.0]))

    def up_m(weight):
        return igg3(design, sigma_m, noise, options=IrlsOptions(weight=weight, iterations=5)).state[2]

    slope = jax.jit(jax.grad(up_m))(network)
    step = jnp.zeros(3).at[1].set(1e-6)
    difference = up_m(Network(network.inner + step, network.outer)) - up_m(Network(network.inner - step, network.outer))
    assert float(slope.inner[1]) == pytest.approx(float(difference) / 2e-6, rel=1e-4)
    assert np.isfinite(up_m(Cauchy()))


def test_what_jax_builds_again_is_not_checked_and_what_a_sweep_takes_is() -> None:
    negative = jax.tree.map(lambda value: -value, Igg3())
    assert negative.k0 == -1.5
    with pytest.raises(pl_mc.InputError, match=r"^igg3: 0 < k0 < k1 is needed"):
        Igg3(k0=-1.5)
    arrays = Igg3(k0=jnp.asarray([1.5, 2.0]))
    with pytest.raises(pl_mc.InputError, match=r"^igg3: k0: one number is needed, not an array of shape \(2,\)"):
        pl_mc.sweep(G, FAULTS, draws=10, seed=1, methods=(arrays,))
    table = pl_mc.sweep(G, FAULTS, draws=10, seed=1, methods=(Igg3(k0=np.asarray(2.0)),), progress=False)
    assert set(table.method) == {"igg3(k0=2)"}
    with pytest.raises(pl_mc.InputError, match=r"^igg3: 0 < k0 < k1"):
        pl_mc.sweep(G, FAULTS, draws=10, seed=1, methods=(Igg3(k0=jnp.asarray(-2.0)),))
