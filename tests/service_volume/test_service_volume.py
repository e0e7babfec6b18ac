"""Service volume: its skies are those of simulate, its counts those of sweeps, its rates what they are said to be.

One small grid is computed once; most tests look at it.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import pl_mc
from pl_mc import AlertLimits, InputError
from pl_mc.alert import OPERATIONS
from pl_mc.error_models import error_model
from pl_mc.geometry.constellations import constellation_slots
from pl_mc.geometry.frames import from_geodetic
from pl_mc.geometry.gps_time import gps_seconds
from pl_mc.geometry.record import UP
from pl_mc.kernels.noise import LANES
from pl_mc.methods import METHODS, Araim, Ls, Parity, WTest, method
from pl_mc.methods.capabilities import levels_from_geometry
from pl_mc.service.continuity import as_durations, continuity, run_counts
from pl_mc.service.counting import weighted_rate
from pl_mc.service.levels import levels_of_batch
from pl_mc.service.sky import Geometries, WorldSky, world_grid
from pl_mc.service.volume import epoch_count, service_volume
from pl_mc.statistics import clopper_pearson
from reference import araim_numpy as reference

START, STEP_S, EPOCHS, MASK_DEG = "2017-11-21T00:00:00", 5_400.0, 6, 15.0
CONSTELLATIONS, WITHOUT = ("GPS", "GAL"), ("G05", "E11")
DRAWS, SEED = 40, 11
# Levels of about 6 m: a limit in the middle of them, and one that decides by the horizontal level.
NEAR = AlertLimits("near", vertical_m=7.0, horizontal_m=7400.0)
FLAT = AlertLimits("flat", vertical_m=1e9, horizontal_m=5.0)
FAR = AlertLimits("far", vertical_m=1e9, horizontal_m=1e9)


@pytest.fixture(scope="module")
def volume():
    """Eighteen sites in batches of five, the last of them not full, in two threads."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("pl_mc.service.task.GEOMETRIES_PER_BATCH", 5 * EPOCHS)
        return service_volume(
            constellations=CONSTELLATIONS, without=WITHOUT, step_deg=60.0, step_s=STEP_S,
            duration_s=EPOCHS * STEP_S, start=START, mask_deg=MASK_DEG, methods=("ls", "araim", "sbas"),
            operations=(NEAR, FLAT, FAR), durations_s=(1_350.0, STEP_S, 1.5 * STEP_S), draws=DRAWS, seed=SEED,
            progress=False, workers=2,
        )  # fmt: skip


def site_series(latitude_deg: float, longitude_deg: float, *, without=WITHOUT) -> pl_mc.Geometry:
    position = from_geodetic(np.radians(latitude_deg), np.radians(longitude_deg), 0.0)
    return pl_mc.simulate(
        site=position, start=START, epochs=EPOCHS, interval_s=STEP_S, mask_deg=MASK_DEG,
        constellations=CONSTELLATIONS, without=without,
    )  # fmt: skip


def sky(without=WITHOUT) -> WorldSky:
    time = gps_seconds(START) + STEP_S * np.arange(EPOCHS)
    return WorldSky(constellation_slots(CONSTELLATIONS, without), error_model(), MASK_DEG, time)


def test_batches_hold_the_geometries_of_simulate():
    latitude, longitude = np.array([-75.0, 2.5, 48.0]), np.array([12.0, -170.0, 100.0])
    here = sky()
    seen = here.counts(np.radians(latitude), np.radians(longitude))
    batch = here.geometries(np.radians(latitude), np.radians(longitude), int(seen.max()) + 2)
    for k in range(3):
        g = site_series(latitude[k], longitude[k])
        part, n = slice(k * EPOCHS, (k + 1) * EPOCHS), g.design.shape[1]
        assert g.clocks == here.clocks
        np.testing.assert_array_equal(seen[k], g.satellite_count)
        np.testing.assert_array_equal(batch.in_view[part, :n], g.in_view)
        assert not batch.in_view[part, n:].any()
        np.testing.assert_allclose(batch.design[part, :n], g.design, atol=1e-9)
        np.testing.assert_allclose(batch.sigma_m[part, :n], g.sigma_m, rtol=1e-9)
        names = np.array([slot.name for slot in here.slots])
        np.testing.assert_array_equal(
            np.where(g.in_view, names[batch.satellite[part, :n]], ""),
            np.where(g.in_view, np.array(g.names)[g.satellite], ""),
        )


def test_availability_is_what_sweeps_count(volume):
    """Scenario by scenario: the epochs of a site have the noise of a sweep over epochs of their numbers.

    Rows of the sweep are packed to the width of its own site, those of the grid to the largest of all.
    """
    assert DRAWS <= LANES
    site = 17
    row = volume.satellites.iloc[site]
    g = site_series(row.latitude_deg, row.longitude_deg)
    g = dataclasses.replace(g, epoch=site * EPOCHS + np.arange(EPOCHS))
    swept = pl_mc.sweep(
        g, pl_mc.no_fault(g), draws=DRAWS, seed=SEED, methods=("ls", "sbas"), alert=NEAR, progress=False
    ).set_index("method")
    found = volume.sites[(volume.sites.site == site) & (volume.sites.operation == "near")].set_index("method")
    assert 0 < found.available["ls"] < EPOCHS * DRAWS
    assert found.available["ls"] == EPOCHS * DRAWS - swept.alarms["ls"]
    # One draw tells what all draws say.
    assert found.scenarios["sbas"] == EPOCHS
    assert found.available["sbas"] * DRAWS == EPOCHS * DRAWS - swept.alarms["sbas"]


def test_araim_has_the_levels_of_the_literal_algorithm(volume):
    """Against one fit for every fault mode and root finding."""
    site, araim = 8, Araim()
    row = volume.satellites.iloc[site]
    vpl = []
    for g in site_series(row.latitude_deg, row.longitude_deg):
        priors = np.full(g.sigma_m.size, araim.p_sat), dict.fromkeys(set(g.systems), araim.p_const)
        variance = g.sigma_m**2
        bias = np.full(g.sigma_m.size, araim.b_nom_m)
        found = reference.levels(g.design, variance, variance, g.systems, bias, *priors, unmonitored="contained")
        vpl.append(found.vpl)
    levels = volume.levels[(volume.levels.site == site) & (volume.levels.method == "araim")].iloc[0]
    # Six epochs: the third is not exceeded in half of them, the last in all.
    np.testing.assert_allclose([levels.vpl_50_m, levels.vpl_99_m], np.sort(vpl)[[2, 5]], rtol=1e-6)


def batch_of(rng: np.random.Generator, *, rows: int) -> Geometries:
    """Three skies of seven, nine and eight satellites of two systems."""
    seen = np.arange(rows) < np.array([7, 9, 8])[:, None]
    line = rng.normal(size=(3, rows, 3))
    line[..., 2] = np.abs(line[..., 2]) + 0.3
    line /= np.linalg.norm(line, axis=-1, keepdims=True)
    letters = np.where(np.arange(rows) % 2 == 0, "G", "E")
    clocks = (letters[:, None] == np.array(["G", "E"])).astype(float)
    design = np.where(seen[..., None], np.concatenate([-line, np.tile(clocks, (3, 1, 1))], axis=-1), 0.0)
    return Geometries(
        design=design,
        sigma_m=np.where(seen, rng.uniform(0.5, 2.0, (3, rows)), 1.0),
        in_view=seen,
        satellite=np.zeros((3, rows), dtype=np.int64),
        systems=np.where(seen, letters, ""),
    )


def permuted(batch: Geometries, order: np.ndarray) -> Geometries:
    given = {f.name: getattr(batch, f.name) for f in dataclasses.fields(batch)}
    return Geometries(**{name: None if array is None else array[:, order] for name, array in given.items()})


def test_levels_from_the_geometry_know_nothing_of_noise_padding_or_order(monkeypatch):
    """Methods of which one draw is taken: the same levels in every draw, though their tests reject half of them.

    Rows in another order, with the padding between them, change nothing either.
    """
    names = [name for name in METHODS if levels_from_geometry(method(name)) and name != "araim"]
    assert "parity" in names
    with_test = {name: {"p_fa": 0.5} if hasattr(method(name), "p_fa") else {} for name in names}
    methods = [method(name, **options) for name, options in with_test.items()]
    methods += [
        Parity(p_fa=0.5, form="sigma"),
        WTest(p_fa=0.5, exclusions=0),
        WTest(p_fa=0.5, exclusions=0, form="reliability", variance="posterior"),
    ]
    assert all(levels_from_geometry(one) for one in methods)
    names = [one.name for one in methods]
    monkeypatch.setattr("pl_mc.service.levels.levels_from_geometry", lambda _: False)
    rng = np.random.default_rng(3)
    batch, numbers = batch_of(rng, rows=11), np.arange(3)
    args = {"draws": 5, "seed": 1, "precision": "float64"}
    plain = levels_of_batch(batch, numbers, methods, **args)
    turned = levels_of_batch(permuted(batch, rng.permutation(11)), numbers, methods, **args)
    for name, first, second in zip(names, plain, turned, strict=True):
        for one, two in zip(first, second, strict=True):
            assert one.shape == (3, 5)
            assert np.isfinite(one).all(), name
            np.testing.assert_array_equal(one, np.broadcast_to(one[:, :1], one.shape), err_msg=name)
            np.testing.assert_allclose(two, one, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    "one", [Ls(), Parity(exclude=True), WTest(), WTest(exclusions=0, variance="posterior"), WTest(form="reliability")]
)
def test_what_excludes_or_scales_with_residuals_is_none_of_them(one):
    assert not levels_from_geometry(one)


def test_cells_have_their_areas():
    """Against the area of a zone between two latitudes, in closed form."""
    grid = world_grid(20.0)
    assert grid.shape == (9, 18)
    assert len(grid) == 162
    edges = np.radians(np.arange(-90.0, 91.0, 20.0))
    zones = np.diff(np.sin(edges)) / 2.0
    np.testing.assert_allclose(grid.as_map(grid.weight).sum(axis=1), zones, rtol=1e-12)
    assert grid.as_map(grid.latitude_deg)[0, 0] == -80.0
    assert grid.as_map(grid.longitude_deg)[0, -1] == 170.0


def test_satellites_switched_off_are_not_seen():
    place = np.radians([40.0]), np.radians([-100.0])
    whole, less = sky(()), sky(WITHOUT)
    assert {slot.name for slot in whole.slots} - {slot.name for slot in less.slots} == set(WITHOUT)
    off = [k for k, slot in enumerate(whole.slots) if slot.name in WITHOUT]
    in_view = whole.look(*place)[1]
    np.testing.assert_array_equal(whole.counts(*place) - in_view[..., off].sum(axis=-1), less.counts(*place))
    assert in_view[..., off].any()


def test_tables_hold_together(volume):
    sites, weight = volume.sites, volume.grid.weight
    assert len(sites) == 18 * 3 * 3
    assert (sites.available <= sites.scenarios).all()
    assert (sites.availability_low <= sites.availability_rate).all()
    assert (sites.availability_rate <= sites.availability_high).all()
    assert set(sites.scenarios[sites.method == "ls"]) == {EPOCHS * DRAWS}
    assert volume.exact == ("araim", "sbas")
    for row in volume.world.itertuples():
        part = sites[(sites.method == row.method) & (sites.operation == row.operation)]
        assert row.available == part.available.sum()
        assert row.availability_rate == pytest.approx(weight @ part.availability_rate)
        assert row.coverage_rate == pytest.approx(weight @ (part.availability_rate >= 0.995))
        assert row.coverage_low <= row.coverage_rate <= row.coverage_high
        assert row.worst_rate == part.availability_rate.min()
        by_epoch = volume.by_epoch[
            (volume.by_epoch.method == row.method) & (volume.by_epoch.operation == row.operation)
        ]
        assert by_epoch.area_share.mean() == pytest.approx(row.availability_rate)
        worst = volume.worst_sites(row.method, row.operation, most=3)
        assert worst.availability_rate.iloc[0] == row.worst_rate
        assert worst.availability_rate.is_monotonic_increasing
    ls = sites[(sites.method == "ls") & (sites.operation == "near")]
    low, high = clopper_pearson(ls.available, ls.scenarios)
    np.testing.assert_array_equal(ls.availability_low, low)
    np.testing.assert_array_equal(ls.availability_high, high)


def test_a_method_without_noise_is_bounded_by_the_moments_of_its_changes(volume):
    """By hand from K_V sigma_U of each epoch: a change lies somewhere in the step that holds it."""
    site = 3
    row = volume.satellites.iloc[site]
    g = site_series(row.latitude_deg, row.longitude_deg)
    whitened = g.design * (g.in_view / g.sigma_m)[..., None]
    covariance = np.linalg.inv(whitened.swapaxes(1, 2) @ whitened)
    serves = 5.33 * np.sqrt(covariance[:, UP, UP]) <= NEAR.vertical_m
    assert 0 < serves.sum() < EPOCHS
    lost = sum(a and not b for a, b in itertools.pairwise(serves)) + serves[-1]
    gained = sum(b and not a for a, b in itertools.pairwise(serves)) + (not serves[-1])
    found = volume.sites[
        (volume.sites.site == site) & (volume.sites.method == "sbas") & (volume.sites.operation == "near")
    ].iloc[0]
    assert found.available == serves.sum()
    assert found.availability_low == pytest.approx((serves.sum() - lost) / EPOCHS)
    assert found.availability_high == pytest.approx((serves.sum() + gained) / EPOCHS)


def test_runs_are_counted_as_by_hand():
    serves = np.array([[1, 1, 0, 1, 1, 1]], dtype=bool)[..., None]
    assert [int(x[0]) for x in run_counts(serves, 1)] == [4, 3]
    assert [int(x[0]) for x in run_counts(serves, 2)] == [3, 1]
    counts = {j: run_counts(serves, j) for j in (1, 2)}
    short, long = as_durations((75.0, 450.0), step_s=300.0, epochs=6)
    assert (short.runs, long.runs) == ((1,), (1, 2))
    value, low, high = continuity(short, counts)
    # A quarter of the operations meets the loss of one step in four.
    assert value[0] == pytest.approx(1.0 - 0.25 * 0.25)
    bounds = clopper_pearson(3, 4)
    assert low[0] == pytest.approx(1.0 - 0.25 * (1.0 - bounds[0]))
    assert high[0] == pytest.approx(1.0 - 0.25 * (1.0 - bounds[1]))
    assert continuity(long, counts)[0][0] == pytest.approx(0.5 * 3 / 4 + 0.5 * 1 / 3)
    nothing = {1: run_counts(np.zeros_like(serves), 1)}
    value, low, high = continuity(short, nothing)
    assert np.isnan(value[0])
    assert (low[0], high[0]) == (0.0, 1.0)


def test_a_method_without_noise_has_no_sampling_interval(volume):
    """In both tables; where nothing starts, nothing is known."""
    for table in (volume.sites, volume.world):
        rows = table[table.method.isin(volume.exact)]
        for label in ("1350s", "5400s", "8100s"):
            rate, low, high = (rows[f"continuity_{label}_{part}"] for part in ("rate", "low", "high"))
            known = rate.notna()
            assert ((rate > 0.0) & (rate < 1.0)).any()
            assert (low[known] == rate[known]).all()
            assert (high[known] == rate[known]).all()
            assert (low[~known] == 0.0).all()
            assert (high[~known] == 1.0).all()
    noisy = volume.world[(volume.world.method == "ls") & (volume.world.operation == "near")].iloc[0]
    assert noisy.continuity_8100s_low < noisy.continuity_8100s_rate < noisy.continuity_8100s_high


def test_bounds_hold_where_runs_share_draws():
    """Service by chance, 1/2 at each of 121 epochs: runs of four further epochs keep it with (1/2)^4."""
    times, j = 4_000, 4
    serves = np.random.default_rng(12).random((times, 121, 1)) < 0.5
    (duration,) = as_durations(400.0, step_s=100.0, epochs=121)
    counts = {j: run_counts(serves, j)}
    value, low, high = continuity(duration, counts)
    # Standard error of the mean of all below that of a quarter of the starts; five of them.
    share = counts[j][1].sum() / counts[j][0].sum()
    assert abs(share - 0.5**j) < 5 * np.sqrt(0.5**j / (counts[j][0].sum() / j))
    assert ((low <= value) & (value <= high)).all()
    # As often as said, less five standard errors; with all starts as trials they would not.
    missed = ((low > 0.5**j) | (high < 0.5**j)).mean()
    assert missed < 0.05 + 5 * np.sqrt(0.05 * 0.95 / times)
    below, above = clopper_pearson(counts[j][1], counts[j][0])
    assert ((below > 0.5**j) | (above < 0.5**j)).mean() > 0.05 + 5 * np.sqrt(0.05 * 0.95 / times)


def test_steps_that_divide_the_duration_but_for_rounding_have_no_epoch_at_its_end():
    assert [epoch_count(*pair) for pair in ((0.3, 0.1), (86_400.0, 300.0), (86_401.0, 300.0), (1.0, 300.0))] == [
        3, 288, 289, 1,
    ]  # fmt: skip


def test_continuity_of_a_known_chain():
    """Service that is lost in a step with probability 1/5 keeps it over a step and a half with (0.8 + 0.64) / 2."""
    rng = np.random.default_rng(8)
    serves = np.ones((1, 4, 200_000), dtype=bool)
    for k in range(1, 4):
        serves[:, k] = serves[:, k - 1] & (rng.random((1, 200_000)) > 0.2)
    (duration,) = as_durations((150.0,), step_s=100.0, epochs=4)
    value, _, _ = continuity(duration, {j: run_counts(serves, j) for j in duration.runs})
    # Standard error below 0.5 / sqrt(2e5) for each of two rates; five of them.
    assert abs(value[0] - 0.72) < 5 * 0.5 / np.sqrt(2e5)


def test_weighted_rates():
    weight, trials = np.array([0.5, 0.25, 0.25]), np.array([10, 10, 10])
    rate, low, high = weighted_rate(weight, np.array([10, 0, 4]), trials)
    assert rate == pytest.approx(0.6)
    # 100 / (10 (0.25 + 0.0625 + 0.0625)) = 26.67 independent trials.
    expected = clopper_pearson(0, 1)
    assert low < rate < high
    assert expected[0] == 0.0
    # Of 30 trials of which two on end share draws, 15 are independent.
    pairs = weighted_rate(np.full(3, 1 / 3), np.array([4, 4, 4]), trials, shared=2)
    assert pairs[1:] == pytest.approx([float(bound) for bound in clopper_pearson(6, 15)])
    alike = weighted_rate(np.full(3, 1 / 3), np.array([4, 4, 4]), trials)
    assert alike[1:] == pytest.approx([float(bound) for bound in clopper_pearson(12, 30)])
    nothing = weighted_rate(weight, np.zeros(3), np.zeros(3))
    assert np.isnan(nothing[0])
    assert nothing[1:] == (0.0, 1.0)


def test_operations_without_a_vertical_limit_ask_for_a_solution():
    assert not OPERATIONS["NPA"].has_vertical
    assert OPERATIONS["LPV-200"].has_vertical
    assert not np.inf <= OPERATIONS["NPA"].val_m


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step_deg": 7.0}, r"step_deg: 7 deg cannot be used; .* nearest: 6.92308"),
        ({"step_deg": 0.5}, r"step_deg: 0.5 deg .* nearest: 1\."),
        (
            {"step_s": 1.0},
            r"step_s: 1 s make 86,400 epochs; at most 20,000 are possible: for 86400 s, steps of 4.32 s or",
        ),
        ({"mask_deg": 90.0}, "mask_deg: 90 deg is outside"),
        ({"operations": ("LPV200",)}, r"operations: 'LPV200' is unknown .nearest: LPV-200"),
        ({"operations": ("LPV-200", "LPV-200")}, "operations: LPV-200 is asked for twice"),
        ({"operations": ()}, "operations: at least one is needed"),
        ({"operations": (35.0,)}, "operations: a name or alert limits"),
        ({"operations": 5}, "operations: a sequence of names or alert limits is needed"),
        ({"durations_s": 90_000.0}, "durations_s: an operation of 90000 s needs more"),
        ({"durations_s": "15"}, "durations_s: it cannot be read as an array of numbers"),
        ({"durations_s": None}, "durations_s: it cannot be read as an array of numbers"),
        ({"durations_s": (90_000.0,)}, r"durations_s: an operation of 90000 s needs more than the 288 epochs"),
        ({"draws": 0}, "draws: a whole number from 1"),
        ({"without": ("G99",)}, "without: 'G99' is not in GPS, GAL"),
        ({"methods": ("lss",)}, "method: 'lss' is unknown"),
        ({"precision": "double"}, "precision: 'double' is unknown"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(options, message):
    with pytest.raises(InputError, match=message):
        service_volume(**options)
