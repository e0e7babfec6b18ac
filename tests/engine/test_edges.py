"""The edges of the public functions: nothing to count, arrays that do not fit, numbers that are none."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import pl_mc
from pl_mc import kernels
from pl_mc.input_errors import InputError


@pytest.fixture(scope="module")
def series() -> pl_mc.Geometry:
    """Three epochs four hours apart, so that satellites rise and set."""
    return pl_mc.simulate(epochs=3, interval_s=4 * 3600.0)


def test_a_fault_that_applies_nowhere_gives_an_empty_table(series: pl_mc.Geometry) -> None:
    # A satellite of the first epoch that has set by the last.
    last = {series.names[k] for k in series.satellite[2][series.in_view[2]]}
    gone = next(name for name in series[0].names if name not in last)
    faults = pl_mc.biases(series, {gone: 30.0})
    for workers in (1, 2):
        table = pl_mc.sweep(series[2:], faults, draws=10, seed=1, by_epoch=workers == 1, workers=workers)
        assert table.empty
        assert {"epoch" if workers == 1 else "epochs", "method", "alarms", "alarm_rate", "missed_high"} <= set(
            table.columns
        )
        assert gone in table.attrs["notes"][0]
    outcomes = pl_mc.sample(series[2:], faults, draws=10, seed=1)
    assert outcomes.empty
    assert "vpl_m" in outcomes.columns


def test_errors_of_another_shape_are_refused(series: pl_mc.Geometry) -> None:
    right = np.zeros(series.sigma_m.shape)
    assert len(pl_mc.solve(series, right, methods=("ls",))) == 3
    for wrong in (right.T, right[0], right.ravel(), np.zeros(5), "a", [[1.0], [2.0, 3.0]]):
        with pytest.raises(InputError, match="errors_m"):
            pl_mc.solve(series, wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="geometry"):
        pl_mc.solve(3, right)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="alert"):
        pl_mc.solve(series, right, alert=35.0)  # type: ignore[arg-type]


def test_a_series_is_iterated_epoch_by_epoch(series: pl_mc.Geometry) -> None:
    assert [int(g.epoch) for g in series] == [0, 1, 2]
    with pytest.raises(InputError, match="whole number or a slice"):
        series[[0, 1]]  # type: ignore[index]


def test_more_draws_than_blocks_can_number_are_refused(series: pl_mc.Geometry) -> None:
    with pytest.raises(InputError, match="draws"):
        pl_mc.sweep(series, pl_mc.no_fault(series), draws=10**13, seed=1)


def test_a_geometry_keeps_its_own_numbers() -> None:
    g = pl_mc.simulate(epochs=1)[0]
    design, sigma = g.design.copy(), g.sigma_m.copy()
    kept = pl_mc.Geometry.from_arrays(design, sigma, g.systems, g.names)
    design[0, 0] = sigma[0] = 99.0
    assert kept.design[0, 0] == g.design[0, 0]
    assert kept.sigma_m[0] == g.sigma_m[0]


def test_epochs_of_one_number_are_refused() -> None:
    g = pl_mc.simulate(epochs=2)
    rows = {"design": g.design, "sigma_m": g.sigma_m, "in_view": g.in_view, "clocks": g.clocks}
    names = [f"G{k:02d}" for k in range(g.sigma_m.shape[1])]
    made = pl_mc.Geometry.from_rows(**rows, names=names, systems=["G"] * len(names))
    assert len(made) == 2
    for changed, word in (
        ({"epoch": [3, 3]}, "epoch"),
        ({"clocks": ("G",)}, "design"),
        ({"sigma_m": g.sigma_m[0]}, "sigma_m"),
        ({"systems": ["G"]}, "systems"),
    ):
        with pytest.raises(InputError, match=word):
            pl_mc.Geometry.from_rows(**({"names": names, "systems": ["G"] * len(names)} | rows | changed))


def test_a_coordinate_without_satellites_is_no_dropped_clock() -> None:
    design = pl_mc.simulate(epochs=1)[0].design.copy()
    design[:, 0] = 0.0
    estimate = kernels.ls(design, np.ones(len(design)), np.zeros(len(design)))
    assert not bool(estimate.available)
    assert np.isinf(kernels.protection_levels(estimate).hpl_m)


def test_single_precision_keeps_a_lone_satellite() -> None:
    # One BeiDou satellite beside GPS: its residual is zero whatever its error, so its weight is one.
    g = pl_mc.simulate(epochs=1)[0]
    rows = [k for k, letter in enumerate(g.systems) if letter == "G"]
    rows.append(g.systems.index("C"))
    observed = np.zeros(len(rows))
    observed[-1] = 1e4
    estimate = kernels.igg3(
        jnp.asarray(g.design[rows], jnp.float32),
        jnp.asarray(g.sigma_m[rows], jnp.float32),
        jnp.asarray(observed, jnp.float32),
    )
    assert estimate.weights.dtype == jnp.float32
    assert bool(estimate.available)
    assert float(estimate.weights[-1]) == 1.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pl_mc.ls(k_vertical=-1.0), "k_vertical"),
        (lambda: pl_mc.igg3(k_vertical=float("nan")), "k_vertical"),
        (lambda: pl_mc.igg3(iterations=True), "iterations"),
        (lambda: pl_mc.igg3(k0="a"), "k0"),
        (lambda: kernels.HuberWeight(-1.0), "huber"),
        (lambda: kernels.TukeyWeight(0.0), "tukey"),
        (lambda: kernels.ls(np.eye(5), np.ones(5), np.ones(5), np.ones(4, bool)), "in_view"),
    ],
)
def test_options_that_make_no_sense(make, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def test_methods_that_are_none(series: pl_mc.Geometry) -> None:
    @dataclasses.dataclass
    class Unhashable:
        name: str = "mine"

        def prepare(self, model):
            return ()

        def solve(self, model, prepared, start):
            raise NotImplementedError

    for wrong in ("lss", 3, None, (pl_mc.ls,), (Unhashable(),), ()):
        with pytest.raises(InputError, match="method"):
            pl_mc.sweep(series, pl_mc.no_fault(series), draws=1, seed=1, methods=wrong)  # type: ignore[arg-type]


def test_labels_tell_biases_apart(series: pl_mc.Geometry) -> None:
    name = series.names[0]
    assert pl_mc.biases(series, {name: 100.0001}).labels == (f"{name}:+100.0001m",)
    assert pl_mc.biases(series, {name: -1234567.0}).labels == (f"{name}:-1234567m",)
    steps = pl_mc.ramp(series, satellite=name, start_m=0.1, stop_m=0.5, step_m=0.1)
    assert steps.labels == tuple(f"{name}:+0.{k}m" for k in range(1, 6))
    for wrong in ({name: "x"}, {name: float("inf")}):
        with pytest.raises(InputError, match=name):
            pl_mc.biases(series, wrong)  # type: ignore[arg-type]


def test_many_calls_compile_once() -> None:
    g = pl_mc.simulate(epochs=1)[0]
    observed = np.zeros(len(g.names))
    kernels.igg3(g.design, g.sigma_m, observed)
    from pl_mc.kernels import solvers

    compiled = solvers._reweighted._cache_size()
    for k in range(20):
        kernels.igg3(g.design, g.sigma_m, observed + k)
    assert solvers._reweighted._cache_size() == compiled
