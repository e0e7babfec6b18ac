"""Whatever a user has set for JAX or NumPy, numbers are the same bit by bit; a forked process says what is wrong."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import textwrap
from collections.abc import Callable

import jax
import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc import statistics
from pl_mc.runtime.precision import precision_scope

G = pl_mc.simulate(site="CUT0", epochs=2)
FAULTS = pl_mc.biases(G, {"G01": 30.0})

SETTINGS = [
    ("jax_threefry_partitionable", False),
    ("jax_default_prng_impl", "rbg"),
    ("jax_random_seed_offset", 5),
    ("jax_enable_custom_prng", True),
    ("jax_legacy_prng_key", "error"),
    ("jax_numpy_dtype_promotion", "strict"),
    ("jax_numpy_rank_promotion", "raise"),
    ("jax_default_matmul_precision", "bfloat16"),
    ("jax_debug_nans", True),
    ("jax_debug_infs", True),
    ("jax_enable_checks", True),
    ("jax_check_tracer_leaks", True),
    ("jax_transfer_guard", "disallow"),
    ("jax_enable_x64", True),
    ("jax_enable_x64", False),
]


def counted() -> dict[str, pd.DataFrame]:
    """Numbers of every sort of random number, of both precisions, small enough to be compiled anew."""
    single = pl_mc.sweep(G, FAULTS, draws=300, seed=3, methods=("ls",), precision="float32")
    drawn = pl_mc.sample(G, FAULTS, draws=8, seed=3, methods=pl_mc.igg3(iterations=2), noise="student_t")
    found = pl_mc.detect(G[0], pl_mc.no_fault(G[0]), tests=("chi2",), draws=50, seed=3, calibration_draws=200)
    return {"single": single, "drawn": drawn, "detect": found}


@pytest.fixture(scope="module")
def sound() -> dict[str, pd.DataFrame]:
    return counted()


@pytest.mark.parametrize(("name", "value"), SETTINGS)
def test_numbers_do_not_depend_on_a_setting(name: str, value: object, sound: dict[str, pd.DataFrame]) -> None:
    before = getattr(jax.config, name)
    jax.config.update(name, value)
    try:
        again = counted()
    finally:
        jax.config.update(name, before)
    for key, table in sound.items():
        pd.testing.assert_frame_equal(again[key], table, check_exact=True)


def test_a_scope_ends() -> None:
    before = jax.config.jax_threefry_partitionable, jax.config.jax_numpy_rank_promotion
    with precision_scope("float32"):
        assert jax.config.jax_numpy_rank_promotion == "allow"
    assert (jax.config.jax_threefry_partitionable, jax.config.jax_numpy_rank_promotion) == before


G_1 = G[0]
CALLS: list[Callable[[], object]] = [
    lambda: pl_mc.exact.ls_rates(G, FAULTS),
    lambda: pl_mc.exact.ls_rates(G, FAULTS, alarm="chi2"),
    lambda: pl_mc.worst_case(G_1, satellites=["G01", ("G01", "C01")]),
    lambda: pl_mc.worst_case(G_1, satellites=["G01"], event="misleading", alarm="chi2"),
    lambda: pl_mc.risk_budget(G_1, method="ls"),
    lambda: pl_mc.reliability(G),
    lambda: pl_mc.sweep(G, FAULTS, draws=300, seed=3, methods=("ls",)),
    lambda: pl_mc.solve(G_1, np.zeros(len(G_1.names))),
    lambda: pl_mc.calibrate(G_1, method="ls", target=0.01, draws=2000),
    lambda: pl_mc.simulate(site="CUT0", epochs=2).design,
    lambda: pl_mc.geometry.dops(G).vdop,
    lambda: pd.DataFrame(np.array(statistics.clopper_pearson(np.arange(5), 5))),
    lambda: pd.DataFrame(np.array(statistics.joint_exceedance([0.0, 1e-300, 1e8], 3, 1e-9, 1.0, 40.0))),
    lambda: pd.DataFrame(np.array(statistics.split_at_threshold([0.0, 1e-300, 1e8], 3, 5e-324))),
    lambda: pd.DataFrame([statistics.noncentral_shift(1e-9, 0.999)]),
]


@pytest.mark.parametrize("call", CALLS)
def test_numbers_do_not_depend_on_the_errors_of_numpy(call: Callable[[], object]) -> None:
    expected = call()
    before = np.seterr(all="raise")
    try:
        found = call()
    finally:
        np.seterr(**before)  # type: ignore[arg-type]
    if isinstance(expected, pd.DataFrame):
        pd.testing.assert_frame_equal(found, expected, check_exact=True)  # type: ignore[arg-type]
    else:
        np.testing.assert_array_equal(found, expected)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "first", ["pl_mc.sweep(g, pl_mc.no_fault(g), draws=10, seed=1, methods=('ls',))", "jax.numpy.zeros(3).sum()"]
)
def test_a_forked_process_says_so(first: str) -> None:
    """Without a word it would wait for ever."""
    assert "fork" in multiprocessing.get_all_start_methods()
    program = f"""
    import multiprocessing, warnings
    import jax, pl_mc
    g = pl_mc.simulate(epochs=1)[0]

    def work(queue):
        try:
            pl_mc.sweep(g, pl_mc.no_fault(g), draws=10, seed=1, methods=("ls",))
        except pl_mc.InputError as error:
            queue.put(str(error))
        queue.put(float(pl_mc.exact.ls_rates(g, pl_mc.no_fault(g)).alarm_rate.iloc[0]))

    {first}
    warnings.simplefilter("ignore")
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=work, args=(queue,))
    process.start()
    print(queue.get(timeout=60))
    assert queue.get(timeout=60) >= 0
    process.join(60)
    print(process.exitcode)
    """
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=120, check=False
    )
    assert "it was forked after JAX had computed in its parent" in ended.stdout, ended.stderr
    assert ended.stdout.endswith("0\n")
