"""Overbounds of samples whose distribution is known: they hold as often as they promise, and are not loose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import special, stats

import pl_mc
from pl_mc.error_models import Sky, as_error_model
from pl_mc.input_errors import InputError
from pl_mc.noise_models import as_noise_model
from pl_mc.statistics.overbound import band, overbound


def holds(bound: object, values: np.ndarray, upper_tail: object) -> bool:
    """Whether both Gaussians are above the true tails from the bias to the farthest sample."""
    found = True
    for sign in (-1.0, 1.0):
        x = np.linspace(bound.bias_m, (sign * values).max(), 400)
        true = upper_tail(x) if sign > 0 else 1.0 - upper_tail(-x)
        found &= bool((special.ndtr(-(x - bound.bias_m) / bound.sigma_m) >= true - 1e-15).all())
    return found


@pytest.mark.parametrize("with_bias", [True, False])
@pytest.mark.parametrize(
    ("name", "draw", "upper_tail", "loose"),
    [
        ("gaussian", lambda rng, n: 2.0 * rng.standard_normal(n), lambda x: special.ndtr(-x / 2.0), 1.8),
        ("biased", lambda rng, n: 0.7 + rng.standard_normal(n), lambda x: special.ndtr(0.7 - x), 2.0),
        ("student t", lambda rng, n: rng.standard_t(3, n), lambda x: stats.t.sf(x, 3), 12.0),
        ("uniform", lambda rng, n: rng.uniform(-1, 1, n), lambda x: np.clip(0.5 - 0.5 * x, 0, 1), 2.0),
    ],
)
def test_what_is_known_is_bounded_at_the_stated_confidence(
    with_bias: bool, name: str, draw: object, upper_tail: object, loose: float
) -> None:
    if name == "biased" and not with_bias:
        return
    rng, held, sigmas = np.random.default_rng(11), 0, []
    for _ in range(200):
        values = draw(rng, 300)
        bound = overbound(values, 300, 0.9, with_bias=with_bias)
        held += holds(bound, values, upper_tail)
        sigmas.append(bound.sigma_m / values.std())
    # 90 % of 200 is 180, give or take 4.2.
    assert held >= 172
    assert np.median(sigmas) < loose


def test_a_band_holds_all_together_as_often_as_it_says() -> None:
    rng, tail, held = np.random.default_rng(3), band(200, 0.9), 0
    from pl_mc.statistics.overbound import _ranks

    for _ in range(2000):
        samples = np.sort(rng.random(200))
        held += bool((samples[_ranks(200) - 1] <= tail).all())
    assert held / 2000 == pytest.approx(0.9, abs=0.025)
    # The largest of 200 alone at one level: 1 - (1 - level)^200 of the beta distribution.
    assert tail[0] == pytest.approx(1.0 - special.betaincc(1, 200, tail[0]) ** (1 / 200), rel=1e-9)


def test_a_narrower_gaussian_would_not_do_and_a_box_is_told() -> None:
    rng = np.random.default_rng(5)
    bound = overbound(rng.standard_normal(20_000), 20_000, 0.95, with_bias=False)
    assert 1.0 < bound.sigma_m < 1.35
    assert bound.unimodal
    # Two heaps far from the middle: nothing unimodal about a small bias lies within.
    heaps = overbound(rng.choice([-3.0, 3.0], 5000) + 0.1 * rng.standard_normal(5000), 5000, 0.95, with_bias=False)
    assert heaps.sigma_m > 3.0


def markov(count: int, rho: float, rng: np.random.Generator) -> np.ndarray:
    values = np.empty(count)
    values[0] = rng.standard_normal()
    for k in range(1, count):
        values[k] = rho * values[k - 1] + np.sqrt(1.0 - rho * rho) * rng.standard_normal()
    return values


def test_correlated_samples_show_less_far_down_and_are_bounded_all_the_same() -> None:
    rng, held = np.random.default_rng(8), 0
    names, times = np.repeat(["G01", "G02", "G03", "G04"], 500), np.tile(30.0 * np.arange(500), 4)
    for _ in range(40):
        values = np.concatenate([markov(500, 0.9, rng) for _ in range(4)])
        fit = pl_mc.fit_overbound(values, satellite=names, time_gps_s=times, confidence=0.9, bias=False)
        (row,) = fit.bins.itertuples()
        held += row.sigma_m >= 1.0
        assert 40 < row.independent < 260
        assert row.shown_to > 5.0 / row.independent / 4.0
    assert held >= 33
    alone = pl_mc.fit_overbound(values)
    assert alone.bins.independent[0] == 2000
    assert "taken as independent" in alone.notes[0]


def table(rng: np.random.Generator, count: int = 4000) -> pd.DataFrame:
    """Errors of half a metre at the zenith and two at the horizon."""
    elevation = rng.uniform(5.0, 90.0, count)
    sigma = np.where(elevation < 30.0, 2.0, 0.5)
    return pd.DataFrame({"error_m": sigma * rng.standard_normal(count), "elevation_deg": elevation})


def test_ranges_of_elevation_each_have_their_own_and_make_a_model(tmp_path: Path) -> None:
    fit = pl_mc.fit_overbound(table(np.random.default_rng(1)), bias=False)
    assert fit.bins.elevation_to_deg.tolist() == [15.0, 30.0, 45.0, 60.0, 90.0]
    assert fit.bins.sigma_m.between([2.0] * 2 + [0.5] * 3, [3.2] * 2 + [0.8] * 3).all()
    assert fit.bins.rms_m.to_numpy() == pytest.approx([2.0, 2.0, 0.5, 0.5, 0.5], rel=0.08)
    path = fit.write(tmp_path / "mine.toml")
    sky = Sky("GPS", np.radians([3.0, 10.0, 29.9, 30.1, 89.0]), 0.0, 0.5, 0.0)
    expected = fit.bins.sigma_m.to_numpy()[[0, 0, 1, 2, 4]]
    for model in (fit.error_model, as_error_model(str(path))):
        assert model.sigma_m(sky) == pytest.approx(expected, rel=1e-12)
    assert as_noise_model(str(path)) == fit.noise_model
    # What was fitted to two carriers is of two carriers already.
    scaled = fit.error_model.scaled_variance_m2(sky.checked(), 2.98, 0.0)
    assert np.sqrt(scaled) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("draw", "law", "quantile"),
    [
        (lambda rng: rng.standard_normal(6000), "gaussian", None),
        (lambda rng: rng.standard_t(4, 6000), "student_t", lambda p: stats.t.isf(p, 4)),
        (lambda rng: rng.standard_normal(6000) * np.where(rng.random(6000) < 0.03, 8.0, 1.0), "gaussian_mixture", None),
    ],
)  # fmt: skip
def test_the_law_is_found_by_likelihood_and_drawn_in_metres(draw: object, law: str, quantile: object) -> None:
    rng = np.random.default_rng(4)
    fit = pl_mc.fit_overbound(draw(rng), bias=False)
    assert fit.laws.law[fit.laws.aic.idxmin()] == law
    assert fit.content["noise"]["name"] == law
    if quantile is None:
        return
    g = pl_mc.simulate(site="CUT0", constellations=("GPS",), epochs=1, error_model=fit.error_model)[0]
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), draws=10, methods=("ls",), seed=1, noise=fit.noise_model)
    assert len(drawn) == 10
    # Of the believed sigma, one number a satellite: what a standard normal z makes is the quantile of the law [m].
    z = special.ndtri(1.0 - np.array([0.3, 0.1, 0.01]))
    errors = np.asarray(fit.noise_model.shape(None, [np.array(z)])) * fit.bins.sigma_m[0]
    assert errors == pytest.approx(quantile(np.array([0.3, 0.1, 0.01])), rel=0.1)


def test_a_file_serves_sweeps_risk_and_araim(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    errors = table(rng)
    errors["error_m"] *= 0.4
    path = str(pl_mc.fit_overbound(errors).write(tmp_path / "mine.toml"))
    g = pl_mc.simulate(site="CUT0", constellations=("GPS", "GAL"), epochs=1, error_model=path)[0]
    assert pl_mc.sweep(g, pl_mc.no_fault(g), draws=256, seed=1, methods=("ls", "araim"), noise=path).draws.sum() == 512
    fault = pl_mc.biases(g, {"G01" if "G01" in g.names else g.names[0]: 40.0})
    found = pl_mc.risk(g, fault, event="alarm", method="ls", seed=1, noise=path, max_evaluations=500_000)
    assert found.probability.notna().all() or found.warning.notna().all()


@pytest.mark.parametrize(
    ("given", "options", "words"),
    [
        (np.zeros(5), {}, "at least 20 independent samples are needed, not 5"),
        ([1.0, np.nan] * 20, {}, "every one is a finite number"),
        (np.ones(30), {"elevation_deg": [1.0]}, "elevation_deg: 30 are needed"),
        (np.ones(30), {"elevation_deg": np.ones(30), "bins_deg": (10, 5)}, "bins_deg: edges that increase"),
        (np.ones(30), {"confidence": 1.0}, "confidence: it lies between 0 and 1"),
        (pd.DataFrame({"x": [1.0]}), {}, "needs a column error_m"),
    ],
)
def test_what_cannot_be_fitted(given: object, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        pl_mc.fit_overbound(given, **options)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "there is no such file"), ("a = ", "it is not TOML"),
        ("[noise]\nname = 'gaussian'", r"a table \[error_model\]"),
        ("[error_model]\nname = 'b.toml'", "not another file"),
        ("[error_model]\nname = 'by_elevation'\nelevation_deg = [0, 90]\nsigma_m = [1, 2]",
         "1 figures are needed between"),
        ("[error_model]\nname = 'by_elevation'\nelevation_deg = [0, 90]", "elevation_deg and sigma_m are needed"),
        ("[error_model]\nname = 'by_elevation'\nelevation_deg = [0, 90]\nsigma_m = [1e-320]",
         "a.toml: error_model: sigma_m: 9.99989e-321 m cannot be used.* over zero, 1e-09 to 1e.09"),
        ("[error_model]\nname = 'constant'\nnosuch = 1", "a.toml: error_model: .*nosuch"),
        ("[error_model]\nname = 'by_elevation'\nelevation_deg = [9, 0]\nsigma_m = [1]", "edges that increase"),
    ],
)  # fmt: skip
def test_files_of_models_that_cannot_be_used(text: str | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=words):
        as_error_model(str(path))


def test_what_a_file_says_is_not_given_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("[noise]\nname = 'student_t'\nnu = 5.0\n[error_model]\nname = 'residual'\nism = 'b.csv'\n")
    with pytest.raises(InputError, match=r"a.toml: noise.nu: the file says it"):
        pl_mc.noise_model(str(path), nu=4.0)
    with pytest.raises(InputError, match=r"a.toml: error_model.ism: the file says it"):
        pl_mc.error_model(str(path), ism={"sigma_ura_m": 1.0})
    with pytest.raises(InputError, match=r"a.toml: error_model: ism: b.csv: there is no"):
        pl_mc.error_model(str(path))
