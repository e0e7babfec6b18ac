"""ARAIM v4.2: what must hold in any geometry, and against plain formulas; the numbers of others are in conformance."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from pl_mc import InputError
from pl_mc.araim import LPV_200, LPV_200_V42, RNP_V42, FaultModes, Ism, protection_levels
from pl_mc.araim.exposure_modes import without_rows
from reference.problems import appendix_d, random_sky

G = appendix_d()
N = len(G.names)
FAULTS = {
    "r_sat_per_h": {"G": 1e-5, "E": 2e-5}, "mfd_sat_h": {"G": 1.0, "E": 1.5},
    "r_const_per_h": {"G": 1e-8, "E": 1e-4}, "mfd_const_h": {"G": 1.0, "E": 2.0},
}  # fmt: skip
ISM = Ism(sigma_ura_m=0.5, sigma_ure_m=0.4, b_nom_m=0.75, **FAULTS)
GIVEN = {
    "design": G.design, "c_int": G.sigma_m**2, "systems": G.systems, "names": G.names, "ism": ISM, "standard": "v4.2",
}  # fmt: skip
SINGLES = FaultModes(np.eye(N, dtype=bool), np.full(N, 1e-5), 0.0, 0.0)


def test_without_exposure_the_levels_are_those_of_v3():
    """One sample, no cap and the same modes: the equations are the same, to the last bits."""
    modes = {"p_sat": 1e-5, "p_const": {"G": 1e-8, "E": 1e-4}}
    plain = (G.design, G.sigma_m**2, 0.5 * G.sigma_m**2, G.systems, 0.75)
    earlier = protection_levels(*plain, **modes, unmonitored="plain")
    listed = FaultModes(earlier.excluded, earlier.probability, 0.0, float(earlier.p_not_monitored))
    found = protection_levels(*plain, **modes, modes=listed, standard="v4.2", budget=LPV_200)
    for field in ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m"):
        assert getattr(found, field) == pytest.approx(getattr(earlier, field), rel=1e-12)
    np.testing.assert_allclose(found.threshold_m, earlier.threshold_m, rtol=1e-12)


def test_priors_at_an_instant_and_over_the_exposure():
    """R MFD, and R (MFD + T); every combination of at most two events has its place or is accounted for."""
    table = protection_levels(**GIVEN).modes().set_index("satellites")
    hour = LPV_200_V42.exposure_h
    p = {name: (1e-5, 1e-5 * (1 + hour)) if name[0] == "G" else (3e-5, 2e-5 * (1.5 + hour)) for name in G.names}
    p |= {"G": (1e-8, 1e-8 * (1 + hour)), "E": (2e-4, 1e-4 * (2 + hour))}
    none = [np.prod([1 - q[k] for q in p.values()]) for k in (0, 1)]
    first = G.names[0]
    assert table.loc[first, "p_instant"] == pytest.approx(none[0] * p[first][0] / (1 - p[first][0]), rel=1e-12)
    assert table.loc[first, "p_exposure"] == pytest.approx(none[1] * p[first][1] / (1 - p[first][1]), rel=1e-12)
    # Galileo's own fault stands for the pairs inside of it that are less probable than a hundredth of it.
    galileo = [name for name in G.names if name[0] == "E"]
    odds = {one: p[one][0] / (1 - p[one][0]) for one in (*galileo, "E")}
    own = none[0] * odds["E"]
    inside = [none[0] * odds[one] * odds[other] for one, other in itertools.combinations(odds, 2)]
    assert table.loc[" ".join(galileo), "p_instant"] == pytest.approx(own + sum(inside), rel=1e-12)


def terms(design, c_int, c_acc, b_nom, modes, budget, axis):
    """Sigma, and threshold with bias, of the case without a fault and of each mode, by NumPy's pseudoinverse."""
    root = 1 / np.sqrt(c_int)
    gain = [(np.linalg.pinv(design * root[:, None]) * root)[axis]]
    for out in modes.excluded:
        rows = np.where(out, 0.0, root)[:, None] * design
        gain.append((np.linalg.pinv(rows) * np.where(out, 0.0, root))[axis])
    gain = np.array(gain)
    separation = np.sqrt((gain - gain[0]) ** 2 @ c_acc)
    p_fa = budget.p_fa_vertical / 2 if axis == 2 else budget.p_fa_horizontal / 4
    factor = stats.norm.isf(p_fa / budget.samples_continuity / len(modes.probability))
    return np.sqrt(gain**2 @ c_int), factor * separation + np.abs(gain) @ b_nom


def weights(modes, budget, axis, share=1.0):
    """Priors, of which the first counts both tails; caps; and the risk that is allowed."""
    cap = np.ones(1 + len(modes.probability))
    if budget.capped:
        cap[1:] = np.minimum(1, modes.exposure / modes.probability / budget.samples_integrity)
    risk = share * (1 - modes.p_not_monitored / budget.p_hmi) / budget.samples_integrity
    risk *= budget.p_hmi_vertical if axis == 2 else budget.p_hmi_horizontal / 2
    return np.concatenate([[2.0], modes.probability]), cap, risk


def tail(u):
    return np.where(u > 0, stats.norm.sf(u), 1.0)


def reference(design, c_int, c_acc, b_nom, modes, budget, axis, share=1.0):
    """A level by the plain equation and SciPy's root."""
    sigma, shift = terms(design, c_int, c_acc, b_nom, modes, budget, axis)
    weight, cap, risk = weights(modes, budget, axis, share)

    def excess(level):
        return float((weight * np.minimum(cap, tail((level - shift) / sigma))).sum() - risk)

    return optimize.brentq(excess, 0.0, 1e4, xtol=1e-10)


def modes_of(levels):
    own = levels.probability > 0
    return FaultModes(
        levels.excluded[own], levels.probability[own], 0.0, float(levels.p_not_monitored), levels.exposure[own]
    )


@pytest.mark.parametrize("budget", [LPV_200_V42, RNP_V42, dataclasses.replace(RNP_V42, capped=True)], ids=str)
def test_levels_by_the_plain_equation(budget):
    levels = protection_levels(**GIVEN, budget=budget)
    modes = modes_of(levels)
    c_int = G.sigma_m**2
    east, north, up = (
        reference(G.design, c_int, c_int - 0.25 + 0.16, np.full(N, 0.75), modes, budget, axis) for axis in range(3)
    )
    assert levels.hpl_m == pytest.approx(np.hypot(east, north), abs=1e-7)
    assert levels.vpl_m == pytest.approx(up, abs=1e-7)


def test_the_bias_of_continuity_widens_the_thresholds():
    """By the sum of |S_k - S_0| b_acc."""
    plain = protection_levels(**GIVEN)
    wide = protection_levels(**GIVEN | {"ism": dataclasses.replace(ISM, b_acc_m=0.3)})
    out, root = plain.excluded[0], 1 / G.sigma_m
    gain = [np.linalg.pinv(G.design * w[:, None]) * w for w in (root, np.where(out, 0.0, root))]
    np.testing.assert_allclose(
        wide.threshold_m[0] - plain.threshold_m[0], 0.3 * np.abs(gain[1] - gain[0])[:3].sum(axis=1), rtol=1e-9
    )
    assert wide.vpl_m > plain.vpl_m


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=6)
def test_invariance(seed):
    """Neither the order of rows nor padding matters where modes join by their priors."""
    rng = np.random.default_rng(seed)
    design, sigma, letters = random_sky(rng, counts=(7, 6))
    systems, small = letters.replace("C", "E"), dataclasses.replace(ISM, sigma_ura_m=0.1, sigma_ure_m=0.05)
    plain = protection_levels(design, sigma**2, systems=systems, ism=small, standard="v4.2", order="probable")
    order = rng.permutation(13)
    wide = np.full((14, 5), np.nan)
    wide[1:] = design[order]
    variance = np.full(14, np.nan)
    variance[1:] = sigma[order] ** 2
    moved = protection_levels(
        wide, variance, systems=["?", *np.array(list(systems))[order]], ism=small, in_view=np.arange(14) > 0,
        standard="v4.2", order="probable",
    )  # fmt: skip
    for field in ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m", "hpl_norm_m", "hpl_plane_m"):
        np.testing.assert_allclose(getattr(moved, field), getattr(plain, field), rtol=1e-7)
    assert moved.p_not_monitored == pytest.approx(plain.p_not_monitored, rel=1e-6, abs=1e-15)


def test_other_horizontal_levels():
    """At each level its own equation uses up the risk; planes with the sign of the code have the smaller one."""
    levels = protection_levels(**GIVEN, budget=RNP_V42)
    modes, c_int = modes_of(levels), G.sigma_m**2
    (s1, t1), (s2, t2) = (
        terms(G.design, c_int, c_int - 0.09, np.full(N, 0.75), modes, RNP_V42, axis) for axis in (0, 1)
    )
    weight, _, risk = weights(modes, RNP_V42, 0)
    weight[0] = 1.0
    s = np.hypot(s1, s2)
    a, c = (t1 * s1 + t2 * s2) / s, (t1 * s2 - t2 * s1) / s

    def norms(level):
        return (2 * weight * tail((level - np.hypot(t1, t2)) / s)).sum()

    def planes(level, sign):
        k = (np.sqrt(level**2 + sign * c**2) - a) / s
        axes = [tail((sq * k + tq - tq[0]) / sq[0]) for sq, tq in ((s1, t1), (s2, t2))]
        return (weight * (tail(k) + sum(axes) / 2)).sum()

    assert levels.hpl_norm_m == pytest.approx(optimize.brentq(lambda x: norms(x) - risk, 1, 1e3), abs=1e-7)
    for sign, level in ((-1, levels.hpl_plane_m), (1, levels.hpl_plane_coded_m)):
        assert level == pytest.approx(optimize.brentq(lambda x, s=sign: planes(x, s) - risk, 8, 1e3), abs=1e-7)
    assert levels.hpl_plane_coded_m < levels.hpl_plane_m


def test_exclusion_takes_the_worst_position():
    levels = protection_levels(**GIVEN, exclusion="constellations")
    positions = levels.positions
    # All in view, each satellite, Galileo; a fault of GPS is too rare to be a candidate.
    assert positions.there.tolist() == [True] * (N + 2)
    np.testing.assert_array_equal(positions.excluded[-1], [name[0] == "E" for name in G.names])
    for field in ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m"):
        assert getattr(levels, field) == getattr(positions, field).max()
    # A position is the geometry without that satellite, which leaves every mode, with its part of the risk.
    alone = protection_levels(**GIVEN, exclusion="satellites").positions
    listed = modes_of(levels)
    left = without_rows(listed, np.arange(N) == 3)
    assert len(left.probability) < len(listed.probability)
    assert left.probability.sum() == pytest.approx(listed.probability.sum() - listed.probability[3], rel=1e-12)
    c_int = G.sigma_m**2
    c_int[3] = 1e12
    b_nom = np.where(np.arange(N) == 3, 0, 0.75)
    up = reference(G.design, c_int, c_int - 0.09, b_nom, left, LPV_200_V42, 2, share=1 / (N + 1))
    assert alone.vpl_m[4] == pytest.approx(up, abs=1e-5)


def test_the_adjusted_estimator_keeps_to_its_accuracy():
    plain = protection_levels(**GIVEN)
    moved = protection_levels(**GIVEN, estimator="adjusted")
    assert moved.sigma_v_acc_m > plain.sigma_v_acc_m
    assert moved.sigma_v_acc_m <= LPV_200_V42.sigma_acc_vertical_m
    limits = {"sigma_acc_vertical_m": float(plain.sigma_v_acc_m), "sigma_acc_horizontal_m": 1e-3}
    tight = dataclasses.replace(LPV_200_V42, **limits)
    still = protection_levels(**GIVEN, estimator="adjusted", budget=tight)
    # No room: nothing moves.
    assert (still.vpl_m, still.hpl_m) == pytest.approx((plain.vpl_m, plain.hpl_m), rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"standard": "v4"}, "standard: 'v4' is unknown .nearest: v4.2"),
        ({"exclusion": "satellite"}, "exclusion: 'satellite' is unknown .nearest: satellites"),
        ({"estimator": "adjust"}, "estimator: 'adjust' is unknown .nearest: adjusted"),
        ({"order": "list"}, "order: 'list' is unknown .nearest: listed"),
        ({"unmonitored": "plain"}, "unmonitored: it belongs to standard 'v3'"),
        ({"standard": "v3", "exclusion": "satellites"}, "exclusion: it has no effect in standard 'v3'"),
        ({"standard": "v3", "estimator": "adjusted"}, "estimator: it has no effect in standard 'v3'"),
        ({"standard": "v3", "order": "listed"}, "order: it has no effect in standard 'v3'"),
        ({"standard": "v3", "budget": RNP_V42}, "budget: RNP v4.2 has fields that have no effect in standard 'v3'"),
        ({"budget": LPV_200, "estimator": "adjusted"}, "budget: the adjusted estimator needs a limit"),
        ({"ism": None, "c_acc": 1.0, "b_nom": 0.75, "p_sat": 1e-5, "p_const": {"G": 1e-8, "E": 1e-4}},
         "ism: with an exposure the rates and durations"),
        ({"ism": Ism(0.5, 0.4, 0.75, 1e-5, 1e-4)}, "r_sat_per_h: it is needed here, and the ISM has none"),
        ({"ism": dataclasses.replace(ISM, r_sat_per_h=0.98, mfd_sat_h=1.0)}, "p_sat: over an exposure of"),
        ({"modes": 3}, r"modes: pl_mc.araim.FaultModes, or a list of 1, are needed, not 3"),
        ({"modes": FaultModes(np.eye(3, dtype=bool), np.ones(3), 0.0, 0.0)}, r"modes: the shapes \(modes, 10\)"),
        ({"modes": [SINGLES] * 2}, "modes: one list, or 1 as there"),
        ({"modes": SINGLES, "order": "listed"}, "order: it has no effect"),
    ],
)  # fmt: skip
def test_sentences(changed, words):
    with pytest.raises(InputError, match=words):
        protection_levels(**GIVEN | changed)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("exposure_h", -1.0, "budget.exposure_h: a time is not negative"),
        ("samples_integrity", 0.5, "budget.samples_integrity: one sample is the least"),
        ("consolidation", 2.0, "budget.consolidation: it lies between 0 and 1"),
        ("p_exclusion", -1e-9, "budget.p_exclusion: it lies between 0 and 1"),
        ("capped", 1, "budget.capped: true or false"),
        ("sigma_acc_vertical_m", 0.0, "budget.sigma_acc_vertical_m"),
    ],
)
def test_budgets(field, value, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(LPV_200_V42, **{field: value})


def test_two_of_prior_rate_and_duration():
    """A prior is the rate times the duration, whichever two are given, satellite by satellite."""
    ism = Ism(r_sat_per_h={"G": 1e-5, "G07": 4e-5}, mfd_sat_h=2.0)
    np.testing.assert_allclose(ism.values("p_sat", ["G01", "G07"], "GG"), [2e-5, 8e-5])
    assert not ism.has("p_const")
    backwards = Ism(p_const={"G": 1e-8, "E": 2e-4}, mfd_const_h={"G": 1.0, "E": 2.0})
    np.testing.assert_allclose(backwards.values("r_const_per_h", ["G", "E"], "GE"), [1e-8, 1e-4])
    with pytest.raises(InputError, match="p_sat: it is r_sat_per_h times mfd_sat_h, which are given; two of the three"):
        Ism(p_sat=1e-5, r_sat_per_h=1e-5, mfd_sat_h=1.0)
    with pytest.raises(InputError, match=r"p_sat: .* cannot be used; a prior probability lies between 0 and 1"):
        Ism(r_sat_per_h=0.5, mfd_sat_h=3.0)
    with pytest.raises(InputError, match=r"mfd_sat_h: 0 cannot be used; .* above zero, .*nearest: above 0"):
        Ism(r_sat_per_h=0.5, mfd_sat_h=0)


@pytest.mark.parametrize("exclusion", [None, "satellites", "constellations"])
def test_geometries_without_satellites_or_with_few_have_no_levels(exclusion):
    """In a batch with a sound one, whose levels stay what they are alone."""
    seen = np.ones((3, N), bool)
    seen[1], seen[2, 4:] = False, False
    given = GIVEN | {"design": np.stack([G.design] * 3), "exclusion": exclusion}
    levels = protection_levels(**given, in_view=seen)
    alone = protection_levels(**GIVEN, exclusion=exclusion)
    assert levels.available.tolist() == [True, False, False]
    assert np.isinf(levels.vpl_m[1:]).all()
    assert levels.vpl_m[0] == pytest.approx(alone.vpl_m, rel=1e-12)
    assert levels.modes()["geometry"].unique().tolist() in ([0], [0, 2])


@pytest.mark.parametrize("exclusion", [None, "satellites", "constellations"])
def test_rows_out_of_view_decide_nothing(exclusion):
    """With a row for every satellite, in view or not, levels are those of the rows in view; modes keep their rows."""
    rows = np.sort(np.stack([np.random.default_rng(seed).permutation(N + 5)[:N] for seed in (1, 2)]))
    wide = {"in_view": np.zeros((2, N + 5), dtype=bool), "design": np.full((2, N + 5, G.design.shape[1]), np.nan)}
    wide |= {
        "c_int": np.full((2, N + 5), np.nan),
        "systems": np.full((2, N + 5), "G"),
        "names": np.full((2, N + 5), "G99"),
    }
    for k, own in enumerate(rows):
        wide["in_view"][k, own], wide["design"][k, own], wide["c_int"][k, own] = True, G.design, G.sigma_m**2
        wide["systems"][k, own], wide["names"][k, own] = G.systems, G.names
    ism = dataclasses.replace(ISM, r_sat_per_h={"G": 1e-5, "E": 2e-5, G.names[2]: 4e-5})
    one = protection_levels(**GIVEN | {"ism": ism}, exclusion=exclusion)
    found = protection_levels(**wide, ism=ism, standard="v4.2", exclusion=exclusion)
    for k, own in enumerate(rows):
        for field in ("vpl_m", "hpl_m", "emt_m", "hpl_plane_m", "p_not_monitored", "probability", "threshold_m"):
            np.testing.assert_array_equal(getattr(found, field)[k], getattr(one, field), err_msg=field)
        np.testing.assert_array_equal(found.excluded[k][:, own], one.excluded)
        assert found.excluded[k].sum() == one.excluded.sum()
        if one.positions is None or found.positions is None:
            continue
        last = N + 6 + np.arange(one.positions.there.size - N - 1)
        place = np.concatenate([[0], 1 + own, last])
        assert found.positions.there[k].sum() == one.positions.there.sum()
        for field in ("there", "vpl_m", "hpl_m", "sigma_v_acc_m"):
            np.testing.assert_array_equal(getattr(found.positions, field)[k][place], getattr(one.positions, field))
        np.testing.assert_array_equal(found.positions.excluded[k][place][:, own], one.positions.excluded)
