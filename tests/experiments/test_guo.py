"""The kind ``guo``: what a run leaves behind, and the paper's numbers beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment, load_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.charts import charts_of
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.guo import STUDY
from pl_mc.studies.guo.paper import COUNTED, PRINTED
from pl_mc.studies.guo.run import GuoExperiment, without_satellites
from pl_mc.studies.guo.series import crossed_factors

GEO = ["C01", "C02", "C03", "C04", "C05", "C59", "C60", "C61"]
SMALL: dict[str, Any] = {
    "kind": "guo",
    "title": "small",
    "draws": 64,
    "calibration_draws": 199,
    "source": {
        "kind": "site", "site": "JFNG", "start": "2020-12-01T00:00:00", "epochs": 24, "interval_s": 3600.0,
        "constellations": ["GPS", "BDS-2", "BDS-3"], "without": GEO, "error_model": "constant",
    },
    "curves": {"epoch": 3, "step_m": 20.0, "draws": 300, "calibration_draws": 999},
}  # fmt: skip
REQUIRED_COLUMNS = [
    "test", "reading", "level", "bias_m", "epochs", "detections", "detection_rate", "low", "high", "paper_rate",
    "threshold", "p_fa_nominal", "p_fa_measured",
]  # fmt: skip


def made(**changes: Any) -> GuoExperiment:
    experiment = build_experiment(SMALL | changes, source="test")
    assert isinstance(experiment, GuoExperiment)
    return experiment


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("guo") / "small"
    run_experiment("small", made(), folder)
    return folder


def test_files(small: Path) -> None:
    figures = (
        "fig1_residuals",
        "fig2_satellites",
        "fig3_t",
        "fig4_t",
        "fig5_f",
        "detection",
        "power",
        "power_satellites",
    )
    wanted = {f"{name}.{ending}" for name in figures for ending in ("png", "svg")}
    tables = ("detection", "detection_draws", "hypotheses", "variance_factor", "power", "reliability")
    wanted |= {f"{name}.csv" for name in tables} | {
        "epochs.parquet",
        "summary.md",
        "manifest.json",
        "report.html",
        "assumptions.md",
        "report.json",
    }
    assert {path.name for path in small.iterdir()} == wanted
    assert json.loads((small / "manifest.json").read_text())["experiment"]["p_fa"] == 0.01


def test_detection_is_counted_over_the_epochs(small: Path) -> None:
    table, epochs = pd.read_csv(small / "detection.csv"), pd.read_parquet(small / "epochs.parquet")
    assert list(table.columns[: len(REQUIRED_COLUMNS)]) == REQUIRED_COLUMNS
    assert len(table) == 2 * 2 * 4
    assert (table.epochs == 24).all()
    for (test, level, bias), group in table.groupby(["test", "level", "bias_m"]):
        mine = epochs[(epochs.test == test) & (epochs.bias_m == bias)]
        threshold = mine.threshold if level == "nominal" else mine.threshold_equal
        assert group.detections.item() == (mine.statistic > threshold).sum()
        assert group.threshold.item() == pytest.approx(threshold.median())
    printed = table[(table.level == "nominal") & (table.bias_m > 0)].set_index(["test", "bias_m"]).paper_rate
    assert printed["mean_check"].tolist() == [0.480, 0.955, 0.994]
    assert printed["chi2"].tolist() == [0.0, 0.032, 0.655]


def test_biases_are_on_the_least_detectable_beidou_satellite(small: Path) -> None:
    epochs = pd.read_parquet(small / "epochs.parquet")
    assert epochs.satellite.str.startswith("C").all()
    assert not epochs.satellite.isin(GEO).any()
    assert (epochs.groupby("epoch").satellite.nunique() == 1).all()
    chosen = epochs[epochs.epoch == 3].satellite.iloc[0]
    reliable = pd.read_csv(small / "reliability.csv")
    mine = reliable[reliable.name.str.startswith("C")]
    assert mine.name[mine.mdb_m.idxmax()] == chosen


def test_many_draws_agree_with_the_exact_law(small: Path) -> None:
    draws = pd.read_csv(small / "detection_draws.csv")
    exact = draws[draws.exact_rate.notna()]
    assert exact.bias_m.tolist() == [0, 10, 20, 30]
    assert (exact.exact_p_value > 1e-4).all()
    power = pd.read_csv(small / "power.csv", keep_default_na=False, na_values=[""])
    assert (power.exact_p_value.dropna() > 1e-5).all()
    assert power.satellite.isna().sum() == 4


def test_the_papers_own_numbers_do_not_agree_with_each_other() -> None:
    assert COUNTED["mean_check"][20.0] / 2880 == pytest.approx(0.970, abs=5e-4)
    assert PRINTED["mean_check"][20.0] == 0.955
    for bias in (10.0, 30.0):
        assert COUNTED["mean_check"][bias] / 2880 == pytest.approx(PRINTED["mean_check"][bias], abs=1e-3)
    for bias, count in COUNTED["chi2"].items():
        assert count / 2880 == pytest.approx(PRINTED["chi2"][bias], abs=5e-4)


def test_no_variance_factor_serves_the_whole_line(small: Path) -> None:
    factors = pd.read_csv(small / "variance_factor.csv").set_index(["line", "bias_m"])
    for (line, bias), row in factors.iterrows():
        # The factor solves what it was asked for.
        wanted = row.paper_rate or 1 - 0.5 ** (1 / 2880)
        assert row[f"rate_{bias:g}m"] == pytest.approx(wanted, rel=0.01), line


def test_the_same_seed_gives_the_same_tables(small: Path, tmp_path: Path) -> None:
    run_experiment("small", made(), tmp_path / "again")
    for name in ("detection.csv", "detection_draws.csv", "power.csv", "summary.md", "epochs.parquet"):
        assert (tmp_path / "again" / name).read_bytes() == (small / name).read_bytes()


def test_a_run_writes_nothing_and_answers_alike_of_tables_read_back(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    findings = STUDY.run(made(), Execution(progress=False))
    assert list(tmp_path.iterdir()) == []
    stored = read_run_folder(small)
    assert set(findings.data) == set(stored.tables)
    assert STUDY.answer(findings.data, made()) == STUDY.answer(stored.tables, made())


def test_detection_is_charted_bias_by_bias(small: Path) -> None:
    stored = read_run_folder(small)
    assert stored.document is not None
    charts = {chart["id"]: chart for chart in charts_of(stored.document.tables, stored.tables, val_m=35.0)}
    assert list(charts) == ["detection", "detection_draws", "power"]
    assert len({chart["title"] for chart in charts.values()}) == 3
    for chart in charts.values():
        assert chart["curves"] == ["chi2, apriori", "mean_check, shift_kept"]
        assert [quantity["label"] for quantity in chart["quantities"]] == ["detection"]
    assert [menu["label"] for menu in charts["power"]["menus"]] == ["level", "satellite"]


def test_satellites_are_left_out_with_their_errors() -> None:
    series = made().source.series(draws=1, seed=1, precision="float64")
    g, errors = without_satellites(series, ("G01", "C21"))
    assert not {"G01", "C21"} & set(g.names)
    whole = series.geometry
    for e in range(len(g)):
        before = dict(
            zip(np.array(whole.names)[whole.satellite[e][whole.in_view[e]]], series.errors_m[0, e], strict=False)
        )
        after = dict(zip(np.array(g.names)[g.satellite[e][g.in_view[e]]], errors[e], strict=False))
        assert after == {name: value for name, value in before.items() if name not in ("G01", "C21")}


def test_no_hour_decides_its_own_factor() -> None:
    rng = np.random.default_rng(4)
    ratios, time_s = rng.exponential(size=(2880, 2)), 30.0 * np.arange(2880)
    factors = crossed_factors(ratios, time_s, 0.05)
    odd = (time_s // 3600) % 2 == 1
    changed = ratios.copy()
    changed[odd] *= 2.0
    again = crossed_factors(changed, time_s, 0.05)
    np.testing.assert_array_equal(again[odd], factors[odd])
    np.testing.assert_allclose(again[~odd], 2.0 * factors[~odd])
    # 1440 epochs choose, 1440 others judge.
    assert abs((ratios > factors).mean() - 0.05) < 4 * np.sqrt(0.05 * 0.95 * 2 / 5760)


def test_the_shipped_files_are_sound() -> None:
    for name in ("guo2022", "guo2022-esbc"):
        loaded, experiment = load_experiment(name)
        assert loaded == name
        assert isinstance(experiment, GuoExperiment)
        readings = {test.label.split(",")[0] for test in experiment.test_records()}
        assert readings == {"apriori", "divided", "shift_kept", "shared_clock", "separate_fits", "weighted"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tests": [{"name": "chi"}]}, "test: 'chi' is unknown"),
        ({"system": "E"}, "system: 'E' has no satellite"),
        ({"curves": SMALL["curves"] | {"epoch": 99}}, "curves.epoch: 99 is not among the epochs 0 to 23"),
    ],
)
def test_what_cannot_be_run_is_refused(changes: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        run_experiment("bad", made(**changes), tmp_path / "bad")


def test_wrong_fields_are_named() -> None:
    with pytest.raises(InputError, match=r"curves.draws.*\n?") as caught:
        made(curves={"epoch": 3}, biases=[10.0])
    assert "biases: there is no such field (nearest: biases_m" in str(caught.value)
