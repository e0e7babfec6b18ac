"""The limit state is positive exactly where the event is, in coordinates that hold all that the vertical feels."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax import Array

import pl_mc
from pl_mc.alert import LPV_200
from pl_mc.integrity_risk.rare.limit_state import FAR_M, RISK_EVENTS, LimitState, limit_state, rotation
from pl_mc.kernels.events import EVENTS, events, limits_of
from pl_mc.methods import Igg3, Ls, Method, Outcome
from reference.problems import appendix_d, random_series

METRES = st.floats(0.0, 200.0)


@pytest.fixture(scope="module")
def sky() -> pl_mc.Geometry:
    return appendix_d(noise=4.0)


def limit_of(g: pl_mc.Geometry, fault: pl_mc.Faults, method: Method, event: str) -> LimitState:
    bias = fault.bias_m[0]
    coordinates = rotation(g.design, g.sigma_m, g.in_view, bias)
    return LimitState(g.design, g.sigma_m, g.in_view, bias, method, event, 35.0, coordinates)


@jax.jit
def judged(outcome: Outcome) -> tuple[Array, Array]:
    """Which events happened, and the limit states of those that have one."""
    states = [limit_state(outcome, 35.0, event) for event in RISK_EVENTS]
    return events(outcome, limits_of(LPV_200, np.float64)), jnp.stack(states)


@given(error=st.floats(-200.0, 200.0), vpl=METRES, available=st.booleans(), rejects=st.booleans())
def test_its_sign_is_the_event(error: float, vpl: float, available: bool, rejects: bool) -> None:
    infinite = np.inf if not available else 0.0
    outcome = Outcome(
        error_m=np.array([0.0, 0.0, error + infinite]),
        hpl_m=np.array(1.0),
        vpl_m=np.array(vpl + infinite),
        available=np.array(available),
        rejects=np.array(rejects),
    )
    seen, values = jax.device_get(judged(outcome))
    happened = dict(zip([event.name for event in EVENTS], seen, strict=True))
    for event, value in zip(RISK_EVENTS, values, strict=True):
        assert np.isfinite(value)
        # On the boundary itself the definitions of a sweep decide; it has no probability.
        if value != 0.0:
            assert (value > 0.0) == happened[event], event


def test_no_solution_is_as_far_as_can_be() -> None:
    nothing = jnp.full(3, jnp.inf)
    outcome = Outcome(nothing, nothing[0], nothing[0], jnp.array(False), jnp.array(False))
    assert float(limit_state(outcome, 35.0, "alarm")) == FAR_M
    assert float(limit_state(outcome, 35.0, "misleading")) == -FAR_M


@pytest.mark.parametrize("method", [Ls(), Igg3()], ids=["ls", "igg3"])
def test_points_are_errors_of_the_receiver(sky: pl_mc.Geometry, method: Method) -> None:
    """The points, turned into pseudorange errors and solved as a receiver's, give the limit state."""
    points = 1.5 * np.random.default_rng(1).standard_normal((40, 10))
    fault = pl_mc.biases(sky, {sky.names[2]: 10.0})
    series = pl_mc.Geometry.from_rows(
        design=np.tile(sky.design, (40, 1, 1)),
        sigma_m=np.tile(sky.sigma_m, (40, 1)),
        in_view=np.ones((40, 10), dtype=bool),
        names=sky.names,
        systems=sky.systems,
        clocks=sky.clocks,
    )
    coordinates = limit_of(sky, fault, method, "missed").coordinates
    errors = sky.sigma_m * (points @ coordinates.matrix.T) + fault.bias_m[0]
    table = pl_mc.solve(series, errors, methods=(method,))
    quiet, error = 35.0 - table["vpl_m"], table["up_m"].abs()
    expected = {
        "alarm": -quiet,
        "exceeded": error - table["vpl_m"],
        "missed": np.minimum(error - 35.0, quiet),
        "misleading": np.minimum(error - table["vpl_m"], quiet),
    }
    for event in RISK_EVENTS:
        values = limit_of(sky, fault, method, event)(points)
        np.testing.assert_allclose(values, expected[event], rtol=0, atol=1e-7)
    assert 0 < (expected["alarm"] > 0).sum() < 40


@pytest.mark.parametrize("method", [Ls(), Igg3(scale="apriori")], ids=["ls", "igg3"])
def test_the_other_coordinates_move_nothing_vertical(sky: pl_mc.Geometry, method: Method) -> None:
    fault = pl_mc.biases(sky, {sky.names[0]: 20.0})
    limit = limit_of(sky, fault, method, "misleading")
    assert (limit.active, limit.dimension) == (6, 10)
    rng = np.random.default_rng(2)
    points = rng.standard_normal((50, 10))
    moved = points.copy()
    moved[:, limit.active :] += 3.0 * rng.standard_normal((50, 4))
    np.testing.assert_allclose(limit(moved), limit(points), rtol=0, atol=1e-7)


def test_coordinates_are_orthonormal_in_every_view() -> None:
    """Epochs with satellites out of view and a clock that nothing observes; with and without a fault."""
    in_view = np.ones((3, 9), dtype=bool)
    in_view[1, 2] = in_view[2, 6:] = False
    series = random_series(np.random.default_rng(3), in_view, "GGGGGGCCC")
    for k, unknowns in enumerate((5, 5, 4)):
        g = series[k : k + 1]
        seen = g.in_view[0]
        for bias in (np.zeros(9), np.where(np.arange(9) == 1, 30.0, 0.0)):
            found = rotation(g.design[0], g.sigma_m[0], seen, bias)
            matrix, m = found.matrix, int(seen.sum())
            assert matrix.shape == (9, m)
            assert found.active == m - unknowns + 1
            np.testing.assert_allclose(matrix.T @ matrix, np.eye(m), atol=1e-12)
            assert not matrix[~seen].any()
            # The residuals' coordinates see no position and no clock.
            whitened = g.design[0] / g.sigma_m[0][:, None]
            np.testing.assert_allclose(matrix[:, 1 : found.active].T @ whitened, 0.0, atol=1e-12)
