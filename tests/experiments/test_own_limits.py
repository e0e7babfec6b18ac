"""Alert limits of a user's own in an experiment file and on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import pl_mc
from pl_mc.cli.main import main
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.input_errors import InputError

CONTENT: dict[str, Any] = {
    "kind": "sweep", "title": "small", "draws": 300, "seed": 3, "geometry": {"epochs": 1, "epoch": 0},
    "faults": {"biases": [{"G12": 20.0}]}, "methods": ["ls"],
}  # fmt: skip


def test_limits_in_a_table_and_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [f"{key} = {json.dumps(CONTENT[key])}" for key in ("kind", "title", "draws", "seed", "methods")]
    Path("one.toml").write_text(
        "\n".join([*lines, 'alert = {name = "mine", vertical_m = 12}', "[geometry]", "epochs = 1", "epoch = 0",
                   "[[faults.biases]]", "G12 = 20.0"])
    )  # fmt: skip
    main(("run", "one.toml", "-q"))
    main(("run", "runs/one/manifest.json", "-q", "--out", "again"))
    main(("run", "one.toml", "-q", "--val", "30", "--out", "wider"))
    g = pl_mc.simulate(epochs=1)[0]
    rates = {}
    for folder, limit_m in (("runs/one", 12.0), ("again", 12.0), ("wider", 30.0)):
        rates[folder] = pd.read_csv(Path(folder, "rates.csv")).alarm_rate.iloc[0]
        limits = pl_mc.AlertLimits("x", vertical_m=limit_m)
        faults = pl_mc.biases(g, {"G12": 20.0})
        expected = pl_mc.sweep(g, faults, draws=300, seed=3, methods="ls", alert=limits).alarm_rate.iloc[0]
        assert rates[folder] == expected
    assert rates["runs/one"] > rates["wider"]
    assert "Alert limit: mine, VAL 12" in Path("runs/one/summary.md").read_text()


@pytest.mark.parametrize(
    ("alert", "words"),
    [
        (35, "alert: an operation's name, or a table such as .vertical_m = 25., is needed, not 35"),
        ({"val": 7}, "alert.val: there is no such field .valid: name, vertical_m, horizontal_m"),
        ({"vertical_m": "20"}, "alert.vertical_m: a number is needed"),
        ({"vertical_m": -3.0}, "alert.vertical_m: an alert limit is positive and finite"),
        ({}, "alert: own limits has no limit"),
        ("LPV200", "alert: 'LPV200' is unknown .nearest: LPV-200"),
    ],
)
def test_limits_that_cannot_be(alert: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        build_experiment(CONTENT | {"alert": alert}, source="test").alert_limits()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            [3],
            "faults.biases.0: a table of biases in metres by satellite, or text such as G02:.30m, is needed, not 3.$",
        ),
        ([{"G12": "x"}], "faults.biases.0: a table of biases in metres by satellite"),
        ([], "faults.biases: tuple should have at least 1 item"),
    ],
)
def test_faults_that_are_none(given: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        build_experiment(CONTENT | {"faults": {"biases": given}}, source="test")
    assert "\n" not in str(caught.value)


def test_faults_as_text_in_an_experiment() -> None:
    record = build_experiment(CONTENT | {"faults": {"biases": ["none", "G12+G22:+30m"]}}, source="test")
    g = pl_mc.simulate(epochs=1)[0]
    faults, notes = record.faults.build(g)  # type: ignore[attr-defined]
    assert faults.labels == ("none", "G12:+30m,G22:+30m")
    assert notes == ()


def test_a_limit_for_what_judges_by_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(("run", "guo2022", "--val", "3", "-q"))
    assert stop.value.code == 2
    assert "--val: an experiment of the kind guo judges by no alert limit." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("alert", "words"),
    [
        ({"horizontal_m": 7.0}, "alert: own limits has no vertical limit, which decides here"),
        ({"vertical_m": 20.0, "horizontal_m": 7.0}, "alert.horizontal_m: 7 m would decide nothing here"),
        ("RNP 0.1", "alert: RNP 0.1 has no vertical limit"),
    ],
)
def test_limits_of_a_kind_that_takes_no_axes(alert: Any, words: str) -> None:
    record = load_experiment("guo2022", {"alert": alert})[1]
    with pytest.raises(InputError, match=words):
        record.alert_limits()


BOTH = {"vertical_m": 15.0, "horizontal_m": 10.0}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": "vertical", "alert": "RNP 0.1"}, "axes: vertical needs a vertical limit, and RNP 0.1 has HAL 185 m"),
        ({"axes": ["either"], "alert": {"vertical_m": 3}}, "axes: either needs a horizontal limit, and own limits has"),
        ({"axes": "up"}, "axes: 'up' is unknown"),
        ({"axes": []}, "axes: at least one is needed .of vertical, horizontal, either"),
        ({"axes": ["vertical", "vertical"]}, "axes: each axis is judged once"),
        ({"axes": 3}, "axes: a sequence of axes is needed"),
    ],
)
def test_axes_that_cannot_be(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        build_experiment(CONTENT | change, source="test")
    assert "\n" not in str(caught.value)
    assert str(caught.value).count("axes:") == 1


def test_kinds_that_take_no_axes_or_one_at_a_time() -> None:
    with pytest.raises(InputError, match="axes: an experiment of this kind judges by the vertical limit, or by limits"):
        load_experiment("guo2022", {"axes": "horizontal"})
    files = {"observations": "a", "navigation": "b", "truth": "1,2,3", "title": "t", "kind": "observe", "alert": BOTH}
    with pytest.raises(InputError, match="axes: this kind of experiment judges by one axis at a time"):
        build_experiment(files | {"axes": ["vertical", "horizontal"]}, source="test")
    assert build_experiment(files | {"axes": "either"}, source="test").judged_axes() == ("either",)


def test_the_axis_of_an_experiment() -> None:
    for change, axes in (
        ({}, ("vertical",)),
        ({"alert": BOTH}, ("vertical",)),
        ({"alert": {"horizontal_m": 7.0}}, ("horizontal",)),
        ({"alert": "RNP 0.1"}, ("horizontal",)),
        ({"alert": BOTH, "axes": "either"}, ("either",)),
        ({"alert": BOTH, "axes": ["horizontal", "vertical"]}, ("horizontal", "vertical")),
    ):
        assert build_experiment(CONTENT | change, source="test").judged_axes() == axes
