"""The pure entry: its counts are those of a sweep, under every transformation."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import pl_mc
from pl_mc.kernels import count_events, epoch_key, linear_model
from pl_mc.kernels.events import EVENTS
from pl_mc.methods import Igg3, Ls
from pl_mc.noise_models import StudentT
from reference.problems import appendix_d

G = appendix_d()
BIAS_M = np.stack([np.zeros(10), 40.0 * np.eye(10)[2], 25.0 * np.eye(10)[7]])
METHODS = (Ls(), Igg3(iterations=5))
DRAWS, SEED = 700, 11
COUNTS = [event.count for event in EVENTS]


def swept(methods, bias_m=BIAS_M, **options) -> np.ndarray:
    """(f, rows, events), the counts of a sweep."""
    faults = pl_mc.Faults.from_array(G, bias_m)
    table = pl_mc.sweep(G, faults, draws=DRAWS, seed=SEED, methods=methods, progress=False, **options)
    rows = len(table) // len(bias_m)
    by_row = table[COUNTS].to_numpy().reshape(rows, len(bias_m), len(COUNTS))
    return np.swapaxes(by_row, 0, 1)


AXES = ("vertical", "horizontal", "either")


@functools.cache
def by_axes() -> np.ndarray:
    """Of each method by each axis, method by method."""
    return swept(METHODS, axes=AXES)


@functools.cache
def model():
    return jax.jit(linear_model)(G.design, G.sigma_m, G.in_view)


@functools.cache
def key():
    return epoch_key(np.uint32(SEED), np.uint32(G.epoch))


@pytest.mark.parametrize("together", [1, 2])
def test_counts_are_those_of_a_sweep(together: int) -> None:
    # Compiled as a whole: operations by themselves are a hundred programs.
    @jax.jit
    def three(key, model, bias_m):
        given = (key, model, bias_m, METHODS)
        return (
            count_events(*given, pl_mc.LPV_200, DRAWS, axes=AXES, together=together),
            # An operation by name, and the axis of the limit that there is.
            count_events(*given, "RNP 0.1", DRAWS, together=together),
            count_events(*given, pl_mc.LPV_200, DRAWS, noise_model=StudentT(4.0)),
        )

    found, rail, of_noise = three(key(), model(), BIAS_M)
    assert found.dtype == jnp.int32
    np.testing.assert_array_equal(found, by_axes())
    np.testing.assert_array_equal(rail, swept(METHODS, alert="RNP 0.1"))
    np.testing.assert_array_equal(of_noise, swept(METHODS, noise=StudentT(4.0)))


def test_without_jit_the_counts_are_the_same() -> None:
    found = count_events(key(), model(), BIAS_M, METHODS[:1], pl_mc.LPV_200, DRAWS)
    np.testing.assert_array_equal(found, by_axes()[:, :1])


def test_grids_of_numbers_limits_and_geometries_are_one_call() -> None:
    @jax.jit
    def counts(model, k0, k_vertical, limits_m):
        method = Igg3(k0=k0, k_vertical=k_vertical, iterations=5)
        return count_events(key(), model, BIAS_M, (method,), limits_m, DRAWS)[:, 0]

    k0, k_vertical = jnp.asarray([1.5, 1.5, 2.5]), jnp.asarray([5.33, 3.0, 5.33])
    limits_m = jnp.asarray([[35.0, 40.0], [35.0, 40.0], [12.0, 40.0]])
    found = jax.vmap(counts, in_axes=(None, 0, 0, 0))(model(), k0, k_vertical, limits_m)
    for row, one, k, limits in zip(found, k0, k_vertical, limits_m, strict=True):
        alert = pl_mc.AlertLimits("own", *map(float, limits))
        method = Igg3(k0=float(one), k_vertical=float(k), iterations=5)
        np.testing.assert_array_equal(row, swept((method,), alert=alert)[:, 0])
    design = np.stack([G.design, G.design[::-1]])
    sigma = np.stack([G.sigma_m, G.sigma_m[::-1]])
    models = jax.jit(jax.vmap(linear_model))(design, sigma)
    both = jax.vmap(counts, in_axes=(0, None, None, None))(models, 1.5, 5.33, limits_m[0])
    np.testing.assert_array_equal(both[0], found[0])
    assert (both[1] != both[0]).any()


def test_geometries_are_spread_over_devices() -> None:
    mesh = Mesh(np.asarray(jax.devices()), ("geometries",))
    count = len(jax.devices())
    spread = NamedSharding(mesh, PartitionSpec("geometries"))
    design, sigma = (jax.device_put(np.stack([one] * count), spread) for one in (G.design, G.sigma_m))

    @jax.jit
    def counts(design, sigma):
        return jax.vmap(lambda a, s: count_events(key(), linear_model(a, s), BIAS_M, METHODS, pl_mc.LPV_200, DRAWS))(
            design, sigma
        )

    found = counts(design, sigma)
    for one in found:
        np.testing.assert_array_equal(one, by_axes()[:, :: len(AXES)])


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"methods": ("ls",)}, r"^methods: a sequence of records such as pl_mc.methods.Ls\(\) is needed"),
        ({"methods": ()}, r"^methods: a sequence of records"),
        ({"bias_m": np.zeros((2, 9))}, r"^bias_m: \(f, 10\) is needed for a model of 10 rows, not \(2, 9\)"),
        ({"draws": 0}, r"^draws: a whole number from 1 to 2147483647"),
        ({"limits": np.asarray([35.0])}, r"^limits: VAL and HAL are needed, an array \(2,\), not \(1,\)"),
        ({"axes": ("up",)}, r"^axes: 'up' is unknown"),
        ({"limits": "CAT IV"}, r"^alert: 'CAT IV' is unknown"),
        (
            {"axes": ("horizontal",), "limits": pl_mc.AlertLimits("lift", vertical_m=3.0)},
            r"^axes: horizontal needs a horizontal limit",
        ),
    ],
)
def test_what_does_not_fit_is_said(changed, sentence: str) -> None:
    given = {"bias_m": BIAS_M, "methods": METHODS, "limits": pl_mc.LPV_200, "draws": 10, "axes": ("vertical",)}
    with pytest.raises(pl_mc.InputError, match=sentence):
        count_events(key(), model(), **(given | changed))
