"""The series of a made-up receiver: errors that are known exactly, and the notes on what was left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from receiver_files import TRUTH_M, TRUTH_TEXT, Sky, navigation_text, observation_text, simulate, write_pair

from pl_mc.error_models import error_model
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverSeries, Truth, read_receiver_series, read_truth

TRUTH = read_truth(TRUTH_TEXT)


def least_squares(series: ReceiverSeries, epoch: int) -> NDArray[np.float64]:
    """East, north, up of the weighted least-squares solution [m]."""
    g, errors = series.geometry[epoch], series.errors_m[epoch][series.geometry.in_view[epoch]]
    solution, *_ = np.linalg.lstsq(g.design / g.sigma_m[:, None], errors / g.sigma_m, rcond=None)
    return solution[:3]


@pytest.fixture(scope="module")
def series(made_files: tuple[Path, Path]) -> ReceiverSeries:
    return read_receiver_series(*made_files, TRUTH)


def test_the_biases_come_back_and_nothing_else(series: ReceiverSeries, made_sky: Sky) -> None:
    g = series.geometry
    assert series.notes == ()
    np.testing.assert_array_equal(g.time_gps_s, made_sky.times_gps_s)
    for epoch in range(len(g)):
        rows = g.in_view[epoch]
        names = [g.names[k] for k in g.satellite[epoch][rows]]
        expected = [made_sky.bias_m.get(name, 0.0) for name in names]
        assert set(made_sky.bias_m) <= set(names)
        # Pseudoranges are written to a millimetre, half of which the medians may add.
        np.testing.assert_allclose(series.errors_m[epoch][rows], expected, atol=2e-3)
        assert not series.errors_m[epoch][~rows].any()


def test_design_and_sigma_are_those_of_the_true_position(series: ReceiverSeries) -> None:
    g = series.geometry
    assert g.clocks == ("G", "C")
    rows = g.in_view
    np.testing.assert_allclose(np.linalg.norm(g.design[rows][:, :3], axis=1), 1.0, rtol=1e-12)
    is_gps = np.array(g.systems)[g.satellite] == "G"
    np.testing.assert_array_equal(g.design[..., 3][rows], is_gps[rows])
    np.testing.assert_array_equal(g.design[..., 4][rows], ~is_gps[rows])
    assert g.elevation_rad[rows].min() >= np.radians(10.0)
    kind = {"C02": 1.0, "C03": 1.0}
    sigma0 = np.array([kind.get(name, 0.3 if name[0] == "G" else 0.6) for name in g.names])[g.satellite[rows]]
    bare = read_bare_sigma(g.elevation_rad[rows], sigma0)
    np.testing.assert_allclose(g.sigma_m[rows], bare, rtol=1e-9)


def read_bare_sigma(elevation_rad: NDArray[np.float64], sigma0_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Equation 3 with 0.5 m of vertical ionosphere, written out."""
    sine = np.sin(elevation_rad)
    obliquity = 1 / np.sqrt(1 - (6378136.3 / 6728136.3 * np.cos(elevation_rad)) ** 2)
    return np.sqrt(sigma0_m**2 / sine + (0.5 * obliquity) ** 2 + (0.12 * 1.001) ** 2 / (0.002001 + sine**2))


def test_a_wrong_truth_comes_back_as_the_position_error(tmp_path: Path) -> None:
    clean = simulate(seconds=(0.0,))
    paths = write_pair(tmp_path, observation_text(clean), navigation_text(clean.orbits))
    moved_m = np.array([3.0, -2.0, 4.0])
    latitude, longitude, _ = geodetic(TRUTH_M)
    position = TRUTH_M - enu_rotation(latitude, longitude).T @ moved_m
    series = read_receiver_series(*paths, Truth(np.empty(0), position[None], "moved"))
    # What is left: millimetres of rounding, and the troposphere over 4 m of height, times the dilution.
    np.testing.assert_allclose(least_squares(series, 0), moved_m, atol=0.01)


@pytest.mark.parametrize("systems", [("G",), ("C",), ("C", "G")])
def test_clock_columns_follow_the_systems(systems: tuple[str, ...], made_files: tuple[Path, Path]) -> None:
    series = read_receiver_series(*made_files, TRUTH, systems=systems)
    g = series.geometry
    assert g.clocks == systems
    assert set(g.systems) == set(systems)
    for column, letter in enumerate(systems):
        mine = (np.array(g.systems)[g.satellite] == letter) & g.in_view
        np.testing.assert_array_equal(g.design[..., 3 + column], mine)


def test_mask_and_error_model_are_used(made_files: tuple[Path, Path], series: ReceiverSeries) -> None:
    high = read_receiver_series(*made_files, TRUTH, mask_deg=30.0, error_model="none")
    assert high.geometry.elevation_rad[high.geometry.in_view].min() >= np.radians(30.0)
    assert high.geometry.satellite_count.max() < series.geometry.satellite_count.min()
    same = read_receiver_series(*made_files, TRUTH, error_model=error_model("residual"))
    np.testing.assert_array_equal(same.geometry.sigma_m, series.geometry.sigma_m)


def test_epochs_without_truth_are_skipped_and_reported(made_files: tuple[Path, Path], made_sky: Sky) -> None:
    times = np.array(made_sky.times_gps_s)
    truth = Truth(times[1:] - 0.5, np.stack([TRUTH_M, TRUTH_M]), "track")
    with pytest.raises(InputError, match=r"2020-06-25.*no position at any epoch"):
        read_receiver_series(*made_files, truth)
    truth = Truth(times[1:], np.stack([TRUTH_M, TRUTH_M]), "track")
    series = read_receiver_series(*made_files, truth)
    assert series.geometry.epoch.tolist() == [1, 2]
    assert series.errors_m.shape[0] == series.truth_m.shape[0] == 2
    assert "1 of 3 epochs are skipped: they have no true position." in series.notes


def test_left_out_satellites_are_named(made_sky: Sky, tmp_path: Path) -> None:
    column = {orbit.name: k for k, orbit in enumerate(made_sky.orbits)}
    ranges = made_sky.pseudorange_m.copy()
    ranges[0, column["G06"]], ranges[1, column["G06"]], ranges[2, column["C23"]] = 1e7, 6e7, 1.4e7
    ranges[1, column["G16"]] += 2e3
    gone = {"G09": {"health": 1}, "C24": {"toe": made_sky.orbits[0].toe + 8000}}
    orbits = [replace(orbit, **gone.get(orbit.name, {})) for orbit in made_sky.orbits]
    paths = write_pair(tmp_path, observation_text(replace(made_sky, pseudorange_m=ranges)), navigation_text(orbits))
    series = read_receiver_series(*paths, TRUTH)
    assert series.notes == (
        "G09 (3 epochs): left out as unhealthy.",
        "C24 (3 epochs): left out for want of a usable ephemeris.",
        "G06 (2 epochs), C23 (1 epoch): left out for a pseudorange outside 1.5e+07 to 5e+07 m.",
        "G16 (1 epoch): kept in spite of an error of more than 1000 m.",
    )
    assert not {"G09", "C24"} & set(series.geometry.names)


def test_lone_satellites_and_empty_epochs_are_reported(made_sky: Sky, tmp_path: Path) -> None:
    ranges = made_sky.pseudorange_m.copy()
    is_bds = np.array([orbit.name[0] == "C" for orbit in made_sky.orbits])
    lone = [orbit.name for orbit in made_sky.orbits].index("C22")
    ranges[0, is_bds & (np.arange(is_bds.size) != lone)] = np.nan
    ranges[1, is_bds] = np.nan
    text = observation_text(replace(made_sky, pseudorange_m=ranges))
    series = read_receiver_series(*write_pair(tmp_path, text, navigation_text(made_sky.orbits)), TRUTH)
    assert len(series.notes) == 2
    assert series.notes[0] == "BeiDou has no satellite in view at 1 epoch."
    assert series.notes[1].startswith("BeiDou has a lone satellite at 1 epoch;")
    assert series.geometry.unknown_count.tolist() == [5, 4, 5]


@pytest.mark.parametrize("mask_deg", [-1.0, 90.0, float("nan")])
def test_masks_outside_the_sky_are_refused(mask_deg: float, made_files: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match="mask_deg"):
        read_receiver_series(*made_files, TRUTH, mask_deg=mask_deg)


def test_a_truth_elsewhere_is_refused(made_files: tuple[Path, Path]) -> None:
    perth = read_truth("-2364337.441, 4870285.621, -3360809.672")
    with pytest.raises(InputError, match="km from the approximate position"):
        read_receiver_series(*made_files, perth)


def test_no_usable_epoch_is_refused(made_files: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match="no epoch can be used"):
        read_receiver_series(*made_files, TRUTH, mask_deg=89.9)
