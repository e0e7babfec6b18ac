"""The mean check against a plain NumPy fit for every satellite, the trap it is built on, and its thresholds."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from pl_mc import InputError
from pl_mc.detectors import MeanCheck, View, satterthwaite
from pl_mc.detectors.base import SYSTEM_LETTERS
from pl_mc.kernels import linear_model, start_from
from reference.mean_check_numpy import mean_check

READINGS = (
    ("shift_kept", "of_reading", True),
    ("shared_clock", "of_reading", False),
    ("shared_clock", "kept", True),
    ("separate_fits", "of_reading", True),
    ("weighted", "of_reading", False),
)
LANES = 40


@functools.partial(jax.jit, static_argnames=("test", "p_fa"))
def examine(test, design, sigma_m, observed_m, system, in_view, p_fa=0.01):
    model = linear_model(design, sigma_m, in_view)
    return test.examine(model, test.prepare(model, system, p_fa), start_from(model, observed_m))


def sky(seed: int, *, gps: int = 7, bds: int = 9, equal: bool = False):
    """Design, sigma, letters and observations (n, LANES), half of the lanes with 30 m on one satellite."""
    rng = np.random.default_rng(seed)
    systems = "G" * gps + "C" * bds
    n = gps + bds
    elevation, azimuth = rng.uniform(0.2, 1.5, n), rng.uniform(0, 2 * np.pi, n)
    sight = np.stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
    clocks = np.array([[s == "G", s == "C"] for s in systems], dtype=float)
    sigma = np.where(clocks[:, 0] > 0, np.sqrt(2.5), np.sqrt(4.5)) if equal else rng.uniform(1.0, 3.0, n)
    observed = sigma[:, None] * rng.standard_normal((n, LANES))
    observed[rng.integers(0, n, LANES // 2), np.arange(LANES // 2)] += 30.0
    return np.hstack([-sight.T, clocks]), sigma, systems, observed


def places(systems: str) -> np.ndarray:
    return np.array([SYSTEM_LETTERS.index(s) for s in systems], dtype=np.int32)


def verdict(test, design, sigma, systems, observed):
    return examine(test, design, sigma, observed, places(systems), np.ones(len(systems), bool))


@pytest.mark.parametrize(("reading", "shift", "keep"), READINGS)
@pytest.mark.parametrize("seed", [1, 2])
def test_kernel_is_the_plain_fit_of_every_satellite(reading: str, shift: str, keep: bool, seed: int) -> None:
    design, sigma, systems, observed = sky(seed)
    found = verdict(MeanCheck(reading=reading, shift=shift), design, sigma, systems, observed)
    for lane in range(LANES):
        statistic, place, error = mean_check(design, sigma, observed[:, lane], systems, reading=reading, keep=keep)
        assert found.statistic[lane] == pytest.approx(statistic, rel=1e-10)
        assert found.satellite[lane] == place
        assert found.error_m[lane] == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize("seed", [3, 4])
def test_the_trap_with_a_clock_for_each_system_the_weighted_mean_residual_is_zero(seed: int) -> None:
    """Whatever the errors: so T of the mean-shift residuals themselves is zero where weights are equal."""
    design, sigma, systems, observed = sky(seed, equal=True)
    weight = 1 / sigma[:, None] ** 2
    state = np.linalg.solve(design.T @ (weight * design), design.T @ (weight * observed))
    residual = design @ state - observed
    for letter in "GC":
        rows = np.array(list(systems)) == letter
        np.testing.assert_allclose((weight * residual)[rows].mean(axis=0), 0.0, atol=1e-13)
        np.testing.assert_allclose(residual[rows].mean(axis=0), 0.0, atol=1e-12)
    found = verdict(MeanCheck(reading="weighted"), design, sigma, systems, observed)
    # Exactly zero, not a rounding error that a calibration could take for a statistic.
    np.testing.assert_array_equal(found.statistic, 0.0)
    assert not np.any(found.decision)


def test_with_equal_weights_the_default_is_one_estimated_shift_over_the_size_of_its_system() -> None:
    design, sigma, systems, observed = sky(5, equal=True)
    found = verdict(MeanCheck(), design, sigma, systems, observed)
    root = np.sqrt(2.5 / 7 + 4.5 / 9)
    whitened = design / sigma[:, None]
    residual = (
        observed / sigma[:, None] - whitened @ np.linalg.lstsq(whitened, observed / sigma[:, None], rcond=None)[0]
    )
    redundancy = 1 - np.einsum("ij,ji->i", whitened, np.linalg.pinv(whitened))
    shift = sigma[:, None] * residual / redundancy[:, None]
    size = np.array([7 if s == "G" else 9 for s in systems])
    np.testing.assert_allclose(found.statistic, (np.abs(shift) / size[:, None]).max(axis=0) / root, rtol=1e-12)


def test_weights_that_differ_inside_a_system_make_the_removed_shift_tell_something() -> None:
    found = verdict(MeanCheck(reading="weighted"), *sky(6))
    assert np.all(np.asarray(found.statistic) > 1e-3)


@pytest.mark.parametrize("test", [MeanCheck(), MeanCheck("shared_clock"), MeanCheck("separate_fits")])
def test_padding_and_order_change_nothing(test: MeanCheck) -> None:
    design, sigma, systems, observed = sky(7)
    expected = verdict(test, design, sigma, systems, observed)
    n, rng = len(systems), np.random.default_rng(0)
    place = rng.permutation(n + 5)[:n]
    wide, spread, seen = np.full((n + 5, 6), np.nan), np.full(n + 5, np.nan), np.zeros(n + 5, bool)
    # A sixth column: the clock of a system that no satellite in view has.
    wide[place], spread[place], seen[place] = np.hstack([design, np.zeros((n, 1))]), sigma, True
    system, given = np.full(n + 5, -1, np.int32), np.zeros((n + 5, LANES))
    system[place], given[place] = places(systems), observed
    found = examine(test, wide, spread, given, system, seen)
    # An order of sums: rounding, times the condition of the normal equations.
    np.testing.assert_allclose(found.statistic, expected.statistic, rtol=1e-10)
    np.testing.assert_allclose(found.error_m, expected.error_m, rtol=1e-10)
    np.testing.assert_array_equal(found.satellite, place[np.asarray(expected.satellite)])
    assert found.threshold == expected.threshold


def test_satterthwaite_of_the_published_examples() -> None:
    """SciPy's check against R: (1, 2, 3) and (1, 2, 3, 4) against (1.1, 2.9, 4.2)."""
    other = np.array([1.1, 2.9, 4.2])
    for values, t, dof in (
        ([1.0, 2.0, 3.0], -0.68649512735572582, 3.4104431643463764),
        ([1.0, 2.0, 3.0, 4.0], -0.2108663315950719, 3.9030852720403546),
    ):
        first, second = np.var(values, ddof=1), np.var(other, ddof=1)
        assert satterthwaite(first, second, len(values), 3) == pytest.approx(dof, rel=1e-14)
        difference = (np.mean(values) - other.mean()) / np.sqrt(first / len(values) + second / 3)
        assert difference == pytest.approx(t, rel=1e-13)


def test_thresholds_are_student_quantiles() -> None:
    design, sigma, systems, observed = sky(8)
    dof = (2.5 / 7 + 4.5 / 9) ** 2 / ((2.5 / 7) ** 2 / 6 + (4.5 / 9) ** 2 / 8)
    for one_sided, tail in ((False, 0.005), (True, 0.01)):
        found = verdict(MeanCheck(one_sided=one_sided), design, sigma, systems, observed)
        assert found.threshold == pytest.approx(stats.t.isf(tail, dof), rel=1e-12)
        np.testing.assert_array_equal(found.decision, np.asarray(found.statistic) > float(found.threshold))


def test_types_are_kept() -> None:
    design, sigma, systems, observed = sky(9)
    for test in (MeanCheck("shared_clock"),):
        found = verdict(test, design.astype(np.float32), sigma.astype(np.float32), systems, observed.astype(np.float32))
        assert found.statistic.dtype == found.error_m.dtype == found.threshold.dtype == jnp.float32
        assert np.all(np.isfinite(found.statistic))


@pytest.mark.parametrize(
    ("counts", "dof", "reading", "words"),
    [
        ({"G": 7}, 3, "shift_kept", "BeiDou has no satellite in view to compare GPS with"),
        ({"C": 7, "E": 5}, 3, "shift_kept", "GPS has no satellite"),
        ({"G": 7, "C": 1}, 3, "shift_kept", "BeiDou has a single satellite"),
        ({"G": 3, "C": 2}, 0, "shift_kept", "n = t"),
        ({"G": 4, "C": 9}, 8, "separate_fits", "GPS has 4 satellites"),
    ],
)
def test_reasons_against(counts: dict[str, int], dof: int, reading: str, words: str) -> None:
    reason = MeanCheck(reading).reason_against(View(counts, dof, determined=True))
    assert reason is not None
    assert words in reason
    assert MeanCheck(reading).reason_against(View({"G": 5, "C": 5}, 5, determined=True)) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reading": "shift"}, "mean_check.reading: 'shift' is unknown .nearest: shift_kept"),
        ({"shift": "lost"}, "mean_check.shift"),
        ({"one_sided": 1}, "one_sided: true or false"),
        ({"systems": ("G", "G")}, "two different systems"),
        ({"systems": ("G", "X")}, "'X' is unknown"),
        ({"variances_m2": (2.5, 0.0)}, "two variances over zero"),
    ],
)
def test_bad_options_are_refused(options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        MeanCheck(**options)
