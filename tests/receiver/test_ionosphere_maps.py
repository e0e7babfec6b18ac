"""Maps of the ionosphere whose delays are known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ionex_files import ionex

from pl_mc.cli.main import main
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.input_errors import InputError
from pl_mc.receiver import ReceiverSeries, read_receiver_series, read_truth
from pl_mc.receiver.ionosphere_maps import IonosphereMaps

FILES = Path(__file__).parent / "files"
PAIR = FILES / "mixed_3.obs", FILES / "mixed_3.nav"
TEXT = "4075580.8863,931853.5784,4801567.9707"
L1_HZ = 1575.42e6


def read(**options: object) -> ReceiverSeries:
    return read_receiver_series(*PAIR, read_truth(TEXT), systems=("G",), **options)


DAY = ("2020 6 24 12 0 0", "2020 6 25 0 0 0", "2020 6 25 12 0 0")


def test_a_layer_of_one_content_delays_as_its_formula_says(tmp_path: Path) -> None:
    # 20 TECU at midnight, the time of the two epochs, 18 s before which UTC is.
    path = ionex(tmp_path, lambda k, *_: (10.0, 20.0, 50.0)[k], DAY)
    none, maps = read(ionosphere="none"), read(ionex=path)
    np.testing.assert_array_equal(none.geometry.design, maps.geometry.design)
    for epoch in range(2):
        elevation = np.arcsin(-none.geometry.design[epoch, :, 2])
        zenith = np.arcsin(6371.0 / (6371.0 + 450.0) * np.cos(elevation))
        expected_m = 40.3e16 * 20.0 / L1_HZ**2 / np.cos(zenith)
        taken_m = none.errors_m[epoch] - maps.errors_m[epoch]
        # The clock of each is the median, so that differences between satellites tell; 12 h have 10 TECU, 18 s 1e-3 m.
        np.testing.assert_allclose(np.diff(taken_m), np.diff(expected_m), atol=3e-3)
    assert np.ptp(expected_m) > 2.0


def test_files_of_several_days_are_taken_together_and_what_none_covers_is_refused(tmp_path: Path) -> None:
    before = ionex(tmp_path, lambda *_: 20.0, ("2020 6 23 0 0 0", "2020 6 24 0 0 0"), "before.20i")
    there = ionex(tmp_path, lambda *_: 20.0, DAY)
    np.testing.assert_array_equal(read(ionex=[before, there]).errors_m, read(ionex=there).errors_m)
    with pytest.raises(InputError, match=r"before\.20i: the maps do not cover the observations"):
        read(ionex=before)
    with pytest.raises(InputError, match="not of dual"):
        read(ionex=there, ionosphere="dual")
    with pytest.raises(InputError, match=r"mixed_3\.nav: it cannot be read as maps"):
        read(ionex=PAIR[1])
    with pytest.raises(InputError, match="there is no such file"):
        read(ionex=tmp_path / "no.20i")


@pytest.mark.usefixtures("without_figures")
def test_the_command_takes_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = ionex(tmp_path, lambda *_: 20.0, DAY)
    options = ["--truth", TEXT, "--systems", "G", "--method", "ls", "--out", str(tmp_path / "out")]
    options += ["--ionex", str(path)]
    main(["observe", *map(str, PAIR), *options])
    assert "ionosphere by maps" in " ".join(capsys.readouterr().out.split())


FOUR_HOURS = ("2020 6 25 0 0 0", "2020 6 25 2 0 0", "2020 6 25 4 0 0")
# What a TECU in the vertical delays on L1 [m].
TECU_M = 40.3e16 / L1_HZ**2


class Rays:
    """Rays to anywhere from anywhere but the poles, where they meet a layer, and by what it delays them more."""

    def __init__(self, count: int = 200, radius_km: float = 6371.0, layer_km: float = 450.0) -> None:
        rng = np.random.default_rng(1)
        self.angles = {
            "latitude_rad": np.radians(rng.uniform(-60, 60, count)),
            "longitude_rad": np.radians(rng.uniform(-120, 120, count)), "azimuth_rad": rng.uniform(0, 6.28, count),
            "elevation_rad": np.radians(rng.uniform(5, 90, count)),
        }  # fmt: skip
        latitude, longitude, azimuth, elevation = self.angles.values()
        sine = radius_km / (radius_km + layer_km) * np.cos(elevation)
        earth = np.pi / 2 - elevation - np.arcsin(sine)
        point = np.arcsin(np.sin(latitude) * np.cos(earth) + np.cos(latitude) * np.sin(earth) * np.cos(azimuth))
        east = longitude + np.arcsin(np.sin(earth) * np.sin(azimuth) / np.cos(point))
        self.latitude_deg, self.longitude_deg = np.degrees(point), np.degrees(east)
        self.slant = 1.0 / np.sqrt(1.0 - sine**2)

    def content_tecu(self, paths: Path | list[Path], after_midnight_s: float) -> np.ndarray:
        """The vertical content that files give to these rays, so many seconds of UTC after midnight."""
        # GPS time is 18 s ahead of UTC.
        time_s = np.full(self.slant.size, gps_seconds("2020-06-25T00:00:18") + after_midnight_s)
        return IonosphereMaps(paths).delay_m(time_s, **self.angles) / TECU_M / self.slant


@pytest.mark.parametrize(
    "options",
    [
        {}, {"exponent": 0}, {"exponent": -2}, {"exponent": 1}, {"mapping": "NONE"}, {"north": (-87.5, 87.5)},
        {"east": (0.0, 360.0)}, {"east": (0.0, 355.0)}, {"layer_km": 350.0, "radius_km": 6378.0},
    ],
)  # fmt: skip
def test_one_content_everywhere_in_any_form_of_the_grid(options: dict, tmp_path: Path) -> None:
    path = ionex(tmp_path, lambda *_: 20.0, FOUR_HOURS, **options)
    rays = Rays(**{name: options[name] for name in ("layer_km", "radius_km") if name in options})
    np.testing.assert_allclose(rays.content_tecu(path, 3000.25), 20.0, rtol=1e-12)


def test_contents_are_linear_between_the_nodes_of_the_grid(tmp_path: Path) -> None:
    rays = Rays()
    path = ionex(tmp_path, lambda _, north, east: 50.0 + 0.2 * north + 0.1 * east, FOUR_HOURS[:1], exponent=-2)
    expected = 50.0 + 0.2 * rays.latitude_deg + 0.1 * rays.longitude_deg
    np.testing.assert_allclose(rays.content_tecu(path, 0.0), expected, rtol=1e-12)


@pytest.mark.parametrize("after_s", [0.0, 900.5, 3600.0, 7199.0, 7200.0, 9000.0, 14_400.0])
def test_between_maps_in_time_a_content_goes_with_the_sun(after_s: float, tmp_path: Path) -> None:
    rays = Rays()
    # A slope on the first map alone, on which the point of a ray lies so many degrees further east as the Earth turned.
    path = ionex(tmp_path, lambda k, _, east: 50.0 + (0.1 * east if k == 0 else 10.0 * k), FOUR_HOURS, exponent=-2)
    part = after_s / 7200.0
    first = 50.0 + 0.1 * (rays.longitude_deg + after_s / 240.0)
    expected = (1.0 - part) * first + part * 60.0 if part <= 1 else 60.0 + 10.0 * (part - 1.0)
    np.testing.assert_allclose(rays.content_tecu(path, after_s), expected, rtol=1e-12)


def test_maps_of_a_region_are_not_turned(tmp_path: Path) -> None:
    rays = Rays()
    path = ionex(
        tmp_path, lambda k, _, east: 50.0 + 0.1 * east * (k == 0), FOUR_HOURS, exponent=-2, east=(-170.0, 170.0)
    )
    np.testing.assert_allclose(rays.content_tecu(path, 3600.0), 50.0 + 0.05 * rays.longitude_deg, rtol=1e-12)


def test_a_day_that_ends_before_midnight_goes_on_in_the_next_file(tmp_path: Path) -> None:
    before = ionex(tmp_path, lambda *_: 10.0, ("2020 6 24 21 0 0", "2020 6 24 23 0 0"), "before.20i")
    there = ionex(tmp_path, lambda *_: 30.0, ("2020 6 25 1 0 0", "2020 6 25 3 0 0"), "there.20i")
    late = ionex(tmp_path, lambda *_: 30.0, ("2020 6 25 2 30 0", "2020 6 25 4 30 0"), "late.20i")
    rays = Rays()
    for paths in ([before, there], [there, before]):
        np.testing.assert_allclose(rays.content_tecu(paths, 1800.0), 25.0, rtol=1e-12)
    with pytest.raises(InputError, match=r"2020-06-25 00:30:00 UTC is not within them, which are of 2020-06-24 21:00"):
        rays.content_tecu([before, late], 1800.0)


@pytest.mark.parametrize("after_s", [-1.0, 14_401.0])
def test_times_before_the_first_and_after_the_last_map_are_refused(after_s: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the maps do not cover the observations; 2020-06-2"):
        Rays().content_tecu(ionex(tmp_path, lambda *_: 20.0, FOUR_HOURS), after_s)


def test_missing_values_and_places_outside_are_refused_where_a_ray_needs_them(tmp_path: Path) -> None:
    rays = Rays()
    south = ionex(tmp_path, lambda _, north, __: 20.0 if north >= 0 else np.nan, FOUR_HOURS)
    with pytest.raises(InputError, match=r"the map of 2020-06-25 00:00:00 UTC has no value where a satellite is seen"):
        rays.content_tecu(south, 60.0)
    # A map without any value costs the times that it has a part in.
    second = ionex(tmp_path, lambda k, *_: np.nan if k == 1 else 20.0, FOUR_HOURS)
    np.testing.assert_allclose(rays.content_tecu(second, 0.0), 20.0, rtol=1e-12)
    with pytest.raises(InputError, match="the map of 2020-06-25 02:00:00 UTC has no value"):
        rays.content_tecu(second, 60.0)
    with pytest.raises(InputError, match="latitude outside grid"):
        rays.content_tecu(ionex(tmp_path, lambda *_: 20.0, FOUR_HOURS, north=(70.0, 30.0)), 60.0)


def test_packed_maps(tmp_path: Path) -> None:
    import gzip

    import ncompress

    content = ionex(tmp_path, lambda *_: 20.0, FOUR_HOURS).read_bytes()
    for name, pack in (("a.20i.gz", gzip.compress), ("a.20i.Z", ncompress.compress)):
        (tmp_path / name).write_bytes(pack(content))
        np.testing.assert_allclose(Rays().content_tecu(tmp_path / name, 60.0), 20.0, rtol=1e-12)
