"""Machine code in one piece and loops over few lanes give what the same code gives without them."""

from __future__ import annotations

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pl_mc.engine.compiling import sweep_options
from pl_mc.kernels import count_events, epoch_key, linear_model
from pl_mc.kernels.one_call import by_pieces, in_one_call
from pl_mc.methods import MM, Huber, Igg3
from pl_mc.runtime.precision import precision_scope
from reference.problems import appendix_d

G = appendix_d()
BIAS_M = np.stack([np.zeros(10), 40.0 * np.eye(10)[2], 5.0 * np.eye(10)[7]])
# As many draws as make whole pieces, and one more.
DRAWS = 513
# Small enough for alarms and hazards of every method.
LIMITS_M = np.array([6.0, 5.0])


@pytest.mark.parametrize("lanes", [None, 64, 100, 256])
def test_pieces_are_the_whole(lanes: int | None) -> None:
    noise = jnp.asarray(np.random.default_rng(1).normal(size=(3, 256)))

    def function(moving, fixed):
        return jax.tree.map(lambda one: jnp.sin(one) * fixed[0] + fixed[1][2], moving)

    moving, fixed = {"rows": noise[:2], "one": noise[2]}, (noise[0], noise)
    found = by_pieces(function, moving, fixed, lanes)
    jax.tree.map(np.testing.assert_array_equal, found, function(moving, fixed))


def compiled(function, *arguments) -> tuple[np.ndarray, str]:
    made = jax.jit(function, compiler_options=sweep_options()).lower(*arguments).compile()
    return np.asarray(made(*arguments)), made.as_text()


def test_what_a_function_can_hold_is_one_and_what_it_cannot_is_none() -> None:
    noise = jnp.asarray(np.random.default_rng(2).normal(size=(4, 64)))

    def holds(x):
        return jnp.cumsum(x @ x.T, axis=0)

    found, text = compiled(lambda x: in_one_call(holds, x), noise)
    np.testing.assert_allclose(found, holds(noise), rtol=1e-13, atol=1e-13)
    assert 'xla_cpu_small_call="true"' in text
    assert in_one_call(lambda x: jnp.sort(x @ x.T, axis=0), noise) is None


@pytest.mark.parametrize(("method", "one"), [(Igg3(iterations=5), True), (Igg3(iterations=5, scale="mad"), False)])
def test_loops_are_over_pieces_in_one_function_alone(method, one: bool) -> None:
    """A scale that is sorted for is compiled as without pieces, operation by operation."""
    model = jax.jit(partial(linear_model, one_clock_per_row=True))(G.design, G.sigma_m, G.in_view)

    def program(lanes: int | None) -> str:
        pieces = dataclasses.replace(model, loop_lanes=lanes)
        counts = partial(count_events, limits=LIMITS_M, draws=DRAWS, bias_m=BIAS_M, methods=(method,))
        return jax.jit(counts).lower(epoch_key(np.uint32(5), np.uint32(0)), pieces).as_text()

    assert (program(64) == program(None)) == (not one)


# Settled solutions, plain ones, weights that ties do not change, starts of their own, and a scale that is sorted for.
METHODS = (Igg3(), Igg3(iterations=5), Igg3(start="huber", covariance="sandwich"), Huber(), MM())


@pytest.mark.parametrize(
    ("method", "precision"),
    [*((method, "float64") for method in METHODS), (METHODS[0], "float32")],
    ids=lambda given: getattr(given, "name", given),
)
def test_counts_are_those_of_whole_tiles(method, precision: str) -> None:
    def counts(model):
        key = epoch_key(np.uint32(5), np.uint32(0))
        return count_events(key, model, BIAS_M, (method,), LIMITS_M, DRAWS, axes=("vertical", "horizontal"), together=2)

    with precision_scope(precision):
        # Operations by themselves are a hundred programs.
        model = jax.jit(partial(linear_model, one_clock_per_row=True))(
            G.design.astype(precision), G.sigma_m.astype(precision), G.in_view
        )
        whole = compiled(counts, model)[0]
        pieces = compiled(counts, dataclasses.replace(model, loop_lanes=64))[0]
    assert whole[..., 0].min() > 0, "there are alarms"
    np.testing.assert_array_equal(pieces, whole)
