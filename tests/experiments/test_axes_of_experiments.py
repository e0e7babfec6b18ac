"""Experiments that are judged horizontally, or by several axes: tables, texts, figures, charts."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.alert import AXES, HORIZONTAL
from pl_mc.cli.main import main
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.report.comparison import PAIRED, compare_runs
from pl_mc.report.run_folder import read_run_folder
from pl_mc.statistics import ls_rates

# The settled default, which pages are looked at with, is compiled several times as long as plain solutions, and these
# longer than least squares: what is judged by which axis is the same for all.
PLAIN = ["ls", {"name": "igg3", "iterations": 2}]
METHODS = (pl_mc.ls(), pl_mc.igg3(iterations=2))
RAMP: dict[str, Any] = {
    "kind": "sweep", "title": "rail", "draws": 300, "seed": 3, "geometry": {"epochs": 1, "epoch": 0},
    "faults": {"satellite": "G12", "start_m": 0, "stop_m": 30, "step_m": 10}, "methods": ["ls"],
}  # fmt: skip
RAIL = {"name": "rail", "horizontal_m": 10.0}
BOTH = {"name": "both", "vertical_m": 15.0, "horizontal_m": 10.0}
VIEWS: dict[str, dict[str, Any]] = {
    "faults": {},
    # As many as the ramp has: one program serves both.
    "listed": {"faults": {"biases": ["none", "G12:+10m", "G12:+20m", "C01:+20m"]}},
    "satellites": {"view": "satellites", "draws_per_satellite": 64},
    "map": {
        "view": "map", "draws": 16, "faults": {"start_m": 10, "stop_m": 20, "step_m": 10},
        "geometry": {"epochs": 3, "interval_s": 3600.0},
    },
}  # fmt: skip
FIRST = {"faults": "rates", "listed": "rates", "satellites": "ramp", "map": "by_bias"}


def run(content: dict[str, Any], out: Path) -> Path:
    return run_experiment("one", build_experiment(content, source="test"), out).folder


def words_of(folder: Path) -> str:
    """All that a reader sees: the document with its captions and what is drawn, and the notes."""
    return (folder / "report.json").read_text() + (folder / "summary.md").read_text()


@pytest.mark.parametrize("view", VIEWS)
def test_a_horizontal_limit_alone_runs_to_a_page_that_never_says_vertical(view: str, tmp_path: Path) -> None:
    folder = run(RAMP | VIEWS[view] | {"alert": RAIL, "methods": ["ls", "igg3"]}, tmp_path / "out")
    said = words_of(folder)
    # Tables and the chart of levels have both levels.
    said = said.replace("VPL and HPL against the bias", "").replace("VPL, median and 5-95 % [m]", "")
    assert not re.search(r"VAL|VPL|vertical error|vertical protection|Judged|K_V", said)
    assert "HAL 10" in said
    assert "horizontal error > HPL" in said
    assert "Missed detections (horizontal error beyond the alert limit of 10 m, no alarm)" in said
    assert "is not judged" not in said
    assert "(HPL_R)" in said
    table = pd.read_csv(folder / f"{FIRST[view]}.csv")
    assert set(table.axis) == {HORIZONTAL}
    page = (folder / "report.html").read_text()
    assert '"name": "VAL"' not in page
    assert '"name":"VAL"' not in page


def test_rates_are_those_of_the_sweep_and_exact_ones_stand_beside_them(tmp_path: Path) -> None:
    folder = run(RAMP | {"alert": BOTH, "axes": list(AXES), "methods": PLAIN}, tmp_path / "out")
    g = pl_mc.simulate(epochs=1)[0]
    faults = pl_mc.ramp(g, satellite="G12", start_m=0, stop_m=30, step_m=10)
    alert = pl_mc.AlertLimits("both", 15.0, 10.0)
    expected = pl_mc.sweep(g, faults, draws=300, seed=3, alert=alert, axes=AXES, methods=METHODS, progress=False)
    pd.testing.assert_frame_equal(pd.read_csv(folder / "rates.csv"), expected, check_dtype=False)
    exact = pd.read_csv(folder / "exact.csv")
    assert list(dict.fromkeys(exact.axis)) == ["vertical", "horizontal"]
    for axis in ("vertical", "horizontal"):
        known = ls_rates(g, faults, alert=alert, axis=axis)  # type: ignore[arg-type]
        part = exact[exact.axis == axis].drop(columns="axis").reset_index(drop=True)
        pd.testing.assert_frame_equal(part, known, check_dtype=False)
    assert {"rates.png", "rates_horizontal.png", "rates_either.png"} <= {path.name for path in folder.iterdir()}
    answer = json.loads((folder / "report.json").read_text())["answer"]
    assert len(answer) == 9
    assert answer[1].startswith("Alarms (HPL > HAL): least squares (HPL)")
    assert answer[5].startswith("Misleading information (vertical error or horizontal error beyond its protection")
    summary = (folder / "summary.md").read_text()
    for heading in ("## Judged vertically", "## Judged horizontally", "## Judged by either limit"):
        assert summary.count(heading) == 1
    charts = re.search(r'"id": ?"rates".*?"menus": ?(\[.*?\]), ?"quantities"', (folder / "report.html").read_text())
    assert charts is not None
    assert json.loads(charts[1])[0]["values"] == list(AXES)


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("view", ["faults", "map"])
def test_the_vertical_is_what_it_was_and_the_other_limit_is_told(view: str, tmp_path: Path) -> None:
    content = RAMP | VIEWS[view]
    alone = run(content | {"alert": {"name": "both", "vertical_m": 15.0}}, tmp_path / "alone")
    told = run(content | {"alert": BOTH}, tmp_path / "told")
    several = run(content | {"alert": BOTH, "axes": list(AXES)}, tmp_path / "several")
    name = f"{FIRST[view]}.csv"
    assert (alone / name).read_bytes() == (told / name).read_bytes()
    table = pd.read_csv(several / name)
    part = table[table.axis == "vertical"].drop(columns="axis").reset_index(drop=True)
    pd.testing.assert_frame_equal(part, pd.read_csv(alone / name))
    note = "The horizontal alert limit of both, 10 m, is not judged: the vertical one, 15 m, decides alone."
    assert note in (told / "summary.md").read_text()
    assert "is not judged" not in (several / "summary.md").read_text()


@pytest.mark.usefixtures("without_figures")
def test_limits_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [f"{key} = {json.dumps(RAMP[key])}" for key in ("kind", "title", "draws", "seed", "methods")]
    faults = ["[faults]", *(f"{key} = {json.dumps(value)}" for key, value in RAMP["faults"].items())]
    Path("one.toml").write_text("\n".join([*lines, "[geometry]", "epochs = 1", "epoch = 0", *faults]))
    axes = {}
    for name, options in {
        "near": ("--hal", "4"),
        "far": ("--hal", "40"),
        "either": ("--val", "15", "--hal", "4", "--axes", "either"),
        "two": ("--val", "15", "--hal", "4", "--axes", "vertical", "--axes", "horizontal"),
        "vertical": ("--val", "15", "--hal", "4"),
    }.items():
        main(("run", "one.toml", "-q", "--out", name, *options))
        axes[name] = pd.read_csv(Path(name, "rates.csv"))
    assert set(axes["near"].axis) == set(axes["far"].axis) == {"horizontal"}
    assert axes["near"].alarms.sum() > axes["far"].alarms.sum()
    assert set(axes["either"].axis) == {"either"}
    assert (axes["either"].alarms.to_numpy() >= axes["near"].alarms.to_numpy()).all()
    assert set(axes["two"].axis) == {"vertical", "horizontal"}
    assert "axis" not in axes["vertical"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("run", "ramp", "--hal", "10", "--axes", "vertical"), "axes: vertical needs a vertical limit"),
        (("run", "ramp", "--hal", "-1"), "alert.horizontal_m: an alert limit is positive"),
        (("run", "guo2022", "--hal", "3"), "--hal: an experiment of the kind guo judges by no alert limit."),
        (("run", "zhao2021-readings", "--hal", "3", "--axes", "either"), "axes: either needs a vertical limit"),
        (("run", "guo2022", "--axes", "either"), "axes: an experiment of this kind judges by the vertical"),
    ],
)
def test_what_the_command_line_refuses(
    options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with pytest.raises(SystemExit) as stop:
        main((*options, "-q", "--out", str(tmp_path / "out")))
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.usefixtures("without_figures")
def test_compare_judges_availability_by_a_horizontal_limit_of_one_s_own(tmp_path: Path) -> None:
    content = RAMP | {"kind": "compare"}
    available = {}
    for hal_m in (4.0, 40.0):
        folder = run(content | {"alert": {"vertical_m": 15.0, "horizontal_m": hal_m}}, tmp_path / f"{hal_m:g}")
        available[hal_m] = pd.read_csv(folder / "overview.csv").availability.iloc[0]
    g = pl_mc.simulate(epochs=1)[0]
    drawn = pl_mc.sample(g, pl_mc.no_fault(g), draws=300, seed=3, methods="ls")
    for hal_m, share in available.items():
        assert share == np.mean((drawn.vpl_m <= 15.0) & (drawn.hpl_m <= hal_m))
    assert available[4.0] < available[40.0]


STANFORD: dict[str, Any] = {
    "kind": "stanford", "title": "rail", "draws": 300, "seed": 3, "geometry": {"epochs": 1, "epoch": 0},
    "faults": {"start_m": 5, "stop_m": 15, "step_m": 5}, "satellites": ["G12"], "methods": PLAIN,
}  # fmt: skip


def test_a_stanford_diagram_of_the_horizontal(tmp_path: Path) -> None:
    folder = run(STANFORD | {"alert": RAIL}, tmp_path / "out")
    said = words_of(folder)
    assert not re.search(r"VAL|VPL|vertical", said)
    assert "HAL 10 m" in said
    regions = pd.read_csv(folder / "regions.csv").set_index(["method", "region"])
    assert set(regions.axis) == set(pd.read_csv(folder / "stanford.csv").axis) == {HORIZONTAL}
    g = pl_mc.simulate(epochs=1)[0]
    faults = pl_mc.ramp(g, satellite="G12", start_m=5, stop_m=15, step_m=5)
    alert = pl_mc.AlertLimits("rail", horizontal_m=10.0)
    swept = pl_mc.sweep(g, faults, draws=300, seed=3, alert=alert, methods=METHODS, progress=False)
    for method, rows in swept.groupby("method"):
        count = regions.loc[method]["count"]
        assert count["misleading"] + count["hazardously misleading"] == rows.misleading.sum()
        assert count["hazardously misleading"] == rows.missed.sum()
        unavailable = count["system unavailable"] + count["system unavailable, error beyond level"]
        assert unavailable + count["no solution"] == rows.alarms.sum()


def test_a_stanford_diagram_has_one_error() -> None:
    for axes, words in (
        (["either"], "axes: this kind of experiment has one error and one level; choose vertical or horizontal"),
        (["vertical", "horizontal"], "axes: this kind of experiment judges by one axis at a time"),
    ):
        with pytest.raises(pl_mc.InputError, match=words):
            build_experiment(STANFORD | {"alert": BOTH, "axes": axes}, source="test")
    with pytest.raises(pl_mc.InputError, match="reach_m: more than the alert limit of 10 m is needed"):
        run(STANFORD | {"alert": RAIL, "reach_m": 8.0}, Path("nowhere"))


@pytest.mark.usefixtures("without_figures")
def test_runs_of_several_axes_are_compared_axis_by_axis(tmp_path: Path) -> None:
    """Epoch by epoch too, and a run that names no axis beside one that names three."""
    content = RAMP | {
        "draws": 32, "faults": {"biases": ["none", "G12:+10m"]}, "geometry": {"epochs": 40, "interval_s": 600.0},
    }  # fmt: skip
    near = {"name": "near", "vertical_m": 6.0, "horizontal_m": 4.0}
    several = run(content | {"alert": near, "axes": list(AXES)}, tmp_path / "several")
    same = run(content | {"alert": BOTH, "axes": list(AXES)}, tmp_path / "same")
    alone = run(content | {"alert": {"name": "alone", "vertical_m": 15.0}}, tmp_path / "alone")
    first, second, third = map(read_run_folder, (several, same, alone))
    found = compare_runs(first, second).rates
    assert set(found.axis) == set(AXES)
    assert (found.interval == PAIRED).any()
    counts = pd.read_csv(several / "rates.csv")
    alarms = found[(found.event == "alarm") & (found.method == "ls")]
    for row in alarms.itertuples():
        chosen = (counts.method == "ls") & (counts.axis == row.axis) & (counts.fault == row.fault)
        assert row.first_count == counts.alarms[chosen].iloc[0]
        assert row.low <= row.difference <= row.high
    assert set(compare_runs(second, third).rates.axis) == {"vertical"}
    assert (compare_runs(second, third).rates.difference == 0).all()
