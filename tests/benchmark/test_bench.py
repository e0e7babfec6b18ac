"""The benchmark: the suite in benchmarks/, the forms it compares with, and the command's record, text and files."""

from __future__ import annotations

import functools
import json
import math
import re
import shutil
import sys
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.benchmark.accuracy import Disagreement, disagreements, event_rates, overlapping
from pl_mc.benchmark.batched_numpy import NumpyModel, NumpyOutcome, both_methods, count_events, events_of
from pl_mc.benchmark.limit import limits
from pl_mc.benchmark.measure import Contestant, Rate, Ratio, measure
from pl_mc.benchmark.problem import METHODS, ROBUST, reference_errors_m, reference_faults, reference_geometry
from pl_mc.benchmark.run import LIMIT, NUMPY, SWEEP, Sizes, _busy_share, _notes, run_bench
from pl_mc.benchmark.scaling import run_scaling, scaling, scaling_figure, scenario_counts
from pl_mc.cli import running
from pl_mc.engine.plan import SCENARIOS_PER_CALL
from pl_mc.kernels.events import EVENTS
from pl_mc.kernels.noise import LANES, epoch_key, unit_noise
from reference import igg3_numpy
from reference.forked import Forked
from reference.problems import random_geometry

# Speed, and precision: as users compile.
pytestmark = pytest.mark.optimised

ROOT = Path(__file__).parents[2]

# A program as the user's would be, which reads and writes the files but is not fast: IGG-III by NumPy.
LIMIT_SCRIPT = """#!{python}
import sys
import numpy as np
values = np.fromfile(sys.argv[1])
n, t, s, iterations = values[:4].astype(int)
k0, k1, k_v, up = values[4:8]
a, p, sv, l = np.split(values[8:], np.cumsum([n * t, n, n]))
a, l = a.reshape(n, t), l.reshape(n, s)
vpl = np.empty(s)
for j in range(s):
    w = np.ones(n)
    for k in range(iterations + 1):
        normal = a.T @ (a * (w * p)[:, None])
        v = a @ np.linalg.solve(normal, a.T @ (w * p * l[:, j])) - l[:, j]
        m = np.sqrt(v @ (w * p * v) / (n - t))
        if k < iterations:
            u = np.abs(v) / (sv * max(1.0, m))
            w = np.where(u <= k0, 1.0, np.where(u <= k1, k0 / np.maximum(u, k0) * ((k1 - u) / (k1 - k0)) ** 2, 0.0))
    vpl[j] = k_v * m * np.sqrt(np.linalg.inv(normal)[int(up), int(up)])
vpl.astype(np.{dtype}).astype(float).tofile(sys.argv[2])
print("{printed}")
"""


def limit_program(folder: Path, *, dtype: str = "float64", printed: str = "5.000") -> Path:
    place = folder / f"limit_{dtype}"
    place.write_text(LIMIT_SCRIPT.format(python=sys.executable, dtype=dtype, printed=printed))
    place.chmod(0o755)
    return place


def test_the_suite_of_benchmarks_is_correct():
    program = "import sys, pytest\nsys.exit(pytest.main(sys.argv[1:]))"
    done = Forked(program, ["benchmarks", "-n", "0", "-q", "-p", "no:cacheprovider"], cwd=ROOT)
    out, err = done.communicate()
    assert done.returncode == 0, out[-3000:] + err[-3000:]
    assert re.search(r"^9 passed", out, re.MULTILINE)


# ---- Batched NumPy, which everything else is compared with ----


@pytest.mark.parametrize(("k0", "k1"), [(1.5, 5.0), (0.5, 1.2)], ids=["default", "strict"])
def test_batched_numpy_is_the_slow_reference(k0, k1):
    """On random skies with up to half of the satellites faulted; strict weights leave some without a solution."""
    rng = np.random.default_rng(5)
    undetermined = 0
    for counts in ((5, 3), (6, 6), (12, 12), (7, 5, 4)):
        g = random_geometry(rng, counts=counts)
        errors = g.sigma_m * rng.standard_normal((60, g.sigma_m.size))
        faulted = rng.random(errors.shape) < rng.uniform(0, 0.5, (60, 1))
        errors += faulted * rng.uniform(-200, 200, errors.shape)
        model, whitened = NumpyModel(g), errors / g.sigma_m
        weight = functools.partial(igg3_numpy.igg3_weight, k0=k0, k1=k1)
        robust = functools.partial(igg3_numpy.igg3, weight=weight, iterations=10)
        for found, solve in (
            (model.least_squares(whitened), igg3_numpy.least_squares),
            (model.igg3(whitened, pl_mc.igg3(k0=k0, k1=k1, iterations=10)), robust),
        ):
            slow = [solve(g.design, g.sigma_m, row) for row in errors]
            available = np.array([one.available for one in slow])
            np.testing.assert_array_equal(found.available, available)
            undetermined += int((~available).sum())
            # Roundings of 200 m, enlarged by normal matrices whose condition rejections leave at 1e6 or below.
            for mine, theirs in (
                (found.vpl_m, [one.vpl_m for one in slow if one.available]),
                (found.vertical_error_m, [one.x[2] for one in slow if one.available]),
            ):
                np.testing.assert_allclose(mine[available], theirs, rtol=1e-7, atol=1e-7)
    assert (undetermined > 10) == (k1 < 5)


@pytest.fixture(scope="module")
def table():
    """One block of noise under every fault, of the shape that a repetition in tiny sizes has."""
    g = reference_geometry()
    return pl_mc.sweep(g, reference_faults(g), draws=LANES, seed=4, methods=METHODS, workers=1, progress=False)


def test_batched_numpy_counts_what_the_sweep_counts(table):
    """On the sweep's own noise, fault by fault and event by event."""
    g = reference_geometry()
    faults = reference_faults(g)
    noise = np.asarray(jax.jit(lambda seed: unit_noise(epoch_key(seed, 0), 0, len(g.names), np.float64))(np.uint32(4)))
    counts = count_events(g, faults.bias_m, noise.T, pl_mc.LPV_200.vertical_m)
    for k, method in enumerate(("ls", ROBUST.name)):
        rows = table[table.method == method]
        np.testing.assert_array_equal(counts[:, k], rows[[event.count for event in EVENTS]].to_numpy())
    assert counts[:, 0, 0].max() == LANES  # every draw alarms at 100 m
    assert counts[:, 0, 0].min() == 0  # and none at 5 m


def test_the_reference_problem_is_what_it_says():
    g = reference_geometry()
    assert g.design.shape == (24, 5)
    assert [g.systems.count(letter) for letter in "GC"] == [12, 12]
    np.testing.assert_allclose(np.linalg.norm(g.design[:, :3], axis=1), 1.0, rtol=1e-12)
    assert np.degrees(g.elevation_rad).min() > 10
    faults = reference_faults(g)
    np.testing.assert_array_equal(faults.scalar_bias_m, np.arange(5.0, 101.0, 5.0))
    errors = reference_errors_m(g, 40, seed=1)
    np.testing.assert_allclose(errors[20:] - errors[:20], reference_errors_m(g, 40, seed=1)[20:] - errors[:20])


# ---- Timing ----


def test_measuring_alternates_and_uses_multiples_of_a_unit():
    order: list[tuple[str, int]] = []

    def clock(name: str, per_scenario_s: float):
        def run(scenarios: int) -> float:
            order.append((name, scenarios))
            return scenarios * per_scenario_s

        return run

    contestants = [
        Contestant("slow", "float64", 1, 1, unit=10, run=clock("slow", 1e-2), compiles=True),
        Contestant("fast", "float64", 2, 1, unit=100, run=clock("fast", 1e-4)),
        Contestant("fixed", "float64", 1, 0, unit=16, run=clock("fixed", 1e-6), most=1),
        Contestant("shared", "float64", 3, 1, unit=10, run=clock("shared", 3e-2)),
    ]
    rates = measure(contestants, seconds=3.0, rounds=3)
    # 1 s a repetition: ten units of 0.1 s; two threads do two hundred units of 5 ms each; three have time for ten of
    # 0.1 s each, of which the last would keep two of them waiting.
    assert [rate.scenarios for rate in rates] == [100, 20_000, 16, 90]
    assert [name for name, _ in order[8:]] == ["slow", "fast", "fixed", "shared"] * 3
    assert [rate.median_rate for rate in rates] == pytest.approx([1e-4, 1e-2, 1.0, 1e-4 / 3])
    assert rates[0].first_call_s == pytest.approx(0.1)
    assert rates[1].first_call_s is None


def test_ratios_are_taken_round_by_round():
    one = Rate("a", "float64", 1, 1, 1_000_000, (1.0, 2.0, 4.0))
    other = Rate("b", "float64", 1, 1, 1_000_000, (2.0, 4.0, 4.0))
    ratio = Ratio.of(one, other)
    assert (ratio.median, ratio.low, ratio.high) == pytest.approx((2.0, 1.0, 2.0))
    assert one.median_rate == pytest.approx(0.5)
    assert one.best_rate == pytest.approx(1.0)


@pytest.mark.parametrize(("calls", "threads", "share"), [(1, 1, 1.0), (1, 2, 0.5), (3, 2, 0.75), (41, 4, 41 / 44)])
def test_a_sweep_too_short_for_its_threads_is_told(calls, threads, share):
    """Three calls on two threads take as long as four."""
    rate = Rate(SWEEP, "float64", threads, 1, calls * SCENARIOS_PER_CALL, (1.0,))
    assert _busy_share(rate) == pytest.approx(share)
    assert any("threads' time" in note for note in _notes([rate], [])) == (share < 0.95)


# ---- Exactness ----


def test_disagreements_count_each_event_that_differs():
    sure = np.ones(4, bool), np.zeros(4, bool)
    single = NumpyOutcome(np.array([1.0, 40.0, 1.0, 9.0]), np.array([34.0, 36.0, 36.0, 8.0]), *sure)
    double = NumpyOutcome(np.array([1.0, 40.0, 1.0, 9.0]), np.array([36.0, 36.0, 36.0, 10.0]), *sure)
    found = {d.event: d for d in disagreements({"ls": single}, {"ls": double}, 35.0)}
    differing = {event: d.count for event, d in found.items() if d.count}
    assert differing == {"alarm": 1, "false_alarm": 1, "exceeded": 1, "misleading": 1}
    assert all(isinstance(d, Disagreement) and d.scenarios == 4 for d in found.values())
    # Clopper and Pearson without an event: 1 - 0.025^(1/4).
    assert found["hazard"].high == pytest.approx(1 - 0.025**0.25)


def test_every_event_of_the_engine_is_told_in_its_order():
    outcome = NumpyOutcome(
        np.array([0.0, 40.0, 40.0, 40.0, 20.0, 0.0, 0.0]),
        np.array([36.0, 36.0, 30.0, 30.0, 10.0, 10.0, 10.0]),
        np.array([True, True, True, False, True, True, False]),
        np.array([False, False, False, False, False, True, False]),
    )
    names = [event.name for event in EVENTS]
    seen = [{n for n, flag in zip(names, column, strict=True) if flag} for column in events_of(outcome, 35.0).T]
    assert seen == [
        {"alarm", "false_alarm"},
        {"alarm", "hazard", "exceeded"},
        {"hazard", "missed", "exceeded", "misleading"},
        {"alarm", "unavailable"},
        {"exceeded", "misleading"},
        {"unconverged"},
        {"alarm", "unavailable"},
    ]


def test_rates_of_both_precisions_have_intervals_that_know_of_shared_noise(table):
    rates = event_rates({"float64": table, "float32": table})
    assert overlapping(rates) == (18, 18)
    assert all(rate.independent_draws == LANES and rate.draws == 20 * LANES for rate in rates)
    none = [rate for rate in rates if rate.count == 0]
    assert none
    # Nothing in 256 independent draws, not in 5,120.
    assert all(rate.high == pytest.approx(1 - 0.025 ** (1 / LANES)) for rate in none)
    apart = [rates[0], *(r for r in event_rates({"float32": table.assign(alarms=0)}) if r.event == "alarm")]
    assert overlapping(apart) == (0, 1)


# ---- The command ----


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A run in tiny sizes beside a program, with its files."""
    folder = tmp_path_factory.mktemp("bench")
    sizes = Sizes(seconds=0.02, repetitions=2, draws=LANES, accuracy_scenarios=200, limit_scenarios=16, settled=False)
    record, text = run_bench(sizes=sizes, limit=limit_program(folder), out=folder / "out", progress=False)
    return record, text, folder / "out"


def test_a_benchmark_tells_rates_ratios_and_exactness(bench):
    record, text, _ = bench
    whats = {(rate.what, rate.precision) for rate in record.rates}
    assert {(SWEEP, "float64"), (SWEEP, "float32"), (NUMPY, "float64"), (LIMIT, "float64")} <= whats
    for rate in record.rates:
        assert len(rate.seconds) == 2
        assert 0 < rate.median_rate <= rate.best_rate < math.inf
    first = [rate.first_call_s for rate in record.rates if rate.what == SWEEP and rate.threads == 1]
    assert all(seconds is not None and seconds > 0 for seconds in first)
    compared = {(ratio.precision, ratio.to) for ratio in record.ratios}
    assert {("float64", NUMPY), ("float64", LIMIT), ("float32", NUMPY)} <= compared
    assert ("float32", LIMIT) not in compared

    largest = {(d.what, d.precision, d.method, d.quantity): d.largest_m for d in record.differences}
    for (_, precision, _, _), by_m in largest.items():
        # A few hundred roundings of numbers of at most 105 m.
        assert by_m < 300 * np.finfo(precision).eps * 105
    assert largest["pl_mc", "float32", "ls", "VPL"] > largest["pl_mc", "float64", "ls", "VPL"]
    assert (LIMIT, "float64", ROBUST.name, "VPL") in largest
    assert all(d.availability_differs == 0 and d.scenarios in (200, 16) for d in record.differences)
    assert {(d.method, d.event) for d in record.disagreements} == {
        (method, event.name) for method in ("ls", ROBUST.name) for event in EVENTS
    }
    for word in ("pl_mc.sweep", "batched NumPy", "hand-written kernel", "first call [s]", "float32", "load average"):
        assert word in text


def test_the_files_hold_the_same_and_no_path(bench, tmp_path):
    record, text, folder = bench
    assert {path.name for path in folder.iterdir()} == {"bench.json", "bench.csv", "bench.md"}
    told = json.loads((folder / "bench.json").read_text())
    assert told == json.loads(json.dumps(record.as_dict()))
    assert told["rates"][0]["median_rate"] == record.rates[0].median_rate
    assert told["machine"]["versions"]["jax"] == jax.__version__
    rows = pd.read_csv(folder / "bench.csv")
    np.testing.assert_allclose(rows.median_million_per_s, [rate.median_rate for rate in record.rates])
    assert (folder / "bench.md").read_text() == text + "\n"
    for path in folder.iterdir():
        for place in (folder, Path.home(), ROOT, Path(sys.prefix)):
            assert f"{place}" not in path.read_text()


def test_one_precision_compares_nothing_between_precisions():
    sizes = Sizes(seconds=0.01, repetitions=1, draws=LANES, accuracy_scenarios=200, limit_scenarios=16, settled=False)
    record, text = run_bench(sizes=sizes, precisions=["float64"], progress=False)
    assert {rate.precision for rate in record.rates} == {"float64"}
    assert record.disagreements == ()
    assert "float32" not in text
    assert LIMIT not in {rate.what for rate in record.rates}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seconds": 0.0}, ["seconds", "positive"]),
        ({"precisions": ["float46"]}, ["precision", "float46", "float64"]),
        ({"precisions": []}, ["precision", "at least one"]),
        ({"devices": 4097}, ["devices", "4097"]),
        ({"devices": 0}, ["devices", "at least 1"]),
        ({"limit": "nowhere"}, ["limit", "nowhere"]),
    ],
)
def test_options_that_cannot_be_used_are_one_sentence(options, words):
    with pytest.raises(pl_mc.InputError) as error:
        run_bench(**options)
    assert all(word in str(error.value) for word in words)
    assert str(error.value).count("\n") == 0


# ---- A program to compare with ----


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_program_says_its_precision_by_its_output(tmp_path, dtype):
    g = reference_geometry()
    errors = reference_errors_m(g, 32, seed=2)
    with limits(limit_program(tmp_path, dtype=dtype), g, errors, threads=2, precisions=["float64"]) as found:
        (one,) = found
        assert one.precision == dtype
        assert one.seconds() == pytest.approx(32 / 5e6)
        folder = one.folder
    assert not folder.exists()
    bound = 300 * np.finfo(dtype).eps * np.abs(errors).max()
    np.testing.assert_allclose(one.vpl_m, both_methods(g, errors)[ROBUST.name].vpl_m, rtol=0, atol=bound)


@pytest.mark.parametrize("printed", ["", "nan", "-3", "fast"])
def test_a_program_without_a_rate_is_told(tmp_path, printed):
    g = reference_geometry()
    program = limit_program(tmp_path, printed=printed)
    with (
        pytest.raises(pl_mc.InputError, match="printed no rate"),
        limits(program, g, reference_errors_m(g, 16, seed=2), threads=1, precisions=["float64"]),
    ):
        pass


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_a_source_is_compiled_for_each_precision_or_told(tmp_path):
    source = tmp_path / "kernel.cpp"
    # Protection levels of a third, in the precision that it is compiled for.
    source.write_text(
        "#include <cstdio>\n#include <vector>\nint main(int, char **argv) {\n"
        "  std::vector<double> out(16, double(REAL(1) / REAL(3)));\n"
        '  FILE *f = std::fopen(argv[2], "wb"); std::fwrite(out.data(), 8, out.size(), f); std::fclose(f);\n'
        '  std::printf("2.5\\n"); }\n'
    )
    g = reference_geometry()
    errors = reference_errors_m(g, 16, seed=2)
    with limits(source, g, errors, threads=1, precisions=["float64", "float32"]) as found:
        assert [one.precision for one in found] == ["float64", "float32"]
        assert all(one.seconds() == pytest.approx(16 / 2.5e6) for one in found)
    source.write_text("no program")
    with (
        pytest.raises(pl_mc.InputError, match="cannot compile"),
        limits(source, g, errors, threads=1, precisions=["float64"]),
    ):
        pass


# ---- Cost against size ----


def test_a_point_of_the_scaling_curve_is_a_process_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    # This process holds more than the other may be charged with.
    ballast = np.ones(150_000_000)
    table, text = run_scaling([5_110], workers=1, out=tmp_path / "curve", progress=False)
    (row,) = table.itertuples()
    assert row.scenarios == 5_120
    assert 0 < row.sweep_s < row.process_s
    assert 0 < row.processor_s < 4 * row.process_s
    assert row.scenarios_per_s == pytest.approx(5_120 / row.sweep_s)
    assert 100 < row.peak_memory_mb < ballast.nbytes / 1e6
    assert {path.name for path in (tmp_path / "curve").iterdir()} == {
        "scaling.csv", "scaling.md", "scaling.png", "scaling.svg",
    }  # fmt: skip
    assert "5,120" in text
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "curve" / "scaling.csv"), table)


def test_a_point_with_parts_goes_on_and_its_seconds_are_those_of_all_its_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    first = scaling([5_110], workers=1, parts=tmp_path, progress=False)
    (folder,) = tmp_path.iterdir()
    spent = json.loads((folder / "spent.json").read_text())
    assert 0 < spent["processor_s"] <= first.processor_s[0]
    (folder / "spent.json").write_text(json.dumps(dict.fromkeys(spent, 1000.0)))
    (part,) = folder.glob("part-*.parquet")
    counted = part.stat().st_mtime_ns
    again = scaling([5_110], workers=1, parts=tmp_path, progress=False)
    assert part.stat().st_mtime_ns == counted
    assert (again[["process_s", "processor_s", "sweep_s"]] > 1000).all(axis=None)


def test_the_curve_is_drawn_on_logarithmic_scales():
    columns = {"precision": "float64", "threads": 2, "sweep_s": 1.0, "scenarios_per_s": 1e6}
    table = pd.DataFrame({"scenarios": [10**6, 10**8], "process_s": [4.0, 40.0], "peak_memory_mb": [400.0, 420.0]})
    left, right = scaling_figure(table.assign(**columns)).axes
    assert [axes.get_xscale() for axes in (left, right)] == ["log", "log"]
    np.testing.assert_allclose(left.lines[0].get_ydata(), [4.0, 40.0])
    # In proportion to the last point a hundredth of the size takes a hundredth of the time.
    np.testing.assert_allclose(left.lines[1].get_ydata(), [0.4, 40.0])
    np.testing.assert_allclose(right.lines[0].get_ydata(), [400.0, 420.0])


def test_numbers_of_scenarios_are_read_as_people_write_them():
    assert scenario_counts("1e6, 20,3.5e7") == (10**6, 20, 35_000_000)
    for bad in ("1e6,", "many", "0", "1.5", "-4", "inf", "nan"):
        with pytest.raises(pl_mc.InputError, match="scaling"):
            scenario_counts(bad)
    with pytest.raises(pl_mc.InputError, match="scaling"):
        run_scaling([])
    with pytest.raises(pl_mc.InputError, match="only the points of --scaling have parts"):
        running.bench(parts=Path("parts"))
