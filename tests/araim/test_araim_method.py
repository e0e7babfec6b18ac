"""The method of the sweep: the same levels as the function, tests that are what they claim, rates within budget."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

import pl_mc
import pl_mc.araim
from pl_mc import InputError
from pl_mc.araim import LPV_200, fault_modes
from pl_mc.araim.compiled_modes import Priors, compiled_modes
from pl_mc.kernels import linear_model, start_from
from pl_mc.methods.araim import Araim
from reference import araim_numpy
from reference.problems import appendix_d, random_sky

ROWS, CLOCKS = 14, 3

# A geometry of this many satellites and these priors needs pairs, among them pairs that modes hold.
PAIRS = Araim(p_sat=1e-4, p_const=1e-5)


@functools.partial(jax.jit, static_argnames="of")
def prepared_and_outcome(of, design, sigma_m, observed_m, in_view):
    model = linear_model(design, sigma_m, in_view)
    prepared = of.prepare(model)
    return model, prepared, of.solve(model, prepared, start_from(model, observed_m))


@functools.partial(jax.jit, static_argnames="of")
def outcome(of, *arrays):
    return prepared_and_outcome(of, *arrays)[2]


def padded(rng, counts, lanes=8):
    """A sky in random rows of fourteen, three clocks; noise, with 40 m on one satellite in half of the lanes."""
    design, sigma, systems = random_sky(rng, counts=counts)
    n = len(systems)
    place = np.sort(rng.permutation(ROWS)[:n])
    wide, wide_sigma, observed = np.full((ROWS, 3 + CLOCKS), np.nan), np.full(ROWS, np.nan), np.zeros((ROWS, lanes))
    wide[place] = np.pad(design, ((0, 0), (0, 3 + CLOCKS - design.shape[1])))
    wide_sigma[place] = sigma
    observed[place] = sigma[:, None] * rng.standard_normal((n, lanes))
    observed[rng.choice(place, lanes // 2), np.arange(lanes // 2)] += 40.0
    return wide, wide_sigma, observed, np.isin(np.arange(ROWS), place), systems, place


@pytest.mark.parametrize(
    ("of", "counts"),
    [
        (Araim(), (6, 5)),
        (Araim(), (5, 5, 4)),
        (Araim(), (10,)),
        (Araim(), (9, 1)),
        (PAIRS, (5, 5, 4)),
        (PAIRS, (6, 5)),
        (PAIRS, (5,)),
    ],
)
def test_levels_and_decisions_are_those_of_the_reference(of, counts):
    """Both levels, and the decision on each lane, threshold by threshold from pseudoinverses.

    The accuracy of 1e-7 is rounding times the condition of the subsets' normal matrices, here below 1e8.
    """
    rng = np.random.default_rng(sum(counts))
    design, sigma, observed, in_view, systems, place = padded(rng, counts)
    _, _, found = prepared_and_outcome(of, design, sigma, observed, in_view)
    part, variance, n = design[place][:, : 3 + len(counts)], sigma[place] ** 2, len(place)
    priors = np.full(n, of.p_sat), dict.fromkeys("GCE", of.p_const)
    expected = araim_numpy.levels(
        part, variance, variance, systems, np.full(n, of.b_nom_m), *priors, unmonitored=of.unmonitored
    )
    np.testing.assert_allclose(found.vpl_m, expected.vpl, rtol=1e-7)
    np.testing.assert_allclose(found.hpl_m, expected.hpl, rtol=1e-7)
    # Without the largest constellation the others have to determine a position.
    assert np.all(found.available == (len(counts) > 1 and min(counts) > 3))
    assert np.all(found.available == np.isfinite(expected.vpl))
    if not np.all(found.available):
        assert not found.rejects.any()
        return
    whole, _ = araim_numpy.subset(part, variance, frozenset())
    np.testing.assert_allclose(found.error_m, whole @ observed[place], rtol=0, atol=1e-9)
    rejects = np.zeros(observed.shape[1], dtype=bool)
    for excluded, threshold in zip(expected.modes, expected.thresholds, strict=True):
        gain, _ = araim_numpy.subset(part, variance, excluded)
        separation = np.abs((gain - whole) @ observed[place])
        # Subsets without any separation have a threshold of zero.
        rejects |= ((separation > threshold[:, None]) & (separation > 1e-9)).any(axis=0)
    np.testing.assert_array_equal(found.rejects, rejects)
    assert rejects[: len(rejects) // 2].any()
    assert not rejects.all()


@functools.partial(jax.jit, static_argnames="priors")
def modes_of(clocks, in_view, priors):
    design = jnp.concatenate([jnp.ones((clocks.shape[0], 3)), clocks], axis=1)
    return compiled_modes(linear_model(design, jnp.ones(clocks.shape[0]), in_view), priors)


PRIORS = [
    Priors(p_sat, p_const, LPV_200.p_threshold, unmonitored)
    for p_sat, p_const, unmonitored in (
        (1e-5, 1e-4, "contained"),
        (1e-4, 1e-5, "contained"),
        (1e-4, 1e-4, "plain"),
        (1e-8, 2e-4, "contained"),
    )
]


def triples_held(clocks, in_view, priors, modes, left):
    """(modes,), what the host adds to the prior of each mode for the three faults at a time that it holds.

    The host looks at three faults where pairs leave more than the threshold and what cannot be tested is no more
    than that; those that a mode holds are then shared out, as pairs are. The compiled rule counts all of them as
    not monitored.
    """
    member = (clocks > 0) & in_view[:, None]
    counts = in_view & ~(member & (member.sum(axis=0) == 1)).any(axis=1)
    groups = [group for group in (member & counts[:, None]).T if group.any()]
    events = [(np.eye(len(in_view), dtype=bool)[k], priors.p_sat) for k in np.flatnonzero(counts)]
    events += [(group, priors.p_const) for group in groups]
    none = np.prod([1.0 - p for _, p in events])

    def combinations(size):
        for chosen in itertools.combinations(events, size):
            prior = none * np.prod([p / (1.0 - p) for _, p in chosen])
            yield np.any([spoilt for spoilt, _ in chosen], axis=0), prior

    def solvable(spoilt):
        kept = in_view & ~spoilt
        return kept.sum() >= 3 + (member & kept[:, None]).any(axis=0).sum()

    lost = sum(prior for size in (1, 2) for spoilt, prior in combinations(size) if not solvable(spoilt))
    more = np.zeros(len(modes))
    if priors.unmonitored == "contained" and left > priors.p_threshold >= lost:
        for spoilt, prior in combinations(3):
            holds = np.array([set(np.flatnonzero(spoilt)) <= set(mode) for mode in modes])
            more += prior * holds / max(holds.sum(), 1)
    return more


@given(counts=st.lists(st.integers(0, 8), min_size=3, max_size=3), priors=st.sampled_from(PRIORS))
# Here pairs leave 1.00002 times the threshold, and the host goes on to three faults.
@example(counts=[2, 3, 4], priors=PRIORS[3])
@settings(max_examples=60)
def test_modes_are_those_of_the_host(counts, priors):
    """Whatever the rule makes of each pattern, both implementations make it, but for three faults at a time."""
    letters = "".join(letter * count for letter, count in zip("GCE", counts, strict=True))[:ROWS]
    letters += "-" * (ROWS - len(letters))
    clocks = np.array([[a == b for b in "GCE"] for a in letters], dtype=float)
    in_view = np.array([letter != "-" for letter in letters])
    found = jax.tree.map(np.asarray, modes_of(clocks, in_view, priors))
    expected = fault_modes(
        [letter.replace("-", "") for letter in letters],
        clocks > 0,
        np.where(in_view, priors.p_sat, 0.0),
        dict.fromkeys("GCE", priors.p_const),
        LPV_200,
        priors.unmonitored,
    )

    def table(sets, p):
        return sorted((tuple(np.flatnonzero(s).tolist()), float(q)) for s, q in zip(sets, p, strict=True) if q > 0)

    mine, theirs = table(found.excluded, found.probability), table(expected.excluded, expected.probability)
    assert [s for s, _ in mine] == [s for s, _ in theirs]
    more = triples_held(clocks, in_view, priors, [s for s, _ in mine], float(found.p_not_monitored))
    np.testing.assert_allclose([p for _, p in mine] + more, [p for _, p in theirs], rtol=1e-9)
    np.testing.assert_allclose(found.p_not_monitored - more.sum(), expected.p_not_monitored, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("priors", PRIORS)
def test_pairs_are_ruled_out_only_where_no_view_needs_them(priors):
    """All ways to have up to ten satellites of two systems in view, against the bound for ten rows."""
    if priors.pairs_possible(10, 2):
        # There is a place for pairs, whether or not a view needs one.
        assert priors != PRIORS[0]
        return
    for counts in itertools.product(range(11), repeat=2):
        if sum(counts) <= 10:
            letters = "G" * counts[0] + "E" * counts[1]
            clocks = np.array([[a == b for b in "GE"] for a in letters], dtype=bool).reshape(len(letters), 2)
            p_sat, p_const = np.full(len(letters), priors.p_sat), dict.fromkeys("GE", priors.p_const)
            modes = fault_modes(list(letters), clocks, p_sat, p_const, LPV_200, priors.unmonitored)
            # At most one event each: a satellite, or a constellation as it stands in view.
            sizes = modes.excluded.sum(axis=1)
            assert all(size == 1 or size in counts for size in sizes)
            assert len(sizes) <= len(letters) + 2


def test_which_priors_ask_for_pairs():
    assert not Priors(1e-5, 1e-4, 8e-8, "contained").pairs_possible(24, 2)
    # C(24, 2) p^2 + 24 x 2 p P + P^2 = 8.6e-8
    assert Priors(1e-5, 1e-4, 8e-8, "plain").pairs_possible(24, 2)
    assert Priors(1e-5, 1e-4, 8e-8, "contained").pairs_possible(36, 3)
    assert not Priors(1e-5, 0.0, 8e-8, "plain").pairs_possible(40, 4)


def test_each_test_has_its_share_of_the_false_alerts():
    """Under the sweep's noise a separation is normal with the sigma that its threshold is a multiple of."""
    rng = np.random.default_rng(4)
    design, sigma, observed, in_view, _, place = padded(rng, (6, 5))
    model, prepared, _ = prepared_and_outcome(Araim(), design, sigma, observed, in_view)
    gain, limit = np.asarray(prepared.whole.gain[0]), np.asarray(prepared.whole.limit_m[0])
    live = np.isfinite(limit)
    assert live.sum() == 3 * (len(place) + 2)
    hat = np.asarray(model.design) @ np.asarray(model.gain)
    spread = np.sqrt((((gain @ (np.diag(np.asarray(model.in_view)) - hat))[live]) ** 2).sum(axis=1))
    axis = np.repeat(np.arange(3), len(limit) // 3)[live]
    count = live.sum() / 3
    p_fa = np.where(axis == 2, LPV_200.p_fa_vertical / count, LPV_200.p_fa_horizontal / 2 / count)
    some = spread > 1e-6
    assert some.sum() > 30
    np.testing.assert_allclose(2 * stats.norm.sf(limit[live][some] / spread[some]), p_fa[some], rtol=1e-6)


def test_the_false_alert_rate_of_a_sweep():
    """Between what one vertical test has and what all tests may have together, at a level of 1e-6 on each side."""
    loud = dataclasses.replace(LPV_200, name="loud", p_fa_vertical=0.02, p_fa_horizontal=0.01)
    of = Araim(budget=loud)
    assert of.name == "araim(budget=loud)"
    g = appendix_d()
    never = pl_mc.AlertLimits("never", vertical_m=1e9, horizontal_m=40.0)
    with jax.numpy_dtype_promotion("standard"):
        table = pl_mc.sweep(g, pl_mc.no_fault(g), draws=20_000, seed=11, methods=(of,), alert=never, workers=1)
    alarms, draws = int(table["alarms"].iloc[0]), int(table["draws"].iloc[0])
    assert draws == 20_000
    assert stats.binom.sf(alarms - 1, draws, 0.03) > 1e-6
    assert stats.binom.cdf(alarms, draws, 0.02 / 12) > 1e-6
    assert int(table["false_alarms"].iloc[0]) == alarms


@pytest.mark.optimised
def test_single_precision():
    rng = np.random.default_rng(9)
    design, sigma, observed, in_view, _, _ = padded(rng, (6, 5))
    # What single precision is held to may be compiled in any way.
    quick = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
    quickly = jax.jit(outcome.__wrapped__, static_argnames="of", compiler_options=quick)
    double = quickly(Araim(), design, sigma, observed, in_view)
    single = outcome(Araim(), *(x.astype(np.float32) for x in (design, sigma, observed)), in_view)
    assert single.vpl_m.dtype == single.error_m.dtype == np.float32
    # Rounding of 6e-8 times a condition of up to 1e3.
    np.testing.assert_allclose(single.vpl_m, double.vpl_m, rtol=1e-4)
    np.testing.assert_allclose(single.hpl_m, double.hpl_m, rtol=1e-4)
    np.testing.assert_array_equal(single.rejects, double.rejects)


def test_names_and_options():
    assert Araim().name == "araim"
    assert Araim(p_const=0.0, unmonitored="plain").name == "araim(p_const=0,unmonitored=plain)"
    assert hash(Araim()) == hash(Araim())
    for options, words in (
        ({"p_sat": 0.0}, "araim: p_sat: a positive number"),
        ({"p_sat": 2.0}, "araim: p_sat: a prior probability"),
        ({"p_const": -1e-4}, "araim: p_const: a prior probability"),
        ({"p_const": float("nan")}, "araim: p_const: a finite number"),
        ({"b_nom_m": -1.0}, "araim: b_nom_m: a nominal bias"),
        ({"accuracy_ratio": 0.0}, "araim: accuracy_ratio: a positive number"),
        ({"budget": 1e-7}, "araim: budget: a budget such as"),
        ({"unmonitored": "none"}, "araim: unmonitored: 'none' is unknown"),
    ):
        with pytest.raises(InputError, match=words):
            Araim(**options)
