"""The methods of classical RAIM against plain solves of every set of satellites, and against exact probabilities.

The tolerance between two computations of the same number is 1e-8: rounding (1e-16) times the condition of a normal
matrix (up to 1e4), and the square of what an exclusion magnifies (redundancy numbers down to 1e-2).
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

import pl_mc
from pl_mc import InputError
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.leave_one_out import parity_basis, projections
from pl_mc.methods import LeaveOneOut, MaxDop, Nioraim, Parity, RangeComparison, Sbas, Slope, WTest, method
from pl_mc.methods.raim_levels import FORMS, noise_factors, protected_sizes, thresholds
from pl_mc.statistics import binomial_p_value, joint_exceedance, ls_quantities, split_at_threshold
from reference import raim_numpy as oracle
from reference.problems import appendix_d, random_sky

TOLERANCE = 1e-8
LANES = 12
P_FA, P_MD = 1e-3, 1e-2
RISKS = {"p_fa": P_FA, "p_md": P_MD}

FAMILY = (
    *(Slope(**RISKS, form=form) for form in FORMS),
    MaxDop(**RISKS),
    MaxDop(**RISKS, form="subset"),
    Parity(**RISKS),
    Parity(**RISKS, form="noncentral", exclude=True),
    WTest(),
    WTest(exclusions=3, form="reliability", final="local"),
    WTest(exclusions=2, variance="posterior", final="global", p_fa=P_FA),
    LeaveOneOut(**RISKS),
    LeaveOneOut(**RISKS, form="sigma"),
    RangeComparison(**RISKS),
    RangeComparison(**RISKS, base="others"),
    Nioraim(**RISKS, iterations=60),
    Nioraim(**RISKS, iterations=60, target="horizontal"),
    Sbas(),
)


@functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
def solve_all(design, sigma_m, observed_m, in_view):
    """Outcomes of the family, and |p|^2 beside V'PV."""
    model = linear_model(design, sigma_m, in_view)
    start = start_from(model, observed_m)
    basis, _ = parity_basis(model, projections(model))
    parity = basis @ start.residuals
    found = [of.solve(model, of.prepare(model), start) for of in FAMILY]
    return found, (jnp.sum(parity**2, axis=0), start.square_sum), basis


def outcomes(design, sigma_m, observed_m, in_view=None):
    in_view = np.ones(len(sigma_m), bool) if in_view is None else in_view
    # Module-wide fixtures come before the folder's own; another setting would be another compilation.
    with jax.numpy_dtype_promotion("strict"):
        found, squares, basis = solve_all(design, sigma_m, observed_m, in_view)
    return dict(zip(FAMILY, jax.tree.map(np.asarray, found), strict=True)), squares, basis


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A sky of ten satellites, seven to ten of them in view; noise, and faults on none, one or two of them."""
    rng = np.random.default_rng(seed)
    design, sigma, _ = random_sky(rng, counts=(6, 4))
    while True:
        in_view = np.arange(10) != rng.integers(0, 10)
        in_view[rng.permutation(10)[: rng.integers(0, 3)]] = False
        a = design[in_view] / sigma[in_view, None]
        used = a[:, (a != 0).any(axis=0)]
        if used.shape[0] > used.shape[1] and np.linalg.svd(used, compute_uv=False)[-1] > 0.1:
            break
    observed = sigma[:, None] * rng.standard_normal((10, LANES))
    for lane in range(LANES // 3, LANES):
        for i in rng.permutation(np.nonzero(in_view)[0])[: 1 + lane % 2]:
            observed[i, lane] += rng.choice([-1, 1]) * rng.uniform(5, 80) * sigma[i]
    return design, sigma, observed, in_view


@pytest.fixture(scope="module", params=[1, 2, 3, 4, 5, 6])
def solved(request):
    given_problem = problem(request.param)
    return given_problem, np.nonzero(given_problem[3])[0], *outcomes(*given_problem)


def assert_levels(found, expected) -> None:
    np.testing.assert_allclose(found.hpl_m, expected[0], rtol=TOLERANCE)
    np.testing.assert_allclose(found.vpl_m, expected[1], rtol=TOLERANCE)
    np.testing.assert_array_equal(found.available, np.broadcast_to(np.isfinite(expected).all(), (LANES,)))


def assert_each(found, expected) -> None:
    """``expected`` has one (error, levels, rejects) for each lane."""
    for lane, (error, levels, rejects) in enumerate(expected):
        available = bool(np.isfinite(levels).all())
        assert found.available[lane] == available
        if available:
            np.testing.assert_allclose(found.error_m[:, lane], error, rtol=TOLERANCE, atol=TOLERANCE)
            np.testing.assert_allclose([found.hpl_m[lane], found.vpl_m[lane]], levels, rtol=TOLERANCE)
            assert found.rejects[lane] == rejects


def each_fit(design, sigma, observed, rows):
    return [oracle.fit(design, sigma, observed[:, lane], rows) for lane in range(LANES)]


@pytest.mark.parametrize("form", FORMS)
def test_slope(solved, form):
    (design, sigma, observed, _), rows, found, _, _ = solved
    found = found[Slope(**RISKS, form=form)]
    levels = oracle.slope_levels(design, sigma, rows, form, P_FA, P_MD)
    assert_levels(found, levels)
    fits = each_fit(design, sigma, observed, rows)
    assert_each(found, [(f.error, levels, f.square_sum > stats.chi2.isf(P_FA, f.dof)) for f in fits])


def test_max_dop(solved):
    """By the DOPs of sets that are solved anew; the change of the DOP is the slope (Brown 1992)."""
    (design, sigma, _, _), rows, found, _, _ = solved
    whole, *subsets = oracle.subset_dops(design, sigma, rows)
    dof = oracle.fit(design, sigma, np.zeros(10), rows).dof
    size = oracle.size("noncentral", dof, P_FA, P_MD)
    change = np.sqrt(np.max(np.square(subsets) - whole**2, axis=0))
    change, slope = found[MaxDop(**RISKS)], (found[Slope(**RISKS)], change * size)
    assert_levels(change, slope[1])
    np.testing.assert_allclose(change.vpl_m, slope[0].vpl_m, rtol=TOLERANCE)
    np.testing.assert_allclose(change.hpl_m, slope[0].hpl_m, rtol=TOLERANCE)
    np.testing.assert_array_equal(change.rejects, slope[0].rejects)
    assert_levels(found[MaxDop(**RISKS, form="subset")], np.max(subsets, axis=0) * [6.18, 5.33])


def test_the_parity_vector_is_as_long_as_the_residuals(solved):
    """Q A = 0, Q Q' = I on n - t rows, Q'Q = I - A N^-1 A'P: |p|^2 = V'PV draw by draw, one test is the other."""
    (design, sigma, observed, in_view), rows, found, (parity, residuals), basis = solved
    fits = each_fit(design, sigma, observed, rows)
    dof = fits[0].dof
    np.testing.assert_allclose(basis @ basis.T, np.diag(np.arange(10) < dof), atol=TOLERANCE)
    np.testing.assert_allclose((basis.T @ basis)[np.ix_(rows, rows)], fits[0].redundancy_matrix, atol=TOLERANCE)
    np.testing.assert_allclose(basis @ np.where(in_view[:, None], design / sigma[:, None], 0), 0, atol=1e-10)
    np.testing.assert_allclose(parity, residuals, rtol=TOLERANCE)
    expected = [oracle.parity_square_sum(design, sigma, observed[:, lane], rows) for lane in range(LANES)]
    np.testing.assert_allclose(parity, expected, rtol=TOLERANCE)
    line, chi_square = found[Parity(**RISKS)], found[Slope(**RISKS)]
    np.testing.assert_array_equal(line.rejects, chi_square.rejects)
    assert_levels(line, oracle.slope_levels(design, sigma, rows, "line", P_FA, P_MD))


def test_exclusion_by_parity_is_exclusion_by_the_best_of_all_sets(solved):
    (design, sigma, observed, _), rows, found, _, _ = solved
    expected, sigma_expected = [], []
    for lane in range(LANES):
        used, alarm = oracle.leave_one_out(design, sigma, observed[:, lane], rows, P_FA)
        levels = oracle.slope_levels(design, sigma, used.rows, "noncentral", P_FA, P_MD)
        expected.append((used.error, levels, alarm))
        sigma_expected.append((used.error, oracle.sigma_levels(used.covariance, 6.18, 5.33), alarm))
    for of in (LeaveOneOut(**RISKS), Parity(**RISKS, form="noncentral", exclude=True)):
        assert_each(found[of], expected)
    assert_each(found[LeaveOneOut(**RISKS, form="sigma")], sigma_expected)


def test_w_test(solved):
    (design, sigma, observed, _), rows, found, _, _ = solved
    plain, reliable, posterior = ([], [], [])
    delta = pl_mc.statistics.noncentral_shift(1e-3, 0.8)
    for lane in range(LANES):
        problem_of_lane = (design, sigma, observed[:, lane], rows, 1e-3)
        used, local, whole = oracle.w_test(*problem_of_lane, 1, 1 / 15000)
        plain.append((used.error, oracle.sigma_levels(used.covariance, 6.18, 5.33), local or whole))
        used, local, _ = oracle.w_test(*problem_of_lane, 3, 1 / 15000)
        levels = np.array(oracle.slopes(design, sigma, used.rows)) * delta
        reliable.append((used.error, levels, local))
        used, _, whole = oracle.w_test(*problem_of_lane, 2, P_FA)
        m = np.sqrt(used.square_sum / used.dof)
        posterior.append((used.error, oracle.sigma_levels(used.covariance, 6.18 * m, 5.33 * m), whole))
    assert_each(found[WTest()], plain)
    assert_each(found[WTest(exclusions=3, form="reliability", final="local")], reliable)
    assert_each(found[WTest(exclusions=2, variance="posterior", final="global", p_fa=P_FA)], posterior)


@pytest.mark.parametrize("base", ["minimal", "others"])
def test_range_comparison(solved, base):
    """The base, its predictions and their covariance are solved anew for every comparison."""
    (design, sigma, observed, _), rows, found, _, _ = solved
    expected = []
    for lane in range(LANES):
        rejects, *levels = oracle.range_comparison(design, sigma, observed[:, lane], rows, P_FA, P_MD, base)
        error = oracle.fit(design, sigma, observed[:, lane], rows).error
        expected.append((error, levels, rejects))
    assert_each(found[RangeComparison(**RISKS, base=base)], expected)


def test_nioraim(solved):
    """At least the smallest slope that linear programming finds, 3 % above it at the most, and never above that of
    least squares."""
    (design, sigma, *_), rows, found, _, _ = solved
    plain, of = found[Slope(**RISKS)], found[Nioraim(**RISKS, iterations=60)]
    if not plain.available.all():
        assert not of.available.any()
        return
    dof = oracle.fit(design, sigma, np.zeros(10), rows).dof
    least = oracle.least_slope(design, sigma, rows, 2) * oracle.size("noncentral", dof, P_FA, P_MD)
    assert np.all(of.vpl_m >= least * (1 - TOLERANCE))
    assert np.all(of.vpl_m <= np.minimum(plain.vpl_m * (1 + TOLERANCE), 1.03 * least))
    horizontal = found[Nioraim(**RISKS, iterations=60, target="horizontal")]
    assert np.all(horizontal.hpl_m <= plain.hpl_m * (1 + TOLERANCE))
    np.testing.assert_array_equal(of.rejects, plain.rejects)


def test_sbas(solved):
    (design, sigma, observed, _), rows, found, _, _ = solved
    fits = each_fit(design, sigma, observed, rows)
    levels = oracle.sigma_levels(fits[0].covariance, 6.0, 5.33)
    assert_each(found[Sbas()], [(f.error, levels, False) for f in fits])


@given(seed=st.integers(100, 10_000), scale=st.sampled_from([0.1, 3.0]), shift=st.floats(-1e3, 1e3))
@example(seed=714, scale=3.0, shift=0.0)
@settings(max_examples=8)
def test_order_scale_and_truth(seed, scale, shift):
    """Satellites in another order: nothing changes. Metres times a factor: everything in metres goes with it.
    A truth that is moved moves the position, and nothing else: every method's position is unbiased."""
    design, sigma, observed, in_view = problem(seed)
    expected, _, _ = outcomes(design, sigma, observed, in_view)
    order = np.random.default_rng(seed).permutation(10)
    shuffled, _, _ = outcomes(design[order], sigma[order], observed[order], in_view[order])
    truth = np.array([shift, -shift, 0.5 * shift, 10.0, -20.0])
    scaled, _, _ = outcomes(design, scale * sigma, scale * observed, in_view)
    moved, _, _ = outcomes(design, sigma, observed + (design @ truth)[:, None], in_view)
    for of in FAMILY:
        for other, factor, offset in ((shuffled, 1, 0), (scaled, scale, 0), (moved, 1, truth[:3, None])):
            found, known = other[of], expected[of]
            np.testing.assert_array_equal(found.available, known.available)
            np.testing.assert_array_equal(found.rejects, known.rejects)
            # An effect of a metre is found to 1e-12 or so of the 1e3 m that the truth was moved by.
            # Without a satellite a sky may hardly determine a position: rounding grows as the square of its DOP, of
            # which these levels are ten and more.
            for name in ("vpl_m", "hpl_m"):
                level, other_level = getattr(known, name), getattr(found, name) / factor
                finite = np.isfinite(level)
                np.testing.assert_array_equal(finite, np.isfinite(other_level))
                level, other_level = level[finite], other_level[finite]
                assert np.all(np.abs(other_level / level - 1) <= 1e-7 + 1e-15 * level**2), (of.name, name)
            np.testing.assert_allclose(found.error_m, factor * known.error_m + offset, rtol=1e-7, atol=1e-7)


def test_thresholds_of_the_literature():
    """Normalised thresholds sqrt(T) after Brown & Chin (1994) for p_fa 1/15000 and 3.3333e-7, as tabulated by LL
    Consulting (l3nav.com, gps_example_11). The tables were found by iteration: they keep p_fa to 0.2 %."""
    for p_fa, known in (
        (1 / 15000, [3.98792, 4.38539, 4.68560, 4.93879, 5.16259, 5.36564, 5.55301, 5.72792, 5.89265, 6.04884]),
        (3.3333e-7, [5.10383, 5.46152, 5.73854, 5.97522, 6.18628, 6.37900, 6.55774, 6.72514, 6.88354, 7.03383]),
    ):
        dof = np.arange(1, 11)
        np.testing.assert_allclose(stats.chi2.sf(np.square(known), dof), p_fa, rtol=2e-3)
        np.testing.assert_allclose(np.sqrt(thresholds(10, p_fa))[1:], known, rtol=6e-5)


@pytest.mark.parametrize(("p_fa", "p_md"), [(1 / 15000, 1e-3), (1e-7, 1e-4), (0.05, 0.2)])
def test_the_order_of_the_forms(p_fa, p_md):
    """noncentral <= line, equal for one degree of freedom but for the far side of the test; and what both mean."""
    arp, noncentral, line = (protected_sizes(30, p_fa, p_md, form)[1:] for form in ("arp", "noncentral", "line"))
    np.testing.assert_allclose(line - arp, stats.norm.isf(p_md), rtol=1e-9)
    assert np.all(noncentral <= line * (1 + 1e-12))
    np.testing.assert_allclose(noncentral[0], line[0], rtol=1e-3)
    dof = np.arange(1, 31)
    missed, _ = split_at_threshold(thresholds(30, p_fa)[1:], dof, noncentral**2)
    np.testing.assert_allclose(missed, p_md, rtol=1e-8)


def test_a_fault_beyond_the_level_is_missed_with_p_md_at_the_most():
    """Exact, for every satellite of Appendix D and biases that reach far beyond every level.

    ``noncentral``: where the mean error passes the level, the test misses less than p_md; for the worst satellite
    just that at the level. ``noncentral_noise``: error beyond the level and no detection, whatever the bias.
    """
    g = appendix_d(noise=1.5)
    quantities = ls_quantities(g)
    dof = int(quantities.dof)
    threshold = thresholds(10, P_FA)[dof]
    found, _, _ = outcomes(np.asarray(g.design), np.asarray(g.sigma_m), np.zeros((10, LANES)))
    level, wide = (found[Slope(**RISKS, form=form)].vpl_m[0] for form in ("noncentral", "noncentral_noise"))
    spread, at_level = float(quantities.vdop_m), []
    for gain, redundancy, sigma in zip(quantities.gain, quantities.redundancy, g.sigma_m, strict=True):
        bias = np.append(np.linspace(0.0, 3.0, 300) * level, level) / abs(gain)
        mean = bias * abs(gain)
        missed, _ = split_at_threshold(threshold, dof, (bias / sigma) ** 2 * redundancy)
        beyond = mean >= level * (1 - 1e-12)
        assert np.all(missed[beyond] <= P_MD * (1 + 1e-6))
        at_level.append(missed[-1])
        far = stats.norm.sf((wide - mean) / spread) + stats.norm.sf((wide + mean) / spread)
        assert np.all(far * missed <= P_MD)
    np.testing.assert_allclose(max(at_level), P_MD, rtol=1e-6)
    assert noise_factors(P_MD)[1] == pytest.approx(stats.norm.isf(P_MD / 2))


SILENT = 1000.0


@pytest.fixture(scope="module")
def rates():
    """Appendix D with noise, 4000 draws: without a fault, and with two on G03; the limit is beyond every level."""
    g = appendix_d()
    faults = pl_mc.ramp(g, satellite="G03", start_m=0.0, stop_m=8.0, step_m=4.0)
    methods = (
        Slope(p_fa=0.02),
        Parity(p_fa=0.02),
        RangeComparison(p_fa=0.02),
        RangeComparison(p_fa=0.02, base="others"),
        LeaveOneOut(p_fa=0.02),
        WTest(exclusions=0, final="global", p_fa=0.02),
    )
    with jax.numpy_dtype_promotion("standard"):
        table = pl_mc.sweep(
            g, faults, draws=4000, seed=11, methods=methods, workers=1,
            alert=pl_mc.AlertLimits("silent", horizontal_m=40.0, vertical_m=SILENT),
        )  # fmt: skip
    return g, faults, [table[table["method"] == of.name] for of in methods]


def test_false_alarms_and_detections_have_the_exact_rates(rates):
    """Three rates of three chi-square tests, at a family-wise level of 1e-6."""
    g, faults, (slope, parity, *_, global_test) = rates
    exact = pl_mc.exact.ls_rates(g, faults, alarm="chi2", p_fa=0.02)["alarm_rate"]
    assert exact[0] == pytest.approx(0.02)
    for rows in (slope, parity, global_test):
        assert binomial_p_value(rows["alarms"], rows["draws"], exact).min() > 1e-6 / 9
    # One test under two names, on the same draws.
    np.testing.assert_array_equal(slope["alarms"], parity["alarms"])


def test_false_alarms_of_range_comparison(rates):
    """Five comparisons with a base: their exact joint probability, by integration to 1e-5, and below p_fa. Ten with
    all others are dependent, so between that of one of them and Bonferroni's bound."""
    g = rates[0]
    prepared = jax.jit(lambda *of: RangeComparison(p_fa=0.02).prepare(linear_model(*of)))(g.design, g.sigma_m)
    rows = np.asarray(prepared.comparisons)[:5]
    limit = np.full(5, float(prepared.threshold))
    inside = stats.multivariate_normal.cdf(
        limit, cov=rows @ rows.T, lower_limit=-limit, abseps=1e-6, rng=np.random.default_rng(1)
    )
    assert 0.02 / 5 < 1 - inside < 0.02
    minimal, others = (table.iloc[0] for table in rates[2][2:4])
    assert binomial_p_value(minimal["alarms"], minimal["draws"], 1 - inside) > 1e-6
    assert stats.binom.sf(others["alarms"] - 1, others["draws"], 0.02) > 1e-6
    assert stats.binom.cdf(others["alarms"], others["draws"], 0.02 / 10) > 1e-6


def test_exclusion_alarms_less_than_detection(rates):
    _, _, (slope, _, _, _, excluding, _) = rates
    assert np.all(excluding["alarms"].to_numpy() <= slope["alarms"].to_numpy())
    assert excluding["alarms"].iloc[2] < 0.5 * slope["alarms"].iloc[2]


def test_with_one_redundancy_nothing_is_excluded():
    """All satellites are suspected alike: the alarm stays, and so do all satellites. One comparison is left, whose
    false alarms have the exact rate: all tests are one."""
    g = appendix_d()
    design, sigma = np.asarray(g.design), np.asarray(g.sigma_m)
    in_view = np.isin(np.arange(10), [0, 1, 2, 3, 5, 6])
    observed = sigma[:, None] * np.random.default_rng(5).standard_normal((10, LANES))
    observed[3, LANES // 2 :] += 200.0
    found, _, _ = outcomes(design, sigma, observed, in_view)
    plain = found[Slope(**RISKS)]
    assert plain.rejects[LANES // 2 :].all()
    excluding = (LeaveOneOut(**RISKS), Parity(**RISKS, form="noncentral", exclude=True))
    for of in (*excluding, RangeComparison(**RISKS), RangeComparison(**RISKS, base="others")):
        same = found[of].rejects == plain.rejects
        # Six comparisons of one and the same thing, at a sixth of the probability each.
        assert same[LANES // 2 :].all() if of == RangeComparison(**RISKS, base="others") else same.all()
        np.testing.assert_allclose(found[of].error_m, plain.error_m, atol=1e-6)
    snooping = found[WTest(exclusions=3, form="reliability", final="local")]
    np.testing.assert_allclose(snooping.error_m, plain.error_m, atol=1e-6)
    np.testing.assert_array_equal(snooping.rejects, plain.rejects)


def test_a_satellite_that_nothing_checks_leaves_no_level():
    """Six satellites of one system; five of them have lines of sight in a plane, so that the height is the sixth's
    alone: whatever its error, no residual shows it."""
    rng = np.random.default_rng(8)
    design, sigma, _ = random_sky(rng, counts=(6, 4))
    design[:5, 2] = design[:5, 0] * 0.3 + 0.2 * design[:5, 1]
    observed = sigma[:, None] * rng.standard_normal((10, LANES))
    found, _, _ = outcomes(design, sigma, observed, np.isin(np.arange(10), [0, 1, 2, 3, 4, 5]))
    for of in FAMILY:
        if isinstance(of, Sbas | WTest) or "sigma" in of.name:
            continue
        assert not found[of].available.any(), of.name
        assert np.isinf(found[of].vpl_m).all()
        assert not found[of].rejects.any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: method("slope", form="apr"), "slope: form: 'apr' is unknown .nearest: arp"),
        (lambda: method("slope", p_fa=0.0), "slope: p_fa: a number between 0 and 1 is needed, not 0.0"),
        (lambda: method("slope", p_fa=0.6, p_md=0.5), "slope: p_md: it lies below 1 - p_fa"),
        (lambda: method("max_dop", form="sub"), "max_dop: form: 'sub' is unknown .nearest: subset"),
        (lambda: method("max_dop", k_vertical=-1.0), "max_dop: k_vertical: a positive number"),
        (lambda: method("parity", exclude=1), "parity: exclude: true or false is needed, not 1"),
        (lambda: method("parity", form="lines"), "parity: form: 'lines' is unknown .nearest: line"),
        (lambda: method("w_test", exclusions=9), "w_test: exclusions: a whole number from 0 to 8"),
        (lambda: method("w_test", power=1e-4), "w_test: power: it lies above alpha"),
        (lambda: method("w_test", final="locl"), "w_test: final: 'locl' is unknown .nearest: local"),
        (lambda: method("w_test", variance="prior"), "w_test: variance: 'prior' is unknown"),
        (lambda: method("w_test", form="line"), "w_test: form: 'line' is unknown"),
        (lambda: method("leave_one_out", form="sgma"), "leave_one_out: form: 'sgma' is unknown .nearest: sigma"),
        (lambda: method("leave_one_out", p_md="x"), "leave_one_out: p_md: a finite number"),
        (lambda: method("range_comparison", base="other"), "range_comparison: base: 'other' is unknown"),
        (lambda: method("nioraim", target="up"), "nioraim: target: 'up' is unknown"),
        (lambda: method("nioraim", iterations=0), "nioraim: iterations: a whole number of at least 1"),
        (lambda: method("sbas", k_horizontal=0.0), "sbas: k_horizontal: a positive number"),
        (lambda: method("sbas", k_up=5.0), "method sbas: the option 'k_up' is unknown"),
    ],
)
def test_options_are_checked(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_noise_beside_a_bias_is_what_the_joint_integral_says():
    """The product of `test_a_fault_beyond_the_level...` is the joint probability, since error and residuals are
    independent: in the limit of a level that hardly depends on V'PV the integral gives the same."""
    joint, _ = joint_exceedance(20.0, 5.0, 9.0, 1e-12, 1.0)
    missed, _ = split_at_threshold(20.0, 5.0, 9.0)
    assert float(joint) == pytest.approx(float(missed))
