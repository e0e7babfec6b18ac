"""A geometry as a table, cut to some satellites, in a line; sites by latitude, longitude and height."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import pl_mc
from pl_mc.geometry.sites import SITES, site_position_m
from pl_mc.input_errors import InputError


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    return pl_mc.simulate(site="CUT0", epochs=5, interval_s=5400.0)


def test_a_row_for_each_satellite_in_view(series: pl_mc.Geometry) -> None:
    table = series.to_frame()
    assert len(table) == series.in_view.sum()
    np.testing.assert_array_equal(table.groupby("epoch").size(), series.satellite_count)
    one = series[2]
    alone = table[table.epoch == 2].reset_index(drop=True)
    assert alone.satellite.tolist() == list(one.names)
    assert alone.system.tolist() == list(one.systems)
    np.testing.assert_allclose(alone.elevation_deg, np.degrees(one.elevation_rad), rtol=1e-12)
    np.testing.assert_allclose(alone.azimuth_deg, np.degrees(one.azimuth_rad), rtol=1e-12)
    np.testing.assert_array_equal(alone.sigma_m, one.sigma_m)
    assert one.to_frame().equals(alone)


def test_some_satellites_alone(series: pl_mc.Geometry) -> None:
    """As if the others had never been there; a single epoch is that of the series."""
    names = [name for name in series.names if name.startswith("G")]
    few = series.sel(satellite=names)
    table = series.to_frame()
    assert few.to_frame().equals(table[table.satellite.isin(names)].reset_index(drop=True))
    np.testing.assert_array_equal(few.unknown_count, 4)
    here, there = few[1], series[1].sel(satellite=[name for name in series[1].names if name.startswith("G")])
    assert here.names == there.names
    for field in ("design", "sigma_m"):
        np.testing.assert_array_equal(getattr(here, field), getattr(there, field))
    faults = pl_mc.no_fault(few)
    gps = pl_mc.simulate(site="CUT0", epochs=5, interval_s=5400.0, constellations=("GPS",))
    alike = [pl_mc.exact.ls_rates(g, pl_mc.no_fault(g)).exceeded_rate for g in (few, gps)]
    np.testing.assert_allclose(*alike, rtol=1e-9)
    assert len(faults) == 1
    assert series.sel(satellite=series.names[3]).names == (series.names[3],)


@pytest.mark.parametrize(
    ("satellite", "words"),
    [("G99", "satellite: 'G99' is not in view .nearest: "), ([], "geometry: no satellite is in view at any epoch"),
     ([3], "satellite: a sequence of names is needed")],
)  # fmt: skip
def test_satellites_that_are_not_there(series: pl_mc.Geometry, satellite: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        series.sel(satellite=satellite)  # type: ignore[arg-type]


def test_a_geometry_in_a_line(series: pl_mc.Geometry) -> None:
    low, high = series.satellite_count.min(), series.satellite_count.max()
    expected = f"Geometry(5 epochs, {low}-{high} satellites at once, {len(series.names)} in all: GPS, BeiDou)"
    assert repr(series) == expected
    assert repr(series[3]) == f"Geometry(epoch 3, {series.satellite_count[3]} satellites: GPS, BeiDou)"


def test_over_epochs_and_satellites(series: pl_mc.Geometry) -> None:
    if importlib.util.find_spec("xarray") is None:
        with pytest.raises(InputError, match="to_xarray: it needs the package xarray"):
            series.to_xarray()
        return
    cube = series.to_xarray()
    assert dict(cube.sizes) == {"epoch": 5, "satellite": len(series.names)}
    assert int(cube.sigma_m.notnull().sum()) == series.in_view.sum()


@pytest.mark.parametrize("name", sorted(SITES))
def test_a_site_by_latitude_longitude_and_height(name: str) -> None:
    from pl_mc.geometry.frames import geodetic

    position = site_position_m(name)
    latitude, longitude, height = (float(value) for value in geodetic(position))
    given = (np.degrees(latitude), np.degrees(longitude), height)
    for form in (given, ",".join(f"{value:.15g}" for value in given)):
        np.testing.assert_allclose(site_position_m(form), position, atol=1e-6)
    with pytest.raises(InputError, match="site: a height of 200000 m is above the limit"):
        site_position_m((given[0], given[1], 2e5))
