"""Sweeps and risks under noise models against exact probabilities of least squares; and what stays as it was."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from jax import Array

import pl_mc
from pl_mc.alert import AlertLimits
from pl_mc.engine.core import EpochBatch, block_noise, block_outcomes, prepare_epoch
from pl_mc.engine.part_task import identity_of
from pl_mc.input_errors import InputError
from pl_mc.integrity_risk.rare.limit_state import LimitState, all_axes, limit_state
from pl_mc.integrity_risk.rare.risk import risk
from pl_mc.kernels.noise import epoch_key, unit_inputs, unit_noise
from pl_mc.methods import Igg3, Ls, Outcome
from pl_mc.noise_models import GAUSSIAN, GaussianMixture, Multipath, NoiseModel, NominalBias, StudentT
from pl_mc.statistics.intervals import binomial_p_value
from pl_mc.statistics.least_squares import ls_quantities
from reference import small_sweep as small
from reference.noise_oracle import mixture_tail, tail_of_sum
from reference.problems import random_geometry
from reference.small_sweep import assert_same

G = random_geometry(np.random.default_rng(64), counts=(4, 3), noise=4.0)
WEIGHTS = ls_quantities(G).gain * G.sigma_m
BIAS_M = 10.0
FAULTS = pl_mc.no_fault(G) + pl_mc.biases(G, {"G02": BIAS_M})
SHIFT_M = float(ls_quantities(G).gain[1] * BIAS_M)
DRAWS = 200_000
# A protection level of next to nothing never alarms: what is missed is every hazard.
SILENT = Ls(k_vertical=1e-9)


def exact_hazard(noise: NoiseModel, shift: float, limit: float = 35.0) -> float:
    return tail_of_sum(noise, WEIGHTS, G.sigma_m, limit, shift)


def test_the_two_oracles_agree() -> None:
    for noise in (GaussianMixture(0.05, 5.0), GaussianMixture(0.3, 2.0, "kept")):
        assert exact_hazard(noise, SHIFT_M) == pytest.approx(mixture_tail(noise, WEIGHTS, 35.0, SHIFT_M), abs=1e-11)


@pytest.mark.parametrize(
    "noise",
    [StudentT(4.0), GaussianMixture(0.05, 5.0), Multipath(0.2, 20.0), NominalBias(4.0, "random")],
    ids=lambda noise: noise.name,
)
def test_hazards_of_least_squares_have_their_exact_rate(noise: NoiseModel) -> None:
    near = AlertLimits("near", vertical_m=25.0, horizontal_m=40.0)
    table = pl_mc.sweep(G, FAULTS, draws=DRAWS, seed=5, methods=("ls",), alert=near, noise=noise)
    for hazards, shift in zip(table.hazards, (0.0, SHIFT_M), strict=True):
        exact = exact_hazard(noise, shift, 25.0)
        assert binomial_p_value(hazards, DRAWS, exact) > 1e-6
    # Gaussian noise would be told from it.
    assert binomial_p_value(table.hazards[1], DRAWS, exact_hazard(GAUSSIAN, SHIFT_M, 25.0)) < 1e-6


@pytest.mark.parametrize("sign", ["down", "given"])
def test_a_constant_bias_is_a_fault_on_every_satellite(sign: str) -> None:
    upward = np.sign(ls_quantities(G).gain) * 2.0
    nominal = {"up": upward, "down": -upward, "given": np.linspace(-3.0, 3.0, 7)}[sign]
    noise = NominalBias(tuple(nominal) if sign == "given" else 2.0, sign)
    table = pl_mc.sweep(G, FAULTS, draws=DRAWS, seed=6, methods=("ls",), noise=noise)
    exact = pl_mc.exact.ls_rates(G, pl_mc.Faults.from_array(G, FAULTS.bias_m + nominal))
    for event in ("alarm", "hazard", "missed", "misleading", "exceeded", "false_alarm"):
        rates = np.minimum(exact[f"{event}_rate"], 1.0)
        assert (binomial_p_value(np.round(table[f"{event}_rate"] * DRAWS), DRAWS, rates) > 1e-6).all(), event


def test_gaussian_noise_is_what_it_was() -> None:
    assert_same(small.run(noise="gaussian", methods=("ls",)), small.run(methods=("ls",)))
    key, block = epoch_key(np.uint32(9), np.uint32(4)), np.int32(3)
    plain = np.asarray(unit_noise(key, block, 7, np.float64))
    first, second = (np.asarray(part) for part in unit_inputs(key, block, 2, 7, np.float64))
    np.testing.assert_array_equal(first, plain)
    # Further numbers are others: of other blocks, other epochs, and of each other.
    assert not np.isin(second, plain).any()
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 4.9 / np.sqrt(first.size)
    wide = np.asarray(unit_inputs(key, block, 2, 9, np.float64)[1])
    np.testing.assert_array_equal(wide[:7], second)


def test_the_noise_is_part_of_what_a_sweep_is(tmp_path) -> None:
    assert "noise" not in identity_of(small.task())["experiment"]
    noise, one = StudentT(5.0), {"methods": ("ls",)}
    assert identity_of(small.task(noise=noise))["experiment"]["noise"] == repr(noise)
    table = small.run(folder=tmp_path / "t", noise=noise, **one)
    assert_same(small.run(folder=tmp_path / "t", noise=noise, resume=True, **one), table)
    assert not table.alarms.equals(small.run(**one).alarms)
    with pytest.raises(InputError, match=r"noise: StudentT\(nu=5.0, .* before, StudentT\(nu=6.0, .* now"):
        small.run(folder=tmp_path / "t", noise=StudentT(6.0), resume=True, **one)
    with pytest.raises(InputError, match=r"noise: StudentT\(nu=5.0, .* before, Gaussian\(\) now"):
        small.run(folder=tmp_path / "t", resume=True, **one)


def test_a_noise_model_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="the geometry has a series of epochs"):
        small.run(noise=NominalBias((1.0,) * 8))
    with pytest.raises(InputError, match="noise: 'gausian' is unknown"):
        small.run(noise="gausian")


def test_the_limit_state_of_shaped_noise_is_that_of_the_sweep() -> None:
    noise, method = Multipath(0.3, 10.0), Igg3(iterations=2)
    seen, bias = np.ones(7, bool), FAULTS.bias_m[1]
    limit = LimitState(
        G.design, G.sigma_m, seen, bias, method, "misleading", 35.0, all_axes(seen, noise.inputs_per_row), noise
    )
    assert limit.active == limit.dimension == 14
    one = EpochBatch(G.design, G.sigma_m, seen, bias[None], np.ones(1, bool), np.uint32(0))
    seed, block = np.uint32(3), np.int32(0)
    numbers = unit_inputs(epoch_key(seed, np.uint32(0)), block, 2, 7, np.float64)
    points = np.concatenate([np.asarray(part).T for part in numbers], axis=1)

    # Compiled as a whole: operation by operation it would take longer.
    @jax.jit
    def counted(one: EpochBatch) -> Outcome:
        (outcome,) = block_outcomes(
            jax.tree.map(lambda part: part[None], one), seed, block, (method,), noise_model=noise
        )
        return jax.tree.map(lambda part: part[0, 0], outcome)

    @jax.jit
    def both(one: EpochBatch, numbers: list[Array]) -> tuple[Array, Array]:
        model, _ = prepare_epoch(one, (method,))
        return block_noise(model, one, seed, block, noise), noise.shape(model, numbers)

    of_outcome = jax.jit(lambda outcome: limit_state(outcome, 35.0, "misleading"))
    np.testing.assert_allclose(limit(points), of_outcome(counted(one)), atol=1e-9)
    np.testing.assert_allclose(*both(one, list(numbers)), atol=1e-12)


@pytest.mark.parametrize(
    ("noise", "limit"), [(StudentT(5.0), 150.0)], ids=lambda value: getattr(value, "name", str(value))
)
def test_rare_hazards_of_least_squares(noise: NoiseModel, limit: float) -> None:
    alert = AlertLimits("far", vertical_m=limit, horizontal_m=40.0)
    exact = exact_hazard(noise, 0.0, limit)
    assert 1e-10 < exact < 3e-5
    row = risk(
        G, pl_mc.no_fault(G), seed=2, event="missed", method=SILENT, alert=alert, noise=noise, target_cov=0.1,
        max_evaluations=3_000_000, progress=False,
    ).iloc[0]  # fmt: skip
    assert row["estimator"] == "importance"
    assert row["warning"] == ""
    assert abs(row["probability"] - exact) < 4.9 * row["standard_error"]
    assert row["standard_error"] < 0.1 * exact


def test_risks_under_gaussian_noise_have_kept_their_random_numbers() -> None:
    faults = pl_mc.biases(G, {"G02": 20.0})
    options = {"seed": 4, "event": "exceeded", "method": "ls", "max_evaluations": 500_000, "progress": False}
    assert_same(risk(G, faults, noise="gaussian", **options), risk(G, faults, **options))
    other = risk(G, faults, noise=StudentT(4.0), **options)
    assert other.probability[0] != risk(G, faults, **options).probability[0]
