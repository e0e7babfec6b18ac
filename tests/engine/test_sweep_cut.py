"""How a sweep is cut into calls, threads, epochs and padding never changes a count; seeds and precision do."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import jax
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pl_mc
from pl_mc.engine import EVENTS, plan
from pl_mc.kernels import least_squares, protection_levels
from pl_mc.kernels.noise import LANES
from pl_mc.methods import Ls
from pl_mc.methods.base import outcome_of
from pl_mc.statistics import binomial_p_value
from reference.problems import appendix_d
from reference.small_sweep import COUNTS, DRAWS, FAULTS, METHODS, SERIES, cut

# Bits, across threads, parts and processes: as users compile.
pytestmark = pytest.mark.optimised

EXPECTED = None


def expected() -> pd.DataFrame:
    """The counts of one uncut call."""
    global EXPECTED
    if EXPECTED is None:
        EXPECTED = pl_mc.sweep(SERIES, FAULTS, draws=DRAWS, seed=51, methods=METHODS, by_epoch=True, workers=1)
    return EXPECTED


@given(per_call=st.sampled_from([1, 4 * LANES, 9 * LANES, 26 * LANES, 2**20]), workers=st.sampled_from([1, 2, 5, None]))
@settings(max_examples=6)
def test_any_cut_and_any_number_of_threads(per_call, workers):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "SCENARIOS_PER_CALL", per_call)
        made = plan.make_plan(SERIES, FAULTS, DRAWS)
        assert made.chunk_count == sum(len(list(made.chunks(part))) for part in range(made.part_count))
        found = pl_mc.sweep(SERIES, FAULTS, draws=DRAWS, seed=51, methods=METHODS, by_epoch=True, workers=workers)
    pd.testing.assert_frame_equal(found, expected())


def test_the_cuts_are_cuts(monkeypatch):
    """The property above is not empty: its plans differ."""
    sizes = set()
    for per_call in (1, 4 * LANES, 9 * LANES, 26 * LANES, 2**20):
        monkeypatch.setattr(plan, "SCENARIOS_PER_CALL", per_call)
        sizes.add(plan.make_plan(SERIES, FAULTS, DRAWS).chunk_count)
    assert len(sizes) >= 4
    assert min(sizes) == 1


def test_an_epoch_alone_counts_as_in_its_series():
    for epoch in (1, 3):
        one = SERIES[epoch]
        rows = expected()[expected()["epoch"] == epoch]
        index = [SERIES.names.index(name) for name in one.names]
        kept = [k for k in range(len(FAULTS)) if FAULTS.applies(SERIES)[epoch, k]]
        faults = pl_mc.Faults.from_array(one, FAULTS.bias_m[kept][:, index])
        found = pl_mc.sweep(one, faults, draws=DRAWS, seed=51, methods=METHODS, by_epoch=True, workers=1)
        pd.testing.assert_frame_equal(found, rows.reset_index(drop=True), check_exact=True)
        part = pl_mc.sweep(
            SERIES[epoch : epoch + 1], FAULTS, draws=DRAWS, seed=51, methods=METHODS, by_epoch=True, workers=1
        )
        pd.testing.assert_frame_equal(part, rows.reset_index(drop=True), check_exact=True)


def test_padding_changes_no_count():
    def widened(array, value):
        return np.concatenate([array, np.full((4, 5, *array.shape[2:]), value, array.dtype)], axis=1)

    wide = dataclasses.replace(
        SERIES,
        design=widened(SERIES.design, 0.0),
        sigma_m=widened(SERIES.sigma_m, 1.0),
        in_view=widened(SERIES.in_view, False),
        satellite=widened(SERIES.satellite, 0),
    )
    found = pl_mc.sweep(wide, FAULTS, draws=DRAWS, seed=51, methods=METHODS, by_epoch=True, workers=1)
    pd.testing.assert_frame_equal(found, expected())


def test_fewer_draws_are_the_first_of_more():
    """The counts of single draws, cut off anywhere, are the counts of a shorter sweep, in calls of one block."""
    single = pl_mc.sample(SERIES[:1], FAULTS, draws=DRAWS, seed=51, methods=METHODS)
    keys = ["method", "fault"]
    for draws in (1, LANES, LANES + 1):
        with cut(1, 1):
            table = pl_mc.sweep(SERIES[:1], FAULTS, draws=draws, seed=51, methods=METHODS, by_epoch=True, workers=1)
        alarms = single[single["draw"] < draws].groupby(keys, sort=False)["alarm"].sum()
        found = table.set_index(keys)["alarms"]
        np.testing.assert_array_equal(found, alarms[found.index])


def test_methods_see_the_same_noise_whoever_else_is_there():
    alone = pl_mc.sweep(SERIES, FAULTS, draws=DRAWS, seed=51, methods=("ls",), by_epoch=True, workers=1)
    beside = expected()[expected()["method"] == "ls"].reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, beside)


@pytest.mark.quick
def test_methods_of_a_sample_see_the_same_noise():
    again = pl_mc.sample(SERIES, FAULTS, draws=9, seed=51, methods=(Ls(), Ls(k_vertical=3.0)))
    first, second = (again[again["method"] == name].reset_index(drop=True) for name in again["method"].unique())
    pd.testing.assert_series_equal(first["up_m"], second["up_m"])


def test_another_seed_gives_other_counts():
    other = pl_mc.sweep(SERIES, FAULTS, draws=DRAWS, seed=52, methods=METHODS, by_epoch=True, workers=1)
    assert (other[COUNTS] != expected()[COUNTS]).any(axis=None)
    # Yet the same rates: differences of two binomial counts within five standard deviations.
    spread = np.sqrt((other["alarms"] + expected()["alarms"]).clip(lower=1))
    assert np.all(np.abs(other["alarms"] - expected()["alarms"]) < 5 * spread)


@pytest.mark.quick
def test_single_precision_has_the_same_rates():
    g = appendix_d(noise=4.0)
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G03": 40.0})
    table = pl_mc.sweep(g, faults, draws=20_000, seed=53, methods=("ls",), precision="float32", workers=1)
    exact = pl_mc.exact.ls_rates(g, faults)
    for event in ("alarm", "hazard", "missed", "exceeded"):
        p_values = binomial_p_value(
            table[next(e.count for e in EVENTS if e.name == event)], table["draws"], exact[f"{event}_rate"]
        )
        # Eight tests at a family-wise level of 1e-6.
        assert p_values.min() > 1e-6 / 8, event
    errors = np.random.default_rng(54).standard_normal(10) * g.sigma_m + 30.0 * np.eye(10)[2]
    single, double = (pl_mc.solve(g, errors, precision=precision) for precision in ("float32", "float64"))
    # Rounding 6e-8 of residuals of some sigma, times the condition of the normal matrix (1e2).
    np.testing.assert_allclose(single["vpl_m"], double["vpl_m"], rtol=1e-4)
    np.testing.assert_allclose(single["up_m"], double["up_m"], rtol=0, atol=1e-3)


TRACES: list[int] = []


@dataclasses.dataclass(frozen=True)
class Traced:
    """Least squares that notes each time that it is traced."""

    name: str = "traced"

    def prepare(self, model):
        return ()

    def solve(self, model, prepared, start):
        TRACES.append(1)
        estimate = least_squares(model, start)
        return outcome_of(estimate, protection_levels(estimate))


@pytest.mark.quick
def test_a_sweep_compiles_once_for_a_shape():
    g = appendix_d()
    for k in range(4):
        faults = pl_mc.biases(g, {g.names[k]: 10.0 * k})
        pl_mc.sweep(g, faults, draws=3 * LANES - k, seed=k, methods=(Traced(),), workers=1 + k % 2)
        if k == 0:
            once = len(TRACES)
    assert len(TRACES) == once >= 1


@pytest.mark.quick
def test_the_caller_s_configuration_is_neither_needed_nor_touched():
    """A caller in JAX's own single precision gets the counts of double precision, and keeps his setting."""
    program = f"""
import sys, jax, numpy as np
sys.path.insert(0, {os.path.dirname(os.path.dirname(os.path.abspath(__file__)))!r})
from reference.problems import appendix_d
import pl_mc
before = dict(jax.config.values)
assert not jax.config.jax_enable_x64
g = appendix_d(noise=4.0)
table = pl_mc.sweep(g, pl_mc.biases(g, {{"G03": 40.0}}), draws=600, seed=7, methods=("ls",), workers=2)
single = pl_mc.solve(g, np.linspace(-9.0, 9.0, 10) ** 3, methods=("ls",))
assert not jax.config.jax_enable_x64
assert jax.numpy.ones(1).dtype == np.float32
assert dict(jax.config.values) == before
print(*table[{COUNTS!r}].iloc[0], float(single["vpl_m"].iloc[0]).hex())
"""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    *counts, level = done.stdout.split()
    assert jax.config.jax_enable_x64
    g = appendix_d(noise=4.0)
    table = pl_mc.sweep(g, pl_mc.biases(g, {"G03": 40.0}), draws=600, seed=7, methods=("ls",), workers=2)
    assert [int(count) for count in counts] == table[COUNTS].iloc[0].tolist()
    here = pl_mc.solve(g, np.linspace(-9.0, 9.0, 10) ** 3, methods=("ls",))["vpl_m"].iloc[0]
    np.testing.assert_allclose(float.fromhex(level), here, rtol=1e-13)
