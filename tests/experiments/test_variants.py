"""Variants of one estimate: the faults that are chosen, the counts, the weights, gates that do or do not see."""

from __future__ import annotations

import functools
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
from scipy import stats

import pl_mc
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.kernels import linear_model, start_from
from pl_mc.kernels.noise import LANES, epoch_key, unit_noise
from pl_mc.methods import GatedIgg3, Igg3, method
from pl_mc.report.document import read_document
from pl_mc.statistics import binomial_p_value
from pl_mc.studies.variants import STUDY
from pl_mc.studies.variants.run import fault_classes, strongest_and_weakest
from reference import igg3_numpy as reference
from reference.problems import random_sky

DRAWS, WATCHED, SEED = 600, 40, 3
GEOMETRY = {"epochs": 4, "interval_s": 7200.0}
SMALL = {
    "kind": "variants",
    "title": "small",
    "draws": DRAWS,
    "weight_draws": WATCHED,
    "seed": SEED,
    "geometry": GEOMETRY,
    "faults": {"start_m": 8.0, "stop_m": 60.0, "step_m": 52.0},
    "variants": [
        {"group": "scale", "label": "apriori", "options": {"scale": "apriori", "iterations": 3}},
        {"group": "gate", "label": "weighted gate", "method": "igg3_gated"},
    ],
}
CASES = {"default": {}, "apriori": {"scale": "apriori", "iterations": 3}}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("variants") / "out"
    result = run_experiment("small", build_experiment(SMALL, source="test"), folder)
    assert "## What is found" in result.summary
    return folder


def read(out: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(out / f"{name}.csv", keep_default_na=False, na_values=[""])


def the_epoch(number: int):
    return pl_mc.simulate(**GEOMETRY)[number]


def errors_of(g, draws: int) -> np.ndarray:
    """(n, draws), the noise of the sweep [m]."""
    key = epoch_key(np.uint32(SEED), np.uint32(g.epoch))
    blocks = [unit_noise(key, block, g.sigma_m.size, np.float64) for block in range(-(-draws // LANES))]
    return g.sigma_m[:, None] * np.hstack(blocks)[:, :draws]


def biased(g, satellites: str, bias_m: float) -> np.ndarray:
    return np.where(np.isin(g.names, satellites.split()), bias_m, 0.0)


def test_the_epochs_and_satellites_are_the_extreme_ones() -> None:
    """By the normal matrix written out, and by all pairs tried."""
    series = pl_mc.simulate(epochs=6, interval_s=9000.0)
    vdop = []
    for g in series:
        normal = g.design.T @ np.diag(g.sigma_m**-2) @ g.design
        vdop.append(np.sqrt(np.linalg.inv(normal)[2, 2]))
    assert strongest_and_weakest(series) == (int(np.argmin(vdop)), int(np.argmax(vdop)))
    g = series[int(np.argmax(vdop))]
    weights = np.diag(g.sigma_m**-2)
    inverse = np.linalg.inv(g.design.T @ weights @ g.design)
    gain = (inverse @ g.design.T @ weights)[2]
    redundancy = 1 - np.diag(g.design @ inverse @ g.design.T @ weights)
    none, median, largest, double = fault_classes(g, series, "weakest", (5.0, 10.0))
    assert none.faults.labels == ("none",)
    middle = redundancy[g.names.index(median.satellites[0])]
    assert np.sum(redundancy < middle) == (redundancy.size - 1) // 2
    assert largest.satellites == (g.names[np.abs(gain).argmax()],)
    pairs = {(i, j): abs(gain[i] + gain[j]) for i in range(gain.size) for j in range(i)}
    i, j = max(pairs, key=pairs.__getitem__)
    assert set(double.satellites) == {g.names[i], g.names[j]}
    assert gain[i] * gain[j] > 0
    assert abs(double.moved) == pytest.approx(pairs[i, j])
    # Both get the whole bias.
    for row, size in zip(double.faults.bias_m, (5.0, 10.0), strict=True):
        assert dict(zip(series.names, row, strict=True)) == {
            name: size if name in double.satellites else 0.0 for name in series.names
        }


def test_the_table_is_complete_and_least_squares_in_it_is_exact(out: Path) -> None:
    table = read(out, "variants")
    faults = read(out, "faults")
    # Two geometries with no fault and three classes of two sizes, for least squares, the default and two variants.
    assert len(table) == 2 * (1 + 3 * 2) * 4
    assert (table.draws == DRAWS).all()
    assert list(faults.fault_class) == 2 * ["median redundancy", "largest influence", "double"]
    assert table.variant.unique().tolist() == ["ls", "default", "apriori", "weighted gate"]
    worst_p = 1.0
    for row in table[(table.variant == "ls") & (table.fault_class != "none")].itertuples():
        g = the_epoch(row.epoch)
        named = faults[(faults.geometry == row.geometry) & (faults.fault_class == row.fault_class)].satellites.iloc[0]
        fault = pl_mc.biases(g, dict.fromkeys(named.split(), row.bias_m))
        exact = pl_mc.exact.ls_rates(g, fault, alert=pl_mc.LPV_200).iloc[0]
        for event, count in (("alarm", row.alarms), ("misleading", row.misleading), ("exceeded", row.exceeded)):
            worst_p = min(worst_p, float(binomial_p_value(count, DRAWS, exact[f"{event}_rate"])))
    # 36 comparisons; under a false alarm rate of 1e-6 in all.
    assert worst_p > 1e-6 / 36


def test_the_weights_are_those_of_the_reference(out: Path) -> None:
    """Every event of the weights, counted with the slow reference on the same draws."""
    swamping, faults = read(out, "swamping"), read(out, "faults")
    assert set(swamping.variant) == {"default", "apriori", "weighted gate"}
    checked = 0
    for row in swamping[swamping.variant.isin(CASES)].itertuples():
        if row.fault_class == "median redundancy":
            continue
        g = the_epoch(row.epoch)
        here = faults[(faults.geometry == row.geometry) & (faults.fault_class == row.fault_class)]
        bias = biased(g, here.satellites.iloc[0], row.bias_m) if len(here) else np.zeros(len(g.names))
        seen = dict.fromkeys(("undetermined", "good_out", "faulted_full", "swamped", "separated", "few_left"), 0)
        for error in errors_of(g, WATCHED).T:
            found = reference.igg3(g.design, g.sigma_m, error + bias, **CASES[row.variant])
            if not found.available:
                seen["undetermined"] += 1
                continue
            out_now, full = found.w == 0, found.w == 1
            good_out, faulted_full = np.any(out_now & (bias == 0)), np.any(full & (bias != 0))
            seen["good_out"] += good_out
            seen["faulted_full"] += faulted_full
            seen["swamped"] += good_out and faulted_full
            seen["separated"] += np.all(out_now[bias != 0]) and not good_out
            seen["few_left"] += np.sum(~out_now) <= g.design.shape[1] + 2
        assert row.draws == WATCHED
        for event, count in seen.items():
            value = getattr(row, f"{event}_count")
            if row.fault_class == "none" and event in ("faulted_full", "swamped", "separated"):
                assert np.isnan(value)
            else:
                assert value == count, (row.variant, row.fault, event)
                checked += count > 0
    # The cases are not all empty.
    assert checked >= 10


def test_figures_and_worst_rates(out: Path) -> None:
    for geometry in ("weakest", "strongest"):
        assert (out / f"variants_{geometry}.png").stat().st_size > 10_000
    table, worst = read(out, "variants"), read(out, "worst")
    for row in worst[worst.event == "misleading"].itertuples():
        ramp = table[
            (table.variant == row.variant) & (table.geometry == row.geometry) & (table.fault_class == row.fault_class)
        ]
        assert row.rate == ramp.misleading_rate.max()
        assert row.low <= row.rate <= row.high


def test_old_tables_tell_the_answer_too(out: Path) -> None:
    tables = {path.stem: read(out, path.stem) for path in out.glob("*.csv")}
    answer = STUDY.answer(tables, build_experiment(SMALL, source="test"))
    document = read_document(out)
    assert document is not None
    assert answer == document.answer
    charts = {table.name: table.chart for table in document.tables if table.chart is not None}
    assert {name: len({*chart.curves, *chart.menus}) for name, chart in charts.items()} == {
        "variants": 3,
        "swamping": 3,
    }
    for name, chart in charts.items():
        assert not tables[name].duplicated([*chart.curves, *chart.menus, chart.x]).any()


@functools.partial(jax.jit, static_argnames="methods")
def solved(methods, design, sigma_m, observed_m):
    model = linear_model(design, sigma_m)
    return [of.solve(model, of.prepare(model), start_from(model, observed_m)) for of in methods]


def test_a_gate_tests_the_square_sum_that_it_names() -> None:
    rng = np.random.default_rng(11)
    design, sigma, _ = random_sky(rng, counts=(7, 4))
    n, lanes, p_fa = sigma.size, 60, 0.05
    observed = 1.3 * sigma[:, None] * rng.standard_normal((n, lanes))
    observed[0] += np.linspace(0.0, 60.0, lanes)
    threshold = stats.chi2.isf(p_fa, n - design.shape[1])
    gates = ("weighted", "unweighted", "ls")
    plain, *gated = solved((Igg3(), *(GatedIgg3(gate=g, p_fa=p_fa) for g in gates)), design, sigma, observed)
    rejected = {}
    for gate, found in zip(gates, gated, strict=True):
        # The estimate and its levels stay what they are.
        np.testing.assert_array_equal(found.vpl_m, plain.vpl_m)
        expected = []
        for k in range(lanes):
            solver = reference.least_squares if gate == "ls" else reference.igg3
            one = solver(design, sigma, observed[:, k])
            weights = one.w if gate == "weighted" else 1.0
            expected.append(np.sum(weights * (one.v / sigma) ** 2) > threshold)
        np.testing.assert_array_equal(found.rejects, expected)
        rejected[gate] = np.asarray(found.rejects)
    # The last quarter is beyond 45 m: the usual gate rejects all of it, the weighted one less than half.
    assert rejected["ls"][-15:].all()
    assert rejected["weighted"][-15:].mean() < 0.5
    assert 0 < rejected["unweighted"].sum() < lanes


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"geometry": GEOMETRY | {"epoch": 1}}, r"geometry\.epochs: a series of at least two"),
        ({"variants": [{"group": "a", "label": "b", "method": "ls"}]}, "b: method: 'ls' is no variant of igg3"),
        ({"variants": [{"group": "a", "label": "b"}]}, "igg3 is asked for twice"),
        ({"variants": [{"group": "a", "label": "b", "options": {"start": "hubre"}}]}, "start: .*nearest: huber"),
        ({"variants": [{"group": "a", "label": "b", "options": {"weight_floor": 1.0}}]}, "weight_floor: a number"),
        ({"variants": []}, "variants: tuple should have at least 1 item"),
    ],
)
def test_bad_input_is_one_sentence(changes: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        run_experiment("small", build_experiment(SMALL | changes, source="test"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("options", "words"), [({"gate": "lss"}, "gate: .*nearest: ls"), ({"p_fa": 0.0}, "p_fa: a")])
def test_bad_gates(options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        method("igg3_gated", **options)


def test_the_experiment_that_comes_along_builds_every_variant() -> None:
    _, experiment = load_experiment("igg3-variants")
    names = [record.name for record in experiment.method_records()]
    assert names[:2] == ["ls", "igg3"]
    assert len(names) == len(experiment.variants) + 2 == len(experiment.legend())
