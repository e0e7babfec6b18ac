"""What protection levels and fault modes must do in any geometry.

Two computations of the same numbers in another order differ by rounding (1e-16 times the condition of a normal
matrix, up to 1e6) and by what the bisection leaves (2e-10 of a bracket of some metres): 1e-8 is above both.
"""

from __future__ import annotations

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import pl_mc.araim
from pl_mc.araim import LPV_200, fault_modes
from reference.problems import random_sky

TOLERANCE = 1e-8
P_CONST = {"G": 1e-8, "C": 1e-4, "E": 1e-5}

# One shape of the compiled function for all: rows, unknowns.
ROWS, UNKNOWNS = 14, 6


def levels(design, variance, systems, *, share=0.6, bias=0.5, p_sat=1e-5, **options):
    """Levels of a geometry in the first of fourteen rows, six unknowns."""
    n, t = design.shape
    wide = np.full((ROWS, UNKNOWNS), np.nan)
    wide[:n] = np.pad(design, ((0, 0), (0, UNKNOWNS - t)))
    padded = [np.pad(np.broadcast_to(v, n), (0, ROWS - n), constant_values=np.nan) for v in (variance, bias, p_sat)]
    letters = [*systems, *"?" * (ROWS - n)]
    return pl_mc.araim.protection_levels(
        wide, padded[0], share * padded[0], letters, padded[1], padded[2], P_CONST,
        in_view=np.arange(ROWS) < n, **options,
    )  # fmt: skip


def assert_same(found, expected, *, scale=1.0):
    for name in ("vpl_m", "hpl_m", "emt_m", "sigma_v_acc_m"):
        np.testing.assert_allclose(getattr(found, name), scale * getattr(expected, name), rtol=TOLERANCE)
    np.testing.assert_allclose(found.p_not_monitored, expected.p_not_monitored, rtol=1e-6)


@given(seed=st.integers(0, 2**32 - 1), counts=st.sampled_from([(6, 5), (5, 5), (10,), (9, 1)]))
@settings(max_examples=15)
def test_invariance(seed, counts):
    """The order of satellites, padding, and a scale of all lengths."""
    rng = np.random.default_rng(seed)
    design, sigma, systems = random_sky(rng, counts=counts)
    base = levels(design, sigma**2, systems)
    order = rng.permutation(len(systems))
    assert_same(levels(design[order], sigma[order] ** 2, [systems[i] for i in order]), base)
    assert_same(levels(design, 9 * sigma**2, systems, bias=1.5), base, scale=3.0)
    assert base.available == np.isfinite(base.vpl_m) == np.isfinite(base.hpl_m)
    assert base.hpl_m == pytest.approx(np.hypot(base.hpl_east_m, base.hpl_north_m))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_more_nominal_bias_and_less_accuracy_raise_the_levels(seed):
    design, sigma, systems = random_sky(np.random.default_rng(seed), counts=(6, 5))
    base = levels(design, sigma**2, systems)
    if not base.available:
        return
    for worse in (levels(design, sigma**2, systems, bias=1.0), levels(design, sigma**2, systems, share=1.0)):
        assert worse.vpl_m > base.vpl_m
        assert worse.hpl_m > base.hpl_m


@given(
    counts=st.lists(st.integers(0, 12), min_size=1, max_size=3),
    p_sat=st.sampled_from([1e-8, 1e-5, 1e-4]),
    p_const=st.lists(st.sampled_from([0.0, 1e-8, 1e-4, 1e-3]), min_size=3, max_size=3),
    unmonitored=st.sampled_from(["plain", "contained"]),
)
def test_priors_add_up(counts, p_sat, p_const, unmonitored):
    """No fault, the modes and what is not monitored are all there is; P_THRES is met where it can be."""
    letters = [letter for letter, count in zip("GCE", counts, strict=False) for _ in range(count)]
    clocks = np.array([[a == b for b in "GCE"] for a in letters], dtype=bool).reshape(len(letters), 3)
    modes = fault_modes(
        letters, clocks, np.full(len(letters), p_sat), dict(zip("GCE", p_const, strict=True)), LPV_200, unmonitored
    )
    total = modes.p_no_fault + modes.probability.sum() + modes.p_not_monitored
    assert total == pytest.approx(1.0, abs=1e-14)
    assert (modes.probability > 0).all()
    left = clocks[None] & ~modes.excluded[..., None]
    kept, unknowns = left.any(axis=2).sum(axis=1), 3 + left.any(axis=1).sum(axis=1)
    assert (kept >= unknowns).all()
    # Without two constellations there are still enough satellites: the rule reaches its aim.
    fewest = len(letters) - sum(sorted(counts)[-2:]) - 2
    if fewest >= 3 + sum(count > 0 for count in counts):
        assert modes.p_not_monitored <= LPV_200.p_threshold


def test_the_risk_equation_holds_at_the_level():
    """One satellite mode after the other, by hand: the vertical risk at VPL is the allowed one."""
    design, sigma, systems = random_sky(np.random.default_rng(5), counts=(11,))
    found = levels(design, sigma**2, systems, share=1.0, bias=0.0)
    assert (found.excluded.sum(axis=1) == 1).all()

    def variance(keep):
        rows = design[keep] / sigma[keep, None]
        return np.linalg.inv(rows.T @ rows)[2, 2]

    everyone = np.ones(11, dtype=bool)
    risk = 2 * stats.norm.sf(found.vpl_m / np.sqrt(variance(everyone)))
    for excluded, p, threshold in zip(found.excluded, found.probability, found.threshold_m[:, 2], strict=True):
        without = variance(everyone & ~excluded[:11])
        # With weights of the accuracy model the separation's variance is a difference of variances.
        assert threshold == pytest.approx(stats.norm.isf(3.9e-6 / 22) * np.sqrt(without - variance(everyone)), rel=1e-7)
        risk += p * stats.norm.sf((found.vpl_m - threshold) / np.sqrt(without))
    assert risk == pytest.approx(9.8e-8 * (1 - found.p_not_monitored / 1e-7), rel=1e-6)


def test_a_lone_satellite_counts_for_nothing():
    design, sigma, systems = random_sky(np.random.default_rng(12), counts=(9, 1))
    with_it = levels(design, sigma**2, systems)
    assert_same(with_it, levels(design[:9, :4], sigma[:9] ** 2, systems[:9]))
    assert not with_it.excluded[:, 9].any()


def test_a_constellation_that_the_position_needs():
    """A lone constellation with probable faults has no level; with improbable ones it has."""
    design, sigma, _ = random_sky(np.random.default_rng(3), counts=(10,))
    beidou = levels(design, sigma**2, "C" * 10)
    assert not beidou.available
    assert np.isinf([beidou.vpl_m, beidou.hpl_m, beidou.emt_m]).all()
    assert beidou.sigma_v_acc_m < np.inf
    assert beidou.p_not_monitored == pytest.approx(1e-4, rel=1e-2)
    gps = levels(design, sigma**2, "G" * 10)
    assert gps.available
    # P_const, and pairs of satellites: 45 x 1e-10.
    assert gps.p_not_monitored == pytest.approx(1e-8 + 4.5e-9, rel=1e-3)


@pytest.mark.parametrize("n", [0, 3, 4, 5])
def test_too_few_satellites(n):
    design, sigma, _ = random_sky(np.random.default_rng(3), counts=(10,))
    found = levels(design[:n], sigma[:n] ** 2, "G" * n)
    assert not any(np.isnan(np.asarray(getattr(found, name))).any() for name in ("vpl_m", "hpl_m", "emt_m"))
    assert found.available == (n == 5)
    assert np.isinf(found.vpl_m) == (n < 5)
    assert np.isinf(found.sigma_v_acc_m) == (n < 4)


def test_the_precision_is_double_whatever_the_configuration():
    design, sigma, systems = random_sky(np.random.default_rng(8), counts=(6, 5))
    base = levels(design, sigma**2, systems)
    with jax.enable_x64(False):
        single = levels(design, sigma**2, systems)
    assert single.vpl_m.dtype == np.float64
    assert single.vpl_m == base.vpl_m


def test_covariances_as_matrices():
    """One geometry and a batch of one, variances as vectors and as diagonal matrices."""
    design, sigma, systems = random_sky(np.random.default_rng(8), counts=(6, 4, 4))
    given = (0.5, 1e-5, P_CONST)
    c_int, c_acc = sigma**2, 0.6 * sigma**2
    vector = pl_mc.araim.protection_levels(design, c_int, c_acc, systems, *given)
    matrix = pl_mc.araim.protection_levels(design, np.diag(c_int), np.diag(c_acc), systems, *given)
    batch = pl_mc.araim.protection_levels(design[None], np.diag(c_int)[None], c_acc[None], [list(systems)], *given)
    assert np.isfinite(vector.vpl_m)
    assert matrix.vpl_m == vector.vpl_m == batch.vpl_m[0]
