"""Clocks eliminated at once: the same estimates as by the elimination that knows nothing of clocks."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pl_mc
from pl_mc.engine.plan import make_plan
from pl_mc.kernels import IrlsOptions, irls, linear_model, start_from
from pl_mc.kernels.clock_elimination import clocks_apart, eliminate_clocks
from reference.problems import appendix_d, random_problem

ROWS, CLOCKS = 24, 3

# Both eliminations round at 1e-16; condition numbers stay below about 1e4 and ten reweightings follow.
TOLERANCE = 1e-10


@functools.partial(jax.jit, static_argnames=("one_clock_per_row",))
def estimates(design, sigma_m, observed_m, in_view, *, one_clock_per_row):
    def one(design, sigma_m, observed_m, in_view):
        model = linear_model(design, sigma_m, in_view, one_clock_per_row=one_clock_per_row)
        return irls(model, start_from(model, jnp.where(in_view, observed_m, 0.0)), IrlsOptions())

    return jax.vmap(one)(design, sigma_m, observed_m, in_view)


def test_estimates_do_not_depend_on_the_elimination():
    rng = np.random.default_rng(8)
    arrays = [
        np.stack(a) for a in zip(*(random_problem(rng).padded(ROWS, CLOCKS, rng) for _ in range(60)), strict=True)
    ]
    # A geometry that determines nothing, and one with too few satellites.
    arrays[3][0] = False
    arrays[3][1, np.flatnonzero(arrays[3][1])[4:]] = False
    at_once, general = (estimates(*arrays, one_clock_per_row=flag) for flag in (True, False))
    np.testing.assert_array_equal(at_once.available, general.available)
    assert not at_once.available[:2].any()
    assert at_once.available.sum() > 50
    there = np.asarray(general.available)
    size = np.nanmax(np.abs(arrays[2]), axis=1, initial=1.0, where=arrays[3])
    np.testing.assert_allclose(at_once.weights, general.weights, atol=TOLERANCE)
    for field in ("state", "residuals_m"):
        difference = np.abs(getattr(at_once, field) - getattr(general, field))[there].max(axis=1)
        assert (difference <= TOLERANCE * size[there]).all(), field
    for field in ("unit_error", "cofactor_m2"):
        np.testing.assert_allclose(getattr(at_once, field), getattr(general, field), rtol=TOLERANCE)
    np.testing.assert_array_equal(at_once.kept, general.kept)


@pytest.mark.parametrize("t", [4, 5, 7])
def test_solution_cofactors_and_flags(t):
    lanes = 12
    rng = np.random.default_rng(t)
    rows = rng.standard_normal((lanes, 6 * t, t))
    clock = np.arange(6 * t) % (t - 3)
    rows[:, :, 3:] = clock[:, None] == np.arange(t - 3)
    # Lane 0: a clock that nothing observes; lane 1: two coordinates that only show together; lane 2: nothing.
    rows[0, :, 3] = 0.0
    rows[1, :, 1] = rows[1, :, 0]
    rows[2] = 0.0
    normal = np.swapaxes(rows, 1, 2) @ rows
    right = rng.standard_normal((t, lanes))
    packed = np.stack([normal[:, row, column] for row, column in clocks_apart(t)])
    floor = np.full(t, 1e-9)
    given = [jnp.asarray(x) for x in (packed, right, floor, np.zeros(t))]
    found = eliminate_clocks(*given, jnp.asarray(True), cofactors=True)
    np.testing.assert_array_equal(found.regular, np.arange(lanes) > 2)
    assert all(np.isfinite(part).all() for part in (*found.solution, *found.cofactors))
    inverse = np.linalg.inv(normal[3:])
    np.testing.assert_allclose(
        np.stack(found.solution)[:, 3:].T, np.einsum("lij,jl->li", inverse, right[:, 3:]), rtol=1e-9
    )
    np.testing.assert_allclose(
        np.stack(found.cofactors)[:, 3:].T, np.diagonal(inverse, axis1=1, axis2=2)[:, :3], rtol=1e-10
    )
    assert not eliminate_clocks(*given, jnp.asarray(False)).regular.any()
    # The clock that dropped out is zero and the rest as without it.
    empty = np.zeros(t)
    empty[3] = 1.0
    dropped = eliminate_clocks(*given[:3], jnp.asarray(empty), jnp.asarray(True))
    if t > 4:
        keep = np.arange(t) != 3
        expected = np.linalg.solve(normal[0][np.ix_(keep, keep)], right[keep, 0])
        np.testing.assert_allclose(np.stack(dropped.solution)[keep, 0], expected, rtol=1e-9)
    assert dropped.regular[0]


def test_a_sweep_uses_it_only_where_clocks_are_apart():
    g = appendix_d()
    faults = pl_mc.biases(g, {g.names[0]: 10.0})
    assert make_plan(g, faults, 100).one_clock_per_row
    design = g.design.copy()
    # One common clock and the offset of the second system: the same space, but rows with two clocks.
    design[:, 3] = 1.0
    mixed = pl_mc.Geometry.from_arrays(design, g.sigma_m, list(g.systems), list(g.names))
    assert not make_plan(mixed, faults, 100).one_clock_per_row
    pair = [pl_mc.sweep(x, faults, draws=2_000, seed=3, alert=pl_mc.LPV_200) for x in (g, mixed)]
    counts = ["alarms", "hazards", "missed", "exceeded", "misleading", "unavailable"]
    np.testing.assert_array_equal(pair[0][counts], pair[1][counts])
