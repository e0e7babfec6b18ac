"""Faults as texts in experiments, in files and on the command line, for every kind that takes them."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.cli.main import main
from pl_mc.engine.drawn_biases import numbers_of_draw
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.experiments.source_files import experiment_files
from pl_mc.faults import fault_text, parse_fault
from pl_mc.injection import inject
from pl_mc.input_errors import InputError
from pl_mc.studies.registry import KINDS

EPOCHS = 12
FILE = f"""kind = "sweep"
title = "small"
draws = 200
seed = 3
methods = ["ls"]

[geometry]
epochs = {EPOCHS}
interval_s = 600

[faults]
biases = ["G01:+30m:0-5", "G:+0.002m/s", "pairs G01+C01:uniform(5,50)m"]
"""
GIVEN = ["G01:+30m:0-5", "G:+0.002m/s", "pairs G01+C01:uniform(5,50)m"]
LABELS = ["G01:+30m:0-5", "G:+0.002m/s", "G01+C01:uniform(5,50)m"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(FILE)
    return tmp_path


def series() -> pl_mc.Geometry:
    return pl_mc.simulate(epochs=EPOCHS, interval_s=600.0)


def table_of(texts: list[str], **options: Any) -> pd.DataFrame:
    g = series()
    first, *rest = (pl_mc.biases(g, text) for text in texts)
    given: dict[str, Any] = {"draws": 200, "seed": 3, "methods": "ls", "progress": False} | options
    return pl_mc.sweep(g, sum(rest, first), **given)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.usefixtures("without_figures")
def test_a_file_with_faults_of_every_shape(here: Path) -> None:
    assert check_experiment("one.toml").text() == ""
    main(("run", "one.toml", "-q"))
    rates = pd.read_csv("runs/one/rates.csv")
    expected = table_of(LABELS)
    assert rates.fault.tolist() == LABELS
    assert rates.alarms.tolist() == expected.alarms.tolist()
    assert rates.epochs.tolist() == [6, EPOCHS, EPOCHS]
    exact = pd.read_csv("runs/one/exact.csv")
    assert exact.groupby("fault").epoch.count().to_dict() == {LABELS[0]: 6, LABELS[1]: EPOCHS}
    summary = Path("runs/one/summary.md").read_text()
    assert [line.split("|")[-2].strip() for line in summary.splitlines() if line.startswith(f"| {LABELS[2]}")] == ["-"]


def test_a_table_of_distributions_is_their_text() -> None:
    content = tomllib.loads(
        FILE.replace(
            FILE.rpartition("biases = ")[2],
            """[
        {G01 = ["uniform", 5, 100]}, {"C01+C02" = ["normal", 0, 10], G01 = 3, G12 = 0}, {G = 20.0}]""",
        )
    )
    faults = build_experiment(content, source="test").faults  # type: ignore[attr-defined]
    assert faults.build(series())[0].labels == ("G01:uniform(5,100)m", "C01+C02:normal(0,10)m,G01:+3m", "G:+20m")
    for given, words in (
        (["gamma", 2], r"faults.biases.0: law: 'gamma' is unknown"), (["uniform", 5], "numbers: fixed takes one"),
        (["uniform", 9, 5], "uniform takes two sizes in order"), ("5", "a table of biases in metres by satellite"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words):
            build_experiment(content | {"faults": {"biases": [{"G01": given}]}}, source="test")


@pytest.mark.usefixtures("without_figures")
def test_faults_of_the_command_line_take_the_place_of_the_files(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texts = ["C01:+0.01m/s:3-", "G+C:+-20m", "G01:+30m,C02:-20m"]
    labels = ["C01:+0.01m/s:3-", "G+C:+-20m", "G01:+30m,C02:-20m"]
    given = [part for text in texts for part in ("--fault", text)]
    main(("run", "one.toml", "-q", *given, "--draws", "300", "--seed", "4", "--val", "20", "--out", "mine"))
    rates = pd.read_csv("mine/rates.csv")
    assert rates.fault.tolist() == labels
    expected = table_of(texts, draws=300, seed=4, alert=pl_mc.AlertLimits("x", vertical_m=20.0))
    assert rates.alarms.tolist() == expected.alarms.tolist()
    recorded = json.loads(Path("mine/manifest.json").read_text())["experiment"]
    assert recorded["faults"] == {"biases": texts}
    assert recorded["title"] == "small; faults instead: " + "; ".join(texts)
    # The manifest redoes the run; finished runs of the same faults are found again, those of others are not.
    main(("run", "mine/manifest.json", "-q", "--out", "again"))
    assert pd.read_csv("again/rates.csv").equals(rates)
    main(("run", "one.toml", "-q", *given, "--draws", "300", "--seed", "4", "--val", "20", "--out", "mine", "--resume"))
    said = refused(capsys, "run", "one.toml", "--fault", "C01:+3m", "--out", "mine", "--resume")
    assert "the finished run there is one of another experiment" in said
    for share in ("1/2", "2/2"):
        main(("run", "one.toml", "-q", *given, "--shard", share, "--out", "shared"))
    main(("merge", "shared", "-q", "--out", "merged"))
    assert pd.read_csv("merged/rates.csv").fault.tolist() == labels
    main(("run", "mine/manifest.json", "-q", "--fault", "none", "--out", "free"))
    free = json.loads(Path("free/manifest.json").read_text())["experiment"]
    assert free["title"] == "small; faults instead: none"


@pytest.mark.parametrize("view", [{"view": "map"}, {"view": "satellites", "draws_per_satellite": 10}])
def test_faults_make_the_view_fault_by_fault(view: dict[str, Any], here: Path) -> None:
    content = {
        "kind": "sweep", "title": "x", "draws": 20, "geometry": {"epochs": 1, "epoch": 0}, **view,
        "faults": {"start_m": 0, "stop_m": 5, "step_m": 5} | ({} if view["view"] == "map" else {"satellite": "G01"}),
    }  # fmt: skip
    Path("manifest.json").write_text(json.dumps({"name": "x", "experiment": content}))
    _, record = load_experiment("manifest.json", faults=("G:+20m",))
    assert record.model_dump()["view"] == "faults"
    assert record.faults.build(pl_mc.simulate(epochs=1)[0])[0].labels == ("G:+20m",)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G01:+0m", "one.toml: faults.biases.0: bias of G01: a bias of size zero is no fault"),
        ("G01:nan", "a bias is a finite number of metres, not nan"),
        ("G01", "faults.biases.0: 'G01' is no fault; the form is G02:+30m"),
        ("G01:+30m:9-5", "the window 9-5 ends before it begins; did you mean 5-9?"),
        ("each:+3m,G01:+3m", "is no fault; one bias follows each"),
        ("G99:+30m", "satellite: 'G99' is not in view"),
        ("R:+20m", "'R' is not in view: none of GLONASS is there (valid: G, C)"),
        ("G01:+30m:9-12", "fault G01:+30m:9-12: epochs run from 0 to 11."),
    ],
)
def test_what_is_no_fault(here: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    assert words in refused(capsys, "run", "one.toml", "--fault", text)
    Path("two.toml").write_text(FILE.replace(", ".join(map(json.dumps, GIVEN)), json.dumps(text)))
    (problem,) = check_experiment("two.toml").problems
    assert problem.line == 12
    assert problem.field.startswith("faults.biases")
    assert words.rpartition("biases.0: ")[2] in f"biases: {problem.reason}"
    assert not Path("runs/one").exists()


def test_a_check_counts_the_faults_that_are_given(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(("check", "one.toml", "--fault", "G01:+30m:0-5", "--fault", "G:+20m"))
    assert f"Cost: {200 * (6 + EPOCHS):,} scenarios over all methods" in capsys.readouterr().out
    with pytest.raises(SystemExit) as stop:
        main(("check", "one.toml", "--fault", "G01:+30m:9-12"))
    assert stop.value.code == 2
    assert "fault G01:+30m:9-12: epochs run from 0 to 11." in capsys.readouterr().err
    assert "takes none from outside" in refused(capsys, "check", "guo2022", "--fault", "G01:+30m")


def test_a_ramp_without_epochs(capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, "run", "ramp", "--fault", "G01:+0.1m/s")
    assert "fault G01:+0.1m/s: a ramp in time needs a series of epochs" in said


TAKEN = {"observe", "series", "stanford", "sweep", "time-ramps", "tuning"}


def test_kinds_that_take_faults_say_so_and_others_refuse_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert {kind for kind in KINDS if KINDS[kind].with_faults is not None} == TAKEN
    refusing = {}
    for name in experiment_files():
        kind = load_experiment(name)[1].model_dump()["kind"]
        if kind in TAKEN:
            text = "G01:+0.1m/s" if kind == "time-ramps" else "G01:+30m"
            assert load_experiment(name, faults=(text,))[1] != load_experiment(name)[1]
        else:
            refusing[kind] = name
    assert set(refusing) == set(KINDS) - TAKEN
    for kind, name in refusing.items():
        said = refused(capsys, "run", name, "--fault", "G01:+30m")
        assert said.startswith(
            f"pl-mc: --fault: an experiment of the kind {kind} takes none from outside (kinds that do:"
        )


SERIES: dict[str, Any] = {
    "kind": "series", "title": "small", "compare": "static", "redraws": 1, "methods": ["ls", "huber"],
    "source": {"kind": "site", "epochs": 30, "interval_s": 30.0},
    "faults": {"biases": ["G01:+30m:5-9", {"C01": 3.0}, "C02:normal(0,9)m:8-12"]},
}  # fmt: skip


@pytest.mark.usefixtures("without_figures")
def test_a_series_with_given_faults(tmp_path: Path) -> None:
    record = build_experiment(SERIES, source="test")
    run_experiment("small", record, tmp_path / "out")
    g = pl_mc.simulate(epochs=30, interval_s=30.0)
    listed = pd.read_csv(tmp_path / "out" / "faults.csv").pivot(index="epoch", columns="satellite", values="bias_m")
    assert listed.G01.dropna().to_dict() == dict.fromkeys(range(5, 10), 30.0)
    assert listed.C01.dropna().to_dict() == dict.fromkeys(range(30), 3.0)
    numbers, row = numbers_of_draw(g, seed=record.seed)[:, 0], g.names.index("C02")
    drawn = [9.0 * numbers[k, np.flatnonzero(g.satellite[k] == row)[0]] for k in range(8, 13)]
    np.testing.assert_allclose(listed.C02.dropna(), drawn, rtol=1e-9)
    epochs = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert epochs.faulted.all()
    first = pd.read_csv(tmp_path / "out" / "redraws.csv").satellites.iloc[0]
    assert set(first.split("+")) == {"G01", "C01", "C02"}
    summary = (tmp_path / "out" / "summary.md").read_text()
    assert "Faults: G01:+30m:5-9; C01:+3m; C02:normal(0,9)m:8-12; drawn with seed" in summary
    assert "over 2 draws of sizes and noise" in summary
    # The errors are those of the sweep's first draw with all faults together.
    faults = sum((pl_mc.biases(g, one) for one in SERIES["faults"]["biases"][1:]), pl_mc.biases(g, "G01:+30m:5-9"))
    errors_m, _, _ = inject(g, np.zeros(g.sigma_m.shape), faults, numbers_of_draw(g, seed=record.seed))
    free = pl_mc.sample(g, pl_mc.no_fault(g), draws=1, seed=record.seed, methods="ls")
    shift = (pl_mc.statistics.ls_quantities(g).gain * errors_m).sum(axis=1)
    found = epochs[epochs.method == "ls"].up_m.to_numpy() - free.up_m.to_numpy()
    np.testing.assert_allclose(found, shift, atol=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["none"], "faults.biases: a series needs an epoch with a fault"),
        (["G01:+30m:5-30"], "fault G01:+30m:5-30: epochs run from 0 to 29."),
        (["E01:+30m"], "satellite: 'E01' is not in view"),
    ],
)
def test_series_refuse_what_they_cannot_inject(given: list[str], words: str, tmp_path: Path) -> None:
    record = build_experiment(SERIES | {"faults": {"biases": given}}, source="test")
    with pytest.raises(InputError) as caught:
        run_experiment("small", record, tmp_path / "out")
    assert words in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("without_figures")
def test_a_diagram_of_given_faults(tmp_path: Path) -> None:
    content: dict[str, Any] = {
        "kind": "stanford", "title": "small", "draws": 300, "methods": ["ls"], "geometry": {"epochs": 4},
        "faults": {"biases": ["G01:uniform(5,90)m", "G01:+30m:1-2"]},
    }  # fmt: skip
    run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    regions = pd.read_csv(tmp_path / "out" / "regions.csv")
    assert (regions.scenarios == 300 * (4 + 2)).all()
    g = pl_mc.simulate(epochs=4)
    faults = pl_mc.biases(g, "G01:uniform(5,90)m") + pl_mc.biases(g, "G01:+30m:1-2")
    expected = pl_mc.sweep(g, faults, draws=300, seed=20171121, methods="ls", progress=False).alarms.sum()
    assert regions["count"][regions.region.str.startswith("system unavailable")].sum() == expected
    assert "G01:uniform(5,90)m; G01:+30m:1-2; 300 draws each" in (tmp_path / "out" / "summary.md").read_text()
    with pytest.raises(InputError, match="satellites: they get a ramp, which faults has to give"):
        run_experiment("x", build_experiment(content | {"satellites": ["G01"]}, source="test"), tmp_path / "no")


def test_ramps_in_time_become_rates() -> None:
    own = load_experiment("time-ramps")[1].model_dump()
    made = load_experiment("time-ramps", faults=("G05:+0.1m/s:60-", "G05:-0.2m/s:60-"))[1].model_dump()
    changed = {field: value for field, value in made.items() if value != own[field]}
    assert changed.pop("title").endswith("; faults instead: G05:+0.1m/s:60-; G05:-0.2m/s:60-")
    assert changed == {"satellite": "G05", "rates_m_per_s": (0.1, -0.2), "onset_s": 60 * own["geometry"]["interval_s"]}


@pytest.mark.parametrize(
    "texts",
    [
        ("G05:+3m",), ("none",), ("G05:+0.1m/s", "G06:+0.1m/s"), ("G05:+0.1m/s:60-90",), ("G05:normal(0,1)m/s",),
        ("G05:+0.1m/s", "G05:+0.2m/s:60-"), ("G05+G06:+0.1m/s",), ("G05:+0.1m/s,G06:+0.1m/s",),
    ],
)  # fmt: skip
def test_other_faults_are_no_ramps_in_time(texts: tuple[str, ...]) -> None:
    with pytest.raises(InputError, match=r"--fault: .*: time-ramps takes ramps of one satellite that begin together"):
        load_experiment("time-ramps", faults=texts)


def test_faults_as_text_in_a_tuning() -> None:
    record = load_experiment("igg3-tuning", faults=("none", "G01:+10m"))[1]
    assert record.model_dump()["faults"] == ("none", "G01:+10m")


def test_the_file_of_the_how_to() -> None:
    page = Path(__file__).parents[2].joinpath("docs", "how-to", "faults.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    content = tomllib.loads(FILE.partition("[faults]")[0].replace(f"epochs = {EPOCHS}", "epochs = 240") + block)
    faults = build_experiment(content, source="test").faults.build(pl_mc.simulate(epochs=240))[0]  # type: ignore[attr-defined]
    assert faults.labels[:2] == ("none", "G01:+30m:100-199")
    assert faults.drawn.sum() == 1
    # Every text of its table is a fault, and its own label or that of the same fault.
    for text in re.findall(r"`([^`]+)`", "".join(re.findall(r"^\| (`.*?) \|", page, re.MULTILINE))):
        assert parse_fault(fault_text(parse_fault(text))) == parse_fault(text)
