"""The accumulated parity test and the innovation test against exact distributions and plain references."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import pl_mc
from pl_mc.methods.raim_levels import thresholds
from pl_mc.statistics.intervals import binomial_p_value
from pl_mc.time_ramps.filters import CONSTANT_VELOCITY, motion_model
from pl_mc.time_ramps.kalman_innovation import FilterPlan, KalmanInnovation
from pl_mc.time_ramps.passes import PassPlan, Signals, fault_free_signals, pass_plan
from pl_mc.time_ramps.sequential_parity import SequentialParity, residual_maps, summed_covariance
from pl_mc.time_ramps.signals import LANES, NoiseInTime, Rows, pass_key, rows_by_satellite, step_numbers, unit_ramp_m
from pl_mc.time_ramps.windows import WindowTests, largest_ratio

EPOCHS, ONSET, INTERVAL_S, BLOCKS = 40, 20, 20.0, 12
SATELLITE, LIMIT_P = "G11", 1e-2
PARITY = (SequentialParity((0.0,), p_fa=LIMIT_P), SequentialParity((300.0,), p_fa=LIMIT_P))
KALMAN = (KalmanInnovation((0.0,), p_fa=LIMIT_P), KalmanInnovation((200.0,), motion=CONSTANT_VELOCITY, p_fa=LIMIT_P))
# Every statement about a distribution is made at this level.
LEVEL, SIGMAS = 1e-5, 4.5

# Compiled as wholes: operation by operation they would take longer.
RATIO = jax.jit(largest_ratio)
NUMBERS = jax.jit(jax.vmap(step_numbers, in_axes=(None, 0, None, None)), static_argnums=(2, 3))
# Parity tests stand before filters.
FILTERS = slice(len(PARITY), None)
MAKE = jax.jit(lambda plan, seed, purpose, block: fault_free_signals(plan, pass_key(seed, purpose, block)))


def series() -> Rows:
    """GPS and three of BeiDou, of which one rises and one sets inside the windows."""
    g = pl_mc.simulate(
        start="2017-11-21T09:40:00", epochs=EPOCHS, interval_s=INTERVAL_S, constellations=("GPS", "BDS-2")
    )
    rows = rows_by_satellite(g)
    assert g.in_view.sum() == rows.in_view.sum()
    rising, setting, steady = [name for name in rows.names if name.startswith("C")][:3]
    keep = [name for name in rows.names if name.startswith("G") or name in (rising, setting, steady)]
    index = [rows.names.index(name) for name in keep]
    in_view = rows.in_view[:, index].copy()
    in_view[:30, keep.index(rising)] = False
    in_view[35:, keep.index(setting)] = False
    return Rows(
        names=tuple(keep),
        design=np.where(in_view[:, :, None], rows.design[:, index], 0.0),
        sigma_m=np.where(in_view, rows.sigma_m[:, index], 1.0),
        in_view=in_view,
        interval_s=rows.interval_s,
    )


@dataclass(frozen=True)
class Case:
    noise: NoiseInTime
    rows: Rows
    plan: PassPlan
    signals: Signals


@pytest.fixture(scope="module")
def rows() -> Rows:
    return series()


@pytest.fixture(scope="module", params=[(0.0, 0.5), (100.0, 0.7)], ids=["white", "correlated"])
def case(request: pytest.FixtureRequest, rows: Rows) -> Case:
    noise = NoiseInTime(*request.param)
    ramp = unit_ramp_m(rows, SATELLITE, ONSET)
    plan = pass_plan((*PARITY, *KALMAN), rows, noise, ramp, ONSET, 35.0)
    parts = [
        jax.tree.map(np.asarray, MAKE(plan, np.uint32(7), np.uint32(0), np.uint32(block))) for block in range(BLOCKS)
    ]
    return Case(noise, rows, plan, jax.tree.map(lambda *one: np.concatenate(one, axis=-1), *parts))


def statistic(case: Case, tests: WindowTests, sums: np.ndarray, epoch: int, rate: float = 0.0) -> np.ndarray:
    """The ratio at an epoch; with one window it is the statistic over its threshold."""
    one = WindowTests(tests.whitener[epoch - ONSET], tests.response[epoch - ONSET], tests.samples)
    total = [jnp.asarray(sums[epoch] - sums[epoch - w]) for w in tests.samples]
    return np.asarray(RATIO(one, total, jnp.asarray([rate])))[0]


def limit(dof: int, rows: Rows) -> float:
    return float(thresholds(len(rows.names), LIMIT_P)[dof])


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("epoch", [25, EPOCHS - 1])
def test_the_accumulated_parity_statistic_is_chi_square(case: Case, which: int, epoch: int) -> None:
    dof = round(float(np.trace(residual_maps(case.rows)[epoch])))
    found = statistic(case, case.plan.sequential[which].tests, case.signals.sums[which], epoch) * limit(dof, case.rows)
    assert stats.kstest(found, stats.chi2(dof).cdf).pvalue > LEVEL


@pytest.mark.parametrize("which", [0, 1])
def test_its_detection_probability_is_the_noncentral_chi_squares(case: Case, which: int) -> None:
    epoch, rows = EPOCHS - 1, case.rows
    window = case.plan.sequential[which].tests.samples[0]
    maps = residual_maps(rows)
    ramp = unit_ramp_m(rows, SATELLITE, ONSET) / rows.sigma_m
    # Everything anew, by dense matrices: the sum of residuals, its covariance, its pseudoinverse on parity space.
    inside = range(epoch - window + 1, epoch + 1)
    lags = np.subtract.outer(np.arange(window), np.arange(window))
    rho = case.noise.autocorrelation(lags, rows.interval_s)
    stacked = np.hstack([maps[k] for k in inside])
    covariance = stacked @ np.kron(rho, np.eye(len(rows.names))) @ stacked.T
    shift = sum(maps[k] @ ramp[k] for k in inside)
    size, basis = np.linalg.eigh(maps[epoch])
    basis = basis[:, size > 0.5]
    seen = basis.T @ shift
    unit = float(seen @ np.linalg.solve(basis.T @ covariance @ basis, seen))
    dof = basis.shape[1]
    rate = float(np.sqrt(8.0 / unit))
    expected = stats.ncx2.sf(limit(dof, rows), dof, 8.0)
    found = int((statistic(case, case.plan.sequential[which].tests, case.signals.sums[which], epoch, rate) > 1.0).sum())
    assert 0.2 < expected < 0.9
    assert binomial_p_value(found, BLOCKS * LANES, expected) > LEVEL


@pytest.mark.parametrize(("correlation", "share"), [(0.0, 0.5), (0.9, 0.6), (1.0, 0.3), (0.99, 0.0)])
def test_the_covariance_of_a_sum_is_that_of_the_double_sum(rows: Rows, correlation: float, share: float) -> None:
    maps = residual_maps(rows)
    for window in (1, 7, ONSET):
        found = summed_covariance(maps, correlation, share, window, ONSET)
        for epoch in (ONSET, EPOCHS - 1):
            expected = np.zeros_like(maps[0])
            for i in range(epoch - window + 1, epoch + 1):
                for j in range(epoch - window + 1, epoch + 1):
                    rho = 1.0 if i == j else share * correlation ** abs(i - j)
                    expected += rho * maps[i] @ maps[j].T
            np.testing.assert_allclose(found[epoch - ONSET], expected, atol=1e-10 * window**2)


def test_innovations_have_their_covariance_and_no_memory(case: Case) -> None:
    for plan, total in zip(case.plan.sequential[FILTERS], case.signals.sums[FILTERS], strict=True):
        before = None
        for epoch in (26, 27):
            weight = np.asarray(plan.weight)[epoch]
            seen = np.flatnonzero(case.rows.in_view[epoch])
            pulled = (total[epoch] - total[epoch - 1])[seen]
            # b = S^-1 nu has the covariance S^-1.
            root = np.linalg.cholesky(weight[np.ix_(seen, seen)])
            unit = np.linalg.solve(root, pulled)
            assert stats.kstest((unit**2).sum(axis=0), stats.chi2(len(seen)).cdf).pvalue > LEVEL
            if before is not None:
                # Products of independent standard normal numbers have unit variance; 4.5 sigma, 81 of them.
                lagged = unit @ before.T / np.sqrt(unit.shape[1])
                assert np.abs(lagged).max() < SIGMAS + 0.7
            before = unit


@pytest.mark.parametrize("which", [0, 1])
def test_the_innovation_statistic_is_chi_square_and_noncentral(case: Case, which: int) -> None:
    epoch, plan = EPOCHS - 1, case.plan.sequential[FILTERS][which]
    window = plan.tests.samples[0]
    dof = int(case.rows.in_view[epoch - window + 1 : epoch + 1].any(axis=0).sum())
    bound = limit(dof, case.rows)
    found = statistic(case, plan.tests, case.signals.sums[FILTERS][which], epoch) * bound
    assert stats.kstest(found, stats.chi2(dof).cdf).pvalue > LEVEL
    unit = bound * float((np.asarray(plan.tests.response)[epoch - ONSET, 0] ** 2).sum())
    expected = stats.ncx2.sf(bound, dof, 8.0)
    rate = float(np.sqrt(8.0 / unit))
    detected = int((statistic(case, plan.tests, case.signals.sums[FILTERS][which], epoch, rate) > 1.0).sum())
    assert binomial_p_value(detected, BLOCKS * LANES, expected) > LEVEL


def test_errors_have_the_autocorrelation_of_their_model(case: Case, rows: Rows) -> None:
    satellite = rows.names.index(SATELLITE)
    noise = case.signals.noise[:, satellite]
    lanes = noise.shape[1]
    for lag in (0, 1, 3, 10):
        expected = float(case.noise.autocorrelation(lag, INTERVAL_S))
        # Var(x y) = 1 + rho^2 for standard normal x, y.
        found = float(np.mean(noise[12] * noise[12 + lag]))
        assert abs(found - expected) < SIGMAS * np.sqrt((1.0 + expected**2) / lanes)


def numpy_filter(test: KalmanInnovation, case: Case, lane: int, ramp_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """S^-1 nu (T, m) and the vertical error (T,) of one lane, satellite by satellite, with no shared gains.

    States of satellites out of view are left out of the measurement, not masked in it.
    """
    rows, noise = case.rows, case.noise
    ramp = ramp_rate * unit_ramp_m(rows, SATELLITE, ONSET)
    key = pass_key(np.uint32(7), np.uint32(0), np.uint32(0))
    transition, root, start = motion_model(test, rows.design.shape[2], rows.interval_s)
    base, count = len(start), len(rows.names)
    motions = max(plan.base for plan in case.plan.sequential[FILTERS])
    phi = noise.correlation(rows.interval_s)
    f = np.block([[transition, np.zeros((base, count))], [np.zeros((count, base)), phi * np.eye(count)]])
    q = np.zeros_like(f)
    q[:base, :base], q[base:, base:] = root @ root.T, (1.0 - phi**2) * np.eye(count)
    p, x, true = np.diag(np.concatenate([start**2, np.ones(count)])), np.zeros(base + count), np.zeros(base)
    numbers = np.asarray(NUMBERS(key, jnp.arange(EPOCHS, dtype=jnp.int32), count, motions)[2])
    pulled, up = np.zeros((EPOCHS, count)), np.zeros(EPOCHS)
    for k in range(EPOCHS):
        motion = numbers[k, :base, lane]
        true = start * motion if k == 0 else transition @ true + root @ motion
        if k:
            x, p = f @ x, f @ p @ f.T + q
        seen = np.flatnonzero(rows.in_view[k])
        h = np.zeros((len(seen), base + count))
        h[:, : rows.design.shape[2]] = rows.design[k, seen]
        h[np.arange(len(seen)), base + seen] = np.sqrt(noise.share) * rows.sigma_m[k, seen]
        z = case.signals.noise[k, seen, lane] * rows.sigma_m[k, seen] + ramp[k, seen] + h[:, :base] @ true
        s = h @ p @ h.T + np.diag((1.0 - noise.share) * rows.sigma_m[k, seen] ** 2)
        innovation = z - h @ x
        pulled[k, seen] = np.linalg.solve(s, innovation)
        x = x + p @ h.T @ pulled[k, seen]
        p = p - p @ h.T @ np.linalg.solve(s, h @ p)
        up[k] = x[2] - true[2]
    return pulled, up


@pytest.mark.parametrize("which", [0, 1])
def test_the_filter_is_that_of_a_plain_reference(case: Case, which: int) -> None:
    plan: FilterPlan = case.plan.sequential[FILTERS][which]
    lane = 17
    free, up = numpy_filter(KALMAN[which], case, lane, 0.0)
    found = case.signals.sums[FILTERS][which][:, :, lane]
    # Sums over the pass of numbers of size 1 / m; the reference subtracts variances of 1e6 m^2.
    np.testing.assert_allclose(found, np.cumsum(free, axis=0), atol=1e-6)
    np.testing.assert_allclose(case.signals.up_m[FILTERS][which][:, lane], up, atol=1e-6)
    rate = 0.05
    ramped, up_ramped = numpy_filter(KALMAN[which], case, lane, rate)
    np.testing.assert_allclose(up_ramped - up, rate * np.asarray(plan.up_m), atol=1e-6)
    epoch = EPOCHS - 1
    window = plan.tests.samples[0]
    total = ramped[epoch - window + 1 : epoch + 1].sum(axis=0)
    summed = np.asarray(plan.weight)[epoch - window + 1 : epoch + 1].sum(axis=0)
    seen = np.flatnonzero(np.diag(summed))
    expected = total[seen] @ np.linalg.solve(summed[np.ix_(seen, seen)], total[seen])
    ratio = statistic(case, plan.tests, case.signals.sums[FILTERS][which], epoch, rate)[lane]
    np.testing.assert_allclose(ratio * limit(len(seen), case.rows), expected, rtol=1e-6)


def test_constant_velocity_has_the_covariance_of_white_acceleration() -> None:
    # Integrals of a white acceleration of density q: q dt^3 / 3, q dt^2 / 2, q dt.
    q, dt = 0.2**2, 4.0
    transition, root, _ = motion_model(KalmanInnovation(motion=CONSTANT_VELOCITY, velocity_m_per_s=0.2), 5, dt)
    found = (root @ root.T)[np.ix_([1, 6], [1, 6])]
    np.testing.assert_allclose(found, q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), rtol=1e-12)
    assert transition[1, 6] == dt
    np.testing.assert_allclose((root @ root.T)[3, 3], 3.0**2 * dt)
    assert (root @ root.T)[3, 6] == 0.0


def test_a_filter_without_coloured_states_takes_errors_as_white(rows: Rows) -> None:
    # Under white errors the two are the same filter; under correlated ones their gains differ.
    ramp = unit_ramp_m(rows, SATELLITE, ONSET)
    for share, same in ((0.0, True), (0.5, False)):
        noise = NoiseInTime(100.0, share)
        plans = [
            pass_plan((dataclasses.replace(KALMAN[0], coloured=coloured),), rows, noise, ramp, ONSET, 35.0)
            for coloured in (True, False)
        ]
        base = plans[0].sequential[0].base
        first, second = (np.asarray(plan.sequential[0].gain)[5:, :base] for plan in plans)
        assert np.allclose(first, second, atol=1e-6) is same
