"""Cholesky factor and elimination: NumPy's factor, solutions and inverses, and a flag instead of a NaN."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pl_mc.kernels.small_matrix import cholesky, eliminate, inverse_columns, lower_triangle, solve

FLOOR = 1e-10
eliminated = jax.jit(eliminate)


def random_normal_matrices(t: int, lanes: int, seed: int = 0) -> np.ndarray:
    """(lanes, t, t), well-conditioned symmetric positive definite."""
    rows = np.random.default_rng(seed).standard_normal((lanes, 3 * t, t))
    return np.swapaxes(rows, 1, 2) @ rows


def pack(matrices: np.ndarray) -> np.ndarray:
    """(t (t + 1) / 2, lanes)."""
    return np.stack([matrices[:, row, column] for row, column in lower_triangle(matrices.shape[-1])])


@pytest.mark.parametrize("t", [1, 2, 4, 6])
def test_factor_solution_and_inverse(t):
    matrices = random_normal_matrices(t, 20)
    right = np.random.default_rng(1).standard_normal((t, 20))
    factor = cholesky(pack(matrices), np.full(t, FLOOR))
    # The condition numbers are below 1e3, so 1e-12 leaves a factor of ten to the rounding bound.
    expected = np.linalg.cholesky(matrices)
    for (row, column), value in factor.lower.items():
        np.testing.assert_allclose(value, expected[:, row, column], atol=1e-12 * np.abs(expected).max())
    diagonal = np.diagonal(expected, axis1=1, axis2=2).T
    np.testing.assert_allclose(np.stack(factor.inverse_diagonal), 1 / diagonal, rtol=1e-12)
    np.testing.assert_allclose(np.stack(factor.pivots), diagonal**2, rtol=1e-12)
    assert np.all(factor.regular)

    x = np.stack(solve(factor, right))
    np.testing.assert_allclose(np.einsum("lij,jl->il", matrices, x), right, atol=1e-11)
    inverse = np.linalg.inv(matrices)
    columns = inverse_columns(factor)
    for k in range(t):
        np.testing.assert_allclose(np.sum(np.stack(columns[k]) ** 2, axis=0), inverse[:, k, k], rtol=1e-11)

    sides = np.stack([right, np.ones_like(right)], axis=1)
    found, regular = eliminated(pack(matrices), sides, np.full(t, FLOOR), np.bool_(True))
    np.testing.assert_allclose(np.einsum("lij,jkl->ikl", matrices, found), sides, atol=1e-11)
    assert np.all(regular)


def test_singular_lanes_are_flagged_and_finite():
    matrices = random_normal_matrices(4, 4)
    matrices[1, :, 3] = matrices[1, 3, :] = 0.0
    matrices[2] = 0.0
    matrices[3] = np.ones((4, 4))
    factor = cholesky(pack(matrices), np.full(4, FLOOR))
    np.testing.assert_array_equal(factor.regular, [True, False, False, False])
    found = [*factor.lower.values(), *factor.inverse_diagonal, *solve(factor, np.ones((4, 4)))]
    assert all(np.isfinite(value).all() for value in found)
    for go in (True, False):
        solution, regular = eliminated(pack(matrices), np.ones((4, 1, 4)), np.full(4, FLOOR), np.bool_(go))
        assert np.isfinite(solution).all()
        if go:
            np.testing.assert_array_equal(regular, [True, False, False, False])


def test_the_floor_is_the_smallest_pivot_that_serves():
    packed = np.array([[4.0, 4.0], [0.0, 0.0], [2.0, np.nextafter(2.0, 0)]])
    floor = np.array([4.0, 2.0])
    np.testing.assert_array_equal(cholesky(packed, floor).regular, [True, False])
    regular = eliminated(packed, np.ones((2, 1, 2)), floor, np.bool_(True))[1]
    np.testing.assert_array_equal(regular, [True, False])


def test_a_single_matrix_needs_no_lanes():
    matrix = random_normal_matrices(3, 1)
    alone = cholesky(pack(matrix)[:, 0], np.full(3, FLOOR))
    np.testing.assert_allclose(
        np.stack(solve(alone, np.arange(3.0))), np.linalg.solve(matrix[0], np.arange(3.0)), rtol=1e-11
    )


def test_gradients_of_a_singular_matrix_are_finite():
    def first_element(packed):
        return solve(cholesky(packed, np.full(3, FLOOR)), np.ones(3))[0]

    def first_eliminated(packed):
        return eliminate(packed, jnp.ones((3, 1)), jnp.full(3, FLOOR), jnp.asarray(True))[0][0, 0]

    for function in (first_element, first_eliminated):
        gradient = jax.jit(jax.grad(function))
        assert np.isfinite(gradient(np.zeros(6))).all()
        assert np.isfinite(gradient(np.ones(6))).all()
