"""Claims beside methods: counts and shares that are known beforehand, and the whole of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import AlertLimits, Judged
from pl_mc.cli.main import main
from pl_mc.engine.stanford import HAZARDOUS, MISLEADING, NOMINAL, REGIONS, REJECTED, UNAVAILABLE
from pl_mc.geometry import Geometry
from pl_mc.geometry.frames import enu_rotation, geodetic
from pl_mc.geometry.gps_time import gps_dates
from pl_mc.input_errors import InputError
from pl_mc.receiver import read_truth
from pl_mc.studies.observe.claims import Claims, independent_epochs
from pl_mc.studies.observe.stanford import stanford_table

TRUTH_M = np.array([3582104.8991, 532590.1966, 5232755.2961])
TRUTH_TEXT = ",".join(map(str, TRUTH_M))
FILES = Path(__file__).parents[1] / "receiver" / "files"


@pytest.fixture(scope="module")
def g() -> Geometry:
    return pl_mc.simulate(site="CUT0", start="2020-06-25", constellations=("GPS",), epochs=2000)


def claims(folder: Path, g: Geometry, heading: str, rows: np.ndarray, name: str = "r.csv") -> Claims:
    path = folder / name
    path.write_text("\n".join([heading, *(",".join(f"{v:.6f}" for v in row) for row in rows)]) + "\n")
    return Claims(path, name, g, read_truth(TRUTH_TEXT))


def test_white_gaussian_errors_lie_within_their_sigmas_as_often_as_they_should(tmp_path: Path, g: Geometry) -> None:
    drawn = np.random.default_rng(5).standard_normal((len(g.epoch), 3)) * [2.0, 3.0, 5.0]
    latitude, longitude, _ = geodetic(TRUTH_M)
    position = TRUTH_M + drawn @ enu_rotation(latitude, longitude)
    sigma = np.broadcast_to([2.0, 3.0, 5.0], drawn.shape)
    rows = np.column_stack([g.time_gps_s, position, sigma])
    found = pd.DataFrame(claims(tmp_path, g, "time_gps_s,x_m,y_m,z_m,sde_m,sdn_m,sdu_m", rows).coverage(g))
    assert found.axis.tolist() == ["horizontal", "horizontal", "vertical", "vertical"]
    assert found.expected.tolist() == [0.683, 0.95, 0.683, 0.95]
    # Rayleigh: sqrt(-2 ln(1 - p)); normal: the quantile of (1 + p) / 2.
    assert found.multiplier.tolist() == pytest.approx([1.5158, 2.4477, 1.0006, 1.9600], abs=1e-4)
    spread = np.sqrt(found.expected * (1 - found.expected) / len(g.epoch))
    assert (np.abs(found.within_rate - found.expected) < 3.5 * spread).all()
    assert (found.independent > 1500).all()
    assert ((found.within_low < found.expected) & (found.expected < found.within_high)).all()
    # The same errors with half of the sigmas: 1.5158 of two directions at half hold 1 - exp(-1.5158^2 / 8).
    rows[:, 4:] /= 2.0
    found = pd.DataFrame(claims(tmp_path, g, "time_gps_s,x_m,y_m,z_m,sde_m,sdn_m,sdu_m", rows).coverage(g))
    assert found.within_rate.tolist() == pytest.approx([0.2497, 0.5271, 0.3831, 0.6729], abs=0.04)
    assert (found.within_high < found.expected).all()


def test_a_horizontal_accuracy_is_that_of_both_directions(tmp_path: Path, g: Geometry) -> None:
    drawn = np.random.default_rng(6).standard_normal((len(g.epoch), 3)) * [2.0, 2.0, 5.0]
    rows = np.column_stack([g.time_gps_s, drawn, np.full((len(g.epoch), 2), [np.sqrt(8.0), 5.0])])
    found = pd.DataFrame(claims(tmp_path, g, "time_gps_s,east_m,north_m,up_m,hacc_m,vacc_m", rows).coverage(g))
    # Of two directions 63.2 % lie within the root of the sum of both variances.
    assert found.expected.tolist() == pytest.approx([0.683, 0.95, 0.6321, 0.683, 0.95], abs=1e-4)
    assert (np.abs(found.within_rate - found.expected) < 0.04).all()


def test_claimed_levels_are_counted_by_region_axis_by_axis(tmp_path: Path, g: Geometry) -> None:
    # Four sorts of epochs: fine; beyond the level; beyond level and limit; with a level beyond the limit.
    sorts = np.array([[3.0, 4.0, 1.0, 9.0, 6.0], [3.0, 4.0, 7.0, 9.0, 6.0], [30.0, 40.0, 15.0, 9.0, 6.0],
                      [0.0, 0.0, 0.0, 25.0, 12.0]])  # fmt: skip
    which = np.repeat([0, 1, 2, 3], [1700, 200, 60, 40])[np.random.default_rng(1).permutation(2000)]
    rows = np.column_stack([g.time_gps_s, sorts[which]])
    found = claims(tmp_path, g, "time_gps_s,east_m,north_m,up_m,hpl_m,vpl_m", rows)
    alert = AlertLimits("mine", vertical_m=10.0, horizontal_m=20.0)
    (table,) = found.rows(g, Judged(alert, "either"), None)
    table.insert(1, "time", gps_dates(table.pop("time_gps_s")))
    counts = stanford_table(table, alert).set_index(["axis", "region"])["count"]
    for axis, expected in (
        ("vertical", {NOMINAL: 1700, MISLEADING: 200, HAZARDOUS: 60, UNAVAILABLE: 40}),
        ("horizontal", {NOMINAL: 1900, MISLEADING: 0, HAZARDOUS: 60, UNAVAILABLE: 40}),
    ):
        assert {region: counts[axis, region] for region in REGIONS if counts[axis, region]} == {
            region: number for region, number in expected.items() if number
        }
    assert table.alarm.sum() == 40
    table["rejected"] = np.arange(2000) < 500
    counts = stanford_table(table, alert).set_index(["axis", "region"])["count"]
    assert counts["vertical", REJECTED] == 500
    assert found.coverage(g) == []


def test_sigmas_become_levels_by_the_multiplier_that_is_told(tmp_path: Path, g: Geometry) -> None:
    rows = np.column_stack([g.time_gps_s, np.zeros((len(g.epoch), 3)), np.full((len(g.epoch), 3), [3.0, 4.0, 5.0])])
    found = claims(tmp_path, g, "time_gps_s,east_m,north_m,up_m,sde_m,sdn_m,sdu_m", rows)
    ((hpl_m, vpl_m),) = found.levels_m(None).values()
    assert (hpl_m[0], vpl_m[0]) == pytest.approx((6.18 * 4.0, 5.33 * 5.0))
    ((hpl_m, vpl_m),) = found.levels_m(2.0).values()
    assert (hpl_m[0], vpl_m[0]) == pytest.approx((8.0, 10.0))
    # The longer axis of an ellipse that lies across: variances 25 and 1 along the diagonals.
    found.fixes.covariance_m2[:, :2, :2] = [[13.0, 12.0], [12.0, 13.0]]
    ((hpl_m, _),) = found.levels_m(1.0).values()
    assert hpl_m[0] == pytest.approx(5.0)


def test_claims_are_joined_with_the_nearest_epoch_and_the_rest_is_told(tmp_path: Path, g: Geometry) -> None:
    seconds = g.time_gps_s[0] + np.array([-30.0, 0.004, 0.4, 14.0, 29.8, 60.0])
    rows = np.column_stack([seconds, np.zeros((6, 3)), np.arange(6.0) + 1.0, np.ones(6)])
    found = claims(tmp_path, g, "time_gps_s,east_m,north_m,up_m,hpl_m,vpl_m", rows)
    assert found.place.tolist() == [0, 1, 2]
    assert found.kept.tolist() == [1, 4, 5]
    assert found.notes[-1] == "r.csv: 3 of 6 positions are at no epoch that is judged, and were left out."
    with pytest.raises(InputError, match="none of its 1 times is that of an epoch"):
        claims(tmp_path, g, "time_gps_s,east_m,north_m,up_m,hpl_m,vpl_m", rows[:1])


def test_correlated_errors_are_worth_fewer_epochs(g: Geometry) -> None:
    fresh, up = np.random.default_rng(2).standard_normal(2000), np.zeros(2000)
    for k in range(1, 2000):
        up[k] = 0.9 * up[k - 1] + fresh[k]
    table = pd.DataFrame({"time": gps_dates(g.time_gps_s), "up_m": up, "vpl_m": 10.0, "available": True})
    # 2000 / 19; one series of that many tells its own correlation to half of it.
    assert independent_epochs(table, Judged(pl_mc.LPV_200)) == pytest.approx(2000 / 19, rel=0.6)
    table["up_m"] = fresh
    assert independent_epochs(table, Judged(pl_mc.LPV_200)) > 1500


@pytest.mark.usefixtures("without_figures")
def test_a_run_with_the_claims_of_a_solution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = str(FILES / "mixed_3.obs"), str(FILES / "mixed_3.nav")
    truth = "4075580.8863,931853.5784,4801567.9707"
    # The two epochs of the file, 100 m above the truth with 10 m claimed, and in its place.
    lines = ["% program: none", "%  GPST x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m)"]
    position = np.array([float(part) for part in truth.split(",")])
    main(["observe", *files, "--truth", truth, "-q", "--out", str(tmp_path / "bare")])
    times = pd.read_parquet(tmp_path / "bare" / "epochs.parquet").time.unique()
    for time, factor in zip(times, (1.0, 1.0 + 100.0 / np.linalg.norm(position)), strict=True):
        x, y, z = position * factor
        lines.append(f"{pd.Timestamp(time):%Y/%m/%d %H:%M:%S.%f} {x:.4f} {y:.4f} {z:.4f} 5 9 3 3 3")
    (tmp_path / "mine.pos").write_text("\n".join(lines) + "\n")
    capsys.readouterr()
    options = ["--claims", str(tmp_path / "mine.pos"), "--hal", "30", "--val", "50", "--claim-multiplier", "2"]
    main(["observe", *files, "--truth", truth, *options, "--out", str(tmp_path / "out")])
    said = " ".join(capsys.readouterr().out.split())
    assert "made such with 2 horizontally" in said
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    mine = table[table.method == "mine.pos"]
    assert mine.vpl_m.tolist() == pytest.approx([6.0, 6.0])
    assert mine.up_m.tolist() == pytest.approx([0.0, 100.0], abs=1e-3)
    assert mine.satellites.tolist() == [9, 9]
    regions = pd.read_csv(tmp_path / "out" / "stanford.csv").set_index(["method", "axis", "region"])["count"]
    assert regions["mine.pos", "vertical", HAZARDOUS] == 1
    assert regions["mine.pos", "vertical", NOMINAL] == 1
    coverage = pd.read_csv(tmp_path / "out" / "coverage.csv")
    assert coverage[coverage.axis == "vertical"].within.tolist() == [1, 1]
    main(["run", str(tmp_path / "out" / "manifest.json"), "-q", "--out", str(tmp_path / "again")])
    pd.testing.assert_frame_equal(coverage, pd.read_csv(tmp_path / "again" / "coverage.csv"))


@pytest.mark.usefixtures("without_figures")
def test_residuals_have_no_clock_and_the_variance_of_the_errors(tmp_path: Path) -> None:
    from pl_mc.receiver import ReceiverSeries

    g = pl_mc.simulate(site="CUT0", start="2020-06-25", constellations=("GPS", "GAL"), epochs=800)
    rng = np.random.default_rng(3)
    clock_m = rng.uniform(-50, 50, (len(g.epoch), 2))
    errors = rng.standard_normal(g.sigma_m.shape) * g.sigma_m + np.einsum("enc,ec->en", g.design[..., 3:], clock_m)
    found = ReceiverSeries(g, np.where(g.in_view, errors, 0.0), np.zeros((len(g.epoch), 3)), (), ()).residuals()
    assert len(found) == g.in_view.sum()
    # What the clocks take from the variance is given back: 1 within three standard errors.
    assert (found.whitened**2).mean() == pytest.approx(1.0, abs=3 * np.sqrt(2 / len(found)))
    assert found.elevation_deg.between(10.0, 90.0).all()
    files = str(FILES / "mixed_3.obs"), str(FILES / "mixed_3.nav")
    truth = "4075580.8863,931853.5784,4801567.9707"
    main(["observe", *files, "--truth", truth, "--residuals", "-q", "--out", str(tmp_path / "out")])
    stored = pd.read_parquet(tmp_path / "out" / "residuals.parquet")
    assert stored.whitened.abs().max() < 5.0
    assert {"satellite", "time_gps_s", "elevation_deg", "whitened", "error_m"} <= set(stored.columns)


def test_a_long_series_is_solved_in_parts_as_its_epochs_are(g: Geometry) -> None:
    errors = np.where(g.in_view, np.random.default_rng(7).standard_normal(g.sigma_m.shape) * g.sigma_m, 0.0)
    whole = pl_mc.solve(g, errors, methods=("ls", "igg3"), tests=True)
    assert len(whole) == 2 * len(g.epoch)
    assert not whole.rejected.any()
    for start, stop in ((0, 5), (510, 515), (1995, 2000)):
        part = pl_mc.solve(g[start:stop], errors[start:stop], methods=("ls", "igg3"))
        same = whole[whole.epoch.between(start, stop - 1)].reset_index(drop=True)
        np.testing.assert_allclose(part[["east_m", "up_m", "vpl_m"]], same[["east_m", "up_m", "vpl_m"]], rtol=1e-9)


def test_figures_of_an_observation(tmp_path: Path) -> None:
    files = str(FILES / "mixed_3.obs"), str(FILES / "mixed_3.nav")
    options = ["--truth", "4075580.8863,931853.5784,4801567.9707", "-q", "--out", str(tmp_path / "out")]
    main(["observe", *files, *options, "--fault", "G07:+80m"])
    names = {path.stem for path in (tmp_path / "out").glob("*.png")}
    # A point has no track; each axis with a limit has a diagram.
    assert names == {"epochs", "stanford_vertical", "stanford_horizontal", "alarms", "ground", "sky", "satellites"}
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(f"{name}.svg" in page for name in names)


def test_cells_of_a_diagram_hold_every_epoch_that_has_a_place(g: Geometry) -> None:
    from pl_mc.studies.observe.sky_figures import _plane, azimuths_deg

    rng, count = np.random.default_rng(1), 500
    table = pd.DataFrame({
        "up_m": rng.normal(0, 30, count), "east_m": 0.0, "north_m": 0.0, "vpl_m": rng.uniform(0, 90, count),
        "hpl_m": 1.0, "available": np.arange(count) % 10 > 0, "rejected": np.arange(count) % 10 == 1,
    })  # fmt: skip
    edges = np.append(0.5 * np.arange(121), np.inf)
    plane = _plane(table, Judged(pl_mc.LPV_200), edges)
    assert plane.shape == (121, 121)
    assert plane.sum() == 400
    inside = table[table.available & ~table.rejected]
    assert plane[-1].sum() == (inside.up_m.abs() >= 60.0).sum()
    assert plane[:, -1].sum() == (inside.vpl_m >= 60.0).sum()
    # The azimuth of a row of residuals is that of its satellite: straight from the design.
    rows = pd.DataFrame({"epoch": [g.epoch[3]], "satellite": [g.names[g.satellite[3, 0]]]})
    east, north = -g.design[3, 0, 0], -g.design[3, 0, 1]
    assert azimuths_deg(g, rows)[0] == pytest.approx(np.degrees(np.arctan2(east, north)) % 360.0)


@pytest.mark.usefixtures("without_figures")
def test_the_real_day_with_injected_faults(tmp_path: Path, data_folder: Path) -> None:
    main(["run", "observe-day", "-q", "--out", str(tmp_path / "day")])
    counts = pd.read_csv(tmp_path / "day" / "stanford.csv").set_index(["method", "axis", "region"])["count"]
    table = pd.read_parquet(tmp_path / "day" / "epochs.parquet")
    araim = table[table.method.str.startswith("araim")]
    name = araim.method.iloc[0]
    for axis in ("vertical", "horizontal"):
        assert counts[name, axis, MISLEADING] == counts[name, axis, HAZARDOUS] == 0
        assert counts["esbc-2020-177-rtklib.pos.gz", axis, NOMINAL] == 2880
    # A ramp is small at first; every other fault is found at once.
    assert araim[araim.faulted].alarm.mean() > 0.97
    assert araim[~araim.faulted].alarm.mean() < 0.01
    # RTKLIB's variances hold an ephemeris error and half of the ionosphere that this day did not have.
    coverage = pd.read_csv(tmp_path / "day" / "coverage.csv")
    assert (coverage.within_rate > 0.98).all()


def test_a_multiplier_without_claims_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    call = ["observe", str(FILES / "none.rnx"), str(FILES / "none.nav"), "--truth", TRUTH_TEXT, "--out", str(out)]
    with pytest.raises(SystemExit, match="2"):
        main([*call, "--claim-multiplier", "3"])
    said = capsys.readouterr().err
    assert "claim_multiplier: without claims there is nothing that it makes levels of" in said
    assert not out.exists()
