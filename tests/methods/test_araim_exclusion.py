"""Exclusion while it flies: positions and levels as predicted, the choice as a plain program makes it."""

from __future__ import annotations

import functools

import jax
import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.araim import LPV_200, LPV_200_V42, RNP_V42, Ism, protection_levels
from pl_mc.ism import codes_of
from pl_mc.kernels import linear_model
from pl_mc.methods import method

ISM = Ism(
    sigma_ura_m=1.0, sigma_ure_m=2 / 3, b_nom_m=0.75,
    r_sat_per_h={"G": 1e-5, "E": 2e-5}, mfd_sat_h={"G": 1.0, "E": 1.5},
    r_const_per_h={"G": 1e-8, "E": 1e-4}, mfd_const_h={"G": 1.0, "E": 2.0},
)  # fmt: skip
SERIES = pl_mc.simulate(
    site=(48.1, 11.6, 500.0), start="2017-11-15T00:00:00", constellations="ADD-24+24", epochs=3, interval_s=7200.0,
    mask_deg=5.0, error_model=pl_mc.error_model("dual_frequency", ism=ISM),
)  # fmt: skip
G = SERIES[0]
N = len(G.names)


def araim(**options):
    return method("araim", ism=ISM, standard="v4.2", **({"budget": LPV_200_V42} | options))


@pytest.fixture(scope="module")
def errors():
    """A fault of some size on one satellite, which noise of 1.2 sigma makes agree with more than one."""
    rng = np.random.default_rng(5)
    drawn = rng.standard_normal((40, N)) * 1.2 * G.sigma_m
    drawn[np.arange(40), rng.integers(0, N, 40)] += rng.uniform(5.0, 30.0, 40)
    # Of two faults none can be excluded alone.
    drawn[30:, 2] += 40.0
    return drawn


@pytest.mark.parametrize("budget", [LPV_200_V42, RNP_V42], ids=str)
def test_positions_and_levels_are_those_that_are_predicted(budget):
    """Every position of a padded geometry; two bisections agree to 2e-10 of a bracket of some metres."""
    one = araim(budget=budget, exclusion="satellites")

    @jax.jit
    def prepare(design, sigma_m, in_view, codes):
        return one.prepare(linear_model(design, sigma_m, in_view, satellite=codes))

    for place in range(3):
        g = SERIES[place]
        n = len(g.names)
        pad = SERIES.design.shape[1] + 1 - n
        prepared = prepare(
            np.pad(g.design, ((0, pad), (0, 0))), np.pad(g.sigma_m, (0, pad), constant_values=1),
            np.arange(n + pad) < n, np.pad(codes_of(g.names, g.systems), (0, pad)),
        )  # fmt: skip
        expected = protection_levels(
            g.design, g.sigma_m**2, systems=g.systems, names=g.names, ism=ISM, standard="v4.2", budget=budget,
            exclusion="satellites",
        ).positions  # fmt: skip
        for field in ("vpl_m", "hpl_m"):
            assert float(getattr(prepared.whole, field)) == pytest.approx(getattr(expected, field)[0], abs=1e-7)
            np.testing.assert_allclose(getattr(prepared.without, field)[:n], getattr(expected, field)[1:], atol=1e-7)


@functools.cache
def modes_of(budget):
    """The fault modes that are monitored, as satellites that are out."""
    predicted = protection_levels(
        G.design, G.sigma_m**2, systems=G.systems, names=G.names, ism=ISM, standard="v4.2", budget=budget,
        exclusion="satellites",
    )  # fmt: skip
    return {tuple(out) for out in predicted.excluded[predicted.probability > 0]}


@functools.cache
def root_and_gain(kept):
    root = np.where(kept, 1 / G.sigma_m, 0.0)
    return root, np.linalg.pinv(G.design * root[:, None]) * root


def plainly(errors_m, budget, p_fa_chi2=1e-8):
    """What is excluded and the up error, by pseudoinverses and loops; None where no exclusion passes."""
    c_acc = G.sigma_m**2 - 1.0 + 4 / 9
    modes = modes_of(budget)

    def solution(kept):
        root, gain = root_and_gain(tuple(kept.tolist()))
        state = gain @ errors_m
        return gain[:3], state, float(((errors_m - G.design @ state) ** 2 * root**2).sum())

    def passes(out):
        kept = ~out
        gain, state, square_sum = solution(kept)
        left = {tuple(np.array(mode) & kept) for mode in modes} - {(False,) * N}
        number = len(left) * budget.samples_continuity
        p = np.array([budget.p_fa_horizontal / 4, budget.p_fa_horizontal / 4, budget.p_fa_vertical / 2]) / number
        quantiles = stats.norm.isf(p)
        for mode in left:
            other, moved, _ = solution(kept & ~np.array(mode))
            sigma = np.sqrt((other - gain) ** 2 @ c_acc)
            if (np.abs(moved[:3] - state[:3]) > quantiles * sigma * (1 + 1e-12)).any():
                return False, state, square_sum
        dof = kept.sum() - 5
        return square_sum <= stats.chi2.isf(p_fa_chi2, dof), state, square_sum

    fine, state, _ = passes(np.zeros(N, bool))
    if fine:
        return "", state[2]
    prior = {"G": 1e-5, "E": 3e-5}
    found = []
    for k, name in enumerate(G.names):
        fine, state, square_sum = passes(np.arange(N) == k)
        p = prior[name[0]]
        if fine:
            found.append((2 * np.log(p) - square_sum, name, state[2]))
    return max(found)[1:] if found else (None, np.nan)


def test_the_choice_is_that_of_a_plain_program(errors):
    kinds = set()
    for drawn in errors:
        row = pl_mc.solve(G, drawn, methods=[araim(exclusion="satellites")], tests=True).iloc[0]
        excluded, up = plainly(drawn, LPV_200_V42)
        if excluded is None:
            assert row["rejected"]
            kinds.add("failed")
            continue
        assert not row["rejected"]
        assert row["excluded"] == excluded
        assert row["up_m"] == pytest.approx(up, abs=1e-8)
        kinds.add("excluded" if excluded else "none")
    assert kinds == {"failed", "excluded", "none"}


def test_a_large_fault_is_excluded_and_alarms_no_more():
    """50 m on one satellite: detection alone alarms, exclusion flies on; the satellite is the faulted one."""
    faults = pl_mc.biases(G, {G.names[3]: 50.0})
    table = pl_mc.sample(G, faults, draws=500, seed=3, methods=[araim(), araim(exclusion="satellites"), "ls"])
    detection, exclusion, least_squares = (part for _, part in table.groupby("method", sort=False))
    assert detection["alarm"].all()
    assert (detection["excluded"] == "").all()
    assert (least_squares["excluded"] == "").all()
    assert not exclusion["alarm"].any()
    assert (exclusion["excluded"] == G.names[3]).all()
    assert (exclusion["up_m"].abs() <= exclusion["vpl_m"]).all()


def test_methods_that_do_not_exclude_have_no_such_column():
    table = pl_mc.sample(G, pl_mc.no_fault(G), draws=2, seed=1, methods=["ls"])
    assert "excluded" not in table


def test_service_has_the_levels_that_are_predicted():
    with pytest.raises(pl_mc.InputError, match=r"araim: exclusion: levels after it are predicted as of v4.2"):
        method("araim", exclusion="satellites").batched_levels(
            G.design[None], G.sigma_m[None], np.ones((1, N), bool), np.array([list(G.systems)])
        )
    horizontal, vertical = araim(exclusion="satellites").batched_levels(
        G.design[None], G.sigma_m[None], np.ones((1, N), bool), np.array([list(G.systems)]), np.array([G.names])
    )
    expected = protection_levels(
        G.design, G.sigma_m**2, systems=G.systems, names=G.names, ism=ISM, standard="v4.2", exclusion="satellites"
    )
    assert (horizontal[0], vertical[0]) == (expected.hpl_m, expected.vpl_m)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"standard": "v4"}, "araim: standard: 'v4' is unknown"),
        ({"exclusion": "satellite"}, "araim: exclusion: 'satellite' is unknown"),
        ({"p_fa_chi2": 0.0}, "araim: p_fa_chi2"),
        ({"p_fa_chi2": 1e-6}, "araim: p_fa_chi2: it has no effect without an exclusion"),
        ({"budget": RNP_V42}, "araim: budget: RNP v4.2 has fields that have no effect in standard 'v3'"),
        ({"standard": "v4.2", "unmonitored": "plain"}, "araim: unmonitored: it belongs to standard 'v3'"),
        ({"standard": "v4.2", "budget": LPV_200_V42}, "araim: ism: with an exposure the rates and durations"),
    ],
)
def test_sentences(options, words):
    with pytest.raises(pl_mc.InputError, match=words):
        method("araim", **options)


def test_without_exposure_no_rates_are_needed():
    assert method("araim", standard="v4.2", budget=LPV_200).standard == "v4.2"
