"""The kind ``series``: the static and dynamic experiment of Zhao et al. (2021), simulated and on real receivers."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.engine import Execution
from pl_mc.experiments.checking import cost_of
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.series import STUDY
from pl_mc.studies.series.run import SeriesExperiment, solved
from pl_mc.studies.series.window_faults import WindowFaults, in_view_throughout
from pl_mc.studies.series.zhao2021 import PAPER
from pl_mc.studies.sources import drawn_errors_m

WINDOWS = [(10, 24), (40, 59)]
SMALL: dict[str, Any] = {
    "kind": "series",
    "title": "small",
    "compare": "static",
    "redraws": 2,
    "source": {"kind": "site", "epochs": 80, "interval_s": 30.0},
    "faults": {"windows": WINDOWS},
}
COLUMNS = [
    "epoch", "time", "method", "satellites", "east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available", "alarm",
    "unconverged", "tied",
    "faulted",
]  # fmt: skip


def made(**changes: Any) -> SeriesExperiment:
    experiment = build_experiment(SMALL | changes, source="test")
    assert isinstance(experiment, SeriesExperiment)
    return experiment


def faults_of(**changes: Any) -> WindowFaults:
    return made(faults=SMALL["faults"] | changes).faults


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("series") / "small"
    run_experiment("small", made(), folder)
    return folder


@pytest.fixture(scope="module")
def geometry() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=80)


# What a run leaves behind.


def test_files_are_named_after_the_paper(small: Path) -> None:
    figures = ("fig1_satellites", "fig3_errors_ls", "fig4_errors_robust", "fig5_vpl")
    wanted = {f"{name}.{ending}" for name in figures for ending in ("png", "svg")}
    wanted |= {"epochs.parquet", "faults.csv", "redraws.csv", "table1.csv", "table1.md"}
    wanted |= {"assumptions.md", "summary.md", "manifest.json", "report.html", "report.json"}
    assert {path.name for path in small.iterdir()} == wanted


def test_epochs_hold_both_methods_and_the_windows(small: Path) -> None:
    epochs = pd.read_parquet(small / "epochs.parquet")
    assert list(epochs.columns) == COLUMNS
    assert epochs.epoch.tolist() == [epoch for epoch in range(80) for _ in range(2)]
    assert epochs.method.tolist() == ["ls", "igg3"] * 80
    assert epochs.time.iloc[0] == pd.Timestamp("2017-11-21")
    assert epochs.time.iloc[-1] == pd.Timestamp("2017-11-21") + pd.Timedelta(seconds=79 * 30)
    inside = epochs.epoch.between(10, 24) | epochs.epoch.between(40, 59)
    np.testing.assert_array_equal(epochs.faulted, inside)


def test_least_squares_alarms_in_the_windows_and_the_robust_method_hardly(small: Path) -> None:
    epochs = pd.read_parquet(small / "epochs.parquet")
    alarms = epochs.groupby(["method", "faulted"]).alarm.mean()
    assert alarms["ls", True] > 0.8
    assert alarms["igg3", True] < 0.1
    assert alarms["ls", False] == alarms["igg3", False] == 0


def test_the_table_is_that_of_the_epochs(small: Path) -> None:
    epochs, table = pd.read_parquet(small / "epochs.parquet"), pd.read_csv(small / "table1.csv")
    assert list(table.columns[:6]) == [
        "direction", "statistic", "before_m", "after_m", "paper_before_m", "paper_after_m",
    ]  # fmt: skip
    for name, method in (("before_m", "ls"), ("after_m", "igg3")):
        mine = epochs[epochs.method == method]
        direct = []
        for column in ("east_m", "north_m", "up_m"):
            size = np.sort(np.abs(mine[column].to_numpy()))
            place = 0.95 * (len(size) - 1)
            low = int(place)
            direct += [size[low] + (place - low) * (size[low + 1] - size[low]), np.sqrt(np.mean(size**2))]
        np.testing.assert_allclose(table[name], direct, rtol=1e-12)
    assert (table.before_low_m <= table.before_m).all()
    assert (table.before_m <= table.before_high_m).all()


def test_the_papers_numbers_are_as_printed(small: Path) -> None:
    table = pd.read_csv(small / "table1.csv")
    assert table.paper_before_m.tolist() == [2.570, 1.151, 7.763, 2.779, 10.110, 4.851]
    assert table.paper_after_m.tolist() == [0.956, 0.471, 1.495, 0.800, 3.051, 1.767]
    # Table 2 has quantiles below the RMS, as the paper prints them.
    assert PAPER["dynamic"].before_m == ((1.709, 8.554), (2.157, 6.449), (20.712, 4.890))
    assert PAPER["dynamic"].after_m == ((1.625, 1.389), (0.875, 0.991), (2.792, 1.998))


def test_redraws_are_counted_one_by_one(small: Path) -> None:
    epochs, redraws = pd.read_parquet(small / "epochs.parquet"), pd.read_csv(small / "redraws.csv")
    assert redraws.redraw.tolist() == [0, 0, 1, 1, 2, 2]
    own = redraws[redraws.redraw == 0].set_index("method")
    inside = epochs[epochs.faulted]
    for method, group in inside.groupby("method"):
        assert own.alarms[method] == group.alarm.sum()
        assert own.exceeded[method] == (group.up_m.abs() > group.vpl_m).sum()
        assert own.faulted_epochs[method] == 35
    assert redraws.satellites.nunique() > 1


def test_the_summary_and_the_reasons_say_what_is_ours(small: Path) -> None:
    summary, page = (small / "summary.md").read_text(), (small / "table1.md").read_text()
    for part in ("median of VPL_R / VPL", "Clopper-Pearson", "unavailable", "10.11", "epochs 10-24 and 40-59"):
        assert part in summary
    assert page.count("before: the paper is ") == page.count("; after: the paper is ") == 6
    assert re.search(r"the paper is (below|above) all redraws: .*(nominal|noise drawn)", page)


def test_the_same_seed_gives_the_same_tables(small: Path, geometry: pl_mc.Geometry, tmp_path: Path) -> None:
    run_experiment("small", made(), tmp_path / "again")
    for name in ("faults.csv", "redraws.csv", "table1.csv", "table1.md", "summary.md", "epochs.parquet"):
        assert (tmp_path / "again" / name).read_bytes() == (small / name).read_bytes()
    listed = [faults_of().draw(geometry, seed=seed).listed for seed in (0, 1)]
    assert not listed[0].equals(listed[1])


def test_a_run_writes_nothing_and_answers_alike_of_tables_read_back(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    findings = STUDY.run(made(), Execution(progress=False))
    assert list(tmp_path.iterdir()) == []
    stored = read_run_folder(small)
    assert set(findings.data) == set(stored.tables) == {"faults", "redraws", "table1"}
    assert STUDY.answer(findings.data, made()) == STUDY.answer(stored.tables, made())
    assert stored.document is not None
    assert stored.document.answer == STUDY.answer(stored.tables, made())


def test_the_cost_is_that_of_every_solution() -> None:
    assert cost_of(made()).scenarios == 80 * 3 * 2
    receiver = {"kind": "receiver", "observations": "a.rnx", "navigation": "b.rnx", "truth": "1,2,3"}
    cost = cost_of(made(source=receiver))
    assert cost.scenarios is None
    assert cost.seconds is not None


def test_a_receiver_says_what_is_read_of_it() -> None:
    receiver = {"kind": "receiver", "observations": "a.rnx", "navigation": "b.rnx", "truth": "1,2,3"}
    assert "systems those it has, mask" in made(source=receiver).source.describe()
    dual = made(source={**receiver, "systems": ["G", "E"], "signals": ["E1+E5b"], "ionosphere": "dual"})
    assert "systems G + E, signals E1+E5b, ionosphere dual, mask" in dual.source.describe()


# What is drawn.


def test_a_pair_a_window_in_view_throughout(small: Path, geometry: pl_mc.Geometry) -> None:
    listed = pd.read_csv(small / "faults.csv")
    assert len(listed) == 2 * (15 + 20)
    for first, last in WINDOWS:
        part = listed[listed.epoch.between(first, last)]
        assert part.groupby("satellite").size().tolist() == [last - first + 1] * 2
        candidates = in_view_throughout(geometry, np.arange(first, last + 1))
        assert set(part.satellite) <= {geometry.names[k] for k in candidates}
    assert listed.bias_m.between(5, 100).all()
    assert listed.bias_m.nunique() == len(listed)


def test_sizes_are_uniform_and_satellites_all_alike(geometry: pl_mc.Geometry) -> None:
    faults, candidates = faults_of(), in_view_throughout(geometry, np.arange(10, 25))
    draws = [faults.draw(geometry, seed=3, redraw=k) for k in range(100)]
    sizes = np.concatenate([draw.listed.bias_m for draw in draws])
    assert sizes.min() >= 5
    assert sizes.max() <= 100
    # Mean and spread of a uniform distribution, within four standard errors.
    spread = 95 / np.sqrt(12)
    assert abs(sizes.mean() - 52.5) < 4 * spread / np.sqrt(sizes.size)
    chosen = [name for draw in draws for name in draw.chosen[0]]
    share = 2 / candidates.size
    count = np.array([chosen.count(geometry.names[k]) for k in candidates])
    assert np.abs(count - 100 * share).max() < 4 * np.sqrt(100 * share * (1 - share))


def test_biases_stand_in_the_rows_of_their_satellites(geometry: pl_mc.Geometry) -> None:
    drawn = faults_of().draw(geometry, seed=7)
    at, row = np.nonzero(drawn.bias_m)
    assert geometry.in_view[at, row].all()
    names = [geometry.names[k] for k in geometry.satellite[at, row]]
    found = pd.DataFrame({"epoch": at, "satellite": names, "bias_m": drawn.bias_m[at, row]})
    pd.testing.assert_frame_equal(
        found.sort_values(["epoch", "satellite"], ignore_index=True),
        drawn.listed.sort_values(["epoch", "satellite"], ignore_index=True),
    )


def test_one_size_a_window_and_random_signs(geometry: pl_mc.Geometry) -> None:
    listed = faults_of(size="one_per_window").draw(geometry, seed=1).listed
    window = listed.epoch > 24
    assert (listed.groupby([window, "satellite"]).bias_m.nunique() == 1).all()
    signed = faults_of(sign="random").draw(geometry, seed=1).listed
    assert 0.2 < (signed.bias_m < 0).mean() < 0.8
    assert signed.bias_m.abs().between(5, 100).all()
    # The option changes signs alone: satellites and sizes stay.
    np.testing.assert_array_equal(signed.bias_m.abs(), faults_of().draw(geometry, seed=1).listed.bias_m)


def test_noise_is_that_of_the_sweep(geometry: pl_mc.Geometry) -> None:
    part = geometry[:6]
    errors_m = drawn_errors_m(part, draws=2, seed=5, precision="float64")
    sampled = pl_mc.sample(part, pl_mc.no_fault(part), draws=2, seed=5, methods=("ls",))
    for draw in range(2):
        solved = pl_mc.solve(part, errors_m[draw], methods=("ls",))
        same = sampled[sampled.draw == draw].sort_values("epoch")
        for column in ("east_m", "up_m", "vpl_m"):
            np.testing.assert_allclose(solved[column], same[column], rtol=1e-9, atol=1e-9)


# The experiments that come with the package.


@pytest.mark.parametrize(
    ("name", "kind", "windows"),
    [
        ("zhao2021-static", "site", ((545, 645), (1708, 1808))),
        ("zhao2021-static-esbc", "receiver", ((545, 645), (1708, 1808))),
        ("zhao2021-dynamic", "flight", ((2250, 2500), (5000, 5250))),
        ("zhao2021-dynamic-card", "receiver", ((300, 400), (800, 900))),
    ],
)
def test_shipped_experiments_say_what_the_paper_says(name: str, kind: str, windows: tuple) -> None:
    experiment = load_experiment(name)[1]
    assert isinstance(experiment, SeriesExperiment)
    assert experiment.source.kind == kind
    assert experiment.faults.windows == windows
    assert experiment.faults.satellites == 2
    assert experiment.source.mask_deg == 10
    assert experiment.compare in name


def test_a_flight_is_solved_like_a_site(tmp_path: Path) -> None:
    source = {"kind": "flight", "start": "2018-08-07T12:52:13", "epochs": 300}
    # The methods do not matter here, and least squares compiles in no time.
    methods = [{"name": "ls"}, {"name": "ls", "k_vertical": 4.0}]
    experiment = made(source=source, compare="dynamic", faults={"windows": [(20, 60)]}, methods=methods, redraws=0)
    run_experiment("flight", experiment, tmp_path / "flight")
    names = {path.name for path in (tmp_path / "flight").iterdir()}
    assert {"flight.csv", "flight.png", "table2.csv", "fig2_satellites.svg", "fig9_vpl.png"} <= names
    flight = pd.read_csv(tmp_path / "flight" / "flight.csv")
    epochs = pd.read_parquet(tmp_path / "flight" / "epochs.parquet")
    # The climbing turn, well over 10 degrees of bank, hides satellites.
    count = epochs.drop_duplicates("epoch").satellites.to_numpy()
    assert count[flight.bank_deg.abs() > 15].min() < count[flight.bank_deg == 0].min()
    assert "may be exchanged (a guess)" in (tmp_path / "flight" / "table2.md").read_text()


@pytest.mark.parametrize("name", ["zhao2021-static-esbc", "zhao2021-dynamic-card"])
def test_alarms_of_real_receivers(name: str, data_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PL_MC_DATA", str(data_folder))
    experiment = load_experiment(name)[1]
    assert isinstance(experiment, SeriesExperiment)
    series = experiment.source.series(draws=1, seed=experiment.seed, precision="float64")
    epochs, faults = solved(experiment, series, 0)
    assert faults.faulted.sum() == sum(last - first + 1 for first, last in experiment.faults.windows)
    alarms = epochs[epochs.faulted].groupby("method").alarm.mean()
    assert alarms["ls"] > 0.8
    assert alarms["igg3"] < 0.2


@pytest.mark.usefixtures("without_figures")
def test_a_receivers_results_do_not_say_where_its_files_lie(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PL_MC_DATA", str(data_folder))
    methods = [{"name": "ls"}, {"name": "ls", "k_vertical": 4.0}]
    experiment = load_experiment("zhao2021-dynamic-card", {"redraws": 0, "methods": methods})[1]
    run_experiment("card", experiment, tmp_path / "card")
    for name in ("summary.md", "manifest.json", "table2.md"):
        assert str(data_folder) not in (tmp_path / "card" / name).read_text()
    manifest = json.loads((tmp_path / "card" / "manifest.json").read_text())
    assert set(manifest["inputs"]) == {"observations", "navigation", "truth"}


# What is wrong is said in a sentence.


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"source": {"kind": "boat"}}, "test: source: its kind is one of site, flight, receiver"),
        ({"source": {}}, "test: source: its kind is one of site, flight, receiver"),
        ({"source": {"kind": "site", "epoch": 3}}, "test: source.epoch: input should be None, not 3."),
        ({"source": {"kind": "site", "sight": "CUT0"}}, "test: source.sight: there is no such field (nearest: site"),
        ({"faults": {"windows": []}}, "test: faults.windows: tuple should have at least 1 item"),
        ({"faults": {"windows": [[9, 5]]}}, "test: faults.windows: windows go from a first to a last epoch"),
        ({"faults": {"windows": [[1, 5], [5, 9]]}}, "test: faults.windows: windows go from a first to a last epoch"),
        ({"faults": {"windows": [[1, 5]], "highest_m": 4.0}}, "test: faults.highest_m: it is at least lowest_m, 5 m"),
        ({"faults": {"windows": [[1, 5]], "size": "each"}}, "test: faults.size: input should be 'every_epoch' or"),
        ({"methods": [{"name": "ls"}]}, "test: methods: two methods are needed"),
        ({"compare": "table"}, "test: compare: input should be 'static' or 'dynamic'"),
        ({"redraws": 256}, "test: redraws: input should be less than 256, not 256."),
    ],
)
def test_wrong_fields_are_named(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(pl_mc.InputError) as caught:
        made(**changes)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"windows": [[60, 80]]}, "faults.windows: 60-80 is outside the series, 0-79."),
        ({"satellites": 30}, "faults.satellites: 30 are needed, but "),
    ],
)
def test_faults_that_a_series_cannot_hold(changes: dict[str, Any], sentence: str, geometry: pl_mc.Geometry) -> None:
    with pytest.raises(pl_mc.InputError, match=re.escape(sentence)):
        faults_of(**changes).draw(geometry, seed=1)


def test_missing_receiver_files_name_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = load_experiment("zhao2021-static-esbc")[1]
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PL_MC_DATA", raising=False)
    with pytest.raises(pl_mc.InputError, match=r"source.observations: ESBC.*let the environment variable PL_MC_DATA"):
        run_experiment("missing", experiment, tmp_path / "out")
    monkeypatch.setenv("PL_MC_DATA", str(tmp_path))
    with pytest.raises(pl_mc.InputError, match=r"which the environment variable PL_MC_DATA names"):
        run_experiment("missing", experiment, tmp_path / "out")
    assert not (tmp_path / "out").exists()
