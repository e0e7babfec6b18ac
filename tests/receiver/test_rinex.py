"""RINEX files as arrays, against states computed by hand formulas and by a second library."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import hatanaka
import numpy as np
import pytest
from receiver_files import (
    ALPHA,
    BETA,
    NOON_SOW,
    TRUTH_M,
    C,
    Sky,
    navigation_text,
    observation_text,
    reference_state,
    write_pair,
)
from rtklib_oracle import differences, rtklib_states

from pl_mc.receiver import ReceiverData, read_rinex


@pytest.fixture(scope="module")
def data(made_files: tuple[Path, Path]) -> ReceiverData:
    return read_rinex(*made_files)


def test_what_was_written_is_read(data: ReceiverData, made_sky: Sky) -> None:
    seen = [k for k, orbit in enumerate(made_sky.orbits) if np.isfinite(made_sky.pseudorange_m[:, k]).any()]
    assert sorted(data.names) == sorted(made_sky.orbits[k].name for k in seen)
    assert data.systems == tuple(name[0] for name in data.names)
    assert data.systems == tuple(sorted(data.systems, reverse=True))
    np.testing.assert_array_equal(data.time_gps_s, made_sky.times_gps_s)
    columns = [[orbit.name for orbit in made_sky.orbits].index(name) for name in data.names]
    np.testing.assert_allclose(data.pseudorange_m, made_sky.pseudorange_m[:, columns], atol=6e-4)
    np.testing.assert_array_equal(data.klobuchar_alpha, ALPHA)
    np.testing.assert_array_equal(data.klobuchar_beta, BETA)
    np.testing.assert_allclose(data.header_position_m, TRUTH_M + np.array([9, 0, -5]), atol=1e-4)
    assert not data.unhealthy.any()
    assert not data.no_ephemeris.any()


def test_states_at_transmission_are_those_of_the_interface_documents(data: ReceiverData, made_sky: Sky) -> None:
    by_name = {orbit.name: orbit for orbit in made_sky.orbits}
    assert {"C02", "C03"} <= set(data.names), "geostationary satellites are part of the check"
    for epoch, time in enumerate(data.time_gps_s):
        for column, name in enumerate(data.names):
            shown = time - data.pseudorange_m[epoch, column] / C
            _, clock = reference_state(by_name[name], shown)
            position, clock = reference_state(by_name[name], shown - clock)
            # Times in seconds since 1980 resolve 2e-7 s, in which a satellite moves a millimetre.
            np.testing.assert_allclose(data.satellite_position_m[epoch, column], position, atol=2e-3)
            expected = C * (clock - by_name[name].group_delay)
            assert data.satellite_clock_m[epoch, column] == pytest.approx(expected, abs=1e-6)


def test_states_are_those_of_rtklib(data: ReceiverData, made_files: tuple[Path, Path], tmp_path: Path) -> None:
    packed = tmp_path / "made.nav.gz"
    packed.write_bytes(gzip.compress(made_files[1].read_bytes()))
    count, position_m, clock_m = differences(rtklib_states(made_files[0], packed, tmp_path), data)
    assert count == 60
    assert position_m < 1e-3
    assert clock_m < 1e-5


def test_classes_of_orbit_come_from_the_ephemerides(data: ReceiverData) -> None:
    orbit = dict(zip(data.names, data.orbits, strict=True))
    assert orbit["C02"] == orbit["C03"] == "BDS-GEO"
    assert orbit["C06"] == orbit["C07"] == "BDS-IGSO"
    assert {orbit[name] for name in data.names if name[0] == "C" and int(name[1:]) >= 19} == {"BDS-MEO"}
    assert {orbit[name] for name in data.names if name[0] == "G"} == {"GPS"}


@pytest.mark.parametrize("packing", ["gz", "crx", "crx.gz"])
def test_packed_files_are_the_same(
    packing: str, made_files: tuple[Path, Path], data: ReceiverData, tmp_path: Path
) -> None:
    observations, navigation = (path.read_bytes() for path in made_files)
    if "crx" in packing:
        observations = hatanaka.rnx2crx(observations)
    if "gz" in packing:
        observations, navigation = gzip.compress(observations), gzip.compress(navigation)
    paths = tmp_path / f"packed.{packing}", tmp_path / "packed.nav"
    for path, content in zip(paths, (observations, navigation), strict=True):
        path.write_bytes(content)
    packed = read_rinex(*paths)
    assert packed.names == data.names
    np.testing.assert_array_equal(packed.pseudorange_m, data.pseudorange_m)
    np.testing.assert_array_equal(packed.satellite_position_m, data.satellite_position_m)


@pytest.mark.parametrize("version", ["3.02", "3.03", "3.05"])
def test_the_older_name_of_b1i_is_read(version: str, made_sky: Sky, data: ReceiverData, tmp_path: Path) -> None:
    text = observation_text(made_sky, version=version, b1i="C1I")
    older = read_rinex(*write_pair(tmp_path, text, navigation_text(made_sky.orbits)))
    assert older.names == data.names
    np.testing.assert_array_equal(older.pseudorange_m, data.pseudorange_m)


@pytest.mark.parametrize("systems", ["G", "C", "CG"])
def test_systems_can_be_chosen(systems: str, made_files: tuple[Path, Path], data: ReceiverData) -> None:
    chosen = read_rinex(*made_files, systems=tuple(systems))
    assert chosen.names == tuple(name for name in data.names if name[0] in systems)


def test_unhealthy_stale_and_damaged_ephemerides_are_told_apart(made_sky: Sky, tmp_path: Path) -> None:
    window_s = 7200
    changes = {"G02": {"health": 1}, "C22": {"health": 1}, "G05": {"toe": NOON_SOW + window_s + 61}}
    # The last epoch is one minute after noon: G06 and C23 are just inside the window, G05 just outside at all.
    changes |= {"G06": {"toe": NOON_SOW + window_s}, "C23": {"toe": NOON_SOW - 14 + window_s}}
    changes |= {"G09": {"root_a": 3000.0}}
    changed = [replace(orbit, **changes.get(orbit.name, {})) for orbit in made_sky.orbits if orbit.name != "C24"]
    data = read_rinex(*write_pair(tmp_path, observation_text(made_sky), navigation_text(changed)))
    column = {name: k for k, name in enumerate(data.names)}
    usable = np.isfinite(data.satellite_clock_m).all(axis=0)
    assert {name for name in data.names if data.unhealthy[:, column[name]].all()} == {"G02", "C22"}
    assert {name for name in data.names if data.no_ephemeris[:, column[name]].all()} == {"G05", "G09", "C24"}
    assert {name for name in data.names if not usable[column[name]]} == {"G02", "C22", "G05", "G09", "C24"}
    assert np.isnan(data.satellite_position_m[:, ~usable]).all()


def test_the_ephemeris_with_the_nearest_reference_time_counts(made_sky: Sky, tmp_path: Path) -> None:
    far = [replace(orbit, toe=orbit.toe + 3600, clock=(1e-4, 0.0, 0.0)) for orbit in made_sky.orbits]
    text = navigation_text([*far, *made_sky.orbits])
    data = read_rinex(*write_pair(tmp_path, observation_text(made_sky), text))
    by_name = {orbit.name: orbit for orbit in made_sky.orbits}
    for column, name in enumerate(data.names):
        _, clock = reference_state(by_name[name], data.time_gps_s[0] - 0.07)
        expected = C * (clock - by_name[name].group_delay)
        # The clock drifts by under a millimetre in the hundredths of a second that the travel times differ by.
        assert data.satellite_clock_m[0, column] == pytest.approx(expected, abs=1e-3)


def test_epochs_without_pseudoranges_are_counted(made_sky: Sky, tmp_path: Path) -> None:
    ranges = made_sky.pseudorange_m.copy()
    ranges[1] = np.nan
    text = observation_text(replace(made_sky, pseudorange_m=ranges))
    data = read_rinex(*write_pair(tmp_path, text, navigation_text(made_sky.orbits)))
    assert data.epochs_in_file == 3
    np.testing.assert_array_equal(data.time_gps_s, np.array(made_sky.times_gps_s)[[0, 2]])


def test_event_records_between_epochs_are_passed_over(made_sky: Sky, data: ReceiverData, tmp_path: Path) -> None:
    lines = observation_text(made_sky).splitlines()
    second = [k for k, line in enumerate(lines) if line.startswith(">")][1]
    event = [f">{'':30}4  1", f"{'an event':60}COMMENT"]
    text = "\n".join([*lines[:second], *event, *lines[second:]]) + "\n"
    again = read_rinex(*write_pair(tmp_path, text, navigation_text(made_sky.orbits)))
    np.testing.assert_array_equal(again.pseudorange_m, data.pseudorange_m)
