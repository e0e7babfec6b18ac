"""`pl-mc observe` on real receiver days, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from pl_mc.cli.main import main
from pl_mc.experiments.checking import check_experiment
from pl_mc.experiments.loading import build_experiment
from pl_mc.injection import Injection, parse_injection
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.observe import STUDY

ESBC_TRUTH = "3582104.8991,532590.1966,5232755.2961"


@pytest.fixture
def esbjerg(data_folder: Path) -> tuple[str, str]:
    """Observation and navigation file of the static day."""
    name = "ESBC00DNK_R_20201770000_01D"
    return str(data_folder / f"{name}_30S_GC.rnx.gz"), str(data_folder / f"{name}_GC_nav.rnx.gz")


# 95 % of |E|, |N|, |U| [m] of single-point solutions with the same error model, from the README of the data.
@pytest.mark.parametrize(
    ("systems", "expected_m"), [("G,C", (0.99, 1.36, 1.76)), ("G", (1.46, 2.39, 2.97)), ("C", (0.68, 1.58, 2.34))]
)
def test_accuracy_on_the_static_day(
    tmp_path: Path, esbjerg: tuple[str, str], systems: str, expected_m: tuple[float, float, float]
) -> None:
    main(["observe", *esbjerg, "--truth", ESBC_TRUTH, "--systems", systems, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    assert list(table.columns) == [
        "epoch", "time", "method", "satellites", "east_m", "north_m", "up_m", "hpl_m", "vpl_m", "available",
        "alarm", "faulted",
    ]  # fmt: skip
    ls = table[table.method == "ls"]
    assert len(ls) == 2880
    for column, expected in zip(("east_m", "north_m", "up_m"), expected_m, strict=True):
        assert ls[column].abs().quantile(0.95) == pytest.approx(expected, rel=0.15)


def test_two_faulted_satellites_alarm_least_squares_and_not_the_robust_level(
    tmp_path: Path, esbjerg: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    # G15 and G17 stand above 30 degrees throughout these epochs.
    faults = [word for name in ("G15", "G17") for word in ("--fault", f"{name}:+30m:400-499")]
    main(["observe", *esbjerg, "--truth", ESBC_TRUTH, *faults, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    faulted = table[table.faulted]
    assert sorted(faulted.epoch.unique()) == list(range(400, 500))
    assert faulted[faulted.method == "ls"].alarm.mean() >= 0.95
    assert faulted[faulted.method == "igg3"].alarm.mean() <= 0.05
    assert "with injected fault" in capsys.readouterr().out
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["experiment"]["faults"] == ["G15:+30m:400-499", "G17:+30m:400-499"]
    assert len(manifest["inputs"]["observations"]["sha256"]) == 64
    stored = read_run_folder(tmp_path / "out")
    assert set(stored.tables) == {"epochs"}
    assert stored.document is not None
    assert stored.document.answer == STUDY.answer({"epochs": table}, build_experiment(stored.experiment, source=""))


def test_the_car_data_run(tmp_path: Path, data_folder: Path) -> None:
    files = ("CARD00ESP_R_20203341240_20M_01S_GC.rnx.gz", "CARD00ESP_R_20203340900_15H_GC_nav.rnx.gz")
    track = str(data_folder / "CARD_own_ppk.csv.gz")
    main(["observe", *(str(data_folder / f) for f in files), "--truth", track, "--out", str(tmp_path / "out")])
    table = pd.read_parquet(tmp_path / "out" / "epochs.parquet")
    ls = table[table.method == "ls"]
    assert len(ls) == 1201
    # The reference itself is good to a few metres; its README gives 95 % of 6.8, 9.4, 12.1 m with other weights.
    for column, expected in (("east_m", 6.8), ("north_m", 9.4), ("up_m", 12.1)):
        assert ls[column].abs().quantile(0.95) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fault", "G99:+30m:400-499"], "G99"),
        (["--fault", "G15:+30m:400-4990"], "0 to 2879"),
        (["--fault", "G15:+30m:499-400"], "400"),
        (["--fault", "G02:+30m:400-410"], "out of view"),
        (["--systems", "G,E"], "E"),
        (["--systems", "Q"], "Q"),
        (["--method", "ls2"], "nearest: ls"),
    ],
)
def test_what_observe_refuses(
    tmp_path: Path, esbjerg: tuple[str, str], capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["observe", *esbjerg, "--truth", ESBC_TRUTH, *options, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = str(tmp_path / "no.rnx")
    with pytest.raises(SystemExit) as stop:
        main(["observe", missing, missing, "--truth", ESBC_TRUTH, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert missing in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_check_names_every_missing_file_by_its_field(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    fields = {**STUDY.outline, "observations": "observations.rnx", "navigation": "navigation.rnx"}
    path.write_text("".join(f"{field} = {json.dumps(value)}\n" for field, value in fields.items()))
    problems = check_experiment(str(path)).problems
    assert [(problem.field, problem.line, problem.reason) for problem in problems] == [
        (name, line, f"{name}.rnx: there is no such file.") for line, name in ((3, "observations"), (4, "navigation"))
    ]


def test_injections_are_read() -> None:
    assert parse_injection("G02:+30m:545-645") == Injection("G02", 30.0, 545, 645)
    assert parse_injection(" C11:-20.5 ") == Injection("C11", -20.5)
    assert str(parse_injection("G02:+30m:545-645")) == "G02:+30m:545-645"


@pytest.mark.parametrize("text", ["", "G02", "G02:m", "G02:3xm", "G02:nan:1-2", "G02:inf", "G02:3:5", "G02:3:9-5"])
def test_other_injections_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="fault"):
        parse_injection(text)
