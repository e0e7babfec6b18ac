"""Noncentral chi-square tails and joint tails against closed forms, other computations and 25-digit arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, special, stats

from pl_mc.input_errors import InputError
from pl_mc.statistics import fault_free_exceeded, joint_exceedance, split_at_threshold

# Threshold, dof, noncentrality, shift; probability below and above the threshold, with slope 5.33 / sqrt(dof).
# Integrated with mpmath at 25 digits over the density written with its Bessel function, panel by panel.
HIGH_PRECISION = (
    (20, 1, 0, 0, 0.11806828343800728, 3.838720437881076e-132),
    (9, 1, 1, 3, 0.2715309614042455, 5.236903057751802e-42),
    (100, 2, 60, -20, 0.007508303597506167, 1.3212786417051888e-73),
    (40, 5, 60, 3, 7.774768202302211e-11, 2.455889559233128e-36),
    (40, 5, 60, 25, 0.04384350213581613, 0.9459958640137706),
    (100, 15, 0, 0, 8.411972337552067e-05, 1.7706611376985372e-57),
    (3, 15, 100, 8, 5.829495955963506e-23, 2.6825783739392485e-05),
    (60, 30, 20, 5, 0.07659701968969856, 0.0004158253341648097),
    (40400, 15, 40000, 270, 0.0009393641750304392, 4.496469557857724e-13),
    (39000, 15, 40000, 275, 0.005368741714993527, 0.4273675239086204),
    (39000, 1, 40000, 1035, 5.440351837132046e-09, 2.6634277071613295e-73),
    (0.001, 4, 9, 1, 1.3438759912261272e-09, 0.00039186896422682205),
)


@pytest.mark.parametrize("case", HIGH_PRECISION)
def test_joint_tails_to_eleven_digits(case: tuple[float, ...]) -> None:
    threshold, dof, noncentrality, shift, below, above = case
    got = joint_exceedance(threshold, dof, noncentrality, 5.33 / np.sqrt(dof), shift)
    np.testing.assert_allclose(got, (below, above), rtol=1e-11)


@pytest.mark.parametrize(
    ("threshold", "dof", "below", "above"),
    [
        (1e5, 1, 4.335668616701536e-08, 0.0),
        (1e5, 6, 2.244168937469781e-08, 0.0),
        (350.0, 6, 2.244168933779478e-08, 3.6903025713792e-17),
    ],
)
def test_a_steep_level_within_a_wide_density(threshold: float, dof: int, below: float, above: float) -> None:
    """A level 85 times sqrt(Y), which the error crosses within a hundredth of the density's width; from mpmath."""
    got = joint_exceedance(threshold, dof, 576.0, 85.0, 1585.0)
    np.testing.assert_allclose(got, (below, above), rtol=1e-11, atol=1e-300)


def test_one_degree_of_freedom_is_two_normal_tails() -> None:
    """Y = (Z + a)^2, so both sides are known in every tail, at noncentralities up to 1e8."""
    offset = np.array([0.0, 1e-9, 1e-3, 0.7, 3.0, 200.0, 1e4])[:, None]
    root = np.maximum(offset + np.array([-35.0, -20.0, -8.0, -1.0, 0.0, 1.0, 8.0, 20.0, 35.0]), 0.25)
    below, above = split_at_threshold(root**2, 1, offset**2)
    np.testing.assert_allclose(above, special.ndtr(offset - root) + special.ndtr(-offset - root), rtol=1e-10)
    # The difference of two lower tails is exact enough where the two are not close to each other.
    far = offset > 1
    expected = (special.ndtr(root - offset) - special.ndtr(-root - offset))[far[:, 0]]
    np.testing.assert_allclose(below[far[:, 0]], expected, rtol=1e-10)
    np.testing.assert_allclose(below[~far[:, 0]], 1 - above[~far[:, 0]], rtol=1e-12)


@pytest.mark.parametrize("dof", [1, 2, 3, 10, 45])
def test_central_tails_are_incomplete_gamma_functions(dof: int) -> None:
    threshold = np.geomspace(1e-8, 1000.0, 30)
    below, above = split_at_threshold(threshold, dof, 0.0)
    np.testing.assert_allclose(below, special.gammainc(dof / 2, threshold / 2), rtol=1e-11)
    np.testing.assert_allclose(above, special.gammaincc(dof / 2, threshold / 2), rtol=1e-11)


@pytest.mark.parametrize("dof", [2, 5, 15, 40])
@pytest.mark.parametrize("noncentrality", [1e-6, 0.5, 30.0, 4e4])
def test_noncentral_tails_are_those_of_scipy_where_scipy_holds(dof: int, noncentrality: float) -> None:
    root = np.sqrt(noncentrality + dof) + np.array([-8.0, -5.0, -2.0, 0.0, 2.0, 5.0, 8.0])
    threshold = root[root > 0] ** 2
    below, above = split_at_threshold(threshold, dof, noncentrality)
    np.testing.assert_allclose(below, stats.ncx2.cdf(threshold, dof, noncentrality), rtol=1e-10)
    np.testing.assert_allclose(above, stats.ncx2.sf(threshold, dof, noncentrality), rtol=1e-10)


def test_tails_at_huge_noncentrality_where_series_do_not_converge() -> None:
    """Y = (Z + a)^2 + central chi-square: a normal integral of gamma functions, at noncentrality 1e8."""
    offset, dof = 1e4, 6
    for reach in (-12.0, -3.0, 4.0, 12.0):
        root = offset + reach
        # sqrt(Y) is about a + Z + chi2 / 2a, so that the average over the central part is a plain one.
        mean, _ = integrate.quad(
            lambda y, root=root: stats.chi2.pdf(y, dof - 1) * special.ndtr(offset - np.sqrt(root**2 - y)), 0, 120,
            points=[1, 3, 6, 12, 30], epsabs=0, epsrel=1e-12, limit=300,
        )  # fmt: skip
        assert split_at_threshold(root**2, dof, offset**2)[1] == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize(
    ("threshold", "dof", "noncentrality", "shift"),
    [
        (40.0, 5, 0.0, 0.0),
        (10.0, 5, 30.0, 4.0),
        (30.0, 2, 30.0, -4.0),
        (38416.0, 4, 4e4, 500.0),
        (41000.0, 4, 4e4, 520.0),
    ],
)
def test_joint_tails_integrated_over_the_error_instead(
    threshold: float, dof: int, noncentrality: float, shift: float
) -> None:
    """The other order of integration: over Z, with the distribution function of Y inside."""
    slope = 5.33 / np.sqrt(dof)
    edge, scale = slope * np.sqrt(threshold), abs(shift)

    def quiet(z: float) -> float:
        limit = min((z + scale) ** 2 / slope**2, threshold)
        return np.exp(-z * z / 2) / np.sqrt(2 * np.pi) * stats.ncx2.cdf(limit, dof, noncentrality)

    inner = sorted(
        p for p in {-8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0, edge - scale, -scale, -edge - scale} if abs(p) < 14
    )
    value, _ = integrate.quad(quiet, -14, 14, points=inner, epsabs=0, epsrel=1e-10, limit=500)
    below, above = joint_exceedance(threshold, dof, noncentrality, slope, shift)
    assert below == pytest.approx(value, rel=1e-8)
    everything, _ = joint_exceedance(np.inf, dof, noncentrality, slope, shift)
    assert below + above == pytest.approx(everything, rel=1e-12)


def test_central_joint_tail_is_student() -> None:
    dof = np.arange(1, 60)
    below, above = joint_exceedance(np.inf, dof, 0.0, 5.33 / np.sqrt(dof), 0.0)
    np.testing.assert_allclose(below, fault_free_exceeded(dof), rtol=1e-11)
    np.testing.assert_array_equal(above, 0.0)
    # The factor that keeps 1e-7 with one degree of freedom is 6.4 million.
    for factor in (1e-3, 40.0, 1e4, 1e7):
        below, _ = joint_exceedance(np.inf, dof, 0.0, factor / np.sqrt(dof), 0.0)
        np.testing.assert_allclose(below, fault_free_exceeded(dof, factor), rtol=1e-11, atol=1e-290)


def test_both_sides_meet_at_any_threshold() -> None:
    threshold = np.geomspace(1e-3, 1e3, 40)
    below, above = joint_exceedance(threshold, 7, 50.0, 2.0, 11.0)
    np.testing.assert_allclose(below + above, joint_exceedance(np.inf, 7, 50.0, 2.0, 11.0)[0], rtol=1e-12)
    # Beyond the bulk the sides change by less than rounding.
    assert (np.diff(below) >= -1e-13 * below[:-1]).all()
    assert (np.diff(above) <= 1e-13 * above[:-1]).all()
    np.testing.assert_array_equal(np.add(*split_at_threshold(threshold, 7, 50.0)), 1.0)


def test_empty_thresholds_and_probabilities_beyond_doubles() -> None:
    np.testing.assert_array_equal(split_at_threshold([0.0, np.inf], 4, 9.0), [[0, 1], [1, 0]])
    np.testing.assert_array_equal(split_at_threshold(1.0, 4, 1e6), (0.0, 1.0))
    np.testing.assert_array_equal(split_at_threshold(1e6, 4, 1.0), (1.0, 0.0))
    assert joint_exceedance(0.0, 4, 9.0, 2.0, 1.0)[0] == 0.0
    assert joint_exceedance(1.0, 4, 1e6, 2.0, 1.0) == (0.0, 0.0)


def test_many_pairs_are_the_same_as_one_by_one() -> None:
    rng = np.random.default_rng(5)
    count = 5000
    arguments = (
        rng.uniform(0, 100, count), rng.integers(1, 20, count), rng.uniform(0, 200, count),
        rng.uniform(1, 5, count), rng.normal(0, 10, count),
    )  # fmt: skip
    together = joint_exceedance(*arguments)
    for k in (0, 1, 4095, 4096, 4999):
        np.testing.assert_allclose(
            [side[k] for side in together], joint_exceedance(*(a[k] for a in arguments)), rtol=1e-12
        )


@pytest.mark.parametrize(
    ("changed", "name"),
    [({"threshold": -1.0}, "threshold"), ({"threshold": np.nan}, "threshold"), ({"dof": 0}, "dof"),
     ({"noncentrality": -1e-9}, "noncentrality"), ({"noncentrality": np.nan}, "noncentrality"),
     ({"slope": 0.0}, "slope"), ({"shift": np.inf}, "shift")],
)  # fmt: skip
def test_arguments_outside_their_range(changed: dict[str, float], name: str) -> None:
    arguments = {"threshold": 3.0, "dof": 2, "noncentrality": 1.0, "slope": 1.0, "shift": 0.0} | changed
    with pytest.raises(InputError, match=name):
        joint_exceedance(**arguments)
