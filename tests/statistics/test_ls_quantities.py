"""Least-squares quantities against published numbers, the normal equations, and geometries without padding."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pl_mc.faults import Faults, biases, no_fault
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.statistics import fault_effects, ls_quantities


def _normal_equations(g: Geometry) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """N^-1, N^-1 A'P and P(I - A N^-1 A'P) of one epoch, as the formulas are written."""
    weight = np.diag(1.0 / g.sigma_m**2)
    inverse = np.linalg.inv(g.design.T @ weight @ g.design)
    solution = inverse @ g.design.T @ weight
    return inverse, solution, weight @ (np.eye(len(g.sigma_m)) - g.design @ solution)


def test_appendix_d(appendix_d: Geometry) -> None:
    # ARAIM ADD v3.0 Appendix D geometry with W = 1/C_int; numbers of an exact computation made elsewhere.
    redundancy = [0.686552, 0.527214, 0.309345, 0.552657, 0.544048, 0.541127, 0.518285, 0.360606, 0.519245, 0.440920]
    got = ls_quantities(appendix_d)
    np.testing.assert_allclose(got.redundancy, redundancy, atol=1.1e-6)
    assert got.redundancy.sum() == pytest.approx(5, abs=1e-13)
    assert got.vdop_m**2 == pytest.approx(3.16569275, abs=5e-9)
    assert got.dof == 5
    assert got.available


def test_one_clock_closed_form() -> None:
    """Elevations 0, 0, 45, 45, 90 deg, azimuths 0, 90, 180, 270, 360 deg; closed forms of gnss_lib_py's tests."""
    elevation, azimuth = np.radians([0, 0, 45, 45, 90]), np.radians([0, 90, 180, 270, 360])
    up = np.sin(elevation)
    line = np.column_stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), up])
    g = Geometry.from_arrays(np.hstack([-line, np.ones((5, 1))]), np.ones(5), "GGGGG", "abcde")
    got = ls_quantities(g)
    assert got.hdop_m == pytest.approx(np.sqrt(25 / 6 - np.sqrt(2)), rel=1e-13)
    assert got.vdop_m == pytest.approx(np.sqrt(9 / 4 + np.sqrt(2)), rel=1e-13)


def test_every_epoch_is_that_of_the_normal_equations(day: Geometry) -> None:
    got = ls_quantities(day)
    np.testing.assert_array_equal(got.dof, [7, 2, 2, 1, 0, -2])
    np.testing.assert_array_equal(got.available, [True, True, True, True, False, False])
    for k in range(5):
        single = day[k]
        inverse, solution, residual = _normal_equations(single)
        count = len(single.sigma_m)
        assert got.vdop_m[k] == pytest.approx(np.sqrt(inverse[2, 2]), rel=1e-10)
        assert got.hdop_m[k] == pytest.approx(np.sqrt(inverse[0, 0] + inverse[1, 1]), rel=1e-10)
        np.testing.assert_allclose(got.gain[k, :count], solution[2], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(got.redundancy[k, :count], np.diag(residual) * single.sigma_m**2, atol=1e-9)
        np.testing.assert_array_equal(got.gain[k, count:], 0.0)
        np.testing.assert_array_equal(got.redundancy[k, count:], 0.0)
    assert np.isnan(got.vdop_m[5])
    assert np.isnan(got.gain[5]).all()


def test_a_series_is_its_epochs(day: Geometry) -> None:
    got = ls_quantities(day)
    for k in range(4):
        single = ls_quantities(day[k])
        count = len(day[k].sigma_m)
        assert single.vdop_m.shape == single.dof.shape == ()
        assert single.vdop_m == pytest.approx(got.vdop_m[k], rel=1e-12)
        np.testing.assert_allclose(single.gain, got.gain[k, :count], rtol=1e-10, atol=1e-12)


def test_gain_finds_position_and_is_blind_to_the_clock(day: Geometry) -> None:
    got = ls_quantities(day)
    moved = np.einsum("en,ent->et", got.gain[:5], day.design[:5])
    np.testing.assert_allclose(moved, np.tile([0, 0, 1, 0, 0], (5, 1)), atol=1e-11)


def test_dependent_columns_are_unavailable(day: Geometry) -> None:
    """All satellites at one elevation: height and clock cannot be told apart."""
    azimuth = np.linspace(0, 2 * np.pi, 9)[:8]
    line = np.column_stack([0.8 * np.sin(azimuth), 0.8 * np.cos(azimuth), np.full(8, 0.6)])
    g = Geometry.from_rows(
        design=np.hstack([-line, np.ones((8, 1))])[None],
        sigma_m=np.ones((1, 8)),
        in_view=np.ones((1, 8), bool),
        names="abcdefgh",
        systems="GGGGGGGG",
        clocks="G",
    )
    got = ls_quantities(g)
    assert got.dof[0] == 4
    assert not got.available[0]
    assert np.isnan(got.vdop_m[0])


def test_effects_are_the_quadratic_forms(day: Geometry) -> None:
    rng = np.random.default_rng(3)
    rows = np.zeros((4, len(day.names)))
    rows[1, 0], rows[2, [0, 7]] = 30.0, (-12.0, 40.0)
    rows[3] = rng.normal(0, 20, len(day.names))
    effects = fault_effects(day, Faults.from_array(day, rows))
    # A fault counts where all of its satellites are in view: the last one at epoch 0 alone.
    assert set(zip(effects.epoch_index.tolist(), effects.fault_index.tolist(), strict=True)) == {
        *((k, 0) for k in range(6)), *((k, 1) for k in range(6)), (0, 2), (3, 2), (4, 2), (5, 2), (0, 3),
    }  # fmt: skip
    for k, f, vertical, spread, across in zip(*dataclasses.astuple(effects), strict=True):
        single = day[int(k)]
        if k == 5:
            assert np.isnan(vertical)
            assert np.isnan(spread)
            assert np.isnan(across).all()
            continue
        _, solution, residual = _normal_equations(single)
        bias = np.array([rows[f, day.names.index(name)] for name in single.names])
        assert vertical == pytest.approx(solution[2] @ bias, rel=1e-9, abs=1e-12)
        assert spread == pytest.approx(bias @ residual @ bias, rel=1e-9, abs=1e-6)
        assert across == pytest.approx(solution[:2] @ bias, rel=1e-9, abs=1e-12)


def test_effect_of_one_satellite_is_its_redundancy(appendix_d: Geometry) -> None:
    quantities = ls_quantities(appendix_d)
    for k, name in enumerate(appendix_d.names):
        effects = fault_effects(appendix_d, biases(appendix_d, {name: 17.0}), quantities)
        expected = 17.0**2 * quantities.redundancy[k] / appendix_d.sigma_m[k] ** 2
        assert effects.noncentrality[0] == pytest.approx(expected, rel=1e-12)
        assert effects.vertical_m[0] == pytest.approx(17.0 * quantities.gain[k], rel=1e-12)


def test_faults_of_another_geometry(day: Geometry, appendix_d: Geometry) -> None:
    with pytest.raises(InputError, match="other satellites"):
        fault_effects(day, no_fault(appendix_d))
