"""The geometry record: what it refuses, how a series is packed and cut, and that JAX can carry it."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest

from pl_mc import Geometry, InputError
from reference.problems import appendix_d, random_series

SYSTEMS = "GGGGGCCC"
IN_VIEW = np.array(
    [[1, 1, 1, 1, 1, 1, 1, 0], [1, 0, 1, 1, 1, 0, 0, 0], [1, 0, 0, 0, 0, 1, 1, 0], [0, 0, 0, 0, 0, 0, 0, 0]], dtype=bool
)


@pytest.fixture
def series():
    """Four epochs; C08 is never in view, the second epoch has no BeiDou, the last has nothing."""
    return random_series(np.random.default_rng(2), IN_VIEW, SYSTEMS)


@pytest.fixture
def plain():
    """Valid arguments of `Geometry.from_arrays`."""
    g = appendix_d()
    return {"design": g.design.copy(), "sigma_m": g.sigma_m.copy(), "systems": list(g.systems), "names": list(g.names)}


def with_value(array, place, value):
    changed = np.array(array, dtype=float)
    changed[place] = value
    return changed


@pytest.mark.parametrize(
    ("field", "change", "words"),
    [
        ("design", lambda d: d[0], "design: two axes"),
        ("design", lambda d: "ENU", "design: it cannot be read as an array of numbers"),
        ("design", lambda d: [[1, 2], [3]], "design: it cannot be read as an array of numbers"),
        ("design", lambda d: d[:-1], r"sigma_m: one entry per design row is needed, \(9,\), not \(10,\)"),
        ("sigma_m", lambda s: s[:-1], r"sigma_m: one entry per design row is needed, \(10,\), not \(9,\)"),
        ("sigma_m", lambda s: s[:, None], "sigma_m: one entry per design row"),
        ("systems", lambda s: s[:-1], "systems: one entry per design row"),
        ("names", lambda s: s[:-1], "names: one entry per design row"),
        ("systems", lambda s: ["X", *s[1:]], "systems: 'X' is unknown .valid: G, C, E, R"),
        ("names", lambda s: [s[1], *s[1:]], "names: 'G02' appears more than once"),
        ("design", lambda d: d[:, :3], "three position columns and at least one clock are needed, not 3"),
        ("sigma_m", lambda s: with_value(s, 2, 0.0), "sigma_m: G03 has 0; a sigma is finite and positive"),
        ("sigma_m", lambda s: with_value(s, 2, -1.0), "sigma_m: G03 has -1"),
        ("sigma_m", lambda s: with_value(s, 2, np.nan), "sigma_m: G03 has nan"),
        ("sigma_m", lambda s: with_value(s, 2, np.inf), "sigma_m: G03 has inf"),
        ("sigma_m", lambda s: [str(one) for one in s], r"array of numbers \(it holds '[\d.]+'\)\."),
        ("design", lambda d: with_value(d, (4, 1), np.nan), "design: the row of G05 is not finite"),
        ("design", lambda d: with_value(d, (4, 1), np.inf), "design: the row of G05 is not finite"),
        ("design", lambda d: with_value(d, np.s_[:, 4], 0.0), "design: column 4 is all zeros"),
        ("design", lambda d: with_value(d, np.s_[:, 4], d[:, 3]), "depend on each other .rank 4."),
        ("design", lambda d: with_value(d, np.s_[:, 1], 2 * d[:, 0]), "G01 starts with a vector of length"),
        ("design", lambda d: with_value(d, np.s_[3, :3], 20e6 * d[3, :3]), "G04 starts .* are a unit vector"),
        ("design", lambda d: with_value(d, np.s_[6, 3:], 1e10), "E07 has 1e.10 in a clock column"),
        ("sigma_m", lambda s: [str(one) for one in s], "sigma_m: it cannot be read as an array of numbers"),
        ("sigma_m", lambda s: np.array(s, "datetime64[s]"), "sigma_m: it cannot be read"),
        ("sigma_m", lambda s: s > 0, "sigma_m: it cannot be read"),
        ("sigma_m", lambda s: s + 1j, "sigma_m: it cannot be read"),
        ("sigma_m", lambda s: np.ma.masked_less(s, np.median(s)), "sigma_m: it cannot be read"),
        ("sigma_m", lambda s: with_value(s, 2, 1e-300), "sigma_m: G03 has 1e-300; .* 1e-09 to 1e.09 m"),
        ("sigma_m", lambda s: with_value(s, 2, 1e300), "sigma_m: G03 has 1e.300"),
    ],
)
def test_arrays_that_are_no_geometry(plain, field, change, words):
    plain[field] = change(plain[field])
    with pytest.raises(InputError, match=words) as caught:
        Geometry.from_arrays(**plain)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_fewer_satellites_than_unknowns(plain):
    few = {field: value[3:7] for field, value in plain.items()}
    with pytest.raises(InputError, match="4 satellites cannot determine 5 unknowns"):
        Geometry.from_arrays(**few)


def test_a_single_epoch(plain):
    g = Geometry.from_arrays(**plain)
    assert (len(g), g.is_series, g.satellite_count, g.unknown_count) == (1, False, 10, 5)
    assert g.clocks == ("G", "E")
    assert g.epoch == 0
    assert np.isnan(g.time_gps_s)
    np.testing.assert_array_equal(g.satellite, np.arange(10))
    assert g.in_view.all()
    with pytest.raises(InputError, match="a single epoch has no further epochs"):
        g[0]


def test_a_shared_clock_is_named_after_its_systems(plain):
    plain["design"] = np.hstack([plain["design"][:, :3], np.ones((10, 1))])
    assert Geometry.from_arrays(**plain).clocks == ("GE",)


def test_lists_of_whole_numbers_are_numbers():
    design = [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [-1, 0, 0, 1], [0, -1, 0, 1]]
    assert Geometry.from_arrays(design, [1, 2, 3, 4, 5], "GGGGG", "abcde").design.dtype == np.float64


def test_directions():
    """East, north, zenith, south-west at 45 deg."""
    half = np.sqrt(0.5)
    sight = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-0.5, -0.5, half], [0, -1, 0]])
    g = Geometry.from_arrays(np.hstack([-sight, np.ones((5, 1))]), np.ones(5), "GGGGG", "abcde")
    np.testing.assert_allclose(np.degrees(g.elevation_rad), [0, 0, 90, 45, 0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(g.azimuth_rad)[[0, 1, 3, 4]], [90, 0, 225, 180], atol=1e-12)


def test_packing(series):
    assert series.design.shape == (4, 7, 5)
    assert series.names == ("G01", "G02", "G03", "G04", "G05", "C06", "C07")
    assert series.systems == tuple("GGGGGCC")
    assert series.clocks == ("G", "C")
    np.testing.assert_array_equal(series.satellite_count, [7, 4, 3, 0])
    # The three coordinates stay unknown where nothing is in view.
    np.testing.assert_array_equal(series.unknown_count, [5, 4, 5, 3])
    np.testing.assert_array_equal(series.epoch, [0, 1, 2, 3])
    assert np.isnan(series.time_gps_s).all()
    # Satellites keep their order, those in view first.
    np.testing.assert_array_equal(series.satellite[1], [0, 2, 3, 4, 0, 0, 0])
    np.testing.assert_array_equal(series.satellite[2], [0, 5, 6, 0, 0, 0, 0])
    np.testing.assert_array_equal(series.in_view, np.arange(7) < series.satellite_count[:, None])
    assert np.all(series.design[~series.in_view] == 0)
    assert np.all(series.sigma_m[~series.in_view] == 1)


def test_padding_may_hold_anything():
    g = random_series(np.random.default_rng(2), IN_VIEW, SYSTEMS)
    full = random_series(np.random.default_rng(2), np.ones_like(IN_VIEW), SYSTEMS)
    arguments = {
        "in_view": IN_VIEW,
        "names": full.names,
        "systems": full.systems,
        "clocks": full.clocks,
        "design": np.where(IN_VIEW[..., None], full.design, np.nan),
        "sigma_m": np.where(IN_VIEW, full.sigma_m, -np.inf),
    }
    again = Geometry.from_rows(**arguments)
    jax.tree.map(np.testing.assert_array_equal, again, g)
    dated = Geometry.from_rows(**arguments, epoch=[5, 7, 9, 11], time_gps_s=[1.0, 2.0, 3.0, 4.0])
    assert dated[2].epoch == 9
    assert dated[2].time_gps_s == 3.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"in_view": np.zeros((4, 8), bool)}, "no satellite is in view at any epoch"),
        ({"sigma_m": np.zeros((4, 8))}, "sigma_m: a has 0; a sigma is finite and positive"),
        ({"sigma_m": np.full((4, 8), np.nan)}, "sigma_m: a has nan; a sigma is finite and positive"),
        ({"design": np.full((4, 8, 5), np.nan)}, "design: the row of a is not finite"),
        ({"systems": ["Q"] * 8}, "systems: 'Q' is unknown"),
        ({"names": ["G01"] * 8}, "names: 'G01' appears more than once"),
    ],
)
def test_rows_that_are_no_geometry(change, words):
    arguments = {
        "design": np.ones((4, 8, 5)),
        "sigma_m": np.ones((4, 8)),
        "in_view": IN_VIEW,
        "names": list("abcdefgh"),
        "systems": list(SYSTEMS),
        "clocks": ["G", "C"],
    }
    with pytest.raises(InputError, match=words):
        Geometry.from_rows(**(arguments | change))


def test_one_epoch_of_a_series(series):
    g = series[1]
    assert not g.is_series
    assert g.names == ("G01", "G03", "G04", "G05")
    assert g.clocks == ("G",)
    assert g.design.shape == (4, 4)
    assert g.epoch == 1
    np.testing.assert_array_equal(g.satellite, np.arange(4))
    np.testing.assert_array_equal(g.design, series.design[1, :4, :4])
    assert series[-2].names == series[2].names == ("G01", "C06", "C07")
    assert series[3].design.shape == (0, 3)
    assert series[np.int64(0)].names == series.names


def test_slices_are_series(series):
    part = series[1:3]
    assert part.is_series
    assert len(part) == 2
    np.testing.assert_array_equal(part.epoch, [1, 2])
    assert part.names == series.names
    np.testing.assert_array_equal(series[::2].epoch, [0, 2])
    assert part[0].names == series[1].names
    with pytest.raises(InputError, match="the slice 3:1 holds no epoch of 4"):
        series[3:1]


@pytest.mark.parametrize("index", [4, -5])
def test_epochs_that_do_not_exist(series, index):
    with pytest.raises(InputError, match=f"epoch index {index} is outside 0 to 3"):
        series[index]


def test_as_series(series):
    assert series.as_series() is series
    one = series[0].as_series()
    assert one.is_series
    assert len(one) == 1
    jax.tree.map(np.testing.assert_array_equal, one[0], series[0])


def test_jax_carries_it(series):
    for g in (series, series[0]):
        leaves, structure = jax.tree.flatten(g)
        again = jax.tree.unflatten(structure, leaves)
        assert isinstance(again, Geometry)
        assert (again.names, again.systems, again.clocks) == (g.names, g.systems, g.clocks)
        jax.tree.map(np.testing.assert_array_equal, again, g)
    total = jax.jit(lambda g: (g.design**2).sum() + len(g.names))(series)
    np.testing.assert_allclose(total, (series.design**2).sum() + 7, rtol=1e-14)


def test_it_is_immutable(series):
    with pytest.raises(dataclasses.FrozenInstanceError):
        series.names = ()
    with pytest.raises(dataclasses.FrozenInstanceError):
        del series.design
