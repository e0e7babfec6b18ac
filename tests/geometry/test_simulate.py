"""The simulated sky: closed forms, the places of the papers, and options that cannot be used."""

from __future__ import annotations

import numpy as np
import pytest

from pl_mc.constants import K_VERTICAL
from pl_mc.error_models import Sky, error_model
from pl_mc.geometry import dops, redundancy_numbers, simulate
from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.frames import from_geodetic, geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.sites import SITES
from pl_mc.input_errors import InputError

WGS84_A_M, WGS84_E2 = 6_378_137.0, 6.694379990141317e-3


@pytest.fixture(scope="module")
def perth():
    """CUT0 on the day of the paper, every five minutes."""
    return simulate(epochs=288, interval_s=300.0)


def test_shapes_names_and_clocks(perth):
    assert perth.is_series
    assert len(perth) == 288
    assert perth.clocks == ("G", "C")
    assert perth.design.shape == (288, perth.satellite_count.max(), 5)
    assert perth.time_gps_s[0] == gps_seconds("2017-11-21")
    assert perth.time_gps_s[1] - perth.time_gps_s[0] == 300.0
    assert set(perth.names) == {slot.name for slot in constellation_slots(["GPS", "BDS-2"])}


def test_rows_are_unit_vectors_above_the_mask(perth):
    rows = perth.design[perth.in_view]
    np.testing.assert_allclose(np.linalg.norm(rows[:, :3], axis=1), 1.0)
    np.testing.assert_array_equal(rows[:, 3:].sum(axis=1), 1.0)
    assert np.degrees(perth.elevation_rad[perth.in_view]).min() >= 10.0
    systems = np.array(perth.systems)[perth.satellite[perth.in_view]]
    np.testing.assert_array_equal(rows[:, 3] == 1, systems == "G")


def test_sigma_is_the_model_s(perth):
    single = perth[100]
    orbit = {slot.name: slot.orbit for slot in constellation_slots(["GPS", "BDS-2"])}
    latitude, longitude, _ = geodetic(SITES["CUT0"].position_m)
    sky = Sky([orbit[n] for n in single.names], single.elevation_rad, single.azimuth_rad, latitude, longitude)
    np.testing.assert_allclose(single.sigma_m, error_model("residual").sigma_m(sky), rtol=1e-9)


@pytest.mark.parametrize(("latitude_deg", "longitude_deg"), [(-32.0, 115.9), (30.5, 114.5), (5.0, 80.0)])
def test_geostationary_satellites_in_closed_form(latitude_deg, longitude_deg):
    """Direction of a point in the equator plane from the ellipsoid, written out in east, north and up."""
    position = from_geodetic(np.radians(latitude_deg), np.radians(longitude_deg), 0.0)
    single = simulate(site=position, epochs=1, constellations="BDS-3", mask_deg=0.0)[0]
    row = single.names.index("C61")
    latitude, apart = np.radians(latitude_deg), np.radians(110.5 - longitude_deg)
    normal = WGS84_A_M / np.sqrt(1 - WGS84_E2 * np.sin(latitude) ** 2)
    east = 42_164e3 * np.sin(apart)
    north = -np.sin(latitude) * 42_164e3 * np.cos(apart) + normal * WGS84_E2 * np.sin(latitude) * np.cos(latitude)
    up = np.cos(latitude) * 42_164e3 * np.cos(apart) - normal * (1 - WGS84_E2 * np.sin(latitude) ** 2)
    assert single.azimuth_rad[row] == pytest.approx(np.arctan2(east, north) % (2 * np.pi), abs=1e-9)
    assert single.elevation_rad[row] == pytest.approx(np.arctan2(up, np.hypot(east, north)), abs=1e-9)


def test_satellite_counts_at_perth_are_plausible(perth):
    """24 GPS slots give 4 to 10 above 10 deg anywhere; most of regional BeiDou-2 stands over Australia."""
    systems = np.array(perth.systems)[perth.satellite]
    gps = ((systems == "G") & perth.in_view).sum(axis=1)
    beidou = ((systems == "C") & perth.in_view).sum(axis=1)
    assert 4 <= gps.min() < gps.max() <= 10
    assert 8 <= beidou.min() < beidou.max() <= 14


def test_every_epoch_at_perth_is_redundant(perth):
    r = redundancy_numbers(perth)
    np.testing.assert_allclose(r.sum(axis=1), perth.satellite_count - perth.unknown_count, atol=1e-9)
    assert dops(perth).pdop.max() < 3


def test_the_bound_of_do_229_alone_exceeds_the_alert_limit():
    """K_V sigma_up with sigma_UIRE: about 45 to 53 m, above VAL = 35 m, at all epochs of the day."""
    vpl = K_VERTICAL * dops(simulate(epochs=288, interval_s=300.0, error_model="uire"), weighted=True).vdop
    assert vpl.min() > 35.0
    assert 45.0 < np.median(vpl) < 53.0


def test_beidou_2_and_3_share_one_clock_after_gps_and_before_galileo():
    g = simulate(
        site="JFNG", start="2020-12-01", epochs=24, interval_s=3600.0, constellations=["GAL", "BDS-3", "GPS", "BDS-2"]
    )
    assert g.clocks == ("G", "C", "E")
    assert g.design.shape[2] == 6
    single = g[0]
    beidou = np.array(single.systems) == "C"
    np.testing.assert_array_equal(single.design[beidou, 3:], np.tile([0.0, 1.0, 0.0], (beidou.sum(), 1)))
    assert beidou.sum() > 15


def test_a_standing_track_is_a_site():
    place = SITES["CUT0"].position_m
    track = simulate(track_m=np.tile(place, (5, 1)))
    site = simulate(site=place, epochs=5)
    np.testing.assert_array_equal(track.design, site.design)
    np.testing.assert_array_equal(track.sigma_m, site.sigma_m)


def test_a_moving_track_sees_each_epoch_from_its_own_place():
    ends = np.array([SITES["CUT0"].position_m, SITES["JFNG"].position_m])
    track = simulate(track_m=ends, interval_s=60.0)
    for k, name in enumerate(("CUT0", "JFNG")):
        standing = simulate(site=name, epochs=2, interval_s=60.0)[k]
        assert track[k].names == standing.names
        np.testing.assert_array_equal(track[k].design, standing.design)
        np.testing.assert_array_equal(track[k].sigma_m, standing.sigma_m)


def test_satellites_switched_off_are_gone_and_nothing_else_changes():
    full = simulate(epochs=1)[0]
    less = simulate(epochs=1, without=full.names[:2])[0]
    assert less.names == full.names[2:]
    np.testing.assert_array_equal(less.design, full.design[2:])


def test_a_caller_s_mask_hides_satellites():
    slots = constellation_slots(["GPS", "BDS-2"])
    visible = np.ones((3, len(slots)), dtype=bool)
    full = simulate(epochs=3)
    hidden = full[1].names[0]
    visible[1, [slot.name for slot in slots].index(hidden)] = False
    got = simulate(epochs=3, visible=visible)
    assert got[0].names == full[0].names
    assert got[1].names == full[1].names[1:]


def test_a_lone_satellite_of_a_system_keeps_its_row():
    beidou = [slot.name for slot in constellation_slots("BDS-2") if slot.name != "C03"]
    g = simulate(epochs=2, without=beidou)
    assert g.clocks == ("G", "C")
    assert "C03" in g[0].names


def test_a_system_never_in_view_has_no_clock():
    beidou = [slot.name for slot in constellation_slots("BDS-2") if slot.name != "C05"]
    # C05 stands at 58.75 deg E, below the horizon of the middle of the Pacific.
    g = simulate(site=from_geodetic(0.1, np.radians(-150.0), 0.0), epochs=2, without=beidou)
    assert g.clocks == ("G",)
    assert g.design.shape[2] == 4


@pytest.mark.parametrize("latitude_deg", [90.0, -90.0, 0.0])
def test_poles_and_equator_are_places_like_others(latitude_deg):
    g = simulate(site=from_geodetic(np.radians(latitude_deg), 0.0, 0.0), epochs=3, constellations=["GPS", "GAL"])
    assert np.isfinite(dops(g).gdop).all()


def test_a_mask_of_zero_keeps_only_what_is_above_the_horizon():
    assert simulate(epochs=10, mask_deg=0.0).elevation_rad.min() >= 0.0


def test_the_mask_only_takes_away():
    low, high = simulate(epochs=1, mask_deg=5.0)[0], simulate(epochs=1, mask_deg=30.0)[0]
    assert set(high.names) < set(low.names)


class Flat:
    """A caller's own model."""

    name = "flat"

    def sigma_m(self, sky: Sky) -> np.ndarray:
        return np.full(sky.shape, 1.5)

    def describe(self) -> dict:
        return {"name": self.name}


def test_a_caller_s_error_model_is_used():
    g = simulate(epochs=2, error_model=Flat())
    np.testing.assert_array_equal(g.sigma_m[g.in_view], 1.5)


@pytest.mark.parametrize(
    ("sigma", "words"), [(1.5, "error model 'flat': one sigma per"), ([0.0], "finite and positive")]
)
def test_a_caller_s_error_model_is_checked(sigma, words, monkeypatch):
    monkeypatch.setattr(Flat, "sigma_m", lambda self, sky: np.resize(sigma, sky.shape if sigma != 1.5 else ()))
    with pytest.raises(InputError, match=words):
        simulate(epochs=2, error_model=Flat())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mask_deg": 90.0}, "mask_deg: 90 deg is outside the range from 0 to below 90 deg; nearest: below 90"),
        ({"mask_deg": -5.0}, "mask_deg: -5 deg .* nearest: 0"),
        ({"mask_deg": float("nan")}, "mask_deg: a finite number is needed, not nan"),
        ({"mask_deg": "ten"}, "mask_deg: a finite number is needed, not 'ten'"),
        ({"epochs": 0}, "epochs: 0 cannot be used; .* at least 1"),
        ({"epochs": 2.5}, "epochs: 2.5"),
        ({"epochs": True}, "epochs: True"),
        ({"interval_s": 0.0}, "interval_s: 0 s"),
        ({"interval_s": float("inf")}, "interval_s: a finite number is needed, not inf"),
        ({"start": "21.11.2017"}, "start: '21.11.2017' is not a date; .* 2017-11-21T00:00:00"),
        ({"constellations": ["GPS", "GLONASS"]}, "constellations: 'GLONASS' is unknown"),
        ({"without": ["G33"]}, "without: 'G33' is not in GPS, BDS-2"),
        ({"site": "CUTO"}, "site: 'CUTO' is unknown .nearest: CUT0"),
        ({"site": (1e6, 0.0, 0.0)}, "site: .* inside the Earth"),
        ({"site": "CUT0", "track_m": np.tile(SITES["CUT0"].position_m, (2, 1))}, "site: a track is given too"),
        ({"track_m": np.ones((2, 2))}, "track_m: epochs by 3 coordinates"),
        ({"track_m": np.empty((0, 3))}, "track_m: epochs by 3 coordinates"),
        ({"track_m": np.tile(SITES["CUT0"].position_m, (2, 1)), "epochs": 3}, "epochs: 3 were asked for, .* has 2"),
        ({"error_model": "iono"}, "error model: 'iono' is unknown"),
        ({"epochs": 2, "visible": np.ones((2, 5), dtype=bool)}, "visible: .*2, 38.*not bool .2, 5."),
        ({"epochs": 2, "visible": np.ones((2, 38))}, "visible: .*float64"),
        ({"epochs": 2, "visible": np.zeros((2, 38), dtype=bool)}, "no satellite is above the mask of 10 deg"),
        ({"epochs": 2, "mask_deg": 89.99}, "no satellite is above the mask"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        simulate(**options)
