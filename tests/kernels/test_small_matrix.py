"""The written-out Cholesky factor: NumPy's factor, solutions and inverses, and a flag instead of a NaN."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from pl_mc.kernels.small_matrix import (
    cholesky,
    inverse_columns,
    inverse_diagonal_element,
    lower_triangle,
    solve,
    sum_of_squares,
)

FLOOR = 1e-10


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
        np.testing.assert_allclose(inverse_diagonal_element(factor, k), inverse[:, k, k], rtol=1e-11)
        np.testing.assert_allclose(sum_of_squares(columns[k]), inverse[:, k, k], rtol=1e-11)


def test_singular_lanes_are_flagged_and_finite():
    matrices = random_normal_matrices(4, 4)
    matrices[1, :, 3] = matrices[1, 3, :] = 0.0
    matrices[2] = 0.0
    matrices[3] = np.ones((4, 4))
    factor = cholesky(pack(matrices), np.full(4, FLOOR))
    np.testing.assert_array_equal(factor.regular, [True, False, False, False])
    found = [*factor.lower.values(), *factor.inverse_diagonal, *solve(factor, np.ones((4, 4)))]
    assert all(np.isfinite(value).all() for value in found)


def test_the_floor_is_the_smallest_pivot_that_serves():
    packed = np.array([[4.0, 4.0], [0.0, 0.0], [2.0, np.nextafter(2.0, 0)]])
    np.testing.assert_array_equal(cholesky(packed, np.array([4.0, 2.0])).regular, [True, False])


def test_a_single_matrix_needs_no_lanes():
    matrix = random_normal_matrices(3, 1)
    alone = cholesky(pack(matrix)[:, 0], np.full(3, FLOOR))
    np.testing.assert_allclose(
        np.stack(solve(alone, np.arange(3.0))), np.linalg.solve(matrix[0], np.arange(3.0)), rtol=1e-11
    )


def test_gradients_of_a_singular_matrix_are_finite():
    def first_element(packed):
        return solve(cholesky(packed, np.full(3, FLOOR)), np.ones(3))[0]

    assert np.isfinite(jax.grad(first_element)(np.zeros(6))).all()
    assert np.isfinite(jax.grad(first_element)(np.ones(6))).all()
