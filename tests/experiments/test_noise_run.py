"""The experiment about noise models, and noise in an experiment file of a sweep."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pl_mc
from pl_mc.engine import Execution
from pl_mc.experiments.loading import build_experiment
from pl_mc.experiments.running import run_experiment
from pl_mc.input_errors import InputError
from pl_mc.report.run_folder import read_run_folder
from pl_mc.studies.noise import STUDY

GEOMETRY = {"epochs": 1, "epoch": 0}
NOISE = {
    "kind": "noise",
    "title": "small",
    "draws": 3000,
    "seed": 5,
    "geometry": GEOMETRY,
    "faults": {"satellite": "G22", "sizes_m": [10.0]},
    "noises": [{"name": "gaussian"}, {"name": "student_t", "nu": 3.0, "match": "core"}],
    "methods": [{"name": "ls"}],
    "exposure": {"taus_s": [0.0, 5.0], "duration_s": 5.0, "draws": 256, "event": "exceeded"},
}


def test_factors_are_the_rates_of_the_sweeps(tmp_path: Path) -> None:
    run_experiment("small", build_experiment(NOISE, source="test"), tmp_path / "out")
    folder = tmp_path / "out"
    factors = pd.read_csv(folder / "factors.csv")
    g = pl_mc.simulate(epochs=1)[0]
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G22": 10.0})
    counted = pl_mc.sweep(g, faults, draws=3000, seed=5, methods=("ls",), noise=pl_mc.student_t(3, "core"))
    exact = pl_mc.exact.ls_rates(g, faults)
    rows = factors[factors.noise == "student_t(nu=3,match=core)"]
    for event, column in (("alarm", "alarms"), ("misleading", "misleading"), ("missed", "missed")):
        of_event = rows[rows.event == event]
        assert of_event["count"].tolist() == counted[column].tolist()
        np.testing.assert_allclose(of_event.gaussian_rate, exact[f"{event}_rate"], rtol=1e-12)
        np.testing.assert_allclose(of_event.rate, counted[f"{event}_rate"])
    known = rows[rows.factor.notna()]
    np.testing.assert_allclose(known.factor, known.rate / known.gaussian_rate)
    assert (known.factor_low < known.factor).all()
    assert len(pd.read_csv(folder / "exposures.csv")) == 2 * 9
    for name in ("noise_models.png", "exposures.png"):
        assert (folder / name).stat().st_size > 20_000
    assert "student_t(nu=3,match=core)" in (folder / "summary.md").read_text(encoding="utf-8")
    stored = read_run_folder(folder)
    assert stored.document is not None
    assert STUDY.answer(stored.tables, build_experiment(NOISE, source="test")) == stored.document.answer


def test_the_run_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    experiment = build_experiment(NOISE | {"rare": {"max_evaluations": 500_000}}, source="test")
    findings = STUDY.run(experiment, Execution(progress=False))
    assert list(findings.data) == ["rates", "factors", "risks", "exposures"]
    assert [picture.name for picture in STUDY.pictures(findings.data, experiment)] == ["noise_models", "exposures"]
    assert not list(tmp_path.iterdir())


def test_rare_events_and_exposures_are_in_the_cost() -> None:
    """Two noise models under no fault with one method; 5 samples by 2 correlation times by 256 draws."""
    work = STUDY.beside(build_experiment(NOISE, source="test"))
    assert work.seconds == pytest.approx(2 * 2_000_000 / 5.9e4 + 5 * 2 * 256 / 2.0e6)
    assert work.remark == "as if all 2 rare events had to be estimated, which only a run can tell"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"noises": [{"name": "student_t"}, {"name": "gaussian"}]}, "the first has to be gaussian"),
        ({"noises": [{"name": "gaussian"}, {"name": "gaussian"}]}, "gaussian is asked for twice"),
        ({"noises": [{"name": "gaussian"}, {"name": "student", "nu": 3.0}]}, "'student' is unknown"),
        ({"rare": {"methods": ["igg4"]}}, "rare.methods: 'igg4' is unknown"),
        ({"geometry": {"epochs": 2}}, "needs one epoch"),
    ],
)
def test_what_cannot_be_used_says_why(changed: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        run_experiment("small", build_experiment(NOISE | changed, source="test"), tmp_path / "out")


def test_a_sweep_takes_its_noise_from_the_file(tmp_path: Path) -> None:
    content = {
        "kind": "sweep", "title": "small", "draws": 2000, "seed": 5, "geometry": GEOMETRY,
        "faults": {"biases": [{}, {"G22": 10.0}]}, "methods": [{"name": "ls"}],
        "noise": {"name": "student_t", "nu": 3.0, "match": "core"},
    }  # fmt: skip
    run_experiment("small", build_experiment(content, source="test"), tmp_path / "out")
    rates = pd.read_csv(tmp_path / "out" / "rates.csv")
    g = pl_mc.simulate(epochs=1)[0]
    faults = pl_mc.no_fault(g) + pl_mc.biases(g, {"G22": 10.0})
    table = pl_mc.sweep(g, faults, draws=2000, seed=5, methods=("ls",), noise=pl_mc.student_t(3.0, "core"))
    assert rates.alarms.tolist() == table.alarms.tolist()
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["experiment"]["noise"] == {"name": "student_t", "nu": 3.0, "match": "core"}
    assert "noise student_t(nu=3,match=core)" in (tmp_path / "out" / "summary.md").read_text(encoding="utf-8")
