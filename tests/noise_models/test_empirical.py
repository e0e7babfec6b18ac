"""Draws from a receiver's own errors: which errors, how often, and together in time."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
from scipy import special

import pl_mc
from pl_mc.geometry.record import Geometry
from pl_mc.input_errors import InputError
from pl_mc.kernels import linear_model
from pl_mc.noise_models import as_noise_model
from pl_mc.noise_models.empirical import passes_of


def written(folder: Path, passes: list[tuple[float, float, object]], name: str = "errors.csv") -> str:
    """Passes of so many degrees at the least and the most, with errors by elevation; one a day, up and down again."""
    parts = []
    for k, (low, high, error) in enumerate(passes):
        way = np.concatenate([np.linspace(low, high, 400), np.linspace(high, low, 400)])
        parts.append(pd.DataFrame({
            "satellite": f"G{k + 1:02d}", "time_gps_s": 1e9 + 30.0 * np.arange(800), "elevation_deg": way,
            "whitened": [error(e) if callable(error) else error for e in way],
        }))  # fmt: skip
    path = folder / name
    table = pd.concat(parts)
    table.to_csv(path, index=False) if name.endswith("csv") else table.to_parquet(path)
    return str(path)


def one_epoch() -> Geometry:
    return pl_mc.simulate(site="CUT0", constellations=("GPS",), epochs=1)[0]


def drawn(noise: object, g: Geometry, count: int = 4000, seed: int = 0) -> np.ndarray:
    rng, model = np.random.default_rng(seed), jax.jit(linear_model)(g.design, g.sigma_m, g.in_view)
    units = [rng.standard_normal((len(g.names), count)) for _ in range(2)]
    return np.asarray(noise.shape(model, units))


def elevations_deg(g: Geometry) -> np.ndarray:
    return np.degrees(np.arcsin(-g.design[:, 2]))


def test_the_error_is_that_of_the_own_elevation(tmp_path: Path) -> None:
    g = one_epoch()
    noise = pl_mc.empirical(written(tmp_path, [(5.0, 90.0, lambda e: e), (5.0, 90.0, lambda e: -e)]))
    errors = drawn(noise, g)
    assert np.abs(errors) == pytest.approx(np.broadcast_to(elevations_deg(g)[:, None], errors.shape), abs=0.2)
    # Either pass is as likely: half of the signs, of 4000 independent ones, at each satellite.
    assert (errors > 0).mean(axis=1) == pytest.approx(0.5, abs=0.035)


def test_passes_that_do_not_come_so_high_are_not_drawn_there(tmp_path: Path) -> None:
    g = one_epoch()
    noise = pl_mc.empirical(written(tmp_path, [(5.0, 40.0, 1.0), (5.0, 90.0, 2.0), (5.0, 90.0, 3.0)]))
    errors, elevation = drawn(noise, g), elevations_deg(g)
    assert elevation.max() > 45 > 35 > elevation.min()
    for row, e in zip(errors, elevation, strict=True):
        expected = {1.0: 1 / 3, 2.0: 1 / 3, 3.0: 1 / 3} if e < 39.9 else {2.0: 0.5, 3.0: 0.5}
        assert set(row.tolist()) == set(expected)
        for value, share in expected.items():
            assert (row == value).mean() == pytest.approx(share, abs=0.035)


def test_satellites_that_stand_still_give_all_their_hours(tmp_path: Path) -> None:
    still = pd.DataFrame({"satellite": "C02", "time_gps_s": 30.0 * np.arange(2880), "elevation_deg": 30.02,
                          "whitened": np.arange(2880.0)})  # fmt: skip
    still.to_csv(tmp_path / "still.csv", index=False)
    noise = pl_mc.empirical(str(tmp_path / "still.csv"))
    assert passes_of(noise).errors.shape[1] == 73
    errors = drawn(noise, one_epoch())
    assert errors.min() < 100
    assert errors.max() > 2780


def test_epochs_that_are_drawn_together_stay_on_their_pass(tmp_path: Path) -> None:
    passes = [(0.0, 90.0, float(k)) for k in range(40)]
    path = written(tmp_path, passes)
    g = pl_mc.simulate(site="CUT0", constellations=("GPS",), epochs=8)
    assert (g.satellite == g.satellite[0]).all()
    values = {}
    for together in (1, 4):
        noise = pl_mc.empirical(path, epochs_together=together)
        table = pl_mc.sample(g, pl_mc.no_fault(g), draws=200, methods=("ls",), seed=3, noise=noise)
        values[together] = table.pivot(index="epoch", columns="draw", values="up_m").to_numpy()
    # Errors that stay move the position slowly, and jump with the next four epochs.
    steps = np.abs(np.diff(values[4], axis=0)).mean(axis=1)
    assert steps[3] > 10 * steps[[0, 1, 2, 4, 5, 6]].max()
    steps = np.abs(np.diff(values[1], axis=0)).mean(axis=1)
    assert steps.min() > 0.5 * steps.max()


def test_draws_have_the_distribution_of_the_data(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    passes = [(5.0, 90.0, lambda e, k=k: float(rng.standard_t(4))) for k in range(60)]
    noise = pl_mc.empirical(written(tmp_path, passes, "errors.parquet"))
    errors = drawn(noise, one_epoch(), 20_000).ravel()
    for p in (0.05, 0.25, 0.5, 0.75, 0.95):
        assert np.quantile(errors, p) == pytest.approx(special.stdtrit(4, p), abs=0.25)


def test_counts_are_the_same_whoever_counts_them(tmp_path: Path) -> None:
    path = written(tmp_path, [(5.0, 90.0, lambda e, k=k: np.sin(7 * k + e)) for k in range(9)])
    g = pl_mc.simulate(site="CUT0", constellations=("GPS",), epochs=5)
    faults = pl_mc.ramp(g, satellite=g.names[int(g.satellite[0, 0])], start_m=5, stop_m=25, step_m=10)
    counts = [
        pl_mc.sweep(g, faults, draws=600, seed=5, methods=("ls",), noise=pl_mc.empirical(path), workers=workers)
        for workers in (1, 2)
    ]
    pd.testing.assert_frame_equal(*counts)
    assert counts[0].alarms.sum() > 0
    single = pl_mc.sweep(
        g, faults, draws=600, seed=5, methods=("ls",), noise=pl_mc.empirical(path), precision="float32"
    )
    # The random numbers of single precision are others; the rates are alike.
    assert single.alarm_rate.to_numpy() == pytest.approx(counts[0].alarm_rate.to_numpy(), abs=0.05)


def test_a_file_that_changes_is_another_model(tmp_path: Path) -> None:
    first = pl_mc.empirical(written(tmp_path, [(5.0, 90.0, 1.0)]))
    again = pl_mc.empirical(first.file)
    assert first == again
    assert hash(first) == hash(again)
    second = pl_mc.empirical(written(tmp_path, [(5.0, 90.0, 2.0)]))
    assert first != second
    assert first.digest in first.name
    assert as_noise_model(second, one_epoch()) is second


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop(columns="whitened"), "whitened is not there"),
        (lambda t: t.assign(whitened="x"), "whitened: a finite number is needed in every row"),
        (lambda t: t.assign(elevation_deg=91.0), "elevation_deg: each is between 0 and 90"),
        (lambda t: t[:50], "at least 100 errors are needed, not 50"),
    ],
)
def test_tables_that_cannot_be_drawn_from(change: object, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, [(5.0, 90.0, 1.0)])
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError, match=words):
        pl_mc.empirical(path)
    with pytest.raises(InputError, match="empirical: file: the name of a table is needed"):
        as_noise_model("empirical")
    with pytest.raises(InputError, match="there is no such file"):
        pl_mc.empirical(str(tmp_path / "no.csv"))
    with pytest.raises(InputError, match="epochs_together"):
        pl_mc.empirical(path, epochs_together=0)


def test_rare_events_are_refused(tmp_path: Path) -> None:
    g, noise = one_epoch(), pl_mc.empirical(written(tmp_path, [(5.0, 90.0, 1.0)]))
    with pytest.raises(InputError, match=r"nothing beyond the errors of its file.*fit_overbound"):
        pl_mc.risk(g, pl_mc.no_fault(g), event="alarm", method="ls", seed=1, noise=noise)
