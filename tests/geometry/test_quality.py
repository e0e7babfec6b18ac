"""Dilution of precision and redundancy numbers: published values, and what must hold for any geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pl_mc.geometry import Geometry, dops, redundancy_numbers

# ARAIM Algorithm Description Document v3.0, appendix D: east, north, up of each design row, and C_int [m^2].
APPENDIX_D = np.array(
    [
        [0.0225, 0.9951, -0.0966, 3.8865],
        [0.6750, -0.6900, -0.2612, 1.4377],
        [0.0723, -0.6601, -0.7477, 0.8604],
        [-0.9398, 0.2553, -0.2269, 1.6383],
        [-0.5907, -0.7539, -0.2877, 1.3229],
        [-0.3236, -0.0354, -0.9455, 0.8434],
        [-0.6748, 0.4356, -0.5957, 0.8963],
        [0.0938, -0.7004, -0.7075, 0.8669],
        [0.5571, 0.3088, -0.7709, 0.8573],
        [0.6622, 0.6958, -0.2780, 1.3616],
    ]
)


def directions(elevation_deg, azimuth_deg) -> np.ndarray:
    """Design columns of directions: minus east, north, up."""
    elevation, azimuth = np.radians(elevation_deg), np.radians(azimuth_deg)
    return -np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=-1
    )


def one_epoch(rows: np.ndarray, systems: str, sigma_m: np.ndarray | float = 1.0) -> Geometry:
    clocks = np.array([[s == c for c in dict.fromkeys(systems)] for s in systems], dtype=float)
    return Geometry.from_arrays(
        np.hstack([rows, clocks]),
        np.broadcast_to(sigma_m, len(rows)),
        list(systems),
        [f"{s}{k:02d}" for k, s in enumerate(systems, 1)],
    )


@st.composite
def random_geometries(draw) -> Geometry:
    """Eight to twenty satellites of one to three systems, spread over the sky, with unequal sigmas."""
    n = draw(st.integers(8, 20))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    letters = "GCE"[: draw(st.integers(1, 3))]
    systems = "".join(letters[k % len(letters)] for k in range(n))
    elevation = np.degrees(np.arcsin(rng.uniform(0.1, 1.0, n)))
    return one_epoch(directions(elevation, rng.uniform(0, 360, n)), systems, rng.uniform(0.3, 5.0, n))


def appendix_d() -> Geometry:
    return one_epoch(APPENDIX_D[:, :3], "GGGGGEEEEE", np.sqrt(APPENDIX_D[:, 3]))


def test_dops_in_closed_form():
    """Five satellites and one clock, as the tests of gnss_lib_py work them out."""
    got = dops(one_epoch(directions([0, 0, 45, 45, 90], [0, 90, 180, 270, 360]), "GGGGG"))
    root2 = np.sqrt(2.0)
    assert got.gdop == pytest.approx(np.sqrt(23 / 3), rel=1e-12)
    assert got.hdop == pytest.approx(np.sqrt(25 / 6 - root2), rel=1e-12)
    assert got.vdop == pytest.approx(np.sqrt(9 / 4 + root2), rel=1e-12)
    assert got.pdop == pytest.approx(np.sqrt(77 / 3) / 2, rel=1e-12)
    assert got.tdop == pytest.approx(np.sqrt(5) / 2, rel=1e-12)


def test_redundancy_numbers_of_appendix_d():
    """Least squares on the published rows, W = 1 / C_int, computed elsewhere; the five redundant rows add up."""
    expected = [0.686552, 0.527214, 0.309345, 0.552657, 0.544048, 0.541127, 0.518285, 0.360606, 0.519245, 0.440920]
    got = redundancy_numbers(appendix_d())
    np.testing.assert_allclose(got, expected, atol=5.1e-7)
    assert got.sum() == pytest.approx(5.0, abs=1e-12)


def test_weighted_vdop_of_appendix_d_is_sigma_up():
    assert dops(appendix_d(), weighted=True).vdop ** 2 == pytest.approx(3.16569275, rel=1e-8)


@settings(max_examples=60, deadline=None)
@given(random_geometries())
def test_redundancy_numbers_are_shares_and_sum_to_n_less_t(g):
    r = redundancy_numbers(g)
    assert ((r >= 0) & (r <= 1)).all()
    assert r.sum() == pytest.approx(g.satellite_count - g.unknown_count, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(random_geometries(), st.floats(0.0, 2 * np.pi), st.booleans())
def test_turning_about_the_vertical_changes_no_figure_but_east_and_north(g, angle, weighted):
    turned = np.array(g.design)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned[:, :2] = turned[:, :2] @ turn
    other = Geometry.from_arrays(turned, g.sigma_m, g.systems, g.names)
    np.testing.assert_allclose(redundancy_numbers(other), redundancy_numbers(g), atol=1e-9)
    for name in ("gdop", "pdop", "hdop", "vdop", "tdop"):
        assert getattr(dops(other, weighted=weighted), name) == pytest.approx(
            getattr(dops(g, weighted=weighted), name), rel=1e-7
        )


@settings(max_examples=60, deadline=None)
@given(random_geometries())
def test_dops_are_sums_of_squares(g):
    d = dops(g)
    assert d.pdop**2 == pytest.approx(d.hdop**2 + d.vdop**2)
    assert d.gdop**2 == pytest.approx(d.pdop**2 + d.tdop**2)
    np.testing.assert_allclose(dops(g.as_series()).gdop, [d.gdop])


def series() -> Geometry:
    """Four epochs of the same seven directions: all; one system gone; one lone BeiDou; too few satellites."""
    rows = directions([80, 20, 30, 40, 25, 55, 35], [0, 10, 100, 190, 280, 45, 150])
    clocks = np.array([[1, 0]] * 5 + [[0, 1]] * 2, dtype=float)
    in_view = np.ones((4, 7), dtype=bool)
    in_view[1, 5:] = False
    in_view[2, 6] = False
    in_view[3, 3:] = False
    return Geometry.from_rows(
        design=np.tile(np.hstack([rows, clocks]), (4, 1, 1)),
        sigma_m=np.tile(np.linspace(1, 2, 7), (4, 1)),
        in_view=in_view,
        names=["G01", "G02", "G03", "G04", "G05", "C01", "C02"],
        systems="GGGGGCC",
        clocks=["G", "C"],
    )


def test_a_series_gives_what_its_epochs_give():
    g = series()
    r, d = redundancy_numbers(g), dops(g)
    assert r.shape == (4, 7)
    for k in range(3):
        single = g[k]
        np.testing.assert_allclose(r[k, : len(single.names)], redundancy_numbers(single), atol=1e-12)
        for name in ("gdop", "pdop", "hdop", "vdop", "tdop"):
            assert getattr(d, name)[k] == pytest.approx(getattr(dops(single), name))


def test_a_clock_that_nobody_observes_is_no_unknown():
    g = series()
    r = redundancy_numbers(g)
    assert r[1].sum() == pytest.approx(5 - 4)
    np.testing.assert_array_equal(r[1, 5:], 0.0)


def test_a_lone_satellite_of_a_system_is_not_checked_at_all():
    """It fixes its own clock and nothing else."""
    r = redundancy_numbers(series())
    assert r[2, 5] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(r[2, :5], r[1, :5], atol=1e-12)


def test_too_few_satellites_leave_figures_undefined_and_padding_at_zero():
    g = series()
    r = redundancy_numbers(g)
    assert np.isnan(r[3, :3]).all()
    np.testing.assert_array_equal(r[3, 3:], 0.0)
    d = dops(g)
    assert np.isnan([d.gdop[3], d.pdop[3], d.hdop[3], d.vdop[3], d.tdop[3]]).all()


def test_satellites_on_one_cone_determine_no_position():
    """With one elevation for all, height and clock cannot be told apart, whatever the number of satellites."""
    rows = directions(np.full(6, 30.0), np.arange(6) * 60.0)
    g = Geometry.from_rows(
        design=np.hstack([rows, np.ones((6, 1))])[None],
        sigma_m=np.full((1, 6), 1e-3),
        in_view=np.ones((1, 6), dtype=bool),
        names=[f"G{k:02d}" for k in range(6)],
        systems="GGGGGG",
        clocks=["G"],
    )
    assert np.isnan(dops(g).vdop).all()
    assert np.isnan(redundancy_numbers(g)).all()


def test_just_enough_satellites_have_no_redundancy():
    g = one_epoch(directions([80, 20, 30, 40], [0, 10, 130, 250]), "GGGG")
    np.testing.assert_allclose(redundancy_numbers(g), 0.0, atol=1e-12)
    assert np.isfinite(dops(g).gdop)
